# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds the moments of resonance in a log, and the shares of time at angles and margins."""

from dataclasses import dataclass

import numpy as np

from linkage_vibration.drawing.intervals import runs
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.resonance import ResonanceState
from linkage_vibration.review.log import Log, durations

Shares = tuple[FloatArray, FloatArray]
"""The edges of bins, (n_bins + 1,), and the share of the time in each bin, (n_bins,).

The sum of the shares is 1 if every prediction has a number.
"""

MAX_MOMENTS = 1000
_ANGLE_BINS, _MARGIN_BINS = 45, 25
_MARGIN_TOP = 0.5  # relative; the last bin also holds all larger margins


@dataclass(frozen=True, slots=True)
class Moment:
    """One warning: a period in which an excitation was near a natural frequency."""

    start: float  # s since the first stamp
    end: float  # s since the first stamp
    first: int  # prediction
    last: int  # prediction
    nearest: int  # prediction with the smallest margin; the numbers below are those at it
    excitation: str  # name
    mode: int  # index of the natural frequency, counted from 0
    excitation_frequency: float  # Hz
    natural_frequency: float  # Hz
    relative_margin: float  # excitation frequency less natural frequency, over the latter, 1
    crossed: bool  # whether the excitation frequency crossed the natural frequency


def moments(log: Log) -> list[Moment]:
    """Return each run of warnings about the same excitation and mode, in order of time."""
    resonances = log.resonances
    if resonances is None:
        return []
    times, result = log.times, []
    one_pass = np.searchsorted(log.passes, np.arange(len(times)), side="right")
    about_what = (resonances.excitation, resonances.mode, one_pass)
    for start, end in runs(resonances.state == ResonanceState.WARNING, *about_what):
        margins = resonances.relative_margin[start:end]
        nearest = start + int(np.abs(margins).argmin())
        period = float(times[start]), float(times[end - 1]), start, end - 1
        about = str(resonances.excitation[nearest]), int(resonances.mode[nearest])
        at = (
            resonances.excitation_frequency,
            resonances.natural_frequency,
            resonances.relative_margin,
        )
        excitation_frequency, natural, margin = (float(column[nearest]) for column in at)
        crossed = bool(margins.min() <= 0.0 <= margins.max())
        result.append(
            Moment(*period, nearest, *about, excitation_frequency, natural, margin, crossed)
        )
    return result


def worst(all_moments: list[Moment]) -> list[Moment]:
    """Return the `MAX_MOMENTS` moments with the smallest margins, in order of time."""
    kept = sorted(all_moments, key=lambda moment: abs(moment.relative_margin))[:MAX_MOMENTS]
    return sorted(kept, key=lambda moment: moment.start)


def angle_shares(log: Log) -> Shares:
    """Return the shares of time over the crank angle, rad, of predictions that have numbers."""
    angles = np.where(np.isfinite(log.peak_magnitude), log.table_angle, np.nan)
    if log.table is not None:
        low, high = log.table.alpha3_range
    else:
        finite = angles[np.isfinite(angles)]
        low, high = (finite.min(), finite.max()) if len(finite) else (0.0, 1.0)
    return _shares(log, angles, np.linspace(low, max(high, low + 1e-6), _ANGLE_BINS + 1))


def margin_shares(log: Log) -> Shares | None:
    """Return the shares of time over the relative margin of the nearest excitation."""
    if log.resonances is None:
        return None
    margins = np.minimum(np.abs(log.resonances.relative_margin), _MARGIN_TOP * (1.0 - 1e-12))
    return _shares(log, margins, np.linspace(0.0, _MARGIN_TOP, _MARGIN_BINS + 1))


def _shares(log: Log, values: FloatArray, edges: FloatArray) -> Shares:
    held = durations(log)
    total = float(held.sum()) or 1.0
    finite = np.isfinite(values)
    counts, _ = np.histogram(values[finite], edges, weights=held[finite])
    return edges, counts / total
