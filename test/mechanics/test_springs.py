# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Hydraulic cylinders, and loss factors of springs."""

import math
from typing import Any

import numpy as np
import pytest
import yaml

from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.springs import length_and_rate, spring_stiffness
from linkage_vibration.prediction.doubts import linkage_doubts
from linkage_vibration.support.resources import config_file
from test.mechanics.test_forces import LEVER
from test.support.bob import ARM, BOB, MASS

# The crank (0.203 m long, about P3) is pushed by two cylinders that stand on the tractor.
OIL = {
    "joint": "P3",
    "cylinder": {
        "base_end": [-0.050, 0.025],
        "rod_end": [0.0, 0.090],
        "count": 2,
        "bore": 0.080,
        "stroke": 0.300,
        "closed_length": 0.260,
        "hose_volume": 4.0e-4,
        "bulk_modulus": 1.2e9,
    },
}
STAY = {
    "between": ["P2", "V1"],
    "cylinder": {
        "bore": 0.05,
        "rod": 0.03,
        "stroke": 0.6,
        "closed_length": 0.2,
        "hose_volume": 1e-4,
        "bulk_modulus": 1e9,
    },
}


def sprung(spring: dict[str, Any]) -> LinkageModel:
    """Return the shipped linkage whose crank is held by a spring instead of a clamp."""
    mapping = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    if "joint" in spring:
        del mapping["links"]["input_crank"]["clamped"]
    mapping["springs"] = {"oil": spring}
    return LinkageModel(mechanism_from_mapping(mapping))


def stiffness(model: LinkageModel, alpha3: float) -> float:
    """Return the stiffness of the only spring."""
    (spring,) = model.mechanism.springs
    return float(spring_stiffness(spring, model.mechanism, model.kinematics.at(alpha3)))


def test_oil_on_a_joint_has_the_stiffness_of_its_volume_and_lever() -> None:
    """K r^2 with B A^2 / (V + A x), by hand at one angle; the lever by a right triangle."""
    alpha3 = math.radians(120.0)
    pin, foot = np.array([-0.064, 0.385]), np.array([-0.050, 0.025])
    head = pin + 0.090 * np.array([-math.sin(alpha3), math.cos(alpha3)])
    length = math.dist(head, foot)
    area = math.pi * 0.040**2
    column = 1.2e9 * area**2 / (4.0e-4 + area * (length - 0.260))
    cross = (head - foot)[0] * (pin - foot)[1] - (head - foot)[1] * (pin - foot)[0]
    lever = cross / length  # distance of the pin from the cylinder's axis
    assert stiffness(sprung(OIL), alpha3) == pytest.approx(2.0 * column * lever**2, rel=1e-12)


def test_rod_side_adds_its_own_column() -> None:
    """Both sides at one length: B A^2 / V of the piston, and of the ring with what is left."""
    model, alpha3 = sprung(STAY), math.radians(120.0)
    configuration = model.kinematics.at(alpha3)
    ends = configuration.place("lower_link", (0.366, 0.0)), np.array([-0.334, 0.403])
    travel = math.dist(*ends) - 0.2
    piston, ring = math.pi * 0.025**2, math.pi * (0.025**2 - 0.015**2)
    expected = piston**2 / (1e-4 + piston * travel) + ring**2 / (1e-4 + ring * (0.6 - travel))
    assert stiffness(model, alpha3) == pytest.approx(1e9 * expected, rel=1e-12)


def propped(mass: float, height: float, **cylinder: float) -> LinkageModel:
    """Return a body about the origin that two cylinders hold at 1 m, from 2 m above or below."""
    oil = {"bore": 0.05, "stroke": 1.0, "closed_length": 1.5, "bulk_modulus": 1e9, "count": 2}
    changed = {
        "ground": {"P": [0.0, 0.0], "Q": [1.0, height]},
        "rigid_bodies": {"bob": {**BOB, "mass": mass, "inertia": 0.2 * mass}},
        "springs": {"strut": {"between": ["Q", "E"], "cylinder": {**oil, **cylinder}}},
    }
    return LinkageModel(mechanism_from_mapping({**LEVER, **changed}))


