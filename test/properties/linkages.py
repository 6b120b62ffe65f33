# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Random linkages that close: a pose is drawn first, and the lengths follow from it.

Four-bars, and six-bars of Stephenson's third kind as the package ships one. No dyad is nearer to
being stretched or folded than 25 deg, so that the angle drawn is well away from the toggles. They
may have dampers, or loss factors that differ from link to link, and then a wider stroke.
"""

import copy
import math
from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st

from linkage_vibration.mechanics.description import GROUND, Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.parsing import mechanism_from_mapping

DRIVE_POINT = "C"
SHORTEST = 0.1  # m, of all links
LEAST_BEND = 25.0  # deg, between the two bodies of a dyad and a straight line
ANGLE = st.floats(-180.0, 180.0)  # deg
UNIT = st.floats(0.0, 1.0)
CHOICE = st.booleans()
WIDEST = 40.0  # deg, from the middle of a stroke to its ends
NEAREST = 1.0  # deg, from the end of a stroke to a toggle
STEEL = {"youngs_modulus": 210e9, "density": 7800.0, "poisson_ratio": 0.3}
ALUMINIUM = {"youngs_modulus": 70e9, "density": 2700.0, "poisson_ratio": 0.33}


@dataclass(frozen=True)
class Linkage:
    """A description, and an input angle in degrees at which it closes."""

    mapping: dict[str, Any]
    alpha3_deg: float

    @property
    def alpha3(self) -> float:
        """The input angle, rad."""
        return math.radians(self.alpha3_deg)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism of the description."""
        return mechanism_from_mapping(self.mapping)

    def solve(self, like: Solution | None = None, *, reduced: bool = True) -> Solution:
        """Solve it; ``like`` is a linkage that moves as it does, whose kinematics serve again."""
        kinematics = None if like is None else like.model.kinematics
        model = LinkageModel(self.mechanism, reduced=reduced, kinematics=kinematics)
        return model.solve(self.alpha3)

    def copy(self) -> "Linkage":
        """Return one whose description may be changed."""
        return Linkage(copy.deepcopy(self.mapping), self.alpha3_deg)


def within(draw: st.DrawFn, low: float, high: float) -> float:
    """Draw a number; one strategy serves all ranges, as making one takes longer than drawing."""
    return low + (high - low) * draw(UNIT)


def beam(draw: st.DrawFn, points: dict[str, Any]) -> dict[str, Any]:
    """Draw an elastic link."""
    outer = within(draw, 0.01, 0.06)
    if draw(CHOICE):
        section = {"shape": "rectangle", "width": within(draw, 0.01, 0.06), "height": outer}
    else:
        inner = outer * within(draw, 0.3, 0.9)
        section = {"shape": "tube", "outer_diameter": outer, "inner_diameter": inner}
    material = STEEL if draw(CHOICE) else ALUMINIUM
    return {"points": points, "material": material, "section": section, "elements": 3, "modes": 2}


def add_body(
    draw: st.DrawFn, mapping: dict[str, Any], name: str, start: str, end: str, length: float
) -> None:
    """Draw a body between two points, elastic or rigid."""
    if draw(CHOICE):
        mapping["links"][name] = beam(draw, {start: 0.0, end: length})
        return
    mass = within(draw, 0.5, 100.0)
    radius = within(draw, 0.05, 0.5)  # of gyration, m
    mapping["rigid_bodies"][name] = {
        "points": {start: [0.0, 0.0], end: [length, 0.0]},
        "centre_of_gravity": [within(draw, 0.0, length), within(draw, -0.2, 0.2)],
        "mass": mass,
        "inertia": mass * radius**2,
    }


def damping(draw: st.DrawFn) -> dict[str, Any]:
    """Draw a rule."""
    ratio = within(draw, 0.002, 0.05)
    if draw(CHOICE):
        return {"rule": "loss_factor", "factor": 2.0 * ratio}
    if draw(CHOICE):
        return {"rule": "modal_ratio", "ratio": ratio}
    return {"ratio": ratio, "at_hz": [20.0, 500.0]}


def bend(draw: st.DrawFn) -> float:
    """Draw by how much a dyad is bent, deg."""
    return within(draw, LEAST_BEND, 180.0 - LEAST_BEND) * (1.0 if draw(CHOICE) else -1.0)


