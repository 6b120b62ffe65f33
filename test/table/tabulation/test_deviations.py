# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A table has the standard deviations by uncertain numbers, and says where they are unknown."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("matplotlib")

from benchmark.uncertainty import LIMIT, NAMES, described, scatter
from linkage_vibration.mechanics.description import Mechanism, UncertainNumber, Uncertainty
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.sensitivity import Sensitivity
from linkage_vibration.prediction.batch import predict_many
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.table.table import load_table, save_table
from linkage_vibration.table.tabulation import build_table
from test.support.crossing import crossing_crank

FloatArray = NDArray[np.float64]

AT = 0.7  # rad, where the modes of the crank are nearest
STIFFNESS = 6e4  # N/m, of its spring
CLAIMS = {
    "relative": {
        "links.lower_link.section.height": 0.05,
        "rigid_bodies.implement.mass": 0.1,
        "damping.ratio": 0.3,
    },
    "absolute": {"ground.P3.0": 0.002},
}


@pytest.mark.parametrize("damper", [False, True], ids=["proportional", "coupled"])
def test_between_points_they_are_those_of_the_model(
    mapping: Any, tmp_path: Path, damper: bool
) -> None:
    """They are found at the table's points only, and hold between these, also from a file."""
    if damper:
        joint = {"joint": "E1", "bodies": ["lower_link", "implement"]}
        mapping["springs"] = {"damper": joint | {"stiffness": 1e3, "damping": 300.0}}
    mapping["input"]["range_deg"] = [120.0, 140.0]
    for link in mapping["links"].values():
        link |= {"elements": 4, "modes": 2}
    mapping["uncertainty"] = CLAIMS
    model = LinkageModel(mechanism_from_mapping(mapping))
    save_table(build_table(model, 1e-3), tmp_path / "table.npz")
    predictor = Predictor(load_table(tmp_path / "table.npz", model.mechanism))
    sensitivity, stddev = Sensitivity(model), 1e-3
    ends = predictor.table.alpha3_range  # whose first may round below its cell
    angles = np.array([*ends, *np.random.default_rng(0).uniform(*ends, 6)])
    many = predict_many(predictor, angles, np.full(8, stddev))
    for i, angle in enumerate(angles.tolist()):
        exact = sensitivity.at(model.solve(angle), 300.0).stddev[:, :3]
        shares, one = predictor.shares(angle, stddev), predictor.predict(angle, stddev)
        exact[0] *= one.natural_frequencies
        np.testing.assert_allclose(shares.parameters, exact, rtol=0.03)
        assert (shares.table[0] == one.interpolation_error * one.natural_frequencies).all()
        both = one.frequency_stddev, one.damping_ratio_stddev
        np.testing.assert_allclose(both, shares.total, rtol=1e-12)
        np.testing.assert_array_equal(
            (many.frequency_stddev[i], many.damping_ratio_stddev[i]), both
        )


def uncertain_crank(gap: float, share: float) -> Mechanism:
    """Return a crank whose modes veer, with an uncertain stiffness of its spring."""
    mechanism, step = crossing_crank(gap, AT), 1e-4 * STIFFNESS
    spring = mechanism.springs[0]
    low, high = (
        replace(mechanism, springs=(replace(spring, stiffness=STIFFNESS + change),))
        for change in (-step, step)
    )
    number = UncertainNumber("stiffness", STIFFNESS, share * STIFFNESS, step, (low, high))
    return replace(mechanism, uncertainty=Uncertainty((number,), ((1.0,),)))


def sampled_deviation(model: LinkageModel, angle: float, draws: FloatArray) -> FloatArray:
    """Return the deviations of ln(frequency) with other stiffnesses of the spring, (2,)."""
    solution = model.solve(angle)
    system, row = solution.coupled, solution.coupled.restrict(solution.joining.elongation)[0]
    stiffness = system.stiffness + draws[:, np.newaxis, np.newaxis] * np.outer(row, row)
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(system.mass, stiffness)).real)
    return np.asarray((np.log(squares[:, :2]) / 2.0).std(axis=0))


@pytest.mark.parametrize(
    ("gap", "share", "near"),
    [(0.1, 0.1, True), (0.5, 0.1, True), (0.5, 0.02, False), (2.0, 0.1, False)],
)
def test_near_a_veering_they_hold_or_are_unknown(gap: float, share: float, near: bool) -> None:
    """Where there is a number, samples agree; elsewhere modes change places.

    They agree within a tenth of the larger deviation of the two modes.
    """
    mechanism = uncertain_crank(gap, share)
    model = LinkageModel(mechanism)
    table = build_table(model, 1e-3)
    angles = np.linspace(*table.alpha3_range, 61)
    draws = np.random.default_rng(1).normal(scale=share * STIFFNESS, size=1500)
    sampled = np.array([sampled_deviation(model, angle, draws) for angle in angles.tolist()])
    predicted = table.evaluate_parameter_deviations(angles)[:, :2]
    known = np.isfinite(predicted)
    room = 0.1 + 3.0 / math.sqrt(2.0 * len(draws))
    off = np.abs(predicted - sampled) / sampled.max(axis=1, keepdims=True)
    assert off[known].max() < room
    assert known.mean() > 0.4
    assert known.all() != near


@pytest.mark.nightly
@pytest.mark.parametrize("name", NAMES)
def test_monte_carlo(name: str) -> None:
    """Of whole models with random numbers, those of frequencies agree within a tenth."""
    found = scatter(described(name), 2000, 5)
    assert found.worst[0].max() < LIMIT
    assert np.isfinite(found.predicted).mean() > 0.9


@pytest.mark.nightly
@pytest.mark.xfail(reason="damping known to 30 % is not normal: up to 16 % off in 300 samples")
@pytest.mark.parametrize("name", NAMES)
def test_monte_carlo_of_damping_ratios(name: str) -> None:
    """Of whole models with random numbers, those of damping ratios agree within a tenth."""
    assert scatter(described(name), 2000, 5).worst[1].max() < LIMIT
