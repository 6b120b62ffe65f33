# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Fewer cells of cubics within limits."""

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray

_SAME = 1e-6  # of the largest value: a larger step between two cells is a jump


def moved(cubics: FloatArray, shifts: FloatArray) -> FloatArray:
    """Return cubics, (n, 4, k), expanded about starts that are larger by shifts, (n,)."""
    shift = shifts[:, np.newaxis]
    c3, c2, c1, c0 = cubics.swapaxes(0, 1)
    slope = c1 + (2.0 * c2 + 3.0 * c3 * shift) * shift
    return np.stack(
        [c3, c2 + 3.0 * c3 * shift, slope, c0 + (c1 + (c2 + c3 * shift) * shift) * shift], axis=1
    )


def extremes(cubics: FloatArray, widths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest value of cubics, (n, 4, k), from 0 to widths, (n,).

    They are at the ends or where the slope is zero.
    """
    c3, c2, c1, _ = cubics.swapaxes(0, 1)
    with np.errstate(all="ignore"):
        root = np.sqrt(c2 * c2 - 3.0 * c3 * c1)
        q = -(c2 + np.copysign(root, c2))
        flat = np.nan_to_num(np.stack([q / (3.0 * c3), c1 / q]), posinf=0.0, neginf=0.0)
    width = widths[:, np.newaxis]
    at = [0.0 * c3, width + 0.0 * c3, *np.clip(flat, 0.0, width)]
    values = np.stack([_value(cubics, t) for t in at])
    return values.min(axis=0), values.max(axis=0)


def largest_sizes(cubics: FloatArray) -> FloatArray:
    """Return the largest magnitudes of cubics, (n, 4, k), where cells begin, (k,)."""
    return np.asarray(np.nanmax(np.abs(cubics[:, 3]), axis=0, initial=0.0))


def _value(cubics: FloatArray, t: FloatArray) -> FloatArray:
    """Return the values of cubics, (n, 4, k), at distances from their starts, (n, k)."""
    c3, c2, c1, c0 = cubics.swapaxes(0, 1)
    return np.asarray(((c3 * t + c2) * t + c1) * t + c0)


def joined_cells(
    ends: FloatArray, cubics: FloatArray, limits: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the starts and the cubics of as few cells as limits, (k,), allow.

    Neighbours are joined into a cell with their values and slopes at its ends. The ends are
    (n_cells + 1,), rad, and the cubics (n_cells, 4, k).
    """
    joiner, starts, kept, first = _Joiner(ends, cubics, limits), [], [], 0
    while first < len(cubics):
        after = joiner.longest(first)
        starts.append(ends[first])
        kept.append(cubics[first] if after == first + 1 else joiner.cubic(first, after))
        first = after
    return np.array(starts), np.array(kept)


class _Joiner:
    """Joins cells that begin at angles and end at the next; the last of these ends the last cell.

    A joined cell may differ from each cell by limits, (k,).
    """

    def __init__(self, ends: FloatArray, cubics: FloatArray, limits: FloatArray) -> None:
        self._ends, self._cubics, self._limits = ends, cubics, limits
        self._widths = np.diff(ends)
        self._first = cubics[:, 3], cubics[:, 2]  # values and slopes where each cell begins
        last = moved(cubics, self._widths)
        self._last = last[:, 3], last[:, 2]
        with np.errstate(invalid="ignore"):
            step = np.abs(self._first[0][1:] - self._last[0][:-1])
        unequal = np.isnan(self._first[0][1:]) != np.isnan(self._last[0][:-1])
        self._joins = ~(unequal | (step > _SAME * largest_sizes(cubics))).any(axis=1)

    def longest(self, first: int) -> int:
        """Return the cell after the longest joined cell that begins with this cell."""
        breaks = np.flatnonzero(~self._joins[first:])
        end = first + 1 + int(breaks[0]) if len(breaks) else len(self._cubics)
        after = first + 1
        while after < end and self._holds(first, after + 1):
            after += 1
        return after

    def cubic(self, first: int, after: int) -> FloatArray:
        """Return the cubics, (4, k), with the values and slopes of cells at both ends.

        The cells are those from ``first`` to the one before ``after``.
        """
        h = float(self._ends[after] - self._ends[first])
        f0, d0 = (ends[first] for ends in self._first)
        f1, d1 = (ends[after - 1] for ends in self._last)
        mean = (f1 - f0) / h
        return np.array([(d0 + d1 - 2.0 * mean) / h**2, (3.0 * mean - 2.0 * d0 - d1) / h, d0, f0])

    def _holds(self, first: int, after: int) -> bool:
        """Return whether the joined cell agrees with the cells."""
        shifts = self._ends[first:after] - self._ends[first]
        whole = np.repeat(self.cubic(first, after)[np.newaxis], len(shifts), axis=0)
        off = moved(whole, shifts) - self._cubics[first:after]
        low, high = extremes(off, self._widths[first:after])
        return not (np.maximum(-low, high) > self._limits).any()
