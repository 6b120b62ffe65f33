# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Unit loads as forces at places: their sums and their moments are those of the load."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from linkage_vibration.listening.amplitudes import MeasuredOrder, amplitude_numbers
from linkage_vibration.listening.sensor_response import SensorResponse
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction import loads
from linkage_vibration.prediction.excitation import excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.loads import LoadKind, UnitLoad, load_input
from linkage_vibration.prediction.predictor import Predictor
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
    return load_input(excitation.load, excitation.name, TABLE, MECHANISM)


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


def test_moment_on_a_body_that_is_hinged_on_fixed_ground() -> None:
    """The ground's point does not move, so the pair of forces needs two others."""
    six_bar = read_mechanism(config_file("stephenson_six_bar.yaml"))
    [excitation] = excitations_from_mapping(
        {
            "load": {
                "speed": "pto",
                "orders": [1],
                "moment": [5.0],
                "at": "pendulum",
                "at_speed": 540.0,
            }
        }
    )
    given = excitation.load, excitation.name, TABLE
    with pytest.raises(loads.ExcitationError, match="pendulum has fewer than two points that move"):
        load_input(*given, six_bar)
    others = [body for body in six_bar.rigid_bodies if body.name != "pendulum"]
    [pendulum] = set(six_bar.rigid_bodies).difference(others)
    points = {**dict(pendulum.points), "Q": (0.1, 0.2)}
    body = replace(pendulum, points=tuple(points.items()))
    with pytest.raises(loads.ExcitationError, match=r"no FRF at E, Q, where pendulum"):
        load_input(*given, replace(six_bar, rigid_bodies=(*others, body)))


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


def unbalance_at(name: str, mechanism: Mechanism, where: str) -> UnitLoad:
    """Return a force of 1 N, which `LoadKind.power` multiplies by omega^2."""
    point, _, direction = name.partition(".")
    return UnitLoad(((point, direction),), lambda alpha3: (np.ones(1), np.zeros(1)))


UNBALANCE = LoadKind("unbalance", "kg m", unbalance_at, power=2)
SPEED, SIZE = 900.0, 0.02  # rpm, kg m
OMEGA = 2.0 * math.pi * SPEED / 60.0
ROTOR: dict[str, Any] = {"speed": "pto", "orders": [1], "at": "E2.x", "at_speed": SPEED}
ANGLE, SPEEDS = np.array([2.0]), np.array([[math.nan], [SPEED], [math.nan]])


@pytest.fixture
def unbalanced(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return the description of a kind of load whose entry is all that is new."""
    monkeypatch.setattr(loads, "LOAD_KINDS", (*loads.LOAD_KINDS, UNBALANCE))
    return ROTOR | {"unbalance": [SIZE]}


def test_new_kind_of_load_is_one_entry(unbalanced: dict[str, Any]) -> None:
    """An unbalance acts like a force of omega^2 times it, in levels, members and sensors.

    What was measured of it is written at its key.
    """
    sensor: Any = SimpleNamespace(name="box", at="E2", accelerates=True)
    known = []
    for keys in unbalanced, ROTOR | {"force": [SIZE * OMEGA**2]}:
        [rotor] = excitations = excitations_from_mapping({"rotor": keys})
        levels = LevelTable(Predictor(TABLE), MECHANISM, excitations)
        at = levels.at(ANGLE, SPEEDS)
        gains = SensorResponse(TABLE, MECHANISM, excitations, sensor).gains(2.0, np.array([OMEGA]))
        assert rotor.load is not None
        known.append([at.velocities, at.load_ratios, levels.members(ANGLE, SPEEDS)])
        known[-1].append(rotor.load.amplitude * gains)
        row = MeasuredOrder(rotor, 9, 1.0, 1.0, 1.0, 1.0, 0.03, 0.1, is_detected=True)
        assert ([*keys][-1], ["0.03"]) in [
            (where[1], values) for where, values in amplitude_numbers([row], {"rotor": keys})
        ]
    for of_unbalance, of_force in zip(*known, strict=True):
        assert np.isfinite(of_unbalance).any()
        np.testing.assert_allclose(of_unbalance, of_force, rtol=1e-5)
