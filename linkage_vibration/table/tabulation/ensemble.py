# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Adds what follows from uncertain numbers to a table: deviations of its modes, and an ensemble.

The members of the ensemble are models whose uncertain numbers are drawn. They are solved at a few
angles of the stroke, with fewer elements and modes than the model, and a cylinder may be a little
beyond its stroke. A pair of members is left out unless both close over the stroke, since a machine
that exists does. Where the modes of a member cannot be followed from angle to angle, its
numbers are NaN. Deviations do not follow modes: they are those of the poles of the same rank.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import linear_sum_assignment

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray, rows_of
from linkage_vibration.mechanics.description import Cylinder, Mechanism, coarser
from linkage_vibration.mechanics.model import LinkageModel, Place, Solution
from linkage_vibration.mechanics.modes import (
    MECHANISM,
    DampedModes,
    damp_modes,
    oscillating_indices,
)
from linkage_vibration.mechanics.response import reach
from linkage_vibration.mechanics.uncertainty import paired_draws
from linkage_vibration.table.interpolation import (
    interpolation_matrix,
    stroke_angle,
    stroke_variable,
)
from linkage_vibration.table.packing import PACKED, rounded
from linkage_vibration.table.table import Table, TableError
from linkage_vibration.table.tabulation.sampling import Sampler

_ALL = 10**6
_COARSER = (4, 2), (8, 4), (16, 8), (_ALL, _ALL)  # elements and modes of links, for members
_DAMPED = 2.0  # Undamped modes above so many times the highest pole are left out if they may be.
_N_NODES = 8, 15, 29, 57  # angles at which members are solved
_CLEAR = 1.5  # Overdamped modes above so many times the table's highest one change no rank.
_SAME = 1.0 - 1e-6  # of a gap between modes; a smaller difference is rounding
_BETWEEN = 0.5  # Between them, a pole may be off by this share of its decay.
_MOST_ROUGH = 0.05  # of members and of deviations may be off by more; they are not known then.
_SKEW = 1.0  # A distribution is skew from this standardised third moment on.
_GROUPS = 1.7  # It has two groups if the fourth is smaller; that of an even one is 1.8.
_MISSED = 0.3  # Deviations are not known where interpolation misses a member by this share of them,
_LEAST = 1e-4  # and by this.
_UNCLEAR = 0.5  # MAC up to which a shape may continue two: its sum over all modes is 1.
_NEAR = 0.03  # A pole of coarser bodies may be off by this share of its decay.
Drawn = dict[tuple[int, int], tuple[Mechanism, list[LinkageModel]]]
"""By row and member of a pair, a mechanism and, once it is made, the model of its vertical half."""
_Kept = tuple[IntArray, ComplexArray, FloatArray]  # indices of modes, their shapes, and signs

N_ANGLES = 257  # Even angles over the range at which a table has the standard deviations

_SEED = 7  # of the draws; the next one is that of those in place of pairs that are left out
_FEW_LOST = 7  # One of so many pairs may be left out: what closes scatters less than what is drawn.
_BEYOND = 0.1  # of the stroke of a cylinder, by which that of a member may be beyond it


@dataclass(frozen=True, slots=True, eq=False)
class _Modes:
    """The oscillating modes of a member at one angle, ascending, and its forces at rest."""

    poles: ComplexArray  # (k,), rad/s
    shapes: ComplexArray  # (n, k): on the coordinates; products are the residues of 1 / (s - p)
    rows: ComplexArray  # (n_rows, k): at the places and of the forces
    flexibility: FloatArray  # (n_rows, n_places): at 0 Hz, by all modes
    static: FloatArray  # (n_forces,): under the weight, N
    n_overdamped: int  # modes that do not oscillate, up to the limit of the table


