# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Chooses the points of pieces of the stroke, and halves those that too many points would need."""

import math
from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.table.interpolation import EVEN, leja_points
from linkage_vibration.table.tabulation.accuracy import Accuracy
from linkage_vibration.table.tabulation.sampling import Sampler

_SHORTER = 8.0  # Rounding is checked again when a piece is so many times shorter.
_SHORTEST = 1e-7  # No joint sensor resolves this share of the stroke, 1e-5 deg of 90 deg.
_BATCH = 3  # Three new points measure the error, which may be zero at a single one.
_FIRST = 2 * _BATCH  # A piece begins with so many points.
MOST = 48  # Points of a piece; if a polynomial needs more, halving the piece needs fewer

GRID = 201  # Places at which the polynomials of a piece are evaluated: four to each of 48 points

_EQUALLY_GOOD = math.log(3.0)  # A solved point is used if its product is a third of Leja's.

P = TypeVar("P")


def first_points(solved: Iterable[float], low: float, high: float) -> list[float]:
    """Return the first points of a piece, near Leja's; points that are solved are preferred."""
    points, free = [low, high], [x for x in solved if low < x < high]
    while len(points) < _FIRST or (free and len(points) < MOST // 2):
        best = leja_points(points, low, high, 1)
        products = np.log(np.abs(np.subtract.outer([*best, *free], points))).sum(axis=1)
        if free and products[1:].max() > products[0] - _EQUALLY_GOOD:
            # The last of equally good ones, as in `leja_points`.
            best = [free.pop(int(np.flatnonzero(products[1:] > products[1:].max() - EVEN)[-1]))]
        elif len(points) >= _FIRST:
            break
        points += best
    return sorted(points)


def more_points(fitted: list[float]) -> list[float]:
    """Return the next points in the Leja sequence of those of a piece."""
    return leja_points(fitted, fitted[0], fitted[-1], _BATCH)


def refine_pieces(
    sampler: Sampler,
    waiting: list[list[float]],
    refined: Callable[[list[float]], P | str],
    accuracy: Accuracy,
) -> list[P]:
    """Refine pieces from their first points; halve those for which ``refined`` returns why."""
    pieces, suspicious = list[P](), sampler.length
    while waiting:
        points = waiting.pop()
        low, high = points[0], points[-1]
        piece = refined(points)
        if not isinstance(piece, str):
            pieces.append(piece)
            sampler.finish(high - low)
            continue
        if high - low < 2.0 * (_SHORTEST * sampler.length):
            raise sampler.too_short(low, piece)
        if high - low < suspicious:
            suspicious = (high - low) / _SHORTER
            sampler.check_rounding(accuracy)
        waiting += halves(sampler.solved, low, high)
    return pieces


def halves(solved: Iterable[float], low: float, high: float) -> list[list[float]]:
    """Return the first points of both halves between two stroke variables."""
    middle = (low + high) / 2.0
    return [first_points(solved, low, middle), first_points(solved, middle, high)]


def dense(low: float, high: float, count: int) -> FloatArray:
    """Return stroke variables over a piece, (count,), denser towards its ends."""
    turn = np.linspace(0.0, math.pi, count)
    grid = low + (high - low) * np.sin(turn / 2.0) ** 2
    grid[-1] = high
    return grid
