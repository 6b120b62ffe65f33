# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A function of s fitted to the measured receptances of a free link, and its covariance.

Under forces in equilibrium a link only deforms. There the fit has the modes that the lines show,
and further terms for the modes above them. Without a damping of these terms, noise, which hides
distant modes, would leave the link undamped, and the assembly with too little damping.

There are three laws of damping: viscous, proportional to the stiffness of the distant modes;
structural likewise; and viscous of any kind, in which each FRF has its own odd powers of s. The
Bayesian information criterion (Schwarz 1978) chooses the law, the number of terms, and a set of
modes, from which it then removes single ones that only fit noise. It departs from the first law
only if the lines clearly show another.

Where a link moves as a rigid body the fit has 1 / s^2 in addition, modes that only show there, as
the bending of a link between two pins, and real poles near the first line, as of links whose
damping is proportional to their mass, or that are hung up softly. Where these real poles lie is a
choice, so a second fit has them between those of the first: what depends on the choice is noise. So
is the number of terms: the criterion leaves out a term whose effect is several times its deviation,
and a third fit has more terms, of any damping or one of the same law.

Noise is propagated to first order, through the coefficients and through the poles.
"""

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
import scipy

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, real_equations, symmetric
from linkage_vibration.mechanics.identification import coarseness, fit_poles

_ORDERS = 4  # largest number of terms for the modes above the lines
_LOWEST = 0.02  # least pole of the deformation, over the last line; below it the link is rigid
_NARROWEST = 0.5  # Narrower poles among the lines, in their spacings, are tried last.
_RELAXATIONS = 2.0 ** np.arange(-1, 6)  # real poles of the rigid motions, over the first line
_SHIFT = math.sqrt(2.0)  # factor of the real poles in the second fit, between those of the first
_CLEARLY = 20.0  # least advantage of a law other than the first, in the information criterion
_STEPS = 4  # number of Gauss-Newton steps that improve the poles
_NEGLIGIBLE = 1e-6  # The steps end if the sum of squares falls by less than this share.
_STEP = 1e-6  # relative step of a parameter, for derivatives
_RESOLVED = 1e-8  # Smaller singular values of changes with parameters are errors of differences.
_ROUNDING = 1e-9  # Computed FRFs leave no more than this share of what is fitted.
_COMPUTED = 1e-4  # Measured FRFs leave more than this share of what is fitted.
_SMALLEST = 1e-13  # Smaller singular values of the scaled terms are rounding.


class Choice(enum.Enum):
    """What a fit takes that the lines do not determine."""

    BEST = enum.auto()
    SHIFTED = enum.auto()  # other real poles of the rigid block
    WIDER = enum.auto()  # more terms for what lies above the lines


class _Law(enum.Enum):
    """How a link is damped."""

    VISCOUS = enum.auto()
    STRUCTURAL = enum.auto()
    ANY = enum.auto()


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    """Which terms a fit has; s and the parameters are per last line."""

    law: _Law
    order: int  # number of terms for the modes above the lines
    parameters: FloatArray  # stiffness and damping of each mode; damping of the modes above
    # Whether the modes above have viscous damping of any kind, whatever the law.
    free: bool = field(default=False, kw_only=True)

    def terms(self, s: ComplexArray, parameters: FloatArray | None = None) -> ComplexArray:
        """Return the values of the terms at s, (n_s, 1)."""
        given = self.parameters if parameters is None else parameters
        n = len(given) // 2
        stiffness, decay = given[:n], given[n : 2 * n]
        rate = np.full_like(s, 1j) if self.law is _Law.STRUCTURAL else s
        modes = 1.0 / (s**2 + decay * rate + stiffness)
        if self.free or self.law is _Law.ANY:
            return np.hstack([s ** np.arange(max(2, 2 * self.order - 1)), modes, s * modes])
        powers = np.arange(self.order)
        above = s ** (2 * powers) / (1.0 + given[-1] * rate) ** (powers + 1)
        return np.hstack([above, modes])

    def with_one_more(self) -> "_Shape":
        """Return these terms and one more for the modes above the lines."""
        return replace(self, order=self.order + 1)

    def of_any_law(self) -> "_Shape":
        """Return terms of the same modes with viscous damping of any kind, more if it is that."""
        if self.law is _Law.ANY:
            return self.with_one_more().with_one_more()
        poles = self.poles()
        return _Shape(_Law.ANY, self.order, np.concatenate([np.abs(poles) ** 2, -2.0 * poles.real]))

    def poles(self) -> ComplexArray:
        """Return those of modes in the upper half plane, (n_modes,)."""
        n = len(self.parameters) // 2
        stiffness, decay = self.parameters[:n], self.parameters[n : 2 * n]
        if self.law is _Law.STRUCTURAL:
            return np.asarray(1j * np.sqrt(stiffness + 1j * decay))
        return np.asarray(-decay / 2.0 + np.sqrt(decay**2 / 4.0 - stiffness + 0j))

    def derivatives(self, s: ComplexArray) -> list[ComplexArray]:
        """Return the derivatives of the terms with respect to each parameter."""
        given, steps = self.parameters, _STEP * np.maximum(np.abs(self.parameters), 1e-3)
        return [
            (self.terms(s, given + step) - self.terms(s, given - step)) / (2.0 * step.max())
            for step in np.diag(steps)
        ]


@dataclass(frozen=True, slots=True, eq=False)
class _RigidShape(_Shape):
    """Which terms the rigid block has: those of rigid motions, the elastic ones, and modes.

    These modes do not deform the link where forces are in equilibrium, as the bending of a link
    between two pins. Its parameters are their stiffness and damping.
    """

    elastic: _Shape
    rates: FloatArray  # real poles

    def terms(self, s: ComplexArray, parameters: FloatArray | None = None) -> ComplexArray:
        """Return the values of the terms at s, (n_s, 1)."""
        given = self.parameters if parameters is None else parameters
        stiffness, decay = given.reshape(2, -1)
        modes = 1.0 / (s**2 + decay * s + stiffness)
        rigid = s**-2.0, s**-2.0 * self.rates / (s + self.rates)
        return np.hstack([*rigid, self.elastic.terms(s), modes, s * modes])


_Terms = TypeVar("_Terms", bound=_Shape)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A weighted least-squares fit of terms, in an orthonormal basis of their values."""

    tail: FloatArray  # (n_terms, k): from values of the terms to those of the basis
    basis: FloatArray  # (2 n_freq, k): real above imaginary parts of weighted values
    weights: FloatArray  # (n_freq, 1)
    coefficients: FloatArray  # (k, n, n)

    @property
    def leverage(self) -> FloatArray:
        """From 0 to 1, (n_freq,)."""
        return np.asarray((self.basis**2).sum(axis=1).reshape(2, -1).mean(axis=0))

    def at_lines(self) -> ComplexArray:
        """Return the fit at the lines, (n_freq, n, n)."""
        parts = np.tensordot(self.basis, self.coefficients, axes=1)
        n_freq = len(self.weights)
        return np.asarray((parts[:n_freq] + 1j * parts[n_freq:]) / self.weights[:, :, np.newaxis])

    def values(self, terms: ComplexArray) -> ComplexArray:
        """Return the fit where the terms have these values, (n_s, n_terms)."""
        return np.asarray(np.tensordot(terms @ self.tail, self.coefficients, axes=1))

    def changes(self, rates: ComplexArray, rate: ComplexArray, terms: ComplexArray) -> ComplexArray:
        """Return changes of the fit with a parameter, by ``rates`` of terms at lines and there."""
        plain = np.tensordot(self.tail, self.coefficients, axes=1)
        moved = real_equations(self.weights * rates)
        again = np.tensordot(self.basis.T @ moved, plain, axes=1)
        here = np.tensordot(rate, plain, axes=1)
        return np.asarray(here - np.tensordot(terms @ self.tail, again, axes=1))

    def shares(self, terms: ComplexArray) -> ComplexArray:
        """Return the weights of the lines' parts in the values of the fit, (n_s, 2 n_freq)."""
        double = np.concatenate([self.weights, self.weights])[:, 0]
        return np.asarray((terms @ self.tail) @ self.basis.T * double)


@dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    """The fits of the deformation and of the rigid block, each with its terms.

    Pulls, (n_parameters, 2 n_freq, n, n), are changes of parameters per real and imaginary part of
    the lines.
    """

    shape: _Shape
    elastic: _Fit
    pulls: FloatArray
    rigid_shape: _RigidShape
    moving: _Fit
    rigid_pulls: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class LinkFit:
    """Receptances of a free link at any s, and their variances."""

    omega: FloatArray  # (n_freq,), lines, rad/s
    unit: FloatArray  # (n,), unit of each DoF, which normalises receptances
    lines: ComplexArray  # (n_freq, n, n), measured receptances, symmetric, normalised
    rigid: FloatArray  # (n, n), projection on the rigid motions, normalised
    parts: dict[Choice, _Parts]

    @property
    def elastic(self) -> _Fit:
        """The fit of the deformation."""
        return self.parts[Choice.BEST].elastic

    @property
    def poles(self) -> ComplexArray:
        """Those of the link in the fit, (n_modes,), rad/s."""
        best = self.parts[Choice.BEST]
        both = best.shape.poles(), best.rigid_shape.poles()
        return np.asarray(np.concatenate(both) * self.omega[-1])

    def smooth(self) -> ComplexArray:
        """Return the receptances at the lines, (n_freq, n, n), m/N."""
        return self.at(np.asarray(1j * self.omega, dtype=np.complex128))

    def at(self, s: ComplexArray, choice: Choice = Choice.BEST) -> ComplexArray:
        """Return the receptances, (n_s, n, n), m/N, at points s, (n_s,), rad/s."""
        scaled = s[:, np.newaxis] / self.omega[-1]
        parts = self.parts[choice]
        receptances = parts.elastic.values(parts.shape.terms(scaled))
        receptances = receptances + parts.moving.values(parts.rigid_shape.terms(scaled))
        return np.asarray(receptances * np.outer(self.unit, self.unit))

    def variances(
        self, s: complex, forces: ComplexArray, turns: ComplexArray, noise: float
    ) -> FloatArray:
        """Return variances of Re(t f^T H(s) f), (n_turns,), by relative noise; f, (n,), in N.

        They contain the square of what a fit with more terms changes, beyond what noise does to it.
        """
        best, wider = (self._shares(s, forces, each) for each in (Choice.BEST, Choice.WIDER))
        power = np.abs(self.lines) ** 2 / 2.0
        power = noise**2 * np.concatenate([power, power])
        at = np.array([s])
        change = forces @ (self.at(at, Choice.WIDER) - self.at(at))[0] @ forces
        by_noise, of_change = (
            np.array([((turn * shares).real ** 2 * power).sum() for turn in turns])
            for shares in (best, wider - best)
        )
        return np.asarray(by_noise + np.maximum((turns * change).real ** 2 - of_change, 0.0))

    def _shares(self, s: complex, forces: ComplexArray, choice: Choice) -> ComplexArray:
        """Return the change of f^T H(s) f with parts of lines, (2 n_freq, n, n)."""
        at, lines = np.array([[s / self.omega[-1]]]), 1j * self.omega[:, np.newaxis]
        lines = lines / self.omega[-1]
        parts = self.parts[choice]
        shape, rigid_shape = parts.shape, parts.rigid_shape
        elastic, moving = parts.elastic, parts.moving
        terms, both = shape.terms(at), rigid_shape.terms(at)
        whole = self.unit * forces
        whole_rigid = self.rigid @ whole
        rigid = np.outer(whole_rigid, whole_rigid)
        rest = np.outer(whole, whole) - rigid
        column = (-1, 1, 1)
        shares = moving.shares(both).reshape(column) * rigid
        shares = shares + elastic.shares(terms).reshape(column) * rest
        beside, places = rigid_shape.elastic, (lines, at)
        before = 1 + len(rigid_shape.rates)
        wide = (0, 0), (before, both.shape[1] - before - beside.terms(at).shape[1])
        rates = zip(*(each.derivatives(x) for each in (shape, beside) for x in places), strict=True)
        # FRFs without noise have no pulls.
        for (first, second, along, there), pull in zip(rates, parts.pulls, strict=False):
            change = elastic.changes(first, second, terms)[0]
            change = change + moving.changes(np.pad(along, wide), np.pad(there, wide), both)[0]
            shares = shares + (whole @ change @ whole) * pull
        rates = zip(rigid_shape.derivatives(lines), rigid_shape.derivatives(at), strict=True)
        for (along, there), pull in zip(rates, parts.rigid_pulls, strict=False):
            shares = shares + (whole @ moving.changes(along, there, both)[0] @ whole) * pull
        return np.asarray(shares)


