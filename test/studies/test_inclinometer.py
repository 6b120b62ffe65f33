# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Calibrations from simulated inclinations, whose deviations independent readings confirm."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
import yaml
from scipy.interpolate import PchipInterpolator

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.studies.inclinometer import (
    InclinometerError,
    SensorFit,
    calibrate,
    crank_angles,
    fit,
    number_pairs,
    parameters,
    reading_at,
    report,
)

ERROR = math.radians(0.5)  # standard deviation of the inclinometer


def volts(alpha3: FloatArray, bend: float) -> FloatArray:
    """Return what a sensor shows that a lever turns: an arc sine instead of a straight line."""
    share = (alpha3 - math.radians(135.0)) / math.radians(45.0)
    return 2.5 - 2.0 * np.arcsin(bend * share) / math.asin(bend)


@pytest.mark.parametrize("bend", [0.01, 0.6, 0.9])
@pytest.mark.parametrize("count", [5, 8])
@pytest.mark.parametrize("noise", [0.0, 0.04])
def test_independent_readings_confirm_the_deviation(count: int, bend: float, noise: float) -> None:
    """The intervals of 95 % hold for new angles and readings, and are not far too wide."""
    rng = np.random.default_rng(1)
    within, ratios = [], []
    points = np.radians(np.linspace(90.0, 180.0, count))
    for _ in range(60):
        readings = volts(points, bend) + noise * rng.normal(size=count) / 10.0  # means of a hundred
        measured = points + ERROR * rng.normal(size=count)
        line = fit(readings, measured, np.full(count, ERROR), [0.5, 4.5], noise)
        alpha3 = np.radians(rng.uniform(90.0, 180.0, 50))
        shown = volts(alpha3, bend) + noise * rng.normal(size=50)
        away = PchipInterpolator(*line.knots.T)(np.clip(shown, *line.knots[[0, -1], 0])) - alpha3
        within.append((np.abs(away) <= 1.96 * line.stddev).mean())
        ratios.append((away**2).mean() / line.stddev**2)
    assert np.mean(within) > 0.93
    assert math.sqrt(np.mean(ratios)) > 0.3


@pytest.mark.parametrize("body", ["input_crank", "lower_link", "lift_rod"])
def test_angles_of_other_bodies(mechanism: Mechanism, body: str) -> None:
    """The inclination of a link, without half turns, leads back to the crank angle."""
    expected = np.radians([91.0, 135.0, 179.0])
    configurations = [Kinematics(mechanism).at(alpha3) for alpha3 in expected.tolist()]
    ratios = [configuration.velocity_ratio(body) for configuration in configurations]
    for turn in (0.0, -math.pi, math.pi):
        inclinations = np.array([each.angle(body) for each in configurations]) + turn
        alpha3, slopes = crank_angles(mechanism, body, inclinations)
        assert alpha3 == pytest.approx(expected, abs=1e-5)
        assert slopes == pytest.approx(1.0 / np.array(ratios), rel=1e-4)


@pytest.mark.parametrize(
    ("body", "degrees", "words"),
    [
        ("boom", 10.0, "There is no body 'boom'; name one of: lower_link, upper_link"),
        ("input_crank", 50.0, "No pose has input_crank at the inclination 50.00 deg, but at -93.0"),
        ("lower_link", 60.0, "lower_link at the inclination 60.00 deg, but at -"),
        ("implement", 95.0, "implement has one inclination at two crank angles; measure on"),
    ],
)
def test_inclinations_that_show_no_angle(
    mechanism: Mechanism, body: str, degrees: float, words: str
) -> None:
    """A body or an inclination that does not exist, or that occurs twice, is refused."""
    with pytest.raises(InclinometerError) as raised:
        crank_angles(mechanism, body, np.radians([degrees]))
    assert words in str(raised.value)


def fit_degrees(readings: Sequence[float], degrees: Sequence[float], *ends: float) -> SensorFit:
    """Return the fit to angles of half a degree of deviation."""
    points = np.array(readings, float), np.radians(degrees), np.full(len(readings), ERROR)
    return fit(*points, ends, 0.0)


@pytest.mark.parametrize(
    ("readings", "degrees", "words"),
    [
        ([], [], "0 points do not show their errors; measure at 5 or more heights"),
        ([1, 2, 3, 4], [90, 110, 130, 150], "4 points do not show"),
        ([1, 1, 2, 3, 4], [90, 90, 110, 130, 150], "5 points do not show"),
        ([1, 2, 3, 4, 5], [90, 120, 150, 120, 90], "turns back"),
        ([1, 2, 3, 4, 5], [90, 90, 90, 90, 90], "turns back"),
    ],
)
def test_points_without_a_calibration(
    readings: list[float], degrees: list[float], words: str
) -> None:
    """Points at too few readings, and angles that turn back, are refused."""
    with pytest.raises(InclinometerError, match=words):
        fit_degrees(readings, degrees)


