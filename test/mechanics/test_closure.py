# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Closed poses from rough angles against circles, and lengths that no pose closes."""

import itertools
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from linkage_vibration.mechanics.closure import distance, pose_notice, turns
from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.kinematics import Configuration, Kinematics
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from test.mechanics.test_kinematics import circles, four_bar
from test.properties.linkages import Linkage, linkages

FloatArray = NDArray[np.float64]
LONG = {"max_examples": 12, "deadline": None}
GUESS = st.lists(st.floats(-180.0, 180.0), min_size=4, max_size=4)


def with_guess(mapping: Any, guess: dict[str, float]) -> Mechanism:
    """Return the mechanism whose assembly has other angles, deg."""
    assembly = {**mapping["assembly"], "angles_deg": guess}
    return mechanism_from_mapping({**mapping, "assembly": assembly})


def away(mechanism: Mechanism, angles: dict[str, float]) -> float:
    """Return how far angles (rad) are from those given, in the sense of the package."""
    given_angles = np.array([angle for _, angle in mechanism.assembly_angles])
    own = np.array([angles[body] for body, _ in mechanism.assembly_angles])
    return float(distance(turns(own - given_angles), np.ones(len(own), bool)))


def angles_of(mechanism: Mechanism, configuration: Configuration) -> dict[str, float]:
    """Return the angles of the bodies, rad."""
    return {body.name: configuration.angle(body.name) for body in mechanism.bodies}


def every_pose(mechanism: Mechanism) -> list[dict[str, float]]:
    """Return the angles of all closed poses of the hitch by circles, rad."""
    p1, p2, p3 = (np.array(place) for _, place in mechanism.ground)
    alpha3 = mechanism.assembly_alpha3
    v2 = p3 + 0.203 * np.array([math.cos(alpha3), math.sin(alpha3)])
    actual = []
    for first, second in itertools.product((1.0, -1.0), repeat=2):
        v1 = circles(p1, 0.366, v2, 0.534, first)
        e1 = p1 + (v1 - p1) * 0.810 / 0.366
        try:
            e2 = circles(e1, 0.438, p2, 0.520, second)
        except ValueError:
            continue
        ways = {"lower_link": v1 - p1, "upper_link": e2 - p2, "lift_rod": v1 - v2}
        ways["implement"] = e2 - e1
        actual.append({name: math.atan2(way[1], way[0]) for name, way in ways.items()})
    return actual


@settings(**LONG)
@given(guess=GUESS)
@example([180.0, 176.0, 254.0, -10.0])
def test_the_nearest_of_all_poses(mechanism_file: Any, guess: list[float]) -> None:
    """From any angles, the hitch closes in the nearest of the poses that circles find."""
    mapping = yaml.safe_load(mechanism_file.read_text())
    mapping["input"]["range_deg"] = [139.0, 141.0]
    names = ("lower_link", "upper_link", "lift_rod", "implement")
    mechanism = with_guess(mapping, dict(zip(names, guess, strict=True)))
    poses = every_pose(mechanism)
    assert len(poses) > 1
    kinematics = Kinematics(mechanism)
    actual = angles_of(mechanism, kinematics.at(mechanism.assembly_alpha3))
    nearest = min(away(mechanism, pose) for pose in poses)
    assert away(mechanism, actual) == pytest.approx(nearest, abs=1e-6)
    pasted = yaml.safe_load(kinematics.notice.partition("`")[2].partition("`")[0] or "{}")
    if pasted:
        again = Kinematics(mechanism_from_mapping({**mapping, **pasted}))
        assert again.notice == ""
        assert again.at(mechanism.assembly_alpha3).angles == pytest.approx(
            kinematics.at(mechanism.assembly_alpha3).angles % math.tau, abs=1e-9
        )


@settings(**LONG)
@given(linkage=linkages(), turned=GUESS)
def test_random_linkages_close_from_any_guess(linkage: Linkage, turned: list[float]) -> None:
    """A random linkage closes at least as near to the guess as in the pose that was drawn."""
    drawn = linkage.mapping["assembly"]["angles_deg"]
    guess = {n: a + t for (n, a), t in zip(drawn.items(), itertools.cycle(turned), strict=False)}
    mechanism = with_guess(linkage.mapping, guess)
    try:
        kinematics = Kinematics(mechanism)
    except MechanismError as error:
        # The nearest pose may be on a branch that ends within the stroke.
        assert error.path in ("input.range_deg", "assembly.alpha3_deg")
        return
    configuration = kinematics.at(linkage.alpha3)
    for point, first, second in mechanism.joints:
        ends = [
            configuration.place(body, mechanism.local_points(body)[point])
            for body in (first, second)
        ]
        assert math.dist(*ends) < 1e-12
    known = {name: math.radians(angle) for name, angle in drawn.items()}
    actual = away(mechanism, angles_of(mechanism, configuration))
    assert actual <= max(away(mechanism, known) + 1e-6, math.radians(5.0))
    if actual > math.radians(20.0):
        assert "; write `assembly: {alpha3_deg: " in kinematics.notice


