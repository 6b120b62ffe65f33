# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Estimates the rate of a quantity from its readings, with a bound of the error.

Two means of readings give the mean rate between them. The rate now differs from it by at most the
errors of both means over the time between them, plus the largest second derivative of the quantity
(its bend) times the time since their middle. So each pair of means gives an interval for the rate:
near pairs suffer from the errors of the readings, far ones from the bend. The estimate is the
middle of the intersection of the intervals of all recent pairs, and the bound of its error is half
the width of the narrowest. If they hardly intersect, the quantity bends more than assumed, and
twice the bend is tried, and so on.

Readings within `POOL` form one mean, so that noise at a high rate averages out. The error of a mean
is half a step of the sensor's resolution, which does not average out, and noise. The resolution is
given, or it is the smallest change between readings so far, or less while a motion is smoother than
such steps. The noise is the part of the third differences of means that the steps do not explain.

Nothing here has a clock. The same readings give the same estimates to the last bit, one by one
(`RateFilter.add`) or many (`RateFilter.add_many`).
"""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import repeat
from typing import NamedTuple

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.excitation import Source

POOL = 40_000_000  # ns; readings within it are averaged
GAP = 500_000_000  # ns; readings that are farther apart do not belong to one motion

_LAGS = 8  # each of the newest two means is compared with so many before
_BENDS = 1.0, 2.0, 4.0, 8.0, 16.0  # multiples of the assumed bend that are tried
_EXPLAINED = 0.5  # the usual third difference by steps is this share of the largest one
_SPREAD = 2.0  # half-width of the noise over its largest recent residual
_AGREEMENT = 0.65  # least width of an intersection over that of the narrowest interval
_FEW = 4.0  # the noise is taken as larger by this number over the number of residuals
_DECAY = 0.98  # the largest residual counts less by this factor with each new mean
_RESIDUALS = 6  # so many are needed to know the noise, or that a motion is smooth

_CRANK = 1.0, 0.01  # rad/s^2, such as of a lift of 90 deg in 3 s, and rad
_HALF_TURN = math.pi + 1e-6  # rad, also in single precision
_SPEEDS = {Source.ENGINE: (250.0, 1.0), Source.PTO: (250.0, 1.0), Source.GROUND: (2.0, 0.1)}
"""Usual bend, rpm/s^2 or m/s^3, and coarsest resolution, rpm or m/s."""


class Rate(NamedTuple):
    """A rate, and a bound of its error; both are NaN if the rate is not known."""

    value: float
    error: float


UNKNOWN = Rate(math.nan, math.nan)
Estimate = Callable[[], Rate]
unknown_rate: Estimate = partial(Rate, *UNKNOWN)
_Mean = tuple[float, float, float, float]
"""Time (s) and value of a mean, half of the resolution, and 1 / sqrt(number of readings)."""


def _residuals(means: Sequence[_Mean]) -> tuple[float, float]:
    """Return the error of a reading by the third difference of four means, and its noise."""
    # Written out, as each speed that is reported needs it.
    (a, va, ha, na), (b, vb, hb, nb), (c, vc, hc, nc), (d, vd, hd, nd) = means
    ab, ac, ad, bc, bd, cd = a - b, a - c, a - d, b - c, b - d, c - d
    wa, wb = 1.0 / (ab * ac * ad), -1.0 / (ab * bc * bd)
    wc, wd = 1.0 / (ac * bc * cd), -1.0 / (ad * bd * cd)
    total = abs(wa * va + wb * vb + wc * vc + wd * vd)
    allowed = abs(wa) * ha + abs(wb) * hb + abs(wc) * hc + abs(wd) * hd
    norm = math.sqrt((wa * na) ** 2 + (wb * nb) ** 2 + (wc * nc) ** 2 + (wd * nd) ** 2)
    return total / norm, max(0.0, total - _EXPLAINED * allowed) / norm


def _rate(
    now: float, spread: float, latest: _Mean, past: Sequence[_Mean], bends: Sequence[float]
) -> Rate:
    """Return the rate at a time, s, from the latest mean and those before it."""
    means = latest, *reversed(past)
    points = [(time, mean, half_step + spread * share) for time, mean, half_step, share in means]
    pairs = []
    for i, (time, mean, error) in enumerate(points[:2]):
        for earlier, before, other in points[i + 1 :]:
            apart = time - earlier
            age = now - 0.5 * (time + earlier)
            pairs.append(((mean - before) / apart, (error + other) / apart, age))
    for bend in bends:
        low, high, least = -math.inf, math.inf, math.inf
        for rate, error, age in pairs:
            error += bend * age
            low = rate - error if rate - error > low else low
            high = rate + error if rate + error < high else high
            least = error if error < least else least
        if 2.0 * _AGREEMENT * least <= high - low < math.inf:
            return Rate(0.5 * (low + high), least)
    return UNKNOWN


def crank_filter() -> "RateFilter":
    """Return a filter for crank angles, rad."""
    return RateFilter(*_CRANK, wraps=True)


def speed_filter(source: Source) -> "RateFilter":
    """Return a filter for a speed, rpm or m/s."""
    return RateFilter(*_SPEEDS[source])


def wrapped_turn(angle: float, before: float) -> float:
    """Return the turn, rad, that a sensor has removed since an angle before; usually 0."""
    step = angle - before
    wraps = abs(step) > math.pi and max(abs(angle), abs(before)) <= _HALF_TURN
    return -math.copysign(2.0 * math.pi, step) if wraps else 0.0


def crank_resolution(stddev: float, angle_stddev: float) -> float:
    """Return the resolution, rad, from deviations with and without its steps; 0 if not known."""
    steps = stddev * stddev - angle_stddev * angle_stddev
    return math.sqrt(12.0 * steps) if steps > 0.0 else 0.0


class RateFilter:
    """Estimates the rate of a quantity.

    The largest usual second derivative (``bend``) is per s^2; the coarsest resolution is assumed
    until two readings differ. ``wraps``: it is an angle, rad; see `wrapped_turn`.
    """

    def __init__(self, bend: float, coarsest: float, *, wraps: bool = False) -> None:
        self._wraps = wraps
        self._bends = [factor * bend for factor in _BENDS]
        self._resolution = coarsest
        self._means: tuple[_Mean, ...] = ()
        self._start = 0  # of the motion, in the list
        self._noise, self._residuals = 0.0, 0  # of one reading, and from how many residuals
        self._smooth: list[float] = []  # errors of readings since the motion has one direction
        self._origin = self._last = self._cell = 0  # ns, ns, and multiples of POOL
        self._value = self._half_step = math.nan  # of the last reading
        self._times, self._sum, self._count = 0, 0.0, 0  # of the readings since the last mean

    def add(self, stamp: int, value: float, resolution: float = 0.0) -> Estimate:
        """Take a reading, ns, and its resolution, or 0; return what estimates the rate."""
        if not self._take(stamp, value, resolution) or self._residuals < _RESIDUALS:
            return unknown_rate
        now, past = 1e-9 * (stamp - self._origin), self._means[self._start :]
        # The half-width of the noise of one reading
        spread = _SPREAD * self._noise * (1.0 + _FEW / (self._residuals + 1.0))
        return partial(_rate, now, spread, self._mean(), past, self._bends)

    def add_many(
        self,
        stamps: Iterable[int],
        values: Iterable[float],
        resolutions: Iterable[float] = repeat(0.0),
        wanted: Iterable[bool] = repeat(True),
    ) -> tuple[FloatArray, FloatArray]:
        """Return the rates that are wanted at many readings, and their errors, (n,) each."""
        rates = zip(map(self.add, stamps, values, resolutions), wanted, strict=False)
        both = np.array([rate() if needed else UNKNOWN for rate, needed in rates]).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    def _take(self, stamp: int, value: float, resolution: float) -> bool:
        """Take a reading; return whether it has a value."""
        if not -math.inf < value < math.inf:
            return False
        if self._wraps and (turn := wrapped_turn(value, self._value)):
            self._move(-turn)
        cell = stamp // POOL
        if not 0 <= stamp - self._last <= GAP or self._count == 0:
            self._start, self._origin = len(self._means), stamp
            self._times, self._sum, self._count = 0, 0.0, 0
        elif stamp == self._last and value == self._value:
            return True  # the same reading once more
        elif cell != self._cell:
            self._close()
        change = abs(value - self._value)
        if 0.0 < change < self._resolution:
            self._resolution = change
        self._half_step = 0.5 * (resolution or self._resolution)
        if len(self._smooth) >= _RESIDUALS and not resolution:
            self._half_step = min(self._half_step, _SPREAD * max(self._smooth))
        self._last, self._cell, self._value = stamp, cell, value
        self._times += stamp - self._origin
        self._sum += value
        self._count += 1
        return True

    def _move(self, by: float) -> None:
        """Count the readings so far from another zero."""
        self._means = tuple((time, mean + by, step, n) for time, mean, step, n in self._means)
        self._sum += by * self._count
        self._value += by

    def _mean(self) -> _Mean:
        """Return the mean of the readings since the last one."""
        count = self._count or 1
        time = 1e-9 * (self._times / count)
        return time, self._sum / count, self._half_step, 1.0 / math.sqrt(count)

    def _close(self) -> None:
        """Keep the mean of the readings, forget those that are no longer used, begin the next."""
        self._means = (*self._means, self._mean())
        if len(self._means) > _LAGS:
            self._means = self._means[1:]
            self._start = max(0, self._start - 1)
        self._times, self._sum, self._count = 0, 0.0, 0
        if len(self._means) - self._start < 4:
            self._smooth = []
            return
        newest = self._means[-4:]
        error, noise = _residuals(newest)
        self._noise = max(noise, _DECAY * self._noise)
        self._residuals += 1
        _, (_, third, *_), (_, second, *_), (_, first, *_) = newest
        turns = not (first - second) * (second - third) > 0.0
        self._smooth = [] if turns else [*self._smooth[1 - _RESIDUALS :], error]
