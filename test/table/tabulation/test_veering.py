# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes that veer or cross: followed at any step, resolved to the tolerance, or refused."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.table.table import TableError
from linkage_vibration.table.tabulation import build_table
from linkage_vibration.table.tabulation.tracking import crossing_gaps, mix_closely
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


def test_gap_that_no_step_resolves_is_refused() -> None:
    """A mode that would need ever shorter steps is reported with the angle and the fix."""
    with pytest.raises(TableError, match=r"at alpha3 = 46\.62\d* deg; give a larger tolerance"):
        build_table(LinkageModel(crossing_crank(1e-9, AT)), 1e-11)


@pytest.mark.parametrize("at", [0.0, 1e-17, 0.3137])
def test_a_crossing_on_a_place_of_the_grid_is_found(at: float) -> None:
    """The grid has 0 exactly, where the difference of both modes is exactly 0."""
    points = [-1.0, 0.0, 1.0]
    rising = np.array(points) - at
    tracked: Any = SimpleNamespace(
        variables=np.array(points),
        log_frequencies=np.column_stack([rising, -rising]),
        at=lambda wanted: np.ones(3, bool),
    )
    sampler: Any = SimpleNamespace(
        at=lambda x: SimpleNamespace(frequencies=np.exp([x - at - 0.1, at - x + 0.1]))
    )
    [(x, gap)] = crossing_gaps(sampler, points, tracked).items()
    assert x == pytest.approx(at, abs=1e-9)
    assert gap == pytest.approx(0.1, abs=1e-9)


def test_modes_that_coincide_do_not_cross() -> None:
    """Two equal modes, whose polynomials differ by rounding alone, are solved nowhere."""
    points, random = np.linspace(-1.0, 1.0, 9), np.random.default_rng(0)
    logarithms = math.log(20.0) + 0.3 * np.repeat(points[:, np.newaxis] ** 2, 2, axis=1)
    logarithms += 1e-15 * random.uniform(-1.0, 1.0, logarithms.shape)
    tracked: Any = SimpleNamespace(
        variables=points, log_frequencies=logarithms, at=lambda wanted: np.ones(9, bool)
    )
    assert crossing_gaps(SimpleNamespace(), points.tolist(), tracked) == {}  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("mac", "apart", "mix"),
    [(0.899, 0.995e-4, True), (0.901, 0.995e-4, False), (0.899, 1.005e-4, False)],
)
def test_modes_that_mix_closely(mac: float, apart: float, mix: bool) -> None:
    """Shapes that agree less than 0.9, of modes closer than a hundred tolerances, veer."""
    macs = np.ones((4, 3))
    macs[2, 1] = mac
    logarithms = np.array([[3.0, 4.0, 5.0]] * 5)
    for at in (2, 3):  # at either end of the step in which the shapes mix
        near = logarithms.copy()
        near[at, 2] = 4.0 + apart
        tracked: Any = SimpleNamespace(mac=macs, log_frequencies=near)
        assert mix_closely(tracked, 1e-6) == mix
    elsewhere: Any = SimpleNamespace(mac=macs, log_frequencies=np.vstack([near[3:4], logarithms]))
    assert not mix_closely(elsewhere, 1e-6)
