# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Tables at the exact angles at which two damped poles meet, and ever nearer to them."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.table.pole_cells import nearest, nearest_rows
from linkage_vibration.table.tabulation import build_table
from test.support.crossing import (
    AT,
    GAP,
    RATIO,
    crossing_crank,
    meeting_off_axis,
    meeting_on_axis,
    poles_at,
)

Meeting = Callable[[], tuple[float, float]]

ROUNDING = 1e-7  # of a pole: where two meet, the square root of that of the model
DISTANCES = np.radians([0.0, 1e-11, 1e-9, 1e-7, 1e-5, 1e-3, 0.1, 0.5])


def test_table_at_the_meeting() -> None:
    """Up to the meeting itself, both modes are met within the reported error and rounding."""
    dashpot, alpha3 = meeting_off_axis()
    mechanism = crossing_crank(GAP, AT, RATIO, dashpot)
    stroke = (alpha3 - 0.01, alpha3 + 0.01)
    mechanism = replace(mechanism, stroke=stroke, assembly_alpha3=stroke[0])
    table = build_table(LinkageModel(mechanism), 1e-4)
    limit = 2.0 * table.interpolation_error.max() + ROUNDING
    for angle in np.concatenate([alpha3 - DISTANCES[1:], alpha3 + DISTANCES]).tolist():
        exact = poles_at(dashpot, angle)
        frequencies, ratios = table.evaluate(np.array([angle]))[0, :4].reshape(2, 2)
        poles = 2.0 * math.pi * frequencies * np.exp(1j * np.arccos(-ratios))
        apart = min(np.abs(poles - other).max() for other in (exact, exact[::-1]))
        assert apart <= limit * np.abs(exact).min()


def test_rows_of_nearest_poles() -> None:
    """Poles cross in the first row; in the second, both are nearest to the same, and 17 < 25."""
    here = np.array([[0.0, 1.0], [0.0, 1.0]]) + 0j
    there = np.array([[1.1, 0.1], [0.9, 5.0]]) + 0j
    assert nearest_rows(here, there).tolist() == [[1, 0], [0, 1]]
    assert nearest_rows(here[:, :0], there[:, :0]).shape == (2, 0)


@pytest.mark.parametrize("meeting", [meeting_off_axis, meeting_on_axis])
def test_only_sum_and_product_are_smooth(meeting: Meeting) -> None:
    """Poles part with the square root of the distance, so the case is the one that is meant."""
    dashpot, alpha3 = meeting()
    gaps = []
    for distance in (1e-6, 1e-4):
        poles = poles_at(dashpot, alpha3 - distance)
        first = min(poles, key=lambda pole: abs(pole.imag))
        other = (
            first.conj() if meeting is meeting_on_axis else max(poles, key=lambda p: abs(p.imag))
        )
        gaps.append(abs(first - other))
    assert gaps[1] / gaps[0] == pytest.approx(10.0, rel=1e-2)


@pytest.mark.parametrize("rounding", [-1e-13, 0.0, 1e-13])
def test_poles_that_move_far_keep_their_order(rounding: float) -> None:
    """Sums of distances are equal in either order: 10 to 20 and 11 to 21, or 10 to 21, 11 to 20."""
    low, high = [10j, (11.0 + rounding) * 1j], [20j, (21.0 - rounding) * 1j]
    for before, after in ((low, high), (low, high[::-1]), (low[::-1], high), (high, low)):
        pairs = nearest(np.array(before), np.array(after))
        assert [pairs[i] for i in np.argsort(np.abs(before))] == np.argsort(np.abs(after)).tolist()
