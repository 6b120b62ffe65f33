# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies, damping and mode shapes identified from frequency response functions.

Poles come from the polyreference least-squares complex frequency-domain method: Guillaume et al.
2003, "A poly-reference implementation of the least-squares complex frequency-domain estimator";
Peeters et al. 2004, "The PolyMAX frequency-domain method". A right matrix fraction with real
coefficients, H(z) = B(z) A(z)^-1, is fitted in least squares; the roots of A are the poles.
Residues then follow from a linear fit (LSFD) with residual terms for the modes below and above
the band. Modes are the stable poles that recur in models of many orders, with similar shapes, and
whose residue is visible in an FRF.

Differences from the textbook, so that one fit finds modes at 3 Hz and at 200 Hz:

- z = (c + s) / (c - s), not exp(s dt). It maps the whole frequency axis once around the unit
  circle, so a modal model is exactly a fraction in z, whatever the spacing of the lines.
- Polynomials are orthonormal on the lines, by Arnoldi's recurrence (Brubeck, Nakatsukasa,
  Trefethen 2021), as powers of z are ill-conditioned in a narrow band.
- The accelerance -w^2 H is fitted, in which modes have similar weights. A second pass divides each
  line by abs(det A) of the first (Sanathanan and Koerner 1963), without which noise biases damping.
- A is I at z = 0, which puts roots that only fit noise outside the unit circle, where they are
  unstable and are discarded (Cauberghe et al. 2005).
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray, real_equations

_STEADY = 0.2  # A pole moves by less than this share of its decay rate from order to order.
_ALIKE = 0.9  # least MAC of the shapes of a pole at two orders
_FAINT = 1e-4  # least share of a mode in any FRF at its resonance; below it, pole and zero cancel
_ABOVE_NOISE = 3.0  # least ratio of this share to the noise; more where few lines show a peak
_SURE = 0.5  # A larger share is a mode, however large the noise is.
_RECURS = 0.5  # least share of the orders at which a mode recurs
# number of poles of the largest model: twice the modes in and near the band, and as many for noise
_MAX_ORDER = 60
_LINES_A_POLE = 3  # least number of lines in the band for each pole of a model
_LEAST_DEGREE = 10  # There must be enough lines for polynomials of this degree.
_NODE = 1e-9  # A drive point is a node if its residue is below this share of the mode's largest.
COARSEST = 5.0  # largest spacing of the lines at a peak, in half-power bandwidths
_SHORT = 0.01  # Lines may end before the ends of a band by this share of it.
_UNEXPLAINED = 0.6  # largest share of the FRFs that modes may leave unexplained near some lines
_RUN = 5  # number of lines over which this share is averaged


class IdentificationError(LinkageVibrationError):
    """The FRFs do not show the modes that were asked for."""


@dataclass(frozen=True, slots=True, eq=False)
class IdentifiedModes:
    """Modes in a band, ascending: sums of R / (i w - p) and conj(R) / (i w - conj(p))."""

    poles: ComplexArray  # (n_modes,): p = -zeta w0 + i w0 sqrt(1 - zeta^2), rad/s
    shapes: FloatArray  # (n_out, n_modes): real, mass-normalised, positive at the drive point

    @property
    def omega(self) -> FloatArray:
        """Natural frequencies, (n_modes,), rad/s."""
        return np.abs(self.poles)

    @property
    def damping_ratios(self) -> FloatArray:
        """Damping ratios, (n_modes,), 1."""
        return np.asarray(-self.poles.real / np.abs(self.poles))


def identify(
    frequencies: FloatArray,
    frf: ComplexArray,
    band: tuple[float, float],
    confirm: Callable[[ComplexArray], BoolArray] | None = None,
) -> IdentifiedModes:
    """Identify the modes in a band (Hz) from receptances, (n_freq, n_out, n_in), m/N.

    The first output and input are the drive point d: phi_o = 2 i w_d R_o / sqrt(2 i w_d R_d), w_d =
    imag p, turned to be as real as possible. `confirm` says which poles, (n,), rad/s, are modes.
    """
    frequencies, frf = _in_band(frequencies, frf, band)
    omega = 2.0 * math.pi * frequencies
    poles, recurring = fit_poles(omega, frf)
    residues, fitted = _residues(omega, frf, poles, omega**2)
    natural = np.abs(poles) / (2.0 * math.pi)
    inside = (natural >= band[0]) & (natural <= band[1])
    rest = _line_sizes(omega, frf, frf - fitted)
    noise = float(np.median(rest / _line_sizes(omega, frf)))
    # Noise matters most if a peak is narrower than the spacing, or only its flank is in the band.
    ends = np.minimum(np.abs(natural - frequencies[0]), np.abs(frequencies[-1] - natural))
    flank = 1.0 - poles.real / math.pi / np.maximum(ends, np.finfo(float).tiny)
    doubt = np.maximum(coarseness(frequencies, poles), 1.0) * flank
    faint = np.clip(_ABOVE_NOISE * noise * doubt**2, _FAINT, _SURE)
    shares = _prominence(omega, frf, poles, residues)
    modes = recurring & inside & (shares > faint)
    if confirm is not None:
        modes[modes] = confirm(poles[modes])
    if not modes.any():
        hint = "widen the band, refine the lines, lower the noise, or add damping if there is none"
        problem = f"No mode is visible between {band[0]:g} and {band[1]:g} Hz"
        raise IdentificationError(f"{problem}; {hint}.")
    _check_resolution(frequencies, poles[modes])
    _check_complete(omega, frf, poles[modes | ~inside])
    poles, residues = poles[modes], residues[modes]
    return IdentifiedModes(poles, _shapes(poles, residues))


