# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Adds an ensemble to a table: poles and shapes of models whose uncertain numbers are drawn.

The members are solved at a few angles of the stroke, with fewer elements and modes than the model,
and a cylinder may be a little beyond its stroke. Where a member cannot be solved, or its modes
cannot be followed from angle to angle, its numbers are NaN.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.description import Cylinder, Mechanism, Uncertainty, coarser
from linkage_vibration.mechanics.model import LinkageModel, Place, Solution
from linkage_vibration.mechanics.modes import oscillating_indices
from linkage_vibration.mechanics.response import reach
from linkage_vibration.mechanics.uncertainty import member_coordinates
from linkage_vibration.table.interpolation import (
    interpolation_matrix,
    stroke_angle,
    stroke_variable,
)
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation.sampling import Sampler
from linkage_vibration.table.tabulation.tracking import UNCLEAR

_ALL = 10**6
_COARSER = (4, 2), (8, 4), (_ALL, _ALL)  # elements and modes of links that are tried for members
_N_NODES = 8, 15, 29  # angles at which members are solved
_SAME = 1.0 - 1e-6  # of a gap between modes; a smaller difference is rounding
_BETWEEN = 0.5  # Between them, a pole may be off by this share of its decay.
_NEAR = 0.03  # A pole of coarser bodies may be off by this share of its decay.
_BEYOND = 0.1  # of the stroke of a cylinder, by which that of a member may be beyond it


@dataclass(frozen=True, slots=True, eq=False)
class _Modes:
    """The oscillating modes of a member at one angle, ascending, and its forces at rest."""

    poles: ComplexArray  # (k,), rad/s
    shapes: ComplexArray  # (n, k): on the coordinates; products are the residues of 1 / (s - p)
    rows: ComplexArray  # (n_rows, k): at the places and of the forces
    flexibility: FloatArray  # (n_rows, n_places): at 0 Hz, by all modes
    static: FloatArray  # (n_forces,): under the weight, N


def with_ensemble(table: Table, sampler: Sampler, progress: Callable[[float], object]) -> Table:
    """Return a table with its ensemble, if it has FRFs and its mechanism has uncertain numbers.

    It has none if too many angles would be needed. ``progress`` is called with the fraction of the
    members that are finished.
    """
    mechanism = sampler.model.mechanism
    uncertainty = mechanism.uncertainty
    if uncertainty is None or not uncertainty.numbers or not table.places:
        return table
    drawn = member_numbers(uncertainty).tolist()
    for n_nodes in _N_NODES:
        solver = _Solver(table, sampler, n_nodes, 1 + len(drawn))
        solver.solve(0, mechanism)
        for member, values in enumerate(drawn, 1):
            if solver.rough:
                break
            progress((member - 1) / len(drawn))
            try:
                solver.solve(member, uncertainty.described(values))
            except LinkageVibrationError:  # numbers that are not possible
                for array in solver.arrays.values():
                    array[member] = math.nan
        if not solver.rough:
            progress(1.0)
            arrays: dict[str, Any] = {f"ensemble_{k}": each for k, each in solver.arrays.items()}
            return replace(table, ensemble_alpha3=solver.nodes, **arrays)
    return table


def member_numbers(uncertainty: Uncertainty) -> FloatArray:
    """Return the uncertain numbers of the members, (n_members, n); opposite ones in each half."""
    half = member_coordinates(len(uncertainty.numbers))
    return uncertainty.draw(np.vstack([half, -half]))


