# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""First-order changes of natural frequencies with the uncertain numbers of a mechanism.

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

Numbers = FloatArray | ComplexArray


@dataclass(frozen=True, slots=True, eq=False)
class ModeChanges:
    """Modes in one configuration, and their changes by one standard deviation of each number."""

    frequencies: FloatArray  # (n_modes,), Hz, ascending
    log_frequencies: FloatArray  # (n_numbers, n_modes): changes of ln(frequency)
    correlation: FloatArray  # (n_numbers, n_numbers)

    @property
    def stddev(self) -> FloatArray:
        """Standard deviations of ln(frequency), (n_modes,)."""
        changes = self.log_frequencies
        return np.asarray(np.sqrt((changes * (self.correlation @ changes)).sum(axis=0)))

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


class Sensitivity:
    """The changes of a model's natural frequencies with the uncertain numbers of its mechanism.

    It refuses links that are known by FRFs alone, and matrices that cannot be compared.
    """

    def __init__(self, model: LinkageModel) -> None:
        uncertainty = model.mechanism.uncertainty
        assert uncertainty is not None
        model.system  # noqa: B018 - it refuses links that have no matrices
        self._model = model
        self.numbers = uncertainty.numbers
        self.correlation = np.array(uncertainty.correlation).reshape(2 * [len(self.numbers)])
        self._changes = [self._change(number) for number in self.numbers]

    def at(self, solution: Solution, highest: float) -> ModeChanges:
        """Return the changes of the modes up to a frequency in Hz."""
        limit, damped = math.tau * highest, solution.damped
        values: Numbers
        if damped.shapes is None:
            omega = solution.modes.omega
            kept = np.flatnonzero(~solution.modes.mechanism & (omega <= limit))
            sizes, shapes = omega[kept], solution.modes.shapes[:, kept]
            zeros, ones = np.zeros(len(sizes)), np.ones(len(sizes))
            values, power = sizes**2, 2.0
            weights = np.array([-values, zeros, ones, zeros])
        else:
            chosen = np.abs(damped.oscillating) <= limit
            poles = damped.oscillating[chosen]
            sizes = np.abs(poles)
            shapes = np.asarray(solution.modes.shapes @ damped.oscillating_shapes[:, chosen])
            zeros, ones = np.zeros(len(sizes)), np.ones(len(sizes))
            if damped.poles is not None:  # viscous damping
                values, power = -1j * poles, 1.0
                weights = 1j * np.array([poles**2, poles, ones, zeros])  # for -i times the poles
            else:
                values, power = -(poles**2), 2.0
                weights = np.array([-values, zeros, ones, 1j * ones])
        changes = (self._forms(solution, shapes, weights) / (power * values)).real
        return ModeChanges(sizes / math.tau, changes, self.correlation)

    def _forms(self, solution: Solution, shapes: Numbers, weights: Numbers) -> Numbers:
        """Return the changes of psi_i^T Z_i psi_i with the forces of the constraints.

        Z is a weighted sum of M, C, K and L, the loss; the weights are (4, k), those of mode i in
        column i. The result is (n_numbers, k).
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
        forms = np.zeros((len(self._changes), shapes.shape[1]), dtype=multipliers.dtype)
        for form, change in zip(forms, self._changes, strict=True):
            for rows, blocks in change.blocks:
                for weight, block in zip(weights, blocks, strict=True):
                    form += weight * (shapes[rows] * (block @ shapes[rows])).sum(axis=0)
            if (rate := _join_rates(change, solution)) is None:
                continue
            damping, stiffness = rate["damping"], rate["stiffness"]
            stiffer = np.outer(damping, weights[1]) + np.outer(stiffness, weights[2])
            more = 2.0 * springs * stretch * (rate["elongation"] @ moved)
            form += (stiffer * stretch**2 + more).sum(axis=0)
            form += 2.0 * (multipliers * (rate["compatibility"] @ moved)).sum(axis=0)
        return forms

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


def _join_rates(change: _Change, solution: Solution) -> dict[str, FloatArray] | None:
    """Return how a number changes what joins the components in a configuration."""
    if change.other is None:
        return None
    (interface, kinematics), here, low = change.other, solution.configuration, solution.joining
    moves = kinematics is not solution.model.kinematics
    there = kinematics.at(here.alpha3) if moves else here
    high = interface.join(there)
    names = ("stiffness", "damping", "compatibility", "elongation")
    return {name: change.steps * (getattr(high, name) - getattr(low, name)) for name in names}


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
