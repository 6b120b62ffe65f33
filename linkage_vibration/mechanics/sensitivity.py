# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""First-order changes of the modes with the uncertain numbers of a mechanism.

An eigenvalue w^2 with the shape phi and the forces mu of the constraints B phi = 0 changes by
phi^T (dK - w^2 dM) phi + 2 mu^T dB phi, where (K - w^2 M) phi + B^T mu = 0. The matrices are
symmetric, so a damped pole has equal left and right shapes, and with s^2 M + s C + K in place of
K - w^2 M the same holds for it. dM, dC and dK of a link are differences of its matrices before
their reduction, on the basis that reduced it: a second reduction might turn its modes round. dB is
the difference of the compatibility matrices of the closed linkages at the same input angle.
"""

import math
from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.compatibility import InterfaceMap
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.description import Link, Mechanism, UncertainNumber
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import LinkageModel, ModelError, Solution
from linkage_vibration.mechanics.paths import split_paths

NEAR = 0.5
"""Modes whose logarithmic frequencies differ by more do not mix."""

# Errors of standard deviations below these shares of a frequency or a ratio do not matter.
_NEGLIGIBLE, _NEGLIGIBLE_RATIO = 1e-4, 1e-3
_MOST = 0.9  # Higher orders may take away at most this share of a variance.

Numbers = FloatArray | ComplexArray
# Eigenvalues, the power of the frequency in them, their changes with mixed ones, (n, k, k), and
# the first four columns of `ModeChanges`.
Eigenvalues = tuple[Numbers, float, Numbers, tuple[FloatArray, FloatArray, FloatArray, FloatArray]]


@dataclass(frozen=True, slots=True, eq=False)
class ModeChanges:
    """Modes in one configuration, and their changes by one standard deviation of each number."""

    frequencies: FloatArray  # (n_modes,), Hz, ascending
    ratios: FloatArray  # (n_modes,): damping ratios
    log_frequencies: FloatArray  # (n_numbers, n_modes): changes of ln(frequency)
    ratio_changes: FloatArray  # (n_numbers, n_modes)
    correlation: FloatArray  # (n_numbers, n_numbers)
    spreads: FloatArray  # (n_numbers,), as `_spread` returns them
    # (2, n_modes): what mixing with near modes adds to the variances of ln(frequency) and of
    # damping ratios, by the second and the third order.
    mixing: FloatArray
    # (n_modes, n_modes): standard deviations of the distances of modes, relative to their poles.
    approach: FloatArray
    toggle_stddev: float  # standard deviation of the angle of a toggle that is near, rad

    @property
    def stddev(self) -> FloatArray:
        """Standard deviations of ln(frequency) and of damping ratios, (2, n_modes)."""
        variance = self._variance
        return np.asarray(np.sqrt(variance + np.maximum(self.mixing, -_MOST * variance)))

    @property
    def excess(self) -> FloatArray:
        """What higher orders add to these variances, as shares of them, (2, n_modes)."""
        least = np.array([np.full(len(self.ratios), _NEGLIGIBLE), _NEGLIGIBLE_RATIO * self.ratios])
        return np.asarray(self.mixing / np.maximum(self._variance, least**2))

    @property
    def _variance(self) -> FloatArray:
        """Variances of ln(frequency) and of damping ratios without mixing, (2, n_modes)."""
        ratio_changes = self.ratio_changes * self.spreads[:, np.newaxis]
        both = np.array([self.log_frequencies, ratio_changes])
        return np.asarray((both * (self.correlation @ both)).sum(axis=1))

    def shares(self, mode: int) -> FloatArray:
        """Return the share of each number in the variance of a frequency, (n_numbers,), sum 1."""
        changes = self.log_frequencies[:, mode]
        parts = changes * (self.correlation @ changes)
        return np.asarray(parts / parts.sum())


@dataclass(frozen=True, slots=True, eq=False)
class _Change:
    """What one standard deviation of a number changes."""

    # For each component that changes: indices of its coordinates, and (4, n, n): dM, dC, dK, dL.
    blocks: tuple[tuple[IntArray, FloatArray], ...]
    # What the model with the larger number has, where its geometry or a spring changes.
    other: tuple[InterfaceMap, Kinematics] | None
    steps: float  # how many steps to the larger number are one standard deviation


# How one standard deviation of each number changes the arrays of a `Joining`, and the ``angles`` of
# the bodies, (n_bodies,), rad.
Joins = list[dict[str, FloatArray] | None]


class Sensitivity:
    """The changes of a model's modes with the uncertain numbers of its mechanism.

    It refuses links that are known by FRFs alone, and matrices that cannot be compared.
    """

    def __init__(self, model: LinkageModel) -> None:
        uncertainty = model.mechanism.uncertainty
        assert uncertainty is not None
        model.system  # noqa: B018 - it refuses links that have no matrices
        self._model = model
        self.numbers = uncertainty.numbers
        self.correlation = np.array(uncertainty.correlation).reshape(2 * [len(self.numbers)])
        self._root = np.linalg.cholesky(self.correlation)
        self._spreads = np.array([_spread(number) for number in self.numbers])
        self._changes = [self._change(number) for number in self.numbers]

    def at(self, solution: Solution, highest: float) -> ModeChanges:
        """Return the changes of the modes up to a frequency in Hz."""
        joins = [_join_rates(change, solution) for change in self._changes]
        limit = math.tau * highest
        changes = self._uncoupled if solution.damped.shapes is None else self._coupled
        values, power, forms, columns = changes(solution, joins, limit)
        mixing, approach = self._mixing(forms, values, power)
        mixing[1] *= 1.0 - columns[1] ** 2  # from the angle of a pole to its damping ratio
        toggle = self._toggle_stddev(joins, solution)
        return ModeChanges(*columns, self.correlation, self._spreads, mixing, approach, toggle)

    def _uncoupled(self, solution: Solution, joins: Joins, limit: float) -> Eigenvalues:
        """Return changes of w^2, of modal damping and of modal loss, where shapes are real."""
        omega, damped = solution.modes.omega, solution.damped
        elastic = np.flatnonzero(~solution.modes.mechanism & (omega <= limit))
        shapes, omega = solution.modes.shapes[:, elastic], omega[elastic]
        values, decay, loss = omega**2, damped.decay[elastic], damped.stiffness.imag[elastic]
        zeros, ones = np.zeros(len(elastic)), np.ones(len(elastic))
        frequency, viscosity = [-values, zeros, ones, zeros], [-decay, ones, zeros, zeros]
        weights = (frequency, viscosity, [-loss, zeros, zeros, ones])
        forms = [self._forms(solution, joins, shapes, np.array(each)) for each in weights]
        main, slower, lossier = (_diagonals(form).real for form in forms)
        size = np.abs(values + 1j * loss)
        viscous, structural = decay / (2.0 * np.sqrt(size)), loss / (2.0 * size)
        larger = (values * main + loss * lossier) / size**2
        changes = slower / (2.0 * np.sqrt(size)) + lossier / (2.0 * size)
        changes -= (viscous / 2.0 + structural) * larger
        frequencies, logs = omega / (2.0 * math.pi), main / (2.0 * values)
        return values, 2.0, forms[0], (frequencies, viscous + structural, logs, changes)

    def _coupled(self, solution: Solution, joins: Joins, limit: float) -> Eigenvalues:
        """Return changes of poles, or of squares of frequencies with structural damping."""
        damped = solution.damped
        kept = np.abs(damped.oscillating) <= limit
        poles = damped.oscillating[kept]
        shapes = np.asarray(solution.modes.shapes @ damped.oscillating_shapes[:, kept])
        zeros, ones = np.zeros(len(poles)), np.ones(len(poles))
        if damped.poles is not None:  # viscous damping
            values, power = -1j * poles, 1.0
            weights = 1j * np.array([poles**2, poles, ones, zeros])  # for -i times the poles
        else:
            values, power = -(poles**2), 2.0
            weights = np.array([-values, zeros, ones, 1j * ones])
        forms = self._forms(solution, joins, shapes, weights)
        relative = _diagonals(forms) / (power * values)
        size = np.abs(poles)
        ratios, logs = -poles.real / size, np.asarray(relative.real)
        changes = np.asarray(-(relative * poles).real / size - ratios * logs)
        return values, power, forms, (size / (2.0 * math.pi), ratios, logs, changes)

    def _forms(
        self, solution: Solution, joins: Joins, shapes: Numbers, weights: Numbers
    ) -> Numbers:
        """Return the changes of psi_j^T Z_i psi_i with the forces of the constraints.

        Z is a weighted sum of M, C, K and L, the loss; the weights are (4, k), those of mode i in
        column i. The result is (n_numbers, k, k).
        """
        joining, system, n = solution.joining, self._model.system, len(self._model.interface)
        moved, b = shapes[:n], slice(0, n)
        matrices = system.mass, system.damping, system.stiffness, system.loss
        stretch = joining.elongation @ moved
        springs = np.outer(joining.damping, weights[1]) + np.outer(joining.stiffness, weights[2])
        force = joining.elongation.T @ (springs * stretch)
        for weight, matrix in zip(weights, matrices, strict=True):
            if weight.any():
                force = force + weight * (matrix[b] @ shapes)
        multipliers = np.linalg.lstsq(joining.compatibility.T, -force, rcond=None)[0]
        k = shapes.shape[1]
        forms: list[Numbers] = [np.zeros((k, k), dtype=multipliers.dtype) for _ in joins]
        for form, change, rate in zip(forms, self._changes, joins, strict=True):
            for rows, blocks in change.blocks:
                for weight, block in zip(weights, blocks, strict=True):
                    if weight.any():
                        form += weight * (shapes[rows].T @ block @ shapes[rows])
            if rate is None:
                continue
            damping, stiffness = rate["damping"], rate["stiffness"]
            stiffer = np.outer(damping, weights[1]) + np.outer(stiffness, weights[2])
            form += stretch.T @ (stiffer * stretch)
            gap = multipliers.T @ (rate["compatibility"] @ moved)
            more = rate["elongation"] @ moved
            form += gap + gap.T
            form += stretch.T @ (springs * more) + more.T @ (springs * stretch)
        return np.concatenate([np.zeros((0, k, k)), forms])

    def _mixing(
        self, forms: Numbers, values: Numbers, power: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return what mixing adds to the variances of ln(pole), (2, k), and `approach`.

        With the changes u of ln(pole), y mixed with mode j, and the gap g, mode i has y^2 / g in
        the second order and y^2 (u_j - u_i) / g^2 in the third; real parts are the frequency's.
        """
        independent = np.tensordot(self._root.T, (forms + forms.swapaxes(1, 2)) / 2.0, 1)
        relative = independent / (power * np.sqrt(np.outer(values, values)))
        changes, logs = _diagonals(relative), np.log(values) / power
        mixed, size = (relative**2).sum(axis=0), (np.abs(relative) ** 2).sum(axis=0)
        along = (changes[:, :, np.newaxis] * relative).sum(axis=0)  # of u_i with y
        gaps = np.subtract.outer(logs, logs)
        # Modes that are far apart do not mix; a shape follows the joints there.
        near = (np.abs(gaps) > 0.0) & (np.abs(gaps) < NEAR)
        gaps = np.where(near, gaps, 1.0)
        added = []
        for part, sign in ((np.real, 1.0), (np.imag, -1.0)):
            first = part(changes)
            products = first.T @ changes
            third = (products - np.diag(products)[:, np.newaxis]) * mixed
            third += 2.0 * (first[:, :, np.newaxis] * relative).sum(axis=0) * (along.T - along)
            square = np.abs(size / gaps) ** 2 + sign * ((mixed / gaps) ** 2).real
            share = square + 2.0 * part(third / gaps**2)
            added.append(np.where(near, share, 0.0).sum(axis=1))
        apart = np.abs(changes[:, :, np.newaxis] - changes[:, np.newaxis]) ** 2
        return np.array(added), np.sqrt(apart.sum(axis=0) + 4.0 * size)

    def _toggle_stddev(self, joins: Joins, solution: Solution) -> float:
        """Return the standard deviation of the angle of a toggle that is near, rad.

        There a body turns with the square root of the distance. So a number that moves the toggle
        has the effect of an equal and opposite change of the input angle.
        """
        rates = np.append(solution.configuration.velocity_ratios, 1e-9)
        turns = np.zeros(len(joins))
        for i, rate in enumerate(joins):
            if rate is not None:
                turns[i] = rate["angles"] @ rates[:-1] / (rates @ rates)
        return float(np.linalg.norm(self._root.T @ turns))

    def _change(self, number: UncertainNumber) -> _Change:
        """Return what a number changes."""
        mechanism, components = self._model.mechanism, self._model.components
        rows, blocks, sides = self._model.system.rows, [], number.sides
        scale = number.deviation / (2.0 * number.step)
        for i, (link, component) in enumerate(zip(mechanism.links, components, strict=False)):
            assert isinstance(component, Component)  # `system` refuses others
            pair = [(_meshed_as(side.links[i], link), side) for side in sides]
            (low, first), (high, second) = pair
            if low != high or (link.damping is None and first.damping != second.damping):
                before, after = (_on_basis(component, *each) for each in pair)
                blocks.append((rows[link.name], scale * (after - before)))
        rigid = zip(*(side.rigid_components() for side in sides), strict=True)
        for component, (low, high) in zip(components[len(mechanism.links) :], rigid, strict=True):
            block = scale * (_stacked(high) - _stacked(low))
            if block.any():
                blocks.append((rows[component.name], block))
        smaller, larger = sides
        other: tuple[InterfaceMap, Kinematics] | None = None
        if _joined(smaller) != _joined(larger):
            kinematics = self._model.kinematics
            if _points(smaller) != _points(larger):
                kinematics = kinematics.nearby(larger)
            other = InterfaceMap(larger, components), kinematics
        return _Change(tuple(blocks), other, number.deviation / number.step)


