# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Cubic cells, by which a table looks up values and slopes.

Another method of interpolation is another class with the methods of `Cells`, which
`Table._lookup` then makes instead.
"""

from bisect import bisect_right
from collections.abc import Iterable

import numpy as np
from scipy.interpolate import CubicSpline

from linkage_vibration.mechanics.arrays import FloatArray


class Cells:
    """Values and slopes of k quantities at any angle, by a cubic spline over each piece.

    Numbers for one angle and for many are equal to the last bit.

    Parameters
    ----------
    pieces : iterable of (angles, values)
        Ends of the cells of each piece, (n + 1,), rad, and the values there, (n + 1, k). Each
        piece begins where the one before it ends.
    """

    def __init__(self, pieces: Iterable[tuple[FloatArray, FloatArray]]) -> None:
        splines = [CubicSpline(angles, values) for angles, values in pieces]
        self._starts = np.concatenate([spline.x[:-1] for spline in splines])
        # Highest power first, (n_cells, 4, k).
        cells = np.concatenate([spline.c.swapaxes(0, 1) for spline in splines])
        self._cells = np.ascontiguousarray(cells)
        # On so few numbers plain floats are three times as fast as arrays.
        self._plain: tuple[list[float], list[list[list[float]]]]
        self._plain = self._starts.tolist(), self._cells.swapaxes(1, 2).tolist()

    def values(self, alpha3: float) -> list[float]:
        """Return the k values at an angle in rad."""
        starts, cells = self._plain
        i = bisect_right(starts, alpha3) - 1
        t = alpha3 - starts[i]
        return [((c3 * t + c2) * t + c1) * t + c0 for c3, c2, c1, c0 in cells[i]]

    def slopes(self, alpha3: float) -> list[float]:
        """Return the k slopes at an angle in rad, per rad."""
        starts, cells = self._plain
        i = bisect_right(starts, alpha3) - 1
        t = alpha3 - starts[i]
        return [(3.0 * c3 * t + 2.0 * c2) * t + c1 for c3, c2, c1, _ in cells[i]]

    def many_values(self, alpha3: FloatArray) -> FloatArray:
        """Return the values at angles in rad, (n, k)."""
        cell, t = self._at(alpha3)
        return np.asarray(((cell[:, 0] * t + cell[:, 1]) * t + cell[:, 2]) * t + cell[:, 3])

    def many_slopes(self, alpha3: FloatArray) -> FloatArray:
        """Return the slopes at angles in rad, (n, k), per rad."""
        cell, t = self._at(alpha3)
        return np.asarray((3.0 * cell[:, 0] * t + 2.0 * cell[:, 1]) * t + cell[:, 2])

    def _at(self, alpha3: FloatArray) -> tuple[FloatArray, FloatArray]:
        i = np.maximum(np.searchsorted(self._starts, alpha3, side="right") - 1, 0)
        return self._cells[i], (alpha3 - self._starts[i])[:, np.newaxis]
