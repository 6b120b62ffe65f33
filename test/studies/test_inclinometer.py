# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Calibrations from simulated inclinations, whose deviations independent readings confirm."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.interpolate import PchipInterpolator

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.studies.inclinometer import (
    PERCENT,
    AngleReading,
    Inclinometer,
    InclinometerError,
    calibrate,
    crank_angle,
    curve_report,
    fit,
    pairs_of,
    parameters,
    still_reading,
)

ERROR = math.radians(0.5)  # standard deviation of the inclinometer


@pytest.fixture(scope="module")
def kinematics(mechanism: Mechanism) -> Kinematics:
    """Return the kinematics of the paper's linkage."""
    return Kinematics(mechanism)


def volts(alpha3: np.ndarray, bend: float) -> np.ndarray:
    """Return what a sensor shows that a lever turns: an arc sine instead of a straight line."""
    share = (alpha3 - math.radians(135.0)) / math.radians(45.0)
    return 2.5 - 2.0 * np.arcsin(bend * share) / math.asin(bend)


def simulated(
    rng: np.random.Generator, count: int, bend: float, noise: float
) -> list[AngleReading]:
    """Return points over the stroke with errors of the inclinometer and of the sensor."""
    alpha3 = np.radians(np.linspace(90.0, 180.0, count))
    readings = volts(alpha3, bend) + noise * rng.normal(size=count) / 10.0  # a mean of a hundred
    shown = alpha3 + ERROR * rng.normal(size=count)
    pairs = zip(readings.tolist(), shown.tolist(), strict=True)
    return [AngleReading(str(i), reading, y, y, ERROR) for i, (reading, y) in enumerate(pairs)]


@pytest.mark.parametrize("bend", [0.01, 0.6, 0.95])
@pytest.mark.parametrize("count", [5, 8])
@pytest.mark.parametrize("noise", [0.0, 0.04])
def test_independent_readings_confirm_the_deviation(count: int, bend: float, noise: float) -> None:
    """The intervals of 95 % hold for new angles and readings, and are not far too wide."""
    rng = np.random.default_rng(1)
    within, ratios = [], []
    for _ in range(60):
        found = fit(simulated(rng, count, bend, noise), [0.5, 4.5], noise)
        alpha3 = np.radians(rng.uniform(90.0, 180.0, 50))
        readings = volts(alpha3, bend) + noise * rng.normal(size=50)
        ends = found.pairs[0], found.pairs[-2]
        curve = PchipInterpolator(found.pairs[0::2], found.pairs[1::2])
        away = curve(np.clip(readings, *ends)) - alpha3
        within.append((np.abs(away) <= 1.96 * found.stddev).mean())
        ratios.append((away**2).mean() / found.stddev**2)
    assert np.mean(within) > 0.93
    assert math.sqrt(np.mean(ratios)) > 0.3


@pytest.mark.parametrize("body", ["input_crank", "lower_link", "lift_rod"])
@pytest.mark.parametrize("alpha3_deg", [91.0, 135.0, 179.0])
def test_angles_of_other_bodies(
    mechanism: Mechanism, kinematics: Kinematics, body: str, alpha3_deg: float
) -> None:
    """The inclination of a link, without half turns, leads back to the crank angle."""
    configuration = kinematics.at(math.radians(alpha3_deg))
    for turn in (0.0, -math.pi, math.pi):
        inclination = configuration.angle(body) + turn
        found, slope = crank_angle(mechanism, kinematics, body, inclination)
        assert found == pytest.approx(math.radians(alpha3_deg), abs=1e-9)
        assert slope == pytest.approx(1.0 / configuration.velocity_ratio(body))