def fit_link(
    omega: FloatArray, frf: ComplexArray, unit: FloatArray, motions: FloatArray
) -> LinkFit:
    """Fit the receptances, (n_freq, n, n), m/N, of a free link at omega, (n_freq,), rad/s.

    `unit`, (n,), normalises the DoFs; `motions`, (n, n_motions), are orthonormal rigid motions of
    the normalised DoFs.
    """
    raw = frf / np.outer(unit, unit)
    lines = symmetric(raw)
    weights = 1.0 / np.linalg.norm(lines, axis=(1, 2))[:, np.newaxis]
    rigid, elastic = motions @ motions.T, scipy.linalg.null_space(motions.T)
    across = lines @ elastic  # a difference of large numbers would lose its digits
    s = 1j * omega[:, np.newaxis] / omega[-1]
    shape = wider = _Shape(_Law.ANY, 1, np.empty(0))
    candidates = _candidates(omega, frf)
    right = real_equations(weights * across.reshape(len(omega), -1))
    if elastic.size:
        shape = _choose(s, right, weights, candidates)
        wider = _improved(s, [shape.with_one_more(), shape.of_any_law()], weights, right)
    side = rigid @ across @ elastic.T
    rest = side + side.swapaxes(1, 2) + elastic @ (elastic.T @ across) @ elastic.T
    block = rigid @ lines @ rigid
    block_right = real_equations(weights * block.reshape(len(omega), -1))
    rates = _RELAXATIONS * omega[0] / omega[-1]
    rigid_shape = _choose_modes(
        s, _RigidShape(_Law.ANY, 0, np.empty(0), shape, rates), block_right, weights, candidates
    )
    parts = {}
    for choice in Choice:
        taken = wider if choice is Choice.WIDER else shape
        shift = _SHIFT if choice is Choice.SHIFTED else 1.0
        beside = replace(taken, free=rigid_shape.elastic.free)
        beside = beside.with_one_more() if choice is Choice.WIDER else beside
        rigid_taken = replace(rigid_shape, elastic=beside, rates=shift * rates)
        pulls = _pulls(s, taken, right, weights)
        rigid_pulls = _pulls(s, rigid_taken, block_right, weights)
        parts[choice] = _Parts(
            taken,
            _fitted(taken.terms(s), weights, rest),
            symmetric(pulls.reshape(len(pulls), 2 * len(omega), *across.shape[1:]) @ elastic.T),
            rigid_taken,
            _fitted(rigid_taken.terms(s), weights, block),
            rigid_pulls.reshape(len(rigid_pulls), 2 * len(omega), *block.shape[1:]),
        )
    return LinkFit(omega, unit, lines, rigid, parts)


