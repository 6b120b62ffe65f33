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
and two further fits have more terms, one of them of any damping; the larger change counts.

A mode among the lines has one shape, so that its residue is the outer product of the shape with
itself. The nearest one in the least-squares sense replaces the residue that the lines give, unless
that clearly has more, of two modes at one pole; then it keeps as many shapes as are clear. A link
whose residues have more would keep poles of its own when it is joined.

Noise is propagated to first order, through the coefficients, the shapes and the poles.
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
_ROUNDING = 1e-7  # Computed FRFs leave no more than this share of what is fitted: their digits.
_COMPUTED = 1e-4  # Measured FRFs leave more than this share of what is fitted.
_UNDONE = 1e-8  # Smaller singular values of scaled changes by parameters are rounding.
_DOUBLE = 0.05  # A pole may be that of more modes if a larger share of its residue is left.
_BEYOND = 10.0  # Noise explains no residue whose power at the lines is so many times as large.
_SMALLEST = 1e-13  # Smaller singular values of the scaled terms are rounding.


class Choice(enum.Enum):
    """What a fit takes that the lines do not determine."""

    BEST = enum.auto()
    SHIFTED = enum.auto()  # other real poles of the rigid block
    WIDER = enum.auto()  # more terms for what lies above the lines
    FREER = enum.auto()  # likewise, with viscous damping of any kind


_MORE_TERMS = Choice.WIDER, Choice.FREER


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

    @property
    def pairs(self) -> bool:
        """Whether each mode has a term with s in addition, of a complex residue."""
        return self.free or self.law is _Law.ANY

    def rate(self, s: ComplexArray) -> ComplexArray:
        """Return what the damping of a mode is multiplied by at s, (n_s, 1)."""
        return np.full_like(s, 1j) if self.law is _Law.STRUCTURAL else s

    def modes(self, s: ComplexArray) -> ComplexArray:
        """Return the values of the terms of the modes at s, (n_s, n_modes)."""
        n = len(self.parameters) // 2
        stiffness, decay = self.parameters[:n], self.parameters[n : 2 * n]
        return np.asarray(1.0 / (s**2 + decay * self.rate(s) + stiffness))

    def modal_terms(self, s: ComplexArray) -> ComplexArray:
        """Return the values of all terms of the modes, the last ones of `terms`."""
        modes = self.modes(s)
        return np.hstack([modes, s * modes]) if self.pairs else modes

    def above(self, s: ComplexArray) -> ComplexArray:
        """Return the values of the terms for what lies above the lines, and of others."""
        if self.pairs:
            return np.asarray(s ** np.arange(max(2, 2 * self.order - 1)))
        powers = np.arange(self.order)
        below = 1.0 + self.parameters[-1] * self.rate(s)
        return np.asarray(s ** (2 * powers) / below ** (powers + 1))

    def terms(self, s: ComplexArray) -> ComplexArray:
        """Return the values of the terms at s, (n_s, 1)."""
        return np.hstack([self.above(s), self.modal_terms(s)])

    def with_one_more(self) -> "_Shape":
        """Return these terms and one more for the modes above the lines."""
        return replace(self, order=self.order + 1)

    def of_any_law(self) -> "_Shape":
        """Return more terms of the same modes, with viscous damping of any kind."""
        if self.law is _Law.ANY:
            return self.with_one_more().with_one_more()
        poles = self.poles()
        return _Shape(
            _Law.ANY, self.order + 1, np.concatenate([np.abs(poles) ** 2, -2.0 * poles.real])
        )

    def poles(self) -> ComplexArray:
        """Return those of modes in the upper half plane, (n_modes,)."""
        n = len(self.parameters) // 2
        stiffness, decay = self.parameters[:n], self.parameters[n : 2 * n]
        if self.law is _Law.STRUCTURAL:
            return np.asarray(1j * np.sqrt(stiffness + 1j * decay))
        return np.asarray(-decay / 2.0 + np.sqrt(decay**2 / 4.0 - stiffness + 0j))

    def derivatives(self, s: ComplexArray) -> ComplexArray:
        """Return the derivatives of the terms by each parameter, (n_parameters, n_s, n_terms)."""
        modes, above = self.modes(s), self.above(s)
        n, first = modes.shape[1], above.shape[1]
        changes = np.zeros((len(self.parameters), len(s), self.terms(s).shape[1]), complex)
        for i in range(n):
            for row, factor in ((i, 1.0), (n + i, self.rate(s)[:, 0])):
                changes[row, :, first + i] = -factor * modes[:, i] ** 2
                if self.pairs:
                    changes[row, :, first + n + i] = s[:, 0] * changes[row, :, first + i]
        if len(self.parameters) % 2 and not self.pairs:
            rate = self.rate(s)
            powers = np.arange(1, self.order + 1)
            changes[-1, :, :first] = -powers * rate * above / (1.0 + self.parameters[-1] * rate)
        return changes