@pytest.mark.parametrize(
    ("body", "degrees", "words"),
    [
        ("boom", 10.0, "There is no body 'boom'; name one of: lower_link, upper_link"),
        ("input_crank", 50.0, "No pose in the stroke has input_crank at the inclination 50.00 deg"),
        ("lower_link", 60.0, "lower_link has -21.1, "),
        ("implement", 95.0, "implement has the inclination 95.00 deg at alpha3 = "),
    ],
)
def test_inclinations_that_show_no_angle(
    mechanism: Mechanism, kinematics: Kinematics, body: str, degrees: float, words: str
) -> None:
    """A body or an inclination that does not exist, or that occurs twice, is refused."""
    with pytest.raises(InclinometerError) as raised:
        crank_angle(mechanism, kinematics, body, math.radians(degrees))
    assert words in str(raised.value)


def point(reading: float, degrees: float) -> AngleReading:
    """Return a point with an error of half a degree."""
    return AngleReading(f"{reading:g}={degrees:g}", reading, 0.0, math.radians(degrees), ERROR)


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        ([(1.0, 90.0), (2.0, 120.0)], "2 points do not show their errors; measure three or more"),
        (
            [(1.0, 90.0), (2.0, 120.0), (3.0, 105.0), (4.0, 150.0)],
            "not monotone: 2=120 has the reading 2 and 120.00 deg, 3=105 has 3 and 105.00 deg",
        ),
        ([(0.0, 120.0), (1.0, 140.0), (2.0, 120.0 - 1e-12)], "not monotone: 1=140 has"),
        ([(0.0, 120.0), (1.0, 140.0), (2.0, 120.0 - 1e-5)], "not monotone: 0=120 has"),
        ([(1.0, 90.0), (1.0, 120.0), (3.0, 150.0)], "1=120 has 1 and 120.00 deg"),
        ([(2.0, 90.0), (2.0, 90.0), (2.0, 90.0)], "span 0.00 deg only"),
        ([(2.0, 90.0), (2.0, 120.0), (2.0, 150.0)], "not monotone"),
        ([(1.0, 90.0), (2.0, 90.0), (3.0, 90.0)], "span 0.00 deg only"),
        ([(1.0, 90.0), (2.0, 90.5), (3.0, 91.0)], "span 1.00 deg only; measure over the whole"),
    ],
)
def test_points_without_a_calibration(pairs: list[tuple[float, float]], words: str) -> None:
    """Too few points, and angles that turn back, are refused with the points."""
    with pytest.raises(InclinometerError) as raised:
        fit([point(*pair) for pair in pairs], [], 0.0)
    assert words in str(raised.value)


def test_a_wrong_point_is_named() -> None:
    """A point that is far off is named, and widens the deviation."""
    good = [point(float(r), 180.0 - 10.0 * r) for r in range(9)]
    found = fit(good, [0.0, 10.0], 0.0)
    assert found.degree == 1
    assert "extrapolated by 0 below and 2 above" in curve_report(found, "input_crank")
    assert "times as large" not in curve_report(found, "input_crank")
    wrong = [*good[:4], point(4.0, 145.0), *good[5:]]
    bad = fit(wrong, [0.0, 10.0], 0.0)
    assert "most at 4=145: measure it again" in curve_report(bad, "input_crank")
    assert bad.stddev > 2.0 * found.stddev


def test_parameters_are_those_of_the_node() -> None:
    """The printed YAML has the pairs as numbers, also where they are small or whole."""
    found = fit([point(float(r) * 1e-9, 180.0 - 10.0 * r) for r in range(9)], [0.0, 0.0], 0.0)
    values = yaml.safe_load(parameters(found, "any"))["/**"]["ros__parameters"]
    for k in (0, 1):
        own, expected = values["calibration"][k::2], found.pairs[k::2]
        np.testing.assert_allclose(own, expected, rtol=1e-8, atol=1e-8 * max(expected))
    assert all(isinstance(value, float) for value in values["calibration"])
    assert values["angle_stddev"] == pytest.approx(found.stddev, rel=1e-2)


