# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reduced models of a damped linkage, which hold the poles in reach of the band.

Where damping couples the modes, two poles may meet, and neither is smooth there. The subspace that
they span together is smooth, and so is the small model on it: H = C (S + sigma G)^-1 C^T plus the
sum of all other modes, with sigma = i w for viscous damping and -w^2 for structural damping. A
table interpolates G, S and C. Its poles are found after that, so the way in which they meet, veer,
or become real does not matter.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.modes import MECHANISM
from linkage_vibration.mechanics.response import RIVAL, PoleResidue, searched
from linkage_vibration.table.interpolation import interpolation_matrix

_EVEN = 100  # Maxima are first sought at so many even frequencies,
_AROUND = np.linspace(-2.0, 2.0, 9)  # and so many half-widths from each resonance.
_STEPS = 12  # Each maximum is then found in so many steps.
_DEFECTIVE = 1e-100

Numbers = FloatArray | ComplexArray


@dataclass(frozen=True, slots=True, eq=False)
class Far:
    """What represents the modes above the band: terms (a + i w b) / (k - w^2 + i w c)."""

    stiffness: ComplexArray  # (n_far,): k, (rad/s)^2
    decay: FloatArray  # (n_far,): c, rad/s
    # (..., 1 + 2 n_far, n_places (n_places + 1) / 2): static flexibility, every a, every b; the
    # upper triangle of the places row by row.
    weights: Numbers

    def frf(self, omega: FloatArray) -> ComplexArray:
        """Return the sums at angular frequencies, (n_freq,), as (..., n_freq, n_triangle), m/N."""
        w = omega[:, np.newaxis]
        terms = 1.0 / (self.stiffness - w**2 + 1j * w * self.decay)
        basis = np.hstack([np.ones((len(omega), 1)), terms, 1j * w * terms])
        return np.asarray(basis @ self.weights)


