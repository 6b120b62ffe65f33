# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Forces in pins, sections, springs and cylinders, as places of FRFs.

A force is a sum of rows on the coordinates of the uncoupled components, times powers of s = i w. A
pin exerts on a link what its motion needs, K + s C + s^2 M, so that both sides of a pin carry the
same force, and static forces follow from the weight likewise. A spring exerts (k + s c) times its
elongation, and a section is strained without damping. Of equal links or cylinders side by side, it
is the force in one of them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray, rows_of
from linkage_vibration.mechanics.compatibility import CouplingError, InterfaceMap, Joining
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.coupling import CoupledSystem, UncoupledSystem, couple
from linkage_vibration.mechanics.description import Link, Mechanism, MechanismError, ReferenceForce
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.springs import Values, has_force, tension_share

GRAVITY = 9.80665
"""Standard acceleration of gravity, m/s2, by which static forces are computed."""

_LEAST_REFERENCE = 0.1  # least reference force, as a share of the largest static one at an angle
_SINGULAR = 1e-13  # Nothing holds a motion whose scaled singular value, of the largest, is smaller.
_BALANCED = 1e-6  # A larger part of the weight that nothing carries is more than rounding.

_SECTION = ("axial", "shear", "moment")


SOIL = "base:"
"""Begins the name of the force between a mount of the base and the soil, such as a tyre's."""


class ForceError(LinkageVibrationError):
    """A place has no such force."""


def is_force(place: tuple[str, str]) -> bool:
    """Return whether a place is one of a force, rather than of a displacement."""
    return place[1] not in ("x", "y", "z")


def tyre_place(mount: str) -> tuple[str, str]:
    """Return the place of the force between a mount of the base and the soil."""
    return SOIL + mount, "force_z"


def magnitudes(places: Sequence[tuple[str, str]], forces: FloatArray) -> FloatArray:
    """Return magnitudes of forces, (n_names, ...), from components at `Forces.places`."""
    names = [name for name, _ in places]
    first = [i for i, name in enumerate(names) if name not in names[:i]]
    return np.sqrt(np.add.reduceat(forces**2, first)) if first else forces


def reference(
    places: Sequence[tuple[str, str]], static: FloatArray, given: ReferenceForce | None
) -> FloatArray:
    """Return what dynamic forces are compared with, (n_names, ...), N, from static components.

    They are static forces, at least a share of the largest one (a pin that carries nearly nothing
    has no ratio), or given. Those of tyres are their loads, negative if they would have to pull.
    """
    names, forces = list(dict.fromkeys(name for name, _ in places)), magnitudes(places, static)
    hung = [i for i, name in enumerate(names) if not name.startswith(SOIL)]
    least = _LEAST_REFERENCE * forces[hung].max(axis=0, initial=0.0)
    forces[hung] = np.where(least > 0.0, np.maximum(forces[hung], least), math.nan)
    for place, force in zip(places, static, strict=True):
        if place == tyre_place(place[0].removeprefix(SOIL)):
            forces[names.index(place[0])] = -force
    if isinstance(given, float):
        forces[hung] = given
        return forces
    for name, force in given or ():
        if name in names:
            forces[names.index(name)] = force
    return forces


def _at_rest(coupled: CoupledSystem, weight: FloatArray) -> FloatArray:
    """Return how far weights, (n,), N, move the components, (n,); NaN if nothing carries them."""
    if coupled.mass.ndim > 2:  # There is one assembly for each weight.
        return np.array([_at_rest(*each) for each in zip(rows_of(coupled), weight, strict=True)])
    n = len(coupled.basis)
    load = np.concatenate([coupled.basis.T @ weight[:n], weight[n:]])
    size = np.diag(coupled.stiffness)
    scale = np.sqrt(np.maximum(size, _SINGULAR * size.max() or 1.0))
    scaled = coupled.stiffness / np.outer(scale, scale)
    moved = np.linalg.lstsq(scaled, load / scale, rcond=_SINGULAR)[0] / scale
    if not np.abs(coupled.stiffness @ moved - load).max() <= _BALANCED * np.abs(weight).max():
        return np.full(len(weight), math.nan)
    return coupled.expand(moved[:, np.newaxis])[:, 0]