def test_a_moment_at_rest() -> None:
    """The reading around a moment is its mean; a hitch that moves, and other times, are refused."""
    times = np.arange(0, 20_000_000_000, 100_000_000)
    rng = np.random.default_rng(2)
    values = 40.0 + 0.1 * rng.normal(size=len(times))
    values[100:] += 5.0 * (times[100:] / 1e9 - 10.0)
    mean, noise = still_reading(times, values, 5.0, "5=120")
    assert mean == pytest.approx(40.0, abs=0.2)
    assert noise == pytest.approx(0.1, rel=0.7)
    for moment, words in (
        (12.0, "so the hitch moves"),
        (25.0, "outside the bag"),
        (-1.0, "outside"),
    ):
        with pytest.raises(InclinometerError, match=words):
            still_reading(times, values, moment, "x")
    values[:] = np.nan
    with pytest.raises(InclinometerError, match="no reading within"):
        still_reading(times, values, 5.0, "x")


def test_a_bag_without_readings(mechanism: Mechanism, kinematics: Kinematics) -> None:
    """A bag in which no reading is available is refused, also beside readings."""
    scene = Inclinometer(mechanism, kinematics, "input_crank", 0.0, 0.5)
    series = np.arange(3), np.full(3, math.nan)
    with pytest.raises(InclinometerError, match=r"The bag has no reading that is available"):
        calibrate(scene, [], ["1=-20", "2=-40", "3=-60"], series, "any")


def test_words_of_another_form() -> None:
    """A word without two numbers is refused."""
    assert pairs_of(["12.5=128"], "T=DEG") == [("12.5=128", 12.5, 128.0)]
    for word in ("12.5", "a=b", "1=2=3", "1=nan", "1e300=2"):
        with pytest.raises(InclinometerError, match="write T=DEG"):
            pairs_of([word], "T=DEG")


@pytest.mark.parametrize("scatter", [0.5, 3.0])
def test_scatter_widens_the_deviation(scatter: float) -> None:
    """The deviation of a straight line is that of `numpy.polyfit`, at the farthest reading.

    Residuals that are larger than the inclinometer explains scale it; smaller ones do not.
    """
    # No polynomial of second degree is nearer to these residuals than a straight line.
    readings, away = np.arange(4.0), np.array([1.0, -3.0, 3.0, -1.0]) / 3.0
    degrees = 180.0 - 20.0 * readings + scatter * math.degrees(ERROR) * away
    found = fit([point(*pair) for pair in zip(readings, degrees, strict=True)], [0.0, 5.0], 0.0)
    assert found.degree == 1
    how: Any = True if scatter > 1.0 else "unscaled"
    _, covariance = np.polyfit(readings, np.radians(degrees), 1, w=np.full(4, 1.0 / ERROR), cov=how)
    at = np.array([5.0, 1.0])
    assert found.stddev == pytest.approx(math.sqrt(at @ covariance @ at), rel=1e-9)


def test_noise_of_the_reading_adds_by_the_slope() -> None:
    """A reading that deviates by 0.2 moves the angle of a line of -10 deg per unit by 2 deg."""
    good = [point(float(r), 180.0 - 10.0 * r) for r in range(9)]
    alone, noisy = (fit(good, [0.0, 8.0], noise).stddev for noise in (0.0, 0.2))
    assert noisy == pytest.approx(math.hypot(alone, math.radians(2.0)), rel=1e-9)


@pytest.fixture(scope="module")
def scene(mechanism: Mechanism, kinematics: Kinematics) -> Inclinometer:
    """Return an inclinometer on the crank of a tractor that stands on a slope of 2 deg."""
    return Inclinometer(mechanism, kinematics, "input_crank", 2.0, 0.5)


