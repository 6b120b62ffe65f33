# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Angles of a table, and polynomial interpolation on points where the error is largest."""

import math
from collections.abc import Sequence

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray

EVEN = 1e-6  # Products are equal if their logarithms differ by less.
_TURN = 2.0 * math.pi
_FARTHEST = 1e6  # rad; a larger angle is too coarse to be reduced to one turn
_GRID = 1001  # The next point is chosen among so many in its interval.


def leja_points(points: Sequence[float], low: float, high: float, count: int) -> list[float]:
    """Return the points that continue a Leja sequence in an interval (Leja 1957).

    Each has the largest product of distances to all before, which the error of interpolation has,
    too. So the next points measure the error of the previous ones.

    >>> leja_points([-1.0, 1.0], -1.0, 1.0, 1)
    [0.0]
    """
    grid = np.linspace(low, high, _GRID)
    chosen: list[float] = []
    with np.errstate(divide="ignore"):  # log(0), at a point that is there
        product = np.log(np.abs(grid[:, np.newaxis] - np.array(points))).sum(axis=1)
        for _ in range(count):
            # The last of equally good ones, on every machine, however the logarithms are rounded.
            chosen.append(float(grid[np.flatnonzero(product > product.max() - EVEN)[-1]]))
            product += np.log(np.abs(grid - chosen[-1]))
    return chosen


def interpolation_matrix(points: FloatArray, at: FloatArray) -> FloatArray:
    """Return the matrix, (n, n_points), that turns values at points into those of a polynomial.

    The second barycentric formula (Berrut and Trefethen 2004) is stable for points that are denser
    towards the ends.

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


def stroke_variable(alpha3: FloatArray, toggles: tuple[float, float] | None) -> FloatArray:
    """Turn input angles (rad) into the variable in which the mechanism moves smoothly.

    Near a toggle everything depends on the square root of the distance, so it is x in alpha3 = m -
    h cos(x) between toggles m - h and m + h; without toggles, the angle itself.
    """
    if toggles is None:
        return alpha3
    middle, half = (toggles[0] + toggles[1]) / 2.0, (toggles[1] - toggles[0]) / 2.0
    return np.asarray(np.arccos(np.minimum(np.maximum((middle - alpha3) / half, -1.0), 1.0)))


def stroke_angle(variable: FloatArray, toggles: tuple[float, float] | None) -> FloatArray:
    """Turn the variable of `stroke_variable` back into the input angle, (n,), rad."""
    if toggles is None:
        return variable
    middle, half = (toggles[0] + toggles[1]) / 2.0, (toggles[1] - toggles[0]) / 2.0
    return np.asarray(middle - half * np.cos(variable))


def angles_in_table(alpha3: FloatArray, alpha3_range: tuple[float, float]) -> FloatArray:
    """Return the angles of a table that are the same positions, rad, (n,); NaN if none is."""
    low, high = alpha3_range
    inside = (low <= alpha3) & (alpha3 <= high)
    if inside.all():
        return alpha3
    with np.errstate(invalid="ignore"):  # an infinite angle
        turned = low + (alpha3 - low) % _TURN
    if covers_a_turn(alpha3_range):
        near, turned = np.abs(alpha3) < _FARTHEST, np.minimum(turned, high)
    else:
        # More than one turn would let angles in degrees pass for radians.
        near = (np.abs(alpha3 - turned) < 1.5 * _TURN) & (turned <= high)
    return np.where(inside, alpha3, np.where(near, turned, math.nan))


def covers_a_turn(alpha3_range: tuple[float, float]) -> bool:
    """Return whether a table over these angles, rad, belongs to a crank that turns all the way."""
    return alpha3_range[1] - alpha3_range[0] >= _TURN * (1.0 - 1e-12)
