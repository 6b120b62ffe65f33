# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Primal assembly: the components on coordinates that satisfy B u = 0 by construction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.compatibility import Joining
from linkage_vibration.mechanics.components import Component

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


class CouplingError(LinkageVibrationError):
    """The constraints do not join the components as they should."""


@dataclass(frozen=True, slots=True, eq=False)
class UncoupledSystem:
    """All components side by side, uncoupled and so the same in every configuration.

    Attributes
    ----------
    n_interface : int
        Interface DoFs of all components; they come first, then all inner coordinates.
    rows : dict of str to ndarray of int, (n_component,)
        Where the coordinates of each component stand.
    mass, stiffness, damping, loss : ndarray, (n, n)
        SI; ``loss`` is the imaginary part of the stiffness.
    """

    n_interface: int
    rows: dict[str, IntArray]
    mass: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    loss: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class CoupledSystem:
    """The assembly in one configuration.

    Attributes
    ----------
    mass, stiffness, damping, loss : ndarray, (m, m)
        On the generalised coordinates q; SI.
    basis : ndarray, (n_interface, m - n_inner)
        Interface DoFs u = basis @ q[: m - n_inner]; the inner coordinates are the rest of q.
    """

    mass: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    loss: FloatArray
    basis: FloatArray

    def expand(self, coordinates: FloatArray) -> FloatArray:
        """Turn columns of q, (m, k), into columns of u and inner coordinates, (n, k)."""
        free = self.basis.shape[1]
        return np.vstack([self.basis @ coordinates[:free], coordinates[free:]])

    def restrict(self, rows: FloatArray) -> FloatArray:
        """Turn rows on the interface DoFs, (k, n_interface), into rows on q, (k, m)."""
        free = self.basis.shape[1]
        return np.hstack([rows @ self.basis, np.zeros((len(rows), len(self.mass) - free))])


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
    place = np.argsort(interface + inner)
    ends = np.cumsum([0] + [len(component.mass) for component in components])
    return UncoupledSystem(
        n_interface=len(interface),
        rows={
            component.name: place[ends[i] : ends[i + 1]] for i, component in enumerate(components)
        },
        mass=block_diag(*(c.mass for c in components))[order],
        stiffness=block_diag(*(c.stiffness for c in components))[order],
        damping=block_diag(*(c.damping for c in components))[order],
        loss=block_diag(*(c.loss_factor * c.stiffness for c in components))[order],
    )


def couple(system: UncoupledSystem, joining: Joining) -> CoupledSystem:
    """Assemble on the null space of B: M = L^T M L, K = L^T (K + G^T k G) L with B L = 0.

    Raises
    ------
    CouplingError
        If rows of B repeat one another; it names the joints.
    """
    basis = _null_space(joining)
    stretch = joining.elongation @ basis
    return CoupledSystem(
        mass=_congruent(system, system.mass, basis),
        stiffness=_congruent(system, system.stiffness, basis, stretch, joining.stiffness),
        damping=_congruent(system, system.damping, basis, stretch, joining.damping),
        loss=_congruent(system, system.loss, basis),
        basis=basis,
    )


def _congruent(
    system: UncoupledSystem,
    matrix: FloatArray,
    basis: FloatArray,
    stretch: FloatArray | None = None,
    weights: FloatArray | None = None,
) -> FloatArray:
    """L^T A L, symmetric to the last bit, with springs added on the interface."""
    b, i = slice(0, system.n_interface), slice(system.n_interface, None)
    cross = basis.T @ matrix[b, i]
    own = basis.T @ matrix[b, b] @ basis
    if stretch is not None and weights is not None:
        own = own + stretch.T @ (weights[:, np.newaxis] * stretch)
    return np.block([[(own + own.T) / 2.0, cross], [cross.T, matrix[i, i]]])


def _null_space(joining: Joining) -> FloatArray:
    n_rows, n = joining.compatibility.shape
    left, values, right = np.linalg.svd(joining.compatibility)
    rank = int((values > values.max(initial=0.0) * max(n_rows, n) * np.finfo(float).eps).sum())
    if rank < n_rows:
        shares = np.abs(left[:, rank:]).max(axis=1)
        names = [label for label, share in zip(joining.labels, shares, strict=True) if share > 1e-6]
        raise CouplingError(
            f"{n_rows - rank} of the {n_rows} constraints repeat others, among these: "
            f"{'; '.join(names)}. Join the same two bodies once only."
        )
    return np.asarray(right[rank:].T)
