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

_NOTABLE = 0.5  # A maximum below this share of the highest at the points is lower between them.
_SAME = 1e-3  # Two maxima of one height that are closer than this share of the band are one.


def heights(at: FloatArray, sizes: FloatArray, band: tuple[float, float]) -> FloatArray:
    """Return magnitudes (m/N) of maxima at some frequencies (Hz); -1 outside the band or if NaN."""
    low, high = widened(band)
    return np.where((low <= at) & (at <= high), sizes, -1.0)


def apart(frequencies: FloatArray | float, exact: FloatArray | float) -> FloatArray:
    """Return the relative difference of frequencies; that in Hz where the exact one is 0 Hz."""
    scale = np.abs(exact)
    return np.asarray(np.abs(frequencies - exact) / np.where(scale > 0.0, scale, 1.0))


def notable(
    at: FloatArray, sizes: FloatArray, band: tuple[float, float], equal: float, strict: bool
) -> BoolArray | None:
    """Return which maxima, (n_peaks,), give the highest peak over n points of the stroke.

    A maximum can be used if it exists at every point; the arrays, (n, n_peaks), are NaN where it
    does not. As few as possible are chosen, so that each point has its highest peak among them, and
    other maxima that are nearly as high. Returns None if the maxima that exist at every point do
    not suffice. If ``strict``, none is left out that is nearly the highest at a point, and may be
    between points.
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
