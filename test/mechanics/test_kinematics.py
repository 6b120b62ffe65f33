# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Loop closure against circles, published figures and differences."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.kinematics import (
    Configuration,
    Kinematics,
    KinematicsError,
    _spline,
    kinematics_of,
)
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping

FloatArray = NDArray[np.float64]


def circles(
    first: FloatArray, radius: float, second: FloatArray, other: float, side: float
) -> FloatArray:
    """Return where two circles meet, left (+1) or right (-1) of the way from first to second."""
    way = second - first
    distance = math.hypot(*way)
    along = (radius**2 - other**2 + distance**2) / (2 * distance)
    across = side * math.sqrt(radius**2 - along**2)
    unit = way / distance
    return first + along * unit + across * np.array([-unit[1], unit[0]])


def by_circles(mechanism: Mechanism, alpha3: float) -> dict[str, FloatArray]:
    """Place the six-bar's points by intersecting circles: nothing shared with the solver."""
    p1, p2, p3 = (np.array(place) for _, place in mechanism.ground)
    upper = mechanism.links[1].points[-1][1][0]
    v2 = p3 + 0.203 * np.array([math.cos(alpha3), math.sin(alpha3)])
    v1 = circles(p1, 0.366, v2, 0.534, 1.0)
    e1 = p1 + (v1 - p1) * 0.810 / 0.366
    e2 = circles(e1, 0.438, p2, upper, 1.0)
    return {"V2": v2, "V1": v1, "E1": e1, "E2": e2}


def places(mechanism: Mechanism, configuration: Configuration) -> dict[str, FloatArray]:
    """Return every point of every body, by the body that comes last in the description."""
    return {
        point: configuration.place(body.name, local)
        for body in mechanism.bodies
        for point, local in mechanism.local_points(body.name).items()
    }


@given(alpha3=st.floats(math.radians(90.0), math.radians(180.0)))
def test_positions_by_circles(mechanism: Mechanism, alpha3: float) -> None:
    """Over the stroke all points lie where intersecting circles puts them."""
    actual = places(mechanism, kinematics_of(mechanism).at(alpha3))
    for point, place in by_circles(mechanism, alpha3).items():
        np.testing.assert_allclose(actual[point], place, atol=1e-13)


@pytest.mark.parametrize(
    ("alpha3_deg", "angles", "ratio"),
    [
        (90.0, (158.90, 141.14, 238.69, 87.80), 0.206),
        (140.0, (179.69, 175.89, 254.08, 95.59), 0.065),
        (168.0, (195.73, 201.00, 260.33, 95.21), -0.108),
        (180.0, (203.25, 213.29, 262.55, 93.20), -0.238),
    ],
)
def test_angles_of_the_default_linkage(
    mechanism: Mechanism, alpha3_deg: float, angles: tuple[float, ...], ratio: float
) -> None:
    """Angles and the mast's velocity ratio as an independent prototype found them."""
    configuration = Kinematics(mechanism).at(math.radians(alpha3_deg))
    bodies = ("lower_link", "upper_link", "lift_rod", "implement")
    actual = [math.degrees(configuration.angle(body)) for body in bodies]
    assert actual == pytest.approx(angles, abs=0.006)
    assert configuration.velocity_ratio("implement") == pytest.approx(ratio, abs=6e-4)


def test_geometry_is_traced_once(mechanism: Mechanism, mapping: Any, printed: Mechanism) -> None:
    """Other masses have the same kinematics, and other points, stroke or pose their own."""
    first = kinematics_of(mechanism)
    mapping["rigid_bodies"]["implement"]["mass"] *= 2.0
    assert kinematics_of(mechanism_from_mapping(mapping)) is first
    mapping["input"]["range_deg"][0] += 1.0
    for other in (printed, mechanism_from_mapping(mapping)):
        own, alpha3 = kinematics_of(other), sum(other.stroke) / 2.0
        assert own is not first
        np.testing.assert_array_equal(own.at(alpha3).angles, Kinematics(other).at(alpha3).angles)


