# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Cubic cells, by which a table looks up values and slopes."""

from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.table.pole_cells import PoleFinder


class Cells:
    """Values and slopes of k quantities at any angle, by a cubic polynomial in each cell.

    Cells begin at ``starts``, (n_cells,), rad, from which ``cubics``, (n_cells, 4, k), count,
    highest power first; where the constant is infinite, the finder is asked.
    """

    def __init__(
        self, starts: FloatArray, cubics: FloatArray, finder: PoleFinder | None = None
    ) -> None:
        self._starts, self._cells = starts, np.ascontiguousarray(cubics)
        self._direct = np.asarray(np.isposinf(self._cells[:, 3]).any(axis=1))
        self._finder = finder

    @cached_property
    def _plain(self) -> tuple[list[float], list[list[list[float]] | None]]:
        """Starts and cubics as plain floats, which for one angle are three times as fast."""
        plain: list[list[list[float]] | None] = self._cells.swapaxes(1, 2).tolist()
        for i in np.flatnonzero(self._direct).tolist():
            plain[i] = None
        return self._starts.tolist(), plain

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """The starts and the cubics of the cells."""
        return self._starts, self._cells

    def values(self, alpha3: float) -> list[float]:
        """Return the k values at an angle in rad."""
        cell, t = self._cell(alpha3)
        if cell is None:
            return list(self.many_values(np.array([alpha3]))[0].tolist())
        return [((c3 * t + c2) * t + c1) * t + c0 for c3, c2, c1, c0 in cell]

    def slopes(self, alpha3: float) -> list[float]:
        """Return the k slopes at an angle in rad, per rad."""
        cell, t = self._cell(alpha3)
        if cell is None:
            return list(self.many_slopes(np.array([alpha3]))[0].tolist())
        return [(3.0 * c3 * t + 2.0 * c2) * t + c1 for c3, c2, c1, _ in cell]

    def many_values(self, alpha3: FloatArray) -> FloatArray:
        """Return the values at angles in rad, (n, k)."""
        i, cell, t = self._at(alpha3)
        values = ((cell[:, 0] * t + cell[:, 1]) * t + cell[:, 2]) * t + cell[:, 3]
        return self._completed(values, i, alpha3, slopes=False)

    def many_slopes(self, alpha3: FloatArray) -> FloatArray:
        """Return the slopes at angles in rad, (n, k), per rad."""
        i, cell, t = self._at(alpha3)
        slopes = (3.0 * cell[:, 0] * t + 2.0 * cell[:, 1]) * t + cell[:, 2]
        return self._completed(slopes, i, alpha3, slopes=True)

    def _completed(
        self, numbers: FloatArray, cells: IntArray, alpha3: FloatArray, *, slopes: bool
    ) -> FloatArray:
        """Return numbers at angles, (n, k), with those of the finder where cells lack cubics."""
        for row in np.flatnonzero(self._direct[cells]):
            assert self._finder is not None
            find = self._finder.slopes if slopes else self._finder.values
            without = np.isposinf(self._cells[cells[row], 3])
            numbers[row, without] = np.array(find(int(cells[row]), float(alpha3[row])))[without]
        return numbers

    def _cell(self, alpha3: float) -> tuple[list[list[float]] | None, float]:
        starts, cells = self._plain
        i = bisect_right(starts, alpha3, 1) - 1  # the first angle may round below its cell
        return cells[i], alpha3 - starts[i]

    def _at(self, alpha3: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        i = np.maximum(np.searchsorted(self._starts, alpha3, side="right") - 1, 0)
        return i, self._cells[i], (alpha3 - self._starts[i])[:, np.newaxis]


class JoinedCells(Cells):
    """Cells that begin where those of any part do; ``columns`` of all quantities are kept."""

    def __init__(self, parts: Sequence[Cells], columns: IntArray) -> None:
        starts = np.unique(np.concatenate([part.arrays[0] for part in parts]))
        shifted = []
        for own, cubics in (part.arrays for part in parts):
            i = np.maximum(np.searchsorted(own, starts, side="right") - 1, 0)
            t, (c3, c2, c1, c0) = (starts - own[i])[:, np.newaxis], cubics[i].swapaxes(0, 1)
            c1, value = (3.0 * c3 * t + 2.0 * c2) * t + c1, ((c3 * t + c2) * t + c1) * t + c0
            value = np.where(np.isposinf(c0), c0, value)
            shifted.append(np.stack([c3, 3.0 * c3 * t + c2, c1, value], axis=1))
        super().__init__(starts, np.concatenate(shifted, axis=2)[..., columns])
        self._parts, self._columns = parts, columns

    def _completed(
        self, numbers: FloatArray, cells: IntArray, alpha3: FloatArray, *, slopes: bool
    ) -> FloatArray:
        at = np.flatnonzero(self._direct[cells])
        if len(at):
            found = [
                p.many_slopes(alpha3[at]) if slopes else p.many_values(alpha3[at])
                for p in self._parts
            ]
            numbers[at] = np.hstack(found)[:, self._columns]
        return numbers
