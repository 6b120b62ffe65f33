# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Divides the stroke into pieces and refines them until the table meets its tolerance."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import N_FAR
from linkage_vibration.table.table import Table, TableError
from linkage_vibration.table.tabulation.accuracy import ROUNDING, TOLERANCE, Accuracy, Bounds
from linkage_vibration.table.tabulation.assembly import assemble, with_bounds
from linkage_vibration.table.tabulation.coupled import build_coupled
from linkage_vibration.table.tabulation.deviations import with_parameter_stddev
from linkage_vibration.table.tabulation.naming import with_mode_names
from linkage_vibration.table.tabulation.near_terms import frf_change
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
from linkage_vibration.table.tabulation.verification import bound_errors, thin

_FINEST, _COARSEST = 1e-11, 1.0  # Rounding prevents finer ones; coarser tables have no use.
_CLEARLY = 1.5  # The estimated change may be twice the true one, so it may exceed its limit.
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
        Called after each solution of the model with the fraction of the stroke that is finished.

    Raises
    ------
    TableError
        If the tolerance is invalid, or cannot be met with `MOST_SOLUTIONS` solutions; if the model
        has too few modes, or hardly any response; if a mode cannot be tracked.
    """
    if not _FINEST <= tolerance < _COARSEST:
        raise TableError(
            f"A tolerance of {tolerance:g} is invalid or cannot be met; give one from {_FINEST:g} "
            f"to {_COARSEST:g}."
        )
    sampler = Sampler(model, points, progress)
    try:
        table = _build(sampler, tolerance)
    except ModesAreCoupled:
        table = build_coupled(sampler, Accuracy(tolerance))
    return with_parameter_stddev(with_mode_names(table, sampler), sampler)


def _build(sampler: Sampler, tolerance: float) -> Table:
    """Build the table of a linkage whose modes damping does not couple."""
    tracker, accuracy = Tracker(sampler, tolerance), Accuracy(tolerance)
    _check_damping(sampler, accuracy)
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
        fresh = [piece for piece in pieces if piece.ends not in tried]
        limit = _CLEARLY * accuracy.frf
        # The estimate leaves out far poles, which would take longer.
        poor = [piece for piece in fresh if frf_change(sampler, tracked, piece) > limit]
        if not poor:
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
        sampler.reopen(sum(piece.ends[1] - piece.ends[0] for piece in poor))
        waiting: list[list[float]] = []
        for piece in poor:
            if piece.ends in tried:  # more points did not help
                waiting += halves(sampler.solved, *piece.ends)
            else:
                tried.add(piece.ends)
                waiting.append(sorted(piece.fitted + more_points(piece.fitted)))
        pieces = [piece for piece in pieces if piece not in poor]
        pieces += refined(waiting)


def _check_damping(sampler: Sampler, accuracy: Accuracy) -> None:
    """Refuse FRFs between points where a resonance is so narrow that rounding moves it."""
    for variable in sampler.ends if sampler.places else ():
        sample = sampler.at(variable)
        inside = sample.frequencies < sampler.response.band[1]
        for mode in np.flatnonzero(inside & (sample.ratios * accuracy.frf < ROUNDING)).tolist():
            raise TableError(
                f"Mode {mode + 1} of {sampler.model.mechanism.name} has a damping ratio of "
                f"{sample.ratios[mode]:.1e} at alpha3 = {math.degrees(sample.alpha3):.3f} deg, so "
                f"its resonance is too narrow for FRFs within {accuracy.frf:g}; give its links "
                "more damping, or build the table with a larger tolerance."
            )
