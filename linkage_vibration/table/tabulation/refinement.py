# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Adds points to a piece of the stroke until its polynomials meet the tolerance."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.table.interpolation import (
    interpolate_positive,
    interpolation_matrix,
    leja_points,
)
from linkage_vibration.table.tabulation.accuracy import Accuracy
from linkage_vibration.table.tabulation.peaks import apart, heights, notable
from linkage_vibration.table.tabulation.tracking import Tracked, Tracker, unclear_steps
from linkage_vibration.table.tabulation.veering import GRID, crossing_gaps, mix_closely

FloatArray = NDArray[np.float64]

_BATCH = 3  # points that tell the error of those before: one alone may stand where it is zero
_FIRST = 2 * _BATCH  # points of a piece to begin with
_MOST = 48  # points of a piece; a polynomial that needs more converges so slowly that halving pays
_EQUALLY_GOOD = math.log(3.0)  # of a Leja point's product: a point that is solved already serves
_LONG = 0.01  # of the stroke: in longer pieces maxima that may be the highest are there all along


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Stroke variables of a piece, and what is known of its error.

    Attributes
    ----------
    fitted : list of float
        Ascending: the points of its polynomials.
    held : list of float
        Those that tell their error.
    gap : float
        Relative error of frequencies where modes cross that veer by next to nothing.
    """

    fitted: list[float]
    held: list[float]
    gap: float

    @property
    def ends(self) -> tuple[float, float]:
        """Where it begins and ends."""
        return self.fitted[0], self.fitted[-1]


def first_points(solved: Iterable[float], low: float, high: float) -> list[float]:
    """Return the first points between two stroke variables, near Leja's, some solved already."""
    points, free = [low, high], [x for x in solved if low < x < high]
    while len(points) < _FIRST or (free and len(points) < _MOST // 2):
        best = leja_points(points, low, high, 1)
        products = np.log(np.abs(np.subtract.outer([*best, *free], points))).sum(axis=1)
        if free and products[1:].max() > products[0] - _EQUALLY_GOOD:
            best = [free.pop(int(products[1:].argmax()))]
        elif len(points) >= _FIRST:
            break
        points += best
    return sorted(points)


def more_points(fitted: list[float]) -> list[float]:
    """Return the points that come next in the Leja sequence of those of a piece."""
    return leja_points(fitted, fitted[0], fitted[-1], _BATCH)


def refine(tracker: Tracker, fitted: list[float], accuracy: Accuracy) -> Piece | None:
    """Add points until natural frequencies and peaks meet the tolerance.

    In turn it is asked whether maxima that are there all along tell the highest peak, whether the
    polynomials meet the tolerance, whether shapes tell which mode is which, and whether modes that
    seem to cross do.

    Parameters
    ----------
    tracker : Tracker
        Over the whole stroke.
    fitted : list of float
        Stroke variables to begin with, ascending; the first and the last bound the piece.
    accuracy : Accuracy
        What is asked for.

    Returns
    -------
    Piece or None
        None where it takes too many points, or others elsewhere: the piece is to be halved.

    Raises
    ------
    TableError
        If a mode cannot be followed.
    """
    sampler, tolerance = tracker.sampler, accuracy.frequency
    band, n_modes = sampler.response.band, sampler.response.modes
    long = fitted[-1] - fitted[0] > _LONG * sampler.length
    between: set[float] = set()  # where modes could not be told apart
    while len(fitted) <= _MOST:
        more = more_points(fitted)
        held = sorted(between.union(more).difference(fitted))
        tracked = tracker.follow(sorted(fitted + held))
        at, sizes = tracked.peak_frequencies, tracked.peak_magnitudes
        maxima = notable(at, sizes, band, accuracy.equal_height, strict=long)
        if maxima is None:
            return None
        if mix_closely(tracked, tolerance):
            tracker.heed_veering()
        told = _Told(tracked, maxima, n_modes, band, accuracy)
        if told.misses(fitted) or told.moves(fitted, fitted + more):
            fitted = sorted(fitted + more)
            continue
        unclear = unclear_steps(sampler, tracked)
        if unclear:
            between.update(unclear)
            continue
        gaps = crossing_gaps(sampler, fitted, tracked)
        veering = {x for x, gap in gaps.items() if gap > tolerance / 2.0}
        if not veering:
            return Piece(fitted, held, max(gaps.values(), default=0.0))
        tracker.heed_veering()
        if veering <= between:
            return None  # points there did not help; halving will
        between |= veering
    return None


@dataclass(frozen=True, slots=True, eq=False)
class _Told:
    """What polynomials are to tell of some samples, and whether they do."""

    tracked: Tracked
    maxima: NDArray[np.bool_]
    n_modes: int
    band: tuple[float, float]
    accuracy: Accuracy

    def misses(self, fitted: list[float]) -> bool:
        """Whether polynomials are off at the samples that they are not fitted to."""
        own = self.tracked.at(fitted)
        frequencies, at, sizes = self._between(fitted, self.tracked.variables[~own])
        exact = self.tracked.log_frequencies[~own, : self.n_modes]
        exact_at = self.tracked.peak_frequencies[~own][:, self.maxima]
        exact_sizes = self.tracked.peak_magnitudes[~own][:, self.maxima]
        # Of two peaks of one height either is the highest: each is held against itself.
        best = heights(at, sizes, self.band).argmax(axis=1)
        rows = np.arange(len(best))
        height = heights(exact_at, exact_sizes, self.band).max(axis=1)
        off = np.abs(sizes[rows, best] / height - 1.0)
        away = apart(at[rows, best], exact_at[rows, best])
        return self._exceeds(frequencies - exact, np.maximum(off, away))

    def moves(self, fitted: list[float], finer: list[float]) -> bool:
        """Whether more points move the polynomials anywhere in the piece."""
        grid = np.linspace(fitted[0], fitted[-1], GRID)
        before, at, sizes = self._between(fitted, grid)
        after, finer_at, finer_sizes = self._between(finer, grid)
        height = heights(at, sizes, self.band).max(axis=1)
        finer_height = heights(finer_at, finer_sizes, self.band).max(axis=1)
        return self._exceeds(before - after, np.abs(height / finer_height - 1.0))

    def _exceeds(self, logarithms: FloatArray, peaks: FloatArray) -> bool:
        """Whether errors, of natural frequencies' logarithms or of peaks, are too large."""
        frequency, peak = np.abs(logarithms).max(), peaks.max()
        return bool(frequency > self.accuracy.frequency or peak > self.accuracy.refined_peak)

    def _between(
        self, points: list[float], at: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Logarithms of natural frequencies, places (Hz) and heights (m/N) of the maxima."""
        own = self.tracked.at(points)
        matrix = interpolation_matrix(self.tracked.variables[own], at)
        return (
            matrix @ self.tracked.log_frequencies[own, : self.n_modes],
            matrix @ self.tracked.peak_frequencies[own][:, self.maxima],
            interpolate_positive(matrix, self.tracked.peak_magnitudes[own][:, self.maxima]),
        )
