# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Deviations of levels by a speed that is not known exactly, against samples of the model."""

import math
from typing import Any

import numpy as np
import pytest

from linkage_vibration.mechanics.ground_motion import transmissibility
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.excitation import Source, excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table

NAME = "three_point_linkage_on_tractor"
ANGLE = 2.2  # rad
STDDEV = 0.02  # of the speed, 1
AMPLITUDE = 2.0  # m/s^2 or N

MECHANISM = read_mechanism(config_file(f"{NAME}.yaml"))
SOIL = {"base_acceleration": [AMPLITUDE], "at": "base.z"}
FORCE = {"force": [AMPLITUDE], "at": "E1.z"}


def velocity_and_stddevs(load: dict[str, Any], hertz: float, stddev: float) -> tuple[float, ...]:
    """Return the velocity by a load, its standard deviation, and that of the total, m/s.

    The linkage itself is known exactly, so only the speed deviates.
    """
    order = {"speed": "engine", "orders": [1], "at_speed": 600.0, "frequency_stddev": stddev}
    excitations = excitations_from_mapping({"load": {**order, **load}})
    predictor = Predictor(load_table(config_file(f"tables/{NAME}.npz")))
    table = LevelTable(predictor, MECHANISM, excitations)
    speeds = [[60.0 * hertz if s is Source.ENGINE else math.nan] for s in Source]
    exact = np.zeros((2, 1, predictor.table.n_modes))
    levels = table.at(np.array([ANGLE]), np.array(speeds), exact)
    columns = levels.velocities, levels.velocity_stddevs, levels.total_velocity_stddev
    return tuple(float(np.ravel(column)[0]) for column in columns)


@pytest.mark.parametrize("load", [SOIL, FORCE], ids=["soil", "force"])
@pytest.mark.parametrize("hertz", [1.0, 4.0, 15.0])
def test_deviation_by_the_speed(load: dict[str, Any], hertz: float) -> None:
    """It is that of 20,000 speeds at which the model itself gives the velocity.

    A displacement u has the velocity omega u, and an acceleration a of the soil is a displacement
    of a / omega^2; so the velocity per acceleration is |transmissibility| / omega.
    """
    velocity, stddev, total = velocity_and_stddevs(load, hertz, STDDEV)
    drawn = hertz * (1.0 + STDDEV * np.random.default_rng(1).standard_normal(20_000))
    drawn = np.append(drawn, hertz)
    omega, solution = 2.0 * math.pi * drawn, LinkageModel(MECHANISM).solve(ANGLE)
    if load is SOIL:
        moved = transmissibility(solution, [("E1", "z")], ("base", "z")).frf(drawn)
        sampled = np.abs(moved[:, 0, 0]) / omega
    else:
        sampled = omega * np.abs(solution.frf([("E1", "z")], [("E1", "z")]).frf(drawn)[:, 0, 0])
    sampled *= AMPLITUDE / math.sqrt(2.0)
    assert velocity == pytest.approx(float(sampled[-1]), rel=2e-4)
    assert stddev == pytest.approx(float(np.std(sampled[:-1])), rel=0.02)
    assert total == pytest.approx(stddev, rel=1e-6)  # there is no other load


@pytest.mark.parametrize("load", [SOIL, FORCE], ids=["soil", "force"])
def test_speed_that_is_known(load: dict[str, Any]) -> None:
    """A speed that is known exactly, of a linkage that is known exactly, gives no deviation."""
    velocity, stddev, total = velocity_and_stddevs(load, 4.0, 0.0)
    assert velocity > 0.0
    assert (stddev, total) == (0.0, 0.0)