def test_readings_of_the_bag_belong_to_the_calibration(scene: Inclinometer) -> None:
    """It reaches from the least to the largest, and half of their step adds to the deviation."""
    words = [f"{reading:g}={-12.0 - 20.0 * reading:g}" for reading in (0.0, 1.0, 2.0, 3.0)]
    times = np.arange(6) * 10**8
    values = np.array([0.5, -0.3, 3.4, math.nan, 1.7, 1.5])  # the least step is 0.2
    found = calibrate(scene, [], words, (times, values), "V")
    alone = calibrate(scene, [], words, None, "V")
    assert "extrapolated by 0.3 below and 0.4 above" in curve_report(found, "input_crank")
    assert "extrapolated" not in curve_report(alone, "input_crank")
    assert [point.alpha3 for point in alone.points] == pytest.approx(
        np.radians([166.0, 146.0, 126.0, 106.0])
    )
    assert found.pairs == pytest.approx(
        [-0.3, math.radians(172.0), 3.4, math.radians(98.0)], abs=1e-9
    )
    # Equal deviations at 0, 1, 2, 3: s^2 (1/4 + (3.4 - 1.5)^2 / 5), and a step of 0.2.
    line = math.radians(0.5) * math.sqrt(0.25 + (3.4 - 1.5) ** 2 / 5.0)
    step = math.radians(20.0) * 0.2 / math.sqrt(12.0)
    assert found.stddev == pytest.approx(math.hypot(line, step), rel=1e-6)
    two = calibrate(scene, [], words, (times[:2], np.array([0.5, 0.7])), "V")
    line = math.radians(0.5) * math.sqrt(0.25 + 1.5**2 / 5.0)
    assert two.stddev == pytest.approx(math.hypot(line, step), rel=1e-6)


def test_percent_reaches_from_0_to_100(scene: Inclinometer) -> None:
    """A position in percent has a calibration of the whole range, and the node adds its steps."""
    words = [f"{reading:g}={-12.0 - 0.5 * reading:g}" for reading in (10.0, 40.0, 70.0, 90.0)]
    times, values = np.arange(3) * 10**8, np.array([20.0, 40.0, 80.0])
    found = calibrate(scene, [], words, (times, values), PERCENT)
    assert (found.pairs[0], found.pairs[-2]) == (0.0, 100.0)
    assert "extrapolated by 10 below and 10 above" in curve_report(found, "input_crank")
    mean, squares = 52.5, 42.5**2 + 12.5**2 + 17.5**2 + 37.5**2
    line = math.radians(0.5) * math.sqrt(0.25 + mean**2 / squares)  # farthest at 0
    assert found.stddev == pytest.approx(line, rel=1e-6)


@pytest.mark.parametrize(("stddev", "tractor"), [(0.0, 0.0), (math.inf, 0.0), (0.5, math.inf)])
def test_deviations_that_cannot_be_used(scene: Inclinometer, stddev: float, tractor: float) -> None:
    """A deviation of zero, and angles that are not finite, are refused."""
    with pytest.raises(InclinometerError, match="have to be finite, and the first greater than 0"):
        calibrate(replace(scene, stddev_deg=stddev, tractor_deg=tractor), [], [], None, "V")


def test_bag_without_readings(scene: Inclinometer) -> None:
    """A bag whose sensor was never available is refused."""
    series = np.arange(3) * 10**8, np.full(3, math.nan)
    with pytest.raises(InclinometerError, match="The bag has no reading that is available"):
        calibrate(scene, [], ["0=-12", "1=-32", "2=-52"], series, "V")


def test_reading_at_a_moment() -> None:
    """It is the mean of those within half a second, from the first to the last one."""
    times = np.arange(31) * 10**8  # 0 to 3 s at 10 Hz
    values = np.where(np.arange(31) < 16, 1.0, 2.0) + 0.0
    for moment, expected in ((0.0, 1.0), (0.9, 1.0), (2.2, 2.0), (3.0, 2.0)):
        assert still_reading(times, values, moment, "")[0] == pytest.approx(expected)
    for moment in (-0.01, 3.01):
        with pytest.raises(InclinometerError, match="is outside the bag, whose readings end after"):
            still_reading(times, values, moment, "")
    values[10:21] = math.nan
    assert still_reading(times, values, 1.4, "")[0] == 1.0  # the last one is 0.5 s before
    with pytest.raises(InclinometerError, match=r"no reading within 0\.5 s"):
        still_reading(times, values, 1.45, "")


