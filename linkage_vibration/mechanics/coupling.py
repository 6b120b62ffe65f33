# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Primal assembly: the components on coordinates that satisfy B u = 0 by construction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.components import Component

FloatArray = NDArray[np.float64]


class CouplingError(LinkageVibrationError):
    """The constraints do not join the components as they should."""


@dataclass(frozen=True, slots=True)
class UncoupledSystem:
    """All components side by side, uncoupled and so the same in every configuration.

    Attributes
    ----------
    n_interface : int
        Interface DoFs of all components; they come first, then all inner coordinates.
    mass, stiffness : ndarray, (n, n)
        SI.
    """

    n_interface: int
    mass: FloatArray
    stiffness: FloatArray


@dataclass(frozen=True, slots=True)
class CoupledSystem:
    """The assembly in one configuration.

    Attributes
    ----------
    mass, stiffness : ndarray, (m, m)
        On the generalised coordinates q; SI.
    basis : ndarray, (n_interface, m - n_inner)
        Interface DoFs u = basis @ q[: m - n_inner]; the inner coordinates are the rest of q.
    """

    mass: FloatArray
    stiffness: FloatArray
    basis: FloatArray

    def expand(self, coordinates: FloatArray) -> FloatArray:
        """Turn columns of q, (m, k), into columns of u and inner coordinates, (n, k)."""
        free = self.basis.shape[1]
        return np.vstack([self.basis @ coordinates[:free], coordinates[free:]])


def uncoupled_system(components: Sequence[Component]) -> UncoupledSystem:
    """Put components side by side, every interface DoF before every inner coordinate."""
    interface: list[int] = []
    inner: list[int] = []
    start = 0
    for component in components:
        n, n_interface = len(component.mass), len(component.dofs)
        interface += range(start, start + n_interface)
        inner += range(start + n_interface, start + n)
        start += n
    order = np.ix_(interface + inner, interface + inner)
    return UncoupledSystem(
        n_interface=len(interface),
        mass=block_diag(*(component.mass for component in components))[order],
        stiffness=block_diag(*(component.stiffness for component in components))[order],
    )


def couple(system: UncoupledSystem, compatibility: FloatArray) -> CoupledSystem:
    """Assemble on the null space of B: M = L^T M L, K = L^T K L with B L = 0.

    Parameters
    ----------
    system : UncoupledSystem
        The components.
    compatibility : ndarray, (n_constraints, n_interface)
        B.

    Raises
    ------
    CouplingError
        If rows of B repeat one another.
    """
    basis = _null_space(compatibility)
    b, i = slice(0, system.n_interface), slice(system.n_interface, None)

    def congruent(matrix: FloatArray) -> FloatArray:
        cross = basis.T @ matrix[b, i]
        own = basis.T @ matrix[b, b] @ basis
        return np.block([[(own + own.T) / 2.0, cross], [cross.T, matrix[i, i]]])

    return CoupledSystem(congruent(system.mass), congruent(system.stiffness), basis)


def _null_space(compatibility: FloatArray) -> FloatArray:
    n_rows, n = compatibility.shape
    _, values, right = np.linalg.svd(compatibility)
    rank = int((values > values.max(initial=0.0) * max(n_rows, n) * np.finfo(float).eps).sum())
    if rank < n_rows:
        raise CouplingError(
            f"{n_rows - rank} of the {n_rows} constraints repeat others; look for two pins that "
            "join the same two bodies."
        )
    return np.asarray(right[rank:].T)
