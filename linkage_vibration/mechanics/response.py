# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Frequency response functions as pole-residue sums, and their peaks."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.modes import MECHANISM, DampedModes

_REACH = 1.3  # Modes up to this multiple of the upper end of a band keep their own poles.
_MARGIN = 0.95  # Between configurations, the lowest mode may be lower by this factor.
N_FAR = 4
"""Default number of poles that represent the modes above a band."""

RIVAL = 0.8
"""Fraction of the highest value from which a maximum may be the highest between grid points."""

FREE_FROM = 0.01
"""Share of a band from which a mechanism's peak is sought where damping couples the modes."""

_NOTHING = 1e-15  # Smaller residues, as shares of the largest, are rounding.
_NEWTON = 6  # largest number of steps to a maximum; three or four are enough
_GRID = 200  # number of frequencies over the band at which a peak is sought first
_BESIDE = 1e-6  # relative distance from 0 Hz at which a slope is evaluated
# places, in quarter half-widths, at which a maximum is sought if Newton's method fails
_WIDER = np.arange(-32.0, 33.0)
_AROUND = np.linspace(-2.0, 2.0, 9)  # lines about each resonance, in half-power half-widths


class ResponseError(LinkageVibrationError):
    """A frequency response function cannot be evaluated as requested."""


@dataclass(frozen=True, slots=True)
class Peak:
    """The largest value of an FRF within a band.

    Attributes
    ----------
    frequency, magnitude : float
        Hz and m/N; the lower of two peaks of the same height. The magnitude is infinite at an
        undamped resonance.
    inside : bool
        Whether it is a resonance; False if the band has none that is higher than its ends.
    """

    frequency: float
    magnitude: float
    inside: bool


