# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Spectra and levels of a measured signal over time, and how strongly each order is in it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from linkage_vibration.listening.signals import HIGHEST, Signal
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.excitation import Excitation, Source

SECONDS = 4.0  # length of a window, s, which resolves 0.25 Hz; the windows follow each other
_LEAST = 1.0  # Hz: below, an integrated acceleration is drift
_APART = 2.0 / SECONDS  # Hz: orders closer than that are one line
_BESIDE = np.array([-5.0, -4.0, -3.0, 3.0, 4.0, 5.0]) / SECONDS  # Hz, where only noise remains


@dataclass(frozen=True, slots=True, eq=False)
class Orders:
    """Orders in m windows of a signal; squares are NaN where two orders are too close."""

    times: FloatArray  # (m,), middles, s
    speeds: FloatArray  # (m, n_excitations), means, rpm or m/s; NaN if not known
    frequencies: FloatArray  # likewise, Hz
    squares: FloatArray  # likewise, of amplitudes, sums over axes, (m/s^2)^2 or N^2
    noise: FloatArray  # the part of them that noise makes


def track_orders(
    signal: Signal,
    excitations: Sequence[Excitation],
    speeds: Mapping[Source, tuple[FloatArray, FloatArray]],
) -> Orders:
    """Return the amplitudes of orders; speeds are times, s, and values, rpm or m/s.

    In each window, least squares find cosine and sine of all orders together over the angles that
    the shafts turn, which are the integrals of the speeds; so speeds may change.
    """
    times, values = signal.windows(SECONDS)
    m, n, _ = values.shape
    shape = (m, len(excitations))
    mean, hertz, squares, noise = (np.full(shape, math.nan) for _ in range(4))
    turns = np.zeros((*shape, n))
    for i, excitation in enumerate(excitations):
        if excitation.is_order and excitation.source in speeds:
            since, speed = speeds[excitation.source]
            each = np.interp(times, since, np.abs(speed), left=math.nan, right=math.nan)
            mean[:, i], hertz[:, i] = each.mean(axis=1), excitation.ratio * each.mean(axis=1)
            turns[:, i] = np.cumsum(excitation.ratio * each / signal.rate, axis=1)
    window = np.hanning(n)
    beside = np.exp(-2j * math.pi * np.multiply.outer(_BESIDE, np.arange(n) / signal.rate))
    for k in range(m):
        with np.errstate(invalid="ignore"):  # an unknown frequency compares as False
            used = (hertz[k] > _APART) & (hertz[k] < HIGHEST * signal.rate)
        at = np.flatnonzero(used)
        if not len(at):
            continue
        phasors = np.exp(2j * math.pi * turns[k, at])
        columns = np.concatenate([phasors.real, phasors.imag, np.ones((1, n))]).T
        weighted = columns * window[:, np.newaxis], values[k] * window[:, np.newaxis]
        fit = np.linalg.lstsq(*weighted, rcond=None)[0]
        rest = (values[k] - columns @ fit) * window[:, np.newaxis] ** 2
        parts = fit[: 2 * len(at)].reshape(2, len(at), -1)
        apart = np.abs(hertz[k, at] - hertz[k, at][:, np.newaxis])
        alone = (apart + np.where(np.eye(len(at)), math.inf, 0.0)).min(axis=1) > _APART
        lines = np.einsum("an,bn,nc->abc", phasors.conj(), beside, rest, optimize=True)
        lines *= 2.0 / (window**2).sum()
        noise[k, at] = np.where(alone, (np.abs(lines) ** 2).sum(axis=2).mean(axis=1), math.nan)
        squares[k, at] = np.where(alone, (parts**2).sum(axis=(0, 2)), math.nan)
    return Orders(times.mean(axis=1), mean, hertz, squares, noise)


def spectrogram(signal: Signal) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s, (m,), Hz, (n,), and densities by Hann's window, (m, n), summed over axes."""
    times, values = signal.windows(SECONDS)
    n = values.shape[1]
    window = np.hanning(n)[:, np.newaxis]
    spectrum = np.fft.rfft(values * window, axis=1)
    power = 2.0 * (np.abs(spectrum) ** 2).sum(axis=2) / (signal.rate * (window**2).sum())
    frequencies = np.asarray(np.fft.rfftfreq(n, 1.0 / signal.rate), dtype=float)
    return times.mean(axis=1), frequencies, power


def levels(signal: Signal) -> FloatArray:
    """Return the rms in each window, m/s or N, (m,), from 1 Hz to 0.45 of the rate."""
    _, frequencies, power = spectrogram(signal)
    band = (frequencies >= _LEAST) & (frequencies <= HIGHEST * signal.rate)
    power = power[:, band] * frequencies[1]
    if signal.sensor.accelerates:
        power = power / (2.0 * math.pi * frequencies[band]) ** 2
    return np.asarray(np.sqrt(power.sum(axis=1)))
