# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Judges the inputs of a recorded drive, second by second, by the rules of the running node."""

import math
import re
from collections.abc import Iterable
from itertools import repeat

from linkage_vibration.prediction.agreement import StandingClock
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.health import (
    Expected,
    Fault,
    Level,
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


class InputJudge:
    """What is wrong with the inputs of a drive; ``name`` says what is read.

    ``offset`` and ``stale_after`` are as in `Expected`.
    """

    def __init__(
        self,
        name: str,
        alpha3_range: tuple[float, float],
        *,
        offset: float = math.nan,
        stale_after: float = 1.0,
    ) -> None:
        low, high = alpha3_range
        self._expected = Expected(name, "", False, low, high, offset, stale_after, 0.0, None)
        self._readings = ReadingWatch(high - low > math.pi)
        self._standing, self._stands = StandingClock(), False
        self._began: int | None = None  # ns, when the first message arrived
        self._speeds: dict[Source, SpeedWatch] = {}
        self._judged: dict[Source | None, int] = {}  # ns; None: the readings
        # By kind, the first fault with its time, s, and in how many seconds it was so.
        self._found: dict[str, tuple[Fault, float, int]] = {}
        self._last, self._taken = 0.0, False  # s; whether readings wait for their judgement

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
            if self._is_due(None, arrived):
                self._judge_readings(now)
            self._taken = True
            self._stands |= self._standing.stands(arrived, stamp)
            values = stamp, arrived, angle, velocity
            self._readings.take(now, *values, known=in_table, sender=sender)

    def speed(
        self, source: Source, received: int, value: float, topic: str, sender: str = ""
    ) -> None:
        """Take a speed, rpm or m/s, which arrived at a time, ns."""
        now, watch = self._at(received), self._speeds.get(source)
        if watch is None:
            watch = self._speeds[source] = SpeedWatch(source, topic)
        if self._is_due(source, received):
            self._judge_speed(source, now)
        watch.take(now, value, sender)

    def sentences(self) -> list[str]:
        """Return a sentence for each kind of fault, the most serious and then the first one first.

        This judges what came since the last judgement, so it is called once, at the end.
        """
        self._judge_readings(self._last)
        for source in self._speeds:
            self._judge_speed(source, self._last)
        found = sorted(self._found.values(), key=lambda each: (-each[0].level, each[1]))
        words = "{} (first after {:.0f} s, in {} of {} seconds)."
        whole = max(math.ceil(self._last), 1)
        return [words.format(f.sentence.rstrip("."), at, n, whole) for f, at, n in found]

    def _at(self, time: int) -> float:
        """Return a time, ns, in s of the drive."""
        self._began = time if self._began is None else self._began
        now = 1e-9 * (time - self._began)
        self._last = max(self._last, now)
        return now

    def _is_due(self, what: Source | None, now: int) -> bool:
        """Return whether a second has passed since an input was judged, or the clock went back."""
        due = not 0 <= now - self._judged.setdefault(what, now) < _SECOND
        if due:
            self._judged[what] = now
        return due

    def _judge_readings(self, now: float) -> None:
        if self._taken:  # a gap has a sentence of its own
            self._taken = False
            self._note(now, self._readings.judge(now, 1.0, self._expected))
            self._note(now, [Fault(Level.WARN, _STANDS)] * self._stands)
            self._stands = False

    def _judge_speed(self, source: Source, now: float) -> None:
        watches = self._speeds
        self._note(now, watches[source].judge(now, self._expected.stale_after, None))
        if source is Source.PTO and Source.ENGINE in watches:
            self._note(now, turns_without_engine(watches[source], watches[Source.ENGINE], now))

    def _note(self, now: float, faults: Iterable[Fault]) -> None:
        for fault in faults:
            if fault.sentence.endswith(" s ago."):
                continue  # it was noted then
            kind = _NUMBER.sub("", fault.sentence)
            first, at, seconds = self._found.get(kind, (fault, max(now - 1.0, 0.0), 0))
            self._found[kind] = first, at, seconds + 1
