# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Responses of the members of a table's ensemble, of which each is the model with other numbers.

The response of a member is that of its own modes, and what the modes of the mechanism itself leave
of the table's response: modes above the band, and what coarser bodies neglect.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.forces import magnitudes, reference
from linkage_vibration.mechanics.model import Place
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.ground import (
    LINES,
    GroundLevels,
    Terrain,
    contract,
    ground_lines,
    ground_squares,
    vertical_mounts,
)
from linkage_vibration.prediction.loads import UnitLoad, soil_motion
from linkage_vibration.table.interpolation import interpolation_matrix, stroke_variable
from linkage_vibration.table.table import Table

_FEWER = 4  # A fourth of the lines of a ground shows how members differ from the mechanism itself.
_SLOWEST, _FASTEST = 0.3, 30.0  # m/s; beyond these speeds they differ as there
_N_ANGLES, _N_SPEEDS = 25, 128


def draws(excitations: Sequence[Excitation], n_members: int) -> tuple[FloatArray, FloatArray]:
    """Return factors of amplitudes and of frequencies of the members, (n_excitations, n_members).

    Logarithms of amplitudes are normal, and frequencies are normal. Members of opposite signs, in
    the first and the second half, have the same draws, so that these do not correlate with the
    numbers of the mechanism.
    """
    n, half = len(excitations), n_members // 2
    generator, parts = np.random.default_rng(0), []
    for _ in range(0, 2 * n, half - 1):  # columns without a mean, which are orthogonal
        columns = generator.standard_normal((half, half - 1))
        parts.append(np.linalg.qr(columns - columns.mean(axis=0))[0] * math.sqrt(half))
    normal = np.tile(np.hstack(parts)[:, : 2 * n].T, 2)
    amplitude, frequency = (
        np.array([[value] for value in values])
        for values in (
            [getattr(one.load or one.terrain, "relative_stddev", 0.0) for one in excitations],
            [one.relative_stddev for one in excitations],
        )
    )
    return np.exp(amplitude * normal[:n]), np.maximum(1.0 + frequency * normal[n:], 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Modes:
    """The modes of all members at an angle, the mechanism itself first, or its own at angles."""

    poles: ComplexArray  # (n_members, 1, k), rad/s
    outputs: FloatArray  # (n_members, 2 k, n_outputs): both parts of the shapes
    # (2, n_members, n_loads, k): shapes at the loads, and at their parts times s = i w
    loads: ComplexArray
    far: FloatArray  # (2, n_members, n_loads, n_outputs): what the other modes add, likewise
    references: FloatArray  # (n_members, n_forces), N

    def responses(self, omega: FloatArray, loads: IntArray, members: slice) -> FloatArray:
        """Return responses to unit loads, (n_members, 2, n_excitations, n_outputs): both parts.

        Parameters
        ----------
        omega : ndarray, (n_members or 1, n_excitations)
            rad/s.
        loads : ndarray, (n_excitations,)
            The load of each excitation, by its index.
        members : slice
            Those that are wanted.
        """
        w, poles = omega[..., np.newaxis], self.poles[members]
        (force, rate), s = self.loads[:, members].take(loads, axis=2), 1j * w
        far = self.far[:, members].take(loads, axis=2)
        with np.errstate(invalid="ignore"):  # NaN where a member's numbers are not possible
            upper = (force + s * rate) / (s - poles)
            lower = (force.conj() + s * rate.conj()) / (s - poles.conj())
            # It is (x + i y) upper + (x - i y) lower with x + i y at an output, by real products.
            both = np.concatenate([upper + lower, 1j * (upper - lower)], axis=-1)
            factors = np.stack([both.real, both.imag], axis=1)
            responses = factors @ self.outputs[members, np.newaxis]
        responses[:, 0] += far[0]
        responses[:, 1] += w * far[1]
        return np.asarray(responses)


class Members:
    """Finds responses of the members to unit loads, as `levels.LevelTable` needs them.

    Parameters
    ----------
    table : Table
        With an ensemble.
    loads : sequence of UnitLoad
    outputs : sequence of Place
    n_forces : int
        Pins and cylinders whose reference forces are needed.
    table_responses : callable
        Returns the table's responses, (n, 2, n_excitations, n_outputs), at some nodes of the
        ensemble and rad/s of each excitation, (n_excitations,).
    """

    def __init__(
        self,
        table: Table,
        loads: Sequence[UnitLoad],
        outputs: Sequence[Place],
        n_forces: int,
        table_responses: Callable[[slice, FloatArray], FloatArray] | None = None,
    ) -> None:
        self._table, self._n_forces = table, n_forces
        self._table_responses = table_responses
        self._variables = stroke_variable(table.ensemble_alpha3, table.toggles)
        self.n = len(table.ensemble_poles) - 1
        """Number of members beside the mechanism itself."""
        rows = [*table.places, *table.forces]
        nodes = self._at_nodes([rows.index(place) for place in outputs], loads)
        self._shapes = [node.shape[2:] for node in nodes]
        values = np.concatenate([node.reshape(*node.shape[:2], -1) for node in nodes], axis=2)
        # Most loads have neither rates nor imaginary parts.
        self._used, self._n_values = np.flatnonzero(values.any(axis=(0, 1))), values.shape[2]
        self._values = values.take(self._used, axis=2).astype(np.float32)
        self._nominal = self._modes(self._values[:, 0])

    @property
    def arrays(self) -> tuple[FloatArray, NDArray[np.float32], IntArray]:
        """Nodes in the stroke variable, values, (n_nodes, n_members + 1, n_used), and their places.

        The mechanism itself comes first; the places are those in the parts of `_at_nodes`.
        """
        return self._variables, self._values, self._used

    def at(self, alpha3: float) -> _Modes:
        """Return the modes at an angle, rad."""
        at = stroke_variable(np.array([alpha3]), self._table.toggles)
        weights = interpolation_matrix(self._variables, at)[0].astype(np.float32)
        values = weights @ self._values.reshape(len(weights), -1)
        return self._modes(values.reshape(self.n + 1, -1))

    def responses(
        self, alpha3: float, modes: _Modes, omega: FloatArray, loads: IntArray
    ) -> FloatArray:
        """Return responses to unit loads, (n_members, 2, n_excitations, n_outputs): both parts.

        Parameters
        ----------
        alpha3, modes : float and _Modes
            rad, within the range of the table, and what is `at` it.
        omega : ndarray, (n_members, n_excitations)
            rad/s.
        loads : ndarray, (n_excitations,)
            The load of each excitation, by its index.
        """
        assert self._table_responses is not None
        nodes = self._table.ensemble_alpha3
        after = int(np.clip(np.searchsorted(nodes, alpha3), 1, len(nodes) - 1))
        share = (alpha3 - nodes[after - 1]) / (nodes[after] - nodes[after - 1])
        around = slice(after - 1, after + 1)
        # What the table adds to the modes of the mechanism itself.
        left = self._table_responses(around, omega[0])
        left = left - self._nominal.responses(omega[:1], loads, around)
        responses = modes.responses(omega, loads, slice(1, None))
        responses += (1.0 - share) * left[0] + share * left[1]
        return responses

    def _modes(self, values: NDArray[np.float32]) -> _Modes:
        """Return the modes of values, (n, n_used), each of them of a member or at an angle."""
        full = np.zeros((len(values), self._n_values))
        full[:, self._used] = values
        ends = np.cumsum([math.prod(shape) for shape in self._shapes])[:-1]
        parts = zip(np.split(full, ends, axis=1), self._shapes, strict=True)
        poles, outputs, loads, far, static = (part.reshape(-1, *shape) for part, shape in parts)
        forces = magnitudes(self._table.forces, static.T)[: self._n_forces]
        return _Modes(
            np.exp(poles[:, 0] + 1j * poles[:, 1])[:, np.newaxis],
            outputs.reshape(len(values), -1, outputs.shape[-1]),
            np.moveaxis(loads[:, 0] + 1j * loads[:, 1], 1, 0),
            np.moveaxis(far, 1, 0),
            reference(forces, self._table.reference_force).T,
        )

    def _at_nodes(self, outputs: list[int], loads: Sequence[UnitLoad]) -> list[FloatArray]:
        """Return the parts of `_Modes` at the nodes, (n_nodes, n_members, ...), as real numbers.

        They are logarithms of poles, outputs, inputs, what other modes add, and forces at rest.
        """
        table, n = self._table, len(self._table.places)
        every = table.ensemble_poles, table.ensemble_shapes, table.ensemble_far
        poles, rows, far = (np.moveaxis(each, 1, 0) for each in every)
        angles = table.ensemble_alpha3.tolist()
        weights = np.array([self._weights(loads, angle) for angle in angles])
        inputs = np.einsum("jeqmp,jmpk->jmqek", weights, rows[:, :, :n], optimize=True)
        both = [np.log(poles), rows[:, :, outputs].swapaxes(2, 3), inputs]
        return [
            *(np.stack([each.real, each.imag], axis=2) for each in both),
            np.einsum("jeqmp,jmop->jmqeo", weights, far[:, :, outputs], optimize=True),
            np.moveaxis(table.ensemble_static, 1, 0),
        ]

    def _weights(self, loads: Sequence[UnitLoad], alpha3: float) -> FloatArray:
        """Return the weights of loads at an angle, (n_loads, 2, n_members, n_places)."""
        table, mounts = self._table, self._table.ensemble_mounts.astype(float)
        weights = np.zeros((len(loads), 2, self.n + 1, len(table.places)))
        for row, load in zip(weights, loads, strict=True):
            for kind, values in enumerate(load.weights(alpha3)):
                for i, (place, value) in enumerate(zip(load.places, values.tolist(), strict=True)):
                    factor: FloatArray | float = 1.0
                    if load.mounts and value:  # the stiffness or the damping of a mount
                        coefficients = mounts[:, load.mounts[i], kind, "xz".index(place[1])]
                        factor = coefficients / coefficients[0]
                    row[kind, :, table.places.index(place)] += value * factor
        return weights


class GroundMembers:
    """Finds how the levels by the ground differ between the members and the mechanism itself.

    Parameters
    ----------
    table, mechanism : Table and Mechanism
        The table, with an ensemble, and its mechanism.
    terrain : Terrain
    outputs : sequence of Place
        The response point, then forces.
    n_lines : int
        Frequencies over which the levels of the mechanism itself are summed.
    """

    def __init__(
        self,
        table: Table,
        mechanism: Mechanism,
        terrain: Terrain,
        outputs: Sequence[Place],
        n_lines: int = LINES,
    ) -> None:
        mounts, lines = vertical_mounts(mechanism), ground_lines(terrain, n_lines // _FEWER)
        loads = [soil_motion(f"base:{mount.name}.z", mechanism) for mount in mounts]
        members = Members(table, loads, outputs, 0)
        low, high = table.alpha3_range
        self._angles = np.linspace(low, high, _N_ANGLES)
        self._speeds = np.linspace(math.log(_SLOWEST), math.log(_FASTEST), _N_SPEEDS)
        omega = 2.0 * math.pi * np.tile(lines, len(mounts))[np.newaxis]
        every = np.arange(len(mounts)).repeat(len(lines))
        orders, values = [1, *[0] * (len(outputs) - 1)] * (members.n + 1), []
        for angle in self._angles.tolist():
            responses = members.at(angle).responses(omega, every, slice(None))
            transfer = (responses[:, 0] + 1j * responses[:, 1]).swapaxes(1, 2)
            transfer = transfer.reshape(-1, len(mounts), len(lines))
            squares = ground_squares(transfer, orders, mounts, terrain, lines)
            values.append(contract(squares, np.exp(self._speeds)))
        shape = _N_ANGLES, members.n + 1, len(outputs), _N_SPEEDS
        with np.errstate(divide="ignore", invalid="ignore"):
            logs = np.log(np.reshape(values, shape))
            logs = np.moveaxis(logs[:, 1:] - logs[:, :1], 3, 1)
        self._logs = np.where(np.isposinf(logs), math.nan, logs).astype(np.float32)

    def levels(
        self, nominal: GroundLevels, alpha3: float, speed: float, amplitudes: FloatArray
    ) -> GroundLevels:
        """Return the levels of the members from one of the mechanism itself.

        The factors of amplitudes are (n_members,); accelerations are not those of members.
        """
        shares = self.shares(alpha3, speed) * amplitudes * amplitudes
        return replace(
            nominal,
            velocity=nominal.velocity * np.sqrt(shares[0]),
            forces2=nominal.forces2 * shares[1:],
        )

    def shares(self, alpha3: float, speed: float) -> FloatArray:
        """Return mean squares of members over those of the mechanism, (n_outputs, n_members).

        Parameters
        ----------
        alpha3, speed : float
            rad and m/s.
        """
        log_speed = math.log(min(max(speed, _SLOWEST), _FASTEST))
        rows, columns = (
            _between(each, value)
            for each, value in ((self._angles, alpha3), (self._speeds, log_speed))
        )
        logs = sum(a * b * self._logs[i, j] for i, a in rows for j, b in columns)
        return np.asarray(np.exp(logs.T))


def _between(grid: FloatArray, value: float) -> list[tuple[int, float]]:
    """Return the two neighbours of a value on an even grid, and their weights."""
    place = (value - grid[0]) / (grid[1] - grid[0])
    first = min(max(int(place), 0), len(grid) - 2)
    return [(first, first + 1.0 - place), (first + 1, place - first)]
