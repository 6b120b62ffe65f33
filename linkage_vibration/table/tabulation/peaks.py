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

SILENT = float(np.finfo(float).tiny)
"""m/N; a maximum that is not higher is ignored."""

_NOTABLE = 0.5  # of the highest: a maximum that is lower at the points is also lower between them
_SAME = 1e-3  # of the band: two maxima of one height that are so close are one


def heights(at: FloatArray, sizes: FloatArray, band: tuple[float, float]) -> FloatArray:
    """Return magnitudes of maxima within a band, and -1 for those outside or absent.

    Parameters
    ----------
    at, sizes, band
        Hz and m/N of the maxima, (..., n_peaks), NaN where there is none; Hz.
    """
    low, high = widened(band)
    return np.where((low <= at) & (at <= high), sizes, -1.0)


def apart(found: FloatArray | float, exact: FloatArray | float) -> FloatArray:
    """Return the relative difference of frequencies; that in Hz where the exact one is 0 Hz.

    Parameters
    ----------
    found, exact : ndarray or float
        Hz.
    """
    scale = np.abs(exact)
    return np.asarray(np.abs(found - exact) / np.where(scale > 0.0, scale, 1.0))


def notable(
    at: FloatArray, sizes: FloatArray, band: tuple[float, float], equal: float, strict: bool
) -> BoolArray | None:
    """Return which maxima, (n_peaks,), give the highest peak over some points of the stroke.

    A maximum can be used if it exists at every point. As few as possible are chosen, so that each
    point has its highest peak among them, and other maxima that are nearly as high. Returns None if
    the maxima that exist at every point do not suffice.

    Parameters
    ----------
    at, sizes : ndarray, (n, n_peaks)
        Hz and m/N of each maximum at each point; NaN where there is none. The band's ends are last.
    band, equal
        Hz; relative difference up to which two maxima are of one height.
    strict : bool
        Leave out no maximum that is nearly the highest at a point, and may be between points.
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
        # One that merges with another is not smooth there, and not higher than it elsewhere.
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