def draw_linkage(draw: st.DrawFn) -> Linkage:
    """Draw a linkage, and an angle at which it closes."""
    alpha3 = draw(ANGLE)
    angles = {"coupler": draw(ANGLE)}
    angles["rocker"] = angles["coupler"] + bend(draw)
    crank, coupler = within(draw, SHORTEST, 0.4), within(draw, 0.3, 0.9)
    rocker = within(draw, 0.2, 0.7)
    place = {"A": (0.0, 0.0)}
    place["B"] = beyond(place["A"], alpha3, (crank, 0.0))
    place["C"] = beyond(place["B"], angles["coupler"], (coupler, 0.0))
    place["D"] = beyond(place["C"], angles["rocker"], (-rocker, 0.0))
    mapping: dict[str, Any] = {
        "name": "drawn",
        "ground": {name: list(place[name]) for name in "AD"},
        "links": {
            "crank": beam(draw, {"A": 0.0, "B": crank}),
            "coupler": beam(draw, {"B": 0.0, "C": coupler}),
        },
        "rigid_bodies": {},
        "springs": {},
        "input": {"link": "crank", "range_deg": [alpha3 - 0.01, alpha3 + 0.01]},
        "assembly": {"alpha3_deg": alpha3, "angles_deg": angles},
        "damping": damping(draw),
        "response": {
            "drive_point": DRIVE_POINT,
            "direction": "x",
            "band_hz": [0.0, 500.0],
            "modes": 3,
        },
    }
    add_body(draw, mapping, "rocker", "D", "C", rocker)
    if draw(CHOICE):
        beside = (coupler * within(draw, 0.3, 0.7), within(draw, -0.2, 0.2))
        angles["drag_link"] = draw(ANGLE)
        angles["pendulum"] = angles["drag_link"] + bend(draw)
        drag, pendulum = within(draw, 0.2, 0.7), within(draw, 0.2, 0.7)
        mapping["links"]["coupler"]["points"] = {"B": 0.0, "P": list(beside), "C": coupler}
        mapping["links"]["drag_link"] = beam(draw, {"P": 0.0, "E": drag})
        add_body(draw, mapping, "pendulum", "F", "E", pendulum)
        place["P"] = beyond(place["B"], angles["coupler"], beside)
        place["E"] = beyond(place["P"], angles["drag_link"], (drag, 0.0))
        mapping["ground"]["F"] = list(beyond(place["E"], angles["pendulum"], (-pendulum, 0.0)))
    if draw(CHOICE):
        mapping["links"]["crank"]["clamped"] = "A"
    else:
        drive = {"joint": "A", "stiffness": 10.0 ** within(draw, 3.0, 6.0)}
        if "factor" not in mapping["damping"]:  # viscous and structural damping do not mix
            drive["damping"] = within(draw, 0.0, 20.0)
        mapping["springs"]["drive"] = drive
    return Linkage(mapping, alpha3)


def draw_damped(draw: st.DrawFn) -> Linkage:
    """Draw a linkage with a stroke of up to 80 deg, whose damping couples its modes."""
    linkage = draw_linkage(draw)
    mapping = linkage.mapping
    if "factor" in mapping["damping"]:
        for link in mapping["links"].values():
            link["damping"] = {"rule": "loss_factor", "factor": 10.0 ** within(draw, -3.0, 0.0)}
    else:  # viscous and structural damping do not mix
        for i in range(1 + int(within(draw, 0.0, 2.999))):
            mapping["springs"][f"damper_{i}"] = damper(draw, linkage.mechanism)
    half = 2.0 * (WIDEST / 2.0) ** draw(UNIT)
    low, high = linkage.alpha3_deg - half, linkage.alpha3_deg + half
    toggles = Kinematics(linkage.mechanism).toggles
    if toggles is not None:
        ends = [math.degrees(toggle.alpha3) for toggle in toggles]
        near = min(
            NEAREST, (linkage.alpha3_deg - ends[0]) / 2.0, (ends[1] - linkage.alpha3_deg) / 2.0
        )
        low, high = max(low, ends[0] + near), min(high, ends[1] - near)
    mapping["input"]["range_deg"] = [low, high]
    return linkage


def damper(draw: st.DrawFn, mechanism: Mechanism) -> dict[str, Any]:
    """Draw a damper, often without a spring: in a joint, or between points of two bodies."""
    constant = {"damping": 10.0 ** within(draw, -2.0, 5.0)}  # N m s/rad, or N s/m
    if draw(CHOICE):
        constant["stiffness"] = 10.0 ** within(draw, -6.0, 6.0)
    clamped = {link.clamped for link in mechanism.links}  # where a damper could not move
    joints = sorted({point for point, _, _ in mechanism.joints} - clamped)
    names = [GROUND, *(body.name for body in mechanism.bodies)]
    pairs = [
        [each, other]
        for i, first in enumerate(names)
        for second in names[i + 1 :]
        for each in mechanism.local_points(first)
        for other in mechanism.local_points(second)
        if mechanism.owners(each)[:1] != mechanism.owners(other)[:1]
    ]
    if draw(CHOICE):
        return {"joint": _member(draw, joints), **constant}
    return {"between": _member(draw, pairs), **constant}


def _member(draw: st.DrawFn, of: list[Any]) -> Any:
    return of[min(int(draw(UNIT) * len(of)), len(of) - 1)]


linkages = st.composite(draw_linkage)
damped_linkages = st.composite(draw_damped)


def beyond(
    place: tuple[float, float], angle_deg: float, local: tuple[float, float]
) -> tuple[float, float]:
    """Return the place that lies at local x, z from another, in axes turned by an angle."""
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    x, z = local
    return place[0] + c * x - s * z, place[1] + s * x + c * z
