# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the node counts for its diagnostics."""

import math
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field

LATENCIES = 1_000  # the percentiles are those of this many latest latencies
CLOCK_LEAP = 10.0  # s; a simulated clock was set if it goes forward by more
CLOCK_STEP = 0.5  # s; the wall clock was set if it differs by more from the steady clock
_PUBLISHERS = 16  # on one topic, of which the last numbers are kept
RECENT = 10  # statuses, one a second, after which losses, waits and jumps have ended

_Status = tuple[float, int, int, Counter[str], Counter[str]]


@dataclass(frozen=True, slots=True)
class Second:
    """The predictions since the last status, and events since the last `RECENT` statuses."""

    rate: float  # Hz, predictions
    without_numbers: float  # share of the predictions, 0 to 1
    wait: float = 0.0  # s, the longest
    clock_jumps: int = 0
    dropped: int = 0  # messages that were left out
    arrived: Counter[str] = field(default_factory=Counter)  # messages, by topics of inputs
    lost: Counter[str] = field(default_factory=Counter)


@dataclass
class Statistics:
    """What the node counts; the memory is bounded however long it runs."""

    received: int = 0  # messages of the hitch
    with_numbers: int = 0  # predictions for readings, and those without numbers
    without_numbers: int = 0
    arrived: Counter[str] = field(default_factory=Counter)  # messages, by topics of inputs
    lost: Counter[str] = field(default_factory=Counter)  # likewise, by their sequence numbers
    dropped: Counter[str] = field(default_factory=Counter)  # by topic, left out for newer ones
    wait: float = 0.0  # s, the longest of a message since the last status
    clock_jumps: int = 0  # how often the clock was set, or a looping bag jumped back
    latencies: "deque[float]" = field(default_factory=lambda: deque(maxlen=LATENCIES))  # s
    _with_numbers = _without_numbers = 0  # at the last status
    _then: float = math.nan  # s, its time
    # Of the last statuses, the longest wait before, and the counts.
    _before: "deque[_Status]" = field(default_factory=lambda: deque(maxlen=RECENT + 1))
    _wall: float | None = None

    @property
    def predicted(self) -> int:
        """How many readings were predicted for, also where `prediction_rate` publishes fewer."""
        return self.with_numbers + self.without_numbers

    def watch_wall_clock(self, wall: float, steady: float) -> None:
        """Count a jump if the wall clock was set since the last call; both times are in s."""
        ahead = wall - steady
        if self._wall is not None and abs(ahead - self._wall) > CLOCK_STEP:
            self.clock_jumps += 1
        self._wall = ahead

    def since_last_time(self, now: float) -> Second:
        """Return what happened since the last call; ``now`` is by the steady clock, s."""
        without = self.without_numbers - self._without_numbers
        done = self.with_numbers - self._with_numbers + without
        rate = 0.0 if math.isnan(self._then) else done / max(now - self._then, 1e-9)
        self._with_numbers, self._without_numbers = self.with_numbers, self.without_numbers
        counts = self.clock_jumps, self.dropped.total(), self.arrived.copy(), self.lost.copy()
        self._before.append((self.wait, *counts))
        self.wait, self._then = 0.0, now
        _, jumps, dropped, arrived, lost = self._before[0]
        events = counts[0] - jumps, counts[1] - dropped, counts[2] - arrived, counts[3] - lost
        share, wait = without / (done or 1), max(status[0] for status in self._before)
        return Second(rate, share, wait, *events)


class SequenceGaps:
    """Finds the messages that are missing between the sequence numbers of publishers of a topic.

    rclpy does not say which publisher sent a message. So a number belongs to the publisher whose
    last one is the next below it, unless it is the first of a publisher that has sent nothing yet.
    """

    def __init__(self) -> None:
        self._numbers: deque[int] = deque(maxlen=_PUBLISHERS)  # the last one of each publisher

    def before(self, number: int, publishers: Callable[[], int]) -> int:
        """Return how many messages are missing before this one; only then ask for publishers."""
        last = max((each for each in self._numbers if each < number), default=number)
        missing = max(number - last - 1, 0)
        if last == number or (missing and len(self._numbers) < publishers()):
            missing = 0
        else:
            self._numbers.remove(last)
        self._numbers.append(number)
        return missing