@dataclass(frozen=True, slots=True, eq=False)
class _RigidShape(_Shape):
    """Which terms the rigid block has: those of rigid motions, the elastic ones, and modes.

    These modes do not deform the link where forces are in equilibrium, as the bending of a link
    between two pins. Its parameters are their stiffness and damping.
    """

    elastic: _Shape
    rates: FloatArray  # real poles

    def above(self, s: ComplexArray) -> ComplexArray:
        """Return the values of the terms of rigid motions and of the deformation."""
        rigid = s**-2.0, s**-2.0 * self.rates / (s + self.rates)
        return np.hstack([*rigid, self.elastic.terms(s)])


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

    @property
    def of_terms(self) -> FloatArray:
        """The coefficients of the terms, (n_terms, n, n)."""
        return np.asarray(np.tensordot(self.tail, self.coefficients, axes=1))

    def values(self, terms: ComplexArray) -> ComplexArray:
        """Return the fit where the terms have these values, (n_s, n_terms)."""
        return np.asarray(np.tensordot(terms @ self.tail, self.coefficients, axes=1))

    def undone(self, rates: ComplexArray, weights: ComplexArray) -> complex:
        """Return how other coefficients change a weighted sum of them with a parameter.

        `rates` are those of the terms at the lines with the parameter; weights, (n_terms, n, n).
        """
        moved = self.tail @ (self.basis.T @ real_equations(self.weights * rates))
        return -complex((np.tensordot(moved, self.of_terms, axes=1) * weights).sum())

    def shares(self, weights: ComplexArray) -> ComplexArray:
        """Return the parts of lines in a weighted sum of the coefficients, (2 n_freq, n, n)."""
        double = np.concatenate([self.weights, self.weights])
        return np.asarray(np.tensordot(double * (self.basis @ self.tail.T), weights, axes=1))


@dataclass(frozen=True, slots=True, eq=False)
class _Residues:
    """What is left out of the numerators of modes, so that their residues have their few shapes.

    A mode has one shape. By noise, a residue has more, with which the link keeps a pole of its own
    when it is joined: a mode that does not exist, which moves the one beside it.
    """

    shape: _Shape
    excess: FloatArray  # (n_modal_terms, n, n)
    spans: ComplexArray  # (n_modes, n, n), of forces: the projection on those that act on shapes

    def weights(self, s: ComplexArray, forces: ComplexArray) -> ComplexArray:
        """Return how f^T H f at s, (1, 1), depends on the numerators, (n_modal_terms, n, n)."""
        values, n = self.shape.modal_terms(s)[0], len(self.spans)
        weights = np.empty((len(values), len(forces), len(forces)), complex)
        for i, (pole, span) in enumerate(zip(self.shape.poles(), self.spans, strict=True)):
            if not (self.shape.pairs and pole.imag):  # What does not oscillate keeps all shapes.
                weights[i::n] = np.multiply.outer(values[i::n], _along(span.real, forces))
                continue
            near, far = s[0, 0] - pole, s[0, 0] - pole.conjugate()
            one = values[i] * far * _along(span, forces) / (2j * pole.imag)
            other = values[i] * near * _along(span.conj(), forces) / (2j * pole.imag)
            weights[i], weights[n + i] = one - other, pole * one - pole.conjugate() * other
        return weights