def _on_basis(reduced: Component, link: Link, mechanism: Mechanism) -> FloatArray:
    """Return mass, damping, stiffness and loss of a link, (4, n, n), on its reduced basis."""
    whole = link.body.component(link, mechanism, reduced=False)
    assert isinstance(whole, Component)
    basis = np.eye(len(reduced.mass)) if reduced.basis is None else reduced.basis
    if len(whole.mass) != len(basis):
        problem = "a small change of a number changes its mesh; give other `elements`"
        raise ModelError(f"links.{link.name}: {problem}.")
    mass, stiffness = (basis.T @ matrix @ basis for matrix in (whole.mass, whole.stiffness))
    if getattr(link.body, "damping", None) is None:
        damping = (link.damping or mechanism.damping).viscous(mass, stiffness)
    else:
        damping = basis.T @ whole.damping @ basis
    return np.array([mass, damping, stiffness, whole.loss_factor * stiffness])


def _spread(number: UncertainNumber) -> float:
    """Return the factor from the first order to the effect of a number on damping ratios.

    Damping ratios are proportional to dampings. If the logarithm of a damping is normal with the
    deviation s, that of the damping is its median times sqrt(exp(s^2) (exp(s^2) - 1)).
    """
    keys = split_paths(number.path)[0].split(".")
    if not number.relative or not {"damping", "loss_factor"} & {*keys} or "at_hz" in keys:
        return 1.0
    share = number.deviation / abs(number.value)
    grown = math.exp(share**2)
    return math.sqrt(grown * (grown - 1.0)) / share


