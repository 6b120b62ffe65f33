# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Divides the stroke into pieces and refines them until the table meets its tolerance."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import N_FAR
from linkage_vibration.table.table import Table, TableError
from linkage_vibration.table.tabulation.accuracy import TOLERANCE, Accuracy, Bounds
from linkage_vibration.table.tabulation.assembly import assemble, bound_errors, thin, with_bounds
from linkage_vibration.table.tabulation.coupled import build_coupled
from linkage_vibration.table.tabulation.ensemble import with_uncertainty
from linkage_vibration.table.tabulation.naming import with_mode_names
from linkage_vibration.table.tabulation.refinement import (
    Piece,
    first_points,
    halves,
    more_points,
    refine,
    refine_pieces,
)
from linkage_vibration.table.tabulation.sampling import ModesAreCoupled, Sampler
from linkage_vibration.table.tabulation.tracking import Tracker

_FINEST, _COARSEST = 1e-11, 1.0  # Rounding prevents finer ones; coarser tables have no use.
_SHARE = 0.25  # of the work before the ensemble is added, if there is one
_MORE_FAR, _MOST_FAR = 2, 8  # Far poles are added if their error is above half of the tolerance.


def build_table(
    model: LinkageModel,
    tolerance: float = TOLERANCE,
    points: Sequence[str] | None = None,
    progress: Callable[[float], object] = lambda finished: None,
) -> Table:
    """Tabulate the values of predictions over the stroke, to a tolerance.

    Every quantity is a polynomial in `stroke_variable`. The model is solved at the points of a Leja
    sequence; the next three, and one where these change the polynomials most, measure the error of
    the polynomials through the previous points, and join them while it is above the tolerance. A
    piece of the stroke is halved if it needs more than 48 points, or if the highest peak passes to
    a maximum that does not exist in the whole piece. Modes are tracked from point to point by their
    shapes; where a shape might continue two others, a point is added between. Where modes seem to
    cross, the model is solved to decide whether they cross or veer.

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
        measured FRFs has none.
    progress : callable
        Called with the finished fraction of the work after each solution of the model, and after
        each member of the ensemble of a mechanism with uncertain numbers.

    Raises
    ------
    TableError
        If the tolerance is invalid, or cannot be met with `MOST_SOLUTIONS` solutions; if the model
        has too few modes, or hardly any response; if a mode cannot be tracked.
    """
    if not _FINEST <= tolerance < _COARSEST:
        hint = f"give one from {_FINEST:g} to less than {_COARSEST:g}"
        raise TableError(f"A tolerance of {tolerance:g} is invalid or cannot be met; {hint}.")
    share = _SHARE if model.mechanism.uncertainty else 1.0
    sampler = Sampler(model, points, lambda finished: progress(share * finished))
    try:
        table = _build(sampler, tolerance)
    except ModesAreCoupled:
        table = build_coupled(sampler, Accuracy(tolerance))
    table = with_mode_names(_with_static_forces(table, sampler), sampler)
    return with_uncertainty(table, sampler, lambda done: progress(share + (1.0 - share) * done))


def _with_static_forces(table: Table, sampler: Sampler) -> Table:
    """Return a table with its forces under the weight at its points."""
    if not table.forces:
        return table
    model = sampler.model
    solutions = [sampler.solution(angle) for angle in table.alpha3.tolist()]
    forces = [
        model.forces.at_rest(each.configuration, each.joining, each.coupled) for each in solutions
    ]
    return replace(table, static_forces=np.array(forces))


def _build(sampler: Sampler, tolerance: float) -> Table:
    """Build the table of a linkage whose modes damping does not couple."""
    tracker, accuracy = Tracker(sampler, tolerance), Accuracy(tolerance)
    for variable in sampler.ends:
        sampler.at(variable)
    sampler.check_rounding(accuracy)
    reason = f"its modes or peaks change too quickly for a tolerance of {tolerance:g}"

    def refined(waiting: list[list[float]]) -> list[Piece]:
        return refine_pieces(
            sampler, waiting, lambda fitted: refine(tracker, fitted, accuracy) or reason, accuracy
        )

    pieces = refined([first_points(sampler.solved, *sampler.ends)])
    tried: set[tuple[float, float]] = set()  # the ends of pieces that have received more points
    measured: dict[tuple[int, Piece], Bounds] = {}
    n_far = N_FAR
    while True:
        pieces.sort(key=lambda piece: piece.ends)
        tracked = tracker.follow(sorted({x for p in pieces for x in (*p.fitted, *p.held)}))
        finer = assemble(sampler, [piece.finer for piece in pieces], tracked, accuracy, n_far)
        table = thin(finer, pieces)
        for index, piece in enumerate(pieces):
            if (n_far, piece) not in measured:
                bounds = bound_errors(table, finer, index, piece, tracked, sampler)
                measured[n_far, piece] = bounds
        all_bounds = [measured[n_far, piece] for piece in pieces]
        if max(bounds.far for bounds in all_bounds) > accuracy.frf / 2.0 and n_far < _MOST_FAR:
            n_far += _MORE_FAR
            continue
        both = zip(pieces, all_bounds, strict=True)
        poor = [piece for piece, bounds in both if not bounds.meet(accuracy)]
        if not poor:
            return with_bounds(table, all_bounds)
        sampler.finish(sum(piece.ends[0] - piece.ends[1] for piece in poor))
        waiting: list[list[float]] = []
        for piece in poor:
            if piece.ends in tried:  # more points did not help
                waiting += halves(sampler.solved, *piece.ends)
            else:
                tried.add(piece.ends)
                waiting.append(sorted(piece.fitted + more_points(piece.fitted)))
        pieces = [piece for piece in pieces if piece not in poor]
        pieces += refined(waiting)
