# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Polynomial interpolation on points that are added where the error is largest."""

from collections.abc import Sequence

import numpy as np

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray

NearTerms = tuple[ComplexArray, FloatArray, ComplexArray]
"""Terms of FRFs: k and c, (n, n_terms), as in `PoleResidue`, and shapes, (n, n_places, n_terms)."""

EVEN = 1e-6  # of a logarithm: products that differ by less are equal
_LARGE = 600.0  # the logarithm of a number that a float can still hold
_GRID = 1001  # places in an interval among which the next point is chosen


def leja_points(points: Sequence[float], low: float, high: float, count: int) -> list[float]:
    """Choose the points that continue a Leja sequence in an interval.

    Each is where the product of the distances to all previous points is largest (Leja 1957): this
    is the factor of the error of polynomial interpolation that depends on the points. So the next
    points measure the error of the previous ones, and join them if it is too large.

    Parameters
    ----------
    points, count
        The points so far, at least one, and the number of points to add.
    low, high : float
        Ends of the interval.

    Examples
    --------
    >>> leja_points([-1.0, 1.0], -1.0, 1.0, 1)
    [0.0]
    """
    grid = np.linspace(low, high, _GRID)
    chosen: list[float] = []
    with np.errstate(divide="ignore"):
        product = np.log(np.abs(grid[:, np.newaxis] - np.array(points))).sum(axis=1)
        for _ in range(count):
            # The last of equally good ones, on every machine, however the logarithms are rounded.
            chosen.append(float(grid[np.flatnonzero(product > product.max() - EVEN)[-1]]))
            product += np.log(np.abs(grid - chosen[-1]))
    return chosen


def interpolation_matrix(points: FloatArray, at: FloatArray) -> FloatArray:
    """Return the matrix, (n, n_points), that turns values at points into those of a polynomial.

    It is the barycentric formula of the second kind (Berrut and Trefethen 2004), stable for points
    that are denser towards the ends of their interval, such as Leja's and Chebyshev's.

    Parameters
    ----------
    points, at : ndarray, (n_points,) and (n,)
        Distinct, in any order; where the polynomial is evaluated.

    Examples
    --------
    >>> interpolation_matrix(np.array([0.0, 1.0]), np.array([0.25, 1.0]))
    array([[0.75, 0.25],
           [0.  , 1.  ]])
    """
    # Scaled by the capacity, a quarter of the interval, the products neither grow nor vanish.
    scale = 4.0 / (points.max() - points.min())
    apart = scale * (points[:, np.newaxis] - points) + np.eye(len(points))
    weights = 1.0 / apart.prod(axis=1)
    distance = scale * (at[:, np.newaxis] - points)
    hits = distance == 0.0
    terms = weights / np.where(hits, 1.0, distance)
    matrix = terms / terms.sum(axis=1, keepdims=True)
    matrix[hits.any(axis=1)] = hits[hits.any(axis=1)]
    return np.asarray(matrix)


def interpolate_positive(matrix: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate positive values by their logarithms, so that they stay positive.

    Parameters
    ----------
    matrix : ndarray, (n, n_points)
        From `interpolation_matrix`.
    values : ndarray, (n_points, ...)
        At the points; a polynomial that exceeds the range of floats is limited.

    Examples
    --------
    >>> matrix = interpolation_matrix(np.array([0.0, 1.0]), np.array([0.5]))
    >>> np.round(interpolate_positive(matrix, np.array([1.0, 100.0])), 9)
    array([10.])
    """
    return np.asarray(np.exp(np.clip(matrix @ np.log(values), -_LARGE, _LARGE)))


def interpolate_terms(matrix: FloatArray, terms: NearTerms) -> NearTerms:
    """Interpolate the terms of FRFs.

    Parameters
    ----------
    matrix, terms
        From `interpolation_matrix`, and the terms at its points.
    """
    stiffness, decay, shapes = terms
    k = np.exp(matrix @ np.log(stiffness))
    return k, matrix @ decay, np.tensordot(matrix, shapes, axes=1)


def stroke_variable(alpha3: FloatArray, toggles: tuple[float, float] | None) -> FloatArray:
    """Turn an input angle into the variable in which the mechanism moves smoothly.

    Near a toggle every quantity depends on the square root of the distance, which no polynomial in
    the angle follows. With alpha3 = m - h cos(x) between two toggles m - h and m + h it is a smooth
    function of x. Without toggles x is the angle itself.

    Parameters
    ----------
    alpha3, toggles
        rad, between the toggles; rad, or None.
    """
    if toggles is None:
        return alpha3
    middle, half = (toggles[0] + toggles[1]) / 2.0, (toggles[1] - toggles[0]) / 2.0
    return np.asarray(np.arccos(np.clip((middle - alpha3) / half, -1.0, 1.0)))


def stroke_angle(variable: FloatArray, toggles: tuple[float, float] | None) -> FloatArray:
    """Turn the variable of `stroke_variable` back into the input angle, (n,), rad.

    Parameters
    ----------
    variable, toggles
        From `stroke_variable`, (n,); rad, or None.
    """
    if toggles is None:
        return variable
    middle, half = (toggles[0] + toggles[1]) / 2.0, (toggles[1] - toggles[0]) / 2.0
    return np.asarray(middle - half * np.cos(variable))
