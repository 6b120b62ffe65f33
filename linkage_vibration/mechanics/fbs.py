# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Coupling of components by their frequency response functions (LM-FBS).

Brunetti, D'Ambrogio, Fregolent 2022, eq. 14 and 19; de Klerk, Rixen, Voormeeren 2008. A component's
FRFs are in its own axes, so they are computed once; only the compatibility matrix changes with the
configuration.
"""

import math
from collections.abc import Sequence

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import (
    BoolArray,
    ComplexArray,
    FloatArray,
    IntArray,
    solve_stack,
    symmetric,
)
from linkage_vibration.mechanics.compatibility import row_space
from linkage_vibration.mechanics.components import Component

Matrix = FloatArray | ComplexArray

_CHUNK = 2**20  # complex numbers of dynamic stiffness that are held at a time, 16 MB
_FLOATING = 1e-9  # least eigenvalue of the scaled stiffness of a body that is held
_HARMLESS = 1e-12  # A smaller error, of the largest receptance, is not computed precisely.
_ROUNDING_LIMIT = 1e-6  # A larger error by rounding, of the largest receptance, is refused.


class FbsError(LinkageVibrationError):
    """FRFs cannot be computed or coupled."""


def component_frf(
    mass: FloatArray,
    stiffness: FloatArray,
    damping: FloatArray,
    n_dofs: int,
    frequencies: FloatArray | ComplexArray,
    loss_factor: float = 0.0,
) -> ComplexArray:
    """Return (K (1 + i eta) - w^2 M + i w C)^-1 of the first DoFs, (n_freq, n_dofs, n_dofs)."""
    omega = np.multiply(frequencies, 2.0 * math.pi)
    if (omega == 0.0).any():
        scale = np.sqrt(np.maximum(np.diag(stiffness), np.finfo(float).tiny))
        if np.linalg.eigvalsh(stiffness / np.outer(scale, scale))[0] < _FLOATING:
            problem = "A component that is free to move has no receptance at 0 Hz"
            raise FbsError(f"{problem}; begin above 0, at 0.1 Hz or more.")
    lossy = np.asarray((1.0 + 1j * loss_factor) * stiffness, dtype=np.complex128)
    matrices: list[Matrix] = [lossy, mass, damping]
    frf = np.empty((len(omega), n_dofs, n_dofs), dtype=complex)
    step = max(1, _CHUNK // mass.size)
    for start in range(0, len(omega), step):
        frf[start : start + step] = _inverse(matrices, n_dofs, omega[start : start + step])
    for line in np.flatnonzero(~np.isfinite(frf).all(axis=(1, 2))):
        problem = f"A component's dynamic stiffness is singular at {frequencies[line]:g} Hz"
        raise FbsError(f"{problem}; add damping or missing mass, or change the frequencies.")
    return symmetric(frf)


def held_frf(component: Component, frequencies: Matrix, held: BoolArray) -> ComplexArray:
    """Return receptances of a component, (n_freq, n, n); DoFs that are held, (n,), do not move."""
    n, free = len(component.dofs), np.flatnonzero(~held)
    left = np.ix_(*[[*free, *range(n, len(component.mass))]] * 2)
    matrices = component.mass[left], component.stiffness[left], component.damping[left]
    frf = np.zeros((len(frequencies), n, n), dtype=complex)
    try:
        moved = component_frf(*matrices, len(free), frequencies, component.loss_factor)
    except FbsError as error:
        raise FbsError(f"{component.name}: {error}") from None
    frf[:, free[:, np.newaxis], free] = moved
    return frf


def _inverse(matrices: Sequence[Matrix], n_dofs: int, omega: Matrix) -> ComplexArray:
    """Return (K - w^2 M + i w C)^-1 of the first DoFs; uncoupled others are eliminated first."""
    n = len(matrices[0])
    b, i = slice(n_dofs), slice(n_dofs, n)
    pick = np.eye(n, n_dofs)
    if not all(_is_diagonal(matrix[i, i]) for matrix in matrices):
        return _solve(_dynamic(matrices, omega), pick)[:, :n_dofs]
    cross = _dynamic([matrix[b, i] for matrix in matrices], omega)
    diagonals: list[Matrix] = [matrix.diagonal()[np.newaxis, i] for matrix in matrices]
    inner = _dynamic(diagonals, omega)
    with np.errstate(divide="ignore", invalid="ignore"):  # a held resonance, solved below
        passed = (cross / inner) @ cross.swapaxes(1, 2)
    condensed = _dynamic([matrix[b, b] for matrix in matrices], omega) - passed
    held = ~np.isfinite(condensed).all(axis=(1, 2))  # on a resonance with the interface held
    condensed[held] = np.eye(n_dofs)
    frf = _solve(condensed, np.eye(n_dofs))
    if held.any():
        frf[held] = _solve(_dynamic(matrices, omega[held]), pick)[:, :n_dofs]
    return frf


def _dynamic(matrices: Sequence[Matrix], omega: Matrix) -> ComplexArray:
    """Return K - w^2 M + i w C, (n_freq, ...)."""
    stiffness, mass, damping = matrices
    w = omega[:, np.newaxis, np.newaxis]
    return np.asarray(stiffness - w**2 * mass + 1j * w * damping)


def _is_diagonal(matrix: Matrix) -> bool:
    return not (matrix - np.diag(np.diag(matrix))).any()


def couple_frfs(
    blocks: Sequence[ComplexArray],
    compatibility: FloatArray,
    outputs: FloatArray,
    inputs: FloatArray,
    compliance: FloatArray | ComplexArray | float = 0.0,
    frequencies: FloatArray | None = None,
) -> ComplexArray:
    """Couple components: H_c = H - H B^T (B H B^T + S)^-1 B H, (n_freq, n_out, n_in), m/N.

    Blocks are (n_freq, n_r, n_r), rows (..., n), and diagonal entries of S 0, 1 / k or 1 / (k + i w
    c). Repeated rows are left out; FRFs whose rounding exceeds 1e-6 of the largest are refused.
    """
    frf, error = couple_frfs_with_error(blocks, compatibility, outputs, inputs, compliance)
    poor = ~(error <= _ROUNDING_LIMIT * np.abs(frf).max(axis=(1, 2), initial=0.0))
    if poor.any():
        # A response may vanish, so the error is compared with the largest between any two DoFs.
        if np.ndim(compliance) == 2:
            compliance = np.asarray(compliance)[poor]
        every = np.eye(compatibility.shape[1])
        at_poor = [block[poor] for block in blocks]
        whole, _ = couple_frfs_with_error(at_poor, compatibility, every, every, compliance)
        share = error[poor] / np.abs(whole).max(axis=(1, 2))
        share = np.where(np.isfinite(share), share, np.inf)
        if (share > _ROUNDING_LIMIT).any():
            lines = np.flatnonzero(poor)[share > _ROUNDING_LIMIT]
            raise _lost(lines, float(share.max()), frequencies)
    return frf


def couple_frfs_with_error(
    blocks: Sequence[ComplexArray],
    compatibility: FloatArray,
    outputs: FloatArray,
    inputs: FloatArray,
    compliance: FloatArray | ComplexArray | float = 0.0,
) -> tuple[ComplexArray, FloatArray]:
    """Couple components as `couple_frfs` does, and estimate the error by rounding, (n_freq,), m/N.

    A change of B H B^T + S by eps changes H_c by up to eps abs(f)^T abs(Z) abs(g), with the
    interface forces f and g of reciprocal outputs and inputs. A singular matrix has the FRF NaN.
    """
    compatibility, compliance = independent_rows(compatibility, compliance)
    n_rows = len(compatibility)
    left, right = np.vstack([compatibility, outputs]), np.vstack([compatibility, inputs])
    frf = np.zeros((len(blocks[0]), len(left), len(right)), dtype=complex)
    start = 0
    for block in blocks:
        dofs = slice(start, start + block.shape[1])
        start = dofs.stop
        i, j = np.flatnonzero(left[:, dofs].any(axis=1)), np.flatnonzero(right[:, dofs].any(axis=1))
        frf[:, i[:, np.newaxis], j] += left[i, dofs] @ block @ right[j, dofs].T
    interface, diagonal = frf[:, :n_rows, :n_rows], np.arange(n_rows)
    interface[:, diagonal, diagonal] += compliance
    driven, seen = frf[:, :n_rows, n_rows:], frf[:, n_rows:, :n_rows]
    forces = _solve(interface, driven)
    coupled = frf[:, n_rows:, n_rows:] - seen @ forces
    g = np.abs(forces).max(axis=2, initial=0.0)
    # If forces as large as those of the inputs on both sides are harmless, no more is computed.
    level = np.sqrt(np.abs(interface[:, diagonal, diagonal]))
    error = np.finfo(float).eps * (g * level).sum(axis=1) ** 2
    close = ~(error <= _HARMLESS * np.abs(coupled).max(axis=(1, 2), initial=0.0))
    if close.any():
        f = np.abs(_solve(interface[close], seen[close].swapaxes(1, 2))).max(axis=2, initial=0.0)
        flexible = np.abs(interface[close])
        error[close] = np.finfo(float).eps * np.einsum("ki,kij,kj->k", f, flexible, g[close])
    return coupled, np.where(np.isnan(error), np.inf, error)


def independent_rows(
    compatibility: FloatArray, compliance: FloatArray | ComplexArray | float
) -> tuple[FloatArray, FloatArray | ComplexArray]:
    """Replace rigid rows, and their compliance, by a basis of their span if some repeat others."""
    n_rows = len(compatibility)
    spread = np.broadcast_to(compliance, (*np.shape(compliance)[:-1], n_rows))
    rigid = ~spread.any(axis=tuple(range(spread.ndim - 1)))
    rows, _ = row_space(compatibility[rigid], [f"row {row}" for row in np.flatnonzero(rigid)])
    if len(rows) == rigid.sum():
        return compatibility, spread
    zeros = np.zeros((*spread.shape[:-1], len(rows)))
    weights = np.concatenate([zeros, spread[..., ~rigid]], axis=-1)
    return np.vstack([rows, compatibility[~rigid]]), weights


def _solve(matrices: ComplexArray, right: Matrix) -> ComplexArray:
    """Solve a stack of equations; NaN where a matrix is singular."""
    try:
        return solve_stack(matrices, right)
    except np.linalg.LinAlgError:
        columns = np.broadcast_to(right, (len(matrices), *right.shape[-2:]))
        if len(matrices) == 1:
            return np.full(columns.shape, np.nan, dtype=complex)
        return np.concatenate([_solve(matrices[[i]], columns[i]) for i in range(len(columns))])


def _lost(lines: IntArray, share: float, frequencies: FloatArray | None) -> FbsError:
    """Return the error that rounding leaves too few digits at lines, given by their indices."""
    place = f"line {lines[0]}" if frequencies is None else f"{frequencies[lines[0]]:g} Hz"
    if len(lines) > 1:
        place += f" and {len(lines) - 1} other frequencies"
    if share == np.inf:
        problem = f"The interface flexibility B H B^T is singular at {place}"
        return FbsError(f"{problem}; check that every component has FRFs at its joints.")
    return FbsError(
        f"At {place} the components move much more than their assembly, because they are free near "
        "0 Hz or at an undamped resonance of their own, so rounding of their FRFs leaves an error "
        f"of {share:.0e} of the largest coupled FRF; leave these frequencies out, add damping, or "
        "describe the components by their matrices."
    )
