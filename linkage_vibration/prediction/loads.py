# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Turns loads of excitations into forces at the places between which a table has FRFs."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.base import mount_springs
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.ground_motion import soil_places
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import Place
from linkage_vibration.prediction.excitation import Excitation, ExcitationError, Load, LoadKind
from linkage_vibration.support.commands import command
from linkage_vibration.table.table import Table

Weights = Callable[[float], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, slots=True, eq=False)
class UnitLoad:
    """A load of unit size, as forces at places: the sum of (w + s v) over the places.

    The weights w and v, (n_places,), are those at an input angle, rad; s is i omega.
    """

    places: tuple[Place, ...]
    weights: Weights
    # Of a motion of the soil, the index of the mount at each place, whose stiffness and damping the
    # weights are.
    mounts: tuple[int, ...] = ()


def load_input(excitation: Excitation, table: Table, mechanism: Mechanism) -> UnitLoad:
    """Return the input of an excitation; without a load, a force at the response point.

    An ExcitationError says that the mechanism has no such place, or its table no FRF there.
    """
    load, response = excitation.load, mechanism.response
    if load is None:
        return _force((response.point, response.direction))
    load_place = _input(load, mechanism, f"excitation {excitation.name}")
    missing = sorted(
        {point for point, direction in load_place.places if (point, direction) not in table.places}
    )
    if missing:
        raise ExcitationError(
            f"excitation {excitation.name}: the table has no FRF at {', '.join(missing)}, where "
            f"{load.place} acts; name them and {response.point} in "
            f"`{command('build FILE --frf-points')}`, and give that table in table_file."
        )
    return load_place


def _input(load: Load, mechanism: Mechanism, where: str) -> UnitLoad:
    if load.kind in (LoadKind.BASE_ACCELERATION, LoadKind.BASE_DISPLACEMENT):
        return soil_motion(load.place, mechanism, where)
    if load.kind is LoadKind.MOMENT:
        return _moment(load.place, mechanism, where)
    point, _, direction = load.place.rpartition(".")
    if not mechanism.owners(point) or direction not in ("x", "z"):
        raise ExcitationError(
            f"{where}: the mechanism {mechanism.name} has no place {load.place}; give a point and "
            f"a direction, such as {mechanism.response.point}.z."
        )
    return _force((point, direction))


def _force(place: Place) -> UnitLoad:
    weights = np.ones(1), np.zeros(1)
    return UnitLoad((place,), lambda alpha3: weights)


def soil_motion(name: str, mechanism: Mechanism, where: str = "") -> UnitLoad:
    """Return the forces of the mounts per displacement of the soil, such as base:rear_axle.z."""
    point, _, direction = name.rpartition(".")
    if mechanism.base is None:
        raise ExcitationError(
            f"{where}: the ground of {mechanism.name} has no base that the soil could move; "
            "describe the tractor under base: in the mechanism, or give a force."
        )
    if (point, direction) not in soil_places(mechanism):
        motions = ", ".join(".".join(place) for place in soil_places(mechanism))
        raise ExcitationError(f"{where}: the soil has no motion {name}; name one of: {motions}.")
    axis = "xz".index(direction)
    mounts = [
        mount
        for mount, along in mount_springs(mechanism.base)
        if along == axis and point in ("base", f"base:{mount.name}")
    ]
    weights = (
        np.array([mount.stiffness[axis] for mount in mounts]),
        np.array([mount.damping[axis] for mount in mounts]),
    )
    places = tuple((mount.name, direction) for mount in mounts)
    which = tuple(mechanism.base.mounts.index(mount) for mount in mounts)
    return UnitLoad(places, lambda alpha3: weights, which)


def _moment(body: str, mechanism: Mechanism, where: str) -> UnitLoad:
    """Return a pair of forces at two points of a rigid body, which is a moment of 1 N m on it."""
    rigid = {body.name: body for body in mechanism.rigid_bodies}
    if mechanism.base is not None:
        rigid["base"] = mechanism.base.body
    if body not in rigid:
        raise ExcitationError(
            f"{where}: a moment acts on a rigid body, and {body} is not one; give one of: "
            f"{', '.join(rigid)}."
        )
    points = dict(rigid[body].points)
    if body == "base":
        points = {mount.name: mount.at for mount in mechanism.base.mounts} if mechanism.base else {}
    if len(points) < 2:
        raise ExcitationError(
            f"{where}: {body} has fewer than two points at which a table can have FRFs; give a "
            "force at a point."
        )
    pairs = [(first, second) for first in points for second in points]
    first, second = max(pairs, key=lambda pair: math.dist(points[pair[0]], points[pair[1]]))
    (x0, z0), (x1, z1) = points[first], points[second]
    across = np.array([-(z1 - z0), x1 - x0]) / math.dist(points[first], points[second]) ** 2
    places: Sequence[Place] = [(point, d) for point in (first, second) for d in ("x", "z")]
    kinematics = None if body == "base" else Kinematics(mechanism)

    def weights(alpha3: float) -> tuple[FloatArray, FloatArray]:
        turn = 0.0 if kinematics is None else kinematics.at(alpha3).angle(body)
        cos, sin = math.cos(turn), math.sin(turn)
        x, z = cos * across[0] - sin * across[1], sin * across[0] + cos * across[1]
        return np.array([-x, -z, x, z]), np.zeros(4)

    return UnitLoad(tuple(places), weights)
