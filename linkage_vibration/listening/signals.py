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
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.forces import GRAVITY
from linkage_vibration.readers.sensors import Sensor

_FULL, _FLAT = 0.99, 3  # of the range; equal extreme samples in a row of an overloaded sensor
_UNEVEN = 0.1  # of the median step: its standard deviation beyond
_TOP, _FOLDED = 0.9, 0.05  # of half of the rate; of the variance that may be above
_GRAVITY = 0.15  # by which the mean acceleration may differ from gravity
_NO_GRAVITY = 1.0  # m/s^2: a mean below it contains none
_TILT = math.radians(15.0)
_FEWEST = 16  # samples


class SignalError(LinkageVibrationError):
    """A measured signal cannot be used."""


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """What a sensor measured.

    Attributes
    ----------
    sensor : Sensor
    times : ndarray, (n,)
        s since the first prediction, ascending.
    values : ndarray, (n, 3) or (n, 1)
        m/s^2 along x, y and z of the tractor, or N.
    rate : float
        Samples per second, Hz.
    doubts : tuple of str
        A sentence for each thing that may be wrong.
    """

    sensor: Sensor
    times: FloatArray
    values: FloatArray
    rate: float
    doubts: tuple[str, ...]

    def stretches(self) -> list[FloatArray]:
        """Return the even times, s, (n,), of each stretch without gaps."""
        edges = [0, *(gap_starts(self.times) + 1).tolist(), len(self.times)]
        ends = [(self.times[a], self.times[b - 1]) for a, b in pairwise(edges)]
        return [a + np.arange(int((b - a) * self.rate + 1.5)) / self.rate for a, b in ends]

    def at(self, times: FloatArray) -> FloatArray:
        """Return values at times, (..., k)."""
        return np.stack([np.interp(times, self.times, each) for each in self.values.T], axis=-1)

    def windows(self, seconds: float) -> tuple[FloatArray, FloatArray]:
        """Return times of samples, (m, n), and samples without their means, (m, n, k).

        The windows follow each other, and their samples are even; none contains a gap.
        """
        n = max(round(seconds * self.rate), 2)
        whole = [times[: len(times) // n * n] for times in self.stretches()]
        times = np.concatenate(whole).reshape(-1, n)
        values = self.at(times)
        return times, values - values.mean(axis=1, keepdims=True)


def known_at(times: FloatArray, since: FloatArray, values: FloatArray) -> FloatArray:
    """Return values, (n,), of a log at other times; NaN before, after and in gaps of their own."""
    found = np.interp(times, since, values, left=math.nan, right=math.nan)
    for i in gap_starts(since).tolist():
        found[(times > since[i]) & (times < since[i + 1])] = math.nan
    return found


def measured_signal(
    sensor: Sensor, times: FloatArray, readings: FloatArray, highest: float
) -> Signal:
    """Return the signal of readings, (n, k), in units of the sensor, with what is doubtful.

    Modes of interest are up to the highest frequency, Hz.
    """
    distinct = np.diff(times, prepend=-math.inf) > 0.0
    times, readings = times[distinct], readings[distinct]
    if len(times) < _FEWEST:
        raise SignalError(f"{sensor.name} has {len(times)} samples; record at least {_FEWEST}.")
    rate = 1.0 / float(np.median(np.diff(times)))
    values = sensor.scale * readings @ sensor.axes.T
    doubts = [*_range_doubts(sensor, readings), *_time_doubts(times)]
    doubts += _rate_doubts(sensor, times, values, rate, highest)
    if sensor.accelerates:
        doubts += _gravity_doubts(values.mean(axis=0))
    return Signal(sensor, times, values, rate, tuple(doubts))


def _range_doubts(sensor: Sensor, readings: FloatArray) -> Iterator[str]:
    """Yield whether readings reach their range, which is known or where they stay flat."""
    size = np.abs(readings)
    if sensor.limit < math.inf:
        if count := int((size >= _FULL * sensor.limit).any(axis=1).sum()):
            yield f"{count} samples reach the range of {sensor.limit:g}, so peaks are cut off."
        return
    flat = (size == size.max(axis=0)) & (size > 0.0)
    ends = flat[_FLAT - 1 :].copy()
    for back in range(1, _FLAT):
        ends &= flat[_FLAT - 1 - back : len(flat) - back]
    if ends.any() and (readings.std(axis=0) > 0.0)[ends.any(axis=0)].any():
        text = f"Its largest reading repeats {_FLAT} times or more in a row"
        yield f"{text}, so it may be overloaded; give its range."


def _time_doubts(times: FloatArray) -> Iterator[str]:
    """Yield gaps and uneven steps."""
    steps, gaps = np.diff(times), gap_starts(times)
    if len(gaps):
        text = f"{len(gaps)} gaps of up to {steps[gaps].max():.2g} s are left out"
        yield f"{text}; check the load of the recorder."
    usual = np.delete(steps, gaps)
    if usual.std() > _UNEVEN * np.median(steps):
        share = 100.0 * usual.std() / np.median(steps)
        text = f"Its steps vary by {share:.0f} % (standard deviation)"
        yield f"{text}, so high frequencies are too low; stamp samples in the sensor."


def _rate_doubts(
    sensor: Sensor, times: FloatArray, values: FloatArray, rate: float, highest: float
) -> Iterator[str]:
    """Yield whether the rate is too low, and whether vibration above half of it is folded."""
    if rate < 2.0 * highest:
        text = f"At {rate:.3g} Hz it shows nothing above {rate / 2.0:.3g} Hz"
        yield f"{text}, and modes reach {highest:.3g} Hz."
    if sensor.filtered:
        return
    at = np.arange(times[0], times[-1], 1.0 / rate)
    even = np.array([np.interp(at, times, each) for each in values.T])
    power = (np.abs(np.fft.rfft(even - even.mean(axis=1, keepdims=True))) ** 2).sum(axis=0)
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
