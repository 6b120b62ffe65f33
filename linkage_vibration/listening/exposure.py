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
KINDS = "standing", "transport", "work"
_DAY = 8.0 * 3600.0  # s
_FACTORS = 1.4, 1.4, 1.0  # of x, y and z, for the health of a sitting person
_BAND = 0.4, 100.0  # Hz, whose two filters are Butterworth's of order 2
_STEP = {False: (2.0, 2.0, 0.63), True: (12.5, 12.5, 0.63)}  # f3, f4 (Hz) and Q4 of Wd and Wk
_RISE = 2.37, 0.91, 3.35, 0.91  # f5 (Hz), Q5, f6 (Hz) and Q6 of Wk
_SECOND = 1.0  # s, of a running rms
_STANDS = 0.3  # m/s
_RAISED = 0.75  # of the range of heights in a drive; above it, the hitch is raised


@dataclass(frozen=True, slots=True)
class Exposure:
    """What a person felt.

    Attributes
    ----------
    weighted : tuple of float, (3,)
        Frequency-weighted accelerations along x, y and z with their factors, rms, m/s^2.
    seconds : float
        How long was measured.
    shares : dict of str to (float, float, float)
        For each kind of work: its share of the time, and the shares of it in which the running rms
        of the worst axis exceeds the action and the limit value.
    """

    weighted: tuple[float, float, float]
    seconds: float
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
    steps = np.arange(signal.times[0], signal.times[-1], 1.0 / signal.rate)
    values = np.stack([np.interp(steps, signal.times, each) for each in signal.values.T])
    values -= values.mean(axis=1, keepdims=True)
    n = len(steps)
    frequencies = np.fft.rfftfreq(2 * n, 1.0 / signal.rate)
    for axis, factor in enumerate(_FACTORS):  # exact filters, which a low rate does not bend
        spectrum = np.fft.rfft(values[axis], 2 * n) * weighting(frequencies, vertical=axis == 2)
        values[axis] = factor * np.fft.irfft(spectrum, 2 * n)[:n]
    long = max(round(_SECOND * signal.rate), 1)
    running = values[:, : n // long * long].reshape(3, -1, long)
    worst = np.sqrt((running**2).mean(axis=2)).max(axis=0)
    at = np.interp(steps[: n // long * long : long], signal.times, np.arange(len(kinds)))
    kind = kinds[at.astype(np.int64)]
    x, y, z = np.sqrt((values**2).mean(axis=1)).tolist()
    shares = {}
    for i, name in enumerate(KINDS):
        if (chosen := kind == i).any():
            above = [float((worst[chosen] > value).mean()) for value in (ACTION, LIMIT)]
            shares[name] = (float(chosen.mean()), above[0], above[1])
    return Exposure((x, y, z), n / signal.rate, shares)


def kinds_of_work(speed: FloatArray, height: FloatArray) -> IntArray:
    """Return the index in `KINDS` of each sample from ground speeds, m/s, and heights of the hitch.

    It stands below 0.3 m/s. Otherwise it is transport if the hitch is in the highest quarter of the
    heights of the drive, else work; so it is where the speed is not known.
    """
    low, high = float(np.nanmin(height)), float(np.nanmax(height))
    raised = (height > low + _RAISED * (high - low)) & np.isfinite(speed)
    return np.asarray(np.where(np.abs(speed) < _STANDS, 0, np.where(raised, 1, 2)))