@dataclass(frozen=True, slots=True, eq=False)
class PoleResidue:
    """H(w) = sum over r of (residue_r + i w rate_r) / (k_r - w^2 + i w c_r) + residual.

    Attributes
    ----------
    stiffness : complex ndarray, (n_modes,)
        k, (rad/s)^2.
    decay : ndarray, (n_modes,)
        c, rad/s.
    residues, rates : complex ndarray, (n_out, n_in, n_modes)
        1/kg and s/kg; rates are zero unless viscous damping couples the modes.
    residual : complex ndarray, (n_out, n_in)
        Static flexibility of the modes that the sum leaves out, m/N; zero if it has every mode.
    """

    stiffness: ComplexArray
    decay: FloatArray
    residues: ComplexArray
    rates: ComplexArray
    residual: ComplexArray

    def frf(self, frequencies: FloatArray) -> ComplexArray:
        """Return the receptance at frequencies in Hz, (n_freq,), as (n_freq, n_out, n_in) in m/N.

        It is infinite on an undamped pole, such as 0 Hz of a mechanism.

        Raises
        ------
        ResponseError
            If the frequencies are not a one-dimensional array.

        Examples
        --------
        At 0 Hz an oscillator of 1 kg and 100 N/m yields 1/100 m/N:

        >>> oscillator = oscillators([10.0], [0.02], [1.0])
        >>> float(abs(oscillator.frf(np.array([0.0]))[0, 0, 0]))
        0.01
        """
        omega = 2.0 * math.pi * np.asarray(frequencies, dtype=float)
        if omega.ndim != 1:
            raise ResponseError(
                f"The frequencies are an array of shape {omega.shape}; give a list of Hz, such as "
                "[10.0, 20.0]."
            )
        terms = np.multiply.outer(self.decay, 1j * omega)
        terms += self.stiffness[:, np.newaxis]
        terms -= omega**2
        endless = terms == 0.0  # on an undamped pole
        terms[endless] = np.inf
        np.reciprocal(terms, out=terms)
        flat = self.residues.reshape(self.residual.size, -1) @ terms
        if self.rates.any():
            flat += (self.rates.reshape(self.residual.size, -1) @ terms) * 1j * omega
        flat += self.residual.reshape(-1, 1)
        frf = np.moveaxis(flat.reshape(*self.residual.shape, len(omega)), -1, 0)
        for mode, line in np.argwhere(endless):
            frf[line][(self.residues[:, :, mode] != 0.0) | (self.rates[:, :, mode] != 0.0)] = np.inf
        return np.asarray(frf)

    def condensed(self, kept: BoolArray, far: "FarPoles") -> "PoleResidue":
        """Keep some modes, and replace the sum of all others by far poles and a static residual.

        Parameters
        ----------
        kept, far
            Which modes keep their poles, (n_modes,); the poles chosen for the band and the others.
        """
        shape = self.residues.shape[:2]
        others = self._only(~kept).frf(far.frequencies).reshape(len(far.frequencies), -1)
        rates = np.zeros((len(far.stiffness), math.prod(shape)), dtype=complex)
        if self.rates.any():
            weights, rates = far.fit_with_rates(others)
        elif self.residues.imag.any() or self.stiffness.imag.any():
            weights = far.fit(others)
        else:
            weights = far.fit_real(others).astype(complex)
        near, parts = self._only(kept), (*shape, len(far.stiffness))
        return PoleResidue(
            np.concatenate([near.stiffness, far.stiffness]),
            np.concatenate([near.decay, far.decay]),
            np.concatenate([near.residues, weights[1:].T.reshape(parts)], axis=2),
            np.concatenate([near.rates, rates.T.reshape(parts)], axis=2),
            self.residual + weights[0].reshape(shape),
        )

    def between(self, output: int, into: int) -> "PoleResidue":
        """Return a single FRF.

        Parameters
        ----------
        output, into : int
            Indices.
        """
        at = slice(output, output + 1), slice(into, into + 1)
        return PoleResidue(
            self.stiffness, self.decay, self.residues[at], self.rates[at], self.residual[at]
        )

    def _only(self, which: BoolArray) -> "PoleResidue":
        """Return the sum over a selection of the modes, (n_modes,), without the residual."""
        return PoleResidue(
            self.stiffness[which],
            self.decay[which],
            self.residues[:, :, which],
            self.rates[:, :, which],
            np.zeros_like(self.residual),
        )

    def peak(self, band: tuple[float, float]) -> Peak:
        """Find the largest magnitude of a single FRF within a band (Hz), its ends included.

        A grid, refined about each resonance in the band, brackets its maxima; the zeros of the
        derivative of abs(H)^2 in the brackets of the highest ones are compared.
        """
        low, high = 2.0 * math.pi * band[0], 2.0 * math.pi * band[1]
        omega = np.sqrt(np.abs(self.stiffness))
        if (omega < MECHANISM).any():
            # A mechanism responds without limit towards 0 Hz, which is not a resonance.
            first = float(omega[omega >= MECHANISM].min(initial=high)) / 2.0
            low = max(low, FREE_FROM * high if self.rates.any() else first)
        inside = (omega > low) & (omega < high)
        centre, width = omega[inside], self._half_widths(inside)
        driven = np.abs(self.residues[0, 0, inside]) + centre * np.abs(self.rates[0, 0, inside])
        endless = centre[(width <= 0.0) & (driven > 0.0)]
        if len(endless):
            return Peak(float(endless.min()) / (2.0 * math.pi), math.inf, True)
        grid = 2.0 * math.pi * self.lines((low / (2.0 * math.pi), band[1]), _GRID)
        size = np.abs(self._value(grid))
        rises, falls = np.diff(size, prepend=-1.0) > 0.0, np.diff(size, append=-1.0) <= 0.0
        best = Peak(math.nan, -1.0, False)
        for top in np.flatnonzero(rises & falls & (size >= RIVAL * size.max())).tolist():
            left, right = grid[max(top - 1, 0)], grid[min(top + 1, len(grid) - 1)]
            left = max(left, _BESIDE * right)  # at 0 Hz itself the slope is zero
            at, turns = float(grid[top]), self._slope(left) > 0.0 > self._slope(right)
            if turns:
                at = float(brentq(self._slope, left, right, xtol=1e-14 * high, rtol=1e-14))
            magnitude = float(np.abs(self._value(np.array([at]))[0]))
            if magnitude > best.magnitude:
                best = Peak(at / (2.0 * math.pi), magnitude, turns)
        # A bracket may hold two maxima, and the higher one may have been missed.
        for at, magnitude in zip(*self.local_peaks(np.flatnonzero(inside)), strict=True):
            if magnitude > best.magnitude * (1.0 + 1e-12) and band[0] < at < band[1]:
                best = Peak(float(at), float(magnitude), True)
        return best

    def lines(self, band: tuple[float, float], count: int) -> FloatArray:
        """Return frequencies (Hz) over a band, evenly spaced, and more about each resonance there.

        Parameters
        ----------
        band, count
            Hz; number of evenly spaced ones, including the ends of the band.
        """
        low, high = 2.0 * math.pi * band[0], 2.0 * math.pi * band[1]
        omega = np.sqrt(np.abs(self.stiffness))
        inside = (omega > max(low, MECHANISM)) & (omega < high)
        near = omega[inside] + np.multiply.outer(_AROUND, self._half_widths(inside))
        every = np.clip([*np.linspace(low, high, count), *near.ravel()], low, high)
        return np.asarray(np.unique(every) / (2.0 * math.pi))

    def local_peaks(
        self, modes: IntArray, band: tuple[float, float] = (0.0, math.inf)
    ) -> tuple[FloatArray, FloatArray]:
        """Return the maximum near the resonance of some modes, of a single FRF.

        Parameters
        ----------
        modes, band
            Indices, (n,), and Hz: maxima that other modes shifted are only sought in the band.

        Returns
        -------
        frequencies, magnitudes : ndarray, (n,)
            Hz and m/N; NaN where there is no maximum, infinite if a mode is undamped. Modes close
            to one another may share a maximum.
        """
        k, width = np.abs(self.stiffness[modes]), self._half_widths(modes)
        start = np.sqrt(np.maximum(k - 2.0 * width**2, 0.0))
        omega, settled = self._climb(start, width, 3.0 * width)
        inside = (start >= 2.0 * math.pi * band[0]) & (start <= 2.0 * math.pi * band[1])
        lost = np.flatnonzero(~settled & inside)
        if len(lost):
            # Other modes have shifted the maximum: look for the nearest one.
            step = width[lost] / 4.0
            around = np.maximum(start[lost] + np.multiply.outer(_WIDER, step), 0.0)
            size = np.abs(self._value(around.ravel())).reshape(around.shape)
            top = np.zeros(size.shape, dtype=bool)
            top[1:-1] = (size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])
            nearest = np.where(top, np.abs(_WIDER)[:, np.newaxis], np.inf).argmin(axis=0)
            begin = around[nearest, np.arange(len(lost))]
            again, found_again = self._climb(begin, step, 2.0 * step)
            settled[lost], omega[lost] = found_again & top.any(axis=0), again
        omega[~settled] = np.nan
        sizes, finite = np.full(len(omega), np.nan), np.isfinite(omega)
        sizes[finite] = np.abs(self._value(omega[finite]))
        driven = (self.residues[0, 0, modes] != 0.0) | (self.rates[0, 0, modes] != 0.0)
        endless = (width <= 0.0) & driven
        omega[endless], sizes[endless] = start[endless], np.inf
        return omega / (2.0 * math.pi), sizes

    def _half_widths(self, modes: IntArray | BoolArray) -> FloatArray:
        """Return half of the half-power bandwidths of some modes, rad/s."""
        omega = np.sqrt(np.abs(self.stiffness[modes]))
        return np.asarray((self.decay[modes] + self.stiffness.imag[modes] / omega) / 2.0)

    def _climb(
        self, start: FloatArray, stride: FloatArray, reach: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return maxima of abs(H) by Newton's method, rad/s, and whether each was found."""
        omega = start.copy()
        for _ in range(_NEWTON):
            value, first, second = self._single(omega)
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = (value.conj() * first).real
                bend = np.abs(first) ** 2 + (value.conj() * second).real
                step = np.where(bend < 0.0, slope / bend, 0.0)
            omega = omega - np.clip(step, -stride, stride)
            if (np.abs(step) <= 1e-12 * start).all():
                break
        settled = (np.abs(omega - start) < reach) & (np.abs(step) <= 1e-6 * stride) & (bend < 0.0)
        return omega, settled

    def _terms(self, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return denominators and terms of the only FRF, (n_freq, n_modes)."""
        w = omega[:, np.newaxis]
        below = self.stiffness - w**2 + 1j * w * self.decay
        with np.errstate(divide="ignore", invalid="ignore"):  # on a pole that is undamped
            return below, (self.residues[0, 0] + w * (1j * self.rates[0, 0])) / below

    def _value(self, omega: FloatArray) -> ComplexArray:
        """Return the only FRF at angular frequencies, (n_freq,)."""
        return np.asarray(self._terms(omega)[1].sum(axis=1) + self.residual[0, 0])

    def _single(self, omega: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return H, dH/dw and d2H/dw2 of the only FRF, at angular frequencies, (n_freq,)."""
        below, value = self._terms(omega)
        rate, below_rate = 1j * self.rates[0, 0], 1j * self.decay - 2.0 * omega[:, np.newaxis]
        with np.errstate(divide="ignore", invalid="ignore"):
            first = (rate - value * below_rate) / below
            second = 2.0 * (value - first * below_rate) / below
        return value.sum(axis=1) + self.residual[0, 0], first.sum(axis=1), second.sum(axis=1)

    def _slope(self, omega: float) -> float:
        """Return d(abs(H)^2)/dw / 2."""
        value, derivative, _ = self._single(np.array([omega]))
        return float((value.conj() * derivative)[0].real)


@dataclass(frozen=True, slots=True, eq=False)
class FarPoles:
    """Poles above a band, fixed beforehand, whose sum represents that of all modes there.

    However many modes lie above the band, and however they veer from one configuration to the
    next, their sum within the band is smooth. It is a * 1 + sum over j of b_j k_j / (k_j - w^2 +
    i w c_j) to a good approximation, where 1 / k_j are the Chebyshev nodes between 0 and 1 / k of
    the lowest of those modes; each pole divides the error by about ten.
    """

    stiffness: ComplexArray  # (n_far,): k, (rad/s)^2
    decay: FloatArray  # (n_far,): c, rad/s
    frequencies: FloatArray  # (n_lines,), Hz, at which a sum is fitted
    _inverse: ComplexArray
    _real_inverse: FloatArray

    def fit(self, sums: ComplexArray) -> ComplexArray:
        """Return static residual and residues, (1 + n_far, k), of sums, (n_lines, k)."""
        return np.asarray(self._inverse @ sums)

    def fit_real(self, sums: ComplexArray) -> FloatArray:
        """Return the same for real residues, which real modes have."""
        return np.asarray(self._real_inverse @ np.vstack([sums.real, sums.imag]))

    def fit_with_rates(self, sums: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return residual and residues, (1 + n_far, k), and rates, (n_far, k), of complex modes."""
        w, k = 2.0 * math.pi * self.frequencies[:, np.newaxis], self.stiffness.real
        terms = k / (k - w**2 + 1j * w * self.decay)
        basis = np.hstack([np.ones((len(w), 1)), terms, 1j * w / np.sqrt(k) * terms])
        scale = np.concatenate([[1.0], k, np.sqrt(k)])[:, np.newaxis]
        rows, values = (np.vstack([part.real, part.imag]) for part in (basis, sums))
        weights = scale * np.linalg.lstsq(rows, values, rcond=None)[0] + 0j
        return weights[: 1 + len(k)], weights[1 + len(k) :]


def far_poles(
    stiffness: ComplexArray, decay: FloatArray, band: tuple[float, float], n_far: int = N_FAR
) -> FarPoles:
    """Choose poles for the modes (k and c) above a band (Hz), of one or more configurations."""
    n_lines = 3 * n_far + 4
    nodes = (1.0 - np.cos(np.pi * (np.arange(n_lines) + 0.5) / n_lines)) / 2.0
    frequencies = band[0] + (band[1] - band[0]) * nodes
    if not len(stiffness):
        k, c = np.zeros(0, dtype=complex), np.zeros(0)
        nothing = np.zeros((1, n_lines))
        return FarPoles(k, c, frequencies, nothing.astype(complex), np.zeros((1, 2 * n_lines)))
    lowest = _MARGIN * stiffness.real.min()
    steps = (1.0 - np.cos(np.pi * (np.arange(n_far) + 0.5) / n_far)) / 2.0
    k = lowest / steps[::-1] + 0j
    # The damping follows a line, c = a + b k, like Rayleigh's; the nearest modes count most.
    weights = lowest / stiffness.real
    lines = np.column_stack([np.ones(len(decay)), stiffness.real / lowest])
    goal = np.column_stack([decay, stiffness.imag])
    size = weights[:, np.newaxis]
    law = np.linalg.lstsq(lines * size, goal * size, rcond=None)[0]
    damping = np.column_stack([np.ones(n_far), k.real / lowest]) @ law
    k, c = np.asarray(k + 1j * damping[:, 1], dtype=np.complex128), damping[:, 0].copy()
    w = 2.0 * math.pi * frequencies[:, np.newaxis]
    basis = np.hstack([np.ones((n_lines, 1)), k / (k - w**2 + 1j * w * c)])
    scale = np.concatenate([[1.0], k])[:, np.newaxis]
    inverse = (scale * np.linalg.pinv(basis)).astype(np.complex128)
    real_inverse = scale.real * np.linalg.pinv(np.vstack([basis.real, basis.imag]))
    return FarPoles(k, c, frequencies, inverse, real_inverse)


def searched(band: tuple[float, float], *, free: bool) -> tuple[float, float]:
    """Return the part of a band (Hz) in which responses are compared; `free` is for a mechanism."""
    return (max(band[0], FREE_FROM * band[1]), band[1]) if free else band


def in_reach(
    stiffness: FloatArray | ComplexArray,
    band: tuple[float, float],
    decay: FloatArray | None = None,
) -> BoolArray:
    """Return which modes are in a band (Hz), or too close above it for far poles, (n_modes,).

    The slower root of an overdamped mode decides, if the decay c, rad/s, is given.
    """
    size = np.sqrt(np.abs(stiffness))
    if decay is not None:
        slow = decay > 2.0 * size
        fast = decay[slow] / 2.0 + np.sqrt(decay[slow] ** 2 / 4.0 - size[slow] ** 2)
        size[slow] = size[slow] ** 2 / fast
    return np.asarray(size < reach(band))


def reach(band: tuple[float, float]) -> float:
    """Return up to which magnitude poles are tabulated one by one for a band (Hz), rad/s."""
    return 2.0 * math.pi * _REACH * band[1]


def pole_residue(damped: DampedModes, outputs: FloatArray, inputs: FloatArray) -> PoleResidue:
    """Turn damped modes into FRFs; outputs, (n_out, n_modes), and inputs are on undamped modes."""
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
    # A mechanism mode that does not move the places has no term, but rounding would leave one.
    size = np.abs(constants).max(axis=(0, 1), initial=0.0)
    kept = (np.abs(damped.stiffness) > MECHANISM**2) | (size > _NOTHING * size.max(initial=0.0))
    return PoleResidue(
        damped.stiffness[kept],
        damped.decay[kept],
        constants[:, :, kept],
        rates[:, :, kept],
        np.zeros(constants.shape[:2], dtype=complex),
    )


def oscillators(omega: ArrayLike, damping_ratios: ArrayLike, residues: ArrayLike) -> PoleResidue:
    """Return one FRF: the sum of viscously damped oscillators (rad/s, 1 and 1/kg)."""
    w = np.asarray(omega, dtype=float)
    above = np.asarray(residues, dtype=complex)[np.newaxis, np.newaxis]
    decay = 2.0 * np.asarray(damping_ratios, dtype=float) * w
    residual = np.zeros((1, 1), dtype=complex)
    return PoleResidue(w**2 + 0j, decay, above, np.zeros_like(above), residual)
