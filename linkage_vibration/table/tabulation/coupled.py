# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Refines pieces of a table of a linkage whose damping couples the modes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.response import FarPoles, far_poles, reach, searched
from linkage_vibration.table.interpolation import interpolation_matrix
from linkage_vibration.table.reduced import Far, Numbers, ReducedModels
from linkage_vibration.table.table import Table, TableError
from linkage_vibration.table.tabulation.accuracy import MARGIN, Accuracy, Bounds
from linkage_vibration.table.tabulation.assembly import bare_table, with_bounds
from linkage_vibration.table.tabulation.cell_making import Cell, CellArrays, cell_arrays
from linkage_vibration.table.tabulation.comparison import (
    Polynomials,
    compare,
    relative_errors,
    weighted_frf,
)
from linkage_vibration.table.tabulation.refinement import (
    MOST,
    first_points,
    more_points,
    refine_pieces,
)
from linkage_vibration.table.tabulation.sampling import Rounding, Sampler
from linkage_vibration.table.tabulation.subspaces import (
    N_CHECK,
    N_FAR,
    N_FIT,
    PoleSample,
    Subspace,
    check_lines,
    continue_set,
)

_NARROW = 64  # A step below this part of a piece is not halved to distinguish poles.
_END = 1.0 / 200.0  # In this share of the band, at its end, far poles are least accurate.
_FAR_ANGLES = 65  # The error by far poles is evaluated at so many angles of a piece.
_LESS_ROUNDING = "more damping, a band_hz that ends nearer to the lowest mode, "
_BETWEEN = 24  # If poles need more points to be followed, the piece is halved.


@dataclass(frozen=True, slots=True, eq=False)
class ReducedPiece:
    """A piece of the stroke, with the reduced models at its points."""

    variables: FloatArray  # (n,): stroke variables of the points, ascending
    alpha3: FloatArray  # (n,), rad
    models: ReducedModels
    bounds: Bounds
    cells: list[Cell]


class PoleTracker:
    """Follows the poles of a damped linkage."""

    def __init__(self, sampler: Sampler) -> None:
        self.sampler, self.at = sampler, sampler.poles_at
        self.band, self.n_modes = sampler.response.band, sampler.response.modes

    def needed(self, sample: PoleSample) -> IntArray:
        """Return the indices of the poles in reach of the band, and of the lowest modes."""
        poles = sample.poles
        wanted = np.abs(poles) < reach(self.band)
        upper = np.flatnonzero(poles.imag > 0.0)
        lowest = poles[upper[np.argsort(np.abs(poles[upper]))][: self.n_modes]]
        for pole in lowest:
            wanted |= np.abs(np.abs(poles) - abs(pole)) <= 1e-9 * abs(pole)
        return np.flatnonzero(wanted)

    def follow(self, points: list[float]) -> dict[float, IntArray] | None:
        """Find the poles that make up one smooth subspace over a piece, at each of its points.

        Points are added where the steps are too long to follow it. It returns indices by the stroke
        variables of the points, or None if the piece must be halved.
        """
        points, base = list(points), len(points) // 2
        fewest = len(points)
        start = self.needed(self.at(points[base]))
        while len(points) < fewest + _BETWEEN:
            sets: dict[float, IntArray] = {points[base]: start}
            trouble = False
            for i in (*range(base + 1, len(points)), *range(base - 1, -1, -1)):
                before = points[i - 1 if i > base else i + 1]
                sample, set_there = self.at(points[i]), sets[before]
                here = self.at(before).subspace(set_there)
                chosen, clear, rival = continue_set(here, sample, len(set_there))
                sets[points[i]] = chosen
                missing = np.setdiff1d(self.needed(sample), chosen)
                if clear and not len(missing):
                    continue
                trouble = True
                step = abs(points[i] - before)
                if not clear and step > (points[-1] - points[0]) / _NARROW:
                    points = sorted([*points, (points[i] + before) / 2.0])
                    base, start = points.index(before), set_there
                elif not clear and not len(rival):
                    return None
                else:
                    start = np.union1d(chosen, missing if clear else rival)
                    base = i
                break
            if not trouble:
                return sets
        return None