def test_angles_that_are_nearly_right_need_no_notice(mechanism: Mechanism) -> None:
    """The shipped angles, and others within a few degrees, lead to no notice."""
    assert Kinematics(mechanism).notice == ""


@pytest.mark.parametrize(("share", "said"), [(0.32, False), (0.34, True)])
def test_an_ambiguous_guess_says_so(
    mechanism: Mechanism, mapping: Any, share: float, said: bool
) -> None:
    """The notice has both poses between which a guess lies, unless one is twice as far."""
    poses = every_pose(mechanism)
    mapping["input"]["range_deg"] = [139.0, 141.0]
    apart = [(away_from(poses[0], pose), pose) for pose in poses[1:]]
    other = min(apart, key=lambda pair: pair[0])[1]
    half = {
        n: math.degrees(a + share * float(turns(np.array(other[n] - a))))
        for n, a in poses[0].items()
    }
    notice = Kinematics(with_guess(mapping, half)).notice
    words = "The choice is ambiguous: the loops also close with `angles_deg: {"
    assert (words in notice) == said
    assert notice.count("lower_link: ") == 1 + said


def away_from(first: dict[str, float], other: dict[str, float]) -> float:
    """Return the root mean square of the angles between two poses, rad."""
    apart = turns(np.array([first[name] - other[name] for name in first]))
    return float(np.sqrt((apart**2).mean()))


def test_an_angle_of_the_assembly_out_of_reach(mapping: Any) -> None:
    """An angle of the assembly at which the loops do not close is refused, with its fix."""
    mapping["assembly"]["alpha3_deg"] = 230.0
    with pytest.raises(MechanismError, match=r"close at alpha3 = 230 deg: .*; correct this angle,"):
        Kinematics(mechanism_from_mapping(mapping))


@settings(**LONG)
@given(crank=st.floats(0.1, 1.0), coupler=st.floats(0.1, 2.0), rocker=st.floats(0.1, 2.0))
def test_how_much_a_four_bar_misses(crank: float, coupler: float, rocker: float) -> None:
    """With the crank upright, coupler and rocker miss by what the triangle says."""
    reach = math.hypot(1.0, crank)
    missing = max(reach - coupler - rocker, abs(coupler - rocker) - reach)
    assume(missing > 0.01)
    mapping = four_bar_mapping(crank, coupler, rocker)
    with pytest.raises(MechanismError, match=r"assembly: the loops do not close at") as raised:
        Kinematics(mechanism_from_mapping(mapping))
    for gap in gaps_of(raised.value, "ABCD"):
        assert gap == pytest.approx(missing, rel=2e-3, abs=1e-5)


def gaps_of(error: MechanismError, pins: Iterable[str]) -> list[float]:
    """Return the gaps that an error states for pins, m."""
    return [float(str(error).partition(f"{pin} by ")[2].partition(" m")[0]) for pin in pins]


def four_bar_mapping(crank: float, coupler: float, rocker: float) -> dict[str, Any]:
    """Return a four-bar with an upright crank, which may not close."""
    bar = {
        "section": {"shape": "round", "diameter": 0.02},
        "material": {"youngs_modulus": 2.1e11, "density": 7800, "poisson_ratio": 0.3},
    }
    return {
        "name": "four_bar",
        "ground": {"A": [0.0, 0.0], "D": [1.0, 0.0]},
        "links": {
            "crank": {"points": {"A": 0.0, "B": crank}, **bar},
            "coupler": {"points": {"B": 0.0, "C": coupler}, **bar},
            "rocker": {"points": {"D": 0.0, "C": rocker}, **bar},
        },
        "input": {"link": "crank", "range_deg": [89.999, 90.001]},
        "assembly": {"alpha3_deg": 90, "angles_deg": {"coupler": 10, "rocker": 100}},
        "damping": {"ratio": 0.01, "at_hz": [1, 100]},
        "response": {"drive_point": "C", "direction": "x", "band_hz": [0, 100], "modes": 2},
    }


@pytest.mark.parametrize(
    ("link", "point", "length", "loop"),
    [
        ("lift_rod", "V1", 0.1, ("P1", "P3", "V1", "V2")),
        ("upper_link", "E2", 0.15, ("P2", "E1", "E2")),
    ],
)
def test_the_pins_that_stay_open(
    mapping: Any, link: str, point: str, length: float, loop: tuple[str, ...]
) -> None:
    """The error says what is missing at each pin of the loop with the wrong length."""
    mapping["links"][link]["points"][point] = length
    mapping["input"]["range_deg"] = [139.999, 140.001]
    mechanism = mechanism_from_mapping(mapping)
    with pytest.raises(MechanismError, match=r"assembly: .*the lengths of") as raised:
        Kinematics(mechanism)
    missing = missing_of(mechanism, link, length)
    assert gaps_of(raised.value, loop) == pytest.approx([missing] * len(loop), rel=2e-3)