def _along(span: ComplexArray, forces: ComplexArray) -> ComplexArray:
    """Return how f^T R f changes with a residue R of few shapes, (n, n), by their span."""
    within = span @ forces
    cross = np.outer(within, forces)
    return np.asarray(cross + cross.T - np.outer(within, within))


def _residues(shape: _Shape, numerators: FloatArray, allowed: FloatArray) -> _Residues:
    """Return what is left out of the numerators, (n_modal_terms, n, n), of modes.

    `allowed`, (n_modes,), is the largest norm that noise explains. A residue has one shape, and
    further ones of a larger norm, as of two modes at one pole, if they are not small beside it.
    """
    poles, size = shape.poles(), numerators.shape[-1]
    excess, spans = np.zeros_like(numerators), np.tile(np.eye(size) + 0j, (len(poles), 1, 1))
    for i, pole in enumerate(poles):
        if not 0.0 < pole.imag < 1.0:  # Above the lines, a term stands for several modes.
            continue
        whole = numerators[i] + (pole * numerators[len(poles) + i] if shape.pairs else 0.0)
        left, values, right = np.linalg.svd(whole)
        beyond = np.sqrt(np.cumsum(values[::-1] ** 2))[::-1]  # the norm from each value on
        n = 1 + int((beyond[1:] > max(_DOUBLE * values[0], allowed[i])).sum())
        rest = symmetric(left[:, n:] * values[n:] @ right[n:])
        spans[i] = left[:, :n].conj() @ left[:, :n].T
        excess[i] = rest.real
        if shape.pairs:
            excess[len(poles) + i] = rest.imag / pole.imag
            excess[i] -= pole.real * excess[len(poles) + i]
    return _Residues(shape, excess, spans)


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
    residues: _Residues  # of the modes of the deformation, in both fits
    rigid_residues: _Residues


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
        for each in (parts.residues, parts.rigid_residues):
            receptances -= np.tensordot(each.shape.modal_terms(scaled), each.excess, axes=1)
        return np.asarray(receptances * np.outer(self.unit, self.unit))

    def variances(
        self, s: complex, forces: ComplexArray, turns: ComplexArray, noise: float
    ) -> FloatArray:
        """Return variances of Re(t f^T H(s) f), (n_turns,), by relative noise; f, (n,), in N.

        They contain the larger square of what fits with more terms change, beyond what noise does.
        """
        best, *others = (self._shares(s, forces, each) for each in (Choice.BEST, *_MORE_TERMS))
        power = np.abs(self.lines) ** 2 / 2.0
        power = noise**2 * np.concatenate([power, power])
        at = np.array([s])
        by_noise, *of_changes = (
            np.array([((turn * shares).real ** 2 * power).sum() for turn in turns])
            for shares in (best, *(other - best for other in others))
        )
        hidden = np.zeros(len(turns))
        for choice, of_change in zip(_MORE_TERMS, of_changes, strict=True):
            change = forces @ (self.at(at, choice) - self.at(at))[0] @ forces
            hidden = np.maximum(hidden, (turns * change).real ** 2 - of_change)
        return np.asarray(by_noise + hidden)

    def _shares(self, s: complex, forces: ComplexArray, choice: Choice) -> ComplexArray:
        """Return the change of f^T H(s) f with parts of lines, (2 n_freq, n, n)."""
        at = np.array([[s / self.omega[-1]]])
        lines = 1j * self.omega[:, np.newaxis] / self.omega[-1]
        parts, whole = self.parts[choice], self.unit * forces
        shape, rigid_shape = parts.shape, parts.rigid_shape
        beside, square = rigid_shape.elastic, np.outer(whole, whole)
        modal = parts.residues.weights(at, whole)
        n_before, n_own = 1 + len(rigid_shape.rates), len(parts.rigid_residues.excess)
        first = n_before + beside.above(at).shape[1]
        weights = np.multiply.outer(shape.terms(at)[0], square)
        weights[shape.above(at).shape[1] :] = modal[: shape.modal_terms(at).shape[1]]
        rigid_weights = np.multiply.outer(rigid_shape.terms(at)[0], square)
        rigid_weights[first : first + len(modal)] = modal
        rigid_weights[first + len(modal) :] = parts.rigid_residues.weights(at, whole)
        coefficients, rigid_coefficients = parts.elastic.of_terms, parts.moving.of_terms
        rigid_coefficients[first : first + len(modal)] -= parts.residues.excess
        rigid_coefficients[first + len(modal) :] -= parts.rigid_residues.excess
        shares = parts.elastic.shares(weights - self.rigid @ weights @ self.rigid)
        shares = shares + parts.moving.shares(self.rigid @ rigid_weights @ self.rigid)
        wide = (0, 0), (n_before, n_own)
        rates = zip(
            *(each.derivatives(x) for each in (shape, beside) for x in (lines, at)), strict=True
        )
        # FRFs without noise have no pulls.
        for (along, there, along_beside, there_beside), pull in zip(
            rates, parts.pulls, strict=False
        ):
            direct = np.tensordot(there[0], coefficients, axes=1)
            padded = np.pad(there_beside, wide)[0]
            direct = direct + np.tensordot(padded, rigid_coefficients, axes=1)
            change = whole @ direct @ whole + parts.elastic.undone(along, weights)
            change += parts.moving.undone(np.pad(along_beside, wide), rigid_weights)
            shares = shares + change * pull
        rates = zip(rigid_shape.derivatives(lines), rigid_shape.derivatives(at), strict=True)
        for (along, there), pull in zip(rates, parts.rigid_pulls, strict=False):
            direct = whole @ np.tensordot(there[0], rigid_coefficients, axes=1) @ whole
            shares = shares + (direct + parts.moving.undone(along, rigid_weights)) * pull
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
    shape = _Shape(_Law.ANY, 1, np.empty(0))
    wider = dict.fromkeys(_MORE_TERMS, shape)
    candidates = _candidates(omega, frf)
    right = real_equations(weights * across.reshape(len(omega), -1))
    if elastic.size:
        shape = _choose(s, right, weights, candidates)
        more = zip(_MORE_TERMS, (shape.with_one_more(), shape.of_any_law()), strict=True)
        wider = {choice: _refined(s, each, weights, right)[0] for choice, each in more}
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
        taken = wider.get(choice, shape)
        shift = _SHIFT if choice is Choice.SHIFTED else 1.0
        beside = replace(taken, free=rigid_shape.elastic.free)
        beside = beside.with_one_more() if choice in _MORE_TERMS else beside
        rigid_taken = replace(rigid_shape, elastic=beside, rates=shift * rates)
        pulls = _pulls(s, taken, right, weights)
        rigid_pulls = _pulls(s, rigid_taken, block_right, weights)
        deforming = _fitted(taken.terms(s), weights, rest)
        moving = _fitted(rigid_taken.terms(s), weights, block)
        parts[choice] = _Parts(
            taken,
            deforming,
            symmetric(pulls.reshape(len(pulls), 2 * len(omega), *across.shape[1:]) @ elastic.T),
            rigid_taken,
            moving,
            rigid_pulls.reshape(len(rigid_pulls), 2 * len(omega), *block.shape[1:]),
            *_both_residues(s, lines, taken, deforming, rigid_taken, moving),
        )
    return LinkFit(omega, unit, lines, rigid, parts)


