# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds out whether the values of an input go to and fro, as those of publishers that disagree.

A crank angle that jumps faster than a hitch can is doubted as well, and the reading after it.
Nothing here has a clock. The node and a replay ask it alike, so that both know the same speeds.
"""

import math

from linkage_vibration.prediction.inputs.presets import ENGINE, GROUND, HITCH, PTO
from linkage_vibration.prediction.motion import wrapped_turn

AGREEMENT = {
    HITCH: (0.03, 0.5, "rad"),
    ENGINE: (50.0, 500.0, "rpm"),
    PTO: (20.0, 150.0, "rpm"),
    GROUND: (0.3, 1.0, "m/s"),
}
"""Differences up to the first number are noise; to and fro, a value changes by less than the second
number per second: a hitch that is adjusted, or an engine whose governor hunts."""
DIFFERING = (
    5  # changes of side, each within a second of the one before; an engine that starts has four
)
# A step of a motion takes so many changes back: two steps up and two down count nothing, but three
# publishers in turn, two steps up and one down, do.
_OF_A_MOTION = 1.5
FASTEST, LEAST_JUMP = 4.0, 0.06  # rad/s and rad; a hitch is slower, and noise is smaller
_LASTING = 1_000_000_000  # ns


class Agreement:
    """Whether the values of an input agree; those of a crank that turns all the way always do.

    A value changes sides by a step that is larger than noise and motion, if the last such step was
    in the other direction; a step in the same direction is one of a motion.
    """

    def __init__(self, name: str, turns: bool = False) -> None:
        self._noise, self._rate, _ = AGREEMENT[name]
        self._noise, self._wraps = math.inf if turns else self._noise, name == HITCH
        self._fastest = FASTEST if self._wraps and not turns else math.inf
        self._last, self._step = math.nan, 0.0  # the last value, and the last large step
        self._changed, self._count = 0, 0.0  # when it last changed sides, ns, and how often
        self._time, self._jumped = 0, False  # the latest of the last second; whether it jumped

    def take(self, time: int, value: float) -> bool:
        """Take a value at a time, ns; return whether it goes to and fro."""
        if not math.isfinite(value):
            return False
        step, seconds = value - self._last, 1e-9 * (time - self._time)
        if self._wraps:
            step += wrapped_turn(value, self._last)
        # The times of two publishers may be those of two clocks, which differ by less than this.
        self._time = max(time, self._time) if time > self._time - _LASTING else time
        jumps = abs(step) > LEAST_JUMP + self._fastest * max(seconds, 1e-9)
        self._jumped, self._last = jumps and 0.0 <= seconds <= 1e-9 * _LASTING, value
        if not abs(step) > self._noise + self._rate * max(seconds, 0.0):
            return False
        changes, self._step = step * self._step < 0.0, step
        if not changes:
            self._count = max(self._count - _OF_A_MOTION, 0.0)
            return False
        self._count = self._count + 1.0 if abs(time - self._changed) <= _LASTING else 1.0
        self._changed = time
        return self._count >= DIFFERING

    def is_lost(self, time: int) -> bool:
        """Return whether the value is not known at a time, ns."""
        lasts = abs(time - self._changed) <= _LASTING
        return self._jumped or (self._count >= DIFFERING and lasts)

    def loses(self, time: int, value: float) -> bool:
        """Take a value at a time, ns; return whether it is not known."""
        self.take(time, value)
        return self.is_lost(time)


class StandingClock:
    """Whether the time of receipt stands still while stamps go on, so that no load is known."""

    def __init__(self) -> None:
        self._receipt, self._stamp = -1, 0  # ns, of the first reading since the clock stands

    def stands(self, receipt: int, stamp: int) -> bool:
        """Return whether the clock stands at a reading, from its receipt and its stamp, ns."""
        if receipt != self._receipt:
            self._receipt, self._stamp = receipt, stamp
        return stamp - self._stamp > _LASTING


def crank_agreement(alpha3_range: tuple[float, float]) -> Agreement:
    """Return that of the crank angle of a table with a range, rad."""
    return Agreement(HITCH, turns=alpha3_range[1] - alpha3_range[0] > math.pi)
