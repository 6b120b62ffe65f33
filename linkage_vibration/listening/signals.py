# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measured signals in SI and in the axes of the tractor, and what is doubtful about them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from linkage_vibration.drawing.intervals import gap_starts
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, runs
from linkage_vibration.mechanics.forces import GRAVITY
from linkage_vibration.readers.sensors import Sensor
from linkage_vibration.readers.stamps import even_samples

_FULL, _FLAT = 0.99, 3  # of the range; equal extreme samples in a row of an overloaded sensor
_UNEVEN, _BURSTS = 0.1, 1.0  # of a step: standard deviation of stamps that is named, and refused
_DRIFT = 2.0  # s, over which the clock of a sensor is even
_SHORT = 0.5  # s between gaps, on average, below which samples come in bursts
_STAMP = "stamp each sample when it is taken."
HIGHEST = 0.45  # highest frequency that is believed, as a share of the rate
_TOP, _FOLDED = 0.9, 0.05  # of half of the rate; of the variance that may be above
_GRAVITY = 0.15  # by which the mean acceleration may differ from gravity
_NO_GRAVITY = 1.0  # m/s^2: a mean below it contains none
_TILT = math.radians(15.0)
_FEWEST = 16  # samples
_REGULAR = 0.9  # Values are repeated ones if this share occurs equally often, or once more.
_SLOWEST = 0.4  # s between samples, beyond which `HIGHEST` is near the 1 Hz at which levels begin


class SignalError(LinkageVibrationError):
    """A measured signal cannot be used."""


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """What a sensor measured."""

    sensor: Sensor
    times: FloatArray  # (n,), s since the first prediction, even between gaps
    values: FloatArray  # (n, 3) or (n, 1): m/s^2 along x, y, z of the tractor, or N
    rate: float  # Hz
    doubts: tuple[str, ...]  # sentences about what may be wrong

    def at(self, times: FloatArray) -> FloatArray:
        """Return values at times, (..., k)."""
        return np.stack([np.interp(times, self.times, each) for each in self.values.T], axis=-1)

    def windows(self, seconds: float) -> tuple[FloatArray, FloatArray]:
        """Return times, (m, n), and samples less means, (m, n, k), of windows without gaps."""
        n = max(round(seconds * self.rate), 2)
        edges = [0, *(gap_starts(self.times) + 1).tolist(), len(self.times)]
        whole = [self.times[a : b - (b - a) % n] for a, b in pairwise(edges)]
        times = np.concatenate(whole).reshape(-1, n)
        values = self.at(times)
        return times, values - values.mean(axis=1, keepdims=True)


def known_at(times: FloatArray, since: FloatArray, values: FloatArray) -> FloatArray:
    """Return values, (n,), of a log at other times; NaN before, after and in gaps of their own."""
    known = np.interp(times, since, values, left=math.nan, right=math.nan)
    for i in gap_starts(since).tolist():
        known[(times > since[i]) & (times < since[i + 1])] = math.nan
    return known


def measured_signal(
    sensor: Sensor, times: FloatArray, readings: FloatArray, highest: float
) -> Signal:
    """Return the signal of readings, (n, k), with doubts about modes up to the highest, Hz."""
    times, readings = even_samples(sensor.name, times, readings, SignalError)
    if len(times) < _FEWEST:
        raise SignalError(f"{sensor.name} has {len(times)} samples; record at least {_FEWEST}.")
    times, readings, held = _updates(times, readings)
    even, missing, step, spread = _even_clock(sensor, times)
    if step > _SLOWEST:
        text = f"{sensor.name} has {1.0 / step:.2g} samples per second, too few to hear anything"
        raise SignalError(f"{text}; record more, and give its times in s.")
    values = sensor.scale * readings @ sensor.axes.T
    doubts = [*_range_doubts(sensor, readings), *_time_doubts(times, step, spread)]
    if missing.any():
        values = np.stack([np.interp(even, even[~missing], each) for each in values.T], axis=-1)
    if held > 1:
        text = f"Its values occur {held} times in a row"
        doubts.append(f"{text}, so it counts as a sensor with {1.0 / step:.3g} samples per second.")
    doubts += _rate_doubts(sensor, values, 1.0 / step, highest)
    if sensor.accelerates:
        doubts += _gravity_doubts(values.mean(axis=0))
    return Signal(sensor, even, values, 1.0 / step, tuple(doubts))


def _updates(times: FloatArray, readings: FloatArray) -> tuple[FloatArray, FloatArray, int]:
    """Return readings with new values only, and how often each occurs, if that is mostly equal.

    A sensor that is published more often than it measures repeats its values.
    """
    new = np.flatnonzero((np.diff(readings, axis=0) != 0.0).any(axis=1)) + 1
    if len(new) < _FEWEST:
        return times, readings, 1
    occurs = np.diff(new)
    held = int(np.median(occurs))
    # Where the rates are no multiples, values occur n or n + 1 times.
    regular = max(np.isin(occurs, (n, n + 1)).mean() for n in (held - 1, held))
    if held == 1 or regular < _REGULAR:
        return times, readings, 1
    return times[new], readings[new], held