def test_toggles(mechanism: Mechanism, printed: Mechanism) -> None:
    """The linkages lock where the prototype found it, with upper link and mast in line."""
    for description, toggles in ((mechanism, (-63.29, 203.70)), (printed, (-56.345, 184.938))):
        kinematics = Kinematics(description)
        low, high = (math.degrees(angle) for angle in kinematics.closable_range)
        assert (low, high) == pytest.approx(toggles, abs=6e-3)
        nearly = kinematics.at(kinematics.closable_range[1] - 1e-10)
        assert kinematics.toggles is not None
        assert [set(toggle.aligned) for toggle in kinematics.toggles] == [{"P2", "E2", "E1"}] * 2
        across = math.sin(nearly.angle("upper_link") - nearly.angle("implement"))
        assert abs(across) < 1e-4  # in line but for the square root of the distance
        assert nearly.toggle_distance == pytest.approx(1e-10, rel=1e-4)


def test_toggle_to_the_last_digits(printed: Mechanism) -> None:
    """The toggle is where upper link and mast just reach: E1 to P2 = 0.420 + 0.438 m."""
    high = Kinematics(printed).closable_range[1]
    p2 = np.array(dict(printed.ground)["P2"])
    p1, p3 = np.zeros(2), np.array(dict(printed.ground)["P3"])
    v2 = p3 + 0.203 * np.array([math.cos(high), math.sin(high)])
    e1 = p1 + circles(p1, 0.366, v2, 0.534, 1.0) * 0.810 / 0.366
    assert math.dist(e1, p2) == pytest.approx(0.858, abs=1e-12)


@pytest.mark.parametrize("distance_deg", [1.0, 1e-3, 1e-5, 1e-7])
def test_digits_lost_near_a_toggle(printed: Mechanism, distance_deg: float) -> None:
    """Angles lose eps / sqrt(distance) and no more; velocity ratios grow as 1 / sqrt(distance)."""
    kinematics = kinematics_of(printed)
    distance = math.radians(distance_deg)
    configuration = kinematics.at(kinematics.closable_range[1] - distance)
    mast = np.subtract(*(by_circles(printed, configuration.alpha3)[end] for end in ("E2", "E1")))
    off = configuration.angle("implement") - math.atan2(mast[1], mast[0])
    assert abs(off) < 10.0 * np.finfo(float).eps / math.sqrt(distance)
    nearer = kinematics.at(kinematics.closable_range[1] - distance / 100.0)
    growth = nearer.velocity_ratio("implement") / configuration.velocity_ratio("implement")
    assert growth == pytest.approx(10.0, rel=2.0 * math.sqrt(distance) + 1e-4)


def test_first_frequency_vanishes_at_a_toggle(printed: Mechanism) -> None:
    """With its bars in line the mast is free, so the first mode falls as sqrt(distance).

    A crank angle that is off by a tenth of the distance then costs a twentieth of the frequency.
    """
    model = LinkageModel(printed)
    high = model.kinematics.closable_range[1]
    first = [model.solve(high - 10.0**-n).natural_frequencies[0] for n in (4, 5, 6)]
    np.testing.assert_allclose(np.array(first[:-1]) / first[1:], math.sqrt(10.0), rtol=0.02)
    off = model.solve(high - 1.1e-6).natural_frequencies[0]
    assert off / first[2] - 1.0 == pytest.approx(0.05, abs=0.002)


def test_velocity_ratios_are_derivatives(mechanism: Mechanism) -> None:
    """Velocity ratios and point rates agree with central differences."""
    kinematics, alpha3, h = Kinematics(mechanism), math.radians(123.0), 1e-5
    here, before, after = (kinematics.at(alpha3 + d) for d in (0.0, -h, h))
    np.testing.assert_allclose(
        here.velocity_ratios, (after.angles - before.angles) / (2 * h), atol=1e-9
    )
    centre = mechanism.rigid_bodies[0].centre_of_gravity
    difference = after.place("implement", centre) - before.place("implement", centre)
    np.testing.assert_allclose(
        here.place_rate("implement", centre), difference / (2 * h), atol=1e-9
    )


@pytest.mark.parametrize("alpha3_deg", [204.0, 300.0, -64.0, 1e6])
def test_angles_out_of_reach_tell_the_nearest(mechanism: Mechanism, alpha3_deg: float) -> None:
    """Where the linkage cannot close, the error gives the nearest angle at which it can."""
    kinematics = Kinematics(mechanism)
    with pytest.raises(KinematicsError, match="nearest") as raised:
        kinematics.at(math.radians(alpha3_deg))
    assert raised.value.nearest is not None
    assert raised.value.nearest in (kinematics.toggles or ())
    assert "were degrees" not in str(raised.value)


