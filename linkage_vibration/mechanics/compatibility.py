# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The compatibility matrix B(configuration): B u = 0 joins the components.

A pin between bodies r and s gives R(angle_r) u_r - R(angle_s) u_s = 0 (Brunetti, D'Ambrogio,
Fregolent 2022, the first two rows of eq. 20 to 22), with u in the bodies' own axes. The ground does
not move, unless it belongs to a base. A rigid body, such as the base, moves at a point by the
displacement of its centre of gravity plus its rotation times the arm. A spring has a row as well,
whose value is the elongation of the spring.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, side_by_side
from linkage_vibration.mechanics.components import CENTRE_OF_GRAVITY, Components
from linkage_vibration.mechanics.description import GROUND, Mechanism, Spring
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.springs import Values, spring_line, spring_stiffness

_ZERO = 1e-12  # Directions with a smaller share of the largest singular value of B are repetitions.
_CLEAR = 1e-6  # Directions with a larger share are constraints; between both limits it is unclear.
_INVOLVED = 1e-6  # A row takes part in an unclear direction if its share is larger.


SpringRow = tuple[FloatArray, Values, Values]
"""The elongation of a spring or a mount by u, its stiffness and its damping."""


class CouplingError(LinkageVibrationError):
    """The constraints do not join the components as they should."""


@dataclass(frozen=True, slots=True, eq=False)
class Joining:
    """What joins the components on the DoFs u; in a stack, each array has an axis before."""

    compatibility: FloatArray  # (n_constraints, n): B, of B u = 0
    labels: tuple[str, ...]  # (n_constraints,): what each row of B belongs to
    # (n_springs, n): G; G u is the stretch (m) or twist (rad) of springs, then of mounts
    elongation: FloatArray
    stiffness: FloatArray  # (n_springs,): of the springs and mounts, SI
    damping: FloatArray  # (n_springs,)
    # Stiffness of all coordinates by forces at rest; None if these are left out
    weight: FloatArray | None = None


