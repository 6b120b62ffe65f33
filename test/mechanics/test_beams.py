# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Beam elements against closed forms, and how fast they converge."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from linkage_vibration.mechanics.beams import element_matrices, link_matrices
from linkage_vibration.mechanics.description import Link, Material, Section, rectangle

FloatArray = NDArray[np.float64]
STEEL = Material(210e9, 7800.0, 0.3)
LENGTH = 1.2


def beam(section: Section, elements: int, count: int = 1) -> Link:
    """Return a link with two points, 1.2 m apart."""
    return Link("beam", (("A", 0.0), ("B", LENGTH)), STEEL, section, count, elements, 20, None)


def frequencies(link: Link, held: list[int]) -> FloatArray:
    """Return natural frequencies in rad/s with some DoFs held (negative: from the end)."""
    mass, stiffness, _ = link_matrices(link)
    free = np.setdiff1d(np.arange(len(mass)), np.array(held, dtype=int) % len(mass))
    values = eigh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], eigvals_only=True)
    return np.sqrt(np.abs(values))


AXIAL = [-3, 0]  # u of both ends
PINNED = [*AXIAL, 1, -2]
CLAMPED_FREE = [0, 1, 2]


def bending(link: Link, root: float) -> float:
    """Return an Euler-Bernoulli frequency, (root / L)^2 sqrt(E I / rho A), in rad/s."""
    section = link.section
    wave = math.sqrt(STEEL.youngs_modulus * section.second_moment / (STEEL.density * section.area))
    return (root / LENGTH) ** 2 * wave


@pytest.mark.parametrize(
    ("held", "roots", "rigid"),
    [
        (PINNED, [math.pi, 2 * math.pi, 3 * math.pi], 0),
        (CLAMPED_FREE, [1.8751040687, 4.6940911330, 7.8547574382], 0),
        ([], [4.7300407449, 7.8532046241, 10.9956078380], 3),
    ],
    ids=["pinned", "clamped-free", "free-free"],
)
def test_slender_beams(held: list[int], roots: list[float], rigid: int) -> None:
    """A very slender beam has Euler's bending frequencies, and its rigid modes at zero."""
    link = beam(rectangle(0.01, 0.0012, 0.3), 40)
    found = frequencies(link, held)
    assert found[rigid : rigid + 3] == pytest.approx([bending(link, r) for r in roots], rel=2e-5)
    assert (found[:rigid] < 1e-3 * found[rigid]).all()


def test_rod() -> None:
    """A clamped-free rod's first axial frequency is c / (4 L), approached at second order."""
    exact = math.pi / 2 * math.sqrt(STEEL.youngs_modulus / STEEL.density) / LENGTH
    errors = []
    for elements in (4, 8, 16):
        link = beam(rectangle(0.02, 0.02, 0.3), elements)
        bending_held = [i for i in range(3 * elements + 3) if i % 3]
        errors.append(frequencies(link, [0, *bending_held])[0] / exact - 1.0)
    assert 0.0 < errors[-1] < 5e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.02)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.02)


def timoshenko(section: Section, n: int) -> float:
    """Return the n-th frequency of a pinned Timoshenko beam, in rad/s.

    With w = sin(k x), k = n pi / L: the smaller root of
    E I k^4 - (rho A + rho I k^2 (1 + E / (kappa G))) w^2 + rho^2 I / (kappa G) w^4 = 0.
    """
    k = n * math.pi / LENGTH
    shear = section.shear_coefficient * STEEL.shear_modulus
    a = STEEL.density**2 * section.second_moment / shear
    b = STEEL.density * (
        section.area + section.second_moment * k**2 * (1 + STEEL.youngs_modulus / shear)
    )
    c = STEEL.youngs_modulus * section.second_moment * k**4
    return math.sqrt((b - math.sqrt(b**2 - 4 * a * c)) / (2 * a))


@pytest.mark.parametrize("n", [1, 2, 3])
def test_deep_beam_converges_to_timoshenko(n: int) -> None:
    """A deep beam approaches the exact frequency from above, at second order.

    Fourth order, as Euler's element has it, ends where elements get as short as they are deep.
    """
    section = rectangle(0.05, 0.15, 0.3)
    exact = timoshenko(section, n)
    held = [i for i in range(3 * 33) if i % 3 == 0]
    errors = []
    for elements in (8, 16, 32):
        link = beam(section, elements)
        axial = [i for i in held if i < 3 * elements + 3]
        found = frequencies(link, [*axial, 1, -2])
        errors.append(found[n - 1] / exact - 1.0)
    assert all(error > 0.0 for error in errors)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.03)
    assert exact < 0.99 * bending(beam(section, 1), n * math.pi)  # shear matters here


def test_tip_deflection_is_exact_with_one_element() -> None:
    """A cantilever's tip moves by F L^3 / (3 E I) + F L / (kappa A G), whatever the mesh."""
    section = rectangle(0.05, 0.2, 0.3)
    _, stiffness = element_matrices(LENGTH, section, STEEL)
    tip = np.linalg.inv(stiffness[3:, 3:])[1, 1]
    shear = section.shear_coefficient * section.area * STEEL.shear_modulus
    exact = LENGTH**3 / (3 * STEEL.youngs_modulus * section.second_moment) + LENGTH / shear
    assert tip == pytest.approx(exact, rel=1e-12)


def test_rigid_motion_needs_no_force_and_has_the_bodys_inertia() -> None:
    """Translations and a rotation are stress free; they carry rho A L and its moments."""
    section = rectangle(0.03, 0.06, 0.3)
    link = beam(section, 7, count=2)
    mass, stiffness, nodes = link_matrices(link)
    rigid = np.zeros((len(mass), 3))
    rigid[0::3, 0] = rigid[1::3, 1] = rigid[2::3, 2] = 1.0
    rigid[1::3, 2] = nodes
    assert np.abs(stiffness @ rigid).max() < 1e-9 * np.abs(stiffness).max()
    total = 2 * STEEL.density * section.area * LENGTH
    turning = 2 * STEEL.density * section.second_moment * LENGTH
    inertia = np.diag([total, total, total * LENGTH**2 / 3 + turning])
    inertia[1, 2] = inertia[2, 1] = total * LENGTH / 2
    np.testing.assert_allclose(rigid.T @ mass @ rigid, inertia, rtol=1e-12, atol=1e-12)


def test_points_are_nodes() -> None:
    """Every point is a node, and elements are shared out by length, one at least."""
    points = (("A", 0.0), ("B", 0.011), ("C", 0.4), ("D", 1.0))
    link = Link("bar", points, STEEL, rectangle(0.01, 0.02, 0.3), 1, 10, 5, None)
    nodes = link_matrices(link)[2]
    assert len(nodes) == 1 + 1 + 4 + 6
    assert all(np.isclose(nodes, place).any() for _, place in points)
    assert (np.diff(nodes) > 0).all()