def test_calibration_does_not_turn_back_beyond_the_points() -> None:
    """A parabola that turns at 5 gives a calibration to 4, and none to 6."""
    readings = np.arange(5.0)
    degrees = 100.0 + 20.0 * readings - 2.0 * readings**2
    assert len(fit_degrees(readings, degrees, 0.0, 4.0).knots) == 13
    with pytest.raises(InclinometerError, match="turns back"):
        fit_degrees(readings, degrees, 0.0, 6.0)


def test_a_wrong_point_is_named() -> None:
    """A point that is far off is named, and widens the deviation."""
    readings = np.arange(9.0)
    degrees = 180.0 - 10.0 * readings
    words = [f"{reading:g}" for reading in readings]
    good = fit_degrees(readings, degrees, 0.0, 10.0)
    assert good.knots[[0, -1], 0].tolist() == [0.0, 10.0]
    assert "times as large" not in report(words, readings, np.radians(degrees), good)
    degrees[4] += 10.0
    bad = fit_degrees(readings, degrees, 0.0, 10.0)
    assert "most at 4: measure it again" in report(words, readings, np.radians(degrees), bad)
    assert bad.stddev > 2.0 * good.stddev


@pytest.mark.parametrize("scatter", [0.5, 1.9, 2.1])
def test_deviation_of_a_cubic(scatter: float) -> None:
    """The residuals of five points are those of the fourth difference, (1, -4, 6, -4, 1).

    The deviation at an end is then sqrt(69 / 70) of that of a point, as the residual is
    sqrt(1 / 70). Residuals that are larger than the inclinometer explains scale it, and are named
    if they are twice as large.
    """
    readings, away = np.arange(5.0), np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / math.sqrt(70.0)
    degrees = 180.0 - 20.0 * readings + scatter * math.degrees(ERROR) * away
    line = fit_degrees(readings, degrees, 0.0, 4.0)
    assert line.residuals == pytest.approx(scatter * ERROR * away, rel=1e-9)
    assert line.excess == pytest.approx(scatter, rel=1e-9)
    assert line.stddev == pytest.approx(ERROR * math.sqrt(69.0 / 70.0) * max(scatter, 1.0))
    text = report(["a point"] * 5, readings, np.radians(degrees), line)
    assert ("times as large as the inclinometer explains" in text) == (scatter > 2.0)


def test_noise_of_the_reading_adds_by_the_slope() -> None:
    """A reading that deviates by 0.2 moves the angle of a line of -10 deg per unit by 2 deg."""
    readings, sigma = np.arange(9.0), np.full(9, ERROR)
    alpha3 = np.radians(180.0 - 10.0 * readings)
    alone, noisy = (fit(readings, alpha3, sigma, [], noise).stddev for noise in (0.0, 0.2))
    assert noisy == pytest.approx(math.hypot(alone, math.radians(2.0)), rel=1e-9)


def test_parameters_are_those_of_the_node() -> None:
    """The printed YAML has the pairs as numbers, also where they are small or whole."""
    line = fit_degrees(np.arange(9.0) * 1e-9, 180.0 - 10.0 * np.arange(9.0), 0.0)
    values = yaml.safe_load(parameters(line, "any"))["/**"]["ros__parameters"]
    pairs = np.array(values["calibration"]).reshape(-1, 2)
    np.testing.assert_allclose(pairs[:, 0], line.knots[:, 0], rtol=1e-9, atol=1e-20)
    np.testing.assert_allclose(pairs[:, 1], line.knots[:, 1], atol=1e-9)
    assert all(isinstance(value, float) for value in values["calibration"])
    assert values["angle_stddev"] == pytest.approx(line.stddev, rel=1e-2)


def test_reading_at_a_moment() -> None:
    """It is the mean of those within half a second, from the first to the last one."""
    times = np.arange(31) / 10.0  # 0 to 3 s at 10 Hz
    readings = np.where(np.arange(31) < 16, 1.0, 2.0)
    for moment, mean in ((0.0, 1.0), (0.9, 1.0), (2.2, 2.0), (3.0, 2.0)):
        assert reading_at(times, readings, moment) == (mean, 0.0)
    assert reading_at(times[:2], np.array([1.0, 1.2]), 0.0) == pytest.approx((1.1, 0.1))
    readings[10:21] = math.nan
    assert reading_at(times, readings, 1.4)[0] == 1.0  # the last one is 0.5 s before
    for moment in (1.45, -0.6, 3.6):
        with pytest.raises(
            InclinometerError, match=r"No reading is within 0\.5 s .* 0 to 3\.000 s"
        ):
            reading_at(times, readings, moment)


