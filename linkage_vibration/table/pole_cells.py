# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds natural frequencies and damping ratios by reduced models, where cells have no cubics."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.modes import MECHANISM, oscillating_indices
from linkage_vibration.table.interpolation import stroke_angle, stroke_variable
from linkage_vibration.table.reduced import Modal, ReducedModels

FIRST_CELLS = 32  # Cells of a piece before any is halved


@dataclass(frozen=True, eq=False)
class PolePiece:
    """A piece of the stroke in which reduced models are interpolated."""

    alpha3: FloatArray  # (n,), rad, ascending: where they are known
    models: ReducedModels
    toggles: tuple[float, float] | None  # rad
    peak_band: tuple[float, float]  # Hz, in which the highest peak is sought

    @cached_property
    def variables(self) -> FloatArray:
        """The stroke variables of its points, (n,)."""
        return stroke_variable(self.alpha3, self.toggles)

    @cached_property
    def angles(self) -> FloatArray:
        """The ends of its first cells, (FIRST_CELLS + 1,), rad."""
        angles = stroke_angle(
            np.linspace(self.variables[0], self.variables[-1], FIRST_CELLS + 1), self.toggles
        )
        angles[[0, -1]] = self.alpha3[[0, -1]]
        return angles

    def modal(self, alpha3: FloatArray) -> Modal:
        """Return the poles and residues at angles, rad."""
        return self.models.at(self.variables, stroke_variable(alpha3, self.toggles)).modal

    def drive(self, alpha3: FloatArray) -> Modal:
        """Return the poles at angles, rad, and residues of the place of the highest peak alone."""
        return self._driven.at(self.variables, stroke_variable(alpha3, self.toggles)).modal

    @cached_property
    def _driven(self) -> ReducedModels:
        shapes, weights = self.models.shapes[:, :1], self.models.weights[:, :, :1]
        return replace(self.models, shapes=shapes, weights=weights, n_inputs=1)

    def evaluate(self, alpha3: FloatArray) -> tuple[list[ComplexArray], FloatArray]:
        """Return the oscillating poles (rad/s) at each of some angles, and the peaks, (n, 2)."""
        modal = self.drive(alpha3)
        return oscillating_rows(modal.frequencies), modal.highest(self.peak_band)


def oscillating(poles: ComplexArray) -> ComplexArray:
    """Return the poles that oscillate, of each pair the upper, (k,), rad/s, by magnitude."""
    return np.asarray(poles[oscillating_indices(poles)])


def oscillating_rows(poles: ComplexArray) -> list[ComplexArray]:
    """Return what `oscillating` returns of each row of poles, (n, order), rad/s."""
    size = np.abs(poles)
    upper = (poles.imag > 0.0) & (size >= MECHANISM)
    order = np.argsort(np.where(upper, size, math.inf), axis=1, kind="stable")
    rows = np.take_along_axis(poles, order, axis=1)
    return [row[:n] for row, n in zip(rows, upper.sum(axis=1).tolist(), strict=True)]


def values_of(poles: ComplexArray) -> FloatArray:
    """Return the natural frequencies (Hz) and damping ratios of poles (rad/s), (2, ...)."""
    size = np.abs(poles)
    return np.array([size / (2.0 * math.pi), -poles.real / size])


def nearest(poles: ComplexArray, other: ComplexArray) -> dict[int, int]:
    """Pair poles, (n,) and (m,), rad/s, by the least sum of squared distances: index to index."""
    pairs = scipy.optimize.linear_sum_assignment(np.abs(poles[:, np.newaxis] - other) ** 2)
    return dict(zip(pairs[0].tolist(), pairs[1].tolist(), strict=True))


def nearest_rows(poles: ComplexArray, other: ComplexArray) -> IntArray:
    """Return what `nearest` returns of each row of poles, both (n, k), as indices there, (n, k)."""
    if not poles.size:
        return np.zeros(poles.shape, dtype=np.intp)
    there: IntArray = np.abs(poles[:, :, np.newaxis] - other[:, np.newaxis]).argmin(axis=2)
    # Where two poles have the same nearest one, their sum of squares decides.
    shared = (np.sort(there, axis=1) != np.arange(poles.shape[1])).any(axis=1)
    for row in np.flatnonzero(shared).tolist():
        there[row] = list(nearest(poles[row], other[row]).values())
    return there


@dataclass(frozen=True, slots=True, eq=False)
class PoleFinder:
    """Finds values and slopes in cells that have no cubics."""

    pieces: Sequence[PolePiece]  # each begins where the one before it ends
    bounds: FloatArray  # (n_cells + 1,), rad: the ends of all cells
    rows: IntArray  # (n_cells,): for each cell without cubics its row of `poles`
    # (n_direct, 2, n_branches): poles at both ends of each of these, rad/s, those of the modes
    # first; NaN for a pole that oscillates at neither end
    poles: ComplexArray
    n_modes: int

    def values(self, cell: int, alpha3: float) -> list[float]:
        """Return frequencies (Hz) and ratios, NaN if overdamped, and the peak (Hz and m/N)."""
        start, end = self.bounds[cell : cell + 2].tolist()
        begins = [piece.alpha3[0] for piece in self.pieces]
        piece = self.pieces[int(np.searchsorted(begins, start, side="right")) - 1]
        poles, peaks = piece.evaluate(np.array([alpha3]))
        share, ends = (alpha3 - start) / (end - start), self.poles[self.rows[cell]]
        names = np.flatnonzero(~np.isnan(ends[0]))
        expected = (1.0 - share) * ends[0, names] + share * ends[1, names]
        row = np.full(2 * self.n_modes + 2, math.nan)
        for at, j in nearest(expected, poles[0]).items():
            if names[at] < self.n_modes:
                row[[names[at], self.n_modes + names[at]]] = values_of(poles[0][j])
        row[-2:] = peaks[0]
        return [float(value) for value in row]

    def slopes(self, cell: int, alpha3: float) -> list[float]:
        """Return the slopes of the same, per rad, by a difference."""
        start, end = self.bounds[cell : cell + 2].tolist()
        step = 1e-3 * (end - start)
        before, after = max(alpha3 - step, start), min(alpha3 + step, end)
        low, here, high = (np.array(self.values(cell, at)) for at in (before, alpha3, after))
        # Beside the angle at which a mode vanishes, only the side on which it exists counts.
        begin, low = np.where(np.isnan(low), alpha3, before), np.where(np.isnan(low), here, low)
        end, high = np.where(np.isnan(high), alpha3, after), np.where(np.isnan(high), here, high)
        slope = np.divide(high - low, end - begin, out=np.zeros_like(here), where=end > begin)
        return [float(value) for value in slope + 0.0 * here]  # NaN where the mode vanishes