@dataclass(frozen=True, eq=False)
class Forces:
    """Finds the forces in a mechanism whose components have matrices."""

    mechanism: Mechanism
    system: UncoupledSystem
    interface: InterfaceMap

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all force places: pins, by the first link of beams, springs, then tyres."""
        named: dict[str, str] = {}  # with the point of each
        for link in self.mechanism.links:
            for point, _ in link.points if link.name in self._ends else ():
                bodies = len(self.mechanism.owners(point))
                if bodies > 2 or (bodies == 2 and point not in named.values()):
                    named[f"{link.name}:{point}"] = point
        springs = dict.fromkeys(name for name, _ in self.springs if name)
        names, given = (*named, *springs), self.mechanism.response.reference_force
        for name, _ in given if isinstance(given, tuple) else ():
            if name not in names:
                problem = f"{name} has no force; give some of: {', '.join(names) or 'none'}."
                raise MechanismError("response.reference_force", problem)
        return names

    @cached_property
    def places(self) -> tuple[tuple[str, str], ...]:
        """The scalar places of `names`: all components of pins, springs, then tyres."""
        springs = [place for place in self.springs if place[0]]
        pins = [name for name in self.names if name not in dict(springs)]
        both = [(name, each) for name in pins for each in self._directions(*self._end(name))]
        return (*both, *springs)

    def _directions(self, link: Link, point: str) -> list[str]:
        """Return the components of the force of a pin on a link, along the global axes."""
        dofs, axes = self._parts[link.name].dofs, self.interface.directions
        return [f"force_{axis}" for axis in axes if InterfaceDof(point, axis) in dofs]

    @cached_property
    def _ends(self) -> dict[str, Mapping[str, FloatArray]]:
        """The forces in sections at the points of each link that shows them."""
        links = self.mechanism.links
        ends = {link.name: link.body.sections(link, self._parts[link.name]) for link in links}
        return {name: forces for name, forces in ends.items() if forces}

    @cached_property
    def _parts(self) -> dict[str, Component]:
        return {part.name: part for part in self.system.components}

    def rows(
        self, places: Sequence[tuple[str, str]], configuration: Configuration, joining: Joining
    ) -> NDArray[Any]:
        """Return forces at places per coordinate, (3, n_places, n): factors of 1, s and s^2."""
        shape = *configuration.angles.shape[:-1], 3, len(self.system.mass)
        rows = np.zeros((len(places), *shape), complex if self.system.loss.any() else float)
        names = dict.fromkeys(name for name, _ in places)
        forces_at = {name: self._forces_at(name, configuration, joining) for name in names}
        for row, (name, direction) in zip(rows, places, strict=True):
            at, forces = forces_at[name]
            if direction not in forces:
                available = ", ".join(forces) or "no force"
                raise ForceError(f"{name} has no {direction}; it has: {available}.")
            row[..., at] = forces[direction]
        return np.moveaxis(rows, 0, -2)

    def _forces_at(
        self, name: str, configuration: Configuration, joining: Joining
    ) -> tuple[Any, dict[str, NDArray[Any]]]:
        """Return indices of coordinates, and rows on them of the forces at a name by direction."""
        if name not in dict(self.springs):
            link, point = self._end(name)
            directions, axes = self._directions(link, point), self.interface.axes
            pin, turn = self._on_link(link, point, joining), axes(link.name, configuration)
            if len(directions) < turn.shape[-1]:  # A link in the middle has a force along y alone.
                which = [self.interface.directions.index(each[-1]) for each in directions]
                turn = turn[..., which, :][..., which]
            forces = [*np.moveaxis(turn[..., np.newaxis, :, :] @ pin / link.count, -2, 0)]
            if point in self._ends[link.name]:
                elastic = np.zeros((len(_SECTION), 3, len(self.system.mass)))
                elastic[:, 0, self.system.rows[link.name]] = self._ends[link.name][point]
                directions, forces = [*directions, *_SECTION], [*forces, *elastic]
            return slice(None), dict(zip(directions, forces, strict=True))
        found = {}
        for i in (i for i, each in enumerate(self.springs) if each[0] == name):
            both = np.stack([x[..., i] for x in (joining.stiffness, joining.damping)], axis=-1)
            force = np.concatenate([both, 0.0 * both[..., :1]], axis=-1)[..., np.newaxis]
            force = force * joining.elongation[..., np.newaxis, i, :]
            share = np.asarray(self.tension_share(i, configuration))
            found[self.springs[i][1]] = share[..., np.newaxis, np.newaxis] * force
        return slice(self.system.n_interface), found

    def _on_link(self, link: Link, point: str, joining: Joining) -> NDArray[Any]:
        """Return what pins at a point exert on a link, (3, 2, n): beside springs, what moves it."""
        system, dofs = self.system, self._parts[link.name].dofs
        own_dofs = [InterfaceDof(point, each[-1]) for each in self._directions(link, point)]
        at = system.rows[link.name][[dofs.index(dof) for dof in own_dofs]]
        lossy = system.stiffness + 1j * system.loss if system.loss.any() else system.stiffness
        own = np.array([lossy[at], system.damping[at], system.mass[at]])
        rows = np.broadcast_to(own, (*joining.stiffness.shape[:-1], *own.shape)).copy()
        stretch = joining.elongation
        for i, weights in enumerate((joining.stiffness, joining.damping)):
            pulled = stretch[..., at].swapaxes(-1, -2) * weights[..., np.newaxis, :]
            rows[..., i, :, : system.n_interface] += pulled @ stretch
        if joining.weight is not None:
            rows[..., 0, :, :] += joining.weight[..., at, :]
        return rows

    @cached_property
    def springs(self) -> list[tuple[str, str]]:
        """The name and direction of the force of each row of `Joining`; "" if it has no force."""
        own = [(each.name if has_force(each) else "", "force") for each in self.mechanism.springs]
        return own + [
            tyre_place(mount.name) if axis else ("", "")
            for mount, axis in self.mechanism.mount_springs
        ]

    def tension_share(self, row: int, configuration: Configuration) -> Values:
        """Return the force at the place of a row of `Joining`, per force that the row exerts."""
        if row >= len(self.mechanism.springs):
            return 1.0
        return tension_share(self.mechanism.springs[row], self.mechanism, configuration)

    @cached_property
    def sections(self) -> tuple[tuple[str, str], ...]:
        """The places of forces and moments in sections at the points of links."""
        return tuple(
            (f"{link}:{point}", direction)
            for link, points in self._ends.items()
            for point in points
            for direction in _SECTION
        )

    def at_rest(
        self,
        configuration: Configuration,
        joining: Joining,
        coupled: CoupledSystem | None = None,
        rows: NDArray[Any] | None = None,
    ) -> FloatArray:
        """Return static forces at `places`, (..., n_places), N; NaN if nothing carries them."""
        moved, falling = self.moved_by_weight(configuration, joining, coupled)
        rows = self.rows(self.places, configuration, joining) if rows is None else rows
        forces = rows[..., 0, :, :].real @ moved[..., np.newaxis]
        inertia = rows[..., 2, :, :].real @ falling[..., np.newaxis]
        return np.asarray((forces - inertia)[..., 0])

    def moved_by_weight(
        self, configuration: Configuration, joining: Joining, coupled: CoupledSystem | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return motions by the weight, NaN if nothing carries it, and gravity, (..., n)."""
        shape, down = configuration.angles.shape[:-1], np.array([0.0, -GRAVITY])
        falling = np.zeros((*shape, len(self.system.mass)))
        for part in self.system.components:
            moved = part.translation(down, configuration.turn(part.name))
            falling[..., self.system.rows[part.name]] = moved
        try:
            load = falling @ self.system.mass
            return _at_rest(coupled or couple(self.system, joining), load), falling
        except CouplingError:
            return np.full_like(falling, math.nan), falling

    def _end(self, name: str) -> tuple[Link, str]:
        """Return the link and the point of a name such as lower_link:E1."""
        if name not in self._points:
            hint = f"give one of: {', '.join(self.names) or 'none'}"
            raise ForceError(f"There is no force at {name}; {hint}.")
        link, point = self._points[name]
        if link.name not in self._ends:
            hint = f"describe it by material and section, or give one of: {', '.join(self.names)}"
            problem = f"The matrices or FRFs of links.{link.name} do not show forces"
            raise ForceError(f"{problem}; {hint}.")
        return link, point

    @cached_property
    def _points(self) -> dict[str, tuple[Link, str]]:
        """The link and the point of each name such as lower_link:E1."""
        links = self.mechanism.links
        return {f"{link.name}:{point}": (link, point) for link in links for point, _ in link.points}
