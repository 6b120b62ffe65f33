# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Models of an ensemble are the same with any arithmetic."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.interpolation import interpolation_matrix, stroke_variable
from linkage_vibration.table.tabulation import build_table
from linkage_vibration.table.tabulation.ensemble import _nodes, first_widest


@pytest.mark.parametrize(("wider", "first"), [(9e-7, 1), (1.1e-6, 3)])
def test_the_last_bit_does_not_choose_where_modes_are_followed_from(
    wider: float, first: int
) -> None:
    """Gaps within a millionth of the widest are the same, and the first one is chosen."""
    assert first_widest(np.array([0.1, 0.4, 0.2, 0.4 * (1.0 + wider), 0.4])) == first
    assert first_widest(np.array([0.0, 0.0])) == 0
    assert first_widest(np.array([0.1, math.inf, math.inf])) == 1  # with a single mode


def test_nodes_are_those_of_chebyshev() -> None:
    """They are (1 - cos x) / 2 of the stroke at even x, and both ends to the last bit."""
    table = SimpleNamespace(alpha3_range=(1.1, 2.9), toggles=None)
    expected = [1.1, 2.0 - 0.9 * math.sqrt(0.5), 2.0, 2.0 + 0.9 * math.sqrt(0.5), 2.9]
    actual = _nodes(table, 5)
    np.testing.assert_allclose(actual, expected, rtol=1e-14)
    assert (actual[0], actual[-1]) == (1.1, 2.9)


@pytest.mark.nightly(alone="test_deviations.py compares deviations with whole models")
def test_members_that_mix_the_modes_of_the_mechanism() -> None:
    """Between angles at which members are solved, nine of ten FRFs across are those of models.

    In half of the members of this starter, links bend in other modes than in the mechanism itself.
    """
    mechanism = read_mechanism(config_file("starters/category_1.yaml"))
    assert mechanism.uncertainty is not None
    own = LinkageModel(mechanism)
    half = build_table(own, 1e-2).halves[1]
    angles = half.ensemble_alpha3
    alpha3, e1 = float(angles[3:5].mean()), half.member_outputs.index(("E1", "y"))
    nodes, at = (stroke_variable(x, half.toggles) for x in (angles, np.array([alpha3])))
    [weights] = interpolation_matrix(nodes, at)
    s = 2j * np.pi * np.array([[1.2], [4.5], [30.0], [150.0], [170.0]])
    errors = []
    for member, values in enumerate(mechanism.uncertainty.draw(half.ensemble_coordinates[:16]), 1):
        drawn = mechanism.uncertainty.described(values.tolist())
        model = LinkageModel(drawn, kinematics=own.kinematics.nearby(drawn)).halves[1]
        exact = model.solve(alpha3).frf(["E1.y"], ["E1.y"]).frf(s[:, 0].imag / (2.0 * np.pi))
        poles = np.exp(weights @ np.log(half.ensemble_poles[member]))
        squares = (weights @ half.ensemble_shapes[member][:, e1]) ** 2
        near = squares / (s - poles) + squares.conj() / (s - poles.conj())
        found = near.sum(axis=1) + weights @ half.ensemble_far[member][:, e1, e1]
        errors.append(np.abs(found / exact.ravel() - 1.0))
    assert np.quantile(errors, 0.9) < 0.05
