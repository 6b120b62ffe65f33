# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Adds points to a piece of the stroke until its polynomials meet the tolerance."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.mechanics.description import Response
from linkage_vibration.table.interpolation import (
    EVEN,
    interpolate_positive,
    interpolation_matrix,
    leja_points,
)
from linkage_vibration.table.tabulation.accuracy import Accuracy
from linkage_vibration.table.tabulation.peaks import notable, row_errors
from linkage_vibration.table.tabulation.sampling import Sampler
from linkage_vibration.table.tabulation.tracking import (
    GRID,
    Tracked,
    Tracker,
    crossing_gaps,
    mix_closely,
    unclear_steps,
)

_SHORTER = 8.0  # Rounding is checked again when a piece is so many times shorter.
_BATCH = 3  # So many points measure the error; one alone may be where it is zero.
_FIRST = 2 * _BATCH  # A piece begins with so many points.
MOST = 48
"""Points of a piece; if a polynomial needs more, halving the piece needs fewer."""

_EQUALLY_GOOD = math.log(3.0)  # A solved point is used if its product is a third of Leja's.
_LONG = 0.01  # In pieces above this share of the stroke, each possible highest maximum exists.


P = TypeVar("P")


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Stroke variables of a piece, and its error where modes cross."""

    fitted: list[float]  # ascending: the points of its polynomials
    more: list[float]  # the points of finer polynomials, which measure their error
    between: list[float]  # other points, at which modes could not be distinguished
    gap: float  # relative error of frequencies where modes cross that veer by a negligible gap

    @property
    def ends(self) -> tuple[float, float]:
        """Stroke variables at which it begins and ends."""
        return self.fitted[0], self.fitted[-1]

    @property
    def held(self) -> list[float]:
        """The points to which its polynomials are not fitted."""
        return sorted({*self.more, *self.between})

    @property
    def finer(self) -> "Piece":
        """The same piece with the finer polynomials."""
        return replace(self, fitted=sorted({*self.fitted, *self.more}))


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
    """Refine pieces from their first points, the last first, and halve those that cannot be.

    The function that refines a piece returns it, or the reason why it must be halved.
    """
    pieces, suspicious = list[P](), sampler.length
    while waiting:
        points = waiting.pop()
        low, high = points[0], points[-1]
        piece = refined(points)
        if not isinstance(piece, str):
            pieces.append(piece)
            sampler.finish(high - low)
            continue
        if high - low < 2.0 * sampler.shortest:
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


def refine(tracker: Tracker, fitted: list[float], accuracy: Accuracy) -> Piece | None:
    """Add points until natural frequencies and peaks meet the tolerance; None to halve the piece.

    Checked are: maxima that exist at every point suffice for the highest peak, polynomials meet the
    tolerance, shapes identify the modes, modes that seem to cross do cross.
    """
    sampler, tolerance = tracker.sampler, accuracy.frequency
    response = sampler.response
    long = fitted[-1] - fitted[0] > _LONG * sampler.length
    between: set[float] = set()  # where modes could not be distinguished
    while len(fitted) <= MOST:
        more = more_points(fitted)
        held = sorted(between.union(more).difference(fitted))
        tracked = tracker.follow(sorted(fitted + held))
        at, sizes = tracked.peak_frequencies, tracked.peak_magnitudes
        maxima = notable(at, sizes, response.peak_band, accuracy.equal_height, strict=long)
        if maxima is None:
            return None
        if mix_closely(tracked, tolerance):
            tracker.heed_veering()
        polynomials = _Polynomials(tracked, maxima, response, accuracy)
        grid = np.linspace(fitted[0], fitted[-1], GRID)
        # Polynomials through all points are exact at those to which the first are not fitted.
        misses = polynomials.differ(fitted, fitted + held, np.array(held))
        if misses or polynomials.differ(fitted, fitted + more, grid):
            fitted = sorted(fitted + more)
            continue
        unclear = unclear_steps(sampler, tracked)
        if unclear:
            between.update(unclear)
            continue
        gaps = crossing_gaps(sampler, fitted, tracked)
        veering = {x for x, gap in gaps.items() if gap > tolerance / 2.0}
        if not veering:
            more.append(polynomials.worst(fitted, more))
            sampler.at(more[-1])
            gap = max(gaps.values(), default=0.0)
            return Piece(fitted, more, sorted(between.difference(fitted)), gap)
        tracker.heed_veering()
        if veering <= between:
            return None  # points there did not help; halving will
        between |= veering
    return None


@dataclass(frozen=True, slots=True, eq=False)
class _Polynomials:
    """Compares polynomials with the samples that they represent."""

    tracked: Tracked
    maxima: BoolArray
    response: Response  # bands and number of modes of the table
    accuracy: Accuracy

    def differ(self, fitted: list[float], finer: list[float], at: FloatArray) -> bool:
        """Return whether more points change the polynomials too much at some stroke variables."""
        modes, band = self.response.modes, self.response.peak_band
        value, peak = row_errors(self._rows(fitted, at), self._rows(finer, at), modes, band)
        return bool(value > self.accuracy.frequency or peak > self.accuracy.refined_peak)

    def worst(self, fitted: list[float], more: list[float]) -> float:
        """Return the stroke variable at which more points change a value or an FRF most.

        The changes are compared with their tolerances. The shift of a pole in half-power
        half-widths, divided by sqrt(2), is the relative change of its resonance in the L2 norm.
        """
        grid = dense(fitted[0], fitted[-1])
        before, ratios = self._values(fitted, grid)
        after, finer_ratios = self._values([*fitted, *more], grid)
        off, ratio = np.abs(before - after), np.abs(ratios / finer_ratios - 1.0)
        shift = np.hypot(off / finer_ratios, ratio) / math.sqrt(2.0) / self.accuracy.frf
        shift[np.exp(after) > self.response.band[1]] = 0.0
        off = np.maximum(off, ratio)[:, : self.response.modes] / self.accuracy.frequency
        return float(grid[np.maximum(shift.max(axis=1), off.max(axis=1)).argmax()])

    def _rows(self, points: list[float], at: FloatArray) -> FloatArray:
        """Return frequencies, ratios, and frequencies and heights of the maxima, as `row_errors`.

        They are those of the polynomials through some points.
        """
        rows = self.tracked.at(points)
        matrix = interpolation_matrix(self.tracked.variables[rows], at)
        logarithms, ratios = self._values(points, at)
        maxima = self.tracked.peak_frequencies[rows][:, self.maxima]
        heights = self.tracked.peak_magnitudes[rows][:, self.maxima]
        parts = (
            np.exp(logarithms[:, : self.response.modes]),
            ratios[:, : self.response.modes],
            matrix @ maxima,
        )
        return np.hstack([*parts, interpolate_positive(matrix, heights)])

    def _values(self, points: list[float], at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return logarithms of frequencies and ratios of all tracked modes."""
        rows = self.tracked.at(points)
        matrix = interpolation_matrix(self.tracked.variables[rows], at)
        return matrix @ self.tracked.log_frequencies[rows], matrix @ self.tracked.ratios[rows]


def dense(low: float, high: float) -> FloatArray:
    """Return stroke variables over a piece, (401,), denser towards its ends."""
    turn = np.linspace(0.0, math.pi, GRID)
    grid = low + (high - low) * np.sin(turn / 2.0) ** 2
    grid[-1] = high
    return grid