def refine_piece(
    tracker: PoleTracker, fitted: list[float], accuracy: Accuracy
) -> ReducedPiece | str:
    """Add points until poles, peaks and FRFs of the reduced models meet the tolerance.

    It returns the piece, or the reason why it must be halved.
    """
    while len(fitted) <= MOST:
        more = more_points(fitted)
        finer = sorted(fitted + more)
        sets = tracker.follow(finer)
        if sets is None:
            return "a pole in reach of the band cannot be told from others"
        spaces = _one_basis(tracker, sets, finer)
        if spaces is None:
            return "the shapes of the poles change too quickly"
        samples = [tracker.at(x) for x in finer]
        models = _models(tracker, samples, [sets[x] for x in finer], spaces)
        rows = np.array([x in set(fitted) for x in finer], dtype=np.bool_)
        variables = np.array(finer)
        response, toggles = tracker.sampler.response, tracker.sampler.toggles
        coarse = Polynomials(variables[rows], _only(models, rows), toggles, response)
        if not coarse.misses(
            variables[~rows], [samples[i] for i in np.flatnonzero(~rows)], accuracy
        ):
            fine = Polynomials(variables, models, toggles, response)
            values = fine.rounding() + tracker.sampler.rounding(finer).values
            alpha3, rounding = tracker.sampler.angle(finer[0]), Rounding(values)
            tracker.sampler.refuse_rounding(rounding, alpha3, accuracy, 1.0 / 2.0, _LESS_ROUNDING)
            far_error = MARGIN * _far_error(tracker, samples, models, variables)
            far_error += tracker.sampler.rounding(finer).frf
            compared = compare(coarse, fine, accuracy, far_error, values)
            if compared is not None:
                angles = np.array([tracker.sampler.angle(x) for x in finer])
                return ReducedPiece(variables, angles, models, *compared)
        fitted = finer
    return f"the poles or the peak change too quickly for a tolerance of {accuracy.frequency:g}"