@dataclass(frozen=True, slots=True, eq=False)
class Modal:
    """Poles and residues of reduced models at n angles: H = sum of psi psi^T / (sigma - pole)."""

    poles: ComplexArray  # (n, order): of sigma
    shapes: ComplexArray  # (n, n_places, order): psi
    viscous: bool
    free: bool  # whether the linkage can move freely at 0 Hz
    far: Far
    models: tuple[Numbers, Numbers, Numbers]  # G, S and C, as `ReducedModels` has them

    @property
    def frequencies(self) -> ComplexArray:
        """Poles as complex angular frequencies lambda, (n, order), rad/s."""
        return self.poles if self.viscous else np.asarray(1j * np.sqrt(-self.poles))

    def frf(self, row: int, omega: FloatArray) -> ComplexArray:
        """Return the FRFs at one of the angles, (n_freq, n_triangle), m/N, at rad/s."""
        terms = 1.0 / (self._sigma(omega)[:, np.newaxis] - self.poles[row])
        shapes, upper = self.shapes[row], np.triu_indices(self.shapes.shape[1])
        weights = replace(self.far, weights=self.far.weights[row])
        return np.asarray(terms @ (shapes[upper[0]] * shapes[upper[1]]).T + weights.frf(omega))

    def highest(self, drive: int, band: tuple[float, float]) -> FloatArray:
        """Return frequency (Hz) and height (m/N) of the highest maximum at one place, (n, 2)."""
        rows, omega, size = self.maxima(drive, band)
        best = np.lexsort((-size, rows))
        first = best[np.unique(rows[best], return_index=True)[1]]
        return np.column_stack([omega[first] / (2.0 * math.pi), size[first]])

    def maxima(
        self, drive: int, band: tuple[float, float]
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Find the maxima of the receptance of one place that are nearly the highest.

        It returns, for each, the index of its angle, its frequency (rad/s) and its magnitude (m/N).
        """
        grid = self._lines(band)
        size = self._magnitudes(drive, grid)
        rises = np.diff(size, axis=1, prepend=-1.0) > 0.0
        falls = np.diff(size, axis=1, append=-1.0) <= 0.0
        row, top = np.nonzero(rises & falls & (size >= RIVAL * size.max(axis=1)[:, np.newaxis]))
        low, high = (
            grid[row, np.maximum(top - 1, 0)],
            grid[row, np.minimum(top + 1, grid.shape[1] - 1)],
        )
        low = np.maximum(low, 1e-6 * high)  # at 0 Hz itself the slope is zero
        rise, fall = self._slope(drive, row, low), self._slope(drive, row, high)
        inside, at, before = (rise > 0.0) & (fall < 0.0), low, np.zeros(len(row))
        for _ in range(_STEPS):  # of the Illinois method
            share = rise / np.where(inside, rise - fall, 1.0)
            at = low + np.clip(share, 0.0, 1.0) * (high - low)
            slope = self._slope(drive, row, at)
            rising = slope > 0.0
            twice = before * np.where(rising, 1.0, -1.0) > 0.0
            rise, fall = (
                np.where(rising, slope, np.where(twice, rise / 2.0, rise)),
                np.where(rising, np.where(twice, fall / 2.0, fall), slope),
            )
            low, high = np.where(rising, at, low), np.where(rising, high, at)
            before = np.where(rising, 1.0, -1.0)
        at = np.where(inside, at, grid[row, top])
        return row, at, np.abs(self._drive(drive, row, at)[0])

    def _magnitudes(self, drive: int, omega: FloatArray) -> FloatArray:
        """Return abs(H) of one place at angular frequencies of each angle, (n, n_lines), m/N."""
        residues = self.shapes[:, drive, :, np.newaxis] ** 2
        terms = 1.0 / (self._sigma(omega)[:, :, np.newaxis] - self.poles[:, np.newaxis])
        weights, w = self.far.weights[:, :, self._place(drive), np.newaxis], omega[:, :, np.newaxis]
        far = 1.0 / (self.far.stiffness - w**2 + 1j * w * self.far.decay)
        n_far = len(self.far.stiffness)
        value = (
            (terms @ residues)[..., 0] + weights[:, 0] + (far @ weights[:, 1 : 1 + n_far])[..., 0]
        )
        return np.asarray(np.abs(value + 1j * omega * (far @ weights[:, 1 + n_far :])[..., 0]))

    def _place(self, drive: int) -> int:
        """Return the index of a place in the upper triangle."""
        n = int(self.shapes.shape[1])
        return drive * n - drive * (drive - 1) // 2

    def _lines(self, band: tuple[float, float]) -> FloatArray:
        """Return angular frequencies among which maxima are sought, (n, n_lines), ascending."""
        # A mechanism responds without limit towards 0 Hz, which is not a resonance.
        low, high = (2.0 * math.pi * end for end in searched(band, free=self.free))
        poles = self.frequencies
        n = len(poles)
        oscillates = (poles.imag > MECHANISM) & (np.abs(poles) < high)
        even = np.tile(np.linspace(low, high, _EVEN), (n, 1))
        around = poles.imag[..., np.newaxis] - poles.real[..., np.newaxis] * _AROUND
        around = np.where(oscillates[..., np.newaxis], around, high).reshape(n, -1)
        every = np.clip(np.hstack([even, around]), low, high)
        return np.sort(every, axis=1)

    def _sigma(self, omega: FloatArray) -> ComplexArray:
        return np.asarray(1j * omega if self.viscous else -(omega**2) + 0j)

    def _near(
        self, drive: int, rows: IntArray, omega: FloatArray
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return what `_drive` returns, without the far poles.

        The poles of a linkage that moves freely nearly coincide at 0 Hz, so that their residues are
        large and cancel; there the reduced models are solved instead.
        """
        sigma = self._sigma(omega)[:, np.newaxis]
        rate = 1j * np.ones_like(omega) if self.viscous else -2.0 * omega + 0j
        if not self.free:
            residues, terms = self.shapes[rows, drive] ** 2, 1.0 / (sigma - self.poles[rows])
            slope = -rate * (residues * terms**2).sum(axis=1)
            return np.asarray((residues * terms).sum(axis=1)), np.asarray(slope)
        inertia, stiffness, shapes = (each[rows] for each in self.models)
        rows_at_drive = shapes[:, drive] + 0j
        pencil = stiffness + sigma[:, np.newaxis] * inertia
        moved = np.linalg.solve(pencil, rows_at_drive[..., np.newaxis])
        slope = -rate * (moved * (inertia @ moved)).sum(axis=(1, 2))
        return np.asarray((rows_at_drive * moved[..., 0]).sum(axis=1)), np.asarray(slope)

    def _drive(
        self, drive: int, rows: IntArray, omega: FloatArray
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return H of one place and dH/dw, (k,), at angles by their rows and rad/s."""
        value, slope = self._near(drive, rows, omega)
        w, k, c = omega[:, np.newaxis], self.far.stiffness, self.far.decay
        weights = self.far.weights[rows, :, self._place(drive)]
        below, below_rate = k - w**2 + 1j * w * c, -2.0 * w + 1j * c
        a, b = weights[:, 1 : 1 + len(k)], weights[:, 1 + len(k) :]
        far = (a + 1j * w * b) / below
        value = value + weights[:, 0] + far.sum(axis=1)
        return value, slope + ((1j * b - far * below_rate) / below).sum(axis=1)

    def _slope(self, drive: int, rows: IntArray, omega: FloatArray) -> FloatArray:
        """Return d(abs(H)^2)/dw / 2, (k,)."""
        value, slope = self._drive(drive, rows, omega)
        return np.asarray((value.conj() * slope).real)


@dataclass(frozen=True, slots=True, eq=False)
class ReducedModels:
    """Reduced models at n angles of a piece of the stroke."""

    inertia: Numbers  # (n, order, order): G
    stiffness: Numbers  # (n, order, order): S
    shapes: Numbers  # (n, n_places, order): C
    far: Far
    viscous: bool
    free: bool  # whether the linkage can move freely at 0 Hz

    @property
    def modal(self) -> Modal:
        """The poles and residues."""
        matrices = -np.linalg.solve(self.inertia, self.stiffness)
        poles, vectors = np.linalg.eig(matrices)
        poles, vectors = poles.astype(complex), vectors.astype(complex)
        scale = ((self.inertia @ vectors) * vectors).sum(axis=1)
        # Where two poles meet to the last bit, their vectors have no scale; rounding gives one.
        scale = np.where(np.abs(scale) > _DEFECTIVE, scale, _DEFECTIVE)
        vectors = vectors / np.sqrt(scale)[:, np.newaxis]
        shapes = np.asarray(self.shapes @ vectors, dtype=np.complex128)
        models = self.inertia, self.stiffness, self.shapes
        return Modal(poles, shapes, self.viscous, self.free, self.far, models)

    def at(self, variables: FloatArray, wanted: FloatArray) -> "ReducedModels":
        """Interpolate from the stroke variables of the models to those wanted."""
        matrix = interpolation_matrix(variables, wanted)
        parts = self.inertia, self.stiffness, self.shapes, self.far.weights
        inertia, stiffness, shapes, weights = (np.tensordot(matrix, part, 1) for part in parts)
        far = replace(self.far, weights=weights)
        return replace(self, inertia=inertia, stiffness=stiffness, shapes=shapes, far=far)


def pole_residue_sum(modal: Modal, outputs: list[int], inputs: list[int]) -> PoleResidue:
    """Return the FRFs at the first of the angles between some places, by their indices."""
    poles, shapes, n = modal.poles[0], modal.shapes[0], modal.shapes.shape[1]
    residues = shapes[outputs][:, np.newaxis] * shapes[inputs][np.newaxis]
    if modal.viscous:
        k, c, above, rates = _second_order(poles, residues)
    else:
        k, c, above, rates = -poles, np.zeros(len(poles)), residues, np.zeros_like(residues)
    far, n_far = modal.far, len(modal.far.stiffness)
    full = from_triangle(far.weights[0], n, outputs, inputs)
    return PoleResidue(
        np.concatenate([k, far.stiffness]),
        np.concatenate([c, far.decay]),
        np.concatenate([above, full[:, :, 1 : 1 + n_far]], axis=2),
        np.concatenate([rates, full[:, :, 1 + n_far :]], axis=2),
        np.array(full[:, :, 0]),
    )


def from_triangle(
    rows: Numbers, n_places: int, outputs: list[int], inputs: list[int]
) -> ComplexArray:
    """Turn upper triangles, (n, n_triangle), into values between places, (n_out, n_in, n)."""
    upper, full = np.triu_indices(n_places), np.empty((len(rows), n_places, n_places), complex)
    full[:, upper[0], upper[1]] = full[:, upper[1], upper[0]] = rows
    return np.asarray(full[:, outputs][:, :, inputs].transpose(1, 2, 0))


def _second_order(
    poles: ComplexArray, residues: ComplexArray
) -> tuple[ComplexArray, FloatArray, ComplexArray, ComplexArray]:
    """Turn R / (s - p) into terms of the second order: k, c, and the constants and rates above.

    A term has two conjugate poles, or two real ones that are neighbours in magnitude; the last of
    an odd number of real ones is doubled, and the numerator cancels one.
    """
    upper = np.flatnonzero(poles.imag > 0.0)
    real = np.flatnonzero(poles.imag == 0.0)
    real = real[np.argsort(np.abs(poles[real]), kind="stable")]
    first_root, second_root = real[::2], real[1::2]
    if len(first_root) > len(second_root):
        second_root = np.append(second_root, first_root[-1])
    p = np.concatenate([poles[upper], poles[first_root]])
    q = np.concatenate([poles[upper].conj(), poles[second_root]])
    first = np.concatenate([residues[..., upper], residues[..., first_root]], axis=2)
    second = np.concatenate([residues[..., upper].conj(), residues[..., second_root]], axis=2)
    if len(real) % 2:
        second[..., -1] = 0.0
    above = -(first * q + second * p).real.astype(complex)
    rates = (first + second).real.astype(complex)
    return (p * q).real + 0j, -(p + q).real, above, rates
