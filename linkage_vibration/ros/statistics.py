# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the node counts for its diagnostics."""

from collections import Counter, deque
from dataclasses import dataclass, field

LATENCIES = 1_000  # the percentiles are those of this many latest latencies
CLOCK_STEP = 0.5  # s; the wall clock was set if it differs by more from the steady clock


@dataclass(frozen=True, slots=True)
class Second:
    """Events since the last status."""

    rate: float  # Hz, predictions
    without_numbers: float  # share of the predictions, 0 to 1
    clock_jumps: int
    qos_mismatches: int


@dataclass
class Statistics:
    """What the node counts; the memory is bounded however long it runs."""

    received: int = 0  # messages
    predicted: int = 0  # predictions that were published, and of these:
    without_numbers: int = 0
    clock_jumps: int = 0  # how often the clock was set, or a looping bag jumped back
    qos_mismatches: Counter[str] = field(default_factory=Counter)  # by topic
    latencies: "deque[float]" = field(default_factory=lambda: deque(maxlen=LATENCIES))  # s
    _before: tuple[float, int, int, int, int] | None = None  # time and counts at the last status
    _wall: float | None = None

    def watch_wall_clock(self, wall: float, steady: float) -> None:
        """Count a jump if the wall clock was set since the last call; both times are in s."""
        ahead = wall - steady
        if self._wall is not None and abs(ahead - self._wall) > CLOCK_STEP:
            self.clock_jumps += 1
        self._wall = ahead

    def since_last_time(self, now: float) -> Second:
        """Return what happened since the last call; ``now`` is by the steady clock, s."""
        mismatches = sum(self.qos_mismatches.values())
        counts = self.predicted, self.without_numbers, self.clock_jumps, mismatches
        then, *before = self._before or (now - 1.0, *counts)
        self._before = (now, *counts)
        predicted, refused, jumps, mismatched = (
            count - earlier for count, earlier in zip(counts, before, strict=True)
        )
        rate = predicted / max(now - then, 1e-9)
        return Second(rate, refused / predicted if predicted else 0.0, jumps, mismatched)
