# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The response to motions of the soil."""

import math
from typing import Any

import numpy as np
import pytest
import yaml

from linkage_vibration.mechanics.ground_motion import soil_places, transmissibility
from linkage_vibration.mechanics.model import LinkageModel, ModelError
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from test.mechanics.test_base import TRACTOR
from test.support.free_bodies import forces_by_cuts

OUTPUTS = [("E1", "x"), ("E1", "z"), ("E2", "x")]
LINES = np.array([0.0, 1.0, 2.8, 5.3, 20.0, 80.0])


def described(**changes: Any) -> Any:
    """Return the shipped linkage with other keys."""
    mapping = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    return {**mapping, **changes}


@pytest.mark.parametrize("mount", ["", "rear_axle"])
@pytest.mark.parametrize("direction", ["x", "z"])
def test_soil_under_mounts_equals_a_direct_solution(mount: str, direction: str) -> None:
    """(K + s C + s^2 M) q = G^T (k + s c) at each line, without modes."""
    model = LinkageModel(read_mechanism(config_file("three_point_linkage_on_tractor.yaml")))
    solution = model.solve(2.0)
    coupled, joining = solution.coupled, solution.joining
    rows = [-4, -2] if direction == "x" else [-3, -1]  # rear along x, z, then front along x, z
    rows = rows[:1] if mount else rows
    left = coupled.restrict(model.rows(OUTPUTS, solution.configuration))
    into = coupled.restrict(joining.elongation[rows])
    expected = []
    for s in 2j * math.pi * LINES:
        matrix = coupled.stiffness + s * coupled.damping + s**2 * coupled.mass
        force = into.T @ (joining.stiffness[rows] + s * joining.damping[rows])
        expected.append(left @ np.linalg.solve(matrix, force))
    soil = f"base:{mount}" if mount else "base", direction
    receptances = transmissibility(solution, OUTPUTS, soil).frf(LINES)[:, :, 0]
    np.testing.assert_allclose(receptances, np.array(expected), rtol=1e-6, atol=1e-8)


def test_soil_under_an_axle_loads_pins_and_tyres() -> None:
    """Forces are those by the force of its mount; its tyre is compressed by the soil, too."""
    model = LinkageModel(read_mechanism(config_file("three_point_linkage_on_tractor.yaml")))
    places, s = model.forces.places, 2j * math.pi * LINES[1:]
    assert model.mechanism.base is not None
    [rear, _] = model.mechanism.base.mounts
    law = rear.stiffness[1] + s * rear.damping[1]
    exact = forces_by_cuts(model, 2.0, LINES[1:], [("rear_axle", "z")])[:, :, 0]
    exact = exact * law[:, np.newaxis]
    exact[:, places.index(("base:rear_axle", "force_z"))] -= law
    forces = transmissibility(model.solve(2.0), places, ("base:rear_axle", "z"))
    size = np.abs(exact).max(axis=1, keepdims=True)
    assert np.abs((forces.frf(LINES[1:])[:, :, 0] - exact) / size).max() < 1e-6
    at_rest = transmissibility(model.solve(2.0), places, ("base", "z")).frf(np.zeros(1))
    assert np.abs(at_rest).max() < 1e-6 * rear.stiffness[1]


@pytest.mark.parametrize("direction", ["x", "z"])
def test_slow_soil_carries_everything(direction: str) -> None:
    """At 0 Hz every point follows the soil, in its direction only."""
    model = LinkageModel(mechanism_from_mapping(described(base=TRACTOR)))
    transmitted = transmissibility(model.solve(2.0), OUTPUTS, ("base", direction))
    expected = [float(place[1] == direction) for place in OUTPUTS]
    np.testing.assert_allclose(transmitted.frf(np.array([0.0]))[0, :, 0], expected, atol=1e-7)


def test_axles_together_are_the_sum_of_each() -> None:
    """The response is linear in the motion under each mount."""
    solution = LinkageModel(mechanism_from_mapping(described(base=TRACTOR))).solve(2.4)
    names = "base", "base:rear_axle", "base:front_axle"
    every, rear, front = (
        transmissibility(solution, OUTPUTS, (name, "z")).frf(LINES) for name in names
    )
    np.testing.assert_allclose(every, rear + front, rtol=1e-9, atol=1e-12)


def test_unknown_motion_is_refused() -> None:
    """The error names the motions that exist."""
    solution = LinkageModel(mechanism_from_mapping(described(base=TRACTOR))).solve(2.0)
    assert len(soil_places(solution.model.mechanism)) == 6
    with pytest.raises(ModelError, match=r"base:rear_axle\.z"):
        transmissibility(solution, OUTPUTS, ("base:axle", "z"))
    with pytest.raises(ModelError, match=r"no motion E1\.y"):
        transmissibility(solution, OUTPUTS, "E1.y")
    fixed = LinkageModel(mechanism_from_mapping(described())).solve(2.0)
    with pytest.raises(ModelError, match=r"no motion base\.z; .* the mechanism has no base"):
        transmissibility(fixed, OUTPUTS, "base.z")
