# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Primal assembly: the components on coordinates that satisfy B u = 0 by construction."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.arrays import (
    ComplexArray,
    FloatArray,
    IntArray,
    solve_stack,
    symmetric,
)
from linkage_vibration.mechanics.compatibility import CouplingError, Joining, row_space
from linkage_vibration.mechanics.components import Component

_CHUNK = 2**20  # complex numbers of dynamic stiffness that are held at a time, 16 MB
_ROUNDING_LIMIT = 1e-6  # A larger error by rounding, of the motion, is refused.


@dataclass(frozen=True, slots=True, eq=False)
class UncoupledSystem:
    """All components side by side, uncoupled and so the same in every configuration."""

    components: tuple[Component, ...]
    n_interface: int  # interface DoFs of all components; they come first, then inner coordinates
    rows: dict[str, IntArray]  # indices of the coordinates of each component, (n_component,)
    mass: FloatArray  # (n, n), SI; ``loss`` is the imaginary part of the stiffness
    stiffness: FloatArray  # (n, n)
    damping: FloatArray  # (n, n)
    loss: FloatArray  # (n, n)


@dataclass(frozen=True, slots=True, eq=False)
class CoupledSystem:
    """The assembly in one configuration, or with an axis before in a stack of them."""

    mass: FloatArray  # (m, m): on the generalised coordinates q; SI
    stiffness: FloatArray  # (m, m)
    damping: FloatArray  # (m, m)
    loss: FloatArray  # (m, m)
    basis: FloatArray  # (n_interface, m - n_inner): u = basis @ q[: m - n_inner]; then inner ones

    def expand(self, coordinates: FloatArray) -> FloatArray:
        """Turn columns of q, (m, k), into columns of u and inner coordinates, (n, k)."""
        free = self.basis.shape[-1]
        moved = self.basis @ coordinates[..., :free, :]
        return np.concatenate([moved, coordinates[..., free:, :]], axis=-2)

    def restrict(self, rows: FloatArray) -> FloatArray:
        """Turn rows on the interface DoFs, (k, n_interface), into rows on q, (k, m)."""
        free = self.basis.shape[1]
        return np.hstack([rows @ self.basis, np.zeros((len(rows), len(self.mass) - free))])


def uncoupled_system(components: Sequence[Component]) -> UncoupledSystem:
    """Put components side by side, every interface DoF before every inner coordinate."""
    is_inner = np.concatenate([np.arange(len(c.mass)) >= len(c.dofs) for c in components])
    places = np.argsort(is_inner, kind="stable")
    rows = np.split(np.argsort(places), np.cumsum([len(c.mass) for c in components])[:-1])
    matrices = np.zeros((4, len(places), len(places)))
    for c, at in zip(components, rows, strict=True):
        parts = c.mass, c.stiffness, c.damping, c.loss_factor * c.stiffness
        matrices[:, at[:, np.newaxis], at] = parts
    names = [c.name for c in components]
    return UncoupledSystem(
        tuple(components), int((~is_inner).sum()), dict(zip(names, rows, strict=True)), *matrices
    )


def couple(system: UncoupledSystem, joining: Joining) -> CoupledSystem:
    """Assemble on the null space of B: M = L^T M L, K = L^T (K + W + G^T k G) L, B L = 0."""
    _, basis = row_space(joining.compatibility, joining.labels)
    stretch, none = joining.elongation @ basis, np.zeros((1, 1))
    springs, dampers = (
        stretch.swapaxes(-1, -2) @ (weights[..., np.newaxis] * stretch)
        for weights in (joining.stiffness, joining.damping)
    )
    stiffness = system.stiffness
    if joining.weight is not None:
        stiffness = stiffness + joining.weight
    return CoupledSystem(
        _congruent(system, system.mass, basis, none),
        _congruent(system, stiffness, basis, springs),
        _congruent(system, system.damping, basis, dampers),
        _congruent(system, system.loss, basis, none),
        basis,
    )


def assembled_frf(
    system: CoupledSystem, frequencies: FloatArray, outputs: FloatArray, inputs: FloatArray
) -> ComplexArray:
    """Return receptances, (n_freq, n_out, n_in), m/N, by solving the assembly line by line (Hz).

    (K + i (D + w C) - w^2 M) q = f also holds at 0 Hz and at resonances of components. A receptance
    with less than 6 digits is an error. Outputs and inputs are rows on the interface DoFs.
    """
    frequencies = np.asarray(frequencies, dtype=float)
    left, right = system.restrict(outputs), system.restrict(inputs)
    frf = np.empty((len(frequencies), len(left), len(right)), dtype=complex)
    step = max(1, _CHUNK // system.mass.size)
    for start in range(0, len(frequencies), step):
        lines = slice(start, start + step)
        omega = 2.0 * math.pi * frequencies[lines, np.newaxis, np.newaxis]
        dynamic = system.stiffness - omega**2 * system.mass
        dynamic = dynamic + 1j * (system.loss + omega * system.damping)
        try:
            moved = solve_stack(dynamic, np.hstack([left.T, right.T]))
            frf[lines] = left @ moved[:, :, len(left) :]
            # A change of the stiffness by eps changes H = y^T Z x by up to eps |y|^T |Z| |x|.
            y, x = np.split(np.abs(moved), [len(left)], axis=2)
            error = np.finfo(float).eps * (y.swapaxes(1, 2) @ np.abs(dynamic) @ x).max(axis=(1, 2))
            motion = np.abs(system.basis @ moved[:, : system.basis.shape[1]]).max(axis=(1, 2))
            poor = ~(error <= _ROUNDING_LIMIT * motion)
        except np.linalg.LinAlgError:
            poor = np.ones(len(dynamic), dtype=bool)
        for frequency in frequencies[lines][poor]:
            raise CouplingError(
                f"At {frequency:g} Hz the assembly can move without a force, or resonates without "
                "damping, so it has no finite receptance; hold it, for example with `clamped` or a "
                "spring at the joint of the crank, add damping, or change the frequencies."
            )
    return frf


def _congruent(
    system: UncoupledSystem, matrix: FloatArray, basis: FloatArray, springs: FloatArray
) -> FloatArray:
    """Return L^T A L of a matrix, (..., n, n), with `springs`, (m, m), exactly symmetric."""
    n, m, across = system.n_interface, basis.shape[-1], basis.swapaxes(-1, -2)
    size = matrix.shape[-1] - n + m
    result = np.zeros((*basis.shape[:-2], size, size))
    if matrix.any():
        result[..., :m, m:] = side = across @ matrix[..., :n, n:]
        result[..., m:, :m], result[..., m:, m:] = side.swapaxes(-1, -2), matrix[..., n:, n:]
        springs = across @ matrix[..., :n, :n] @ basis + springs
    result[..., :m, :m] = symmetric(springs)
    return result
