# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Polynomials on Leja points: exact where they must be, and as quick to converge as Chebyshev's."""

import math

import numpy as np
import pytest

from linkage_vibration.table.interpolation import (
    interpolation_matrix,
    leja_points,
    stroke_angle,
    stroke_variable,
)


def leja(count: int) -> np.ndarray:
    """Return the first points of the sequence between -1 and 1."""
    return np.array([-1.0, 1.0, *leja_points([-1.0, 1.0], -1.0, 1.0, count - 2)])


def test_polynomials_are_reproduced() -> None:
    """Through n points every polynomial of degree n - 1 is exact, also at the points."""
    points = leja(12)
    at = np.linspace(-1.0, 1.0, 101)
    for degree in range(12):
        matrix = interpolation_matrix(points, at) @ points**degree
        np.testing.assert_allclose(matrix, at**degree, atol=1e-13)
    np.testing.assert_array_equal(interpolation_matrix(points, points), np.eye(12))


def test_convergence_is_geometric() -> None:
    """For 1 / (x^2 + a^2) the error falls by the ellipse of the pole: a + sqrt(1 + a^2) a point."""
    a = 0.5
    at = np.linspace(-1.0, 1.0, 1001)
    exact = 1.0 / (at**2 + a**2)
    errors = []
    for count in (17, 33):
        points = leja(count)
        matrix = interpolation_matrix(points, at) @ (1.0 / (points**2 + a**2))
        errors.append(np.abs(matrix - exact).max())
    rate = math.log(errors[0] / errors[1]) / 16
    assert rate == pytest.approx(math.log(a + math.sqrt(1 + a**2)), rel=0.1)


def test_next_points_tell_the_error() -> None:
    """Three further points of the sequence see the largest error to within a factor of two."""
    at = np.linspace(-1.0, 1.0, 2001)
    for pole in (0.2, 0.5, 1.0):
        for count in (12, 20, 28):
            points = leja(count + 3)

            def error(x: np.ndarray, fitted: np.ndarray = points[:count], a: float = pole) -> float:
                matrix = interpolation_matrix(fitted, x) @ (1.0 / (fitted**2 + a**2))
                return float(np.abs(matrix - 1.0 / (x**2 + a**2)).max())

            assert error(points[count:]) >= error(at) / 2.0


def test_stroke_variable_removes_the_root_at_a_toggle() -> None:
    """Beside a toggle sqrt(distance) needs twelve points where the angle itself defeats fifty."""
    toggles = (-1.0, 1.0)
    alphas = np.linspace(0.0, 1.0, 1001)

    def error(count: int, smooth: bool) -> float:
        def x(alpha: np.ndarray) -> np.ndarray:
            return stroke_variable(alpha, toggles if smooth else None)

        ends = x(np.array([0.0, 1.0]))
        points = ends.mean() + (ends[1] - ends[0]) / 2.0 * leja(count)
        values = np.sqrt(np.maximum(1.0 - stroke_angle(points, toggles if smooth else None), 0.0))
        matrix = interpolation_matrix(points, x(alphas)) @ values
        return float(np.abs(matrix - np.sqrt(1.0 - alphas)).max())

    assert error(12, smooth=True) < 1e-10
    assert error(50, smooth=False) > 1e-3


def test_stroke_variable_and_angle_undo_each_other() -> None:
    """Between the toggles to rounding, at them exactly; without toggles they are the same."""
    angles = np.linspace(-0.5, 2.0, 26)
    toggles = (-0.5, 2.0)
    np.testing.assert_allclose(
        stroke_angle(stroke_variable(angles, toggles), toggles), angles, atol=1e-15
    )
    assert stroke_variable(angles, None) is angles
    assert stroke_angle(angles, None) is angles
