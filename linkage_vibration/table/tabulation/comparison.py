# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Bounds the errors of reduced models between the points, by those through fewer points."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.description import Response
from linkage_vibration.mechanics.response import reach, searched
from linkage_vibration.table.interpolation import stroke_angle, stroke_variable
from linkage_vibration.table.pole_cells import (
    FIRST_CELLS,
    PolePiece,
    oscillating,
    pole_piece,
    values_of,
)
from linkage_vibration.table.reduced import Modal, ReducedModels
from linkage_vibration.table.tabulation.accuracy import N_LINES, SILENT_SHARE, Accuracy, Bounds
from linkage_vibration.table.tabulation.cell_making import (
    CELL_ERROR,
    CELL_ROUNDING,
    Cell,
    make_cells,
)
from linkage_vibration.table.tabulation.subspaces import PoleSample

_FRF_ANGLES = 8  # FRFs are compared at so many angles of a piece.
_NEARLY_REAL = 1e-3  # A pole with a smaller share of imaginary part is nearly real.
_SLOPES = 101  # Slopes are compared at so many angles of a piece,
_STEP = 1e-4  # by differences over twice this share of the piece.
_EPS = 4.0 * float(np.finfo(float).eps)  # Eigenvalues are rounded by this share of the matrix.


def relative_errors(off: ComplexArray, exact: ComplexArray, n: int) -> FloatArray:
    """Return relative errors of FRFs in the L2 norm, (..., n_triangle), of n places.

    Differences and FRFs are (..., n_freq, n_triangle), the upper triangle row by row, m/N. A
    response that is only rounding has no relative error.
    """
    size, error = np.linalg.norm(exact, axis=-2), np.linalg.norm(off, axis=-2)
    upper = np.triu_indices(n)
    places = [i * n - i * (i - 1) // 2 for i in range(n)]
    drives = size[..., places]
    least = SILENT_SHARE * np.sqrt(drives[..., upper[0]] * drives[..., upper[1]])
    return np.asarray(error / np.maximum(np.maximum(size, least), np.finfo(float).tiny))


@dataclass(frozen=True, slots=True, eq=False)
class Polynomials:
    """Polynomials through the reduced models at some points."""

    variables: FloatArray  # (n,): stroke variables of the models
    models: ReducedModels
    toggles: tuple[float, float] | None  # rad
    response: Response  # band and number of modes of the table

    def modal(self, variables: FloatArray) -> Modal:
        """Return poles and residues at stroke variables."""
        return self.models.at(self.variables, variables).modal

    @property
    def piece(self) -> PolePiece:
        """What finds the poles and the peak anywhere in the piece."""
        angles = stroke_angle(self.variables, self.toggles)
        return pole_piece(angles, self.models, self.toggles, self.response.band)

    def rounding(self) -> float:
        """Return by how much rounding may change a frequency, ratio or resonance, relative."""
        at = np.linspace(self.variables[0], self.variables[-1], FIRST_CELLS + 1)
        models = self.models.at(self.variables, at)
        matrices = -np.linalg.solve(models.inertia, models.stiffness)
        poles, right = np.linalg.eig(matrices)
        left = models.inertia @ right
        scale = np.abs((left * right).sum(axis=1)) + np.finfo(float).tiny
        condition = np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=1) / scale
        moved = _EPS * np.linalg.norm(matrices, axis=(1, 2))[:, np.newaxis] * condition
        # Where two poles meet, rounding moves them with its square root.
        gaps = np.abs(poles[:, :, np.newaxis] - poles[:, np.newaxis])
        gaps = np.where(gaps > 0.0, gaps, math.inf).min(axis=2, initial=math.inf)
        moved = np.minimum(moved, np.sqrt(moved * gaps)) / np.abs(poles)
        worst = 0.0
        moved = moved if self.models.viscous else moved / 2.0  # of the square of a pole
        for all_poles, shift in zip(models.modal.frequencies, moved, strict=True):
            exact = self._compared(all_poles)
            exact = exact[exact.imag > _NEARLY_REAL * np.abs(exact)]
            nearest_poles = np.abs(exact[:, np.newaxis] - all_poles).argmin(axis=1)
            ratios = -exact.real / np.abs(exact)
            worst = max(
                worst, float(((shift[nearest_poles] + CELL_ROUNDING) / ratios).max(initial=0.0))
            )
        return worst

    def misses(
        self, variables: FloatArray, samples: Sequence[PoleSample], accuracy: Accuracy
    ) -> bool:
        """Return whether poles in reach differ too much from those of samples elsewhere."""
        pole_sets = self.modal(variables).frequencies
        for poles, sample in zip(pole_sets, samples, strict=True):
            exact = self._compared(sample.poles)
            if _pole_error(poles, exact) > accuracy.frequency:
                return True
        return False

    def _compared(self, poles: ComplexArray) -> ComplexArray:
        """Return those of the oscillating poles of which a table gives values or resonances."""
        upper = oscillating(poles)
        count = max(self.response.modes, int((np.abs(upper) < reach(self.response.band)).sum()))
        return upper[:count]


