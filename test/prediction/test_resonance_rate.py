# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Which readings are assessed: the first in each period of the stamps, which are written here."""

import numpy as np
import pytest

from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.resonance import ResonanceMonitor

MS = 10**6  # ns


def monitor(rate: float) -> ResonanceMonitor:
    """Return a monitor with a rate, Hz."""
    return ResonanceMonitor([Excitation("engine 1", Source.ENGINE, 1.0 / 60.0)], rate=rate)


def chosen(rate: float, milliseconds: list[int]) -> list[int]:
    """Return the stamps that are due, ms, which are the same one by one and together."""
    stamps = np.array(milliseconds, np.int64) * MS
    one_by_one, together = monitor(rate), monitor(rate)
    due = [one_by_one.periods.is_due(stamp) for stamp in stamps.tolist()]
    halves = [together.periods.due(part).tolist() for part in np.array_split(stamps, 2)]
    assert halves[0] + halves[1] == due
    return [stamp for stamp, is_due in zip(milliseconds, due, strict=True) if is_due]


@pytest.mark.parametrize(
    ("rate", "milliseconds", "expected"),
    [
        (50.0, [0, 5, 19, 20, 39, 40, 41], [0, 20, 40]),  # periods of 20 ms begin at 0
        (50.0, [7, 27, 47], [7, 27, 47]),  # a slower input has a resonance at each reading
        (50.0, [10, 130, 131], [10, 130]),  # after a gap
        (20.0, [0, 49, 50, 99], [0, 50]),
        (0.0, [0, 1, 1, 2], [0, 1, 1, 2]),  # each
    ],
)
def test_first_reading_of_each_period(
    rate: float, milliseconds: list[int], expected: list[int]
) -> None:
    """The first reading of all, and the first one in each period, are due."""
    assert chosen(rate, milliseconds) == expected


def test_equal_stamps() -> None:
    """Of readings with equal stamps only the first is due, also if stamps are always zero."""
    assert chosen(50.0, [40, 40, 40, 60, 60]) == [40, 60]
    assert chosen(50.0, [0, 0, 0]) == [0]


def test_clock_that_jumps_back() -> None:
    """After a jump to an earlier period a reading is due at once, and then one in each period."""
    assert chosen(50.0, [1000, 1001, 500, 501, 520]) == [1000, 500, 520]
    assert chosen(50.0, [1019, 1001, 1002]) == [1019]  # a jump within a period changes nothing


def test_another_rate_while_running() -> None:
    """A rate that is changed holds from the next reading on."""
    watch = monitor(50.0)
    assert watch.periods.due(np.array([0, MS])).tolist() == [True, False]
    watch.periods.rate = 0.0
    assert watch.periods.due(np.array([2 * MS, 3 * MS])).tolist() == [True, True]
