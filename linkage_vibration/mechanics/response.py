# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Frequency response functions as pole-residue sums, and their peaks."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import (
    BoolArray,
    ComplexArray,
    FloatArray,
    IntArray,
    Reals,
    product,
    real_equations,
    real_numbers,
)
from linkage_vibration.mechanics.frf import Frf
from linkage_vibration.mechanics.modes import MECHANISM, DampedModes

_REACH = 1.3  # Modes up to this multiple of the upper end of a band keep their own poles.
_MARGIN = 0.95  # Between configurations, the lowest mode may be lower by this factor.
N_FAR = 4
"""Default number of poles that represent the modes above a band."""

RIVAL = 0.8
"""Fraction of the highest value from which a maximum may be the highest between grid points."""

_FREE_FROM = 0.01  # Responses of a mechanism are compared from this share of a band.
_NOTHING = 1e-15  # Smaller residues, as shares of the largest, are rounding.
_NEWTON = 6  # largest number of steps to a maximum; three or four are enough
_GRID = 200  # number of frequencies over the band at which a peak is sought first
_STEPS = 12  # Each maximum is then found in so many steps.
_BESIDE = 1e-6  # relative distance from 0 Hz at which a slope is evaluated
_WIDER = np.arange(-32.0, 33.0)  # quarter half-widths in which a maximum is sought at last
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
    """H = sum over r of (residue_r + s rate_r) / (k_r + s c_r + s^2) + residual + s residual_rate.

    s is i w.

    Attributes
    ----------
    stiffness : complex ndarray, (n_modes,)
        k, (rad/s)^2.
    decay : ndarray, (n_modes,)
        c, rad/s.
    residues, rates : complex ndarray, (n_out, n_in, n_modes)
        1/kg and s/kg; rates are zero unless viscous damping couples the modes.
    residual : complex ndarray, (n_out, n_in)
        Static flexibility of the modes that the sum leaves out, m/N; zero of displacements if it
        has every mode.
    residual_rate : complex ndarray
        The same, times s: that of forces of which inputs have rates.
    outputs, inputs, error
        As those of the `Frf` that `at` returns; none of a sum that was not made between places.
    """

    stiffness: ComplexArray
    decay: FloatArray
    residues: ComplexArray
    rates: ComplexArray
    residual: ComplexArray
    residual_rate: ComplexArray = field(default_factory=lambda: np.zeros((1, 1), dtype=complex))
    outputs: tuple[tuple[str, str], ...] = ()
    inputs: tuple[tuple[str, str], ...] = ()
    error: FloatArray = field(default_factory=lambda: np.full(1, math.nan))

    def at(self, frequencies: Reals) -> Frf:
        """Return the values of `frf` with their places, for pictures and datasets.

        Raises
        ------
        ResponseError
            If the sum was not made between places.
        """
        if not (self.outputs and self.inputs):
            hint = "use `frf`, or what a solution or a table returns"
            raise ResponseError(f"These sums of modes do not know their places; {hint}.")
        lines, values = real_numbers(frequencies, "frequencies"), self.frf(frequencies)
        error = np.broadcast_to(self.error, len(self.outputs))
        return Frf(lines, self.outputs, self.inputs, values, error)

    def frf(self, frequencies: Reals) -> ComplexArray:
        """Return the receptance at frequencies in Hz, (n_freq,), as (n_freq, n_out, n_in) in m/N.

        It is infinite on an undamped pole, such as 0 Hz of a mechanism.

        Raises
        ------
        ResponseError
            If the frequencies are not a one-dimensional array of finite numbers.

        Examples
        --------
        At 0 Hz an oscillator of 1 kg and 100 N/m yields 1/100 m/N:

        >>> oscillator = oscillators([10.0], [0.02], [1.0])
        >>> float(abs(oscillator.frf(np.array([0.0]))[0, 0, 0]))
        0.01
        """
        if np.ndim(frequencies) != 1:
            problem = f"The frequencies are an array of shape {np.shape(frequencies)}"
            raise ResponseError(f"{problem}; give a list of Hz, such as [10.0, 20.0].")
        omega = 2.0 * math.pi * real_numbers(frequencies, "frequencies")
        if not np.isfinite(omega).all():
            raise ResponseError("A frequency is not a finite number; give Hz.")
        terms = np.multiply.outer(self.decay, 1j * omega)
        terms += self.stiffness[:, np.newaxis]
        terms -= omega**2
        endless = terms == 0.0  # on an undamped pole
        terms[endless] = np.inf
        np.reciprocal(terms, out=terms)
        flat = product(self.residues.reshape(self.residual.size, len(terms)), terms)
        if self.rates.any():
            rates = self.rates.reshape(self.residual.size, len(terms))
            flat += product(rates, 1j * omega * terms)
        flat += self.residual.reshape(-1, 1)
        if self.residual_rate.any():
            flat += self.residual_rate.reshape(-1, 1) * 1j * omega
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
        others = self._only(~kept).frf(far.frequencies).reshape(len(far.frequencies), -1)
        rates = bool(self.rates.any())
        real = rates or not (self.residues.imag.any() or self.stiffness.imag.any())
        weights = far.fit(others, real=real, rates=rates).T.reshape(*self.residual.shape, -1)
        return replace(self._only(kept), residual=self.residual).with_far(far, weights)

    def with_far(self, far: "FarPoles", weights: NDArray[Any]) -> "PoleResidue":
        """Add far poles.

        Parameters
        ----------
        far, weights
            The poles, and what `FarPoles.fit` returns for each FRF, (n_out, n_in, 1 + 2 n_far).
        """
        n = 1 + len(far.decay)
        return PoleResidue(
            np.concatenate([self.stiffness, far.stiffness]),
            np.concatenate([self.decay, far.decay]),
            np.concatenate([self.residues, weights[:, :, 1:n]], axis=2),
            np.concatenate([self.rates, weights[:, :, n:]], axis=2),
            self.residual + weights[:, :, 0],
        )

    def driven(self, w: FloatArray, v: FloatArray) -> "PoleResidue":
        """Return the responses to w + s v at the inputs together, where s is i omega.

        Parameters
        ----------
        w, v : ndarray, (n_in, n)
            Weights of the inputs in each of n responses.

        Returns
        -------
        PoleResidue, (n_out, n)
        """

        def summed(values: ComplexArray, by: FloatArray) -> ComplexArray:
            return np.asarray(np.tensordot(values, by, ([1], [0])).swapaxes(1, 2))

        # (a + s b) (w + s v) with s^2 = D - kappa - s gamma, where D is the term's denominator.
        a, b, squared = self.residues, self.rates, summed(self.rates, v)
        residues = summed(a, w) - squared * self.stiffness
        rates = summed(a, v) + summed(b, w) - squared * self.decay
        residual = squared.sum(axis=2) + self.residual @ w
        rest = residual, self.residual @ v
        return PoleResidue(self.stiffness, self.decay, residues, rates, *rest)

    def _only(self, which: BoolArray) -> "PoleResidue":
        """Return the sum over a selection of the modes, (n_modes,), without the residual."""
        residues, rates = self.residues[:, :, which], self.rates[:, :, which]
        return sum_of_modes(self.stiffness[which], self.decay[which], residues, rates)

    def peak(self, band: tuple[float, float]) -> Peak:
        """Find the largest magnitude of a single FRF within a band (Hz), its ends included.

        A grid, refined about each resonance in the band, brackets its maxima; the zeros of the
        derivative of abs(H)^2 in the brackets of the highest ones are compared.
        """
        low, high = (2.0 * math.pi * real_numbers(band, "band")).tolist()
        omega = np.sqrt(np.abs(self.stiffness))
        if (omega < MECHANISM).any():
            # A mechanism responds without limit towards 0 Hz, which is not a resonance.
            oscillates = (omega >= MECHANISM) & (self.decay < 2.0 * omega)
            low = max(low, float(omega[oscillates].min(initial=high)) / 2.0)
        inside = (omega > low) & (omega < high)
        centre, width = omega[inside], self._half_widths(inside)
        driven = np.abs(self.residues[0, 0, inside]) + centre * np.abs(self.rates[0, 0, inside])
        endless = centre[(width <= 0.0) & (driven > 0.0)]
        if len(endless):
            return Peak(float(endless.min()) / (2.0 * math.pi), math.inf, True)
        grid = 2.0 * math.pi * self.lines((low / (2.0 * math.pi), band[1]), _GRID)
        size = np.abs(self._value(grid))[np.newaxis]
        _, tops, turns = find_maxima(grid[np.newaxis], size, lambda _, w: self._slope(w))
        sizes = np.abs(self._value(tops))
        top = int(sizes.argmax())
        best = Peak(float(tops[top]) / (2.0 * math.pi), float(sizes[top]), bool(turns[top]))
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
        low, high = (2.0 * math.pi * real_numbers(band, "band")).tolist()
        omega = np.sqrt(np.abs(self.stiffness))
        inside = (omega > max(low, MECHANISM)) & (omega < high)
        near = omega[inside] + np.multiply.outer(_AROUND, self._half_widths(inside))
        every = np.clip([*np.linspace(low, high, count), *near.ravel()], low, high)
        return np.asarray(np.unique(every) / (2.0 * math.pi))

    def local_peaks(self, modes: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the maximum near the resonance of some modes, indices (n,), of a single FRF.

        Returns
        -------
        frequencies, magnitudes : ndarray, (n,)
            Hz and m/N; NaN where there is no maximum, infinite if a mode is undamped. Modes close
            to one another may share a maximum.
        """
        k, width = np.abs(self.stiffness[modes]), self._half_widths(modes)
        start = np.sqrt(np.maximum(k - 2.0 * width**2, 0.0))
        omega, settled = self._climb(start, width, 3.0 * width)
        lost = np.flatnonzero(~settled)
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
            with np.errstate(divide="ignore", invalid="ignore"):  # on an undamped pole
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
        with np.errstate(divide="ignore", invalid="ignore"):  # on an undamped pole
            first = (rate - value * below_rate) / below
            second = 2.0 * (value - first * below_rate) / below
        return value.sum(axis=1) + self.residual[0, 0], first.sum(axis=1), second.sum(axis=1)

    def _slope(self, omega: FloatArray) -> FloatArray:
        """Return d(abs(H)^2)/dw / 2 of the only FRF, at angular frequencies, (n_freq,)."""
        value, derivative, _ = self._single(omega)
        return np.asarray((value.conj() * derivative).real)


def find_maxima(
    grid: FloatArray, size: FloatArray, slope: Callable[[IntArray, FloatArray], FloatArray]
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Find the maxima of curves that are nearly the highest, from their sizes on a grid, (n, k).

    `slope` returns the slopes of curves, by their indices, at places. The result is, for each
    maximum, the index of its curve, its place, and whether the curve turns there.
    """
    rises = np.diff(size, axis=1, prepend=-1.0) > 0.0
    falls = np.diff(size, axis=1, append=-1.0) <= 0.0
    row, top = np.nonzero(rises & falls & (size >= RIVAL * size.max(axis=1)[:, np.newaxis]))
    low = grid[row, np.maximum(top - 1, 0)]
    high = grid[row, np.minimum(top + 1, grid.shape[1] - 1)]
    low = np.maximum(low, _BESIDE * high)  # at 0 Hz itself the slope is zero
    rise, fall = slope(row, low), slope(row, high)
    inside, at, before = (rise > 0.0) & (fall < 0.0), low, np.zeros(len(row))
    for _ in range(_STEPS):  # of the Illinois method
        share = rise / np.where(inside, rise - fall, 1.0)
        last, at = at, low + np.clip(share, 0.0, 1.0) * (high - low)
        if (np.abs(at - last) <= 1e-14 * at).all():
            break
        here = slope(row, at)
        rising = here > 0.0
        twice = before * np.where(rising, 1.0, -1.0) > 0.0
        rise, fall = (
            np.where(rising, here, np.where(twice, rise / 2.0, rise)),
            np.where(rising, np.where(twice, fall / 2.0, fall), here),
        )
        low, high = np.where(rising, at, low), np.where(rising, high, at)
        before = np.where(rising, 1.0, -1.0)
    return row, np.where(inside, at, grid[row, top]), inside


@dataclass(frozen=True, slots=True, eq=False)
class FarPoles:
    """Poles above a band, fixed beforehand, whose sum represents that of all modes there.

    That smooth sum is a flexibility plus terms (a_j + i w b_j) / (k_j - w^2 + i w c_j), where 1 /
    k_j are Chebyshev nodes from 0 to 1 / k of the lowest mode; each divides the error by ten.
    """

    stiffness: ComplexArray  # (n_far,): k, (rad/s)^2
    decay: FloatArray  # (n_far,): c, rad/s
    # (n_lines,), Hz, at which a sum is fitted; none if its weights are known
    frequencies: FloatArray = field(default_factory=lambda: np.zeros(0))

    def basis(self, omega: FloatArray) -> ComplexArray:
        """Return what the weights are multiplied with at rad/s, (..., 1 + 2 n_far)."""
        w = omega[..., np.newaxis]
        terms = 1.0 / (self.stiffness - w**2 + 1j * w * self.decay)
        return np.concatenate([np.ones_like(w), terms, 1j * w * terms], axis=-1)

    def sums(self, omega: FloatArray, weights: NDArray[Any]) -> ComplexArray:
        """Return `basis` times weights, (..., 1 + 2 n_far, k), at rad/s, (..., n): (..., n, k)."""
        w = omega[..., np.newaxis]
        terms = 1.0 / (self.stiffness - w**2 + 1j * w * self.decay)
        static, constants, rates = np.split(weights, [1, 1 + len(self.decay)], axis=-2)
        return np.asarray(static + terms @ constants + 1j * w * (terms @ rates))

    def with_slopes(
        self, omega: FloatArray, weights: NDArray[Any]
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return the sums with weights, (n, 1 + 2 n_far), at rad/s, (n,), and their slopes."""
        w, n = omega[..., np.newaxis], 1 + len(self.decay)
        terms, rates = 1.0 / (self.stiffness - w**2 + 1j * w * self.decay), 1j * weights[:, n:]
        parts = terms * (weights[:, 1:n] + w * rates)
        slopes = terms * (rates + parts * (2.0 * w - 1j * self.decay))
        return weights[:, 0] + parts.sum(axis=1), np.asarray(slopes.sum(axis=1))

    def fit(self, sums: ComplexArray, *, real: bool, rates: bool = False) -> ComplexArray:
        """Return the weights of sums, (1 + 2 n_far, k): static flexibility, every a, every b."""
        scale = np.concatenate([[1.0], self.stiffness, np.sqrt(self.stiffness)])
        used = slice(None if rates else 1 + len(self.decay))
        rows = (self.basis(2.0 * math.pi * self.frequencies) * scale)[:, used]
        weights = np.zeros((len(scale), sums.shape[1]), dtype=complex)
        parts: list[NDArray[Any]] = [rows, sums]
        left, right = map(real_equations, parts) if real else parts
        weights[used] = scale[used, np.newaxis] * np.linalg.lstsq(left, right, rcond=None)[0]
        return weights


def far_poles(
    stiffness: ComplexArray, decay: FloatArray, band: tuple[float, float], n_far: int = N_FAR
) -> FarPoles:
    """Choose poles for the modes (k and c) above a band (Hz), of one or more configurations."""
    n_lines = 3 * n_far + 4
    nodes = (1.0 - np.cos(np.pi * (np.arange(n_lines) + 0.5) / n_lines)) / 2.0
    frequencies = band[0] + (band[1] - band[0]) * nodes
    if not len(stiffness):
        return FarPoles(np.zeros(0, dtype=complex), np.zeros(0), frequencies)
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
    return FarPoles(np.asarray(k + 1j * damping[:, 1]), damping[:, 0].copy(), frequencies)


def peak_search_band(band: tuple[float, float], *, free: bool) -> tuple[float, float]:
    """Return the part of a band (Hz) in which responses are compared; `free` is for a mechanism."""
    return (max(band[0], _FREE_FROM * band[1]), band[1]) if free else band


def in_reach(
    stiffness: FloatArray | ComplexArray, band: tuple[float, float], decay: FloatArray | None = None
) -> BoolArray:
    """Return which modes, (n_modes,), by their slower roots, are in or close above a band (Hz)."""
    size = np.sqrt(np.abs(stiffness))
    if decay is not None:
        slow = decay > 2.0 * size
        fast = decay[slow] / 2.0 + np.sqrt(decay[slow] ** 2 / 4.0 - size[slow] ** 2)
        size[slow] = size[slow] ** 2 / fast
    return np.asarray(size < reach(band))


def reach(band: tuple[float, float]) -> float:
    """Return up to which magnitude poles are tabulated one by one for a band (Hz), rad/s."""
    return 2.0 * math.pi * _REACH * band[1]


def pole_residue(damped: DampedModes, outputs: NDArray[Any], inputs: FloatArray) -> PoleResidue:
    """Turn damped modes into FRFs; outputs are (n_out, n_modes), or three by powers of s."""
    if outputs.ndim == 2:
        outputs = np.array([outputs, 0.0 * outputs, 0.0 * outputs])
    if damped.shapes is None:
        pairs = [(outputs.astype(complex), inputs.astype(complex))]
    else:
        pairs = [(outputs @ shapes, inputs @ shapes) for shapes in damped.shapes]
    if damped.poles is None:
        # (a + s b + s^2 d) / D with s^2 = D - k - s c, where D is the term's denominator.
        k, c, [((a, b, d), into)] = damped.stiffness, damped.decay, pairs
        constants, rates = ((x[:, np.newaxis] * into) for x in (a - k * d, b - c * d))
    else:
        # R / (s - p) + S / (s - q) = ((R + S) s - (R q + S p)) / (s^2 - (p + q) s + p q)
        first, second = (
            (a + s * b + s**2 * d)[:, np.newaxis] * into
            for ((a, b, d), into), s in zip(pairs, damped.poles, strict=True)
        )
        p, q = damped.poles
        constants = -(first * q + second * p).real.astype(complex)
        rates = (first + second).real.astype(complex)
    # A mechanism mode that does not move the places has no term, but rounding would leave one.
    size = np.abs(constants).max(axis=(0, 1), initial=0.0)
    kept = (np.abs(damped.stiffness) > MECHANISM**2) | (size > _NOTHING * size.max(initial=0.0))
    above, rates = constants[:, :, kept], rates[:, :, kept]
    parts = sum_of_modes(damped.stiffness[kept], damped.decay[kept], above, rates)
    return replace(parts, residual=outputs[2] @ inputs.T + 0j)


def oscillators(omega: ArrayLike, damping_ratios: ArrayLike, residues: ArrayLike) -> PoleResidue:
    """Return one FRF: the sum of viscously damped oscillators (rad/s, 1 and 1/kg)."""
    w = np.asarray(omega, dtype=float)
    above = np.asarray(residues, dtype=complex)[np.newaxis, np.newaxis]
    decay = 2.0 * np.asarray(damping_ratios, dtype=float) * w
    return sum_of_modes(w**2 + 0j, decay, above, np.zeros_like(above))


def sum_of_modes(
    stiffness: ComplexArray, decay: FloatArray, residues: ComplexArray, rates: ComplexArray
) -> PoleResidue:
    """Return FRFs of which every mode is known, so that they have no residual."""
    residual = np.zeros(residues.shape[:2], dtype=complex)
    return PoleResidue(stiffness, decay, residues, rates, residual)
