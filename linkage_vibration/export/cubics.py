# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Fewer cells of cubics within limits."""

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray


def largest_sizes(cubics: FloatArray) -> FloatArray:
    """Return the largest magnitudes of cubics, (n, 4, k), where cells begin, (k,)."""
    return np.asarray(np.nanmax(np.abs(cubics[:, 3]), axis=0, initial=0.0))


def joined_cells(
    ends: FloatArray, cubics: FloatArray, limits: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the starts and the cubics of few cells that differ from each cell by limits, (k,).

    Neighbours are joined into a cell with their values and slopes at its ends. The ends are
    (n_cells + 1,), rad, and the cubics (n_cells, 4, k).
    """
    widths, first, starts, kept = np.diff(ends), 0, list[float](), list[FloatArray]()
    begin, end = _at(cubics, 0.0 * widths), _at(cubics, widths)
    while first < len(cubics):
        after, cubic = first + 1, cubics[first]
        while after < len(cubics):
            longer = _hermite(float(ends[after + 1] - ends[first]), begin[:, first], end[:, after])
            part, whole = slice(first, after + 1), np.array([longer] * (after + 1 - first))
            at = ends[part] - ends[first]
            off = _at(whole, at) - begin[:, part], _at(whole, at + widths[part]) - end[:, part]
            # A cubic lies within its coefficients in the basis of Bernstein.
            third = widths[part, np.newaxis] / 3.0
            (f0, d0), (f1, d1) = off
            if not (np.abs([f0, f0 + third * d0, f1 - third * d1, f1]) <= limits).all():
                break
            after, cubic = after + 1, longer
        starts.append(float(ends[first]))
        kept.append(cubic)
        first = after
    return np.array(starts), np.array(kept)


def _at(cubics: FloatArray, distances: FloatArray) -> FloatArray:
    """Return values and slopes, (2, n, k), of cubics, (n, 4, k), at distances from their starts."""
    t, (c3, c2, c1, c0) = distances[:, np.newaxis], cubics.swapaxes(0, 1)
    return np.array([((c3 * t + c2) * t + c1) * t + c0, (3.0 * c3 * t + 2.0 * c2) * t + c1])


def _hermite(h: float, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return cubics, (4, k), of a width with values and slopes, (2, k), at both ends."""
    (f0, d0), (f1, d1) = begin, end
    mean = (f1 - f0) / h
    return np.array([(d0 + d1 - 2.0 * mean) / h**2, (3.0 * mean - 2.0 * d0 - d1) / h, d0, f0])