def fit_poles(omega: FloatArray, frf: ComplexArray) -> tuple[ComplexArray, BoolArray]:
    """Fit stable poles, (n,), rad/s, ascending, and return which recur; others fit noise."""
    order = min(_MAX_ORDER, len(omega) // _LINES_A_POLE)
    models = list(_models(omega, frf, max(2, order // frf.shape[2])))
    # The lowest of those with the most poles that most models of the upper half of orders have.
    models = models[len(models) // 2 :]
    shares = [np.mean([_recurs(model, other) for other in models], axis=0) for model in models]
    flags = [share >= _RECURS for share in shares]
    best = int(np.argmax([flag.sum() for flag in flags]))
    ascending = np.argsort(np.abs(models[best].poles))
    return models[best].poles[ascending], flags[best][ascending]


def _in_band(
    frequencies: FloatArray, frf: ComplexArray, band: tuple[float, float]
) -> tuple[FloatArray, ComplexArray]:
    """Return the usable lines of a band."""
    kept = (frequencies >= band[0]) & (frequencies <= band[1]) & (frequencies > 0.0)
    least = _LINES_A_POLE * _LEAST_DEGREE * frf.shape[2]
    if kept.sum() < least:
        problem = f"Only {kept.sum()} lines lie between {band[0]:g} and {band[1]:g} Hz"
        raise IdentificationError(f"{problem}; give at least {least}.")
    frequencies, frf = frequencies[kept], frf[kept]
    slack = _SHORT * (band[1] - band[0])
    if frequencies[0] > band[0] + slack or frequencies[-1] < band[1] - slack:
        lines = f"The lines cover {frequencies[0]:g} to {frequencies[-1]:g} Hz, not the whole band"
        hint = f"of {band[0]:g} to {band[1]:g} Hz; measure over all of it, or narrow the band"
        raise IdentificationError(f"{lines} {hint}.")
    return frequencies, frf


def _check_complete(omega: FloatArray, frf: ComplexArray, poles: ComplexArray) -> None:
    """Refuse modes that leave more of the FRFs unexplained near any frequency than noise would."""
    size = _line_sizes(omega, frf)
    fitted = _residues(omega, frf, poles, 1.0 / size)[1]
    power = (_line_sizes(omega, frf, frf - fitted) / size) ** 2
    left = np.sqrt(np.convolve(power, np.full(_RUN, 1.0 / _RUN), mode="valid"))
    worst = int(left.argmax())
    if left[worst] > _UNEXPLAINED:
        where = omega[worst + _RUN // 2] / (2.0 * math.pi)
        rest = f"{100.0 * left[worst]:.0f} % of the FRFs unexplained near {where:.4g} Hz"
        hint = "so that a mode may be missing there; lower the noise, or refine the lines"
        raise IdentificationError(f"The modes of the band leave {rest}, {hint}.")


def _line_sizes(
    omega: FloatArray, frf: ComplexArray, part: ComplexArray | None = None
) -> FloatArray:
    """Return the norm of FRFs, or of a part, at each line, with normalised outputs, (n_freq,)."""
    outputs = np.linalg.norm(omega[:, np.newaxis, np.newaxis] ** 2 * frf, axis=(0, 2))
    weights = 1.0 / np.where(outputs > 0.0, outputs, np.inf)[:, np.newaxis]
    sizes = np.linalg.norm(weights * (frf if part is None else part), axis=(1, 2))
    return np.asarray(np.maximum(sizes, np.finfo(float).tiny))


def coarseness(frequencies: FloatArray, poles: ComplexArray) -> FloatArray:
    """Return the spacing of the lines at each peak in half-power bandwidths, (n,)."""
    after = np.searchsorted(frequencies, np.abs(poles) / (2.0 * math.pi))
    spacing = np.diff(frequencies)[after.clip(1, len(frequencies) - 1) - 1]
    return np.asarray(spacing / (-poles.real / math.pi))


def _check_resolution(frequencies: FloatArray, poles: ComplexArray) -> None:
    """Refuse modes whose peak may be missed between two lines."""
    for pole, coarse in zip(poles, coarseness(frequencies, poles), strict=True):
        if coarse > COARSEST:
            width = -pole.real / math.pi
            peak = f"The peak at {abs(pole) / (2.0 * math.pi):.4g} Hz is {width:.2g} Hz wide"
            lines = f"the lines there are {coarse * width:.2g} Hz apart"
            raise IdentificationError(f"{peak}, but {lines}; use {width:.2g} Hz or less.")


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """Poles of one order in the upper half plane that are stable, and their shapes."""

    poles: ComplexArray  # (n,), rad/s
    shapes: ComplexArray  # (n_out, n), of unit length


def _models(omega: FloatArray, frf: ComplexArray, degree: int) -> Iterator[_Model]:
    """Fit matrix fractions of many degrees; each degree has as many poles as there are inputs."""
    scale = math.sqrt(omega[-1] * max(omega[0], omega[-1] / 4.0))
    z = (scale + 1j * omega) / (scale - 1j * omega)
    accelerance = omega[:, np.newaxis, np.newaxis] ** 2 * frf
    size = np.sqrt((np.abs(accelerance) ** 2).mean(axis=(0, 2), keepdims=True))
    accelerance /= np.where(size > 0.0, size, 1.0)  # outputs of any unit have the same weight
    first = _Fraction(z, accelerance, np.ones(len(z)), degree)
    weights = 1.0 / np.abs(np.linalg.det(first.denominator(degree)))
    second = _Fraction(z, accelerance, weights, degree)
    step = 2 if frf.shape[2] == 1 else 1  # poles come in pairs
    for k in range(step, degree + 1, step):
        roots, shapes = second.roots(k)
        kept = (np.abs(roots) < 1.0) & (roots.imag > 0.0)
        roots = roots[kept]
        yield _Model(scale * (roots - 1.0) / (roots + 1.0), shapes[:, kept])


class _Fraction:
    """Least-squares fits of H(z) = B(z) A(z)^-1 of every degree up to one."""

    def __init__(
        self, z: ComplexArray, frf: ComplexArray, weights: FloatArray, degree: int
    ) -> None:
        """Compute the orthonormal basis, and what remains of the FRFs after B is eliminated."""
        n_freq, n_out, self._n_in = frf.shape
        self._basis = np.empty((n_freq, degree + 1), dtype=complex)
        self._basis[:, 0] = weights / np.linalg.norm(weights)
        self._weights = weights
        self._recurrence = np.zeros((degree + 1, degree))
        for k in range(degree):
            column, before = z * self._basis[:, k], self._basis[:, : k + 1]
            for _ in range(2):  # the second pass removes rounding
                share = (before.conj().T @ column).real
                column -= before @ share
                self._recurrence[: k + 1, k] += share
            self._recurrence[k + 1, k] = np.linalg.norm(column)
            self._basis[:, k + 1] = column / self._recurrence[k + 1, k]
        basis = real_equations(self._basis)
        self._numerators = np.empty((n_out, degree + 1, (degree + 1) * self._n_in))
        rests = []
        for output in range(n_out):
            product = self._basis[:, :, np.newaxis] * frf[:, output, np.newaxis, :]
            equations = real_equations(product.reshape(n_freq, -1))
            self._numerators[output] = basis.T @ equations
            rests.append(np.linalg.qr(equations - basis @ self._numerators[output], mode="r"))
        self._rest = np.asarray(np.linalg.qr(np.vstack(rests), mode="r"))

    def coefficients(self, degree: int) -> FloatArray:
        """Return A on the basis, ((degree + 1) n_in, n_in), scaled to A(z = 0) = I."""
        n = degree + 1
        at_zero = np.ones(n) / np.linalg.norm(self._weights)
        for k in range(degree):
            at_zero[k + 1] = -self._recurrence[: k + 1, k] @ at_zero[: k + 1]
            at_zero[k + 1] /= self._recurrence[k + 1, k]
        size = n * self._n_in
        rest = np.vstack([*self._numerators[:, n:, :size], self._rest[:, :size]])
        eye = np.eye(self._n_in)
        given = np.kron((at_zero / (at_zero @ at_zero))[:, np.newaxis], eye)
        free = np.kron(scipy.linalg.null_space(at_zero[np.newaxis]), eye)
        return np.asarray(given + free @ np.linalg.lstsq(rest @ free, -rest @ given, rcond=None)[0])

    def denominator(self, degree: int) -> ComplexArray:
        """Return A on the lines, (n_freq, n_in, n_in)."""
        coefficients = self.coefficients(degree).reshape(degree + 1, -1)
        values = self._basis[:, : degree + 1] @ coefficients / self._weights[:, np.newaxis]
        return np.asarray(values.reshape(-1, self._n_in, self._n_in))

    def roots(self, degree: int) -> tuple[ComplexArray, ComplexArray]:
        """Return the roots of det A, and shapes B v of unit length where A v = 0."""
        n_in, size = self._n_in, degree * self._n_in
        coefficients = self.coefficients(degree)
        lower = coefficients[:size].reshape(degree, n_in, n_in).swapaxes(0, 1).reshape(n_in, -1)
        # Columns may be dependent.
        last = -np.linalg.lstsq(coefficients[size:], lower, rcond=None)[0]
        companion = np.kron(self._recurrence[:degree, :degree].T, np.eye(n_in))
        companion[-n_in:] += self._recurrence[degree, degree - 1] * last
        roots, vectors = np.linalg.eig(companion)
        # The eigenvectors hold every basis polynomial but the last at a root, times v.
        values = np.vstack([vectors, last @ vectors]).reshape(degree + 1, n_in, -1)
        size += n_in
        numerators = self._numerators[:, : degree + 1, :size] @ coefficients
        shapes = numerators.reshape(-1, size) @ values.reshape(size, -1)
        return roots, shapes / np.maximum(np.linalg.norm(shapes, axis=0), np.finfo(float).tiny)


def _recurs(model: _Model, other: _Model) -> BoolArray:
    """Return which poles of a model another one has as well, one for one, (n,)."""
    if not (len(model.poles) and len(other.poles)):
        return np.zeros(len(model.poles), dtype=bool)
    moved = np.abs(model.poles[:, np.newaxis] - other.poles)
    alike = np.abs(model.shapes.conj().T @ other.shapes) ** 2
    close = (moved <= -_STEADY * model.poles.real[:, np.newaxis]) & (alike >= _ALIKE)
    moved[~close] = np.inf
    nearest = moved.argmin(axis=1)
    each = np.arange(len(nearest))
    return np.asarray(close[each, nearest] & (moved.argmin(axis=0)[nearest] == each))


def _residues(
    omega: FloatArray, frf: ComplexArray, poles: ComplexArray, weights: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Fit residues, (n, n_out, n_in), beside L / s^2 and U + V s^2; return the fit, too."""
    scale = omega[-1]
    s = 1j * omega[:, np.newaxis] / scale
    upper, lower = 1.0 / (s - poles / scale), 1.0 / (s - poles.conj() / scale)
    terms = np.hstack([upper + lower, 1j * (upper - lower), s**-2.0, s**0.0, s**2.0])
    weights = (weights / weights.max())[:, np.newaxis]
    right = weights * frf.reshape(len(omega), -1)
    columns = real_equations(weights * terms)
    norms = np.linalg.norm(columns, axis=0)
    unknowns = np.linalg.lstsq(columns / norms, real_equations(right), rcond=None)[0]
    unknowns /= norms[:, np.newaxis]
    n = len(poles)
    complete = unknowns[:n] + 1j * unknowns[n : 2 * n]
    fitted = (terms @ unknowns).reshape(frf.shape)
    return np.asarray(complete.reshape(n, *frf.shape[1:]) * scale), fitted


def _prominence(
    omega: FloatArray, frf: ComplexArray, poles: ComplexArray, residues: ComplexArray
) -> FloatArray:
    """Return the largest share of each term in an FRF at the line nearest to its pole, (n,)."""
    nearest = np.abs(omega - np.abs(poles)[:, np.newaxis]).argmin(axis=1)
    terms = np.abs(residues / (1j * omega[nearest] - poles)[:, np.newaxis, np.newaxis])
    values = np.abs(frf[nearest])
    return np.asarray((terms / np.where(values > 0.0, values, np.inf)).max(axis=(1, 2)))


def _shapes(poles: ComplexArray, residues: ComplexArray) -> FloatArray:
    """Return real mass-normalised shapes, (n_out, n)."""
    products = 2j * poles.imag[:, np.newaxis, np.newaxis] * residues
    left, values, right = np.linalg.svd(products, full_matrices=False)
    if (np.abs(products[:, 0, 0]) < _NODE * values[:, 0]).any():
        problem = "A mode does not move the drive point, so its shape has no scale"
        raise IdentificationError(f"{problem}; choose another point.")
    columns = left[:, :, 0] * (values[:, 0] * right[:, 0, 0])[:, np.newaxis]
    shapes = columns / np.sqrt(columns[:, [0]])
    turn = np.angle((shapes**2).sum(axis=1)) / 2.0
    shapes = (shapes * np.exp(-1j * turn)[:, np.newaxis]).real.T
    return np.asarray(shapes * np.where(shapes[0] < 0.0, -1.0, 1.0))
