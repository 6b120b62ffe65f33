# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of a drive in which the crank moves little, and their signals over the phase of a mode."""

import math
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from linkage_vibration.mechanics.arrays import FloatArray, runs

SHORTEST, LONGEST = 8.0, 20.0  # seconds of a segment
ACROSS = math.radians(8.0)  # largest difference between angles of segments of one height, rad

_FASTEST = math.radians(1.0)  # rad/s; a crank that moves faster drives what it moves
_LOOKS = 10.0  # Hz at which the angle is looked at
_ROOM = 3.0  # half of the rate of resampled signals, over the frequency of the mode


def find_segments(times: FloatArray, crank_angle: FloatArray) -> list[list[slice]]:
    """Return segments by height, of even times, s, and angles, rad, (n,), NaN if not known."""
    if times[-1] - times[0] < SHORTEST:
        return []
    step = max(1, round(1.0 / (_LOOKS * float(times[1] - times[0]))))
    t, angle = times[::step], crank_angle[::step]
    moves = np.abs(np.gradient(angle, t)) > _FASTEST
    segments: list[slice] = []
    start, low, high = 0, math.inf, -math.inf
    for i in range(len(t) + 1):
        still = i < len(t) and not moves[i] and math.isfinite(angle[i])
        if still:
            low, high = min(low, angle[i]), max(high, angle[i])
            if high - low <= ACROSS / 2.0:
                continue
        if i > start and t[i - 1] - t[start] >= SHORTEST:
            parts = math.ceil((t[i - 1] - t[start]) / LONGEST)
            edges = (np.linspace(start, i - 1, parts + 1).astype(int) * step).tolist()
            segments += [slice(a, b) for a, b in pairwise(edges)]
        start = i if still else i + 1
        low, high = (angle[i], angle[i]) if still else (math.inf, -math.inf)
    heights: list[list[slice]] = []
    for segment in sorted(segments, key=lambda each: float(crank_angle[each].mean())):
        here = crank_angle[segment].mean()
        if heights and here - crank_angle[heights[-1][0]].mean() <= ACROSS / 2.0:
            heights[-1].append(segment)
        else:
            heights.append([segment])
    return heights


def longest_still(times: FloatArray, crank_angle: FloatArray) -> float:
    """Return the longest time, s, in which the crank does not move, of even times, (n,), s."""
    still = np.abs(np.gradient(crank_angle, times)) <= _FASTEST
    return max((float(times[j - 1] - times[i]) for i, j in runs(still)), default=0.0)


def phase_rate(mean: float, given: float) -> float:
    """Return the rate, Hz, to which signals of a given rate are resampled for a mode, Hz."""
    return min(2.0 * _ROOM * mean, given)


def over_phase(signals: FloatArray, predicted: FloatArray, mean: float, given: float) -> FloatArray:
    """Return the signals of a segment over the phase of a predicted frequency, (m, n_channels).

    A multiple of that frequency, (n,), Hz, is then the multiple of its mean over all segments. The
    signals, (n, n_channels), have the rate ``given``, the result that of `phase_rate`.
    """
    from scipy.signal import butter, sosfiltfilt

    rate, values = phase_rate(mean, given), signals - signals.mean(axis=0)
    filters = [butter(2, 0.25 * mean, "highpass", fs=given, output="sos")]
    if rate < given:
        filters.append(butter(6, 0.4 * rate, fs=given, output="sos"))
    for sos in filters:
        values = sosfiltfilt(sos, values, axis=0)
    phase = np.cumsum(predicted) / (given * mean)
    return np.asarray(CubicSpline(phase, values)(np.arange(phase[0], phase[-1], 1.0 / rate)))
