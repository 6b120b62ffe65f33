# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies and shapes of an assembly, and their damping."""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.coupling import CoupledSystem

MECHANISM = 2.0 * math.pi * 1e-2
"""rad/s; below it, 0.01 Hz, a mode is that of a mechanism, at 0 Hz apart from rounding."""

_SHIFT = (2.0 * math.pi * 1.0) ** 2  # (rad/s)^2; it is that of 1 Hz
_SLOWEST = 1e-3  # rad/s; a mechanism mode gets this frequency if damping couples it to others
_STEP = 0.1  # A Newton step converges if it is below this share of the distance to another pole.
_DIAGONAL = 1e-9  # Smaller off-diagonal terms, as shares of the modal damping, are rounding.


class ModesError(LinkageVibrationError):
    """The modes asked for cannot be found."""


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """Undamped modes in one configuration, scaled to unit modal mass."""

    omega: FloatArray  # (n_modes,): natural frequencies, rad/s
    # (n, n_modes): interface DoFs (in their components' own axes), then inner coordinates.
    shapes: FloatArray

    @property
    def mechanism(self) -> BoolArray:
        """Which modes strain nothing and are at 0 Hz apart from rounding, (n_modes,)."""
        return self.omega < MECHANISM


@dataclass(frozen=True, slots=True, eq=False)
class DampedModes:
    """The damped modes: H = sum over r of (a_oir + i w b_oir) / (k_r - w^2 + i w c_r).

    `response.pole_residue` finds a and b. Where damping does not couple the modes, term r is
    undamped mode r; else it is a pair of conjugate poles or two real roots, ascending by abs(k).
    """

    stiffness: ComplexArray  # (n_modes,): k, (rad/s)^2; its imaginary part is structural damping
    decay: FloatArray  # (n_modes,): c = 2 zeta w, rad/s
    # (2 or 1, n_modes, n_modes): the damped modes of each term by the undamped ones. There are two
    # if viscous damping couples the modes, one if structural damping does; otherwise it is None.
    shapes: ComplexArray | None
    poles: ComplexArray | None  # (2, n_modes), rad/s, where viscous damping couples the modes

    @property
    def oscillating(self) -> ComplexArray:
        """Poles that oscillate, where damping couples modes: (n,), rad/s, ascending."""
        return np.asarray(self._upper_poles[oscillating_indices(self._upper_poles)])

    @property
    def oscillating_shapes(self) -> ComplexArray:
        """Their shapes by the undamped modes, (n_modes, n), scaled as `shapes` are."""
        assert self.shapes is not None
        return np.asarray(self.shapes[0][:, oscillating_indices(self._upper_poles)])

    @property
    def real_shapes(self) -> FloatArray:
        """Their shapes by the undamped modes, (n_modes, n): the real part at unit modal mass."""
        scale = 1.0 if self.poles is None else np.sqrt(2.0 * self.oscillating)
        return np.asarray((self.oscillating_shapes * scale).real)

    @property
    def _upper_poles(self) -> ComplexArray:
        """One pole of each term, rad/s."""
        return np.asarray(1j * np.sqrt(self.stiffness) if self.poles is None else self.poles[0])

    @property
    def damping_ratios(self) -> FloatArray:
        """Damping ratios of the undamped or the oscillating modes, 1; NaN of a mechanism mode."""
        if self.shapes is not None:
            poles = self.oscillating
            return np.asarray(-poles.real / np.abs(poles))
        root = np.sqrt(self.stiffness)  # i times it is a pole, if damping is structural
        omega = np.abs(root)
        with np.errstate(divide="ignore", invalid="ignore"):  # rigid modes have none
            ratios = (self.decay / 2.0 + root.imag) / omega
        return np.where(omega > 0.0, ratios, np.nan)


def oscillating_indices(poles: ComplexArray) -> IntArray:
    """Return the indices of the poles that oscillate, of each pair the upper, by magnitude."""
    upper = np.flatnonzero((poles.imag > 0.0) & (np.abs(poles) >= MECHANISM))
    return np.asarray(upper[np.argsort(np.abs(poles[upper]), kind="stable")])


