# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The lateral half of a linkage: its motions that are odd about the middle plane y = 0.

A linkage that is symmetric about this plane has modes of two kinds, which do not mix. In those of
the vertical half, left and right mirror one another: this is the planar model. In those of the
lateral half, left and right move oppositely along x and z and alike along y, and what is in the
middle moves along y, rolls about x, and yaws about z. x points forward, y to the left, z up.

Only the left body of each pair is modelled, with the matrices of both. Pins are ball joints, as in
the paper's eq. 20 to 22, whose third row is that along y here. The bearing of the crank and clamps
also hold the rotation out of the plane.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, symmetric
from linkage_vibration.mechanics.bodies.beam import THETA, Beam, W, beam_matrices
from linkage_vibration.mechanics.bodies.matrices import component_of
from linkage_vibration.mechanics.compatibility import InterfaceMap, Joining, SpringRow
from linkage_vibration.mechanics.components import CENTRE_OF_GRAVITY, Component, Components
from linkage_vibration.mechanics.coupling import uncoupled_system
from linkage_vibration.mechanics.description import (
    GROUND,
    Chain,
    Cylinder,
    Link,
    LossFactor,
    Mechanism,
    MechanismError,
    Point,
    Spring,
)
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.forces import SOIL, Forces, tyre_place
from linkage_vibration.mechanics.kinematics import Configuration, rotation
from linkage_vibration.mechanics.weight import Weight

_SAME_PLACE = 1e-9  # m


def bearing(link: Link, mechanism: Mechanism) -> str | None:
    """Return the point at which the ground holds a link by more than a ball joint: crank, clamp."""
    own, ground = dict(link.points), mechanism.local_points(GROUND)
    at = next((point for point in own if point in ground), None)
    return link.clamped or (at if link.name == mechanism.input_body else None)


def chain_point(chain: Chain, link: Link) -> str:
    """Return the point of a link at which a chain acts; it has the chain's name if it is new."""
    at = [name for name, (x, _) in link.points if abs(x - chain.at) < _SAME_PLACE]
    return at[0] if at else chain.name


def lateral_components(mechanism: Mechanism, *, reduced: bool) -> tuple[Component, ...]:
    """Return the components of the lateral half, in the order of those of the vertical one."""
    assert mechanism.lateral is not None
    inertias = dict(mechanism.lateral.inertia)
    parts = [_link(link, mechanism, reduced=reduced) for link in mechanism.links]
    for body in (each for each in mechanism.rigid if each.name in inertias):
        roll, yaw = inertias[body.name]
        rule = LossFactor(0.0) if body.name == GROUND else mechanism.damping
        parts.append(body.on({"y": body.mass, "roll": roll, "yaw": yaw}, rule))
    return tuple(parts)


