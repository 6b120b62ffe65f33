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
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.modes import MECHANISM, paired
from linkage_vibration.mechanics.response import (
    FarPoles,
    PoleResidue,
    find_maxima,
    peak_search_band,
    sum_of_modes,
)
from linkage_vibration.table.interpolation import interpolation_matrix

_EVEN = 100  # Maxima are first sought at so many even frequencies,
_AROUND = np.linspace(-2.0, 2.0, 9)  # and so many half-widths from each resonance.
_DEFECTIVE = 1e-100

Numbers = NDArray[Any]
Indices = list[int] | slice

EVERY = slice(None)  # The indices of all places


@dataclass(frozen=True, slots=True, eq=False)
class Modal:
    """Poles and residues of reduced models at n angles: H = sum of psi psi^T / (sigma - pole)."""

    poles: ComplexArray  # (n, order): of sigma
    shapes: ComplexArray  # (n, n_rows, order): psi, at places and of forces
    models: "ReducedModels"

    @property
    def frequencies(self) -> ComplexArray:
        """Poles as complex angular frequencies lambda, (n, order), rad/s."""
        return self.poles if self.models.viscous else np.asarray(1j * np.sqrt(-self.poles))

    def frf(self, row: int, outputs: Indices, inputs: Indices) -> PoleResidue:
        """Return the FRFs at one of the angles between some places, by their indices."""
        poles, shapes, models = self.poles[row], self.shapes[row], self.models
        residues = shapes[outputs][:, np.newaxis] * shapes[: models.n_inputs][inputs][np.newaxis]
        if models.viscous:
            k, c, above, rates = _second_order(poles, residues)
        else:
            k, c, above, rates = -poles, np.zeros(len(poles)), residues, np.zeros_like(residues)
        full = from_pairs(models.weights[row], len(shapes), models.n_inputs)[outputs][:, inputs]
        return sum_of_modes(k, c, above, rates).with_far(models.far, full)

    def highest(self, band: tuple[float, float]) -> FloatArray:
        """Return frequency (Hz) and height (m/N) of the highest maximum in a band, (n, 2)."""
        rows, omega, size = self.maxima(band)
        best = np.lexsort((-size, rows))
        first = best[np.unique(rows[best], return_index=True)[1]]
        return np.column_stack([omega[first] / (2.0 * math.pi), size[first]])

    def maxima(self, band: tuple[float, float]) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return row, frequency (rad/s) and size (m/N) of the highest maxima of the first place."""
        grid = self._lines(band)
        row, at, _ = find_maxima(grid, self._magnitudes(grid), self._slope)
        return row, at, np.abs(self._drive(row, at)[0])

    def _magnitudes(self, omega: FloatArray) -> FloatArray:
        """Return abs(H) of the first place at angular frequencies of each angle, (n, n_lines)."""
        sigma, poles = self._sigma(omega), self.poles.T[..., np.newaxis]
        near = zip(self.shapes[:, 0].T[..., np.newaxis] ** 2, poles, strict=True)
        # One term after the other needs less memory, which takes half of the time.
        value = sum(residue / (sigma - pole) for residue, pole in near)
        value += self.models.far.sums(omega, self.models.weights[..., :1])[..., 0]
        return np.asarray(np.abs(value))

    def _lines(self, band: tuple[float, float]) -> FloatArray:
        """Return angular frequencies among which maxima are sought, (n, n_lines), ascending."""
        first, high = (2.0 * math.pi * end for end in peak_search_band(band, free=self.models.free))
        poles = self.frequencies
        n = len(poles)
        oscillates = (poles.imag > MECHANISM) & (np.abs(poles) < high)
        low = np.full((n, 1), first)
        if self.models.free:
            # A mechanism responds without limit towards 0 Hz, which is not a resonance.
            lowest = np.where(oscillates, np.abs(poles), high).min(axis=1, initial=high)
            low = np.maximum(low, lowest[:, np.newaxis] / 2.0)
        even = low + (high - low) * np.linspace(0.0, 1.0, _EVEN)
        around = poles.imag[..., np.newaxis] - poles.real[..., np.newaxis] * _AROUND
        around = np.where(oscillates[..., np.newaxis], around, high).reshape(n, -1)
        lines = np.sort(np.clip(np.hstack([even, around]), low, high), axis=1)
        return lines[:, : int((lines < high).sum(axis=1).max()) + 1]

    def _sigma(self, omega: FloatArray) -> ComplexArray:
        return np.asarray(1j * omega if self.models.viscous else -(omega**2) + 0j)

    def _near(self, rows: IntArray, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return what `_drive` returns, without the far poles.

        The poles of a linkage that moves freely nearly coincide at 0 Hz, so that their residues are
        large and cancel; there the reduced models are solved instead.
        """
        models, sigma = self.models, self._sigma(omega)[:, np.newaxis]
        rate = 1j * np.ones_like(omega) if models.viscous else -2.0 * omega + 0j
        if not models.free:
            residues, terms = self.shapes[rows, 0] ** 2, 1.0 / (sigma - self.poles[rows])
            slope = -rate * (residues * terms**2).sum(axis=1)
            return np.asarray((residues * terms).sum(axis=1)), np.asarray(slope)
        inertia, place = models.inertia[rows], models.shapes[rows, 0] + 0j
        pencil = models.stiffness[rows] + sigma[:, np.newaxis] * inertia
        moved = np.linalg.solve(pencil, place[..., np.newaxis])
        slope = -rate * (moved * (inertia @ moved)).sum(axis=(1, 2))
        return np.asarray((place * moved[..., 0]).sum(axis=1)), np.asarray(slope)

    def _drive(self, rows: IntArray, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return H of the first place and dH/dw, (k,), at angles by their rows and rad/s."""
        value, slope = self._near(rows, omega)
        far, rise = self.models.far.with_slopes(omega, self.models.weights[rows, :, 0])
        return value + far, slope + rise

    def _slope(self, rows: IntArray, omega: FloatArray) -> FloatArray:
        """Return d(abs(H)^2)/dw / 2, (k,)."""
        value, slope = self._drive(rows, omega)
        return np.asarray((value.conj() * slope).real)


@dataclass(frozen=True, slots=True, eq=False)
class ReducedModels:
    """Reduced models at n angles of a piece of the stroke."""

    inertia: Numbers  # (n, order, order): G
    stiffness: Numbers  # (n, order, order): S
    # (n, n_rows, order): C, of places, the first of which is that of the highest peak, then forces
    shapes: Numbers
    # (n, 1 + 2 n_far, n_pairs): static flexibility, residues and rates of each of `frf_pairs`
    weights: Numbers
    far_stiffness: ComplexArray  # (n_far,), as `FarPoles`
    far_decay: FloatArray  # (n_far,)
    n_inputs: int  # number of the places, which are also inputs of FRFs
    free: bool  # whether the linkage can move freely at 0 Hz

    @property
    def far(self) -> FarPoles:
        """The poles that represent all other modes."""
        return FarPoles(self.far_stiffness, self.far_decay)

    @property
    def viscous(self) -> bool:
        """Whether damping is viscous, rather than structural."""
        return not np.iscomplexobj(self.stiffness)

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
        return Modal(poles, np.asarray(self.shapes @ vectors, dtype=np.complex128), self)

    def at(self, variables: FloatArray, wanted: FloatArray) -> "ReducedModels":
        """Interpolate from the stroke variables of the models to those wanted."""
        matrix = interpolation_matrix(variables, wanted)
        parts = self.inertia, self.stiffness, self.shapes, self.weights
        inertia, stiffness, shapes, weights = (np.tensordot(matrix, part, 1) for part in parts)
        return replace(self, inertia=inertia, stiffness=stiffness, shapes=shapes, weights=weights)


MODEL_ARRAYS = [each.name for each in fields(ReducedModels)][:-2]
"""Names of the arrays of reduced models."""


@lru_cache
def frf_pairs(n_rows: int, n_inputs: int) -> tuple[IntArray, IntArray]:
    """Return outputs and inputs, (n_pairs,): places' upper triangle, then forces by each place."""
    upper, n_forces = np.triu_indices(n_inputs), n_rows - n_inputs
    forces, places = np.divmod(np.arange(n_forces * n_inputs), n_inputs)
    return np.append(upper[0], n_inputs + forces), np.append(upper[1], places)


def shortened(rows: Numbers, n_inputs: int) -> Numbers:
    """Round forces among `frf_pairs`, (..., n_pairs), to single precision, an error of 6e-8."""
    single = np.complex64 if np.iscomplexobj(rows) else np.float32
    first, rows = n_inputs * (n_inputs + 1) // 2, rows.copy()
    rows[..., first:] = rows[..., first:].astype(single)
    return rows


def from_pairs(rows: Numbers, n_rows: int, n_inputs: int) -> ComplexArray:
    """Turn values of `frf_pairs`, (n, n_pairs), into all of them, (n_rows, n_inputs, n)."""
    outputs, inputs = frf_pairs(n_rows, n_inputs)
    full = np.empty((n_rows, n_inputs, len(rows)), complex)
    full[outputs, inputs] = rows.T
    between = outputs < n_inputs
    full[inputs[between], outputs[between]] = rows.T[between]
    return full


def _second_order(
    poles: ComplexArray, residues: ComplexArray
) -> tuple[ComplexArray, FloatArray, ComplexArray, ComplexArray]:
    """Return k, c and both numerators of R / (s - p); an odd real pole is doubled and cancelled."""
    left, right = paired(poles)
    n, right = len(right), np.append(right, left[len(right) :])
    p, q, first, second = poles[left], poles[right], residues[..., left], residues[..., right]
    second[..., n:] = 0.0
    above = -(first * q + second * p).real.astype(complex)
    rates = (first + second).real.astype(complex)
    return (p * q).real.astype(complex), -(p + q).real, above, rates