def row_space(compatibility: FloatArray, labels: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return orthonormal bases, (rank, n) of what the rows of B span, and (n, n - rank) of motions.

    Those of a stack of B have an axis before. Repeated rows are left out. Rows that nearly repeat
    others are refused: keeping them would magnify rounding, and leaving them out free a joint.
    """
    left, values, right = np.linalg.svd(compatibility)
    largest = values.max(axis=-1, initial=0.0)[..., np.newaxis]
    rank = int((values > _ZERO * largest).sum(axis=-1).max())
    unclear = values[..., :rank] < _CLEAR * largest
    for row in np.argwhere(unclear.any(axis=-1))[:1]:
        at = tuple(row)
        shares = np.abs(left[at][:, :rank][:, unclear[at]]).max(axis=1)
        names = dict.fromkeys(np.array(labels)[shares > _INVOLVED].tolist())
        share = f"{values[at][rank - 1] / values[at][0]:.1e} of the largest singular value"
        problem = f"Some constraints nearly repeat others ({share}): {'; '.join(names)}"
        hint = "let the two sides of a repeated one agree to the last digit"
        raise CouplingError(f"{problem}. Close each joint once, and {hint}.")
    return right[..., :rank, :], right[..., rank:, :].swapaxes(-1, -2)


class InterfaceMap:
    """The position of every interface DoF in the vector u, (n,), one component after the other."""

    directions = "xz"  # of the displacement of a point, along the global axes

    def __init__(self, mechanism: Mechanism, components: Components) -> None:
        self._mechanism = mechanism
        self._y: dict[str, float] = {}  # of points that are not in the middle, m
        dofs = [(component.name, dof) for component in components for dof in component.dofs]
        self._index = {dof: i for i, dof in enumerate(dofs)}
        self._places: dict[tuple[str, str], list[int]] = {}  # of x, z and, if there is one, theta
        for (body, dof), at in self._index.items():
            self._places.setdefault((body, dof.point), []).append(at)
        self._centres = {body.name: body.centre_of_gravity for body in mechanism.rigid}
        self._stretches = {link.name: link.stretch for link in mechanism.links}

    def __len__(self) -> int:
        """Return the number of interface DoFs."""
        return len(self._index)

    @cached_property
    def held(self) -> BoolArray:
        """Which DoFs of links the ground holds at every angle, (n,), by pins and clamps."""
        held = np.zeros(len(self), dtype=bool)
        if GROUND in self._centres:  # A base moves.
            return held
        for point, first, second in self._mechanism.joints:
            if first == GROUND and second not in self._centres:
                held[self._places[second, point][:2]] = True
        for link in self._mechanism.links:
            if link.clamped is not None:
                held[self.at(link.name, link.clamped, "theta")] = True
        return held

    def displacement(self, body: str, point: str, configuration: Configuration) -> FloatArray:
        """Return the (..., n_directions, n) matrix that turns u into a point's displacement."""
        if body == GROUND or body in self._centres:
            place = configuration.place(body, self._mechanism.local_points(body)[point])
            return self._carried(body, place, self._y.get(point, 0.0), configuration)
        axes = self.axes(body, configuration)
        rows = np.zeros((*axes.shape[:-1], len(self)))
        for i, direction in enumerate(self.directions):
            at = self._index.get((body, InterfaceDof(point, direction)))
            if at is not None:
                rows[..., at] = axes[..., i]
        return rows

    def _carried(
        self, body: str, place: FloatArray, y: float, configuration: Configuration
    ) -> FloatArray:
        """Return the displacement of a place, (..., 2), that a rigid body carries, (..., 2, n)."""
        rows = np.zeros((*configuration.angles.shape[:-1], 2, len(self)))
        if body in self._centres:
            arm = place - configuration.place(body, self._centres[body])
            x, z, theta = self._places[body, CENTRE_OF_GRAVITY]
            rows[..., 0, x] = rows[..., 1, z] = 1.0
            rows[..., 0, theta], rows[..., 1, theta] = -arm[..., 1], arm[..., 0]
        return rows

    def axes(self, link: str, configuration: Configuration) -> FloatArray:
        """Return the matrix that turns `directions` of a link into global ones, (..., 2, 2)."""
        return configuration.turn(link)

    @property
    def n_mounts(self) -> int:
        """How many of the last rows of the elongations belong to mounts."""
        return len(self._mechanism.mount_springs)

    def join(self, configuration: Configuration) -> Joining:
        """Return what joins the components in a configuration."""
        shape = configuration.angles.shape[:-1]
        rows, springs = self._constraints(configuration), self._springs(configuration)
        compatibility, elongation = (
            side_by_side(parts, (*shape, len(self)), -2)
            for parts in (list(rows.values()), [row for row, _, _ in springs])
        )
        both = [k for _, k, _ in springs], [c for _, _, c in springs]
        stiffness, damping = (side_by_side(numbers, shape, -1) for numbers in both)
        return Joining(compatibility, tuple(rows), elongation, stiffness, damping)

    def _constraints(self, configuration: Configuration) -> dict[str, FloatArray]:
        """Return the rows of B with their labels."""
        rows = self._pins(configuration)
        for link in self._mechanism.links:
            if link.clamped is not None:
                turn = self._turn(link.name, link.clamped) - self._turn(GROUND, link.clamped)
                rows[f"clamp of {link.name} at {link.clamped}"] = turn
        return rows

    def _pins(self, configuration: Configuration) -> dict[str, FloatArray]:
        rows: dict[str, FloatArray] = {}
        for point, first, second in self._mechanism.joints:
            apart = self.displacement(first, point, configuration)
            apart -= self.displacement(second, point, configuration)
            for i, direction in enumerate(self.directions):
                rows[f"pin {point} of {first} and {second} in {direction}"] = apart[..., i, :]
        return rows

    def _springs(self, configuration: Configuration) -> list[SpringRow]:
        springs = []
        for spring in self._mechanism.springs:
            k = spring_stiffness(spring, self._mechanism, configuration)
            row = self._elongation(spring, configuration)
            springs.append((row, k, spring.damping + spring.retardation * k))
        return springs + self._mounts(configuration)

    def _mounts(self, configuration: Configuration) -> list[SpringRow]:
        springs: list[SpringRow] = []
        for mount, axis in self._mechanism.mount_springs:
            row = self.displacement(GROUND, mount.name, configuration)[..., axis, :]
            springs.append((row, mount.stiffness[axis], mount.damping[axis]))
        return springs

    def _elongation(self, spring: Spring, configuration: Configuration) -> FloatArray:
        first, second = spring.bodies
        if len(spring.points) == 1:
            return self._turn(second, spring.points[0]) - self._turn(first, spring.points[0])
        unit, _ = spring_line(spring, self._mechanism, configuration)
        ends = zip(spring.bodies, spring.points, strict=True)
        start, end = (self.displacement(*end, configuration) for end in ends)
        return np.asarray((unit[..., np.newaxis, :] @ (end - start))[..., 0, :])

    def _turn(self, body: str, point: str) -> FloatArray:
        """Return the row of the rotation of a body about the axis of a pin, (n,).

        A link that is not parallel to the plane has its own rotation about an axis across itself,
        which is smaller: its end moves as far, on a longer way.
        """
        row = np.zeros(len(self))
        if body != GROUND or body in self._centres:
            at = CENTRE_OF_GRAVITY if body in self._centres else point
            row[self.at(body, at, "theta")] = self._stretches.get(body, 1.0)
        return row

    def at(self, body: str, point: str, direction: str) -> int:
        """Return the position of a DoF of a body in u."""
        return self._index[body, InterfaceDof(point, direction)]
