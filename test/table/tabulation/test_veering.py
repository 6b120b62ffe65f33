# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes that veer or cross: followed at any step, and resolved to the tolerance."""

import numpy as np
import pytest
from numpy.typing import NDArray

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.table.table import TableError
from linkage_vibration.table.tabulation import build_table
from test.support.crossing import STROKE, crossing_crank, exact_frequencies

AT = 0.8137  # rad, where the crank's modes meet: on no even grid


def angles() -> NDArray[np.float64]:
    """Return angles all over the stroke, and ever denser towards the meeting."""
    near = AT + np.outer([-1.0, 1.0], np.logspace(-9, -2, 70)).ravel()
    return np.sort(np.concatenate([np.linspace(*STROKE, 300), near, [AT]]))


@pytest.mark.parametrize(
    ("gap", "tolerance"),
    [(0.0, 1e-6), (1e-6, 1e-6), (1e-6, 1e-9), (1e-3, 1e-6), (0.1, 1e-6), (1.0, 1e-6)],
)
def test_every_gap_is_met_to_the_tolerance(gap: float, tolerance: float) -> None:
    """From a crossing to a wide veering both frequencies meet the tolerance and their error."""
    table = build_table(LinkageModel(crossing_crank(gap, AT)), tolerance)
    ordered = np.sort(table.evaluate(angles())[:, :2], axis=1)
    error = np.abs(ordered / exact_frequencies(gap, AT, angles()) - 1.0).max()
    assert error <= tolerance
    assert error <= 3.0 * table.interpolation_error.max() + 1e-12


def test_shape_follows_its_own_mode_across() -> None:
    """At a crossing each tracked frequency goes on smoothly; at a veering both turn away."""
    crossing = build_table(LinkageModel(crossing_crank(0.0, AT)))
    first, second = crossing.natural_frequencies[:, :2].T
    assert first[0] < second[0]
    assert first[-1] > second[-1]
    tuned = second if np.ptp(second) < np.ptp(first) else first
    assert np.ptp(tuned) < 1e-6 * tuned[0]
    veering = build_table(LinkageModel(crossing_crank(1.0, AT)))
    assert (veering.natural_frequencies[:, 0] < veering.natural_frequencies[:, 1]).all()


def test_tolerance_below_rounding_is_refused() -> None:
    """However narrow a gap is, it needs no short steps; only rounding limits the tolerance."""
    model, solutions = LinkageModel(crossing_crank(1e-9, AT)), list[float]()
    assert build_table(model, 1e-9, progress=solutions.append).interpolation_error.max() <= 1e-9
    assert len(solutions) < 30
    words = r"Rounding changes .* 1e-11; give a tolerance of at least \S+ \(by `.* --tolerance`\)"
    with pytest.raises(TableError, match=words):
        build_table(model, 1e-11)
