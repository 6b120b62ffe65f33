# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Forces at rest under the weight, which stiffen or soften the lateral half.

In the plane they are those of the vertical half. A link that is not parallel to the plane also
pulls its pins across it, so that its forces do not turn it about its own z axis.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.compatibility import CouplingError, InterfaceMap
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.coupling import uncoupled_system
from linkage_vibration.mechanics.description import GROUND, Mechanism, Point
from linkage_vibration.mechanics.forces import Forces
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.springs import spring_line

_REPEATED = 1e-9  # Constraints with a smaller share of the largest singular value repeat others.


Load = tuple[str, Point, float, FloatArray]
"""A body, x, z and y on it of the left place, m, and the force of both sides there, (..., 3), N."""


@dataclass(frozen=True, eq=False)
class Weight:
    """Finds the forces at rest by the y of points, m, and the point of links in a bearing."""

    mechanism: Mechanism
    y: Mapping[str, float]
    bearings: Mapping[str, str]
    contacts: Mapping[str, float]  # m, heights at which the soil carries the mounts
    given: Forces | None  # those of the vertical half, if they are known

    @cached_property
    def _plane(self) -> Forces:
        """The forces of the vertical half, whose links need no modes as they do not move."""
        if self.given is not None:
            return self.given
        links = tuple(replace(link, modes=0) for link in self.mechanism.links)
        bare = replace(self.mechanism, links=links)
        components = bare.components()
        system = uncoupled_system([c for c in components if isinstance(c, Component)])
        return Forces(bare, system, InterfaceMap(bare, components))

    def at(self, configuration: Configuration) -> tuple[list[Load], dict[str, FloatArray]]:
        """Return the loads by pins, springs and mounts, and tensions, N, of both sides.

        They are (..., n_points - 1) between the points of each link, and (...,) of each spring
        between two points, by its name. A `CouplingError` says that nothing carries the weight.
        """
        mechanism, loads, tensions = self.mechanism, list[Load](), dict[str, FloatArray]()
        along, pull, pins, turning = self._in_the_plane(configuration)
        still = np.zeros(configuration.angles.shape[:-1])
        sideways: defaultdict[tuple[str, str], FloatArray] = defaultdict(lambda: still)

        def act(bodies: Sequence[str], points: Sequence[str], *force: FloatArray) -> None:
            """Let a force act on the first body, and its reaction on the second one."""
            for body, point, sign in zip(bodies, points, (1.0, -1.0), strict=True):
                own, place = sign * np.stack(force, axis=-1), mechanism.local_points(body)[point]
                loads.append((body, place, self.y.get(point, 0.0), own))
                sideways[body, point] = sideways[body, point] + own[..., 1]

        for i, spring in enumerate(mechanism.springs):
            if len(spring.points) == 2:
                unit, length = spring_line(spring, mechanism, configuration)
                tensions[spring.name] = tension = pull[..., i]
                start, end = (self.y.get(point, 0.0) for point in spring.points)
                force = (unit[..., 0], (end - start) / length, unit[..., 1])
                act(spring.bodies, spring.points, *(tension * each for each in force))
        across = self._across(along, sideways)
        for i, (point, *bodies) in enumerate(mechanism.joints):
            act(bodies, (point, point), pins[..., 2 * i], across[..., i], pins[..., 2 * i + 1])
        for link in mechanism.links:
            aside = [sideways[link.name, point] for point, _ in link.points]
            shares = along[link.name] + link.slope * np.stack(aside, axis=-1)
            tensions[link.name] = -np.cumsum(shares, axis=-1)[..., :-1] / link.stretch
            if pin := self.bearings.get(link.name):  # Its weight turns it as a force 1 m away.
                away, _ = mechanism.local_points(link.name)[pin]
                y = self.y.get(pin, 0.0) + link.slope
                push = turning[link.name][..., np.newaxis] * configuration.turn(link.name)[..., 1]
                loads.append((link.name, (away + 1.0, 0.0), y, np.insert(push, 1, 0.0, -1)))
        for i, (mount, axis) in enumerate(mechanism.mount_springs, len(mechanism.springs)):
            place = (mount.at[0], self.contacts[mount.name])
            loads.append((GROUND, place, 0.0, -pull[..., i, np.newaxis] * np.eye(3)[2 * axis]))
        return loads, tensions

    def _in_the_plane(
        self, configuration: Configuration
    ) -> tuple[dict[str, FloatArray], FloatArray, FloatArray, dict[str, FloatArray]]:
        """Return forces along links, of springs and of pins, N, and moments about bearings, N m."""
        plane, n = self._plane, len(self._plane.interface)
        joining = plane.interface.join(configuration)
        moved, falling = plane.moved_by_weight(configuration, joining)
        unknown = np.isnan(moved).any(axis=-1)
        for alpha3 in np.extract(unknown, configuration.alpha3)[:1]:
            where = f"{self.mechanism.name} at {math.degrees(alpha3):g} deg"
            problem = f"Nothing carries the weight of {where}, which stiffens its lateral half"
            hint = "hold its crank with `clamped` or a spring at its joint, give mounts stiffness "
            hint += "along z, or write `weight: ignored` under `lateral`"
            raise CouplingError(f"{problem}; {hint}.")
        elastic, stretch = (moved @ plane.system.stiffness)[..., :n], joining.elongation
        pull = joining.stiffness * _times(stretch, moved[..., :n])
        load, parts = (falling @ plane.system.mass)[..., :n], plane.system.components
        by_pins = elastic - load + _times(stretch.swapaxes(-1, -2), pull)
        into = np.linalg.pinv(joining.compatibility.swapaxes(-1, -2), rcond=_REPEATED)
        along = {
            link.name: elastic[..., [plane.interface.at(link.name, p, "x") for p, _ in link.points]]
            for link in self.mechanism.links
        }
        turning = {
            part.name: load[..., plane.system.rows[part.name][: len(part.dofs)]] @ self._arms(part)
            for part in parts
            if part.name in self.bearings
        }
        return along, pull, _times(np.asarray(into), by_pins), turning

    def _arms(self, part: Component) -> list[float]:
        """Return the arms of the DoFs of a link about its bearing, m."""
        points = self.mechanism.local_points(part.name)
        [slant] = [link.stretch for link in self.mechanism.links if link.name == part.name]
        start, _ = points[self.bearings[part.name]]
        arms = {p: {"x": 0.0, "z": x - start, "theta": 1.0 / slant} for p, (x, _) in points.items()}
        return [arms[dof.point][dof.direction] for dof in part.dofs]

    def _across(
        self, along: Mapping[str, FloatArray], sideways: Mapping[tuple[str, str], FloatArray]
    ) -> FloatArray:
        """Return what pins exert across the plane, (..., n_joints), N, if links are at rest."""
        # The first row is empty, as there may be no pairs of links.
        rows, right = [[0.0] * len(self.mechanism.joints)], [sideways["", ""]]
        for link in (each for each in self.mechanism.links if each.count > 1):
            for axis in range(1 if link.name in self.bearings else 2):
                arms = {point: x**axis for point, (x, _) in link.points}
                joints = [(arms.get(point, 0.0), a, b) for point, a, b in self.mechanism.joints]
                rows.append([x * ((a == link.name) - (b == link.name)) for x, a, b in joints])
                turned = along[link.name] @ [axis * self.y.get(point, 0.0) for point in arms]
                right.append(turned - sum(x * sideways[link.name, p] for p, x in arms.items()))
        return np.stack(right, axis=-1) @ np.linalg.pinv(rows, rcond=_REPEATED).T


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Return the products of matrices, (..., m, n), and vectors, (..., n)."""
    return np.asarray((matrix @ vector[..., np.newaxis])[..., 0])
