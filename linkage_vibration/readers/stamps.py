# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds when samples were taken that share stamps, or whose stamps are coarse."""

import math
from itertools import pairwise

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray

_TOGETHER, _MANY = 0.2, 0.25  # of a step, below which samples are a batch; share of such steps
_COARSE = 0.1  # of a step: a finer resolution of stamps is not corrected
_COARSEST = 1.5  # resolutions in a step: in fewer, a lost sample looks like rounding
_PAUSE, _LEAST_PAUSE = 10.0, 0.1  # usual steps, and s, above which an even clock begins anew
_SILENT = 2.0  # s: a longer step is no usual one
_LOST = 2.0  # s, over which the means of stamps follow an even clock unless samples are lost
_EXACT = 1e-3  # of a step: what rounding of numbers changes in even stamps
_FIRST = 0.2  # of a step, by which first samples of batches have to fit better than their last
_FEWEST = 8  # batches that show a clock


def even_samples(
    name: str, times: FloatArray, signals: FloatArray, error: type[LinkageVibrationError]
) -> tuple[FloatArray, FloatArray]:
    """Return when the samples of ascending stamps, (n,), s, were taken, and signals, (n, k).

    A sensor samples evenly by a clock of its own, also if stamps are those of batches, or rounded.
    Samples that are only copies count once. Other samples that share a stamp are an error.
    """
    shared = np.diff(times) == 0.0
    if (shared <= (np.diff(signals, axis=0) == 0.0).all(axis=1)).all():
        kept = np.append(True, ~shared)[: len(times)]
        times, signals = times[kept], signals[kept]
    steps = np.diff(times)
    usual = steps[steps < _SILENT]
    apart = usual[usual > _TOGETHER * usual.sum() / max(len(usual), 1)]
    longest = max(_PAUSE * float(np.median(apart)), _LEAST_PAUSE) if len(apart) else math.inf
    edges = [0, *(np.flatnonzero(steps > longest) + 1).tolist(), len(times)]
    times = np.concatenate([_even_times(times[a:b]) for a, b in pairwise(edges)])
    if count := int((np.diff(times) <= 0.0).sum()):
        text = f"{name}: {count} of {len(times)} samples have the stamp of the one before"
        raise error(f"{text}, and are not even; record each sample with a time of its own.")
    return times, signals


def _even_times(times: FloatArray) -> FloatArray:
    """Return even times near coarse stamps or those of batches, (n,), s; others as they are."""
    from scipy.ndimage import uniform_filter1d

    steps = np.diff(times)
    step = float(steps.mean()) if len(steps) else 0.0
    if step == 0.0:
        return times
    unit = 10.0 ** math.ceil(math.log10(_COARSE * step))
    units, together = (times - times[0]) / unit, steps < _TOGETHER * step
    ends = np.append(np.flatnonzero(~together), len(steps))
    coarse = bool(np.abs(units - np.rint(units)).max() < _EXACT * step / unit)
    if len(ends) < _FEWEST:
        return times
    if together.mean() > _MANY or steps.min() == 0.0:
        within, places = step, np.arange(len(times))
    elif coarse and step > _COARSEST * unit:  # Longer steps show how many samples are lost.
        counts = np.maximum(np.rint(steps / step), 1.0)
        within, places = unit / 2.0, np.append(0, np.cumsum(counts)).astype(int)
    else:
        return times
    best, even = math.inf, times
    for at in (ends, np.append(0, ends[:-1] + 1)):
        slope, start = np.polyfit(places[at], times[at] - times[0], 1)
        off = times[at] - times[0] - start - slope * places[at]
        lost = uniform_filter1d(off, round(_LOST / step * len(at) / len(times)) | 1, mode="nearest")
        if off.std() < best - _FIRST * step and max(off.std(), np.abs(lost).max()) <= within:
            best, even = float(off.std()), times[0] + start + slope * places
    return times if best < _EXACT * step and not together.any() else even
