# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The errors that decide whether a piece of a table is refined, in closed form."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from linkage_vibration.table.tabulation import piece_refinement
from linkage_vibration.table.tabulation.subspaces import check_lines

BAND = 0.0, 100.0  # Hz


def maxima(hertz: list[float], sizes: list[float]) -> Any:
    """Return a stand-in for the modes at one angle, with these maxima."""
    highest = int(np.argmax(sizes))
    rows, omega = np.zeros(len(hertz), int), 2.0 * math.pi * np.array(hertz)
    return SimpleNamespace(
        highest=lambda band: np.array([[hertz[highest], sizes[highest]]]),
        maxima=lambda band: (rows, omega, np.array(sizes)),
    )


@pytest.mark.parametrize(
    ("hertz", "sizes", "expected"),
    [
        ([10.0], [1.02], 0.02 / 1.02),  # a height
        ([10.5], [1.0], 0.5 / 10.5),  # a frequency
        ([20.0, 10.0], [1.01, 1.0], 0.01 / 1.01),  # a rival within the error of the height
        ([20.0, 10.0], [1.01, 0.98], 0.5),  # and one that is too low
    ],
)
def test_errors_of_the_highest_peak(
    hertz: list[float], sizes: list[float], expected: float
) -> None:
    """A peak of 1 at 10 Hz is compared in height and frequency with the nearest of the highest."""
    fine = maxima(hertz, sizes)
    highest = fine.highest(BAND)
    actual = piece_refinement._peak_error(maxima([10.0], [1.0]), highest, lambda rows: fine, BAND)
    assert actual == pytest.approx(expected)


@pytest.mark.parametrize(("lines", "share"), [(slice(None), 1.0), (slice(-1, None), 1.0 / 200.0)])
def test_errors_by_far_poles(monkeypatch: pytest.MonkeyPatch, lines: slice, share: float) -> None:
    """An even error counts over the whole band, and one at its end over 1/200 of it."""
    monkeypatch.setattr(piece_refinement, "_near_lines", lambda *_: 0.0j)
    n = len(check_lines(BAND, free=False))
    totals = np.zeros((n, 1), complex)
    totals[lines] = 1e-3
    models = SimpleNamespace(
        free=False,
        shapes=np.ones((2, 1, 1)),
        n_inputs=1,
        weights=np.zeros((2, 1, 1)),
        far=SimpleNamespace(sums=lambda *_: np.zeros((2, n, 1))),
    )
    piece: Any = SimpleNamespace(models=models, variables=np.array([0.0, 1.0]), toggles=None)
    samples: Any = [SimpleNamespace(totals=totals)] * 2
    norms = piece_refinement._far_norms(samples, piece, BAND, np.array([0.0, 0.4]))
    assert norms.max(axis=1) == pytest.approx(1e-3 * math.sqrt(share * 100.0), rel=0.01)


@pytest.mark.parametrize("rival", [[1], []])
def test_a_pole_that_almost_belongs_to_a_set_joins_it(
    monkeypatch: pytest.MonkeyPatch, rival: list[int]
) -> None:
    """A set that is clear only with its rival takes it up; without one, the piece is halved."""
    sample: Any = SimpleNamespace(subspace=lambda chosen: chosen)
    sampler: Any = SimpleNamespace(response=None, measured=False, at=lambda x: sample)
    monkeypatch.setattr(piece_refinement, "_needed", lambda *_: frozenset({0}))
    monkeypatch.setattr(
        piece_refinement,
        "continue_set",
        lambda here, there, n: (frozenset(range(n)), n == 2, frozenset(rival)),
    )
    sets = piece_refinement._follow(sampler, [0.0, 1.0, 2.0])
    assert (sets is None) == (not rival)
    assert all(each == {0, 1} for each in (sets or {}).values())