def thrusts(mass: float, height: float) -> list[tuple[float, float, float]]:
    """Return the thrust of each cylinder, N, with its lever, m, and angle, deg, by moments."""
    actual = []
    for degrees in np.linspace(-10.0, 10.0, 9).tolist():
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        x, z = BOB["centre_of_gravity"]
        e, foot = np.array(BOB["points"]["E"]) @ [[c, s], [-s, c]], np.array([1.0, height])
        along = (e - foot) / math.dist(e, foot)
        lever = float(e[0] * along[1] - e[1] * along[0])
        actual.append((mass * 9.80665 * (x * c - z * s) / (2.0 * lever), lever, degrees))
    return actual


def test_a_lever_is_the_distance_of_the_pin_from_the_cylinder() -> None:
    """It is d(length)/d(angle), with the sign of a cylinder that grows with the angle."""
    model = propped(100.0, -2.0)
    for _, lever, degrees in thrusts(100.0, -2.0):
        at = model.kinematics.at(math.radians(degrees))
        actual = length_and_rate(model.mechanism.springs[0], model.mechanism, at)
        assert actual[1] == pytest.approx(lever, rel=1e-9)


@pytest.mark.parametrize(("height", "rod"), [(-2.0, None), (2.0, 0.03)])
def test_a_pressure_that_no_tractor_has_is_doubted(height: float, rod: float | None) -> None:
    """It is doubted above 200 bar on the piston or, where the cylinder pulls, on the ring."""
    area = math.pi * 0.025**2 - math.pi * (0.015**2 if height > 0.0 else 0.0)
    thrust, lever, degrees = max(thrusts(1.0, height), key=lambda first: abs(first[0]))
    limit = 200e5 * area / abs(thrust)  # kg
    sides = {} if rod is None else {"rod": rod}
    assert not [*linkage_doubts(propped(0.999 * limit, height, **sides))]
    notice = " ".join(linkage_doubts(propped(1.5 * limit, height, **sides)))
    assert f"needs 300 bar in strut at alpha3 = {degrees:.0f} deg" in notice
    assert f"its lever is {1e3 * abs(lever):.0f} mm, and tractors reach 200 bar" in notice
    assert "200 bar in strut" in " ".join(linkage_doubts(propped(1.001 * limit, height, **sides)))


def test_a_cylinder_that_cannot_pull_is_doubted() -> None:
    """One that hangs the body up needs oil on the side of its rod; one that stands does not."""
    assert "strut would have to pull" in " ".join(linkage_doubts(propped(10.0, 2.0)))
    assert not [*linkage_doubts(propped(10.0, 2.0, rod=0.03))]
    assert not [*linkage_doubts(propped(10.0, -2.0))]


def jointed(**cylinder: Any) -> LinkageModel:
    """Return a body about the origin that a cylinder on its pin holds, from below."""
    oil = {"bore": 0.05, "stroke": 1.0, "closed_length": 0.5, "bulk_modulus": 1e9}
    ends = {"base_end": [0.3, -1.0], "rod_end": [0.3, 0.0]}
    spring = {"joint": "P", "cylinder": {**oil, **ends, **cylinder}}
    mapping = {**LEVER, "ground": {"P": [0.0, 0.0]}, "springs": {"strut": spring}}
    return LinkageModel(mechanism_from_mapping(mapping))


def test_a_cylinder_without_a_lever_holds_nothing() -> None:
    """With its rod at the pin its force is not known, and the notice says why; 1 cm holds."""
    model = jointed(rod_end=[0.0, 0.0])
    assert np.isnan(model.static_forces(0.0)).all()
    notice = "strut has no lever at alpha3 = -10 deg, so it holds nothing there"
    assert " ".join(linkage_doubts(model)).startswith(notice)
    held = jointed(rod_end=[0.01, 0.0])
    lever = 0.01 / math.hypot(0.29, 1.0)
    assert held.static_forces(0.0) == pytest.approx(MASS * 9.80665 * ARM / lever, rel=1e-6)
    assert not [*linkage_doubts(held)]


