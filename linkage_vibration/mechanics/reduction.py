# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Craig-Bampton reduction of any symmetric mass and stiffness."""

from dataclasses import dataclass

import numpy as np
import scipy

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray, symmetric

_SINGULAR = 1e-12  # A smaller pivot, as a share of its diagonal entry, is rounding.


class ReductionError(LinkageVibrationError):
    """A component cannot be reduced on the interface DoFs given."""


@dataclass(frozen=True, slots=True)
class Reduction:
    """A component on its interface DoFs and the amplitudes of its fixed-interface modes."""

    mass: FloatArray  # (m, m), m = n_interface + n_modes, interface DoFs first; SI
    stiffness: FloatArray  # (m, m)
    transformation: FloatArray  # (n, m): u = T q, interface DoFs first on both sides


def craig_bampton(
    mass: FloatArray, stiffness: FloatArray, n_interface: int, n_modes: int
) -> Reduction:
    """Reduce (n, n) matrices, interface DoFs first, to these and fixed-interface modes (1968).

    T = [[I, 0], [-K_ii^-1 K_ib, Phi]], with K_ii Phi = M_ii Phi Omega^2 and Phi^T M_ii Phi = I.
    Statics stay exact; natural frequencies come from above. At most all modes are kept.
    """
    b, i = slice(0, n_interface), slice(n_interface, None)
    n_interior = len(mass) - n_interface
    n_modes = min(n_modes, n_interior)
    transformation = np.eye(len(mass), n_interface + n_modes)
    if n_interior:
        try:
            factor = scipy.linalg.cho_factor(stiffness[i, i])
        except np.linalg.LinAlgError:
            raise _not_held(n_interface) from None
        if (np.diag(factor[0]) ** 2 < _SINGULAR * np.diag(stiffness)[i]).any():
            raise _not_held(n_interface)
        transformation[i, b] = -scipy.linalg.cho_solve(factor, stiffness[i, b])
    reduced_mass, reduced_stiffness = np.zeros((2, n_interface + n_modes, n_interface + n_modes))
    if n_modes:
        fixed = stiffness[i, i], mass[i, i]
        squared, shapes = scipy.linalg.eigh(*fixed, subset_by_index=[0, n_modes - 1])
        transformation[i, i] = shapes
        # Entries that are 0 or 1 by theory are set so to the last bit.
        reduced_mass[i, i], reduced_stiffness[i, i] = np.eye(n_modes), np.diag(squared)
        reduced_mass[i, b] = shapes.T @ (mass[i, b] + mass[i, i] @ transformation[i, b])
        reduced_mass[b, i] = reduced_mass[i, b].T
    statics = transformation[:, b]
    reduced_mass[b, b] = symmetric(statics.T @ mass @ statics)
    reduced_stiffness[b, b] = symmetric(statics.T @ stiffness @ statics)
    return Reduction(reduced_mass, reduced_stiffness, transformation)


def _not_held(n_interface: int) -> ReductionError:
    """Return the error that a component moves although its interface is held."""
    problem = f"With its {n_interface} interface DoFs held the component can still move"
    hint = "hold more of them, for example a rotation if it has only one pin"
    return ReductionError(f"{problem}; {hint}.")
