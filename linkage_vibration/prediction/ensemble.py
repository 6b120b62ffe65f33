# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Responses of the members of a table's ensemble, of which each is the model with other numbers.

The response of a member is that of its own modes, and what the modes of the mechanism itself leave
of the table's response: modes above the band, and what coarser bodies neglect.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.forces import reference
from linkage_vibration.mechanics.model import Place
from linkage_vibration.mechanics.uncertainty import balanced
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.ground import (
    N_FREQUENCIES,
    GroundLevels,
    Half,
    Terrain,
    ground_lines,
    ground_squares,
    halves_of,
    line_weights,
    weighted,
)
from linkage_vibration.prediction.level_cache import Arrays, Keep, Kept, computed
from linkage_vibration.prediction.loads import UnitLoad, soil_motion, weights_at
from linkage_vibration.table.interpolation import interpolation_matrix, stroke_variable
from linkage_vibration.table.table import Table

Singles = NDArray[np.float32]

_FEWER = 4  # Ratios of members to the mechanism need a fourth of the frequencies of its levels.
_SLOWEST, _FASTEST = 0.3, 30.0  # m/s; the ratios are tabulated between these, and constant beyond
_N_ANGLES, _N_SPEEDS = 25, 128


def load_factors(
    excitations: Sequence[Excitation], coordinates: FloatArray | Singles
) -> tuple[FloatArray, FloatArray]:
    """Return factors of amplitudes and of frequencies of the members, (n_excitations, n_members).

    ln(amplitude) and frequency are normal. Both members of a pair, in both halves, have the same
    draws, which do not correlate with the numbers of the mechanism: `Table.ensemble_coordinates`.
    """
    n, half = len(excitations), len(coordinates) // 2
    same = coordinates[:half] + coordinates[half:]
    taken = np.column_stack([np.ones(half), same[:, same.any(axis=0)]])
    generator, room = np.random.default_rng(0), half - taken.shape[1]
    parts = [balanced(generator, taken, room) for _ in range(0, 2 * n, room)]
    normal = np.tile(np.hstack(parts)[:, : 2 * n].T, 2)
    loads = [each.load or each.terrain for each in excitations]
    amplitude = np.array([[getattr(load, "relative_stddev", 0.0)] for load in loads])
    frequency = np.array([[each.relative_stddev] for each in excitations])
    return np.exp(amplitude * normal[:n]), np.maximum(1.0 + frequency * normal[n:], 0.0)


class _Modes(NamedTuple):
    """The modes of members at angles, in single precision; the first axes are free.

    With s = i w, a response is the sum of (a + b w^2 + s c) shape / (k - w^2 + s d) over the modes
    and both parts of their shapes, and of what the other modes add.
    """

    stiffness: Singles  # (..., 1, 2 n_modes): k, for each part
    damping: Singles  # likewise: d
    numerators: Singles  # (..., 3, n_loads, 2 n_modes): a, b and c
    outputs: Singles  # (..., 2 n_modes, n_outputs): both parts of the shapes
    far: Singles  # (..., 2, n_loads, n_outputs): what the other modes add, and that times s
    references: Singles  # (..., n_forces), N

    def at(self, which: Any) -> "_Modes":
        """Return those with these indices."""
        return _Modes(*(part[which] for part in self))

    def responses(self, omega: FloatArray, loads: IntArray) -> Singles:
        """Return responses to unit loads, (..., 2, n_excitations, n_outputs): both parts."""
        n_shapes = self.outputs.shape[-2]
        w = omega.astype(np.float32)[..., np.newaxis].repeat(n_shapes, axis=-1)
        w2, numerators = w * w, self.numerators.take(loads, axis=-2)
        a, b, c = (numerators[..., i, :, :] for i in range(3))
        far = self.far.take(loads, axis=-2)
        with np.errstate(invalid="ignore"):  # NaN where a member's numbers are not possible
            real, imaginary = self.stiffness - w2, self.damping * w
            square = real * real + imaginary * imaginary
            real, imaginary = real / square, imaginary / square
            a, c = a + b * w2, c * w
            factors = np.stack([a * real + c * imaginary, c * real - a * imaginary], axis=-3)
            rows = factors.reshape(*factors.shape[:-3], -1, n_shapes) @ self.outputs
        responses = rows.reshape(*factors.shape[:-1], self.outputs.shape[-1])
        far[..., 1, :, :] *= w[..., :1]
        responses += far
        return np.asarray(responses)


