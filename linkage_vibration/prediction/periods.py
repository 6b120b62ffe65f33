# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Which messages an output at a limited rate has, decided by their times, live and offline."""

import enum

import numpy as np
from numpy.typing import NDArray

PARTS = 5  # In so many parts of a window a reading is assessed, which is the first in its part
_NEVER = -(2**63)  # ns
_SECOND = 10**9  # ns


def second(stamp: int) -> int:
    """Return the beginning of the second of a stamp, ns, which is the stamp of a measurement."""
    return stamp // _SECOND * _SECOND


class Stamps:
    """Finds the time of each reading: its stamp, or its receipt if the stamps do not move.

    Stamps of 0 do not move, nor does one that is that of the reading before. The stamps count again
    as soon as two in turn have moved. The same readings have the same times, one by one or many.
    """

    def __init__(self) -> None:
        self._stamp, self._moved = _NEVER, True

    def time(self, stamp: int, receipt: int) -> tuple[int, bool]:
        """Return the time of a reading, ns, from its stamp and its receipt; whether it is that."""
        moved_before, self._moved = self._moved, stamp not in (0, self._stamp)
        self._stamp = stamp
        return (stamp, False) if moved_before and self._moved else (receipt, True)

    def times(
        self, stamps: NDArray[np.int64], receipts: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the times of readings, (n,), and at which of them they are those of receipt."""
        before = np.append(np.int64(self._stamp), stamps[:-1])
        moved = (stamps != before) & (stamps != 0)
        received = ~(moved & np.append(self._moved, moved[:-1]))
        if len(stamps):
            self._stamp, self._moved = int(stamps[-1]), bool(moved[-1])
        return np.where(received, receipts, stamps), received


class Periods:
    """Chooses the first message in each period of ``rate``, Hz; with 0, each message."""

    def __init__(self, rate: float = 0.0) -> None:
        self.rate = rate
        self._last = _NEVER

    def is_due(self, time: int) -> bool:
        """Return whether the next message is due, from its time, ns."""
        if not self.rate:
            return True
        before, self._last = self._last, time // round(1e9 / self.rate)
        return self._last != before

    def due(self, times: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which messages are due, (n,), from their times, ns, in the order of arrival."""
        if not self.rate:
            return np.ones(len(times), np.bool_)
        periods = np.concatenate([[self._last], times // round(1e9 / self.rate)])
        self._last = int(periods[-1])
        return np.asarray(periods[1:] != periods[:-1])


class WindowStep(enum.IntEnum):
    """What a reading does to the window of readings of which the most severe is published."""

    LEFT_OUT = 0  # another one has been assessed in this part
    WAITS = 1
    CLOSES = 2
    ALONE = 3  # It closes, and those that wait were much earlier, or later by a clock since set.


class Windows:
    """Assigns readings to windows, by their times alone.

    A window ends with the first reading in each period of ``rate``, Hz, and that reading belongs to
    it: so a reading that comes a period after the one before does not wait. With 0, none waits.
    """

    def __init__(self, rate: float = 0.0) -> None:
        self.rate = rate
        self._part = self._time = _NEVER

    def step(self, time: int) -> WindowStep:
        """Return what the next reading does, from its time, ns."""
        if not self.rate:
            return WindowStep.CLOSES
        length = round(1e9 / (PARTS * self.rate))
        before, self._part = self._part, time // length
        if self._part == before:
            return WindowStep.LEFT_OUT
        apart, self._time = time - self._time, time
        if self._part // PARTS == before // PARTS:
            return WindowStep.WAITS
        return WindowStep.CLOSES if 0 <= apart <= PARTS * length else WindowStep.ALONE
