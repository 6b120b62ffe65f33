# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Refines pieces of a table.

The errors of reduced models between the points are bounded by those through fewer points.
"""

import math
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.description import Response
from linkage_vibration.mechanics.response import far_poles, peak_search_band, reach
from linkage_vibration.table.interpolation import (
    interpolation_matrix,
    stroke_angle,
    stroke_variable,
)
from linkage_vibration.table.pole_cells import PolePiece, oscillating, oscillating_rows, values_of
from linkage_vibration.table.reduced import EVERY, Modal, ReducedModels, frf_pairs, shortened
from linkage_vibration.table.tabulation.accuracy import CELL_SHARE, MARGIN, Accuracy, Bounds
from linkage_vibration.table.tabulation.cell_making import CELL_ROUNDING, Cell, make_cells
from linkage_vibration.table.tabulation.frf_errors import frf_norms, worst_shares
from linkage_vibration.table.tabulation.refinement import GRID, MOST, dense, more_points
from linkage_vibration.table.tabulation.sampling import Rounding, Sampler
from linkage_vibration.table.tabulation.subspaces import (
    N_CHECK,
    N_FAR,
    N_FIT,
    PoleSample,
    Set,
    Subspace,
    check_lines,
    continue_set,
)

_NARROW = 64  # A step below this part of a piece is not halved to distinguish poles.
_LONG = 0.01  # In pieces above this share of the stroke, each identified mode exists everywhere.
_END = 1.0 / 200.0  # In this share of the band, at its end, far poles are least accurate.
_BETWEEN = 24  # If poles need more points to be followed, the piece is halved.
_NEARLY_REAL = 1e-3  # A pole with a smaller share of imaginary part is nearly real.
_EPS = 4.0 * float(np.finfo(float).eps)  # Eigenvalues are rounded by this share of the matrix.
_SLOPE_ROUNDING = (
    4.0  # With this factor, no slope in `benchmark.bounds` is off by more than its bound.
)
# By the remainder of a cubic through four even points, its slope at an end is off by this number of
# errors of its value in the middle, over its width: (2 / 9) / (1 / 144).
_CELL_SLOPE = 32.0


@dataclass(frozen=True, slots=True, eq=False)
class RefinedPiece:
    """A piece of the stroke that meets the tolerance."""

    points: list[float]  # its stroke variables
    piece: PolePiece
    bounds: Bounds
    cells: list[Cell]


def _needed(sample: PoleSample, response: Response, most: int) -> Set:
    """Return the indices of the poles in reach of the band, and of the lowest modes.

    At most the lowest of a number of poles are returned.
    """
    poles = sample.poles
    wanted = np.abs(poles) < reach(response.band)
    upper = oscillating(poles)
    for pole in upper[: response.modes]:
        wanted |= np.abs(np.abs(poles) - abs(pole)) <= 1e-9 * abs(pole)
    lowest = np.argsort(np.abs(poles), kind="stable")[:most]
    return frozenset(lowest[wanted[lowest]].tolist())


def _follow(sampler: Sampler, points: list[float]) -> dict[float, Set] | None:
    """Find the poles that make up one smooth subspace over a piece, at each of its points.

    Points are added where the steps are too long to follow it. It returns indices by the stroke
    variables of the points, or None if the piece must be halved.
    """
    points, base = list(points), len(points) // 2
    most, response = len(points) + _BETWEEN, sampler.response
    counts = {len(sampler.at(x).poles) for x in points} if sampler.measured else {sys.maxsize}
    if len(counts) > 1 and points[-1] - points[0] > _LONG * sampler.length:
        return None
    least = min(counts)  # Modes that are identified at some angles only are left out.
    start = _needed(sampler.at(points[base]), response, least)
    while len(points) < most:
        sets: dict[float, Set] = {points[base]: start}
        for i in (*range(base + 1, len(points)), *range(base - 1, -1, -1)):
            before = points[i - 1 if i > base else i + 1]
            sample, set_there = sampler.at(points[i]), sets[before]
            here = sampler.at(before).subspace(set_there)
            chosen, clear, rival = continue_set(here, sample, len(set_there))
            sets[points[i]] = chosen
            missing = _needed(sample, response, least) - chosen
            if clear and not missing:
                continue
            step = abs(points[i] - before)
            if not clear and step > (points[-1] - points[0]) / _NARROW:
                points = sorted([*points, (points[i] + before) / 2.0])
                base, start = points.index(before), set_there
            elif not clear and not rival:
                return None
            else:
                start = chosen | (missing if clear else rival)
                base = i
            break
        else:
            return sets
    return None


def refine(sampler: Sampler, fitted: list[float], accuracy: Accuracy) -> RefinedPiece | str:
    """Add points until poles, peaks and FRFs of the reduced models meet the tolerance.

    It returns the piece, or the reason why it must be halved.
    """
    response = sampler.response
    while len(fitted) <= MOST:
        finer = sorted(fitted + more_points(fitted))
        sampler.prepare(finer)
        sets = _follow(sampler, finer)
        if sets is None:
            return "a pole in reach of the band cannot be distinguished from others"
        samples, chosen = [sampler.at(x) for x in finer], [sets[x] for x in finer]
        spaces = [sample.subspace(each) for sample, each in zip(samples, chosen, strict=True)]
        left = spaces[len(spaces) // 2].left  # one basis for all points
        try:
            spaces = [space.on(left) for space in spaces]
        except np.linalg.LinAlgError:
            return "the shapes of the poles change too quickly"
        near = _near_models(sampler, samples, spaces)
        kept, fine = np.isin(finer, fitted), _piece(sampler, finer, near)
        fewer = near.at(fine.variables, fine.variables[kept])
        others = [sample for sample, known in zip(samples, kept, strict=True) if not known]
        if not misses(_piece(sampler, fitted, fewer), others, response, accuracy):
            fine = replace(fine, models=_with_far(sampler, samples, chosen, near))
            fewer = fine.models.at(fine.variables, fine.variables[kept])
            coarse = _piece(sampler, fitted, fewer)
            values, alpha3 = rounding(fine, response)
            values += sampler.rounding(finer).values
            sampler.refuse_rounding(Rounding(values), alpha3, accuracy, 1.0 / 2.0)
            # A table of identified modes has no FRFs.
            exact = [] if sampler.measured else samples
            rounded = Rounding(values, sampler.rounding(finer).frf if exact else 0.0)
            compared = compare(
                coarse, fine, response, accuracy, exact, rounded, len(sampler.outputs)
            )
            if compared is not None:
                return RefinedPiece(finer, fine, *compared)
        fitted = finer
    return f"the poles or the peak change too quickly for a tolerance of {accuracy.frequency:g}"


def _piece(sampler: Sampler, variables: list[float], models: ReducedModels) -> PolePiece:
    """Return a piece with the reduced models at stroke variables."""
    alpha3 = np.array([sampler.angle(x) for x in variables])
    return PolePiece(alpha3, models, sampler.toggles, sampler.response.peak_band)


def _near_models(
    sampler: Sampler, samples: Sequence[PoleSample], spaces: Sequence[Subspace]
) -> ReducedModels:
    """Return the reduced models at the points of a piece, without far poles."""
    return ReducedModels(
        inertia=np.array([space.inertia for space in spaces]),
        stiffness=np.array([space.stiffness for space in spaces]),
        shapes=np.array([space.shapes for space in spaces]),
        weights=np.zeros((len(spaces), 1, 0)),
        far_stiffness=np.empty(0, complex),
        far_decay=np.empty(0),
        n_inputs=len(spaces[0].shapes) - len(sampler.rows),
        free=any(sample.free for sample in samples),
    )


def _with_far(
    sampler: Sampler, samples: Sequence[PoleSample], sets: Sequence[Set], near: ReducedModels
) -> ReducedModels:
    """Return reduced models at the points of a piece with the far poles of the band."""
    viscous, free = samples[0].viscous, near.free
    both = list(zip(samples, sets, strict=True))
    outside = [
        np.append(sample.others, np.delete(sample.poles, [*chosen])) for sample, chosen in both
    ]
    poles = np.concatenate(outside)
    # The static flexibility replaces identified modes at the end of the band.
    poles = poles[(poles.imag >= 0.0) & (not sampler.measured)]
    stiffness = np.abs(poles) ** 2 + 0j if viscous else -(poles**2)
    decay = -2.0 * poles.real if viscous else np.zeros(len(poles))
    far = far_poles(stiffness, decay, peak_search_band(sampler.response.band, free=free), N_FAR)
    lines = _near_lines(near, check_lines(sampler.response.band, free=free)[:N_FIT])
    sums = np.array([sample.totals[:N_FIT] for sample in samples]) - lines
    side_by_side = sums.swapaxes(0, 1).reshape(N_FIT, -1)
    fitted = far.fit(side_by_side, real=viscous, rates=viscous)
    weights = np.asarray(fitted.reshape(len(fitted), len(sums), -1).swapaxes(0, 1))
    weights_of_kind = weights.real if viscous else weights
    weights = shortened(weights_of_kind, near.n_inputs)
    return replace(near, weights=weights, far_stiffness=far.stiffness, far_decay=far.decay)


def _near_lines(models: ReducedModels, omega: FloatArray) -> ComplexArray:
    """Return the FRFs of the reduced models alone at rad/s, (n, n_lines, n_pairs)."""
    sigma = 1j * omega if models.viscous else -(omega**2) + 0j
    pencil = (
        models.stiffness[:, np.newaxis]
        + sigma[:, np.newaxis, np.newaxis] * models.inertia[:, np.newaxis]
    )
    shapes = models.shapes[:, np.newaxis]
    frf = shapes @ np.linalg.solve(pencil, shapes[:, :, : models.n_inputs].swapaxes(2, 3) + 0j)
    outputs, inputs = frf_pairs(models.shapes.shape[1], models.n_inputs)
    return np.asarray(frf[:, :, outputs, inputs])


def _far_norms(
    samples: Sequence[PoleSample], piece: PolePiece, band: tuple[float, float], alpha3: FloatArray
) -> FloatArray:
    """Return norms of errors in a band (Hz) that far poles cause at angles, (n, 2, n_rows, n_in).

    There are two estimates. Errors are known at the points, and interpolated between them as the
    weights of the far poles are.
    """
    models = piece.models
    omega = check_lines(band, free=models.free)
    off = _near_lines(models, omega) + models.far.sums(omega, models.weights)
    off -= [sample.totals for sample in samples]
    at = stroke_variable(alpha3, piece.toggles)
    off = np.tensordot(interpolation_matrix(piece.variables, at), off, 1)
    lines = omega[:, np.newaxis] / (2.0 * math.pi)
    order, weights = np.argsort(omega), np.empty_like(lines)
    weights[order, 0] = np.sqrt(np.gradient(lines[order, 0]))
    # The fit makes its own lines better than those between them. The last one is the end of the
    # band, where the error is large over a small part of it.
    width, checked = float(np.ptp(lines)), np.zeros_like(lines)
    checked[N_FIT:-1] = math.sqrt(width / (N_CHECK - 1))
    checked[-1] = math.sqrt(_END * width)
    norms = np.zeros((len(at), 2, models.shapes.shape[1], models.n_inputs))
    outputs, inputs = frf_pairs(*norms.shape[2:])
    for i, each in enumerate((weights, checked)):
        norms[:, i, outputs, inputs] = np.linalg.norm(each * off, axis=1)
    return norms


def rounding(piece: PolePiece, response: Response) -> tuple[float, float]:
    """Return by how much rounding may change a value, relative, and the worst angle, rad."""
    modal = piece.drive(piece.angles)
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
    worst = 0.0, float(piece.angles[0])
    angles = piece.angles.tolist()
    for alpha3, all_poles, shift in zip(angles, modal.frequencies, moved, strict=True):
        exact = _not_real(_compared(oscillating(all_poles), response))
        nearest_poles = np.abs(exact[:, np.newaxis] - all_poles).argmin(axis=1)
        shares = (shift[nearest_poles] + CELL_ROUNDING) / values_of(exact)[1]
        worst = max(worst, (float(shares.max(initial=0.0)), alpha3))
    return worst


def misses(
    piece: PolePiece, samples: Sequence[PoleSample], response: Response, accuracy: Accuracy
) -> bool:
    """Return whether poles in reach differ too much from those of samples elsewhere."""
    modal = piece.drive(np.array([sample.alpha3 for sample in samples]))
    exact = [oscillating(sample.poles) for sample in samples]
    errors = _pole_errors(modal.frequencies, exact, response)
    return _worst(errors) > accuracy.frequency


def _pole_errors(
    approximate: ComplexArray, exact: Iterable[ComplexArray], response: Response
) -> list[FloatArray]:
    """Return the relative errors of the poles of which a table gives values, at each angle.

    Those of an angle are (2, k), of natural frequencies and of damping ratios, each of the nearest
    pole; they are infinite if no pole oscillates. All the exact ones oscillate.
    """
    errors = []
    for candidates, all_poles in zip(oscillating_rows(approximate), exact, strict=True):
        # Where two poles are about to become real, only the angle at which they do differs.
        wanted = _not_real(_compared(all_poles, response))
        if len(wanted) and not len(candidates):
            errors.append(np.full((2, len(wanted)), math.inf))
            continue
        near = candidates[np.abs(wanted[:, np.newaxis] - candidates).argmin(axis=1)]
        errors.append(values_of(near) / values_of(wanted) - 1.0)
    return errors


def _compared(upper: ComplexArray, response: Response) -> ComplexArray:
    """Return those of the oscillating poles of which a table gives values or resonances."""
    return upper[: max(response.modes, int((np.abs(upper) < reach(response.band)).sum()))]


def _not_real(poles: ComplexArray) -> ComplexArray:
    """Return the poles that are not nearly real."""
    return poles[poles.imag > _NEARLY_REAL * np.abs(poles)]


def compare(
    coarse: PolePiece,
    fine: PolePiece,
    response: Response,
    accuracy: Accuracy,
    samples: Sequence[PoleSample],
    rounding: Rounding,
    n_outputs: int,
) -> tuple[Bounds, list[Cell]] | None:
    """Return by how much fewer points change a piece, and its cells; None if it is too much.

    The samples at its points, if there are any, show the errors of FRFs that far poles cause. So
    many motions, before the forces, are outputs alone.
    """
    all_over = stroke_angle(dense(fine.variables[0], fine.variables[-1], GRID), fine.toggles)
    there = oscillating_rows(fine.drive(all_over).frequencies)
    errors = _pole_errors(coarse.drive(all_over).frequencies, there, response)
    if _worst(errors) > accuracy.frequency:
        return None  # before cells are made, which takes longer
    # Smaller cells would follow rounding, and their slopes even more.
    cell_error = max(accuracy.cell, min(rounding.values, CELL_SHARE * accuracy.frequency))
    cells = make_cells(fine, cell_error)
    angles = np.array([[cell.start, (cell.start + cell.end) / 2.0] for cell in cells]).ravel()
    before, peaks = coarse.drive(angles), np.concatenate([cell.peaks for cell in cells])
    there = [poles for cell in cells for poles in (cell.first, cell.middle)]
    off = [_worst([each]) for each in _pole_errors(before.frequencies, there, response)]
    values = max(*off, _worst(errors))
    compared_band = peak_search_band(response.band, free=fine.models.free)
    peak = _peak_error(before, peaks, lambda rows: fine.drive(angles[rows]), response.peak_band)
    # Fewer points leave the largest errors between them.
    between = stroke_angle((coarse.variables[1:] + coarse.variables[:-1]) / 2.0, coarse.toggles)
    rows = np.searchsorted(angles[:-1], between).tolist()
    rows = sorted({0, len(angles) - 1, int(np.argmax(off)), *rows})
    pairs = [each.modal(angles[rows]) for each in (coarse, fine)]
    far = _far_norms(samples, fine, response.band, angles[rows]) if samples else [()] * len(rows)
    frf, far_error = np.zeros((2, 2))
    for row, by_far in enumerate(far):
        approximate, exact = (each.frf(row, EVERY, EVERY) for each in pairs)
        norms, size = frf_norms(approximate, exact, compared_band)
        if not fine.models.free:
            frf = np.maximum(frf, worst_shares(norms, size, n_outputs))
        for each in by_far:
            far_error = np.maximum(far_error, worst_shares(each, size, n_outputs))
    frf = frf + MARGIN * far_error + rounding.frf
    slope = max(
        np.abs(there - here)[0].max(initial=0.0) / step
        for (here, there), step in zip(pairwise(errors), np.diff(all_over), strict=True)
        if here.shape == there.shape
    )
    # Polynomials through points that rounding moves have other slopes.
    matrix = interpolation_matrix(fine.variables, stroke_variable(all_over, fine.toggles))
    steps = np.abs(np.diff(matrix, axis=0)).sum(axis=1)
    slope += _SLOPE_ROUNDING * rounding.values * float((steps / np.diff(all_over)).max())
    widths = [cell.end - cell.start for cell in cells if cell.values is not None]
    slope += _CELL_SLOPE * cell_error / min(widths, default=math.inf)
    # The error of a cubic in its middle is a little more than half of its largest.
    rest = 2.0 * cell_error + rounding.values
    both, force = (frf + rounding.values).tolist()
    bounds = Bounds(values + rest, peak + rest, both, force, float(slope))
    return (bounds, cells) if bounds.meet(accuracy) else None


def _worst(errors: Sequence[FloatArray]) -> float:
    """Return the largest of the errors of poles."""
    return max(float(np.abs(each).max(initial=0.0)) for each in errors)


def _peak_error(
    coarse: Modal, highest: FloatArray, fine: Callable[[IntArray], Modal], band: tuple[float, float]
) -> float:
    """Return the largest relative difference from the highest peaks, (n, 2), Hz and m/N, at angles.

    The function returns the fine model at some of the angles.
    """
    hertz, off = coarse.highest(band).T
    off = np.abs(off / highest[:, 1] - 1.0)
    away = _apart(hertz, highest[:, 0], band)
    # Either of two peaks of one height, within the error, is the highest.
    doubted = np.flatnonzero(away > off.max())
    if len(doubted):
        rows, omega, size = fine(doubted).maxima(band)
        rows, places = doubted[rows], omega / (2.0 * math.pi)
        rival = size >= (1.0 - 2.0 * off[rows]) * highest[rows, 1]
        np.minimum.at(away, rows[rival], _apart(hertz[rows], places, band)[rival])
    return float(np.maximum(off, away).max())


def _apart(hertz: FloatArray, places: FloatArray, band: tuple[float, float]) -> FloatArray:
    return np.asarray(np.abs(hertz - places) / np.maximum(places, 1e-6 * band[1]))
