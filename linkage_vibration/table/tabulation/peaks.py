# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The highest peak: it may jump from one maximum to another, so both are tabulated.

A maximum of the drive-point receptance is smooth along the stroke while it exists. The highest of
several is not smooth where two of them exchange places, and no polynomial follows a maximum that
merges with another or vanishes.
"""

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.mechanics.response import RIVAL
from linkage_vibration.table.table import widened
from linkage_vibration.table.tabulation.accuracy import ROUNDING

SILENT = float(np.finfo(float).tiny)
"""m/N; a maximum that is not higher is ignored."""

_NOTABLE = 0.5  # A maximum below this share of the highest at the points is lower between them.
_SAME = 1e-3  # Two maxima of one height that are closer than this share of the band are one.


def heights(at: FloatArray, sizes: FloatArray, band: tuple[float, float]) -> FloatArray:
    """Return magnitudes (m/N) of maxima at some frequencies (Hz); -1 outside the band or if NaN."""
    low, high = widened(band)
    return np.where((low <= at) & (at <= high), sizes, -1.0)


def row_errors(
    rows: FloatArray, exact: FloatArray, n_modes: int, band: tuple[float, float], least: float = 0.0
) -> FloatArray:
    """Return the largest relative errors of values and of the highest peak, (2,).

    Rows are frequencies, damping ratios, and Hz and heights of maxima, of which exact rows may have
    more; ``least`` is a known error of the peak. At 0 Hz, the difference in Hz counts.
    """
    n = 2 * n_modes
    (at, sizes), (places, exact_sizes) = (np.hsplit(each[:, n:], 2) for each in (rows, exact))
    sizes, exact_sizes = heights(at, sizes, band), heights(places, exact_sizes, band)
    best = sizes.argmax(axis=1)[:, np.newaxis]
    at, size = (np.take_along_axis(each, best, 1) for each in (at, sizes))
    height = exact_sizes.max(axis=1, keepdims=True)
    error = max(least, float(np.abs(size / height - 1.0).max()))
    # Either of two peaks of one height, within the error, is the highest.
    rival = exact_sizes >= (1.0 - 2.0 * error - ROUNDING) * height
    apart = np.abs(at - places) / np.where(places > 0.0, places, 1.0)
    away = np.where(rival, apart, np.inf).min(axis=1)
    return np.array([np.abs(rows[:, :n] / exact[:, :n] - 1.0).max(), max(error, away.max())])


def notable(
    at: FloatArray, sizes: FloatArray, band: tuple[float, float], equal: float, strict: bool
) -> BoolArray | None:
    """Return which maxima, (n_peaks,), give the highest peak; None if they do not suffice.

    The arrays, (n, n_peaks), are NaN where one does not exist. As few as possible are chosen; if
    ``strict``, none is left out that may be the highest between points.
    """
    level, size = 1.0 - equal, heights(at, sizes, band)
    highest = size.max(axis=1, keepdims=True)
    whole = np.asarray(np.isfinite(sizes).all(axis=0))
    chosen = _cover((size >= level * highest) & whole)
    if chosen is None:
        return None

    def meets(row: int, peak: int) -> bool:
        """Return whether a maximum is close to one of those chosen, at a point."""
        near = np.abs(at[row, chosen] - at[row, peak]) <= _SAME * band[1]
        ratio = size[row, chosen] / max(size[row, peak], SILENT)
        return bool((near & (ratio >= level) & (ratio * level <= 1.0)).any())

    rivals = (size >= _NOTABLE * highest).any(axis=0)
    for other in np.flatnonzero(whole & rivals & ~chosen).tolist():
        # A maximum that merges with another is not smooth there, and elsewhere it is not higher.
        chosen[other] = not any(meets(row, other) for row in range(len(at)))
    left_out = np.argwhere((size >= RIVAL * highest) & ~chosen).tolist()
    if strict and not all(meets(row, peak) for row, peak in left_out):
        return None
    return chosen


def _cover(reached: BoolArray) -> BoolArray | None:
    """Choose columns, the fullest first, until each row is reached; None if that is impossible."""
    chosen = np.zeros(reached.shape[1], dtype=np.bool_)
    missing = np.ones(len(reached), dtype=np.bool_)
    while missing.any():
        # The ends of the band are last, and are smooth where a maximum merges with them.
        count = reached[missing].sum(axis=0)
        best = len(count) - 1 - int(count[::-1].argmax())
        if count[best] == 0:
            return None
        chosen[best] = True
        missing[reached[:, best]] = False
    return chosen