@pytest.mark.parametrize("alpha3", [math.inf, -math.inf, math.nan])
def test_what_is_no_angle_is_refused(mechanism: Mechanism, alpha3: float) -> None:
    """A number that is not finite has no nearest angle; the error names the number."""
    with pytest.raises(KinematicsError, match=rf"^alpha3 = {alpha3} is not an angle") as raised:
        Kinematics(mechanism).at(alpha3)
    assert raised.value.nearest is None


def test_degrees_and_arrays_in_place_of_an_angle(model: LinkageModel) -> None:
    """The error of 130 asks whether degrees were given; that of an array names what takes many."""
    with pytest.raises(KinematicsError, match=r"130 deg is in range, so were degrees given"):
        model.solve(130)
    for solve in (model.solve, model.static_forces, model.kinematics.at):
        with pytest.raises(LinkageVibrationError, match="call it for each of them"):
            solve(np.array([2.2, 2.3]))
    assert model.solve(np.float32(2.3)).natural_frequencies[0] > 3.0


@pytest.mark.parametrize(
    ("stroke_deg", "words"),
    [
        ([90, 204], r"at 204 deg.*203\.703"),
        ([-70, 180], r"at -70 deg.*-63\.294"),
        ([-70, 204], r"at -70 deg.*-63\.294"),
        ([90, 600], r"at 600 deg.*203\.703"),
        ([450, 540], r"at 450 deg.*203\.703"),
    ],
)
def test_stroke_past_a_toggle_is_refused(mapping: Any, stroke_deg: list[float], words: str) -> None:
    """A stroke that crosses a toggle, at either end or a turn away, is refused with its toggles."""
    mapping["input"]["range_deg"] = stroke_deg
    with pytest.raises(MechanismError, match=rf"input\.range_deg: .*{words}"):
        Kinematics(mechanism_from_mapping(mapping))


def test_stroke_may_near_a_toggle_but_not_touch_it(mechanism: Mechanism) -> None:
    """A picoradian before the toggle is in reach; the toggle itself is refused."""
    low, high = Kinematics(mechanism).closable_range
    for ends in ((low + 1e-12, 2.0), (2.0, high - 1e-12)):
        near = Kinematics(dataclasses.replace(mechanism, stroke=ends))
        assert all(np.isfinite(near.at(angle).angles).all() for angle in ends)
    for ends in ((low, 2.0), (2.0, high)):
        with pytest.raises(MechanismError, match=r"input\.range_deg.*in line"):
            Kinematics(dataclasses.replace(mechanism, stroke=ends))


@pytest.mark.parametrize(
    "stroke", [(3.0, 2.0), (2.0, 2.0), (math.nan, 2.0), (2.0, math.nan), (2.0, math.inf)]
)
def test_stroke_that_is_no_interval_is_refused(
    mechanism: Mechanism, stroke: tuple[float, float]
) -> None:
    """Reversed, empty and infinite strokes are refused, also without a file."""
    with pytest.raises(MechanismError, match=r"input\.range_deg: .*ascend"):
        Kinematics(dataclasses.replace(mechanism, stroke=stroke))


@pytest.mark.parametrize("stroke_deg", [(80.0, 275.0), (275.0, 285.0)])
def test_stroke_over_a_gap_is_refused(stroke_deg: tuple[float, float]) -> None:
    """It closes from 40.4 to 96.5 deg and from 263.5 to 319.6, but cannot go from one to other."""
    stroke = math.radians(stroke_deg[0]), math.radians(stroke_deg[1])
    rocking = dataclasses.replace(four_bar(1.0, 0.8, 1.0, 0.35), stroke=stroke)
    with pytest.raises(
        MechanismError, match=r"range_deg: .* at 2[78]5 deg: .*96\.\d* deg with B, C"
    ):
        Kinematics(rocking)


def test_links_that_cannot_close_are_refused(mapping: Any) -> None:
    """The error of a link that is too short says where to fix it."""
    mapping["links"]["lift_rod"]["points"]["V1"] = 0.1
    with pytest.raises(MechanismError, match=r"assembly: .*lengths"):
        Kinematics(mechanism_from_mapping(mapping))


