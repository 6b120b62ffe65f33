# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Timoshenko beam elements in the plane of motion.

The bending element is the two-node one whose cubic field solves the static equations (Przemieniecki
1968), with the consistent mass of that field, rotary inertia included (Friedman and Kosmatka 1993).
Statics are exact for loads at nodes, whatever the mesh. Natural frequencies are approached from
above, as h^4 in the length h of the elements while these are slender, and as h^2 when they get as
short as they are deep.

A node moves by u and w along the local x and z axes and turns by theta from x towards z.
"""

import numpy as np
from scipy.linalg import hilbert

from linkage_vibration.mechanics.arrays import FloatArray, symmetric
from linkage_vibration.mechanics.description import Material, Section

U, W, THETA = range(3)
"""Order of the coordinates of a node."""


def element_matrices(
    length: float, section: Section, material: Material
) -> tuple[FloatArray, FloatArray]:
    """Return mass and stiffness of one element, (6, 6), SI: u, w, theta of both nodes."""
    youngs, density, area = material.youngs_modulus, material.density, section.area
    mass, stiffness = np.zeros((2, 6, 6))
    along = np.ix_([U, 3 + U], [U, 3 + U])
    mass[along] = density * area * length / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    stiffness[along] = youngs * area / length * np.array([[1.0, -1.0], [-1.0, 1.0]])
    across = np.ix_([W, THETA, 3 + W, 3 + THETA], [W, THETA, 3 + W, 3 + THETA])
    mass[across], stiffness[across] = _bending_element(
        length,
        youngs * section.second_moment,
        section.shear_coefficient * material.shear_modulus * area,
        density * area,
        density * section.second_moment,
    )
    return mass, stiffness


def _bending_element(
    length: float, rigidity: float, shear_rigidity: float, line_mass: float, rotary: float
) -> tuple[FloatArray, FloatArray]:
    """Bending by E I, kappa G A, rho A and rho I, on w and theta = dw/dx of both nodes.

    With s = x / L the static field is w = a0 + a1 s + a2 s^2 + a3 s^3 and
    theta = (a1 + phi a3 / 2 + 2 a2 s + 3 a3 s^2) / L, where phi = 12 E I / (kappa G A L^2) is shear
    over bending flexibility. The values at s = 0 and 1 give the coefficients. Integrals of
    s^i s^j over the element are the entries of a Hilbert matrix.
    """
    phi = 12.0 * rigidity / (shear_rigidity * length**2)
    # Bending by equal and opposite end moments, and by end forces.
    even, odd = np.array([0.0, -length, 0.0, length]), np.array([2.0, length, -2.0, length])
    a3 = odd / (1.0 + phi)
    a2 = (even - 3.0 * a3) / 2.0
    theta_start = np.array([0.0, length, 0.0, 0.0])
    w = np.array([[1.0, 0.0, 0.0, 0.0], theta_start - phi / 2.0 * a3, a2, a3])
    theta = np.array([theta_start, 2.0 * a2, 3.0 * a3]) / length
    mass = length * (line_mass * w.T @ hilbert(4) @ w + rotary * theta.T @ hilbert(3) @ theta)
    pure, sheared = np.outer(even, even), 3.0 / (1.0 + phi) * np.outer(odd, odd)
    return symmetric(mass), rigidity / length**3 * (pure + sheared)