def missing_of(mechanism: Mechanism, link: str, length: float) -> float:
    """Return what a length of the hitch lacks at 140 deg, by circles and triangles."""
    p1, p2, p3 = (np.array(place) for _, place in mechanism.ground)
    alpha3 = math.radians(140.0)
    v2 = p3 + 0.203 * np.array([math.cos(alpha3), math.sin(alpha3)])
    if link == "lift_rod":
        reach = math.dist(p1, v2)
        return max(reach - 0.366 - length, abs(0.366 - length) - reach)
    gaps = []
    for side in (1.0, -1.0):
        e1 = p1 + (circles(p1, 0.366, v2, 0.534, side) - p1) * 0.810 / 0.366
        reach = math.dist(e1, p2)
        gaps.append(max(reach - 0.438 - length, abs(0.438 - length) - reach))
    return min(gaps)


def test_a_drawn_four_bar_has_two_poses() -> None:
    """A guess on the other side of a four-bar leads to its other pose, which is reported."""
    up = four_bar(1.0, 0.3, 0.9, 0.8)
    down = [(name, -angle) for name, angle in up.assembly_angles]
    kinematics = Kinematics(Mechanism(**{**vars_of(up), "assembly_angles": tuple(down)}))
    other = kinematics.at(math.radians(90.0))
    assert not np.allclose(other.angles, Kinematics(up).at(math.radians(90.0)).angles)
    assert kinematics.notice == "" or "is used" in kinematics.notice


@pytest.mark.parametrize("off", [-1e-12, 0.0, 1e-12, -1e-3, 1e-3])
def test_a_guess_between_mirrored_poses(off: float) -> None:
    """Along the line from B to D both poses are equally near: the lower coupler is taken.

    By the law of cosines the coupler is acos((1.09 + 0.81 - 0.64) / (2 * 0.9 * sqrt(1.09))) from
    that line, on either side of it.
    """
    crank, coupler, rocker = 0.3, 0.9, 0.8
    bar = four_bar(1.0, crank, coupler, rocker)
    line = math.atan2(-crank, 1.0)  # from B (0, 0.3) to D (1, 0)
    guess = (("coupler", line + off), ("rocker", line + math.pi))
    kinematics = Kinematics(Mechanism(**{**vars_of(bar), "assembly_angles": guess}))
    length = math.hypot(1.0, crank)
    apart = math.acos((length**2 + coupler**2 - rocker**2) / (2.0 * coupler * length))
    expected = line + apart if off == 1e-3 else line - apart
    angle = kinematics.at(math.radians(90.0)).angle("coupler")
    assert float(turns(np.array(angle - expected))) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("turned", "words"),
    [
        ((-1.5, 1.5 + 1e-14), "coupler turned by -85.9 deg"),
        ((1.5 + 1e-14, -1.5), "coupler turned by +85.9 deg"),
        ((-1.5, 1.5 + 9e-7), "coupler turned by -85.9 deg"),
        ((-1.5, 1.5 + 2e-6), "rocker turned by +85.9 deg"),
    ],
)
def test_the_first_of_bodies_that_turn_alike_is_named(
    turned: tuple[float, float], words: str
) -> None:
    """Turns that differ by 1e-6 rad or less are equal: the body that the file has first counts."""
    bar = four_bar(1.0, 0.3, 0.9, 0.8)
    guess = np.array([bar.assembly_alpha3, *(angle for _, angle in bar.assembly_angles)])
    assert words in pose_notice(bar, [guess + np.array([0.0, *turned])], 0)


@pytest.mark.parametrize(
    ("angle_deg", "written"),
    [(-1e-14, "0.00"), (1e-14, "0.00"), (359.996, "0.00"), (-0.006, "359.99")],
)
def test_an_angle_of_zero_in_the_notice(angle_deg: float, written: str) -> None:
    """It is written as 0.00, on whichever side of a full turn rounding leaves it."""
    bar = four_bar(1.0, 0.3, 0.9, 0.8)
    guess = np.array([bar.assembly_alpha3, *(angle for _, angle in bar.assembly_angles)])
    guess[1:] = math.radians(angle_deg), guess[2] + 1.5
    assert f"{{coupler: {written}, rocker: " in pose_notice(bar, [guess], 0)


def vars_of(mechanism: Mechanism) -> dict[str, Any]:
    """Return the fields of a mechanism."""
    return {name: getattr(mechanism, name) for name in mechanism.__dataclass_fields__}