def four_bar(ground: float, crank: float, coupler: float, rocker: float) -> Mechanism:
    """Return a four-bar from A (0, 0) to D (ground, 0), open upwards."""
    bar = {
        "section": {"shape": "round", "diameter": 0.02},
        "material": {"youngs_modulus": 2.1e11, "density": 7800, "poisson_ratio": 0.3},
    }
    pose = circles(np.array([0.0, crank]), coupler, np.array([ground, 0.0]), rocker, 1.0)
    way = math.degrees(math.atan2(pose[1] - crank, pose[0]))
    back = math.degrees(math.atan2(pose[1], pose[0] - ground))
    return mechanism_from_mapping(
        {
            "name": "four_bar",
            "ground": {"A": [0.0, 0.0], "D": [ground, 0.0]},
            "links": {
                "crank": {"points": {"A": 0.0, "B": crank}, "clamped": "A", **bar},
                "coupler": {"points": {"B": 0.0, "C": coupler}, **bar},
                "rocker": {"points": {"D": 0.0, "C": rocker}, **bar},
            },
            "input": {"link": "crank", "range_deg": [80, 100]},
            "assembly": {"alpha3_deg": 90, "angles_deg": {"coupler": way, "rocker": back}},
            "damping": {"ratio": 0.01, "at_hz": [1, 100]},
            "response": {"drive_point": "C", "direction": "x", "band_hz": [0, 100], "modes": 2},
        }
    )


def test_full_turns_repeat() -> None:
    """A crank that turns all the way has no toggle, and any number of turns changes nothing."""
    kinematics = Kinematics(four_bar(1.0, 0.3, 0.9, 0.8))
    assert kinematics.toggles is None
    assert kinematics.closable_range == (-math.inf, math.inf)
    with pytest.raises(KinematicsError, match="finite"):
        kinematics.at(math.inf)
    once = kinematics.at(1.0)
    for turns in (-40, -1, 1, 7):
        again = kinematics.at(1.0 + 2 * math.pi * turns)
        np.testing.assert_allclose(again.origins, once.origins, atol=1e-12)
        assert again.toggle_distance == math.inf


def test_strokes_of_more_than_a_turn() -> None:
    """A crank without toggles may turn as far as one likes; so may a range."""
    rotating = dataclasses.replace(four_bar(1.0, 0.3, 0.9, 0.8), stroke=(0.0, 6.0 * math.pi))
    kinematics = Kinematics(rotating)
    once, later = kinematics.at(0.7), kinematics.at(0.7 + 6.0 * math.pi)
    np.testing.assert_allclose(later.velocity_ratios, once.velocity_ratios, rtol=1e-12)


@pytest.mark.parametrize(
    ("sides", "ends"),
    [
        ((1.0, 0.5, 1.0, 0.5), (0.0, 180.0)),  # a parallelogram
        ((1.0, 0.3, 0.3, 1.0), (0.0, 180.0)),  # a kite
        ((1.0, 0.3, 1.2, 0.5), (0.0, 360.0)),  # ground and coupler as long as crank and rocker
    ],
)
def test_branches_end_where_another_crosses(
    sides: tuple[float, float, float, float], ends: tuple[float, float]
) -> None:
    """With all four bars in line there are two branches, which an angle cannot distinguish."""
    kinematics = Kinematics(four_bar(*sides))
    actual = [math.degrees(angle) for angle in kinematics.closable_range]
    assert actual == pytest.approx(ends, abs=1e-3)
    assert kinematics.toggles is not None
    assert [toggle.aligned for toggle in kinematics.toggles] == [("B", "C", "D")] * 2
    with pytest.raises(MechanismError, match=r"range_deg.*B, C and D in line"):
        Kinematics(dataclasses.replace(four_bar(*sides), stroke=(1.0, 6.5)))


@pytest.mark.parametrize("excess", [1e-3, 1e-5, 1e-7])
def test_nearly_a_parallelogram(excess: float) -> None:
    """A branch that passes very near is not mistaken for this one."""
    low, high = Kinematics(four_bar(1.0, 0.5, 1.0 + excess, 0.5)).closable_range
    # The law of cosines with coupler and rocker folded; 1 - cos by the half angle, for its digits.
    share = ((0.5 + excess) ** 2 - 0.25) / 2.0
    assert low == pytest.approx(2.0 * math.asin(math.sqrt(share)), rel=1e-6)
    assert high == pytest.approx(2.0 * math.pi - low, rel=1e-12)


def test_assembly_at_a_toggle_is_refused(mapping: Any, mechanism: Mechanism) -> None:
    """Where a branch turns back its pose does not identify it."""
    high = Kinematics(mechanism).at(Kinematics(mechanism).closable_range[1] - 1e-13)
    mapping["assembly"]["alpha3_deg"] = math.degrees(high.alpha3)
    for body in mapping["assembly"]["angles_deg"]:
        mapping["assembly"]["angles_deg"][body] = math.degrees(high.angle(body))
    with pytest.raises(MechanismError, match=r"assembly\.alpha3_deg: .*toggle"):
        Kinematics(mechanism_from_mapping(mapping))