def _link(link: Link, mechanism: Mechanism, *, reduced: bool) -> Component:
    """Return a pair of links by the left one, or a link in the middle, which bends across alone."""
    assert isinstance(link.body, Beam)
    assert mechanism.lateral is not None
    chains = [chain for chain in mechanism.lateral.chains if chain.link == link.name]
    places = dict(link.points) | {chain_point(each, link): (each.at, 0.0) for each in chains}
    beam, points = link.body.in_space(list(places.items()), link.stretch)
    held, masses = {point for point in [bearing(link, mechanism)] if point}, link.masses
    # Where the ground does not move, its bearing holds chi, so it is no DoF.
    free, clamped = (held, set[str]()) if mechanism.base else (set[str](), held)
    aside = beam_matrices(beam, points, rotations=free, masses=masses, across=True, clamped=clamped)
    bodies = [aside]
    if link.count > 1:
        link = replace(link, modes=-(-link.modes // 2))  # half of them in each direction
        turned = mechanism.rotations(link.name) | held
        bodies.insert(0, beam_matrices(beam, points, rotations=turned, masses=masses))
    parts = [component_of(link, mechanism, b, b.dofs, reduced=reduced) for b in bodies]
    dofs = tuple(dof for part in parts for dof in part.dofs)
    both = uncoupled_system([replace(part, name=str(i)) for i, part in enumerate(parts)])
    # Of each element, in both directions, what the square of its slope adds up to along it.
    drawings = [part.drawing for part in parts if part.drawing is not None]
    nodes = drawings[0].places[:, 0]
    slopes = [_slopes(each.displacement, np.diff(nodes)[:, np.newaxis]) for each in drawings]
    ends = [link.stretch * x for _, (x, _) in link.points]
    at = np.searchsorted(ends[1:-1], (nodes[1:] + nodes[:-1]) / 2.0)
    tightened = np.zeros((len(ends) - 1, *both.mass.shape))
    for each, own in zip(slopes, both.rows.values(), strict=True):
        for piece, tight in enumerate(tightened):
            piece_slopes = each[:, at == piece].reshape(-1, len(own))
            tight[own[:, np.newaxis], own] = piece_slopes.T @ piece_slopes
    matrices = both.mass, both.stiffness, both.damping
    return Component(link.name, dofs, *matrices, parts[0].loss_factor, None, tightened)


def _slopes(displacement: FloatArray, lengths: FloatArray) -> FloatArray:
    """Return factors of the slopes of elements, (3, n_elements, n), whose squares add up.

    The slope of a cubic is c0 + c1 P1 + c2 P2 in Legendre polynomials, the mean of whose square is
    c0^2 + c1^2 / 3 + c2^2 / 5; displacements of nodes are (n_nodes, 3, n).
    """
    w, theta = displacement[:, W], displacement[:, THETA]
    mean, bent = np.diff(w, axis=0) / lengths, np.diff(theta, axis=0) / 2.0
    rest = theta[:-1] + bent - mean
    parts = [mean, bent / math.sqrt(3.0), rest / math.sqrt(5.0)]
    return np.asarray(np.sqrt(lengths) * parts)


class LateralMap(InterfaceMap):
    """The position of every interface DoF of the lateral half in the vector u, (n,)."""

    directions = "xyz"

    def __init__(
        self,
        mechanism: Mechanism,
        components: Components,
        middle: Configuration,  # that in the middle of the stroke
        plane: Forces | None = None,
    ) -> None:
        super().__init__(mechanism, components)
        assert mechanism.lateral is not None
        self._system = uncoupled_system([c for c in components if isinstance(c, Component)])
        self._lateral = mechanism.lateral
        mounts = mechanism.base.mounts if mechanism.base else ()
        both = zip(mounts, self._lateral.axles, strict=True)
        wheels = {mount.name: axle.track / 2.0 for mount, axle in both}  # of the left one
        self._y = dict(self._lateral.y) | wheels
        # By body, from the components along its principal axes to those along its own axes.
        self._principal = {body.name: middle.turn(body.name).T for body in mechanism.rigid_bodies}
        self._principal |= {body: rotation(axis) for body, axis in self._lateral.roll_axes}
        self.chains = self._lateral.chains
        self._links = {link.name: link for link in mechanism.links}
        points = {link.name: bearing(link, mechanism) for link in mechanism.links}
        self._bearings = {name: point for name, point in points.items() if point}
        self._rigid_shaft = self._lateral.rockshaft == math.inf
        contacts = dict(zip(wheels, (axle.contact for axle in self._lateral.axles), strict=True))
        self._weight = Weight(mechanism, self._y, self._bearings, contacts, plane)

    def join(self, configuration: Configuration) -> Joining:
        """Return what joins the components in a configuration, with the stiffness by the weight."""
        joining = super().join(configuration)
        if not self._lateral.weight:
            return joining
        return replace(joining, weight=self._stiffness_at_rest(configuration))

    def _stiffness_at_rest(self, configuration: Configuration) -> FloatArray:
        """Return the stiffness that forces at rest give all coordinates, (..., n, n).

        A tension straightens its line. A force F at r from the centre of a body does the work
        F (t x (t x r)) / 2 when the body turns by t.
        """
        loads, tensions = self._weight.at(configuration)
        total = np.zeros((*configuration.angles.shape[:-1], *self._system.mass.shape))
        for part in self._system.components:
            if part.tightened is not None:
                at = self._system.rows[part.name]
                own = np.tensordot(tensions[part.name], part.tightened, 1)
                total[..., at[:, np.newaxis], at] = own
        for spring in self._mechanism.springs:
            if spring.name in tensions:
                away, apart = self._line(spring, configuration)
                length = np.linalg.norm(away, axis=-1)
                axis = (away / length[..., np.newaxis])[..., np.newaxis]
                apart = apart - axis * (axis.swapaxes(-1, -2) @ apart)
                string = (tensions[spring.name] / length)[..., np.newaxis, np.newaxis]
                total[..., : len(self), : len(self)] += string * (apart.swapaxes(-1, -2) @ apart)
        for load in loads:
            carrier = GROUND if load[0] in self._bearings else load[0]
            if (carrier, CENTRE_OF_GRAVITY) in self._places:
                at = np.array(self._places[carrier, CENTRE_OF_GRAVITY][1:])
                turn = self.rotation_of(carrier, configuration)
                own = turn.swapaxes(-1, -2) @ self._turned_force(*load, configuration) @ turn
                total[..., at[:, np.newaxis], at] += own
        return total

    def _turned_force(
        self, body: str, place: Point, y: float, force: FloatArray, configuration: Configuration
    ) -> FloatArray:
        """Return the stiffness of a load against roll and yaw of what carries it, (..., 2, 2)."""
        start, held = self._centres.get(body), np.eye(3)
        if start is None:  # A link in a bearing turns with the base; tension turns its axis.
            pin, axis = self._bearings[body], self.axes(body, configuration)[..., 0]
            start, y = self._mechanism.local_points(body)[pin], y - self._y.get(pin, 0.0)
            held = axis[..., :, np.newaxis] * axis[..., np.newaxis, :]
        arm = _in_space(configuration.place(body, place) - configuration.place(body, start), y)
        both = arm[..., :, np.newaxis] * force[..., np.newaxis, :]
        along = np.trace(both, axis1=-2, axis2=-1)[..., np.newaxis, np.newaxis]
        return np.asarray(along * held - symmetric(both))[..., ::2, ::2]

    @property
    def n_mounts(self) -> int:
        """How many of the last rows of the elongations belong to mounts."""
        return len(self.wheels)

    @property
    def held(self) -> BoolArray:
        """None of the interface DoFs, (n,): FRFs of all components are those of free ones."""
        return np.zeros(len(self), dtype=bool)

    def axes(self, link: str, configuration: Configuration) -> FloatArray:
        """Return the (..., 3, 3) matrix whose columns are the axes of the left of the links."""
        turn, cosine = configuration.turn(link), 1.0 / self._links[link].stretch
        sine = self._links[link].slope * cosine
        axes = np.zeros((*turn.shape[:-2], 3, 3))
        axes[..., ::2, :] = turn[..., [0, 0, 1]] * [cosine, -sine, 1.0]
        axes[..., 1, :2] = sine, cosine
        return axes

    def _carried(
        self, body: str, place: FloatArray, y: float, configuration: Configuration
    ) -> FloatArray:
        """Return the displacement of a place, (..., 2), that a rigid body carries, (..., 3, n)."""
        rows = np.zeros((*configuration.angles.shape[:-1], 3, len(self)))
        if (body, CENTRE_OF_GRAVITY) in self._places:
            sway, roll, yaw = self._places[body, CENTRE_OF_GRAVITY]
            x, z = np.moveaxis(place - configuration.place(body, self._centres[body]), -1, 0)
            about_x, about_z = np.moveaxis(self.rotation_of(body, configuration), -2, 0)
            rows[..., 0, [roll, yaw]], rows[..., 2, [roll, yaw]] = -y * about_z, y * about_x
            rows[..., 1, [roll, yaw]] = x[..., np.newaxis] * about_z - z[..., np.newaxis] * about_x
            rows[..., 1, sway] = 1.0
        return rows

    def rotation_of(self, body: str, configuration: Configuration) -> FloatArray:
        """Return the global rotation of a rigid body per roll and yaw of its own, (..., 2, 2).

        These are about principal axes, which turn with the body, so that its inertias are constant.
        """
        turn = configuration.turn(body)
        return turn @ self._principal[body] if body in self._principal else turn

    def _constraints(self, configuration: Configuration) -> dict[str, FloatArray]:
        rows = self._pins(configuration)
        for link, point in self._bearings.items():
            for direction in ("theta", "chi") if self._rigid_shaft else ("chi",):
                turned = self._turned(link, direction, configuration)
                rows[f"bearing of {link} at {point}, {direction}"] = turned
        # What is in the middle moves along y alone.
        return {label: row for label, row in rows.items() if row.any()}

    def _turned(self, link: str, direction: str, configuration: Configuration) -> FloatArray:
        """Return the rotation of a link at its bearing relative to the ground, (..., n).

        theta, from x towards z, is about the link's own y axis backwards, and chi about its z axis.
        """
        rows = np.zeros((*configuration.angles.shape[:-1], len(self)))
        at = self._index.get((link, InterfaceDof(self._bearings[link], direction)))
        if at is not None:
            axes = self.axes(link, configuration)
            own = axes[..., 1] if direction == "theta" else -axes[..., 2]
            if (GROUND, CENTRE_OF_GRAVITY) in self._places:
                rows[..., self._places[GROUND, CENTRE_OF_GRAVITY][1:]] = own[..., ::2]
            rows[..., at] = 1.0
        return rows

    def _mounts(self, configuration: Configuration) -> list[SpringRow]:
        springs: list[SpringRow] = []
        for chain in self.chains:
            row = self._chain(chain, configuration)
            springs.append((row, 2.0 * chain.stiffness, 2.0 * chain.damping))
        for link in self._bearings if not self._rigid_shaft else ():
            # Both cranks turn, by opposite angles.
            row = self._stretches[link] * self._turned(link, "theta", configuration)
            springs.append((row, 4.0 * self._lateral.rockshaft, 0.0))
        for _, axis, place, y, k, c in self.wheels:
            moved = self._carried(GROUND, np.array(place), y, configuration)
            springs.append((moved[..., axis, :], k, c))
        return springs

    @property
    def held_by(self) -> list[tuple[str, str]]:
        """The name and direction of the force of each row of `_mounts`; "" if it has no force."""
        shafts = [] if self._rigid_shaft else [("", "")] * len(self._bearings)
        tyres = [
            (("", ""), (f"{SOIL}{mount}", "force_y"), tyre_place(mount))[axis]
            for mount, axis, *_ in self.wheels
        ]
        return [*((chain.name, "force") for chain in self.chains), *shafts, *tyres]

    @cached_property
    def wheels(self) -> list[tuple[str, int, Point, float, float, float]]:
        """The mount, axis, place in the plane, y, stiffness and damping of what holds the base.

        Each wheel has half of the stiffness of its mount, and the left and the right one move alike
        or oppositely, so the left one with all of the stiffness stands for both.
        """
        wheels, base = [], self._mechanism.base
        for mount, axle in zip(base.mounts if base else (), self._lateral.axles, strict=True):
            for axis, k, c in zip((0, 2), mount.stiffness, mount.damping, strict=True):
                wheels.append((mount.name, axis, mount.at, axle.track / 2.0, k, c))
            soil = (mount.at[0], axle.contact)
            wheels.append((mount.name, 1, soil, 0.0, axle.stiffness, axle.damping))
        return [each for each in wheels if (each[1] == 1 or each[3]) and (each[4] or each[5])]

    def _elongation(self, spring: Spring, configuration: Configuration) -> FloatArray:
        """Return the elongation of the left of two springs; those in the middle keep their length.

        Cylinders in one circuit do not resist, as oil flows from one to the other, and neither does
        what turns the crank, where the rockshaft does.
        """
        rows = np.zeros((*configuration.angles.shape[:-1], len(self)))
        if isinstance(spring.stiffness, Cylinder):
            return rows
        if len(spring.points) == 2:
            return _stretch(f"springs.{spring.name}", *self._line(spring, configuration))
        for body, other, sign in zip(spring.bodies, spring.bodies[::-1], (-1.0, 1.0), strict=True):
            at = self._index.get((body, InterfaceDof(spring.points[0], "theta")))
            if at is not None and self._bearings.get(body) != spring.points[0]:
                rows[..., at] = sign * self._stretches[body]
                if (other, CENTRE_OF_GRAVITY) in self._places:  # it turns as well
                    own = self._stretches[body] * self.axes(body, configuration)[..., ::2, 1]
                    turned = own[..., np.newaxis, :] @ self.rotation_of(other, configuration)
                    both = self._places[other, CENTRE_OF_GRAVITY][1:]
                    rows[..., both] = sign * turned[..., 0, :]
        return rows

    def _chain(self, chain: Chain, configuration: Configuration) -> FloatArray:
        """Return the elongation of the left chain, (..., n)."""
        link = self._links[chain.link]
        (first, (begin, _)), (x, y, z) = link.points[0], chain.end
        aside = self._y.get(first, 0.0) + link.slope * (chain.at - begin)
        place = configuration.place(link.name, (chain.at, 0.0))
        moved = self.displacement(link.name, chain_point(chain, link), configuration)
        end = np.array([x, z])
        away = _in_space(end, y) - _in_space(place, aside)
        apart = self._carried(GROUND, end, y, configuration) - moved
        return _stretch(f"lateral.chains.{chain.name}", away, apart)

    def _line(self, spring: Spring, configuration: Configuration) -> tuple[FloatArray, FloatArray]:
        """Return the way to the second end of a spring, (..., 3), and its change, (..., 3, n)."""
        places, moved = [], []
        for body, point in zip(spring.bodies, spring.points, strict=True):
            place = configuration.place(body, self._mechanism.local_points(body)[point])
            places.append(_in_space(place, self._y.get(point, 0.0)))
            moved.append(self.displacement(body, point, configuration))
        return places[1] - places[0], moved[1] - moved[0]


class LateralForces(Forces):
    """Finds the forces of the lateral half: in pins, springs and chains, and of tyres across."""

    interface: LateralMap

    @cached_property
    def _ends(self) -> dict[str, Mapping[str, FloatArray]]:
        """All links are beams; what strains their sections across the plane is not shown."""
        return {link.name: {} for link in self.mechanism.links}

    @cached_property
    def springs(self) -> list[tuple[str, str]]:
        """The name and direction of the force of each row of `Joining`; "" if it has no force."""
        springs = self.mechanism.springs
        lines = [len(s.points) == 2 and not isinstance(s.stiffness, Cylinder) for s in springs]
        own = [(s.name * line, "force") for s, line in zip(springs, lines, strict=True)]
        return own + self.interface.held_by

    def tension_share(self, row: int, configuration: Configuration) -> float:
        """Return the force at the place of a row of `Joining`, per force that the row exerts."""
        first = len(self.mechanism.springs)
        return 0.5 if first <= row < first + len(self.interface.chains) else 1.0

    def at_rest(self, configuration: Configuration, *_: object) -> FloatArray:
        """Return pretensions of chains, NaN if not known, and 0 elsewhere, (..., n_places), N."""
        tight = {chain.name: chain.pretension for chain in self.interface.chains}
        static = np.array([tight.get(name, 0.0) for name, _ in self.places], dtype=float)
        return np.broadcast_to(static, (*configuration.angles.shape[:-1], len(static)))


def _in_space(place: FloatArray, y: float) -> FloatArray:
    """Return x, y and z, (..., 3), of a place in the plane, (..., 2)."""
    return np.insert(place, 1, y, axis=-1)


def _stretch(name: str, away: FloatArray, apart: FloatArray) -> FloatArray:
    """Return the elongation, (..., n), of a line, (..., 3), that changes by (..., 3, n) per u."""
    length = np.linalg.norm(away, axis=-1, keepdims=True)
    if (length < _SAME_PLACE).any():
        raise MechanismError(name, "its two ends meet, so it has no direction; correct its ends.")
    return np.asarray(((away / length)[..., np.newaxis, :] @ apart)[..., 0, :])
