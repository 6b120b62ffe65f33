# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Frequency response functions as pole-residue sums, and their peaks."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from linkage_vibration.mechanics.modes import DampedModes

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_MECHANISM = (2.0 * math.pi * 1e-2) ** 2  # (rad/s)^2: a mode below 0.01 Hz is a mechanism's
_NOTHING = 1e-15  # of the largest residue
_GRID = 200  # frequencies over the band in which a peak is sought first
_AROUND = np.linspace(-2.0, 2.0, 9)  # and about each resonance, in half-power half-widths


@dataclass(frozen=True, slots=True)
class Peak:
    """Where an FRF is largest within a band."""

    frequency: float  # Hz
    magnitude: float  # m/N


@dataclass(frozen=True, slots=True, eq=False)
class PoleResidue:
    """H(w) = sum over r of (residue_r + i w rate_r) / (k_r - w^2 + i w c_r).

    Attributes
    ----------
    stiffness : complex ndarray, (n_modes,)
        k, (rad/s)^2.
    decay : ndarray, (n_modes,)
        c, rad/s.
    residues, rates : complex ndarray, (n_out, n_in, n_modes)
        1/kg and s/kg; rates are zero unless viscous damping couples the modes.
    """

    stiffness: ComplexArray
    decay: FloatArray
    residues: ComplexArray
    rates: ComplexArray

    def frf(self, frequencies: FloatArray) -> ComplexArray:
        """Receptance at frequencies in Hz, (n_freq,), as (n_freq, n_out, n_in) in m/N.

        Examples
        --------
        At 0 Hz an oscillator of 1 kg and 100 N/m yields 1/100 m/N:

        >>> one = oscillators([10.0], [0.02], [1.0])
        >>> float(abs(one.frf(np.array([0.0]))[0, 0, 0]))
        0.01
        """
        omega = 2.0 * math.pi * np.asarray(frequencies, dtype=float)
        terms = 1.0 / self._denominators(omega)
        flat = terms @ self.residues.reshape(-1, len(self.decay)).T
        if self.rates.any():
            flat += 1j * omega[:, np.newaxis] * (terms @ self.rates.reshape(flat.shape[1], -1).T)
        return flat.reshape(len(omega), *self.residues.shape[:2])

    def peak(self, band: tuple[float, float]) -> Peak:
        """Find the largest magnitude within a band, its ends included, of a single FRF.

        A grid, refined about each resonance in the band, brackets the largest value; the zero of
        the derivative of abs(H)^2 in the bracket is the peak.

        Parameters
        ----------
        band : tuple of float
            Hz.
        """
        low, high = 2.0 * math.pi * band[0], 2.0 * math.pi * band[1]
        omega = np.sqrt(np.abs(self.stiffness))
        inside = (omega > low) & (omega < high)
        centre = omega[inside]
        width = (self.decay[inside] + self.stiffness.imag[inside] / centre) / 2.0
        near = centre + np.multiply.outer(_AROUND, width)
        grid = np.unique(np.clip([*np.linspace(low, high, _GRID), *near.ravel()], low, high))
        top = int(np.abs(self._single(grid)[0]).argmax())
        left, right = grid[max(top - 1, 0)], grid[min(top + 1, len(grid) - 1)]
        at = float(grid[top])
        if self._slope(left) > 0.0 > self._slope(right):
            at = float(brentq(self._slope, left, right, xtol=1e-14 * high, rtol=1e-14))
        magnitude = float(np.abs(self._single(np.array([at]))[0][0]))
        return Peak(at / (2.0 * math.pi), magnitude)

    def _denominators(self, omega: FloatArray) -> ComplexArray:
        w = omega[:, np.newaxis]
        return np.asarray(self.stiffness - w**2 + 1j * w * self.decay)

    def _single(self, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """H and dH/dw of the only FRF, at angular frequencies, (n_freq,)."""
        w = omega[:, np.newaxis]
        below = self._denominators(omega)
        residues, rates = self.residues[0, 0], self.rates[0, 0]
        above = residues + 1j * w * rates
        slope = (1j * rates - above * (1j * self.decay - 2.0 * w) / below) / below
        return (above / below).sum(axis=1), slope.sum(axis=1)

    def _slope(self, omega: float) -> float:
        """d(abs(H)^2)/dw / 2."""
        value, derivative = self._single(np.array([omega]))
        return float((value.conj() * derivative)[0].real)


def pole_residue(damped: DampedModes, outputs: FloatArray, inputs: FloatArray) -> PoleResidue:
    """Turn damped modes into the FRFs between outputs and inputs.

    Parameters
    ----------
    damped : DampedModes
        As `damp_modes` finds them.
    outputs : ndarray, (n_out, n_modes)
        What the undamped, mass-normalised modes contribute to each output.
    inputs : ndarray, (n_in, n_modes)
        And how each input drives them.
    """
    if damped.shapes is None:
        pairs = [(outputs.astype(complex), inputs.astype(complex))]
    else:
        pairs = [(outputs @ shapes, inputs @ shapes) for shapes in damped.shapes]
    residues: list[ComplexArray] = [out[:, np.newaxis] * into[np.newaxis] for out, into in pairs]
    if damped.poles is None:
        constants, rates = residues[0], np.zeros_like(residues[0])
    else:
        # R / (s - p) + S / (s - q) = ((R + S) s - (R q + S p)) / (s^2 - (p + q) s + p q)
        (first, second), (p, q) = residues, damped.poles
        constants = -(first * q + second * p).real.astype(complex)
        rates = (first + second).real.astype(complex)
    # A mechanism mode that the places do not share has no term, where rounding leaves one at 0 Hz.
    size = np.abs(constants).max(axis=(0, 1), initial=0.0)
    kept = (np.abs(damped.stiffness) > _MECHANISM) | (size > _NOTHING * size.max(initial=0.0))
    return PoleResidue(
        damped.stiffness[kept], damped.decay[kept], constants[:, :, kept], rates[:, :, kept]
    )


def oscillators(
    omega: "FloatArray | list[float]",
    damping_ratios: "FloatArray | list[float]",
    residues: "FloatArray | list[float]",
) -> PoleResidue:
    """Return one FRF, the sum of viscously damped oscillators.

    Parameters
    ----------
    omega, damping_ratios, residues : array_like, (n_modes,)
        rad/s, 1 and 1/kg.
    """
    w = np.asarray(omega, dtype=float)
    above = np.asarray(residues, dtype=complex)[np.newaxis, np.newaxis]
    decay = 2.0 * np.asarray(damping_ratios, dtype=float) * w
    return PoleResidue(w**2 + 0j, decay, above, np.zeros_like(above))
