# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Divides the stroke into pieces and refines them until the table meets its tolerance."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from linkage_vibration.errors import check_type
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.model import LinkageModel, Place
from linkage_vibration.mechanics.response import peak_search_band
from linkage_vibration.support.progress import table_bar
from linkage_vibration.support.version import VERSION
from linkage_vibration.table.pole_cells import oscillating, values_of
from linkage_vibration.table.table import Table, TableError, both_halves
from linkage_vibration.table.tabulation.accuracy import COARSEST, TOLERANCE, Accuracy
from linkage_vibration.table.tabulation.cell_making import cell_arrays
from linkage_vibration.table.tabulation.ensemble import Drawn, with_uncertainty
from linkage_vibration.table.tabulation.naming import with_mode_names
from linkage_vibration.table.tabulation.piece_refinement import RefinedPiece, refine
from linkage_vibration.table.tabulation.refinement import first_points, refine_pieces
from linkage_vibration.table.tabulation.sampling import Sampler

_FINEST = 1e-11  # Rounding prevents finer tolerances.
_SHARE = 0.25  # of the work before the ensemble is added, if there is one


def build_table(
    model: LinkageModel,
    tolerance: float = TOLERANCE,
    points: Sequence[str] | None = None,
    progress: Callable[[float], object] | None = None,
) -> Table:
    """Tabulate the values of predictions over the stroke, to a tolerance.

    The table of a mechanism with a lateral half holds the table of that half as well.

    Reduced models with the poles in reach of the band are polynomials in `stroke_variable`. The
    model is solved at the points of a Leja sequence; the next three measure the error of the
    polynomials through the previous points, and join them while it is above the tolerance. A piece
    of the stroke is halved if it needs more than 48 points. The subspace of all poles is followed
    from point to point, so that it does not matter how they cross, veer, or become real.

    Parameters
    ----------
    model : LinkageModel
        The model to tabulate.
    tolerance : float
        Relative, of natural frequencies; a hundred times that of the highest peak's frequency and
        magnitude, and of each FRF between the points (L2 norm over the band; 1e-5 at best).
    points : sequence of str, optional
        Points between which the table has FRFs; by default all that move and the mounts
        of a base, if they are no more than eight, otherwise the response point. A model from
        measured FRFs has none. The response point in its direction is always one of them.
    progress : callable
        Called with the finished fraction of the work after each solution of the model, and after
        each member of the ensemble of a mechanism with uncertain numbers. By default, a bar on a
        terminal shows it.

    Raises
    ------
    TableError
        If the tolerance is invalid, or cannot be met with `MOST_SOLUTIONS` solutions; if the model
        has too few modes, or hardly any response; if poles cannot be followed.
    """
    check_type(model, "make one of a mechanism with `LinkageModel`", LinkageModel)
    if not _FINEST <= tolerance < COARSEST:
        hint = f"give one from {_FINEST:g} to less than {COARSEST:g}"
        raise TableError(f"A tolerance of {tolerance:g} is invalid or cannot be met; {hint}.")
    if progress is None:
        with table_bar(model.mechanism.name) as shown:
            return build_table(model, tolerance, points, shown)
    first, *others = model.halves
    share, drawn = 1.0 / (1 + len(others)), Drawn()
    seen = model.mechanism.response.point, model.mechanism.response.direction
    given = tolerance, points, seen, drawn
    table = _half(first, *given, lambda done: progress(share * done))
    for other in others:
        rest = _half(other, *given, lambda done: progress(share + share * done))
        table = both_halves(table, rest)
    return table


def _half(
    model: LinkageModel,
    tolerance: float,
    points: Sequence[str] | None,
    seen: Place,
    drawn: Drawn,
    progress: Callable[[float], object],
) -> Table:
    share = _SHARE if model.mechanism.uncertainty else 1.0
    sampler = Sampler(model, points, lambda finished: progress(share * finished), seen)
    accuracy, waiting = Accuracy(tolerance), [first_points([], *sampler.ends)]
    pieces = refine_pieces(
        sampler, waiting, lambda fitted: refine(sampler, fitted, accuracy), accuracy
    )
    table = _table(sampler, sorted(pieces, key=lambda each: float(each.piece.alpha3[0])))
    table = with_mode_names(_with_static_forces(table, sampler), sampler)
    return with_uncertainty(
        table, sampler, drawn, lambda done: progress(share + (1.0 - share) * done)
    )


def _with_static_forces(table: Table, sampler: Sampler) -> Table:
    """Return a table with its forces under the weight at its points."""
    if not table.forces:
        return table
    model = sampler.model
    configuration = model.kinematics.stack(table.alpha3)
    joining = model.interface.join(configuration)
    return replace(table, static_forces=model.forces.at_rest(configuration, joining))


def _table(sampler: Sampler, pieces: Sequence[RefinedPiece]) -> Table:
    """Make the table from pieces over the whole stroke, ascending."""
    angles = [each.piece.alpha3 for each in pieces]
    alpha3 = np.unique(np.concatenate(angles))  # each piece begins where the one before it ends
    bounds, modes = [each.bounds for each in pieces], sampler.response.modes
    without = sampler.measured or sampler.free_modes > 0
    table = Table(
        alpha3=alpha3,
        pieces=np.cumsum([0, *(len(each) - 1 for each in angles)]).astype(np.int64),
        natural_frequencies=np.zeros((len(alpha3), modes)),
        interpolation_error=np.array([each.values for each in bounds]),
        peak_error=max(each.peak for each in bounds),
        frf_error=math.nan if without else max(each.frf for each in bounds),
        force_error=max(each.force for each in bounds) if sampler.forces else math.nan,
        slope_error=max(each.slope for each in bounds),
        free_modes=sampler.free_modes,
        toggles=sampler.toggles,
        band=sampler.response.band,
        peak_band=peak_search_band(sampler.response.peak_band, free=sampler.free_modes > 0),
        places=() if without else sampler.pole_places,
        outputs=() if without else sampler.outputs,
        forces=sampler.forces,
        reference_force=sampler.response.reference_force,
        reduced=tuple(each.piece.models for each in pieces),
        model_hash=sampler.model.mechanism.model_hash,
        mechanism_name=sampler.model.mechanism.name,
        package_version=VERSION,
        **cell_arrays([each.cells for each in pieces], modes, sampler.model.mechanism.name),
    )
    values = table.evaluate(alpha3)
    variables = sorted({x for each in pieces for x in each.points})
    stddev = _deviations(sampler, values[:, :modes], variables)
    return replace(
        table,
        natural_frequencies=values[:, :modes],
        damping_ratios=values[:, modes : 2 * modes],
        peak_frequencies=values[:, -2],
        peak_magnitudes=values[:, -1],
        frequency_stddev=stddev[0],
        damping_ratio_stddev=stddev[1],
    )


def _deviations(
    sampler: Sampler, frequencies: FloatArray, variables: Sequence[float]
) -> FloatArray:
    """Return deviations of the identified modes nearest to frequencies, Hz, (2, n, n_modes)."""
    if not sampler.measured:
        return np.empty((2, 0))
    deviations = []
    for row, variable in zip(frequencies, variables, strict=True):
        sample = sampler.at(variable)
        assert sample.deviations is not None
        apart = np.abs(np.subtract.outer(row, values_of(oscillating(sample.poles))[0]))
        deviations.append(sample.deviations[:, linear_sum_assignment(apart**2)[1]])
    return np.array(deviations).swapaxes(0, 1)