def _one_basis(
    tracker: PoleTracker, sets: dict[float, IntArray], points: list[float]
) -> list[Subspace] | None:
    """Return the subspaces at points on the basis of the middle one."""
    middle = points[len(points) // 2]
    left = tracker.at(middle).subspace(sets[middle]).left
    candidates = [tracker.at(x).subspace(sets[x]).on(left) for x in points]
    spaces = [space for space in candidates if space is not None]
    return spaces if len(spaces) == len(candidates) else None


def _models(
    tracker: PoleTracker,
    samples: Sequence[PoleSample],
    sets: Sequence[IntArray],
    spaces: Sequence[Subspace],
) -> ReducedModels:
    """Return the reduced models at the points of a piece."""
    viscous, free = samples[0].viscous, any(sample.free for sample in samples)
    outside = [
        np.concatenate([s.others, np.delete(s.poles, chosen)])
        for s, chosen in zip(samples, sets, strict=True)
    ]
    poles = np.concatenate(outside)
    poles = poles[poles.imag >= 0.0]
    stiffness = np.abs(poles) ** 2 + 0j if viscous else -(poles**2)
    decay = -2.0 * poles.real if viscous else np.zeros(len(poles))
    far = far_poles(stiffness, decay, searched(tracker.band, free=free), N_FAR)
    near = ReducedModels(
        np.array([space.inertia for space in spaces]),
        np.array([space.stiffness for space in spaces]),
        np.array([space.shapes for space in spaces]),
        Far(far.stiffness, far.decay, np.zeros(0)),
        viscous,
        free,
    )
    weights = [
        _far_weights(far, sample.totals[:N_FIT] - lines[:N_FIT], viscous)
        for sample, lines in zip(samples, _near_lines(tracker, near), strict=True)
    ]
    every: Numbers = np.array([each.real if viscous else each for each in weights])
    return replace(near, far=Far(far.stiffness, far.decay, every))


def _near_lines(tracker: PoleTracker, models: ReducedModels) -> ComplexArray:
    """Return the FRFs of the reduced models alone at the check lines, (n, n_lines, n_triangle)."""
    omega = check_lines(tracker.band, free=models.free)
    sigma = 1j * omega if models.viscous else -(omega**2) + 0j
    pencil = (
        models.stiffness[:, np.newaxis]
        + sigma[:, np.newaxis, np.newaxis] * models.inertia[:, np.newaxis]
    )
    shapes = models.shapes[:, np.newaxis]
    frf = shapes @ np.linalg.solve(pencil, shapes.swapaxes(2, 3) + 0j)
    upper = np.triu_indices(models.shapes.shape[1])
    return np.asarray(frf[:, :, upper[0], upper[1]])


def _far_weights(far: FarPoles, sums: ComplexArray, viscous: bool) -> ComplexArray | FloatArray:
    """Return static flexibility, residues and rates, (1 + 2 n_far, n_triangle)."""
    if viscous:
        constants, rates = far.fit_with_rates(sums)
        return np.vstack([constants, rates]).real
    constants = far.fit(sums)
    return np.vstack([constants, np.zeros_like(constants[1:])])


def _far_error(
    tracker: PoleTracker,
    samples: Sequence[PoleSample],
    models: ReducedModels,
    variables: FloatArray,
) -> float:
    """Return the largest relative error of FRFs in the piece, which far poles cause.

    It is known at the points. Between them it is interpolated as the weights of the far poles are.
    """
    omega = check_lines(tracker.band, free=models.free)
    near, exact = _near_lines(tracker, models), np.array([sample.totals for sample in samples])
    off = near + models.far.frf(omega) - exact
    at = np.union1d(np.linspace(variables[0], variables[-1], _FAR_ANGLES), variables)
    between, n = models.at(variables, at).modal, models.shapes.shape[1]
    matrix = interpolation_matrix(variables, at)
    off = np.asarray(np.tensordot(matrix, off, 1), dtype=np.complex128)
    order, weights = np.argsort(omega), np.empty((len(omega), 1))
    weights[order, 0] = np.sqrt(np.gradient(omega[order]))
    # The fit makes its own lines better than those between them. The last one is the end of the
    # band, where the error is large over a small part of it.
    width, checked = float(np.ptp(omega)), np.zeros_like(weights)
    checked[N_FIT:-1] = math.sqrt(width / (N_CHECK - 1))
    checked[-1] = math.sqrt(_END * width)
    worst = 0.0
    for row, error in enumerate(off):
        whole = weighted_frf(between, row, tracker.band)
        parts = [relative_errors(w * error, whole, n).max() for w in (weights, checked)]
        worst = max(worst, *parts)
    return float(worst)


def _only(models: ReducedModels, rows: BoolArray) -> ReducedModels:
    """Return the models at some of the points."""
    far = Far(models.far.stiffness, models.far.decay, models.far.weights[rows])
    return replace(
        models,
        inertia=models.inertia[rows],
        stiffness=models.stiffness[rows],
        shapes=models.shapes[rows],
        far=far,
    )


def build_coupled(sampler: Sampler, accuracy: Accuracy) -> Table:
    """Build the table of a linkage whose damping couples its modes."""
    tracker = PoleTracker(sampler)

    def refined(fitted: list[float]) -> ReducedPiece | str:
        return refine_piece(tracker, fitted, accuracy)

    waiting = [first_points(sampler.solved, *sampler.ends)]
    pieces = refine_pieces(sampler, waiting, refined, accuracy)
    return _table(sampler, sorted(pieces, key=lambda piece: float(piece.variables[0])))


def _table(sampler: Sampler, pieces: Sequence[ReducedPiece]) -> Table:
    """Make the table from pieces over the whole stroke, ascending."""
    alpha3 = np.concatenate([pieces[0].alpha3[:1], *(piece.alpha3[1:] for piece in pieces)])
    ends = np.cumsum([0, *(len(piece.alpha3) - 1 for piece in pieces)])
    n, modes, models = len(alpha3), sampler.response.modes, [piece.models for piece in pieces]
    drive = (sampler.response.point, sampler.response.direction)
    cells = cell_arrays([piece.cells for piece in pieces], modes)
    _check_modes(sampler, cells)
    table = replace(
        bare_table(sampler, alpha3, ends),
        natural_frequencies=np.zeros((n, modes)),
        peak_frequencies=np.zeros((n, 1)),
        peak_notable=np.ones((len(pieces), 1), dtype=np.bool_),
        places=() if sampler.free_modes else (drive, *(p for p in sampler.places if p != drive)),
        far_stiffness=np.array([each.far.stiffness for each in models]),
        far_decay=np.array([each.far.decay for each in models]),
        reduced_orders=np.array([each.inertia.shape[1] for each in models], dtype=np.int64),
        reduced_inertia=np.concatenate([each.inertia.ravel() for each in models]),
        reduced_stiffness=np.concatenate([each.stiffness.ravel() for each in models]),
        reduced_shapes=np.concatenate([each.shapes.ravel() for each in models]),
        reduced_far=np.concatenate([each.far.weights.ravel() for each in models]),
        cell_starts=cells.starts,
        cell_cubics=cells.cubics,
        cell_poles=cells.poles,
    )
    table = with_bounds(table, [piece.bounds for piece in pieces])
    values = table.evaluate(alpha3)
    return replace(
        table,
        natural_frequencies=values[:, :modes],
        damping_ratios=values[:, modes : 2 * modes],
        peak_frequencies=values[:, -2:-1],
        peak_magnitudes=values[:, -1:],
    )


def _check_modes(sampler: Sampler, cells: CellArrays) -> None:
    """Refuse a table that lacks modes, or does not hold them over the whole stroke."""
    name = sampler.model.mechanism.name
    if cells.n_oscillating < sampler.response.modes:
        raise TableError(
            f"response.modes is {sampler.response.modes}, but {name} has {cells.n_oscillating} "
            "modes that oscillate; use fewer."
        )
    for mode, alpha3 in cells.left.items():
        raise TableError(
            f"Mode {mode + 1} of {name} leaves the reach of response.band_hz at "
            f"{math.degrees(alpha3):.3f} deg; widen the band, or use fewer modes in response.modes."
        )