def paired(poles: ComplexArray) -> tuple[IntArray, IntArray]:
    """Return the indices of both poles of each term: conjugate, or real neighbours in magnitude."""
    real = np.flatnonzero(poles.imag == 0.0)
    real = real[np.argsort(np.abs(poles[real]), kind="stable")]
    upper, lower = np.flatnonzero(poles.imag > 0.0), np.flatnonzero(poles.imag < 0.0)
    upper = upper[np.lexsort((poles[upper].imag, poles[upper].real))]
    lower = lower[np.lexsort((-poles[lower].imag, poles[lower].real))]
    return np.concatenate([upper, real[::2]]), np.concatenate([lower, real[1::2]])


def solve_modes(system: CoupledSystem) -> tuple[Modes, FloatArray]:
    """Return all modes of K phi = omega^2 M phi, ascending, and shapes on coordinates, (m, m).

    M phi = mu (K + s M) phi with mu = 1 / (omega^2 + s) gives the lowest frequencies to full
    precision, where the highest leave 1e-7; the small shift s allows a mechanism mode.
    """
    shape = system.mass.shape
    both = (system.mass, system.stiffness + _SHIFT * system.mass)
    pencils = zip(*(each.reshape(-1, *shape[-2:]) for each in both), strict=True)
    solved = zip(*(scipy.linalg.eigh(*pencil) for pencil in pencils), strict=True)
    mu, vectors = (np.array(each)[..., ::-1] for each in solved)
    mu, vectors = mu.reshape(shape[:-1]), vectors.reshape(shape)
    # If mu is only rounding, its limit keeps the compliance phi^2 / omega^2 of the mode right.
    mu = np.maximum(mu, 1e-17 * mu[..., :1])
    omega = np.sqrt(np.maximum(1.0 / mu - _SHIFT, 0.0))
    vectors = vectors / np.sqrt(mu)[..., np.newaxis, :]
    return Modes(omega, system.expand(vectors)), vectors


def damp_modes(system: CoupledSystem, omega: FloatArray, vectors: FloatArray) -> DampedModes:
    """Find the damped modes from undamped ones, (..., k) and (..., m, k); see `mixed_damping`."""
    viscous, loss = modal_damping(system, vectors)
    if not any(_beside_diagonal(each).any() for each in (viscous, loss)):
        return DampedModes(omega**2 + 1j * _diagonal(loss), _diagonal(viscous), None, None)
    if not loss.any():
        return _viscous_modes(omega, viscous)
    if not viscous.any():
        return _structural_modes(omega, loss)
    raise mixed_damping()


