# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Exposure of a person to measured vibration: ISO 2631-1 and A(8) of Directive 2002/44/EC."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.listening.signals import Signal
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray

ACTION, LIMIT = 0.5, 1.15
"""Values of A(8) in 2002/44/EC, m/s^2, above which an employer must act, and which is forbidden."""
WEIGHTED = 80.0
"""Hz, up to which the standards weight vibration."""
STANDS = 0.3
"""Speed over ground below which a machine stands, m/s."""
KINDS = "standing", "transport", "work", "not known"
_DAY = 8.0 * 3600.0  # s
_FACTORS = np.array([1.4, 1.4, 1.0])  # of x, y and z, for the health of a sitting person
_BAND = 0.4, 100.0  # Hz, whose two filters are Butterworth's of order 2
_STEP = {False: (2.0, 2.0, 0.63), True: (12.5, 12.5, 0.63)}  # f3, f4 (Hz) and Q4 of Wd and Wk
_RISE = 2.37, 0.91, 3.35, 0.91  # f5 (Hz), Q5, f6 (Hz) and Q6 of Wk
_SECOND = 1.0  # s, of a running rms
_RAISED = 0.75  # of the stroke; above it, the hitch is raised


@dataclass(frozen=True, slots=True)
class Exposure:
    """What a person felt.

    The shares are, for each kind of work, of the time, and of it above the action and the limit
    value.
    """

    weighted: tuple[float, float, float]  # along x, y and z with their factors, rms, m/s^2
    seconds: float  # without gaps
    shares: dict[str, tuple[float, float, float]]

    @property
    def a8(self) -> float:
        """A(8) of a day with this measured time alone, m/s^2."""
        return max(self.weighted) * math.sqrt(self.seconds / _DAY)

    def hours_until(self, value: float) -> float:
        """Return after how many hours of the same vibration A(8) reaches a value, m/s^2."""
        worst = max(self.weighted)
        return 8.0 * (value / worst) ** 2 if worst else math.inf


def weighting(frequencies: NDArray[Any], *, vertical: bool) -> ComplexArray:
    """Return the weighting Wk (vertical) or Wd of ISO 2631-1 at frequencies in Hz, as complex.

    The parameters are those of ISO 8041.
    """
    s = 1j * np.asarray(frequencies, dtype=float)  # in Hz, as only ratios matter
    low, high = _BAND
    root, (f3, f4, q4) = math.sqrt(2.0), _STEP[vertical]
    response = s**2 / (s**2 + root * low * s + low**2)
    response = response * high**2 / (s**2 + root * high * s + high**2)
    response = response * (1.0 + s / f3) / (1.0 + s / (q4 * f4) + (s / f4) ** 2)
    if vertical:
        f5, q5, f6, q6 = _RISE
        response = response * (1.0 + s / (q5 * f5) + (s / f5) ** 2)
        response = response / (1.0 + s / (q6 * f6) + (s / f6) ** 2) * (f5 / f6) ** 2
    return np.asarray(response)


def exposure(signal: Signal, kinds: IntArray) -> Exposure:
    """Return the exposure of a sensor on a seat; ``kinds`` has one of `KINDS` for each sample."""
    long = max(round(_SECOND * signal.rate), 1)
    squares, count, worst, kind = np.zeros(3), 0, [np.empty(0)], [kinds[:0]]
    for times in signal.stretches():
        values = _weighted(signal.at(times), signal.rate)
        squares += (values**2).sum(axis=0)
        count += len(times)
        seconds = values[: len(times) // long * long].reshape(-1, long, 3)
        worst.append(np.sqrt((seconds**2).mean(axis=1)).max(axis=1))
        middles = times[long // 2 :: long][: len(seconds)]
        kind.append(kinds[np.searchsorted(signal.times, middles, side="right") - 1])
    running, work = np.concatenate(worst), np.concatenate(kind)
    shares = {}
    for i, name in enumerate(KINDS):
        if (chosen := work == i).any():
            above = [float((running[chosen] > value).mean()) for value in (ACTION, LIMIT)]
            shares[name] = (float(chosen.mean()), above[0], above[1])
    x, y, z = np.sqrt(squares / count).tolist()
    return Exposure((x, y, z), count / signal.rate, shares)


def _weighted(values: FloatArray, rate: float) -> FloatArray:
    """Return even samples, (n, 3), weighted by filters that a low rate does not bend."""
    n = len(values)
    frequencies = np.fft.rfftfreq(2 * n, 1.0 / rate)
    gains = np.stack([weighting(frequencies, vertical=vertical) for vertical in (False, True)])
    spectrum = np.fft.rfft(values - values.mean(axis=0), 2 * n, axis=0) * gains[[0, 0, 1]].T
    return np.asarray(_FACTORS * np.fft.irfft(spectrum, 2 * n, axis=0)[:n])


def kinds_of_work(speed: FloatArray, height: FloatArray) -> IntArray:
    """Return the index in `KINDS` of each sample from ground speeds, m/s, and heights of the hitch.

    A height is a share of the stroke, 0 to 1. The tractor stands below 0.3 m/s. Otherwise it is
    transport if the hitch is in the highest quarter of its stroke, else work.
    """
    moves = np.where(np.isnan(speed + height), 3, np.where(height > _RAISED, 1, 2))
    return np.asarray(np.where(np.abs(speed) < STANDS, 0, moves))
