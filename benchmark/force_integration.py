# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Integrates the forces in the pins and cylinders of a linkage over time, from its matrices alone.

At each angle of a grid, the equations M u'' + C u' + K u = f of the assembly have complex modes,
w' = p w + phi^T f. Between two steps the excitations are linear, and then the integration is exact.
Where the crank passes from one angle of the grid to the next, the modes continue: the crank moves
slowly. The force of a pin on a link is what keeps the link in its dynamic equilibrium, M_link u'' +
C_link u' + K_link u, and higher modes follow without inertia. Nothing of the table, of levels, of
forces as places, or of severities is used.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig, null_space
from scipy.optimize import linear_sum_assignment

from linkage_vibration.mechanics.compatibility import Joining
from linkage_vibration.mechanics.coupling import UncoupledSystem
from linkage_vibration.mechanics.description import GROUND
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.loads import (
    BASE_ACCELERATION,
    BASE_DISPLACEMENT,
    FORCE,
    MOMENT,
    LoadKind,
)

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

STEP = 5e-4  # s
EVERY = 40  # steps in a block of 20 ms, in which the angle is one of the grid
GRID = math.radians(0.25)  # between the angles at which the assembly is solved
MODES = 12  # the lowest ones, up to 900 Hz on the shipped tractor
PART, WARM_UP = 40.0, 10.0  # s: parts are integrated side by side, each from a time before it
GRAVITY = 9.80665  # m/s2
LEAST = 0.1  # of the largest static force: what forces are compared with at least


@dataclass(frozen=True, eq=False)
class Run:
    """What a tractor does; arrays are (n,), at times with equal steps."""

    times: FloatArray  # s
    angle: FloatArray  # rad
    speeds: dict[Source, FloatArray]  # rpm or m/s

    @cached_property
    def travelled(self) -> dict[Source, FloatArray]:
        """Integrals of the speeds over time, (n,)."""
        step = self.times[1] - self.times[0]
        return {
            source: np.concatenate([[0.0], np.cumsum(0.5 * step * (speed[1:] + speed[:-1]))])
            for source, speed in self.speeds.items()
        }

    @property
    def blocks(self) -> int:
        """Number of whole blocks of the integration."""
        return int((self.times[-1] - self.times[0]) / (EVERY * STEP) + 1e-6)


@dataclass(frozen=True, eq=False)
class Modal:
    """The assembly at one angle of the grid."""

    poles: ComplexArray  # (n_modes,), one of each pair, rad/s
    shapes: ComplexArray  # (n, n_modes), on the coordinates of the components
    gains: ComplexArray  # (n_modes, n_inputs), per unit of a load
    forces: ComplexArray  # (n_rows, n_modes), of each row per modal coordinate
    rest: FloatArray  # (n_rows, n_inputs), static forces of the modes that are left out
    reference: FloatArray  # (n_places,), N or N m
    damping: FloatArray  # (n, n), with that of the mounts
    configuration: Configuration


