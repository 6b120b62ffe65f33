# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Coupling of components by their frequency response functions (LM-FBS).

Brunetti, D'Ambrogio, Fregolent 2022, eq. 14 and 19; de Klerk, Rixen, Voormeeren 2008. A component's
FRFs are in its own axes, so they are made once; only the compatibility matrix changes with the
configuration.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.errors import LinkageVibrationError

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_CHUNK = 2**20  # complex numbers of dynamic stiffness held at a time, 16 MB
_FLOATING = 1e-9  # least eigenvalue of a scaled stiffness, 1: below it a body is free to move


class FbsError(LinkageVibrationError):
    """FRFs cannot be made or coupled."""


def component_frf(
    mass: FloatArray,
    stiffness: FloatArray,
    damping: FloatArray,
    n_dofs: int,
    frequencies: FloatArray,
    loss_factor: float = 0.0,
) -> ComplexArray:
    """Receptances of one component, (K (1 + i eta) - w^2 M + i w C)^-1, on its first DoFs.

    Parameters
    ----------
    mass, stiffness, damping : ndarray, (n, n)
        Symmetric, SI; the damping is viscous, of any kind.
    n_dofs : int
        How many of the coordinates to keep, the first ones.
    frequencies : ndarray, (n_freq,)
        Hz.
    loss_factor : float
        eta, of structural damping, 1.

    Returns
    -------
    complex ndarray, (n_freq, n_dofs, n_dofs)
        m/N between displacements; symmetric. Below 1 Hz a free body moves so much more than a
        coupled one that the rounding of its FRFs alone leaves errors in those of an assembly: with
        the default linkage 4e-9 of the largest at 0.1 Hz, 1e-7 at 0.01 Hz.

    Raises
    ------
    FbsError
        At 0 Hz, if the component is free to move as a rigid body; at an undamped resonance.
    """
    omega = 2.0 * math.pi * np.asarray(frequencies, dtype=float)
    if (omega == 0.0).any() and _is_floating(stiffness):
        raise FbsError(
            "A component that is free to move has no receptance at 0 Hz; let the first frequency "
            "be above 0, 0.1 Hz or more."
        )
    pick = np.eye(len(mass), n_dofs)
    frf = np.empty((len(omega), n_dofs, n_dofs), dtype=complex)
    step = max(1, _CHUNK // mass.size)
    for start in range(0, len(omega), step):
        w = omega[start : start + step, np.newaxis, np.newaxis]
        dynamic = (1.0 + 1j * loss_factor) * stiffness - w**2 * mass + 1j * w * damping
        try:
            frf[start : start + step] = np.linalg.solve(dynamic, pick)[:, :n_dofs]
        except np.linalg.LinAlgError:
            raise FbsError(
                "A component's dynamic stiffness is singular between "
                f"{frequencies[start]:g} and {frequencies[start + len(w) - 1]:g} Hz: it resonates "
                "there without damping, or has a coordinate with neither mass nor stiffness; give "
                "it damping, or move the frequencies."
            ) from None
    return np.asarray((frf + frf.swapaxes(1, 2)) / 2.0, dtype=complex)


def couple_frfs(
    blocks: Sequence[ComplexArray],
    compatibility: FloatArray,
    outputs: FloatArray,
    inputs: FloatArray,
    compliance: FloatArray | ComplexArray | float = 0.0,
) -> ComplexArray:
    """Couple components: H_c = H - H B^T (B H B^T + S)^-1 B H, between outputs and inputs.

    H is block diagonal and never put together: each block is only multiplied with the rows of B,
    outputs and inputs that touch it.

    Parameters
    ----------
    blocks : sequence of complex ndarray, (n_freq, n_r, n_r)
        Receptances of the components at the same frequencies; their DoFs in turn make the n DoFs.
    compatibility : ndarray, (n_constraints, n)
        B, of full row rank; B u is zero where the joint is rigid.
    outputs, inputs : ndarray, (n_out, n) and (n_in, n)
        Rows that pick or combine DoFs into responses and forces.
    compliance : float or ndarray, (n_constraints,) or (n_freq, n_constraints)
        Diagonal of S: 1/k makes B u the elongation of a spring k, 1/(k + i w c) with a damper
        beside it; 0 is rigid.

    Returns
    -------
    complex ndarray, (n_freq, n_out, n_in)
        m/N between displacements.

    Raises
    ------
    FbsError
        If the arrays do not fit one another, or the joints cannot carry a force at a frequency.
    """
    n_freq = _check_sizes(blocks, (compatibility, outputs, inputs))
    n_rows = len(compatibility)
    left, right = np.vstack([compatibility, outputs]), np.vstack([compatibility, inputs])
    frf = np.zeros((n_freq, len(left), len(right)), dtype=complex)
    start = 0
    for block in blocks:
        own = slice(start, start + block.shape[1])
        start = own.stop
        i, j = np.flatnonzero(left[:, own].any(axis=1)), np.flatnonzero(right[:, own].any(axis=1))
        frf[:, i[:, np.newaxis], j] += left[i, own] @ block @ right[j, own].T
    interface, diagonal = frf[:, :n_rows, :n_rows], np.arange(n_rows)
    interface[:, diagonal, diagonal] += compliance
    try:
        forces = np.linalg.solve(interface, frf[:, :n_rows, n_rows:])
    except np.linalg.LinAlgError:
        raise FbsError(
            "The interface flexibility B H B^T is singular at one of the frequencies; look for "
            "constraints that repeat one another, or for components without FRFs at a joint."
        ) from None
    return np.asarray(frf[:, n_rows:, n_rows:] - frf[:, n_rows:, :n_rows] @ forces)


def _check_sizes(blocks: Sequence[ComplexArray], rows: Sequence[FloatArray]) -> int:
    """Return how many frequencies the blocks share."""
    n = sum(block.shape[1] for block in blocks)
    for name, matrix in zip(("compatibility", "outputs", "inputs"), rows, strict=True):
        if matrix.shape[1] != n:
            raise FbsError(
                f"The {name} have {matrix.shape[1]} columns, but the components {n} DoFs; give "
                "one column to each DoF."
            )
    lengths = [len(block) for block in blocks]
    if len(set(lengths)) != 1:
        raise FbsError(
            f"The components' FRFs have {', '.join(map(str, lengths))} frequencies; bring them to "
            "one frequency axis."
        )
    return lengths[0]


def _is_floating(stiffness: FloatArray) -> bool:
    """Whether a stiffness matrix lets its component move without a force."""
    scale = np.sqrt(np.maximum(np.diag(stiffness), np.finfo(float).tiny))
    return bool(np.linalg.eigvalsh(stiffness / np.outer(scale, scale))[0] < _FLOATING)
