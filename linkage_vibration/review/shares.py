# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Shares of the time of a drive at crank angles and load ratios."""

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.review.log import Log, durations

Shares = tuple[FloatArray, FloatArray]
"""The edges of bins, (n_bins + 1,), and the share of the time in each bin, (n_bins,).

The sum of the shares is 1 if every prediction has a number.
"""

_ANGLE_BINS, _LOAD_BINS = 45, 30
_LOAD_TOP = 0.6  # the last bin also holds all larger load ratios


def angle_shares(log: Log) -> Shares:
    """Return the shares of time over the crank angle, rad, of predictions that have numbers."""
    angles = np.where(np.isfinite(log.peak_magnitude), log.table_angle, np.nan)
    if log.table is not None:
        low, high = log.table.alpha3_range
    else:
        finite = angles[np.isfinite(angles)]
        low, high = (finite.min(), finite.max()) if len(finite) else (0.0, 1.0)
    return _shares(log, angles, np.linspace(low, max(high, low + 1e-6), _ANGLE_BINS + 1))


def load_shares(log: Log) -> Shares | None:
    """Return the shares of time over the total load ratio; None if it is never known."""
    if log.resonances is None or not np.isfinite(log.resonances.total_load_ratio).any():
        return None
    ratios = np.minimum(log.resonances.total_load_ratio, _LOAD_TOP * (1.0 - 1e-12))
    return _shares(log, ratios, np.linspace(0.0, _LOAD_TOP, _LOAD_BINS + 1))


def _shares(log: Log, values: FloatArray, edges: FloatArray) -> Shares:
    held = durations(log)
    total = float(held.sum()) or 1.0
    finite = np.isfinite(values)
    counts, _ = np.histogram(values[finite], edges, weights=held[finite])
    return edges, counts / total