def _both_residues(
    s: ComplexArray,
    lines: ComplexArray,
    shape: _Shape,
    deforming: _Fit,
    rigid_shape: _RigidShape,
    moving: _Fit,
) -> tuple[_Residues, _Residues]:
    """Return what is left out of modes of the deformation, and of those of the rigid block."""
    weights = moving.weights
    rest = lines - deforming.at_lines() - moving.at_lines()
    noise = float(np.mean(np.abs(weights * rest.reshape(len(s), -1)) ** 2)) * lines[0].size
    powers = ((np.abs(weights * each.modes(s)) ** 2).sum(axis=0) for each in (shape, rigid_shape))
    of_both = [np.sqrt(_BEYOND * noise / each) for each in powers]
    n, n_own = len(shape.parameters) // 2, len(rigid_shape.parameters)
    beside, terms = rigid_shape.elastic, moving.of_terms
    last = len(terms) - n_own
    numerators = terms[last - (2 * n if beside.pairs else n) : last].copy()
    own = 2 * n if shape.pairs else n
    numerators[:own] += deforming.of_terms[len(deforming.of_terms) - own :]
    return (
        _residues(beside, numerators, of_both[0]),
        _residues(rigid_shape, terms[last:], of_both[1]),
    )


def _pulls(s: ComplexArray, shape: _Shape, right: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the change of parameters per real and imaginary part, (n_parameters, 2 n_freq, k)."""
    _, left, columns, sizes = _columns(s, shape, weights, right)
    if left < (_ROUNDING * np.linalg.norm(right)) ** 2:
        columns, sizes = columns[:0], sizes[:0]  # FRFs without noise
    # What coefficients undo but for rounding, as of poles far above the lines, has no effect.
    along, values, across = np.linalg.svd(columns.T / sizes, full_matrices=False)
    kept = values > _UNDONE
    pulls = (across[kept].T / values[kept]) @ along[:, kept].T / sizes[:, np.newaxis]
    return np.asarray(np.concatenate([weights, weights]) * pulls.reshape(-1, *right.shape))


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
            other = _others(poles, known)
            start = np.concatenate([np.abs(other) ** 2, -2.0 * other.real])
            found, left = _refined(s, replace(tried, parameters=start), weights, right)
            if (score := _criterion(found, left, right)) < best:
                best, chosen, first = score, found, start
        fits.append(_without_noise(s, chosen, first, best, weights, right))
    among = [int((np.abs(each.poles()) < 1.0).sum()) for each in fits]
    scores = [_criterion(each, _refined(s, each, weights, right)[1], right) for each in fits]
    return fits[int(among[1] < among[0] and scores[1] < scores[0])]


def _others(poles: ComplexArray, known: ComplexArray) -> ComplexArray:
    """Return the poles but for those that are nearest to known ones, within a half-width."""
    if not len(poles):
        return poles
    apart = np.abs(poles[:, np.newaxis] - known)
    same = (apart == apart.min(axis=0)) & (apart <= -poles.real[:, np.newaxis])
    return np.asarray(poles[~same.any(axis=1)])


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
    chosen = _without_noise(s, chosen, first, best, weights, right)
    if math.sqrt(least) < _COMPUTED * np.linalg.norm(right):
        # The criterion ignores errors below the noise of single lines. In FRFs that were computed,
        # and stored in single precision, one more term costs nothing and removes these errors.
        return _improved(s, [chosen, chosen.with_one_more()], weights, right)
    return chosen


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
        rest, left, columns, _ = _columns(s, shape, weights, right)
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
) -> tuple[FloatArray, float, FloatArray, FloatArray]:
    """Return the rest of a fit, its square, and changes with parameters; also their whole sizes.

    The changes are what coefficients cannot undo.
    """
    basis, triangle = np.linalg.qr(real_equations(weights * shape.terms(s)))
    shares = basis.T @ right
    rest = right - basis @ shares
    coefficients = np.linalg.lstsq(triangle, shares, rcond=_SMALLEST)[0]
    columns, sizes = np.empty((len(shape.parameters), right.size)), []
    for i, rate in enumerate(shape.derivatives(s)):
        column = real_equations(weights * rate) @ coefficients
        columns[i] = (column - basis @ (basis.T @ column)).ravel()
        sizes.append(max(float(np.linalg.norm(column)), 1e-300))
    return rest, float((rest**2).sum()), columns, np.array(sizes)


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