def _even_clock(sensor: Sensor, times: FloatArray) -> tuple[FloatArray, BoolArray, float, float]:
    """Return even times of samples, which of them are missing, the step, and how stamps vary, s.

    Stamps are late by various delays, whose slow part is kept. A longer step is a number of missing
    samples unless the step beside it is shorter by the same time.
    """
    from scipy.ndimage import uniform_filter1d

    steps, gaps = np.diff(times), gap_starts(times)
    step = float(np.median(steps))
    beside = np.pad(steps, 1, constant_values=step)
    longer = np.minimum(steps, np.minimum(beside[:-2], beside[2:]) + steps - step)
    longer[gaps] = step
    counts = np.maximum(np.rint(longer / step), 1.0)
    usual = np.ones(len(steps), dtype=bool)
    usual[gaps] = False
    seconds = float(steps[usual].sum())
    if counts.sum() > 2.0 * len(times) or (len(gaps) > 1 and seconds < _SHORT * len(gaps)):
        raise SignalError(f"The samples of {sensor.name} come in bursts; {_STAMP}")
    step = seconds / float(counts[usual].sum())
    place = np.concatenate([[0], np.cumsum(counts)]).astype(int)
    missing = np.ones(place[-1] + 1, dtype=bool)
    missing[place] = False
    even, off = np.empty(len(missing)), np.empty(len(times))
    for a, b in pairwise([0, *(gaps + 1).tolist(), len(times)]):
        late = times[a:b] - step * place[a:b]
        slow = uniform_filter1d(late, min(round(_DRIFT / step) | 1, b - a), mode="nearest")
        off[a:b] = late - slow
        inner = np.arange(place[a], place[b - 1] + 1)
        even[inner] = step * inner + np.interp(inner, place[a:b], slow)
    spread = float(off.std())
    if spread > _BURSTS * step:
        raise SignalError(f"The stamps of {sensor.name} vary by more than a step; {_STAMP}")
    return even, missing, step, spread


def _range_doubts(sensor: Sensor, readings: FloatArray) -> Iterator[str]:
    """Yield whether readings reach their range, which is known or where they stay flat."""
    size = np.abs(readings)
    if sensor.limit < math.inf:
        if count := int((size >= _FULL * sensor.limit).any(axis=1).sum()):
            yield f"{count} samples reach the range of {sensor.limit:g}, so peaks are cut off."
    elif any(_is_flat(each) for each in size.T):
        text = f"Its largest reading repeats {_FLAT} times or more in a row"
        yield f"{text}, so it may be overloaded; give its range."


def _is_flat(size: FloatArray) -> bool:
    """Return whether the largest reading repeats, and is no round crest that is flat by rounding.

    A parabola that falls by one step of the resolution within n samples falls by ((n + 1) / (n -
    1))^2 steps within n + 2 of them; rounding adds one.
    """
    levels = np.unique(size)
    if len(levels) < _FLAT:
        return False
    starts, ends = np.array(runs(size == levels[-1])).T
    n = ends - starts
    beside = np.pad(size, 1, constant_values=-math.inf)  # sample i is at i + 1
    fall = levels[-1] - np.maximum(beside[starts], beside[ends + 1])
    round_crest = ((n + 1) / np.maximum(n - 1, 1)) ** 2 + 1.0
    return bool(np.any((n >= _FLAT) & (fall > round_crest * np.diff(levels).min())))


def _time_doubts(times: FloatArray, step: float, spread: float) -> Iterator[str]:
    """Yield gaps and uneven stamps."""
    gaps = gap_starts(times)
    if len(gaps):
        text = f"{len(gaps)} gaps of up to {np.diff(times)[gaps].max():.2g} s are left out"
        yield f"{text}; check the load of the sensor's computer."
    if spread > _UNEVEN * step:
        loss = 1.0 - math.exp(-((2.0 * math.pi * HIGHEST * spread / step) ** 2) / 2.0)
        text = f"Its stamps vary by {100.0 * spread / step:.0f} % of a step (standard deviation)"
        text += f"; if its samples do so, too, {HIGHEST / step:.3g} Hz appears up to"
        yield f"{text} {100.0 * loss:.0f} % too weak; stamp samples in the sensor."


def _rate_doubts(sensor: Sensor, values: FloatArray, rate: float, highest: float) -> Iterator[str]:
    """Yield whether the rate is too low, and whether vibration above half of it is folded."""
    if rate < 2.0 * highest:
        text = f"At {rate:.3g} Hz it shows nothing above {rate / 2.0:.3g} Hz"
        yield f"{text}, and modes reach {highest:.3g} Hz."
    if sensor.filtered:
        return
    power = (np.abs(np.fft.rfft(values - values.mean(axis=0), axis=0)) ** 2).sum(axis=1)
    if power[int(_TOP * len(power)) :].sum() > _FOLDED * power[1:].sum():
        text = f"It vibrates strongly just below {rate / 2.0:.3g} Hz, half of its rate"
        yield f"{text}, so higher frequencies may appear folded; use a filter or a higher rate."


def _gravity_doubts(mean: FloatArray) -> Iterator[str]:
    """Yield whether gravity has another size or direction than the unit and the mounting say."""
    size = float(np.linalg.norm(mean))
    for factor, words in ((1.0 / GRAVITY, "g"), (GRAVITY, "m/s2")):
        if abs(size / (GRAVITY * factor) - 1.0) < _GRAVITY:
            text = f"Gravity appears as {size:.3g} m/s2, so the unit is wrong"
            yield f"{text}; write `unit: {words}`."
            return
    if size < _NO_GRAVITY:
        yield "It shows no gravity, so neither its unit nor its mounting can be checked."
        return
    if abs(size / GRAVITY - 1.0) >= _GRAVITY:
        yield f"Gravity appears as {size:.3g} m/s2; check its unit and its calibration."
    tilt = math.acos(max(-1.0, min(1.0, float(mean[2]) / size)))
    if tilt > _TILT:
        text = f"Gravity is {math.degrees(tilt):.0f} deg away from where its mounting says"
        yield f"{text}; correct its axes, or fix the sensor, which may hang loose."