def test_a_cylinder_whose_ends_meet_is_refused() -> None:
    """It has no direction there, so the error says which ends to correct."""
    model = jointed(base_end=[0.0, 0.0], rod_end=[0.0, 0.0])
    with pytest.raises(MechanismError, match=r"ends meet .* correct base_end or rod_end") as caught:
        model.solve(0.0)
    assert caught.value.path == "springs.strut"


def _cylinder(**changes: Any) -> dict[str, Any]:
    return {**OIL, "cylinder": {**OIL["cylinder"], **changes}}  # type: ignore[dict-item]


@pytest.mark.parametrize(
    ("spring", "path"),
    [
        (_cylinder(bore=-1.0), "cylinder.bore"),
        (_cylinder(rod=0.08), "cylinder.rod"),
        (_cylinder(bulk=1.0), "cylinder.bulk"),
        (_cylinder(bore=80.0), "cylinder.bore"),
        (_cylinder(stroke=160.0), "cylinder.stroke"),
        (_cylinder(hose_volume=-1e-4), "cylinder.hose_volume"),
        (_cylinder(hose_volume=0.16), "cylinder.hose_volume"),
        (_cylinder(bulk_modulus=1600.0), "cylinder.bulk_modulus"),
        ({"joint": "P3", "stiffness": 2e15}, "stiffness"),
        ({"joint": "P3", "damping": 2e12}, "damping"),
    ],
)
def test_invalid_stiffness_is_refused(spring: dict[str, Any], path: str) -> None:
    """The error names the key."""
    with pytest.raises(MechanismError) as caught:
        sprung(spring)
    assert caught.value.path == f"springs.oil.{path}"


def test_oil_without_height_is_refused() -> None:
    """A piston at its end, without hoses, would be rigid; the error says where."""
    pin, foot = np.array([-0.064, 0.385]), np.array([-0.050, 0.025])
    length = math.dist(pin + 0.090 * np.array([-math.sin(2.0), math.cos(2.0)]), foot)
    spring = _cylinder(closed_length=length - 1e-12, hose_volume=0.0)
    with pytest.raises(MechanismError, match=r"at alpha3 = 114\.59 deg its oil is only 1e-12"):
        stiffness(sprung(spring), 2.0)


def test_piston_beyond_its_end_is_refused() -> None:
    """The error says how long the cylinder would have to be, and where."""
    with pytest.raises(MechanismError, match=r"apart at alpha3 = 114\.59 deg") as caught:
        sprung(_cylinder(stroke=0.01)).solve(2.0)
    assert caught.value.path == "springs.oil.cylinder"


def test_a_stack_names_the_first_angle_beyond_the_end() -> None:
    """Of three angles, the first at which the piston is beyond its end is named."""
    pin, foot = np.array([-0.064, 0.385]), np.array([-0.050, 0.025])
    length = math.dist(pin + 0.090 * np.array([-math.sin(1.8), math.cos(1.8)]), foot)
    model = sprung(_cylinder(closed_length=length - 0.005, stroke=0.01))
    assert model.stack(np.array([1.8, 1.8001])).vectors.shape[0] == 2
    with pytest.raises(MechanismError, match=r"apart at alpha3 = 114\.59 deg"):
        model.stack(np.array([1.8, 2.0, 2.1]))


def damped(spring: dict[str, Any], hertz: float) -> LinkageModel:
    """Return an arm of 1 kg m2 about its pin on the ground, with a spring for that frequency."""
    arm = {
        "points": {"P": [0.0, 0.0], "Q": [1.0, 0.0]},
        "centre_of_gravity": [0.5, 0.0],
        "mass": 3.0,
        "inertia": 0.25,
    }
    mapping = {
        "name": "arm",
        "ground": {"P": [0.0, 0.0]},
        "links": {},
        "rigid_bodies": {"arm": arm},
        "springs": {"hold": {"joint": "P", "stiffness": (2.0 * math.pi * hertz) ** 2, **spring}},
        "input": {"link": "arm", "range_deg": [0.0, 90.0]},
        "assembly": {"alpha3_deg": 0.0},
        "damping": {"rule": "modal_ratio", "ratio": 0.01},
        "response": {"drive_point": "Q", "direction": "z", "band_hz": [0.0, 20.0], "modes": 1},
    }
    return LinkageModel(mechanism_from_mapping(mapping))