def test_noise_of_a_reading_at_rest() -> None:
    """It is the scatter around a line, whose two numbers the readings have given, too."""
    times = np.arange(11) * 10**8
    values = 5.0 + 0.01 * (-1.0) ** np.arange(11)
    mean, noise = still_reading(times, values, 0.5, "")
    away = values - np.polyval(np.polyfit(times, values, 1), times)
    assert mean == pytest.approx(values.mean())
    assert noise == pytest.approx(math.sqrt((away**2).sum() / 9.0), rel=1e-6)
    assert still_reading(times[:3], values[:3], 0.1, "")[1] == 0.0  # three do not tell it


@pytest.mark.parametrize(
    ("steps", "moves"),
    [([0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 3], False), ([0, 0, 0, 0, 1, 1, 2, 2, 2, 3, 3], True)],
)
def test_hitch_that_moves(steps: list[int], moves: bool) -> None:
    """A drift of more than three steps of the sensor within a second is a motion."""
    times, values = np.arange(11) * 10**8, 5.0 + 0.01 * np.array(steps)
    assert (np.polyfit(times / 1e9, steps, 1)[0] > 3.0) == moves  # it is 2.9 or 3.2
    if moves:
        with pytest.raises(InclinometerError, match="so the hitch moves; choose a moment"):
            still_reading(times, values, 0.5, "")
    else:
        assert still_reading(times, values, 0.5, "")[0] == pytest.approx(values.mean())


@pytest.mark.parametrize(("span", "refused"), [(4.2, True), (4.3, False)])
def test_least_span_of_the_points(span: float, refused: bool) -> None:
    """They span six deviations of a difference, 6 sqrt(2) 0.5 deg = 4.24 deg."""
    points = [point(1.0, 90.0), point(2.0, 90.0 + span / 2.0), point(3.0, 90.0 + span)]
    if refused:
        with pytest.raises(InclinometerError, match=r"points span 4\.20 deg only"):
            fit(points, [], 0.0)
    else:
        assert fit(points, [], 0.0).degree == 1


@pytest.mark.parametrize(
    ("squares", "degree"), [(1.9, 1), (2.0 + 1e-9, 1), (2.0 + 1e-5, 2), (2.1, 2)]
)
def test_another_coefficient_has_to_explain_enough(squares: float, degree: int) -> None:
    """A coefficient more is worth a sum of squares that is smaller by 2 (Akaike), and by 1e-6.

    At four points, the bend (1, -1, -1, 1) / 2 is what a second degree explains beyond a line.
    """
    bend = 0.5 * math.sqrt(squares) * 0.5 * np.array([1.0, -1.0, -1.0, 1.0])  # deg
    points = [point(float(i), 100.0 + 20.0 * i + bend[i]) for i in range(4)]
    assert fit(points, [0.0, 3.0], 0.0).degree == degree


def test_calibration_does_not_turn_back() -> None:
    """A curve that turns back among the readings of the bag is not taken, however near it is."""
    points = [point(float(i), 100.0 + 20.0 * i - 2.0 * i * i) for i in range(5)]
    assert fit(points, [0.0, 4.0], 0.0).degree == 2  # it turns at 5
    angles = np.array(fit(points, [0.0, 6.0], 0.0).pairs[1::2])
    assert (np.diff(angles) > 0.0).all()


@pytest.mark.parametrize(("share", "degree"), [(0.0, 1), (0.9e-6, 1), (1.1e-6, 3)])
@pytest.mark.parametrize("low", [0.0, -0.32])
def test_curve_with_a_flat_point(low: float, share: float, degree: int) -> None:
    """A cubic whose smallest slope is a millionth of its largest one, or less, is not taken.

    That of 140 - 3 (x - 2)^3 - s (x - 2) is s at 2, and 9 (2 - low)^2 + s at the end.
    """
    slope = share * 9.0 * (2.0 - low) ** 2
    angles = [140.0 - 3.0 * (x - 2.0) ** 3 - slope * (x - 2.0) for x in range(5)]
    points = [point(float(x), angle) for x, angle in enumerate(angles)]
    assert fit(points, [low, 4.0], 0.0).degree == degree