def _pulls(s: ComplexArray, shape: _Shape, right: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the change of parameters per real and imaginary part, (n_parameters, 2 n_freq, k)."""
    _, left, columns = _columns(s, shape, weights, right)
    if left < (_ROUNDING * np.linalg.norm(right)) ** 2:
        columns = columns[:0]  # FRFs without noise
    pulls = np.linalg.pinv(columns.T, rcond=_RESOLVED).reshape(len(columns), *right.shape)
    return np.asarray(np.concatenate([weights, weights]) * pulls)


def _choose_modes(
    s: ComplexArray,
    shape: _RigidShape,
    right: FloatArray,
    weights: FloatArray,
    candidates: Sequence[ComplexArray],
) -> _RigidShape:
    """Return the terms of the rigid block with the modes that it needs, by the same criterion.

    One among the lines is left out if another damping above them, which noise hides, fits better.
    """
    known, fits = shape.elastic.poles(), []
    for free in (False, True):
        tried, best = replace(shape, elastic=replace(shape.elastic, free=free)), math.inf
        for poles in candidates:
            near = np.abs(poles[:, np.newaxis] - known) <= -poles.real[:, np.newaxis]
            other = poles[~near.any(axis=1)]
            start = np.concatenate([np.abs(other) ** 2, -2.0 * other.real])
            found, left = _refined(s, replace(tried, parameters=start), weights, right)
            if (score := _criterion(found, left, right)) < best:
                best, chosen, first = score, found, start
        fits.append(_without_noise(s, chosen, first, best, weights, right))
    among = [int((np.abs(each.poles()) < 1.0).sum()) for each in fits]
    scores = [_criterion(each, _refined(s, each, weights, right)[1], right) for each in fits]
    return fits[int(among[1] < among[0] and scores[1] < scores[0])]


def _candidates(omega: FloatArray, frf: ComplexArray) -> list[ComplexArray]:
    """Return sets of poles that may be those of the link, per last line."""
    poles, recurring = fit_poles(omega, frf)
    visible = poles.imag > _LOWEST * omega[-1]
    frequencies = omega / (2.0 * math.pi)
    wide = (poles.imag > omega[-1]) | (coarseness(frequencies, poles) < 1.0 / _NARROWEST)
    poles, recurring, wide = (each[visible] for each in (poles / omega[-1], recurring, wide))
    narrow = [] if wide.all() else [poles[recurring], poles]
    return [poles[:0], poles[recurring & wide], poles[wide], *narrow]


def _choose(
    s: ComplexArray, right: FloatArray, weights: FloatArray, candidates: list[ComplexArray]
) -> _Shape:
    """Return the terms by the Bayesian information criterion."""
    best = math.inf
    for poles in candidates:
        for law in _Law:
            stiffness, decay = np.abs(poles) ** 2, -2.0 * poles.real
            if law is _Law.STRUCTURAL:
                decay = decay * np.abs(poles)
            start = np.concatenate([stiffness, decay, np.zeros(int(law is not _Law.ANY))])
            for order in range(1, _ORDERS + 1):
                shape, left = _refined(s, _Shape(law, order, start), weights, right)
                score = _criterion(shape, left, right)
                if score < best:
                    best, chosen, first, least = score, shape, start, left
    if math.sqrt(least) < _COMPUTED * np.linalg.norm(right):
        # The criterion ignores errors below the noise of single lines. In FRFs that were computed,
        # and stored in single precision, one more term costs nothing and removes these errors.
        return _improved(s, [chosen, chosen.with_one_more()], weights, right)
    return _without_noise(s, chosen, first, best, weights, right)


def _without_noise(
    s: ComplexArray,
    chosen: _Terms,
    first: FloatArray,
    best: float,
    weights: FloatArray,
    right: FloatArray,
) -> _Terms:
    """Leave out modes that only fit noise; `first` are the parameters before improvement."""
    for i in reversed(range(len(first) // 2)):
        start = np.delete(first, [i, len(first) // 2 + i])
        shape, left = _refined(s, replace(chosen, parameters=start), weights, right)
        score = _criterion(shape, left, right)
        if score < best:
            best, chosen, first = score, shape, start
    return chosen


def _improved(
    s: ComplexArray, shapes: Sequence[_Shape], weights: FloatArray, right: FloatArray
) -> _Shape:
    """Return which of some terms, with improved parameters, leave least."""
    fits = [_refined(s, shape, weights, right) for shape in shapes]
    return min(fits, key=lambda fit: fit[1])[0]


def _criterion(shape: _Shape, left: float, right: FloatArray) -> float:
    """Return the Bayesian information criterion of a fit that leaves a sum of squares."""
    terms = shape.terms(np.ones((1, 1), dtype=np.complex128)).shape[1]
    count: int = terms * right.shape[1] + len(shape.parameters)
    score = right.size * math.log(max(left, 1e-300)) + count * math.log(right.size)
    return score if shape.law is _Law.VISCOUS else score + _CLEARLY


def _refined(
    s: ComplexArray, shape: _Terms, weights: FloatArray, right: FloatArray
) -> tuple[_Terms, float]:
    """Improve the parameters by Gauss-Newton steps; also return what the fit leaves."""
    refined, best = shape, math.inf
    for _ in range(_STEPS + 1):
        rest, left, columns = _columns(s, shape, weights, right)
        half = len(shape.parameters) // 2
        stiffness, decay = shape.parameters[:half], shape.parameters[half : 2 * half]
        sound = (stiffness > _LOWEST**2).all() and (decay > 0.0).all()
        if not (left < best and sound):
            break
        converged = left > (1.0 - _NEGLIGIBLE) * best
        refined, best = shape, left
        if converged or not len(shape.parameters):
            break
        step = np.linalg.lstsq(columns.T, rest.ravel(), rcond=_SMALLEST)[0]
        shape = replace(shape, parameters=shape.parameters + step)
    return refined, best


def _columns(
    s: ComplexArray, shape: _Shape, weights: FloatArray, right: FloatArray
) -> tuple[FloatArray, float, FloatArray]:
    """Return the rest of a fit, its square, and what coefficients cannot undo of each parameter."""
    basis, triangle = np.linalg.qr(real_equations(weights * shape.terms(s)))
    shares = basis.T @ right
    rest = right - basis @ shares
    coefficients = np.linalg.lstsq(triangle, shares, rcond=_SMALLEST)[0]
    columns = np.empty((len(shape.parameters), right.size))
    for i, rate in enumerate(shape.derivatives(s)):
        column = real_equations(weights * rate) @ coefficients
        columns[i] = (column - basis @ (basis.T @ column)).ravel()
    return rest, float((rest**2).sum()), columns


def _fitted(terms: ComplexArray, weights: FloatArray, lines: ComplexArray) -> _Fit:
    """Fit terms with real coefficients to weighted lines."""
    matrix = real_equations(weights * terms)
    sizes = np.linalg.norm(matrix, axis=0)
    basis, values, right = np.linalg.svd(matrix / sizes, full_matrices=False)
    kept = values > _SMALLEST * values[0]
    basis = basis[:, kept]
    double = np.concatenate([weights, weights])
    coefficients = np.tensordot(basis.T, double[:, :, np.newaxis] * real_equations(lines), axes=1)
    tail = right[kept].T / values[kept] / sizes[:, np.newaxis]
    return _Fit(tail, basis, weights, coefficients)