class EnsembleResponses:
    """Finds responses of the members to unit loads, as `levels.LevelTable` needs them.

    ``table_responses`` returns the table's, (n, 2, n_excitations, n_outputs), at nodes, (n,), and
    rad/s, (n, n_excitations). ``n_forces`` pins and cylinders have reference forces.
    """

    def __init__(
        self,
        table: Table,
        loads: Sequence[UnitLoad],
        outputs: Sequence[Place],
        n_forces: int,
        table_responses: Callable[[IntArray, FloatArray], FloatArray] | None = None,
        kept: Kept = lambda compute: compute(),
    ) -> None:
        self._table, self._n_forces = table, n_forces
        self._table_responses = table_responses
        self._variables = stroke_variable(table.ensemble_alpha3, table.toggles)
        self.n = len(table.ensemble_poles) - 1  # Number of members beside the mechanism itself
        nodes = [*kept(lambda: self._at_nodes(outputs, loads)).values()]
        self._shapes = [node.shape[2:] for node in nodes]
        self._values = np.concatenate([node.reshape(*node.shape[:2], -1) for node in nodes], axis=2)
        self._nominal = self._modes(self._values[:, 0])

    def at(self, alpha3: FloatArray) -> _Modes:
        """Return the modes at angles, (n,), rad: (n, n_members + 1, ...)."""
        at = stroke_variable(alpha3, self._table.toggles)
        weights = interpolation_matrix(self._variables, at).astype(np.float32)
        # The last bits of a product by BLAS depend on its number of threads.
        values = np.einsum("nk,kv->nv", weights, self._values.reshape(len(self._variables), -1))
        return self._modes(values.reshape(len(alpha3), self.n + 1, -1))

    def responses(
        self, alpha3: FloatArray, modes: _Modes, omega: FloatArray, loads: IntArray
    ) -> Singles:
        """Return responses to unit loads, (n, n_members, 2, n_excitations, n_outputs)."""
        assert self._table_responses is not None
        nodes = self._table.ensemble_alpha3
        after = np.clip(nodes.searchsorted(alpha3), 1, len(nodes) - 1)
        share = (alpha3 - nodes[after - 1]) / (nodes[after] - nodes[after - 1])
        around, of_table = np.concatenate([after - 1, after]), np.tile(omega[:, 0], (2, 1))
        # What the table adds to the modes of the mechanism itself.
        own = self._nominal.at(around).responses(of_table, loads)
        left = self._table_responses(around, of_table)[..., : own.shape[-1]] - own
        weights = np.concatenate([1.0 - share, share]).reshape(-1, 1, 1, 1)
        before, behind = (
            (weights * left).astype(np.float32).reshape(2, len(alpha3), *left.shape[1:])
        )
        # One after the other, so that what is computed for all members stays in the cache.
        rows = [modes.at(np.s_[row, 1:]).responses(w, loads) for row, w in enumerate(omega)]
        responses = np.stack(rows)
        responses += (before + behind)[:, np.newaxis]
        return responses

    def _modes(self, values: Singles) -> _Modes:
        """Return the modes of values, (..., n_values), as `_at_nodes` arranges them."""
        ends = np.cumsum([math.prod(shape) for shape in self._shapes])[:-1]
        parts = zip(np.split(values, ends, axis=-1), self._shapes, strict=True)
        poles, shapes, loads, far, static = (
            part.reshape(*values.shape[:-1], *shape) for part, shape in parts
        )
        size, phase, k = np.exp(poles[..., 0, :]), poles[..., 1, :], poles.shape[-1]
        x, y = 2.0 * size * np.cos(phase), 2.0 * size * np.sin(phase)
        # Both parts of the poles, of the shapes at the loads, and of those at their rates.
        px, py = (np.repeat(each[..., np.newaxis, :], loads.shape[-2], axis=-2) for each in (x, y))
        fx, rx, fy, ry = (loads[..., i, j, :, :] for i in (0, 1) for j in (0, 1))
        numerators = np.empty((*values.shape[:-1], 3, loads.shape[-2], 2 * k), np.float32)
        numerators[..., 0, :, :k] = -(fx * px + fy * py)
        numerators[..., 0, :, k:] = fy * px - fx * py
        numerators[..., 1, :, :k] = -2.0 * rx
        numerators[..., 1, :, k:] = 2.0 * ry
        numerators[..., 2, :, :k] = 2.0 * fx - (rx * px + ry * py)
        numerators[..., 2, :, k:] = (ry * px - rx * py) - 2.0 * fy
        forces = np.moveaxis(static.astype(float), -1, 0)
        references = reference(self._table.forces, forces, self._table.reference_force)
        references = references[: self._n_forces]
        return _Modes(
            np.concatenate([size * size] * 2, axis=-1)[..., np.newaxis, :],
            -np.concatenate([x, x], axis=-1)[..., np.newaxis, :],
            numerators,
            shapes.reshape(*values.shape[:-1], -1, shapes.shape[-1]),
            far,
            np.moveaxis(references.astype(np.float32), 0, -1),
        )

    def _at_nodes(self, places: Sequence[Place], loads: Sequence[UnitLoad]) -> Arrays:
        """Return the parts of `_Modes` at the nodes, (n_nodes, n_members, ...), as real numbers."""
        outputs = [self._table.member_outputs.index(place) for place in places]
        table, n = self._table, len(self._table.places)
        modal = table.ensemble_poles, table.ensemble_shapes, table.ensemble_far
        poles, rows, far = (np.moveaxis(each, 1, 0) for each in modal)
        angles = table.ensemble_alpha3.tolist()
        weights = np.array([self._weights(loads, angle) for angle in angles])
        inputs = np.einsum("jeqmp,jmpk->jmqek", weights, rows[:, :, :n], optimize=True)
        both = [np.log(poles), rows[:, :, outputs].swapaxes(2, 3), inputs]
        parts = [np.stack([each.real, each.imag], axis=2) for each in both]
        parts.append(np.einsum("jeqmp,jmop->jmqeo", weights, far[:, :, outputs], optimize=True))
        parts.append(np.moveaxis(table.ensemble_static, 1, 0))
        names = "poles", "outputs", "inputs", "far", "static"
        return {
            name: np.ascontiguousarray(part, np.float32)
            for name, part in zip(names, parts, strict=True)
        }

    def _weights(self, loads: Sequence[UnitLoad], alpha3: float) -> FloatArray:
        """Return the weights of loads at an angle, (n_loads, 2, n_members, n_places)."""
        table, mounts = self._table, self._table.ensemble_mounts.astype(float)
        nominal = weights_at(loads, table.places, alpha3).transpose(2, 0, 1)
        weights = nominal[:, :, np.newaxis].repeat(self.n + 1, axis=2)
        for row, load in zip(weights, loads, strict=True):
            # The stiffness and the damping of a mount are numbers of the member.
            for mount, place in zip(load.mounts, load.places, strict=False):
                of_place = row[..., table.places.index(place)]
                numbers = np.where(of_place, mounts[:, mount, :, "xz".index(place[1])].T, 1.0)
                of_place *= numbers / numbers[:, :1]
        return weights


