# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Bounds the errors of reduced models between the points, by those through fewer points."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.description import Response
from linkage_vibration.mechanics.response import reach, searched
from linkage_vibration.table.interpolation import stroke_angle
from linkage_vibration.table.pole_cells import PolePiece, oscillating, values_of
from linkage_vibration.table.reduced import EVERY, Modal
from linkage_vibration.table.tabulation.accuracy import Accuracy, Bounds
from linkage_vibration.table.tabulation.cell_making import (
    CELL_ERROR,
    CELL_ROUNDING,
    Cell,
    make_cells,
)
from linkage_vibration.table.tabulation.frf_errors import frf_norms, worst_share
from linkage_vibration.table.tabulation.refinement import dense
from linkage_vibration.table.tabulation.subspaces import PoleSample

_FRF_ANGLES = 8  # FRFs are compared at so many angles of a piece.
_NEARLY_REAL = 1e-3  # A pole with a smaller share of imaginary part is nearly real.
_EPS = 4.0 * float(np.finfo(float).eps)  # Eigenvalues are rounded by this share of the matrix.
_CELL_SLOPE = 32.0  # The slope of a cubic is wrong by so many errors in its middle, over its width.


def rounding(piece: PolePiece, response: Response) -> float:
    """Return by how much rounding may change a frequency, ratio or resonance, relative."""
    modal = piece.modal(piece.angles)
    models = modal.models
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
    moved = moved if models.viscous else moved / 2.0  # of the square of a pole
    worst = 0.0
    for all_poles, shift in zip(modal.frequencies, moved, strict=True):
        exact = _not_real(_compared(all_poles, response))
        nearest_poles = np.abs(exact[:, np.newaxis] - all_poles).argmin(axis=1)
        shares = (shift[nearest_poles] + CELL_ROUNDING) / values_of(exact)[1]
        worst = max(worst, float(shares.max(initial=0.0)))
    return worst


def misses(
    piece: PolePiece, samples: Sequence[PoleSample], response: Response, accuracy: Accuracy
) -> bool:
    """Return whether poles in reach differ too much from those of samples elsewhere."""
    modal = piece.modal(np.array([sample.alpha3 for sample in samples]))
    errors = _pole_errors(modal.frequencies, [sample.poles for sample in samples], response)
    return _worst(errors) > accuracy.frequency


def _pole_errors(
    approximate: Iterable[ComplexArray], exact: Iterable[ComplexArray], response: Response
) -> list[FloatArray]:
    """Return the relative errors of the poles of which a table gives values, at each angle.

    Those of an angle are (2, k), of natural frequencies and of damping ratios, each of the nearest
    pole; they are infinite if no pole oscillates.
    """
    errors = []
    for poles, all_poles in zip(approximate, exact, strict=True):
        # Where two poles are about to become real, only the angle at which they do differs.
        wanted, candidates = _not_real(_compared(all_poles, response)), oscillating(poles)
        if len(wanted) and not len(candidates):
            errors.append(np.full((2, len(wanted)), math.inf))
            continue
        near = candidates[np.abs(wanted[:, np.newaxis] - candidates).argmin(axis=1)]
        errors.append(values_of(near) / values_of(wanted) - 1.0)
    return errors


def _compared(poles: ComplexArray, response: Response) -> ComplexArray:
    """Return those of the oscillating poles of which a table gives values or resonances."""
    upper = oscillating(poles)
    return upper[: max(response.modes, int((np.abs(upper) < reach(response.band)).sum()))]


def _not_real(poles: ComplexArray) -> ComplexArray:
    """Return the poles that are not nearly real."""
    return poles[poles.imag > _NEARLY_REAL * np.abs(poles)]


def compare(
    coarse: PolePiece,
    fine: PolePiece,
    response: Response,
    accuracy: Accuracy,
    far_error: float,
    rounding: float,
) -> tuple[Bounds, list[Cell]] | None:
    """Return by how much fewer points change a piece, and its cells; None if that is too much.

    Far poles cause the relative error ``far_error`` of FRFs; ``rounding`` is that of values.
    """
    all_over = stroke_angle(dense(fine.variables[0], fine.variables[-1])[::2], fine.toggles)
    errors = _pole_errors(
        coarse.modal(all_over).frequencies, fine.modal(all_over).frequencies, response
    )
    if _worst(errors) > accuracy.frequency:
        return None  # before cells are made, which takes longer
    cells = make_cells(fine)
    angles = np.array([[cell.start, (cell.start + cell.end) / 2.0] for cell in cells]).ravel()
    before, after = coarse.modal(angles), fine.modal(angles)
    off = [_worst([each]) for each in _pole_errors(before.frequencies, after.frequencies, response)]
    values = max(*off, _worst(errors))
    compared_band = searched(response.band, free=after.models.free)
    peak, frf = _peak_error(before, after, response.peak_band), far_error
    even = np.linspace(0, len(angles) - 1, _FRF_ANGLES).astype(int).tolist()
    for row in {int(np.argmax(off)), *even} if not after.models.free else ():
        approximate, exact = (each.frf(row, EVERY, EVERY) for each in (before, after))
        norms = frf_norms(approximate, exact, compared_band)
        frf = max(frf, far_error + worst_share(*norms))
    slope = max(
        np.abs(there - here)[0].max(initial=0.0) / step
        for (here, there), step in zip(pairwise(errors), np.diff(all_over), strict=True)
        if here.shape == there.shape
    )
    widths = [cell.end - cell.start for cell in cells if cell.values is not None]
    slope += _CELL_SLOPE * CELL_ERROR / min(widths, default=math.inf)
    # The error of a cubic in its middle is a little more than half of its largest.
    rest = 2.0 * CELL_ERROR + rounding
    bounds = Bounds(values + rest, peak + rest, frf + rounding, float(slope))
    return (bounds, cells) if bounds.meet(accuracy) else None


def _worst(errors: Sequence[FloatArray]) -> float:
    """Return the largest of the errors of poles."""
    return max(float(np.abs(each).max(initial=0.0)) for each in errors)


def _peak_error(coarse: Modal, fine: Modal, band: tuple[float, float]) -> float:
    """Return the largest relative difference of the highest peak at angles."""
    peaks = coarse.highest(band)
    rows, omega, size = fine.maxima(band)
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