def _pole_error(poles: ComplexArray, exact: ComplexArray) -> float:
    """Return the largest relative error of frequency or ratio of some poles."""
    # Where two poles are about to become real, only the angle at which they do differs.
    exact = exact[exact.imag > _NEARLY_REAL * np.abs(exact)]
    if not len(exact):
        return 0.0
    poles = oscillating(poles)
    if not len(poles):
        return math.inf
    near = poles[np.abs(exact[:, np.newaxis] - poles).argmin(axis=1)]
    return float(np.abs(values_of(near) / values_of(exact) - 1.0).max())


def compare(
    coarse: Polynomials,
    fine: Polynomials,
    accuracy: Accuracy,
    far_error: float,
    rounding: float,
) -> tuple[Bounds, list[Cell]] | None:
    """Return by how much fewer points change a piece, and its cells; None if that is too much.

    Far poles cause the relative error ``far_error`` of FRFs; ``rounding`` is that of values.
    """
    grid = np.linspace(fine.variables[0], fine.variables[-1], FIRST_CELLS + 1)
    if _differ(coarse.modal(grid), fine.modal(grid), fine, accuracy) is None:
        return None  # before cells are made, which takes longer
    cells = make_cells(fine.piece)
    angles = np.array([[cell.start, (cell.start + cell.end) / 2.0] for cell in cells]).ravel()
    at = stroke_variable(angles, fine.toggles)
    coarse_modal, fine_modal = coarse.modal(at), fine.modal(at)
    differences = _differ(coarse_modal, fine_modal, fine, accuracy)
    if differences is None:
        return None
    shifts, peak = differences
    rows = {int(np.argmax(shifts)), *np.linspace(0, len(at) - 1, _FRF_ANGLES).astype(int).tolist()}
    rows = set() if fine_modal.free else rows  # such a table has no FRFs
    errors = [_frf_error(coarse_modal, fine_modal, row, fine.response.band) for row in rows]
    frf = max(errors, default=0.0) + far_error
    if frf > accuracy.frf:
        return None
    # The error of a cubic in its middle is a little more than half of its largest.
    rest = 2.0 * CELL_ERROR + rounding
    if max(shifts) + rest > accuracy.frequency:
        return None
    slope = _slope_error(coarse, fine) + _slope_jump(cells)
    return Bounds(max(shifts) + rest, peak + rest, frf + rounding, slope), cells


def _differ(
    coarse: Modal, modal: Modal, fine: Polynomials, accuracy: Accuracy
) -> tuple[list[float], float] | None:
    """Return the errors of poles at each angle and of the peak, or None if they are too large."""
    shifts = [
        _pole_error(poles, fine._compared(exact))
        for poles, exact in zip(coarse.frequencies, modal.frequencies, strict=True)
    ]
    if max(shifts) > accuracy.frequency:
        return None
    peak = _peak_error(coarse, modal, fine.response.band)
    return None if peak > accuracy.peak else (shifts, peak)


