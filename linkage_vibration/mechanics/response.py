# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Frequency response functions as pole-residue sums, and their peaks."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_GRID = 200  # frequencies over the band in which a peak is sought first
_AROUND = np.linspace(-2.0, 2.0, 9)  # and about each resonance, in half-power half-widths


@dataclass(frozen=True, slots=True)
class Peak:
    """Where an FRF is largest within a band."""

    frequency: float  # Hz
    magnitude: float  # m/N


@dataclass(frozen=True, slots=True)
class PoleResidue:
    """H(w) = sum over r of residue_r / (w_r^2 - w^2 + 2 i zeta_r w_r w).

    Attributes
    ----------
    omega : ndarray, (n_modes,)
        Natural frequencies, rad/s.
    damping_ratios : ndarray, (n_modes,)
        1.
    residues : ndarray, (n_modes,)
        phi_out phi_in of mass-normalised shapes, 1/kg.
    """

    omega: FloatArray
    damping_ratios: FloatArray
    residues: FloatArray

    def frf(self, frequencies: FloatArray) -> ComplexArray:
        """Receptance at frequencies in Hz, (n_freq,), in m/N.

        Examples
        --------
        At 0 Hz an oscillator of 1 kg and 100 N/m yields 1/100 m/N:

        >>> one = PoleResidue(np.array([10.0]), np.array([0.02]), np.array([1.0]))
        >>> float(abs(one.frf(np.array([0.0]))[0]))
        0.01
        """
        return self._sum(2.0 * math.pi * np.asarray(frequencies, dtype=float))[0]

    def peak(self, band: tuple[float, float]) -> Peak:
        """Find the largest magnitude within a band, its ends included.

        A grid, refined about each resonance in the band, brackets the largest value; the zero of
        the derivative of abs(H)^2 in the bracket is the peak.

        Parameters
        ----------
        band : tuple of float
            Hz.
        """
        low, high = 2.0 * math.pi * band[0], 2.0 * math.pi * band[1]
        inside = (self.omega > low) & (self.omega < high)
        width = (self.damping_ratios * self.omega)[inside]
        near = self.omega[inside] + np.multiply.outer(_AROUND, width)
        grid = np.unique(np.clip([*np.linspace(low, high, _GRID), *near.ravel()], low, high))
        top = int(np.abs(self._sum(grid)[0]).argmax())
        left, right = grid[max(top - 1, 0)], grid[min(top + 1, len(grid) - 1)]
        omega = float(grid[top])
        if self._slope(left) > 0.0 > self._slope(right):
            omega = float(brentq(self._slope, left, right, xtol=1e-14 * high, rtol=1e-14))
        magnitude = float(np.abs(self._sum(np.array([omega]))[0][0]))
        return Peak(omega / (2.0 * math.pi), magnitude)

    def _sum(self, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """H and dH/dw at angular frequencies, (n_freq,)."""
        w = omega[:, np.newaxis]
        decay = 2.0 * self.damping_ratios * self.omega
        poles = self.omega**2 - w**2 + 1j * decay * w
        terms = self.residues / poles
        return terms.sum(axis=1), (terms * (2.0 * w - 1j * decay) / poles).sum(axis=1)

    def _slope(self, omega: float) -> float:
        """d(abs(H)^2)/dw / 2."""
        value, derivative = self._sum(np.array([omega]))
        return float((value.conj() * derivative)[0].real)