def _join_rates(change: _Change, solution: Solution) -> dict[str, FloatArray] | None:
    """Return how a number changes what joins the components in a configuration."""
    if change.other is None:
        return None
    (interface, kinematics), here, low = change.other, solution.configuration, solution.joining
    moves = kinematics is not solution.model.kinematics
    there = kinematics.at(here.alpha3) if moves else here
    high = interface.join(there)
    names = ("stiffness", "damping", "compatibility", "elongation")
    rates = {name: getattr(high, name) - getattr(low, name) for name in names}
    rates["angles"] = there.angles - here.angles
    return {name: change.steps * rate for name, rate in rates.items()}


def _stacked(component: Component) -> FloatArray:
    """Return mass, damping, stiffness and loss of a component, (4, n, n)."""
    loss = component.loss_factor * component.stiffness
    return np.array([component.mass, component.damping, component.stiffness, loss])


def _points(mechanism: Mechanism) -> object:
    """Return what the kinematics depend on."""
    return mechanism.ground, tuple(body.points for body in mechanism.bodies)


def _joined(mechanism: Mechanism) -> object:
    """Return what the joints and the springs depend on."""
    rigid = [(body.points, body.centre_of_gravity) for body in mechanism.rigid]
    mounts = mechanism.base and mechanism.base.mounts
    return _points(mechanism), rigid, mechanism.springs, mounts


def _meshed_as(link: Link, other: Link) -> Link:
    """Return a link with as many elements as another."""
    elements = other.body.elements
    return link if elements is None else link.meshed(elements, link.modes)


def _diagonals(forms: Numbers) -> Numbers:
    """Return the diagonal of each matrix, (n, k)."""
    return forms[:, range(forms.shape[1]), range(forms.shape[1])]