@pytest.mark.parametrize(("hertz", "factor", "at"), [(3.0, 0.1, 3.0), (6.0, 0.1, 3.0), (5, 0.4, 8)])
def test_loss_factor_has_the_decrement_of_its_damper(
    hertz: float, factor: float, at: float
) -> None:
    """A mass swings on a damper of eta k / (2 pi f): its peaks fall as the closed form says.

    At the frequency of the loss factor, the damping ratio is half of it.
    """
    k = (2.0 * math.pi * hertz) ** 2
    c = factor * k / (2.0 * math.pi * at)
    ring = np.roots([1.0, c, k])  # of theta'' + c theta' + k theta = 0
    decrement = -2.0 * math.pi * ring[0].real / abs(ring[0].imag)
    solution = damped({"loss_factor": {"factor": factor, "at_hz": at}}, hertz).solve(0.5)
    ratio = float(solution.damping_ratios[0])
    assert 2.0 * math.pi * ratio / math.sqrt(1.0 - ratio**2) == pytest.approx(decrement, rel=1e-9)
    assert ratio == pytest.approx(factor / 2.0 * hertz / at, rel=1e-9)
    same = damped({"damping": c}, hertz).solve(0.5)
    assert float(same.damping_ratios[0]) == pytest.approx(ratio, rel=1e-12)


def test_loss_factor_of_oil_follows_its_stiffness() -> None:
    """The damper of a cylinder changes over the stroke as the oil does, beside its own damping."""
    loss = {"loss_factor": {"factor": 0.1, "at_hz": 6.0}, "damping": 50.0}
    model = sprung({**OIL, **loss})
    for alpha3 in (1.7, 2.6):
        joining = model.interface.join(model.kinematics.at(alpha3))
        own = stiffness(sprung(OIL), alpha3)
        assert joining.stiffness[0] == own
        assert joining.damping[0] == pytest.approx(50.0 + 0.1 * own / (12.0 * math.pi), rel=1e-12)
    plain = sprung({**OIL, "damping": 50.0}).mechanism
    none = sprung({**OIL, "damping": 50.0, "loss_factor": {"factor": 0.0, "at_hz": 6.0}}).mechanism
    assert none.model_hash == plain.model_hash != model.mechanism.model_hash


@pytest.mark.parametrize(
    ("spring", "path"),
    [
        ({"loss_factor": {"factor": 2.1, "at_hz": 6.0}}, "loss_factor.factor"),
        ({"loss_factor": {"factor": -0.1, "at_hz": 6.0}}, "loss_factor.factor"),
        ({"loss_factor": {"factor": 0.1}}, "loss_factor.at_hz"),
        ({"loss_factor": {"factor": 0.1, "at_hz": 0.05}}, "loss_factor.at_hz"),
        ({"loss_factor": {"factor": float("nan"), "at_hz": 6.0}}, "loss_factor.factor"),
        ({"loss_factor": 0.1}, "loss_factor"),
        ({"stiffness": 0.0, "damping": 1.0, "loss_factor": {}}, "loss_factor"),
    ],
)
def test_invalid_loss_factor_is_refused(spring: dict[str, Any], path: str) -> None:
    """The error names the key; factors of 0 and 2 and 0.1 Hz are valid."""
    with pytest.raises(MechanismError) as caught:
        damped(spring, 3.0)
    assert caught.value.path == f"springs.hold.{path}"
    damped({"loss_factor": {"factor": 2.0, "at_hz": 0.1}}, 3.0)
