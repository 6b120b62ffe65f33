# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Sections against tables, limits and an independent series."""

import math

import numpy as np
import pytest

from linkage_vibration.mechanics.sections import rectangle, tube


@pytest.mark.parametrize(
    ("ratio", "coefficient"), [(1.0, 0.1406), (1.5, 0.1958), (2.0, 0.2287), (10.0, 0.3123)]
)
def test_torsion_of_rectangles_as_tabled(ratio: float, coefficient: float) -> None:
    """J = c a b^3 with the textbooks' c (Timoshenko and Goodier), whichever side stands."""
    expected = pytest.approx(coefficient * ratio * 0.03**4, rel=4e-4)
    assert rectangle(0.03, ratio * 0.03, 0.3).torsion_constant == expected
    assert rectangle(ratio * 0.03, 0.03, 0.3).torsion_constant == expected


@pytest.mark.parametrize("height", [1.0, 1.7, 6.0])
def test_torsion_of_rectangles_by_another_series(height: float) -> None:
    """J is twice the volume under Prandtl's stress function, expanded in double sines."""
    m = np.arange(1.0, 2000.0, 2.0)
    m2, n2 = m[:, np.newaxis] ** 2, m**2
    volume = (1.0 / (m2 * n2 * (m2 + n2 / height**2))).sum()
    expected = 256.0 * height / math.pi**6 * volume
    assert rectangle(1.0, height, 0.3).torsion_constant == pytest.approx(expected, rel=1e-8)


def test_torsion_of_a_strip() -> None:
    """A very thin strip approaches J = a b^3 / 3 (1 - 0.63025 b / a)."""
    ratio = 1e-4
    expected = ratio**3 / 3.0 * (1.0 - 0.630249 * ratio)
    assert rectangle(ratio, 1.0, 0.3).torsion_constant == pytest.approx(expected, rel=1e-10)


def test_rectangle_in_both_planes() -> None:
    """Height counts in the plane, width across it, and Cowper's coefficient in both."""
    section = rectangle(0.02, 0.06, 0.3)
    assert section.area == pytest.approx(1.2e-3)
    assert section.second_moment == pytest.approx(3.6e-7)
    assert section.second_moment_out == pytest.approx(4e-8)
    assert section.shear_coefficient == section.shear_coefficient_out == pytest.approx(13 / 15.3)
    assert rectangle(0.02, 0.06, 0.0).shear_coefficient == pytest.approx(5 / 6)


def test_round_bar() -> None:
    """A tube with no hole is a round bar, with Cowper's 6 (1 + nu) / (7 + 6 nu)."""
    bar, radius = tube(0.03, 0.0, 0.3), 0.015
    assert bar.area == pytest.approx(math.pi * radius**2)
    assert bar.second_moment == bar.second_moment_out == pytest.approx(math.pi * radius**4 / 4)
    assert bar.torsion_constant == pytest.approx(math.pi * radius**4 / 2)
    assert bar.shear_coefficient == bar.shear_coefficient_out == pytest.approx(7.8 / 8.8)


def test_thin_tube() -> None:
    """A thin tube has J = 2 pi r^3 t and Cowper's 2 (1 + nu) / (4 + 3 nu)."""
    radius, wall = 0.05, 1e-6
    section = tube(2 * radius + wall, 2 * radius - wall, 0.3)
    assert section.area == pytest.approx(2 * math.pi * radius * wall)
    assert section.torsion_constant == pytest.approx(2 * math.pi * radius**3 * wall, rel=1e-6)
    assert section.shear_coefficient == pytest.approx(2.6 / 4.9)
