# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The kinds of loads, and how each acts as forces at the places between which a table has FRFs."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.mechanics.description import GROUND, Mechanism
from linkage_vibration.mechanics.ground_motion import soil_places
from linkage_vibration.mechanics.kinematics import kinematics_of
from linkage_vibration.mechanics.model import Place
from linkage_vibration.support.resources import command
from linkage_vibration.table.table import Table

Weights = Callable[[float], tuple[FloatArray, FloatArray]]


class ExcitationError(LinkageVibrationError):
    """A description of excitations is invalid."""


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


@dataclass(frozen=True, slots=True)
class LoadKind:
    """What an excitation does to the mechanism."""

    key: str  # of its amplitudes in a description
    unit: str  # of an amplitude
    # Returns the unit load at what the key `at` names, of a mechanism; the words begin its errors.
    unit_load: Callable[[str, Mechanism, str], UnitLoad] = field(repr=False)
    power: int = 0  # Unit loads are amplitudes times this power of the angular frequency.


@dataclass(frozen=True, slots=True)
class Load:
    """The amplitude of an excitation, and where it acts."""

    kind: LoadKind
    place: str  # a point and direction, a rigid body (moment), or soil such as "base:rear_axle.z"
    amplitude: float  # half of peak to peak, in the unit of the kind
    speed: float  # at which it has this amplitude, rpm or m/s
    exponent: float  # the amplitude grows with this power of the speed
    relative_stddev: float  # of the amplitude

    @property
    def across(self) -> bool:
        """Whether it acts across the plane, and so excites the lateral half."""
        return self.place.endswith(".y")


def given_kinds(keys: Iterable[str]) -> list[LoadKind]:
    """Return the kinds of which a description has amplitudes."""
    given = set(keys)
    return [kind for kind in LOAD_KINDS if kind.key in given]


def load_powers(loads: Sequence[Load | None]) -> IntArray:
    """Return the power of omega of each load, (n_loads,); 0 without a load."""
    return np.array([load.kind.power if load else 0 for load in loads], np.int64)


def unit_sizes(sizes: FloatArray, omega: FloatArray, powers: IntArray) -> FloatArray:
    """Return sizes of loads, (..., n_loads), as multiples of unit loads at frequencies, rad/s."""
    for power in {*powers.tolist()} - {0}:
        factor = math.prod([omega] * abs(power))
        scaled = sizes / factor if power < 0 else sizes * factor
        sizes = np.where(powers == power, scaled, sizes)
    return sizes


def weights_at(loads: Sequence[UnitLoad], places: Sequence[Place], alpha3: float) -> FloatArray:
    """Return both weights of unit loads at places, (2, n_places, n_loads), at an input angle."""
    weights = np.zeros((2, len(places), len(loads)))
    for i, load in enumerate(loads):
        weights[:, [places.index(place) for place in load.places], i] = load.weights(alpha3)
    return weights


def load_input(load: Load | None, name: str, table: Table, mechanism: Mechanism) -> UnitLoad:
    """Return the unit load of an excitation with a name; without a load, at the response point."""
    response = mechanism.response
    if load is None:
        return _force_at((response.point, response.direction))
    unit_load = load.kind.unit_load(load.place, mechanism, f"excitation {name}")
    missing = sorted({place[0] for place in unit_load.places if place not in table.frf_places})
    if missing:
        raise ExcitationError(
            f"excitation {name}: the table has no FRF at {', '.join(missing)}, where "
            f"{load.place} acts; name them and {response.point} in "
            f"`{command('build FILE --frf-points')}`, and give that table in table_file."
        )
    return unit_load


def _force(name: str, mechanism: Mechanism, where: str) -> UnitLoad:
    point, _, direction = name.rpartition(".")
    directions = "xyz" if mechanism.lateral else "xz"
    if not mechanism.owners(point) or direction not in [*directions]:
        raise ExcitationError(
            f"{where}: the mechanism {mechanism.name} has no place {name}; give a point and "
            f"a direction, such as {mechanism.response.point}.z; y needs the key `lateral`."
        )
    return _force_at((point, direction))


def _force_at(place: Place) -> UnitLoad:
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
        for mount, along in mechanism.mount_springs
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
            f"{', '.join(rigid) or 'none, as the mechanism has no rigid body'}."
        )
    points = dict(rigid[body].points)
    if mechanism.base is None:
        fixed = mechanism.local_points(GROUND)
        points = {point: place for point, place in points.items() if point not in fixed}
    elif body == "base":
        points = {mount.name: mount.at for mount in mechanism.base.mounts}
    if len(points) < 2:
        raise ExcitationError(
            f"{where}: {body} has fewer than two points that move, at which a table can have FRFs; "
            "give a force at a point."
        )
    pairs = [(first, second) for first in points for second in points]
    first, second = max(pairs, key=lambda pair: math.dist(points[pair[0]], points[pair[1]]))
    (x0, z0), (x1, z1) = points[first], points[second]
    across = np.array([-(z1 - z0), x1 - x0]) / math.dist(points[first], points[second]) ** 2
    places: Sequence[Place] = [(point, d) for point in (first, second) for d in ("x", "z")]

    def weights(alpha3: float) -> tuple[FloatArray, FloatArray]:
        turn = 0.0 if body == "base" else kinematics_of(mechanism).at(alpha3).angle(body)
        cos, sin = math.cos(turn), math.sin(turn)
        x, z = cos * across[0] - sin * across[1], sin * across[0] + cos * across[1]
        return np.array([-x, -z, x, z]), np.zeros(4)

    return UnitLoad(tuple(places), weights)


FORCE = LoadKind("force", "N", _force)
MOMENT = LoadKind("moment", "N m", _moment)
# The unit load of the soil under the mounts of a base is a displacement.
BASE_ACCELERATION = LoadKind("base_acceleration", "m/s²", soil_motion, power=-2)
BASE_DISPLACEMENT = LoadKind("base_displacement", "m", soil_motion)  # as the runout of a tyre
LOAD_KINDS = FORCE, MOMENT, BASE_ACCELERATION, BASE_DISPLACEMENT  # one entry for each kind