def _peak_error(coarse: Modal, fine: Modal, band: tuple[float, float]) -> float:
    """Return the largest relative difference of the highest peak at angles."""
    peaks = coarse.highest(0, band)
    rows, omega, size = fine.maxima(0, band)
    highest = np.zeros(len(peaks))
    np.maximum.at(highest, rows, size)
    off = np.abs(peaks[:, 1] / highest - 1.0)
    # Either of two peaks of one height, within the error, is the highest.
    rival = size >= (1.0 - 2.0 * off[rows]) * highest[rows]
    away = np.full(len(peaks), math.inf)
    places = omega / (2.0 * math.pi)
    apart_by = np.abs(peaks[rows, 0] - places) / np.maximum(places, 1e-6 * band[1])
    np.minimum.at(away, rows[rival], apart_by[rival])
    return float(np.maximum(off, away).max())


def _frf_error(coarse: Modal, fine: Modal, row: int, band: tuple[float, float]) -> float:
    """Return the largest relative difference of FRFs at an angle, L2 norm over the band."""
    n, poles = fine.shapes.shape[1], fine.frequencies[row]
    approximate, exact = (weighted_frf(each, row, band, poles) for each in (coarse, fine))
    return float(relative_errors(approximate - exact, exact, n).max())


def weighted_frf(
    modal: Modal, row: int, band: tuple[float, float], poles: ComplexArray | None = None
) -> ComplexArray:
    """Return FRFs at an angle, (n_freq, n_triangle), whose squares add up to those of the L2 norm.

    There are more lines near the given poles (rad/s), or near its own.
    """
    low, high = (2.0 * math.pi * end for end in searched(band, free=modal.free))
    poles = modal.frequencies[row] if poles is None else poles
    poles = poles[(poles.imag > 0.0) & (poles.imag < high)]
    near = poles.imag - np.multiply.outer(np.linspace(-2.0, 2.0, 9), poles.real)
    lines = np.unique(np.clip([*np.linspace(low, high, N_LINES), *near.ravel()], low, high))
    return np.asarray(np.sqrt(np.gradient(lines))[:, np.newaxis] * modal.frf(row, lines))


def _slope_error(coarse: Polynomials, fine: Polynomials) -> float:
    """Return the largest difference of a slope, relative to its frequency, 1/rad."""
    toggles, ends = fine.toggles, fine.variables[[0, -1]]
    step = _STEP * (ends[1] - ends[0])
    at = np.linspace(ends[0] + step, ends[1] - step, _SLOPES)
    both = np.column_stack([at - step, at + step]).ravel()
    coarse_poles, fine_poles = coarse.modal(both).frequencies, fine.modal(both).frequencies
    width = np.diff(stroke_angle(both, toggles).reshape(-1, 2), axis=1)[:, 0]
    worst = 0.0
    for i, apart in enumerate(width.tolist()):
        off = [
            _relative_shift(coarse_poles[j], fine._compared(fine_poles[j]))
            for j in (2 * i, 2 * i + 1)
        ]
        if len(off[0]) == len(off[1]) > 0:
            worst = max(worst, float(np.abs(off[1] - off[0]).max()) / apart)
    return worst


def _relative_shift(poles: ComplexArray, exact: ComplexArray) -> FloatArray:
    """Return the relative differences of the frequencies of some poles from the nearest others."""
    exact = exact[exact.imag > _NEARLY_REAL * np.abs(exact)]
    poles = oscillating(poles)
    if not len(poles) or not len(exact):
        return np.zeros(0)
    near = poles[np.abs(exact[:, np.newaxis] - poles).argmin(axis=1)]
    return np.asarray(np.abs(near) / np.abs(exact) - 1.0)


def _slope_jump(cells: Sequence[Cell]) -> float:
    """Return the largest jump of a slope from a cell to the next, relative, 1/rad."""
    worst = 0.0
    for cell, following in pairwise(cells):
        if (
            cell.values is None
            or following.values is None
            or len(cell.last) != len(following.first)
        ):
            continue
        frequency = cell.values[0].sum(axis=0)
        ends = (np.array([3.0, 2.0, 1.0]) @ cell.values[0, :3]) / (cell.end - cell.start)
        begins = following.values[0, 2] / (following.end - following.start)
        order = [
            int(np.abs(cell.last[cell.follows[j]] - following.first).argmin())
            for j in range(len(ends))
        ]
        worst = max(worst, float((np.abs(ends - begins[order]) / frequency).max(initial=0.0)))
    return worst
