# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The highest peak: a jump from one maximum to another is told by tabulating both.

A maximum of the drive-point receptance is smooth along the stroke while it is there; the highest
of several is not, where two of them swap, and no polynomial follows a maximum that merges with
another or vanishes.
"""

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.response import RIVAL
from linkage_vibration.table.table import widened

FloatArray = NDArray[np.float64]

SILENT = float(np.finfo(float).tiny)
"""m/N; a maximum that is no higher is none."""

_NOTABLE = 0.5  # of the highest: a maximum that is lower at the points is so between them too
_SAME = 1e-3  # of the band: two maxima of one height that are this near are one


def heights(at: FloatArray, sizes: FloatArray, band: tuple[float, float]) -> FloatArray:
    """Return magnitudes of maxima within a band, -1 of those that are outside or not there."""
    low, high = widened(band)
    return np.where((low <= at) & (at <= high), sizes, -1.0)


def apart(found: FloatArray | float, exact: FloatArray | float) -> FloatArray:
    """Relative difference of frequencies; in Hz from one of 0 Hz, an end of the band."""
    scale = np.abs(exact)
    return np.asarray(np.abs(found - exact) / np.where(scale > 0.0, scale, 1.0))


def notable(
    at: FloatArray, sizes: FloatArray, band: tuple[float, float], equal: float, strict: bool
) -> NDArray[np.bool_] | None:
    """Which maxima tell the highest peak over some points of the stroke.

    A maximum serves if it is there at every point. As few as can be are taken, so that each point
    has its highest peak among them, and others that come near to it.

    Parameters
    ----------
    at, sizes : ndarray, (n, n_peaks)
        Hz and m/N of each maximum at each point; NaN where there is none. The band's ends last.
    band : tuple of float
        Hz.
    equal : float
        Relative difference up to which two maxima are of one height.
    strict : bool
        Leave out none that nearly is the highest at a point, and might be between points.

    Returns
    -------
    ndarray of bool, (n_peaks,), or None
        None if maxima that are there all along do not suffice.
    """
    level, size = 1.0 - equal, heights(at, sizes, band)
    highest = size.max(axis=1, keepdims=True)
    whole = np.asarray(np.isfinite(sizes).all(axis=0))
    chosen = _cover((size >= level * highest) & whole)
    if chosen is None:
        return None

    def meets(row: int, peak: int) -> bool:
        """Whether a maximum is one of those chosen, or as good as one, at a point."""
        near = np.abs(at[row, chosen] - at[row, peak]) <= _SAME * band[1]
        ratio = size[row, chosen] / max(size[row, peak], SILENT)
        return bool((near & (ratio >= level) & (ratio * level <= 1.0)).any())

    rivals = (size >= _NOTABLE * highest).any(axis=0)
    for other in np.flatnonzero(whole & rivals & ~chosen).tolist():
        # One that runs into another is not smooth there, and not higher than that elsewhere.
        chosen[other] = not any(meets(row, other) for row in range(len(at)))
    left_out = np.argwhere((size >= RIVAL * highest) & ~chosen).tolist()
    if strict and not all(meets(row, peak) for row, peak in left_out):
        return None
    return chosen


def _cover(reached: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    """Choose columns, the fullest first, until each row is reached by one; None if some is not."""
    chosen = np.zeros(reached.shape[1], dtype=np.bool_)
    missing = np.ones(len(reached), dtype=np.bool_)
    while missing.any():
        # The band's ends stand last, and are smooth where a maximum runs into them.
        count = reached[missing].sum(axis=0)
        best = len(count) - 1 - int(count[::-1].argmax())
        if count[best] == 0:
            return None
        chosen[best] = True
        missing[reached[:, best]] = False
    return chosen
