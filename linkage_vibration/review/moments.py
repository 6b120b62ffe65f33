# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Moments of resonance, and the shares of time that a drive spent where."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.drawing.intervals import runs
from linkage_vibration.prediction.resonance import ResonanceState
from linkage_vibration.review.log import Log, durations

FloatArray = NDArray[np.float64]

MAX_MOMENTS = 1000
_ANGLE_BINS, _MARGIN_BINS = 45, 25
_MARGIN_TOP = 0.5  # relative; whatever is larger goes into the last bin


@dataclass(frozen=True, slots=True)
class Moment:
    """An excitation near a natural frequency, from when the warning began until it ended.

    Attributes
    ----------
    start, end : float
        s since the first stamp.
    nearest : int
        Index of the prediction at which they were nearest.
    excitation : str
        Its name.
    mode : int
        Index of the natural frequency.
    excitation_frequency, natural_frequency : float
        There, Hz.
    relative_margin : float
        There, 1.
    crossed : bool
        Whether one passed the other.
    """

    start: float
    end: float
    nearest: int
    excitation: str
    mode: int
    excitation_frequency: float
    natural_frequency: float
    relative_margin: float
    crossed: bool


@dataclass(frozen=True, slots=True, eq=False)
class Shares:
    """For which share of the time a quantity was where.

    Attributes
    ----------
    edges : ndarray, (n_bins + 1,)
        rad, or 1.
    shares : ndarray, (n_bins,)
        Of the time of all predictions; they add up to 1 less the share without a number.
    """

    edges: FloatArray
    shares: FloatArray


def moments(log: Log) -> list[Moment]:
    """Return each stretch of warnings about the same excitation and mode, in order of time."""
    found = log.resonances
    if found is None:
        return []
    times = log.times
    warning = found.state == ResonanceState.WARNING
    result = []
    for start, end in runs(warning, found.excitation, found.mode):
        margins = found.relative_margin[start:end]
        nearest = start + int(np.abs(margins).argmin())
        result.append(
            Moment(
                float(times[start]),
                float(times[end - 1]),
                nearest,
                str(found.excitation[nearest]),
                int(found.mode[nearest]),
                float(found.excitation_frequency[nearest]),
                float(found.natural_frequency[nearest]),
                float(found.relative_margin[nearest]),
                bool(margins.min() <= 0.0 <= margins.max()),
            )
        )
    return result


def worst(found: list[Moment]) -> list[Moment]:
    """Return at most `MAX_MOMENTS` of them, those with the smallest margins, in order of time."""
    kept = sorted(found, key=lambda moment: abs(moment.relative_margin))[:MAX_MOMENTS]
    return sorted(kept, key=lambda moment: moment.start)


def angle_shares(log: Log) -> Shares:
    """Return the time shares over the crank angle, rad, within the range that has numbers."""
    angles = np.where(np.isfinite(log.natural_frequencies[:, 0]), log.crank_angle, np.nan)
    if log.table is not None:
        low, high = log.table.alpha3_range
    else:
        known = angles[np.isfinite(angles)]
        low, high = (known.min(), known.max()) if len(known) else (0.0, 1.0)
    return _shares(log, angles, np.linspace(low, max(high, low + 1e-6), _ANGLE_BINS + 1))


def margin_shares(log: Log) -> Shares | None:
    """Return the time shares over the distance to the nearest excitation, relative."""
    if log.resonances is None:
        return None
    margins = np.minimum(np.abs(log.resonances.relative_margin), _MARGIN_TOP * (1.0 - 1e-12))
    return _shares(log, margins, np.linspace(0.0, _MARGIN_TOP, _MARGIN_BINS + 1))


def _shares(log: Log, values: FloatArray, edges: FloatArray) -> Shares:
    held = durations(log)
    total = float(held.sum()) or 1.0
    known = np.isfinite(values)
    counts, _ = np.histogram(values[known], edges, weights=held[known])
    return Shares(edges, counts / total)
