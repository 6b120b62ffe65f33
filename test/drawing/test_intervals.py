# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Gaps are found where they are, also at the ends of a log."""

import numpy as np

from linkage_vibration.drawing.intervals import gap_starts, pass_starts


def test_gaps_are_long_steps() -> None:
    """A gap is longer than ten median steps, and longer than 0.1 s in any case."""
    times = np.array([0.0, 0.01, 0.02, 0.11, 0.25, 0.26, 0.27])
    assert gap_starts(times).tolist() == [3]
    assert gap_starts(10.0 * times).tolist() == [3]
    assert gap_starts(times[:1]).tolist() == []


def test_samples_that_share_a_stamp() -> None:
    """Ten samples at each time, 0.2 s apart, have no gap; a step of more than 2 s is one."""
    times = np.repeat(0.2 * np.arange(150), 10)
    assert gap_starts(times).tolist() == []
    assert gap_starts(np.append(times, times[-1] + 1.9)).tolist() == []
    assert gap_starts(np.append(times, times[-1] + 2.1)).tolist() == [1499]
    assert gap_starts(np.zeros(10)).tolist() == []


def test_steps_back_that_are_jumps_of_the_clock() -> None:
    """At 100 Hz a clock jumps back by more than 0.1 s, for more than one reading; at 1 Hz by 10 s.

    A clock that chrony or ntpd disciplines is set in one step only from 0.1 s on.
    """

    def jumps(step: float, back: float, late: int = 20) -> list[int]:
        times = step * np.arange(60)
        times[30 : 30 + late] -= back + step
        return pass_starts(np.rint(1e9 * times).astype(np.int64)).tolist()

    assert jumps(0.01, 0.11) == [30]
    assert jumps(0.01, 0.09) == []
    assert jumps(0.01, 0.11, late=1) == []
    assert jumps(1.0, 10.5) == [30]
    assert jumps(1.0, 9.5) == []
