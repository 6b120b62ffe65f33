# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies and mass-normalised shapes of an assembly, and their tracking."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment

from linkage_vibration.mechanics.coupling import CoupledSystem

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_SHIFT = (2.0 * math.pi * 1.0) ** 2  # (rad/s)^2, 1 Hz


@dataclass(frozen=True, slots=True)
class Modes:
    """Undamped modes in one configuration, which proportional damping leaves as they are.

    Attributes
    ----------
    omega : ndarray, (n_modes,)
        Natural frequencies, rad/s.
    shapes : ndarray, (n, n_modes)
        Columns of interface DoFs (each in its component's own axes) and inner coordinates,
        scaled to unit modal mass; 1/sqrt(kg) for displacements.
    """

    omega: FloatArray
    shapes: FloatArray

    def select(self, order: IntArray, signs: FloatArray) -> "Modes":
        """Return some of the modes, in another order and with other signs."""
        return Modes(self.omega[order], self.shapes[:, order] * signs)


def solve_modes(system: CoupledSystem) -> Modes:
    """Solve K phi = omega^2 M phi for every mode, ascending.

    It is solved as M phi = mu (K + s M) phi with mu = 1 / (omega^2 + s), which gives the lowest
    frequencies to full relative precision: as it stands, rounding of the highest (here some
    100 kHz) would leave an error of 1e-7 in the first. The small shift s admits a mechanism mode.
    """
    mu, vectors = eigh(system.mass, system.stiffness + _SHIFT * system.mass)
    # Where rounding has eaten mu, the mode's compliance phi^2 / omega^2 stays right all the same.
    mu, vectors = np.maximum(mu, np.finfo(float).tiny + 1e-17 * mu[-1])[::-1], vectors[:, ::-1]
    omega = np.sqrt(np.maximum(1.0 / mu - _SHIFT, 0.0))
    return Modes(omega, system.expand(vectors / np.sqrt(mu)))


def mac(first: FloatArray, second: FloatArray, mass: FloatArray) -> FloatArray:
    """Mass-weighted modal assurance criterion of mass-normalised shapes.

    (phi_i^T M phi_j)^2, which is 1 for the same shape and 0 for orthogonal ones. Shapes from two
    configurations compare because M is that of the uncoupled components, in their own axes.

    Parameters
    ----------
    first : ndarray, (n, k)
    second : ndarray, (n, l)
    mass : ndarray, (n, n)

    Returns
    -------
    ndarray, (k, l)
    """
    return np.asarray((first.T @ mass @ second) ** 2)


def track(previous: FloatArray, modes: Modes, mass: FloatArray) -> Modes:
    """Find the modes whose shapes continue those of a neighbouring configuration.

    Parameters
    ----------
    previous : ndarray, (n, k)
        Mass-normalised shapes of the tracked modes there.
    modes : Modes
        All modes here.
    mass : ndarray, (n, n)
        Of the uncoupled components.

    Returns
    -------
    Modes
        k modes, in the order of ``previous``, each with the sign that aligns it.
    """
    product = previous.T @ mass @ modes.shapes
    order = linear_sum_assignment(product**2, maximize=True)[1]
    signs = np.where(product[np.arange(len(order)), order] < 0.0, -1.0, 1.0)
    return modes.select(order, signs)
