# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Spectra and levels of a measured signal over time."""

import math

import numpy as np

from linkage_vibration.listening.signals import HIGHEST, Signal
from linkage_vibration.mechanics.arrays import FloatArray

_LEAST = 1.0  # Hz: below, an integrated acceleration is drift


def spectrogram(signal: Signal, seconds: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s, (m,), Hz, (n,), and densities by Hann's window, (m, n), summed over axes."""
    times, values = signal.windows(seconds)
    n = values.shape[1]
    window = np.hanning(n)[:, np.newaxis]
    spectrum = np.fft.rfft(values * window, axis=1)
    power = 2.0 * (np.abs(spectrum) ** 2).sum(axis=2) / (signal.rate * (window**2).sum())
    frequencies = np.asarray(np.fft.rfftfreq(n, 1.0 / signal.rate), dtype=float)
    return times.mean(axis=1), frequencies, power


def levels(signal: Signal, seconds: float) -> FloatArray:
    """Return the rms in each window, m/s or N, (m,), from 1 Hz to 0.45 of the rate."""
    _, frequencies, power = spectrogram(signal, seconds)
    band = (frequencies >= _LEAST) & (frequencies <= HIGHEST * signal.rate)
    power = power[:, band] * frequencies[1]
    if signal.sensor.accelerates:
        power = power / (2.0 * math.pi * frequencies[band]) ** 2
    return np.asarray(np.sqrt(power.sum(axis=1)))