class _Solver:
    """Solves members at the nodes, and follows their modes from those of the mechanism itself."""

    def __init__(self, table: Table, sampler: Sampler, n_nodes: int, n_members: int) -> None:
        self._table, self._model = table, sampler.model
        self._places: list[Place] = [*table.places, *table.forces]
        self._limit = reach(table.band)
        few = _nodes(table, 3).tolist()
        exact = [_oscillating(sampler.solution(angle))[0] for angle in few]
        for self._mesh in _COARSER:
            model = self._coarse(sampler.model.mechanism)
            coarse = [_oscillating(model.solve(angle))[0] for angle in few]
            if all(_agree(*both, self._limit) for both in zip(coarse, exact, strict=True)):
                break
        self._mass = model.system.mass
        every = _nodes(table, 2 * n_nodes - 1)
        self.nodes, self._between = every[::2], every[1::2]
        self._matrix = interpolation_matrix(
            *(stroke_variable(x, table.toggles) for x in (self.nodes, self._between))
        )
        solved = [self._solved(model, angle) for angle in self.nodes.tolist()]
        count = max(table.n_modes, *(int((np.abs(x.poles) < self._limit).sum()) for x in solved))
        gaps = [np.diff(np.log(np.abs(x.poles[: count + 1]))).min(initial=math.inf) for x in solved]
        self._base = first_widest(np.array(gaps))
        self._start = solved[self._base].shapes[:, :count]
        self.rough, base = False, sampler.model.mechanism.base
        n_rows, n_mounts = len(self._places), len(base.mounts) if base else 0

        def unknown(kind: type, *shape: int) -> NDArray[Any]:
            return np.full((n_members, *shape), math.nan, dtype=kind)

        # The numbers of all members, as `Table` has them; NaN where they are not known.
        self.arrays = {
            "poles": unknown(np.complex64, n_nodes, count),
            "shapes": unknown(np.complex64, n_nodes, n_rows, count),
            "far": unknown(np.float32, n_nodes, n_rows, len(table.places)),
            "static": unknown(np.float32, n_nodes, len(table.forces)),
            "mounts": unknown(np.float32, n_mounts, 2, 2),
        }

    def solve(self, member: int, mechanism: Mechanism) -> None:
        """Find the numbers of a member: the poles are followed from node to node."""
        model, numbers = self._coarse(mechanism), {k: a[member] for k, a in self.arrays.items()}
        poles = np.full(numbers["poles"].shape, math.nan, dtype=complex)
        if mechanism.base is not None:
            mounts = mechanism.base.mounts
            numbers["mounts"][:] = [(mount.stiffness, mount.damping) for mount in mounts]
        shapes: dict[int, ComplexArray] = {}
        for node in (*range(self._base, len(self.nodes)), *range(self._base - 1, -1, -1)):
            before = node + 1 if node < self._base else node - 1
            if node != self._base and before not in shapes:
                continue
            try:
                here = self._solved(model, float(self.nodes[node]))
            except LinkageVibrationError:
                continue
            order, signs = self._continued(shapes.get(before, self._start), here.shapes)
            if not len(order):
                continue
            shapes[node], rows = here.shapes[:, order] * signs, here.rows[:, order] * signs
            near = (rows[:, np.newaxis] * rows[: len(self._table.places)] / here.poles[order]).real
            poles[node], numbers["shapes"][node] = here.poles[order], rows
            numbers["far"][node] = here.flexibility + 2.0 * near.sum(axis=2)
            numbers["static"][node] = here.static
        numbers["poles"][:] = poles
        self._check(member % len(self._between), model, poles)

    def _check(self, between: int, model: LinkageModel, poles: ComplexArray) -> None:
        """Note whether the poles of a member can be interpolated between two of its nodes."""
        if np.isfinite(poles).all():
            here, _ = _oscillating(model.solve(float(self._between[between])))
            off = np.exp(self._matrix[between] @ np.log(poles))[:, np.newaxis] - here
            share = np.abs(off) / np.abs(here.real)
            self.rough |= bool(share[linear_sum_assignment(share)].max() > _BETWEEN)

    def _continued(self, before: ComplexArray, here: ComplexArray) -> tuple[IntArray, FloatArray]:
        """Return which shapes continue others, and their signs; none if that is not clear."""
        product = before.conj().T @ self._mass @ here
        sizes = [(x.conj() * (self._mass @ x)).sum(axis=0).real for x in (before, here)]
        criterion = np.abs(product) ** 2 / np.outer(*sizes)
        order = linear_sum_assignment(criterion, maximize=True)[1]
        pairs = np.arange(len(order)), order
        if len(order) < len(product) or (criterion[pairs] <= UNCLEAR).any():
            order, pairs = order[:0], (order[:0], order[:0])
        return order, np.where(product[pairs].real < 0.0, -1.0, 1.0)

    def _coarse(self, mechanism: Mechanism) -> LinkageModel:
        """Return the model of a member."""
        springs = tuple(
            replace(s, stiffness=replace(s.stiffness, margin=_BEYOND * s.stiffness.stroke))
            if isinstance(s.stiffness, Cylinder)
            else s
            for s in mechanism.springs
        )
        mechanism = replace(coarser(mechanism, *self._mesh), springs=springs)
        return LinkageModel(mechanism, kinematics=self._model.kinematics.nearby(mechanism))

    def _solved(self, model: LinkageModel, alpha3: float) -> _Modes:
        """Return the modes of a member at an angle, rad."""
        solution = model.solve(alpha3)
        poles, turn = _oscillating(solution)
        kept = slice(0, 2 * int((np.abs(poles) < self._limit).sum()) + 4)
        participation = solution.participation(self._places)
        return _Modes(
            poles[kept],
            np.asarray(solution.modes.shapes @ turn[:, kept]),
            np.asarray(participation @ turn[:, kept]),
            participation / solution.modes.omega**2 @ participation[: len(self._table.places)].T,
            model.forces.at_rest(solution.configuration, solution.joining, solution.coupled),
        )


def first_widest(gaps: FloatArray) -> int:
    """Return the index of the first gap that is the widest but for rounding."""
    return int((gaps >= _SAME * gaps.max()).argmax())


def _nodes(table: Table, n: int) -> FloatArray:
    """Return angles that are denser towards the ends of the stroke, (n,), rad."""
    ends = stroke_variable(np.array(table.alpha3_range), table.toggles)
    shares = (1.0 - np.cos(np.pi * np.arange(n) / (n - 1))) / 2.0
    nodes = stroke_angle(ends[0] + (ends[1] - ends[0]) * shares, table.toggles)
    nodes[[0, -1]] = table.alpha3_range
    return nodes


def _oscillating(solution: Solution) -> tuple[ComplexArray, ComplexArray]:
    """Return the oscillating poles, ascending, (k,), rad/s, and shapes by the undamped modes.

    The products of the shapes, (n_modes, k), are the residues of 1 / (s - pole).
    """
    damped = solution.damped
    if damped.poles is not None:
        return damped.oscillating, damped.oscillating_shapes
    root = np.sqrt(damped.stiffness - damped.decay**2 / 4.0)
    poles = np.asarray(1j * root - damped.decay / 2.0)
    turn = np.eye(len(root)) if damped.shapes is None else damped.shapes[0]
    upper = oscillating_indices(poles)
    return poles[upper], np.asarray(turn[:, upper] / np.sqrt(2j * root[upper]))


def _agree(coarse: ComplexArray, poles: ComplexArray, limit: float) -> bool:
    """Return whether coarser bodies have the poles of the model up to a limit, rad/s."""
    poles = poles[np.abs(poles) < limit]
    if len(coarse) < len(poles):
        return False
    off = np.abs(coarse[: len(poles)] - poles)
    return bool((off <= _NEAR * np.abs(poles.real)).all())
