# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Tables over alpha3 by several interpolations, on equispaced points and on chosen ones."""

import itertools
import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PchipInterpolator

from benchmark.speed.samples import N_LIVE, Sampler
from benchmark.speed.scene import MODES

FloatArray = NDArray[np.float64]

DEGREE = 5  # degree of a piecewise Chebyshev polynomial
_START = 5  # points from which others are chosen


@dataclass(frozen=True, slots=True)
class PolynomialTable:
    """Piecewise polynomials, highest power first, (n_pieces, degree + 1, n_columns)."""

    breaks: list[float]
    coefficients: FloatArray

    def __call__(self, alpha3: float) -> FloatArray:
        """Return all columns at an angle."""
        i = bisect_right(self.breaks, alpha3, 1, len(self.breaks) - 1) - 1
        t = alpha3 - self.breaks[i]
        first, *others = self.coefficients[i]
        for coefficient in others:
            first = first * t + coefficient
        return np.asarray(first)


@dataclass(frozen=True, slots=True)
class ChebyshevTable:
    """Piecewise Chebyshev series, (n_pieces, degree + 1, n_columns)."""

    breaks: list[float]
    coefficients: FloatArray

    def __call__(self, alpha3: float) -> FloatArray:
        """Return all columns at an angle."""
        i = bisect_right(self.breaks, alpha3, 1, len(self.breaks) - 1) - 1
        low, high = self.breaks[i], self.breaks[i + 1]
        x = min(max((2.0 * alpha3 - low - high) / (high - low), -1.0), 1.0)
        coefficients = self.coefficients[i]
        return np.asarray(np.cos(np.arange(len(coefficients)) * math.acos(x)) @ coefficients)


Interpolant = PolynomialTable | ChebyshevTable
Make = Callable[[Sampler, FloatArray, bool], Interpolant]
"""From a sampler, points and whether it is of FRF terms rather than of live values."""


def values(sampler: Sampler, points: FloatArray, terms: bool, *, rates: bool = False) -> FloatArray:
    """Return the tabulated values or their derivatives at points, (n_points, n_columns)."""
    read = sampler.rate if rates else sampler.at
    samples = [read(float(alpha3)) for alpha3 in points]
    return np.array([sample.terms if terms else sample.live for sample in samples])


def linear(sampler: Sampler, points: FloatArray, terms: bool) -> Interpolant:
    """Return a piecewise linear interpolation."""
    y = values(sampler, points, terms)
    slopes = np.diff(y, axis=0) / np.diff(points)[:, np.newaxis]
    return PolynomialTable(points.tolist(), np.stack([slopes, y[:-1]], axis=1))


def cubic(sampler: Sampler, points: FloatArray, terms: bool) -> Interpolant:
    """Return a cubic spline, not-a-knot."""
    return _of_scipy(CubicSpline(points, values(sampler, points, terms)))


def pchip(sampler: Sampler, points: FloatArray, terms: bool) -> Interpolant:
    """Return a monotone piecewise cubic (Fritsch and Carlson)."""
    return _of_scipy(PchipInterpolator(points, values(sampler, points, terms)))


def hermite(sampler: Sampler, points: FloatArray, terms: bool) -> Interpolant:
    """Return a piecewise cubic with the model's own derivatives."""
    slopes = values(sampler, points, terms, rates=True)
    return _of_scipy(CubicHermiteSpline(points, values(sampler, points, terms), slopes))


def _of_scipy(spline: CubicSpline | CubicHermiteSpline | PchipInterpolator) -> PolynomialTable:
    return PolynomialTable(spline.x.tolist(), np.ascontiguousarray(spline.c.swapaxes(0, 1)))


def chebyshev(sampler: Sampler, breaks: FloatArray, degree: int, terms: bool) -> Interpolant:
    """Return a Chebyshev series in each piece, through its Chebyshev points."""
    nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    fit = np.linalg.inv(np.polynomial.chebyshev.chebvander(nodes, degree))
    pieces = [
        fit @ values(sampler, (low + high + (high - low) * nodes) / 2.0, terms)
        for low, high in itertools.pairwise(breaks)
    ]
    return ChebyshevTable(breaks.tolist(), np.array(pieces))


def chosen(
    sampler: Sampler, stroke: tuple[float, float], n: int, make: Make, per_piece: int = 1
) -> FloatArray:
    """Choose points (or ends of pieces) by halving the intervals with the largest errors.

    Parameters
    ----------
    sampler : Sampler
        The model that is tabulated.
    stroke : tuple of float
        First and last angle, rad.
    n : int
        Number of points.
    make : callable
        The interpolation.
    per_piece : int
        Points per piece, if a piece does not interpolate at its ends.
    """
    points = np.linspace(*stroke, _START if per_piece == 1 else 2)
    while True:
        room = n - len(points) if per_piece == 1 else n // per_piece - (len(points) - 1)
        if room <= 0:
            return points
        table = make(sampler, points, False)
        # Not exactly in the middle, where odd errors are zero.
        probes = points[:-1] + 0.45 * np.diff(points)
        errors = [_error(table(float(a)), sampler.at(float(a)).live) for a in probes]
        count = max(1, min(room, len(points) // 4))
        worst = np.argsort(errors)[-count:]
        points = np.sort(np.append(points, (points[worst] + points[worst + 1]) / 2.0))


def _error(result: FloatArray, exact: FloatArray) -> float:
    """Return the relative error of the worst natural frequency."""
    return float(np.abs(result[:MODES] / exact[:MODES] - 1.0).max())


def tables(
    sampler: Sampler, stroke: tuple[float, float], n: int
) -> dict[tuple[str, bool], tuple[Interpolant, Interpolant]]:
    """Return tables of n points by interpolation and whether the points are chosen.

    There is one table of live values and one of FRF terms for each.
    """

    def both(make: Make, points: FloatArray) -> tuple[Interpolant, Interpolant]:
        return make(sampler, points, False), make(sampler, points, True)

    result = {}
    for name, make in (
        ("linear", linear),
        ("cubic", cubic),
        ("PCHIP", pchip),
        ("Hermite", hermite),
    ):
        result[name, False] = both(make, np.linspace(*stroke, n))
        result[name, True] = both(make, chosen(sampler, stroke, max(n, _START), make))

    def whole(sampler: Sampler, points: FloatArray, terms: bool) -> Interpolant:
        return chebyshev(sampler, points, n - 1, terms)

    def pieces(sampler: Sampler, points: FloatArray, terms: bool) -> Interpolant:
        return chebyshev(sampler, points, DEGREE, terms)

    each = DEGREE + 1
    result["Chebyshev", False] = both(whole, np.array(stroke))
    result["piecewise Chebyshev", False] = both(pieces, np.linspace(*stroke, n // each + 1))
    result["piecewise Chebyshev", True] = both(pieces, chosen(sampler, stroke, n, pieces, each))
    return result


def errors(
    table: Interpolant, exact: Callable[[float], FloatArray], angles: FloatArray
) -> tuple[float, float]:
    """Return the worst relative error of frequencies and of the peak, over angles."""
    result = np.array([table(float(alpha3)) for alpha3 in angles])
    right = np.array([exact(float(alpha3)) for alpha3 in angles])
    frequencies = float(np.abs(result[:, :MODES] / right[:, :MODES] - 1.0).max())
    at = np.abs(result[:, N_LIVE - 2] / right[:, N_LIVE - 2] - 1.0).max()
    magnitude = np.abs(np.expm1(result[:, N_LIVE - 1] - right[:, N_LIVE - 1])).max()
    return frequencies, float(max(at, magnitude))
