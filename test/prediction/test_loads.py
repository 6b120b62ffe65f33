# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Unit loads as forces at places: their sums and their moments are those of the load."""

from typing import Any

import numpy as np
import pytest

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.excitation import excitations_from_mapping
from linkage_vibration.prediction.loads import UnitLoad, load_input
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table

NAME = "three_point_linkage_on_tractor"
MECHANISM = read_mechanism(config_file(f"{NAME}.yaml"))
TABLE = load_table(config_file(f"tables/{NAME}.npz"))


def unit_load(kind: str, at: str) -> UnitLoad:
    """Return the input of a load at a place or on a body."""
    keys: dict[str, Any] = {"speed": "pto", "orders": [1], kind: [5.0], "at": at, "at_speed": 540.0}
    [excitation] = excitations_from_mapping({"load": keys})
    return load_input(excitation, TABLE, MECHANISM)


@pytest.mark.parametrize("body", ["implement", "base"])
@pytest.mark.parametrize("alpha3", [1.7, 2.9])
def test_moment_is_a_pair_of_forces(body: str, alpha3: float) -> None:
    """Its forces have no sum, and their moment about any point is 1, however the body has turned.

    In the plane of x and z the moment of a force is x F_z - z F_x.
    """
    load = unit_load("moment", body)
    weights, rates = load.weights(alpha3)
    assert not rates.any()
    configuration = LinkageModel(MECHANISM).solve(alpha3).configuration
    assert MECHANISM.base is not None
    mounts = {mount.name: mount.at for mount in MECHANISM.base.mounts}
    [rigid] = [each for each in MECHANISM.rigid_bodies if each.name == "implement"]
    points = dict(rigid.points) if body == "implement" else mounts
    force, moment = np.zeros(2), 0.0
    for (point, direction), weight in zip(load.places, weights.tolist(), strict=True):
        at = np.array(points[point], float)
        if body == "implement":
            at = np.asarray(configuration.place("implement", points[point]))
        force["xz".index(direction)] += weight
        moment += at[0] * weight if direction == "z" else -at[1] * weight
    np.testing.assert_allclose(force, 0.0, atol=1e-12)
    assert moment == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("kind", ["base_acceleration", "base_displacement"])
def test_motion_of_the_soil_is_a_force_of_the_mounts(kind: str) -> None:
    """A displacement of the soil acts by the stiffness of each mount, a velocity by its damping."""
    assert MECHANISM.base is not None
    for axis, direction in enumerate("xz"):
        load = unit_load(kind, f"base.{direction}")
        known = {mount.name: mount for mount in MECHANISM.base.mounts}
        stiffness = {p: w for (p, _), w in zip(load.places, load.weights(2.0)[0], strict=True)}
        damping = {p: w for (p, _), w in zip(load.places, load.weights(2.0)[1], strict=True)}
        assert {d for _, d in load.places} == {direction}
        expected = {n: m for n, m in known.items() if m.stiffness[axis] or m.damping[axis]}
        assert stiffness == {name: mount.stiffness[axis] for name, mount in expected.items()}
        assert damping == {name: mount.damping[axis] for name, mount in expected.items()}
        first = unit_load(kind, f"base:rear_axle.{direction}")
        assert first.places == (("rear_axle", direction),)


def test_force_is_one() -> None:
    """A force acts at its place, with the size 1 and without a rate."""
    load = unit_load("force", "E2.x")
    assert load.places == (("E2", "x"),)
    assert [part.tolist() for part in load.weights(2.0)] == [[1.0], [0.0]]