def test_words_of_another_form() -> None:
    """A word without two numbers is refused."""
    assert number_pairs(["12.5=128"]).tolist() == [[12.5, 128.0]]
    for word in ("12.5", "a=b", "1=2=3", "1=nan", "1e300=2"):
        with pytest.raises(InclinometerError, match="write two numbers, such as"):
            number_pairs([word])


WORDS = [f"{reading:g}={-12.0 - 20.0 * reading:g}" for reading in (0.0, 1.0, 2.0, 3.0, 3.5)]


def test_readings_of_the_bag_belong_to_the_calibration(mechanism: Mechanism) -> None:
    """It reaches from the least to the largest, and their least step adds to the deviation.

    The tractor is inclined by 2 deg, so the crank angle is 166 deg at a reading of 0.
    """
    series = np.arange(6) * 10**8, np.array([0.5, -0.3, 3.7, math.nan, 1.7, 1.5])
    scene = mechanism, "input_crank", "V", [], WORDS
    alone, _ = calibrate(*scene, None, 2.0)
    line, _ = calibrate(*scene, series, 2.0)
    assert alone.knots[[0, -1], 0].tolist() == [0.0, 3.5]
    assert line.knots[[0, -1]] == pytest.approx(
        np.array([[-0.3, math.radians(172.0)], [3.7, math.radians(92.0)]]), abs=1e-5
    )
    readings, alpha3 = np.array([0.0, 1.0, 2.0, 3.0, 3.5]), np.radians([166, 146, 126, 106, 96])
    step = 0.2 / math.sqrt(12.0)
    expected = fit(readings, alpha3, np.full(5, ERROR), [-0.3, 3.7], step).stddev
    assert line.stddev == pytest.approx(expected, rel=1e-4)


def test_percent_reaches_from_0_to_100(mechanism: Mechanism) -> None:
    """A position in percent has a calibration of the whole range, and the node adds its steps."""
    readings = np.array([10.0, 30.0, 50.0, 70.0, 90.0])
    words = [f"{reading:g}={-12.0 - 0.5 * reading:g}" for reading in readings]
    series = np.arange(3) * 10**8, np.array([20.0, 40.0, 80.0])
    line, _ = calibrate(mechanism, "input_crank", "percent", [], words, series)
    ends = np.array([[0.0, math.radians(168.0)], [100.0, math.radians(118.0)]])  # a level tractor
    assert line.knots[[0, -1]] == pytest.approx(ends, abs=1e-5)
    alpha3 = np.radians(168.0 - 0.5 * readings)
    expected = fit(readings, alpha3, np.full(5, ERROR), [0.0, 100.0], 0.0).stddev
    assert line.stddev == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(("stddev", "tractor"), [(0.0, 0.0), (math.inf, 0.0), (0.5, math.inf)])
def test_deviations_that_cannot_be_used(
    mechanism: Mechanism, stddev: float, tractor: float
) -> None:
    """A deviation of zero, and angles that are not finite, are refused."""
    with pytest.raises(InclinometerError, match="have to be finite, the first above 0"):
        calibrate(mechanism, "input_crank", "V", [], WORDS, None, tractor, stddev)


def test_bag_without_readings(mechanism: Mechanism) -> None:
    """A bag whose sensor was never available is refused, also beside readings."""
    series = np.arange(3) * 10**8, np.full(3, math.nan)
    with pytest.raises(InclinometerError, match="The bag has no reading"):
        calibrate(mechanism, "input_crank", "V", [], WORDS, series)


@pytest.mark.parametrize("body", ["lower_link", "lift_rod"])
def test_deviation_of_a_point_on_another_body(mechanism: Mechanism, body: str) -> None:
    """An inclination of a body that turns more slowly than the crank says less of its angle."""
    kinematics, expected = Kinematics(mechanism), np.radians([95.0, 115.0, 135.0, 155.0, 175.0])
    angles = np.degrees([kinematics.at(alpha3).angle(body) for alpha3 in expected.tolist()])
    words = [f"{i}={angle:.9f}" for i, angle in enumerate(angles)]
    line, _ = calibrate(mechanism, body, "V", [], words, None)
    steps = [kinematics.at(expected[i] + s).angle(body) for i in range(5) for s in (-1e-6, 1e-6)]
    sigma = ERROR * 2e-6 / np.abs(np.diff(np.reshape(steps, (5, 2)))[:, 0])
    assert line.stddev == pytest.approx(fit(np.arange(5.0), expected, sigma, [], 0.0).stddev, 1e-3)