@pytest.mark.parametrize(
    "words",
    [
        "0=-16 1=-37 2=-40 3=-43 4=-64",
        "0=-34 1=-48 2=-50 3=-52 4=-66",
        "0=-18 .25=-37 .5=-44 .75=-45 1=-46 1.25=-53 1.5=-72",
    ],
)
def test_readings_of_a_cubic_that_is_flat(scene: Inclinometer, words: str) -> None:
    """Measured points on -a (x - b)^3 + c, whose slope at b is exactly 0, get a straight line."""
    assert calibrate(replace(scene, tractor_deg=0.0), [], words.split(), None, "V").degree == 1


@pytest.mark.parametrize("far", range(4))
@pytest.mark.parametrize(("off", "equal"), [(-1e-8, True), (1e-8, True), (1e-6, False)])
def test_the_first_of_equal_residuals_is_named(far: int, off: float, equal: bool) -> None:
    """Four residuals of 2 deg are equal unless they differ by more than 1e-9 rad = 6e-8 deg.

    The line passes through the two means, so a point that is farther from the line by `off` makes
    two residuals larger by half of that: its own, and that of the other point at its reading.
    """
    pairs = [(0.0, 120.0), (0.0, 124.0), (1.0, 140.0), (1.0, 144.0)]
    points = [replace(point(*pair), stddev=math.radians(1.0)) for pair in pairs]
    away = math.radians(off) * (1.0 if far % 2 else -1.0)
    points[far] = replace(points[far], alpha3=points[far].alpha3 + away)
    first = "0=120" if equal or far < 2 else "1=140"
    text = curve_report(fit(points, [0.0, 1.0], 0.0), "input_crank")
    assert f"most at {first}: measure it again" in text


@pytest.mark.parametrize("zero", [1e-17, -1e-17, -0.0])
def test_a_residual_of_zero_has_no_sign_of_its_own(zero: float) -> None:
    """Zeros are printed alike, whatever sign rounding gives them; -0.006 deg is -0.01."""
    found = fit([point(float(r), 180.0 - 10.0 * r) for r in range(9)], [0.0, 8.0], 0.0)
    residuals = np.array([math.radians(-0.006), *[zero] * 8])
    rows = curve_report(replace(found, residuals=residuals), "input_crank").splitlines()[1:10]
    assert [row.split()[-1] for row in rows] == ["-0.01", *["+0.00"] * 8]


@pytest.mark.parametrize(("back", "refused"), [(2.0, False), (2.2, True)])
def test_how_far_an_angle_may_turn_back(back: float, refused: bool) -> None:
    """Between two points it is three deviations of a difference, 3 sqrt(2) 0.5 deg = 2.12 deg."""
    points = [point(0.0, 100.0), point(1.0, 130.0), point(2.0, 130.0 - back), point(3.0, 160.0)]
    if refused:
        with pytest.raises(InclinometerError, match="not monotone: 1=130 has"):
            fit(points, [0.0, 3.0], 0.0)
    else:
        assert len(fit(points, [0.0, 3.0], 0.0).points) == 4


@pytest.mark.parametrize("body", ["lower_link", "lift_rod"])
def test_deviation_of_a_point_on_another_body(
    mechanism: Mechanism, kinematics: Kinematics, body: str
) -> None:
    """An inclination of a body that turns more slowly than the crank says less of its angle."""
    alpha3, step = math.radians(130.0), 1e-6
    low, high = (kinematics.at(alpha3 + s).angle(body) for s in (-step, step))
    scene = Inclinometer(mechanism, kinematics, body, 0.0, 0.5)
    found = scene.point("", 1.0, math.degrees(kinematics.at(alpha3).angle(body)))
    assert found.alpha3 == pytest.approx(alpha3, abs=1e-9)
    assert found.stddev == pytest.approx(math.radians(0.5) * 2.0 * step / abs(high - low), rel=1e-6)