class PinForces:
    """The forces in pins and cylinders of a linkage that excitations load.

    Parameters
    ----------
    model : LinkageModel
        Links of beams that are joined in pins, with springs and a base on mounts.
    excitations : sequence of Excitation
        Those without a load are left out.
    reach : (float, float)
        The smallest and the largest angle that occurs, rad.
    """

    def __init__(
        self, model: LinkageModel, excitations: Sequence[Excitation], reach: tuple[float, float]
    ) -> None:
        self._model, self._system = model, model.system
        self.excitations = [each for each in excitations if each.load is not None]
        self._inputs = list(dict.fromkeys(_input(each) for each in self.excitations))
        pins: dict[str, str] = {}
        for link in model.mechanism.links:
            for point, _ in link.points:
                pins.setdefault(point, link.name)
        self._pins = [(link, point) for point, link in pins.items()]
        counts = {link.name: link.count for link in model.mechanism.links}
        self._counts = np.array([counts[link] for link, _ in self._pins])
        self._springs = [spring.name for spring in model.mechanism.springs]
        self.names = [*(f"{link}:{point}" for link, point in self._pins), *self._springs]
        low, high = reach
        self._angles = np.linspace(low, high, math.ceil((high - low) / GRID) + 1)
        self._modal = [self._solved(float(self._angles[0]))]
        for angle in self._angles[1:].tolist():
            self._modal.append(self._aligned(self._modal[-1], self._solved(angle)))

    def _aligned(self, old: Modal, new: Modal) -> Modal:
        """Return modes in the order and with the signs in which they continue those of an angle."""
        turned = self._turn(old, new) @ old.shapes
        momentum = self._system.mass @ turned
        same = new.shapes.T @ (new.damping @ turned + momentum * old.poles)
        same += new.poles[:, np.newaxis] * (new.shapes.T @ momentum)
        order = linear_sum_assignment(-np.abs(same.T))[1]
        signs = np.where(same[order, np.arange(len(order))].real < 0.0, -1.0, 1.0)
        return replace(
            new,
            poles=new.poles[order],
            shapes=new.shapes[:, order] * signs,
            gains=new.gains[order] * signs[:, np.newaxis],
            forces=new.forces[:, order] * signs,
        )

    def _turn(self, old: Modal, new: Modal) -> FloatArray:
        """Return the matrix that keeps the global displacements of links that turn, (n, n)."""
        turn = np.eye(len(self._system.mass))
        for link in self._model.mechanism.links:
            by = new.configuration.angle(link.name) - old.configuration.angle(link.name)
            cos, sin = math.cos(by), math.sin(by)
            part = next(each for each in self._system.components if each.name == link.name)
            rows = self._system.rows[link.name]
            for i, dof in enumerate(part.dofs):
                if dof.direction == "x":
                    at = rows[[i, i + 1]]
                    turn[np.ix_(at, at)] = [[cos, sin], [-sin, cos]]
        return turn

    def _solved(self, alpha3: float) -> Modal:
        """Solve the assembly at an angle."""
        system = self._system
        configuration = self._model.kinematics.at(alpha3)
        joining = self._model.interface.join(configuration)
        stretch = self._widened(joining.elongation)
        stiffness = system.stiffness + stretch.T @ (joining.stiffness[:, np.newaxis] * stretch)
        damping = system.damping + stretch.T @ (joining.damping[:, np.newaxis] * stretch)
        basis = null_space(self._widened(joining.compatibility))
        m, c, k = (basis.T @ matrix @ basis for matrix in (system.mass, damping, stiffness))
        slow = np.hstack([np.linalg.solve(m, -k), np.linalg.solve(m, -c)])
        poles, vectors = eig(np.vstack([np.eye(len(m), 2 * len(m), len(m)), slow]))
        upper = np.flatnonzero(poles.imag > 0.0)
        kept = upper[np.argsort(np.abs(poles[upper]))][:MODES]
        poles, reduced = poles[kept], vectors[: len(m), kept]
        # phi^T (2 p M + C) phi = 1, so that w' = p w + phi^T f.
        size = (reduced * (2.0 * poles * (m @ reduced) + c @ reduced)).sum(axis=0)
        shapes = basis @ (reduced / np.sqrt(size))
        into = np.array([self._into(each, configuration, joining) for each in self._inputs]).T
        gains = shapes.T @ into
        elastic, viscous, inertia = self._rows(configuration, joining, system)
        forces = elastic @ shapes + viscous @ shapes * poles + inertia @ shapes * poles**2
        moved = basis @ np.linalg.solve(k, basis.T @ into)
        low = 2.0 * (forces @ (gains / -poles[:, np.newaxis])).real
        weight = self._weight(configuration)
        sag = basis @ np.linalg.solve(k, basis.T @ weight)
        held = elastic @ sag
        held[: 2 * len(self._pins)] -= weight[self._pin_rows()]
        reference = np.sqrt(self.squares(held[np.newaxis, :, np.newaxis])[0, :, 0])
        # Of equal links side by side, each carries its part; springs have another unit.
        first = reference[: len(self._pins)] / self._counts
        reference[: len(self._pins)] = np.maximum(first, LEAST * first.max()) * self._counts
        rest = elastic @ moved - low
        return Modal(poles, shapes, gains, forces, rest, reference, damping, configuration)

    def _widened(self, rows: FloatArray) -> FloatArray:
        """Return rows on the interface DoFs as rows on all coordinates."""
        return np.pad(rows, ((0, 0), (0, len(self._system.mass) - self._system.n_interface)))

    def _pin_rows(self) -> list[int]:
        """Return the coordinates along which pins act on links, two for each pin."""
        result = []
        parts = {part.name: part for part in self._system.components}
        for link, point in self._pins:
            for dof, row in zip(parts[link].dofs, self._system.rows[link], strict=False):
                if dof.point == point and dof.direction != "theta":
                    result.append(int(row))
        return result

    def _rows(
        self, configuration: Configuration, joining: Joining, system: UncoupledSystem
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return forces per displacement, velocity and acceleration, each (n_rows, n).

        There are two rows for each pin, and one for each spring.
        """
        pins, springs = self._pin_rows(), slice(0, len(self._springs))
        stretch = self._widened(joining.elongation[springs])
        stiff = joining.stiffness[springs, np.newaxis] * stretch
        viscous = joining.damping[springs, np.newaxis] * stretch
        return (
            np.vstack([system.stiffness[pins], stiff]),
            np.vstack([system.damping[pins], viscous]),
            np.vstack([system.mass[pins], np.zeros_like(stiff)]),
        )

    def squares(self, forces: FloatArray) -> FloatArray:
        """Return squares of the forces at places, (n, n_places, k), of (n, n_rows, k)."""
        pins, last = 2 * len(self._pins), np.square(forces)
        return np.concatenate([last[:, 0:pins:2] + last[:, 1:pins:2], last[:, pins:]], axis=1)

    def _weight(self, configuration: Configuration) -> FloatArray:
        """Return the weight of all but the base, (n,)."""
        weight = np.zeros(len(self._system.mass))
        for part in self._system.components:
            if part.name != GROUND:
                down, turn = np.array([0.0, -GRAVITY]), configuration.turn(part.name)
                weight[self._system.rows[part.name]] = part.mass @ part.translation(down, turn)
        return weight

    def _into(
        self, first: tuple[LoadKind, str], configuration: Configuration, joining: Joining
    ) -> FloatArray:
        """Return the force on each coordinate of a unit load, (n,)."""
        kind, place = first
        point, _, direction = place.rpartition(".")
        if kind == FORCE:
            [into] = self._widened(self._model.rows([(point, direction)], configuration))
            return np.asarray(into)
        if kind == MOMENT:
            name = GROUND if place == "base" else place
            into = np.zeros(len(self._system.mass))
            into[self._system.rows[name][2]] = 1.0  # the rotation of a rigid body
            return into
        return np.asarray(self._widened(joining.elongation)[self._mount(place)])

    def _mount(self, place: str) -> int:
        """Return the row of a mount among springs and mounts, such as that of base:rear_axle.z."""
        mounts = self._model.mechanism.mount_springs
        names = [f"base:{mount.name}.{'xz'[axis]}" for mount, axis in mounts]
        return len(self._springs) + names.index(place)

    def _loads(self, run: Run, at: FloatArray) -> FloatArray:
        """Return the loads on the inputs at times, (n_parts, k), as (n_parts, n_inputs, k)."""
        loads = np.zeros((len(at), len(self._inputs), at.shape[1]))
        joining = self._model.interface.join(self._model.kinematics.at(float(self._angles[0])))
        known = {
            source: [np.interp(at, run.times, x[source]) for x in (run.speeds, run.travelled)]
            for source in run.speeds
        }
        for each in self.excitations:
            assert each.load is not None
            now, travelled = known[each.source]
            phase = 2.0 * math.pi * each.ratio * travelled
            size = each.load.amplitude * (now / each.load.speed) ** each.load.exponent
            values = size * np.sin(phase)
            if each.load.kind in (BASE_ACCELERATION, BASE_DISPLACEMENT):
                assert each.load.kind == BASE_DISPLACEMENT
                row, omega = self._mount(each.load.place), 2.0 * math.pi * each.ratio * now
                values = joining.stiffness[row] * values
                values = values + joining.damping[row] * size * omega * np.cos(phase)
            loads[:, self._inputs.index(_input(each))] += values
        return loads

    def mean_squares(self, run: Run) -> FloatArray:
        """Integrate, and return the mean square of each load ratio in blocks of 20 ms.

        The result is (n_blocks, n_places).
        """
        length, warm = round(PART / (EVERY * STEP)), round(WARM_UP / (EVERY * STEP))
        parts = math.ceil(run.blocks / length)
        first = run.times[0] + PART * np.arange(parts) - WARM_UP
        values = np.zeros((parts, length, len(self.names)))
        state = np.zeros((parts, MODES), complex)
        within = STEP * np.arange(EVERY + 1)
        for block in range(warm + length):
            begin = first + block * EVERY * STEP
            cell = self._cells(run, begin)
            loads = self._loads(run, np.maximum(begin[:, np.newaxis] + within, run.times[0]))
            state, forces = self._advanced(state, cell, loads)
            if block >= warm:
                reference = np.array([self._modal[i].reference for i in cell.tolist()])
                mean = self.squares(forces).mean(axis=2)
                values[:, block - warm] = mean / reference**2
        return values.reshape(parts * length, -1)[: run.blocks]

    def _cells(self, run: Run, times: FloatArray) -> NDArray[np.int64]:
        """Return the nearest angle of the grid at times, (n_parts,)."""
        apart = np.abs(self._angles - np.interp(times, run.times, run.angle)[:, np.newaxis])
        return np.asarray(apart.argmin(axis=1))

    def _advanced(
        self, state: ComplexArray, cell: NDArray[np.int64], loads: FloatArray
    ) -> tuple[ComplexArray, FloatArray]:
        """Return the states after a block, and the forces in it, (n_parts, n_rows, EVERY)."""
        modal = [self._modal[i] for i in cell.tolist()]
        p = np.array([each.poles for each in modal])[..., np.newaxis]
        pushed = np.array([each.gains for each in modal]) @ loads
        h = p * STEP
        grown = np.exp(h)
        second = (grown - 1.0 - h) / h**2 * STEP
        first = (grown - 1.0) / h * STEP - second
        powers = np.exp(h * np.arange(1, EVERY + 1))
        steps = (first * pushed[..., :-1] + second * pushed[..., 1:]) / powers
        states = powers * (state[..., np.newaxis] + np.cumsum(steps, axis=2))
        dynamic = 2.0 * (np.array([each.forces for each in modal]) @ states).real
        return states[..., -1], dynamic + np.array([each.rest for each in modal]) @ loads[..., 1:]


def _input(first: Excitation) -> tuple[LoadKind, str]:
    """Return the kind and the place of a load, which excitations may share."""
    assert first.load is not None
    return first.load.kind, first.load.place


def running(mean_squares: FloatArray, window: float) -> FloatArray:
    """Return the largest running root mean square of all places, (n_blocks,).

    Parameters
    ----------
    mean_squares : ndarray, (n_blocks, n_places)
        As `PinForces.mean_squares` returns them.
    window : float
        s, which end at the block.
    """
    n = round(window / (EVERY * STEP))
    sums = np.cumsum(np.pad(mean_squares, ((n, 0), (0, 0))), axis=0)
    return np.asarray(np.sqrt((sums[n:] - sums[:-n]).max(axis=1) / n))
