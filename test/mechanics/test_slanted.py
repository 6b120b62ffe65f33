# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Links and springs that are not parallel to the plane, against rigid links with one motion."""

import math
from typing import Any, Literal

import numpy as np
import pytest
import yaml

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.support.resources import config_file
from test.mechanics.test_lateral_weight import rigid

Half = Literal["vertical", "lateral"]
STEP, STIFFNESS = 1e-4, 3e5  # rad; N m/rad or N/m
ALPHA3 = math.radians(135.0)


@pytest.fixture
def hitch() -> Any:
    """Return the clamped hitch of rigid links without weight, which nothing holds, as a mapping."""
    tractor, mapping = (
        yaml.safe_load(config_file(f"three_point_linkage{of}.yaml").read_text())
        for of in ("_on_tractor", "")
    )
    mapping.pop("uncertainty", None)
    lateral = tractor["lateral"]
    del lateral["axles"], lateral["inertia"]["base"], mapping["links"]["input_crank"]["clamped"]
    return rigid(mapping | {"lateral": lateral | {"weight": "ignored"}})


def moving_mass(model: LinkageModel, mapping: Any) -> float:
    """Return twice the kinetic energy of the implement at 1 rad/s of the crank, kg m2."""
    body = mapping["rigid_bodies"]["implement"]
    near = [model.kinematics.at(ALPHA3 + step) for step in (-STEP, STEP)]
    centre = model.mechanism.rigid_bodies[0].centre_of_gravity
    moved = np.diff([at.place("implement", centre) for at in near], axis=0)[0] / (2.0 * STEP)
    turned = np.diff([at.angle("implement") for at in near])[0] / (2.0 * STEP)
    return float(body["mass"] * moved @ moved + body["inertia"] * turned**2)


def heave(mapping: Any) -> tuple[float, LinkageModel]:
    """Return the lowest natural frequency, Hz, and the model."""
    model = LinkageModel(mechanism_from_mapping(mapping))
    return float(model.solve(ALPHA3).modes.omega[0]) / math.tau, model


@pytest.mark.parametrize("aside", [0.25, 0.30, 0.35])
def test_a_spring_on_the_pin_of_a_slanted_crank(hitch: Any, aside: float) -> None:
    """It twists as the crank turns about the pin, wherever the end of the crank is along y."""
    hitch["springs"] = {"hold": {"joint": "P3", "stiffness": STIFFNESS}}
    hitch["lateral"]["y"]["V2"] = aside
    found, model = heave(hitch)
    expected = math.sqrt(STIFFNESS / moving_mass(model, hitch)) / math.tau
    assert found == pytest.approx(expected, rel=5e-5)


@pytest.mark.parametrize("aside", [None, 0.29, 0.60, 1.00])
def test_a_spring_that_is_not_parallel_to_the_plane(hitch: Any, aside: float | None) -> None:
    """Its force acts along its true line, so that it resists less of what is seen from the side."""
    hitch["ground"]["Q"] = [0.2, 0.3]
    hitch["springs"] = {"stay": {"between": ["Q", "V1"], "stiffness": 10.0 * STIFFNESS}}
    if aside is not None:
        hitch["lateral"]["y"]["Q"] = aside
    found, model = heave(hitch)
    assert model.mechanism.lateral is not None
    across = dict(model.mechanism.lateral.y)["V1"] - (aside or 0.0)
    pin = dict(model.mechanism.local_points("lower_link"))["V1"]
    lengths = [
        math.hypot(
            *(model.kinematics.at(ALPHA3 + step).place("lower_link", pin) - [0.2, 0.3]), across
        )
        for step in (-STEP, STEP)
    ]
    rate = (lengths[1] - lengths[0]) / (2.0 * STEP)
    stiffness = 10.0 * STIFFNESS * rate**2
    expected = math.sqrt(stiffness / moving_mass(model, hitch)) / math.tau
    assert found == pytest.approx(expected, rel=5e-5)


@pytest.mark.parametrize("half", ["vertical", "lateral"])
@pytest.mark.parametrize("joint", ["P1", "E1"])
@pytest.mark.parametrize("aside", [0.20, 0.40])
def test_a_turn_of_the_whole_tractor_strains_no_joint(half: Half, joint: str, aside: float) -> None:
    """Without tyres, a spring on the pin of a slanted link leaves three motions of each half free.

    It is between the link and the tractor, or the implement.
    """
    mapping = yaml.safe_load(config_file("three_point_linkage_on_tractor.yaml").read_text())
    del mapping["uncertainty"]
    for mount in mapping["base"]["mounts"].values():
        mount["stiffness"] = mount["damping"] = [0.0, 0.0]
    for axle in mapping["lateral"]["axles"].values():
        axle["stiffness"] = axle["damping"] = 0.0
    mapping["lateral"] |= {"weight": "ignored", "y": mapping["lateral"]["y"] | {"P1": aside}}
    mapping["springs"]["pin"] = {"joint": joint, "stiffness": 1e6}
    modes = LinkageModel(mechanism_from_mapping(mapping), half=half).solve(ALPHA3).modes
    assert modes.omega[2] < 1e-4 * modes.omega[3]