def with_uncertainty(
    table: Table, sampler: Sampler, drawn: Drawn, progress: Callable[[float], object]
) -> Table:
    """Return a table with its deviations and, if it has FRFs and angles suffice, its ensemble."""
    mechanism = sampler.model.mechanism
    uncertainty = mechanism.uncertainty
    if uncertainty is None or not uncertainty.numbers:
        return table
    if sampler.model.measured_frequencies is not None:
        raise TableError(
            f"{mechanism.name}: uncertainty needs links with matrices, and some of its links "
            "are known by FRFs alone; remove this section."
        )
    known: dict[tuple[int, int], tuple[LinkageModel, dict[float, _Modes]]] = {}
    pairs = np.concatenate([paired_draws(uncertainty, _SEED + i) for i in (0, 1)], axis=1)
    n = pairs.shape[1] // 2
    for n_nodes in _N_NODES:
        solver, rows = _Solver(table, sampler, n_nodes, 1 + 2 * n), list[int]()
        solver.keep(0, *solver.solve(solver.own, 0))
        for row in range(n + n // _FEW_LOST):
            if len(rows) == n or (solver.rough and n_nodes != _N_NODES[-1]):
                break
            try:
                values = uncertainty.draw(pairs[:, row]).tolist()
                of_pair = (row, 0), (row, 1)
                for at, each in zip(of_pair, values, strict=True):
                    if at not in drawn:
                        drawn[at] = uncertainty.described(each), []
                    if at not in known:
                        known[at] = solver.model(*drawn[at]), {}
                members = 1 + len(rows), 1 + n + len(rows)
                both = [solver.solve(known[x], i) for x, i in zip(of_pair, members, strict=True)]
            except LinkageVibrationError:  # numbers that are not possible
                continue
            for i, each in zip(members, both, strict=True):
                solver.keep(i, *each)
            rows.append(row)
            progress(len(rows) / n)
        stddev = solver.deviations()
        if not solver.rough and not _MOST_ROUGH < np.isnan(stddev).mean() < 1.0:
            break
    table = replace(table, parameter_stddev=stddev)
    if solver.rough or not table.places:
        return table
    arrays: dict[str, Any] = {f"ensemble_{k}": each for k, each in solver.arrays.items()}
    arrays |= {name: rounded(arrays[name]) for name in PACKED}
    coordinates = np.zeros((2, n, len(uncertainty.numbers)))
    coordinates[:, : len(rows)] = pairs[:, rows]
    arrays["ensemble_coordinates"] = np.concatenate(coordinates).astype(np.float32)
    return replace(table, ensemble_alpha3=solver.nodes, **arrays)


class _Solver:
    """Solves members at the nodes, and follows their modes from those of the mechanism itself."""

    def __init__(self, table: Table, sampler: Sampler, n_nodes: int, n_members: int) -> None:
        self._table, self._kinematics = table, sampler.model.kinematics
        self._half = sampler.model.half
        self._places: Sequence[Place] = table.member_outputs
        self._limit = reach(table.band)
        few = _nodes(table, 3).tolist()
        # The table's modes count, too, where they lie above the band's reach.
        numbers = table.evaluate(np.array(few))[:, : table.n_modes]
        top = math.tau * float(np.nanmax(numbers))
        highest, self._slow = max(self._limit, top), _CLEAR * top
        exact = [_oscillating(each.damped)[0] for each in map(sampler.solution, few)]
        for self._mesh, self._highest in itertools.product(_COARSER, (_DAMPED * highest, math.inf)):
            model = self.model(sampler.model.mechanism, [])
            damped = rows_of(_damped(model.stack(np.array(few)), self._highest))
            coarse = [_oscillating(each)[0] for each in damped]
            if all(_agree(*both, highest) for both in zip(coarse, exact, strict=True)):
                break
        self._mass = model.system.mass
        every = _nodes(table, 2 * n_nodes - 1)
        self.nodes, self._between = every[::2], every[1::2]
        angles = self.nodes, self._between
        self._at, self._at_between = (stroke_variable(x, table.toggles) for x in angles)
        self._matrix = interpolation_matrix(self._at, self._at_between)
        modes = self._solved(model, every)
        self.own = model, dict(zip(every.tolist(), modes, strict=True))
        solved = modes[::2]
        n_kept = max(table.n_modes, *(int((np.abs(x.poles) < self._limit).sum()) for x in solved))
        gaps = [
            np.diff(np.log(np.abs(x.poles[: n_kept + 1]))).min(initial=math.inf) for x in solved
        ]
        self._base = first_widest(np.array(gaps))
        # Shapes that members are followed from: those of the mechanism itself by nodes.
        self._own_shapes = {self._base: solved[self._base].shapes[:, :n_kept]}
        self._rough, self._n_lost = list[int](), 0
        base = sampler.model.mechanism.base
        n_rows, n_mounts = len(self._places), len(base.mounts) if base else 0

        def unknown(kind: type, *shape: int) -> NDArray[Any]:
            return np.full((n_members, *shape), math.nan, dtype=kind)

        # The numbers of all members, as `Table` has them; NaN where they are not known.
        self.arrays = {
            "poles": unknown(np.complex64, n_nodes, n_kept),
            "shapes": unknown(np.complex64, n_nodes, n_rows, n_kept),
            "far": unknown(np.float32, n_nodes, n_rows, len(table.places)),
            "static": unknown(np.float32, n_nodes, len(table.forces)),
            "mounts": unknown(np.float32, n_mounts, 2, 2),
        }
        # Of the modes of the table, in the order of their frequencies, ln(frequency) and ln(ratio).
        self._ranks, self._n_overdamped = self._ranks_of(solved), [x.n_overdamped for x in solved]
        both = zip(modes[1::2], self._ranks, strict=False)
        self._own_between = [_logarithms(own.poles[ranks]) for own, ranks in both]
        self._ranked = unknown(np.float64, n_nodes, 2, table.n_modes)
        self._missed = unknown(np.float64, 2, table.n_modes)  # by interpolation of these

    @property
    def rough(self) -> bool:
        """Whether the mechanism itself, or more members than can be left out, need more angles."""
        few = len(self.nodes) == _N_NODES[0]
        n_rough = len(self._rough) + few * self._n_lost
        return 0 in self._rough or n_rough > _MOST_ROUGH * len(self._ranked)

    def _ranks_of(self, solved: list[_Modes]) -> IntArray:
        """Return which poles at the nodes are those of the table, (n_nodes, n_modes), ascending."""
        ranks = []
        for row, here in zip(self._table.evaluate(self.nodes), solved, strict=True):
            tabulated = np.sort(row[: self._table.n_modes])  # NaN, overdamped, is last
            off = np.log(np.abs(here.poles)) - np.log(math.tau * tabulated)[:, np.newaxis]
            ranks.append(linear_sum_assignment(np.abs(np.nan_to_num(off, nan=100.0)))[1])
        return np.array(ranks)

    def deviations(self) -> FloatArray:
        """Return the standard deviations of the modes, as `Table.parameter_stddev` has them.

        Damping ratios count as lognormal unless their logarithms are skew, or in two groups, as
        where modes change places: few members have the tail that makes up the deviation.
        """
        table, n = self._table, self._table.n_modes
        angles, values = np.linspace(*table.alpha3_range, N_ANGLES), self._ranked[1:]
        mean, logs = values.mean(axis=0), values.std(axis=0)
        cubes, fourths = (((values - mean)[:, :, 1] ** k).mean(axis=0) for k in (3, 4))
        square = logs[:, 1] ** 2
        lognormal = np.exp(mean[:, 1] + square / 2.0) * np.sqrt(np.expm1(square))
        straight = (np.abs(cubes) < _SKEW * logs[:, 1] ** 3) & (fourths > _GROUPS * square**2)
        damping = np.where(straight, lognormal, np.exp(values[:, :, 1]).std(axis=0))
        spread = np.stack([logs[:, 0], damping], axis=1)
        at, over = self._at, stroke_variable(angles, table.toggles)
        unknown = PchipInterpolator(at, np.isnan(spread).astype(float))(over) > 0.0
        n_between = len(self._between)
        squares = np.nan_to_num(np.square(self._missed[1:]), nan=math.inf)
        firsts = np.roll(range(n_between), 1)  # of the members that were compared in each interval
        missed = np.sqrt([squares[i::n_between].mean(axis=0) for i in firsts])
        wide = missed > _MISSED * np.minimum(logs[:-1], logs[1:]) + _LEAST
        unknown |= wide[np.clip(np.searchsorted(self.nodes, angles) - 1, 0, n_between - 1)]
        spread = np.where(unknown, math.nan, PchipInterpolator(at, np.nan_to_num(spread))(over))
        frequencies = table.evaluate(angles)[:, :n]
        order = np.argsort(frequencies, axis=1)[:, np.newaxis].repeat(2, axis=1)
        stddev = np.empty_like(spread)
        np.put_along_axis(stddev, order, spread, axis=2)
        stddev[np.isnan(frequencies)[:, np.newaxis].repeat(2, axis=1)] = math.nan
        return np.ascontiguousarray(stddev.swapaxes(0, 1))

    def solve(
        self, known: tuple[LinkageModel, dict[float, _Modes]], member: int
    ) -> tuple[LinkageModel, list[_Modes], _Modes]:
        """Return the model of a member, and its modes at the nodes and at one angle between two."""
        model, modes = known
        angles = [*self.nodes.tolist(), float(self._between[member % len(self._between)])]
        if new := [angle for angle in angles if angle not in modes]:
            modes.update(zip(new, self._solved(model, np.array(new)), strict=True))
        *solved, check = (modes[angle] for angle in angles)
        return model, solved, check

    def keep(self, member: int, model: LinkageModel, solved: list[_Modes], check: _Modes) -> None:
        """Keep the numbers of a member: its poles are followed from node to node."""
        numbers = {k: a[member] for k, a in self.arrays.items()}
        poles = np.full(numbers["poles"].shape, math.nan, dtype=complex)
        if model.mechanism.base is not None:
            mounts = model.mechanism.base.mounts
            numbers["mounts"][:] = [(mount.stiffness, mount.damping) for mount in mounts]
        for node, here in enumerate(solved):
            # Or else ranks are of other modes.
            known = here.n_overdamped == self._n_overdamped[node]
            if known and self._ranks[node].max() < len(here.poles):
                self._ranked[member, node] = _logarithms(here.poles[self._ranks[node]])
        shapes = self._followed(solved)
        for node, (order, _, signs) in shapes.items():
            here = solved[node]
            rows = here.rows[:, order] * signs
            near = (rows[:, np.newaxis] * rows[: len(self._table.places)] / here.poles[order]).real
            poles[node], numbers["shapes"][node] = here.poles[order], rows
            numbers["far"][node] = here.flexibility + 2.0 * near.sum(axis=2)
            numbers["static"][node] = here.static
        if member == 0:
            self._own_shapes = {node: vectors for node, (_, vectors, _) in shapes.items()}
        self._n_lost += len(shapes) < len(self.nodes)
        self._check(member, check.poles, poles)
        numbers["poles"][:] = poles

    def _followed(self, solved: list[_Modes]) -> dict[int, _Kept]:
        """Return the indices of the modes that are kept at each node, their shapes, and signs.

        They are the modes of the mechanism itself. A member in which these are mixed has its own
        order, as only its poles and residues matter.
        """
        outwards = *range(self._base, len(solved)), *range(self._base - 1, -1, -1)
        n_kept = self.arrays["poles"].shape[-1]
        for start in (self._own_shapes, {self._base: solved[self._base].shapes[:, :n_kept]}):
            found = dict[int, _Kept]()
            for node in (*outwards, *outwards[::-1]):
                beside = [found[i][1] for i in (node - 1, node + 1) if i in found]
                for before in (*beside, *([start[node]] if node in start else ())):
                    if node not in found:
                        order, signs = self._continued(before, solved[node].shapes)
                        if len(order):
                            found[node] = order, solved[node].shapes[:, order] * signs, signs
            if len(found) == len(solved):
                break
        return found

    def _check(self, member: int, here: ComplexArray, poles: ComplexArray) -> None:
        """Note by how much interpolation misses a member; discard its poles if by too much."""
        between, ranked = member % len(self._between), self._ranked[member]
        if np.isfinite(ranked).all():
            curve = PchipInterpolator(self._at, ranked - self._ranked[0])(self._at_between[between])
            change = _logarithms(here[self._ranks[between]]) - self._own_between[between]
            self._missed[member] = curve - change
        if np.isfinite(poles).all():
            off = np.exp(self._matrix[between] @ np.log(poles))[:, np.newaxis] - here
            share = np.abs(off) / np.abs(here.real)
            if share[linear_sum_assignment(share)].max() > _BETWEEN:
                self._rough.append(member)
                poles[:] = math.nan

    def _continued(self, before: ComplexArray, here: ComplexArray) -> tuple[IntArray, FloatArray]:
        """Return which shapes continue others, and their signs; none if that is not clear."""
        product = before.conj().T @ self._mass @ here
        sizes = [(x.conj() * (self._mass @ x)).sum(axis=0).real for x in (before, here)]
        criterion = np.abs(product) ** 2 / np.outer(*sizes)
        order = linear_sum_assignment(criterion, maximize=True)[1]
        pairs = np.arange(len(order)), order
        if len(order) < len(product) or (criterion[pairs] <= _UNCLEAR).any():
            order, pairs = order[:0], (order[:0], order[:0])
        return order, np.where(product[pairs].real < 0.0, -1.0, 1.0)

    def model(self, mechanism: Mechanism, kept: list[LinkageModel]) -> LinkageModel:
        """Return the model of a member, and keep that of its vertical half.

        That of another mesh gives the lateral half the same forces at rest, as statics are exact.
        """
        coarse = self._coarse(mechanism)
        if not kept:
            kept.append(LinkageModel(coarse, kinematics=self._kinematics.nearby(coarse)))
        if self._half == "vertical":
            return kept[0]
        return LinkageModel(coarse, half="lateral", vertical=kept[0])

    def _coarse(self, mechanism: Mechanism) -> Mechanism:
        """Return a mechanism whose links have fewer elements, and whose cylinders reach further."""
        springs = tuple(
            replace(s, stiffness=replace(s.stiffness, margin=_BEYOND * s.stiffness.stroke))
            if isinstance(s.stiffness, Cylinder)
            else s
            for s in mechanism.springs
        )
        return replace(coarser(mechanism, *self._mesh), springs=springs)

    def _solved(self, model: LinkageModel, angles: FloatArray) -> list[_Modes]:
        """Return the modes of a member at angles, rad."""
        stack, solved = model.stack(angles), []
        where = stack.configuration, stack.joining
        rows = model.output_rows(self._places, *where)
        n_places, n_forces = len(self._table.places), len(self._table.forces)
        static = np.empty((len(angles), 0))
        if n_forces:
            static = model.forces.at_rest(*where, stack.coupled, rows[..., -n_forces:, :])
        every = rows @ stack.modes.shapes[..., np.newaxis, :, :]
        damped = rows_of(_damped(stack, self._highest))
        each = stack.modes.omega, stack.modes.shapes, damped, every, static
        for omega, shapes, modes, powers, at_rest in zip(*each, strict=True):
            poles, turn = _oscillating(modes)
            near = powers[..., : len(turn)] @ turn
            rows = near[0] + poles * near[1] + poles**2 * near[2]
            rest, k = powers[0].real, modes.stiffness
            slow = (k.real > MECHANISM**2) & (k.real < self._slow**2)
            here = _Modes(
                poles,
                np.asarray(shapes[:, : len(turn)] @ turn),
                rows,
                rest / omega**2 @ rest[:n_places].T,
                at_rest,
                int(((k.real <= modes.decay**2 / 4.0) & slow).sum()),
            )
            solved.append(here)
        return solved


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


def _damped(solution: Solution, highest: float) -> DampedModes:
    """Return the damped modes of a solution, or of a stack, by undamped ones up to rad/s."""
    omega = solution.modes.omega
    n = int((omega <= highest).sum(axis=-1).max())
    return damp_modes(solution.coupled, omega[..., :n], solution.vectors[..., :n])


def _oscillating(damped: DampedModes) -> tuple[ComplexArray, ComplexArray]:
    """Return the oscillating poles, ascending, (k,), rad/s, and their shapes, (n, k)."""
    if damped.poles is not None:
        return damped.oscillating, damped.oscillating_shapes
    root = np.sqrt(damped.stiffness - damped.decay**2 / 4.0)
    poles = np.asarray(1j * root - damped.decay / 2.0)
    turn = np.eye(len(root)) if damped.shapes is None else damped.shapes[0]
    upper = oscillating_indices(poles)
    return poles[upper], np.asarray(turn[:, upper] / np.sqrt(2j * root[upper]))


def _logarithms(poles: ComplexArray) -> FloatArray:
    """Return ln(size) and ln(damping ratio) of poles, (2, n)."""
    size = np.abs(poles)
    return np.log([size, -poles.real / size])


def _agree(coarse: ComplexArray, poles: ComplexArray, limit: float) -> bool:
    """Return whether coarser bodies have the poles of the model up to a limit, rad/s."""
    poles = poles[np.abs(poles) < limit]
    if len(coarse) < len(poles):
        return False
    off = np.abs(coarse[: len(poles)] - poles)
    return bool((off <= _NEAR * np.abs(poles.real)).all())