def test_loops_that_take_more_than_a_turn() -> None:
    """Where the loops close otherwise after a turn, that turn is no repetition of the first.

    In this linkage the crank turns by 430 deg from toggle to toggle.
    """
    bar = {
        "section": {"shape": "round", "diameter": 0.02},
        "material": {"youngs_modulus": 2.1e11, "density": 7800, "poisson_ratio": 0.3},
    }
    points: dict[str, dict[str, Any]] = {
        "crank": {"A": 0.0, "B": 0.174},
        "drag": {"B": 0.0, "C": 1.207},
        "plate": {"C": 0.0, "E": [1.163, 0.415], "F": 0.515},
        "long": {"D": 0.0, "E": 1.894},
        "short": {"G": 0.0, "F": 1.137},
    }
    winding = mechanism_from_mapping(
        {
            "name": "winding",
            "ground": {"A": [0.0, 0.0], "D": [0.519, 0.0], "G": [0.562, -0.260]},
            "links": {name: {"points": places, **bar} for name, places in points.items()},
            "input": {"link": "crank", "range_deg": [80, 100]},
            "assembly": {
                "alpha3_deg": 90,
                "angles_deg": {"drag": -72, "plate": -55, "long": -62, "short": -84},
            },
            "damping": {"ratio": 0.01, "at_hz": [1, 100]},
            "response": {"drive_point": "C", "direction": "x", "band_hz": [0, 100], "modes": 2},
        }
    )
    kinematics = Kinematics(winding)
    low, high = kinematics.closable_range
    assert 2.0 * math.pi < high - low < 4.0 * math.pi
    angle = low + 0.5
    once, again = kinematics.at(angle), kinematics.at(angle + 2.0 * math.pi)
    assert np.abs(np.sin((again.angles - once.angles) / 2.0)).max() > 0.1
    for configuration in (once, again):
        for point, first, second in winding.joints:
            ends = [
                configuration.place(body, winding.local_points(body)[point])
                for body in (first, second)
            ]
            assert math.dist(*ends) < 1e-13


@given(crank=st.floats(0.1, 3.0), coupler=st.floats(0.3, 3.0), rocker=st.floats(0.3, 3.0))
def test_four_bar_toggles_in_closed_form(crank: float, coupler: float, rocker: float) -> None:
    """A four-bar locks where coupler and rocker are in line: the law of cosines says where."""
    reach = math.hypot(1.0, crank)
    far, near = coupler + rocker, abs(coupler - rocker)
    assume(near + 0.05 < reach < far - 0.05)
    limits = [(1 + crank**2 - side**2) / (2 * crank) for side in (near, far)]
    # Coupler, rocker, crank and ground all in line: two branches meet.
    assume(not any(abs(abs(limit) - 1.0) < 1e-4 for limit in limits))
    folded, stretched = (math.acos(c) if abs(c) < 1 else None for c in limits)
    expected_low = folded if folded is not None else (-stretched if stretched else -math.inf)
    expected_high = (
        stretched if stretched is not None else (2 * math.pi - folded if folded else math.inf)
    )
    # The stroke of 80 to 100 deg has to be within reach.
    assume(folded is None or folded < math.radians(79))
    assume(stretched is None or stretched > math.radians(101))
    low, high = Kinematics(four_bar(1.0, crank, coupler, rocker)).closable_range
    assert low == pytest.approx(expected_low, abs=1e-9)
    assert high == pytest.approx(expected_high, abs=1e-9)


@pytest.mark.parametrize("n", [4, 5, 40])
def test_the_spline_is_that_of_scipy(n: int) -> None:
    """Values between, at and beyond the knots are those of another program."""
    random = np.random.default_rng(n)
    x, y = np.cumsum(random.uniform(0.01, 1.0, n)), random.standard_normal((n, 6))
    at = np.append(np.linspace(x[0] - 0.1, x[-1] + 0.1, 101), x)
    np.testing.assert_allclose(_spline(x, y)(at), CubicSpline(x, y)(at), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(_spline(x, y)(at[7]), CubicSpline(x, y)(at[7]), rtol=1e-12)
