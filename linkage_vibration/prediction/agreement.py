# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds out whether the values of an input go to and fro, as those of publishers that disagree.

A crank angle that jumps faster than a hitch can is doubted as well, and the reading after it.
Nothing here has a clock. The node and a replay ask it alike, so that both know the same speeds.
"""

import math

from linkage_vibration.prediction.inputs.presets import ENGINE, GROUND, HITCH, PTO
from linkage_vibration.prediction.motion import wrapped_turn

AGREEMENT = {HITCH: (0.03, "rad"), ENGINE: (50.0, "rpm"), PTO: (20.0, "rpm"), GROUND: (0.3, "m/s")}
"""Differences between publishers up to these are noise."""
DIFFERING = 3  # values that go to and fro, each within a second of the one before, are no glitch
FASTEST, LEAST_JUMP = 4.0, 0.06  # rad/s and rad; a hitch is slower, and noise is smaller
_LASTING = 1_000_000_000  # ns


class Agreement:
    """Whether the values of an input agree; those of a crank that turns all the way always do.

    A value goes to and fro if it differs from the last one by more than from the one before, and by
    more than noise.
    """

    def __init__(self, name: str, turns: bool = False) -> None:
        self._noise, self._wraps = math.inf if turns else AGREEMENT[name][0], name == HITCH
        self._fastest = FASTEST if self._wraps and not turns else math.inf
        self._last = self._before = math.nan
        self._differed, self._count = 0, 0  # when a value last did so, ns, and how many did so
        self._time, self._jumped = 0, False  # of the last value, ns; whether it jumped

    def take(self, time: int, value: float) -> bool:
        """Take a value at a time, ns; return whether it goes to and fro."""
        if not math.isfinite(value):
            return False
        step, back = self._apart(value, self._last), self._apart(value, self._before)
        apart, self._time = time - self._time, time
        jumps = step > LEAST_JUMP + self._fastest * max(1e-9 * apart, 1e-9)
        self._jumped = jumps and 0 <= apart <= _LASTING
        self._before, self._last = self._last, value
        if not step > self._noise + back:
            return False
        self._count = self._count + 1 if 0 <= time - self._differed <= _LASTING else 1
        self._differed = time
        return True

    def is_lost(self, time: int) -> bool:
        """Return whether the value is not known at a time, ns."""
        lasts = 0 <= time - self._differed <= _LASTING
        return self._jumped or (self._count >= DIFFERING and lasts)

    def loses(self, time: int, value: float) -> bool:
        """Take a value at a time, ns; return whether it is not known."""
        self.take(time, value)
        return self.is_lost(time)

    def _apart(self, value: float, other: float) -> float:
        return abs(value - other + (wrapped_turn(value, other) if self._wraps else 0.0))


def crank_agreement(alpha3_range: tuple[float, float]) -> Agreement:
    """Return that of the crank angle of a table with a range, rad."""
    return Agreement(HITCH, turns=alpha3_range[1] - alpha3_range[0] > math.pi)