def modal_damping(system: CoupledSystem, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return viscous damping and loss on undamped modes, (..., k, k); diagonal if uncoupled."""
    across, matrices = vectors.swapaxes(-1, -2), (system.damping, system.loss)
    none = np.zeros((*across.shape[:-1], across.shape[-2]))
    parts = [across @ each @ vectors if each.any() else none for each in matrices]
    both = zip(parts, matrices, strict=True)
    if all(_is_diagonal(modal, matrix, vectors) for modal, matrix in both):
        parts = [modal - _beside_diagonal(modal) for modal in parts]
    viscous, loss = parts
    return viscous, loss


def _diagonal(matrices: FloatArray) -> FloatArray:
    """Return the diagonals of matrices, (..., k)."""
    return np.diagonal(matrices, axis1=-2, axis2=-1).copy()


def _beside_diagonal(matrices: FloatArray) -> FloatArray:
    """Return matrices with zeros on their diagonals."""
    return np.where(np.eye(matrices.shape[-1], dtype=bool), 0.0, matrices)


def mixed_damping() -> ModesError:
    """Return the error that viscous and structural damping occur together."""
    problem = "Viscous and structural damping occur together, and one of them couples the modes"
    hint = "give every link a rule of the same kind, or use the frequency responses from LM-FBS"
    return ModesError(f"{problem}; {hint}.")


def _is_diagonal(modal: FloatArray, matrix: FloatArray, vectors: FloatArray) -> bool:
    """Return whether off-diagonal terms are small against the diagonal ones that they couple."""
    if not modal.any():
        return True
    diagonal = np.abs(_diagonal(modal))
    scale = np.sqrt(diagonal[..., np.newaxis] * diagonal[..., np.newaxis, :])
    off, largest = np.abs(_beside_diagonal(modal)), diagonal.max(axis=-1)
    limit = _DIAGONAL * (scale + largest[..., np.newaxis, np.newaxis] * 1e-9)
    if (off <= limit).all():
        return True
    # A mechanism mode may have no damping; then all its terms are rounding.
    size = np.abs(vectors)
    rounding = size.swapaxes(-1, -2) @ np.abs(matrix) @ size
    rounding *= modal.shape[-1] * np.finfo(float).eps
    undamped = (diagonal <= _diagonal(rounding))[..., np.newaxis]
    coupled = undamped | undamped.swapaxes(-1, -2)
    limit = np.where(coupled, np.maximum(limit, rounding), limit)
    return bool((off <= limit).all())


def _viscous_modes(omega: FloatArray, viscous: FloatArray) -> DampedModes:
    """Solve q'' + D q' + W^2 q = f by x = (W q, q'), which keeps the lowest shapes exact."""
    n, omega = omega.shape[-1], np.maximum(omega, _SLOWEST)
    matrix = np.zeros((*omega.shape[:-1], 2 * n, 2 * n))
    matrix[..., :n, n:] = omega[..., np.newaxis] * np.eye(n)
    matrix[..., n:, :n], matrix[..., n:, n:] = -matrix[..., :n, n:], -viscous
    poles, vectors = (np.asarray(each, dtype=np.complex128) for each in np.linalg.eig(matrix))
    shapes = vectors[..., n:, :] / poles[..., np.newaxis, :]
    poles = _refined(poles, shapes, omega, viscous)
    # x^T [[D, I], [I, 0]] x with x = (psi, lambda psi), by which the residues are scaled.
    scale = (shapes * (viscous @ shapes)).sum(axis=-2) + 2.0 * poles * (shapes**2).sum(axis=-2)
    shapes = shapes / np.sqrt(scale.astype(complex))[..., np.newaxis, :]
    pairs = np.array([paired(row) for row in poles.reshape(-1, 2 * n)])
    pairs = pairs.reshape(*omega.shape[:-1], 2, n)
    product = np.take_along_axis(poles[..., np.newaxis, :], pairs, -1).prod(axis=-2, keepdims=True)
    pairs = np.take_along_axis(pairs, np.argsort(np.abs(product), kind="stable"), -1)
    both = np.take_along_axis(poles[..., np.newaxis, :], pairs, -1)
    shapes = np.take_along_axis(shapes[..., np.newaxis, :, :], pairs[..., np.newaxis, :], -1)
    return DampedModes(both.prod(axis=-2).real + 0j, -both.sum(axis=-2).real, shapes, both)


def _refined(
    poles: ComplexArray, shapes: ComplexArray, omega: FloatArray, viscous: FloatArray
) -> ComplexArray:
    """Return poles without the rounding of the highest ones, by a Newton step each.

    `eig` rounds every pole by as much as the largest, which is 1e-9 of a small damping ratio. The
    root s of psi^T (s^2 + s D + W^2) psi has an error that is the square of the error of psi.
    """
    damped = (shapes * (viscous @ shapes)).sum(axis=-2)
    size = (shapes**2).sum(axis=-2)
    slope = damped + 2.0 * poles * size
    value = (omega[..., np.newaxis] ** 2 * shapes**2).sum(axis=-2)
    value += poles * (poles * size + damped)
    with np.errstate(divide="ignore", invalid="ignore"):  # a slope of zero, as below
        step = value / slope
        # Where two poles meet, the slope is zero, and Newton's method does not converge.
        converges = np.abs(step * size) <= _STEP * np.abs(slope)
    return np.asarray(np.where(converges, poles - step, poles))


def _structural_modes(omega: FloatArray, loss: FloatArray) -> DampedModes:
    """Solve (W^2 + i L) psi = k psi as 1/k y = (I + i W^-1 L W^-1)^-1 W^-2 y, psi = W^-1 y."""
    w = np.maximum(omega, _SLOWEST)
    column, row = w[..., np.newaxis], w[..., np.newaxis, :]
    flexibility = np.linalg.inv(np.eye(w.shape[-1]) + 1j * loss / (column * row))
    values, vectors = np.linalg.eig(flexibility / row**2)
    shapes = np.asarray(vectors / column, dtype=np.complex128)
    shapes = shapes / np.sqrt((shapes**2).sum(axis=-2, keepdims=True))
    order = np.argsort(-np.abs(values), kind="stable")
    shapes = np.take_along_axis(shapes, order[..., np.newaxis, :], -1)[..., np.newaxis, :, :]
    stiffness = 1.0 / (np.take_along_axis(values, order, -1) + 0j)
    return DampedModes(stiffness, np.zeros(w.shape), shapes, None)
