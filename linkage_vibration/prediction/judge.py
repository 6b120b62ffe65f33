# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Judges the inputs of a recorded drive, second by second, by the rules of the running node."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import repeat

from linkage_vibration.prediction.agreement import StandingClock
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.health import (
    Fault,
    Level,
    ReadingExpectation,
    ReadingWatch,
    SpeedWatch,
    turns_without_engine,
)

_SECOND = 10**9  # ns
_STANDS = (
    "The time of receipt stood still while the stamps of readings went on, so that no load is "
    "known; record with a clock that goes, or leave out use_sim_time."
)
_NUMBER = re.compile(r"-?\d[\d.e+-]*")
_EVER = 4e9  # s; longer than any drive, and short enough for ns


@dataclass(frozen=True, slots=True)
class InputFault:
    """A fault of the inputs of a drive."""

    sentence: str
    first: int  # ns, when it was found, by the receipt
    doubts: bool  # whether the values are doubted, and not only their stamps or their number
    times: list[list[int]]  # ns, (n, 2): from when to when it was there


@dataclass(slots=True)
class _Found:
    """A fault, when it was first found, in how many seconds it was there, and when, s."""

    fault: Fault
    first: float
    seconds: int = 0
    times: list[tuple[float, float]] = field(default_factory=list)


class InputJudge:
    """What is wrong with the inputs of a drive; the arguments are those of `ReadingExpectation`."""

    def __init__(
        self,
        name: str,
        alpha3_range: tuple[float, float],
        *,
        offset: float = math.nan,
        stale_after: float = 1.0,
    ) -> None:
        low, high = alpha3_range
        self._expected = ReadingExpectation(
            name, "", False, low, high, offset, stale_after, 0.0, None
        )
        self._readings = ReadingWatch(high - low > math.pi)
        self._standing, self._stands = StandingClock(), False
        self._began: int | None = None  # ns, when the first message arrived
        self._speeds: dict[Source, SpeedWatch] = {}
        self._judged: dict[Source | None, int] = {}  # ns; None: the readings
        self._nothing_due = range(0)  # ns
        self._found: dict[str, _Found] = {}  # by kind
        self._last, self._taken = 0.0, False  # s; whether readings wait for their judgement
        self._end = 0.0  # s; it is before the latest time if the clock went back

    def readings(
        self,
        received: Iterable[int],
        stamps: Iterable[int],
        angles: Iterable[float],
        velocities: Iterable[float],
        known: Iterable[bool],
        senders: Iterable[str] = repeat(""),
    ) -> None:
        """Take readings; see `ReadingWatch.take`."""
        columns = received, stamps, angles, velocities, known, senders
        for arrived, stamp, angle, velocity, in_table, sender in zip(*columns, strict=False):
            now = self._at(arrived)
            if arrived not in self._nothing_due:
                if self._is_due(None, arrived):
                    self._judge_readings(now)
                for source in self._speeds:
                    if self._is_due(source, arrived):
                        self._judge_speed(source, now)
            self._taken, self._end = True, now
            self._stands |= self._standing.stands(arrived, stamp)
            values = stamp, arrived, angle, velocity
            self._readings.take(now, *values, known=in_table, sender=sender)

    def speed(
        self,
        source: Source,
        received: int,
        value: float,
        topic: str,
        sender: str = "",
        age: float = 0.0,
    ) -> None:
        """Take a speed, rpm or m/s, which arrived at a time, ns, when its stamp had an age, s."""
        now, watch = self._at(received), self._speeds.get(source)
        self._end = max(self._end, now)
        if watch is None:
            watch = self._speeds[source] = SpeedWatch(source, topic)
        if self._is_due(source, received):
            self._judge_speed(source, now)
        watch.take(now, value, sender, age)

    def faults(self) -> list[InputFault]:
        """Return one fault of each kind, the most serious first; call this once, at the end."""
        self._judge_readings(self._end)
        for source in self._speeds:
            self._judge_speed(source, self._end)
        found = sorted(self._found.values(), key=lambda each: (-each.fault.level, each.first))
        return [self._described(each) for each in found]

    def _described(self, found: _Found) -> InputFault:
        """Return a fault by times of receipt; its sentence says when it was first so."""
        text, whole = found.fault.sentence.rstrip("."), max(math.ceil(self._last), 1)
        text += f" (first after {found.first:.0f} s, in {found.seconds} of {whole} seconds)."
        began = self._began or 0
        times = [[began + round(1e9 * time) for time in each] for each in found.times]
        doubts = not math.isnan(found.fault.since)
        return InputFault(text, began + round(1e9 * found.first), doubts, times)

    def _at(self, time: int) -> float:
        """Return a time, ns, in s of the drive."""
        self._began = time if self._began is None else self._began
        now = 1e-9 * (time - self._began)
        self._last = max(self._last, now)
        return now

    def _is_due(self, what: Source | None, now: int) -> bool:
        """Return whether a second has passed since an input was judged, or the clock went back."""
        since = now - self._judged.setdefault(what, now)
        if not 0 < since < _SECOND:
            self._judged[what] = now
            if None in self._judged:  # before the first reading, one is always looked at
                times = self._judged.values()
                self._nothing_due = range(max(times), min(times) + _SECOND)
        return not 0 <= since < _SECOND

    def _judge_readings(self, now: float) -> None:
        if self._taken:  # a gap has a sentence of its own
            self._taken = False
            faults = self._readings.judge(now, 1.0, self._expected)
            faults += [Fault(Level.WARN, _STANDS)] * self._stands
            self._note(now, self._readings.last, faults)
            self._stands = False

    def _judge_speed(self, source: Source, now: float) -> None:
        watch, engine = self._speeds[source], self._speeds.get(Source.ENGINE)
        age = self._expected.stale_after
        faults = watch.judge(now, age, None)
        if source is Source.PTO and engine is not None:
            faults += turns_without_engine(watch, engine, now)
        self._note(now, min(now, watch.time + age), faults)  # A speed is used for so long.

    def _note(self, now: float, end: float, faults: Iterable[Fault]) -> None:
        """Add faults that are found now, of values that were used until an end, s."""
        for fault in faults:
            if fault.sentence.endswith(" s ago."):
                continue  # it was noted then
            kind = _NUMBER.sub("", fault.sentence)
            begin = max(now - 1.0, 0.0)
            found = self._found.setdefault(kind, _Found(fault, begin))
            found.seconds += 1
            times = begin if math.isnan(fault.since) else fault.since, end
            times = (-_EVER, _EVER) if math.isinf(fault.since) else times
            first, last = found.times[-1] if found.times else (math.inf, -math.inf)
            if times[0] <= last + 1.0 and first <= times[1] + 1.0:  # In between, it lasted.
                times = min(first, times[0]), max(last, times[1])
                found.times.pop()
            found.times.append(times)
