# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Cuts the stroke into pieces, refines each, and does so again where the table is not as asked."""

import math
from collections.abc import Callable, Sequence

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.table.table import Table, TableError
from linkage_vibration.table.tabulation.accuracy import TOLERANCE, Accuracy
from linkage_vibration.table.tabulation.assembly import assemble
from linkage_vibration.table.tabulation.refinement import (
    Piece,
    first_points,
    more_points,
    refine,
)
from linkage_vibration.table.tabulation.sampling import Sampler
from linkage_vibration.table.tabulation.tracking import Tracker
from linkage_vibration.table.tabulation.verification import verify

_FINEST, _COARSEST = 1e-11, 1.0  # tolerances: below, rounding decides; above, nothing is promised
_TOTAL = 3000  # solutions in all, ten times what the hardest of the shipped linkages takes


def build_table(
    model: LinkageModel,
    tolerance: float = TOLERANCE,
    points: Sequence[str] | None = None,
    solved: Callable[[], object] = lambda: None,
) -> Table:
    """Tabulate what a prediction tells over the stroke, to a tolerance.

    Every quantity is a polynomial in `stroke_variable`. The model is solved at the points of a Leja
    sequence; the three that come next measure the error of the polynomial through those before
    them, where it is largest, and join them while it is above the tolerance. A piece of the stroke
    that would need more than 48 points is halved, and one in which the highest peak passes from one
    maximum to another that is not there all along. Modes are tracked from point to point by their
    shapes; where a shape might continue two, a point is put between. Where modes seem to cross, the
    model is solved to see whether they do, or veer.

    Parameters
    ----------
    model : LinkageModel
        What to tabulate.
    tolerance : float
        Relative, of natural frequencies; a hundred times that of the highest peak's frequency and
        magnitude, and of each FRF between the points (L2 norm over the band; 1e-5 at best).
    points : sequence of str, optional
        Between which points the table is to hold FRFs; all that move, if they are eight at most,
        otherwise the response point. A model from measured FRFs has none.
    solved : callable
        Called after each solution of the model, for a progress bar.

    Raises
    ------
    TableError
        If the tolerance is none, or cannot be met; if the model shows too few modes, or no response
        to speak of; if a mode cannot be followed.
    """
    if not _FINEST <= tolerance < _COARSEST:
        raise TableError(
            f"A tolerance of {tolerance:g} cannot be met, or is none; give one from {_FINEST:g} to "
            f"{_COARSEST:g}."
        )
    sampler = Sampler(model, points, solved)
    tracker, accuracy = Tracker(sampler, tolerance), Accuracy(tolerance)
    pieces = _refined(tracker, [first_points(sampler.samples, *sampler.ends)], accuracy)
    tried: set[tuple[float, float]] = set()  # pieces that were given more points
    while True:
        pieces.sort(key=lambda piece: piece.ends)
        tracked = tracker.follow(
            sorted({x for piece in pieces for x in (*piece.fitted, *piece.held)})
        )
        table = assemble(sampler, pieces, tracked, accuracy)
        table, poor = verify(table, sampler, pieces, tracked, accuracy)
        if not poor:
            return table
        waiting: list[list[float]] = []
        for piece in poor:
            if piece.ends in tried:  # more points have not helped
                waiting += _halves(sampler, *piece.ends)
            else:
                tried.add(piece.ends)
                waiting.append(sorted(piece.fitted + more_points(piece.fitted)))
        pieces = [piece for piece in pieces if piece not in poor]
        pieces += _refined(tracker, waiting, accuracy)


def _refined(tracker: Tracker, waiting: list[list[float]], accuracy: Accuracy) -> list[Piece]:
    """Refine pieces, from the last to the first, and halve those that do not come to meet it."""
    sampler, pieces = tracker.sampler, list[Piece]()
    while waiting:
        fitted = waiting.pop()
        piece = refine(tracker, fitted, accuracy)
        if piece is not None:
            pieces.append(piece)
            continue
        low, high = fitted[0], fitted[-1]
        if high - low < 2.0 * sampler.shortest or len(sampler.samples) > _TOTAL:
            raise TableError(
                f"{sampler.model.mechanism.name} changes too quickly at alpha3 = "
                f"{math.degrees(sampler.angle(low)):.4f} deg for a tolerance of "
                f"{accuracy.frequency:g}; "
                "give a larger one."
            )
        waiting += _halves(sampler, low, high)
    return pieces


def _halves(sampler: Sampler, low: float, high: float) -> list[list[float]]:
    """Return the first points of both halves between two stroke variables."""
    middle = (low + high) / 2.0
    ends = (low, middle), (middle, high)
    return [first_points(sampler.samples, *some) for some in ends]