class GroundMembers:
    """Compares the levels of members by the ground, of the response point and of forces."""

    def __init__(
        self,
        table: Table,
        mechanism: Mechanism,
        terrain: Terrain,
        outputs: Sequence[Place],
        n_lines: int = N_FREQUENCIES,
        keep: Keep = computed,
    ) -> None:
        self._table, self._mechanism, self._terrain, self._keep = table, mechanism, terrain, keep
        self._outputs, self._n_lines = outputs, n_lines
        self._angles = np.linspace(*table.alpha3_range, _N_ANGLES)
        self._speeds = np.linspace(math.log(_SLOWEST), math.log(_FASTEST), _N_SPEEDS)

    @cached_property
    def logs(self) -> Singles:
        """What is interpolated, (n_angles, n_speeds, n_members, n_outputs), at its first use."""
        return np.asarray(self._keep("members", self._tabulated)["logs"])

    def _tabulated(self) -> Arrays:
        """Compute the `logs`."""
        n_members = len(self._table.ensemble_poles)
        shape = _N_ANGLES, n_members, len(self._outputs), _N_SPEEDS
        squares = np.zeros(shape)
        for half in halves_of(self._table, self._mechanism):
            rows = [i for i, place in enumerate(self._outputs) if half.knows(place)]
            squares[:, :, rows] += self._squares(half, rows)
        with np.errstate(divide="ignore", invalid="ignore"):  # log(0) without ground
            logs = np.log(squares)
            logs = np.moveaxis(logs[:, 1:] - logs[:, :1], 3, 1)
        known = np.where(np.isposinf(logs), math.nan, logs)
        return {"logs": np.ascontiguousarray(known, np.float32)}

    def _squares(self, half: Half, known: list[int]) -> FloatArray:
        """Return mean squares in a half, (n_angles, n_members, n_known, n_speeds), or NaN."""
        table, terrain, mounts = half.source, self._terrain, half.mounts
        assert isinstance(table, Table)
        if not np.array_equal(table.ensemble_coordinates, self._table.ensemble_coordinates):
            return np.full((1, 1, 1, 1), math.nan)
        lines = ground_lines(terrain, self._n_lines // _FEWER)
        loads = [soil_motion(f"base:{mount.name}.z", self._mechanism) for mount in mounts]
        members = EnsembleResponses(table, loads, [self._outputs[i] for i in known], 0)
        omega = 2.0 * math.pi * np.tile(lines, len(mounts))[np.newaxis]
        every = np.arange(len(mounts)).repeat(len(lines))
        orders, values = [1 - min(i, 1) for i in known] * (members.n + 1), []
        weights: Singles | None = None  # They are the same at all angles.
        for angle in self._angles:
            responses = members.at(angle[np.newaxis]).at(0).responses(omega, every)
            transfer = (responses[:, 0] + 1j * responses[:, 1]).swapaxes(1, 2)
            transfer = transfer.reshape(-1, len(mounts), len(lines))
            squares = ground_squares(transfer, orders, mounts, terrain, lines, half.difference)
            if weights is None:
                weights = line_weights(squares, np.exp(self._speeds))
            values.append(weighted(squares, weights))
        return np.reshape(values, (_N_ANGLES, members.n + 1, len(known), _N_SPEEDS))

    def levels(
        self, nominal: GroundLevels, alpha3: FloatArray, speed: FloatArray, amplitudes: FloatArray
    ) -> GroundLevels:
        """Return levels of the members, (n n_members), from those of the mechanism itself, (n,)."""
        every = nominal.rows(np.arange(len(alpha3)).repeat(len(amplitudes)))
        if np.isnan(nominal.velocity).all():
            return every
        shares = self.shares(alpha3, speed) * (amplitudes * amplitudes)[:, np.newaxis]
        shares = shares.reshape(-1, shares.shape[-1]).T
        return replace(
            every, velocity=every.velocity * np.sqrt(shares[0]), forces2=every.forces2 * shares[1:]
        )

    def shares(self, alpha3: FloatArray, speed: FloatArray) -> FloatArray:
        """Return mean squares of members over the mechanism's, (n, n_members, n_outputs)."""
        log_speed = np.log(np.clip(speed, _SLOWEST, _FASTEST))
        rows, columns = _between(self._angles, alpha3), _between(self._speeds, log_speed)
        logs = sum((a * b) * self.logs[i, j] for i, a in rows for j, b in columns)
        return np.asarray(np.exp(logs))


def _between(grid: FloatArray, values: FloatArray) -> list[tuple[IntArray, FloatArray]]:
    """Return the two neighbours of values, (n,), on an even grid, and their weights, (n, 1, 1)."""
    place = (values - grid[0]) / (grid[1] - grid[0])
    first = np.clip(np.nan_to_num(place).astype(np.int64), 0, len(grid) - 2)
    after = (place - first).astype(np.float32).reshape(-1, 1, 1)
    return [(first, 1.0 - after), (first + 1, after)]
