# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reasons not to believe an identified mode.

An order, a line of the wheelbase or a tone may be in its place, or a single window shows it.
"""

import math
from collections.abc import Sequence

import numpy as np

from linkage_vibration.listening.output_only import (
    ALIKE,
    Candidate,
    PausableTask,
    covariances,
    mac,
    poles_and_shapes,
)
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import Place
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.ground import Terrain, ground_spectrum, vertical_mounts
from linkage_vibration.table.table import Table

NEAR, MOST_NEAR = 0.05, 0.02  # relative distance at which an order hides a mode; share that it may
WINDOWS = 2  # windows that must show a mode
MOST_DAMPED = 0.04  # predicted damping ratio above which intervals of frequencies did not hold

_LINE = 0.05  # relative distance of a line to what it explains
_PROMINENT = 1.0  # dB of a line
_ALIKE_HZ = 0.05  # relative distance of the same mode in a window
_ORDERS = 3  # of the diagram, at which a window shows a mode
_LESS = 0.5  # of a predicted damping ratio: models hardly know it better than by a factor of two
_ABOVE = 1.64  # standard deviations that 95 % of estimates do not exceed
_PERIODS = 8  # of a line, over which its amplitude is measured
_FEWEST = 3  # amplitudes in a window
_STEADY = 0.2  # ln of the mean square less the mean of ln: 0.58 for noise, less for a tone


def order_doubt(
    frequency: FloatArray, speeds: dict[Source, FloatArray], excitations: Sequence[Excitation]
) -> str:
    """Return which order was near a frequency over time, Hz, (n,), for too long; else nothing.

    Speeds are (n,), in the units of their sources. One that is not known may hide any mode, also
    that of a terrain, which makes lines.
    """
    for each in excitations:
        speed = speeds.get(each.source, np.full(len(frequency), np.nan))
        away = np.abs(each.ratio * speed / frequency - 1.0)
        unknown, near = float(np.isnan(speed).mean()), float((away <= NEAR).mean())
        if unknown > MOST_NEAR:
            what = f"the {each.source.value} speed, which {each.name} follows,"
            return f"{what} is not known in {100.0 * unknown:.0f} % of a stretch"
        if near > MOST_NEAR:
            what = f"{each.name} was within {100.0 * NEAR:g} % of it"
            return f"{what} in {100.0 * near:.0f} % of a stretch"
    return ""


def wheelbase_lines(
    table: Table,
    mechanism: Mechanism,
    terrain: Terrain,
    place: Place,
    alpha3: float,
    speeds: Sequence[float],
) -> PausableTask[FloatArray]:
    """Return frequencies, Hz, of maxima of the predicted spectrum that no mode makes.

    It is the mean of the acceleration's at speeds, m/s, as a line that follows a changing speed is
    none. One mount makes no line; NaN: the table has no FRFs at the mounts.
    """
    from scipy.signal import find_peaks

    mounts = vertical_mounts(mechanism)
    if len(mounts) < 2 or not {(mount.name, "z") for mount in mounts} <= {*table.places}:
        return np.full(int(len(mounts) > 1), np.nan)
    spectra = []
    for speed in speeds:
        yield
        spectra.append(ground_spectrum(table, mechanism, terrain, place, alpha3, speed))
    f = spectra[0][0]
    mean = np.nan_to_num(np.mean([psd for _, psd in spectra], axis=0)) * f**2
    peaks = find_peaks(10.0 * np.log10(np.maximum(mean, 1e-30)), prominence=_PROMINENT)[0]
    modes = table.evaluate(np.array([alpha3]))[0, : table.n_modes]
    away = np.abs(np.log(np.divide.outer(f[peaks], modes)))
    return np.asarray(f[peaks][np.nanmin(away, axis=1) > _LINE])


def line_doubt(frequency: float, predicted: float, lines: FloatArray) -> str:
    """Return that a line, Hz (NaN: anywhere), explains a frequency better than a mode; else ""."""
    if np.isnan(lines).any():
        return "the table has no FRFs at the wheels, whose lines may be there; add --frf-points"
    away = np.abs(np.log(lines / frequency))
    if not len(lines) or away.min() > min(_LINE, abs(np.log(predicted / frequency))):
        return ""
    return f"the wheelbase makes a line at {lines[away.argmin()]:.2f} Hz, where no mode is"


def damping_doubt(ratio: float) -> str:
    """Return that the deviation of a mode with a predicted damping ratio is not known, or nothing.

    On simulated drives, too few of the intervals of tractor modes on tyres held. Those of modes
    below the limit hold, see `benchmark/results/listening.md`.
    """
    if ratio <= MOST_DAMPED:  # false for NaN, which overdamped modes have
        return ""
    return f"its damping ratio of {100.0 * ratio:.1f} % leaves its standard deviation unknown"


def low_damping_doubt(ratio: float, stddev: float, predicted: float) -> str:
    """Return that a damping ratio is as low as that of a tone, such as of a pump; else ""."""
    if not ratio + _ABOVE * stddev < _LESS * predicted:
        return ""
    measured = f"{100.0 * ratio:.2g} +- {100.0 * stddev:.1g} %"
    expected = f"instead of the predicted {100.0 * predicted:.2g} %"
    return f"it may be a tone, as its damping ratio is {measured} {expected}"


def tone_doubt(
    windows: Sequence[FloatArray],
    rate: float,
    band: tuple[float, float],
    orders: Sequence[Sequence[float]],
) -> PausableTask[str]:
    """Return which tone that no excitation describes dominates a band, Hz; else nothing.

    Of squares of amplitudes, ln(mean) - mean(ln) is 0.58 for random forces, and 1 / q for a tone of
    q times their power (Jacobsen, Andersen and Brincker 2007). Orders, Hz, are no tones.
    """
    difference, count, tones = 0.0, 0, list[float]()
    for window, described in zip(windows, orders, strict=True):
        yield
        line, channel = _strongest_line(window, rate, band)
        length = round(_PERIODS * rate / line)
        wave = np.hanning(length) * np.exp(-2j * np.pi * line / rate * np.arange(length))
        starts = range(0, len(window) - length + 1, length)
        squares = [abs(window[i : i + length, channel] @ wave) ** 2 for i in starts]
        is_order = any(abs(each / line - 1.0) <= NEAR for each in described)
        if is_order or len(squares) < _FEWEST or min(squares) <= 0.0:
            continue
        mean = math.log(float(np.mean(squares)))
        difference += len(squares) * (mean - float(np.log(squares).mean()))
        count += len(squares) - 1
        tones.append(line)
    if not count or difference / count >= _STEADY:
        return ""
    return f"a tone at {np.median(tones):.2f} Hz, which no excitation describes, is stronger"


def _strongest_line(
    window: FloatArray, rate: float, band: tuple[float, float]
) -> tuple[float, int]:
    """Return the frequency of the strongest line of a window in a band, Hz, and its channel."""
    size = window.std(axis=0)
    values = (window - window.mean(axis=0)) / np.where(size > 0.0, size, np.inf)
    n = 4 * len(values)  # so that frequencies are closer than a line is wide
    hertz = np.fft.rfftfreq(n, 1.0 / rate)
    power = np.abs(np.fft.rfft(values * np.hanning(len(values))[:, np.newaxis], n, axis=0)) ** 2
    power[(hertz < band[0]) | (hertz > band[1])] = -1.0
    line, channel = np.unravel_index(int(power.argmax()), power.shape)
    return float(hertz[line]), int(channel)


def window_doubt(
    windows: Sequence[FloatArray], rate: float, first_lag: int, candidate: Candidate
) -> PausableTask[str]:
    """Return that fewer than `WINDOWS` windows, (n, n_channels), show a mode; else nothing."""
    shown = 0
    for window in windows:
        yield
        scale = window.std(axis=0)
        sums, counts = covariances([window / scale], first_lag, len(window))
        if not len(counts):
            continue
        orders = 0
        for poles, shapes in poles_and_shapes(sums[0] / counts[0], rate):
            hertz, damping = np.abs(poles) / (2.0 * np.pi), -poles.real / np.abs(poles)
            near = np.abs(hertz / candidate.frequency - 1.0) < _ALIKE_HZ
            alike = mac(candidate.shape / scale, shapes) > ALIKE
            orders += bool((near & alike & (damping > 0.0)).any())
        shown += orders >= _ORDERS
    return "" if shown >= WINDOWS else f"{shown} of {len(windows)} windows show it"
