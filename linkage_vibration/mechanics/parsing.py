# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Turns a mapping, as read from YAML, into a validated mechanism."""

import itertools
import math
from dataclasses import replace
from typing import Any, Literal

from linkage_vibration.mechanics.base import read_mounts
from linkage_vibration.mechanics.bodies import BODIES, BodyReader
from linkage_vibration.mechanics.description import (
    GROUND,
    Base,
    Body,
    Damping,
    Link,
    LossFactor,
    Mechanism,
    MechanismError,
    ModalRatio,
    Point,
    Response,
    RigidBody,
    Spring,
    rayleigh_damping,
)
from linkage_vibration.mechanics.keys import DAMPEST, Keys
from linkage_vibration.mechanics.springs import read_stiffness
from linkage_vibration.mechanics.uncertainty import read_uncertainty

# No linkage comes near these limits; numbers in millimetres or tonnes go beyond them.
_LONGEST = 100.0  # m; longest distance between two points of a body
FARTHEST = 2.0 * _LONGEST
"""Longest distance of a centre of gravity from a point of its body, m."""
_WIDEST = 10.0  # largest radius of gyration of a rigid body, in m and in sizes of the body
_HEAVIEST = 1e9  # kg; largest mass of a rigid body


def _no_files(keys: Keys, _: dict[str, Point]) -> Body:
    """Refuse links from files, where nothing can read them."""
    raise MechanismError(
        keys.path, "a file cannot be read here; describe a beam, or read the mechanism from a file."
    )


def mechanism_from_mapping(mapping: Any, read_body: BodyReader = _no_files) -> Mechanism:
    """Validate a mapping, as read from YAML, and return the mechanism that it describes.

    Keys that end in ``_deg`` are in degrees, all else is SI. `read_body` reads the body of a link
    that has a ``file``, from the keys of the link and its points. The first invalid key is refused.
    """
    top = Keys("", mapping)
    if "uncertainty" in top:  # of numbers that are valid
        return _uncertain(top["uncertainty"], mapping, read_body)
    ground = {name: top["ground"].point(name) for name in top["ground"]}
    links = tuple(_link(top["links"][name], name, ground, read_body) for name in top["links"])
    rigid_bodies = tuple(
        _rigid_body(top["rigid_bodies"][name], name) for name in top.names("rigid_bodies")
    )
    taken = {point for body in links + rigid_bodies for point, _ in body.points} | ground.keys()
    base = _base(top["base"], ground, taken) if "base" in top else None
    points = {GROUND: ground if base is None else dict(base.body.points)}
    bodies: tuple[Link | RigidBody, ...] = links + rigid_bodies
    for body in bodies:
        if body.name in points:
            raise MechanismError(body.name, "two bodies have this name; rename one.")
        points[body.name] = dict(body.points)
    grounded = [name for name in points if name != GROUND and points[name].keys() & ground.keys()]
    input_body = top["input"].choice("link", grounded)
    low, high = top["input"].interval("range_deg")
    assembly = top["assembly"]
    others = [name for name in points if name not in (GROUND, input_body)]
    mechanism = Mechanism(
        name=top.text("name"),
        ground=tuple(ground.items()),
        links=links,
        rigid_bodies=rigid_bodies,
        springs=tuple(
            _spring(top["springs"][name], name, points, (low, high))
            for name in top.names("springs")
        ),
        input_body=input_body,
        stroke=(math.radians(low), math.radians(high)),
        assembly_alpha3=math.radians(assembly.number("alpha3_deg")),
        assembly_angles=tuple(
            (name, math.radians(assembly["angles_deg"].number(name))) for name in others
        ),
        damping=_damping(top["damping"]),
        response=_response(top["response"], points, base=base is not None),
        base=base,
        gravity=_gravity(top),
    )
    top.refuse_unknown()
    _check_lengths(mechanism)
    _check_topology(mechanism)
    return mechanism


def _uncertain(keys: Keys, mapping: dict[str, Any], read_body: BodyReader) -> Mechanism:
    """Return the mechanism of a mapping with the uncertainty of its numbers."""
    exact = {key: value for key, value in mapping.items() if key != "uncertainty"}
    mechanism = mechanism_from_mapping(exact, read_body)
    uncertainty = read_uncertainty(keys, exact, lambda other: again_from_mapping(other, mechanism))
    keys.refuse_unknown()
    return replace(mechanism, uncertainty=uncertainty)


def again_from_mapping(mapping: dict[str, Any], mechanism: Mechanism) -> Mechanism:
    """Validate a mapping whose links from files have the bodies of a mechanism read before."""
    bodies = {f"links.{link.name}": link.body for link in mechanism.links}
    given = mapping["links"].items()
    links = {name: {**link, "file": {}} if "file" in link else link for name, link in given}

    def body(keys: Keys, points: dict[str, Point]) -> Body:
        keys["file"].refuse_unknown()
        return bodies[keys.path]

    return mechanism_from_mapping({**mapping, "links": links}, body)


def _response(keys: Keys, points: dict[str, dict[str, Point]], *, base: bool) -> Response:
    movable = dict.fromkeys(
        point for name in points if name != GROUND or base for point in points[name]
    )
    direction: Literal["x", "z"] = "x" if keys.choice("direction", ["x", "z"]) == "x" else "z"
    band = keys.interval("band_hz")
    if band[0] < 0.0:
        raise keys.error("band_hz", "frequencies are not negative; begin at 0.")
    modes, names = keys.integer("modes"), _mode_names(keys)
    return Response(keys.choice("drive_point", movable), direction, band, modes, names)


def _mode_names(keys: Keys) -> tuple[str, ...]:
    """Read names of modes; a name is neither a number nor that of another mode."""
    names = keys.words("mode_names") if "mode_names" in keys else ()
    for name in filter(None, names):
        if names.count(name) > 1 or name.strip() != name or name.isdecimal():
            raise keys.error(
                "mode_names",
                f"{name!r} occurs twice, is a number, or begins or ends with a space; give each "
                "mode a name of its own.",
            )
    return names


def _link(keys: Keys, name: str, ground: dict[str, Point], read_file: BodyReader) -> Link:
    points = keys["points"]
    places = {point: points.place(point) for point in points}
    if len(places) < 2:
        raise keys.error("points", "a link has at least two points; add one.")
    straight = [(point, place[0]) for point, place in places.items() if place[1] == 0.0]
    for (_, before), (point, after) in itertools.pairwise(straight):
        if after <= before:
            raise points.error(
                point,
                f"{after:g} m is not beyond the point before it ({before:g} m); list the points "
                "in the order in which they lie along the link.",
            )
    readers = {"file": read_file, **BODIES}
    kind = next((key for key in readers if key in keys), "material")
    return Link(
        name=name,
        points=tuple(places.items()),
        body=readers[kind](keys, places),
        count=keys.integer("count", default=1),
        modes=keys.integer("modes", default=20, least=0),
        clamped=keys.choice("clamped", [p for p in places if p in ground])
        if "clamped" in keys
        else None,
        masses=tuple(
            (keys["masses"].member(point, places), keys["masses"].number(point, positive=True))
            for point in keys.names("masses")
        ),
        damping=_damping(keys["damping"]) if "damping" in keys else None,
    )


def _gravity(keys: Keys) -> float:
    gravity = keys.number("gravity", default=0.0)
    if gravity < 0.0:
        raise keys.error("gravity", f"{gravity:g} points upwards; give 9.81, in m/s2.")
    return gravity


def _damping(keys: Keys) -> Damping:
    rule = keys.choice("rule", ["rayleigh", "modal_ratio", "loss_factor"], default="rayleigh")
    if rule == "modal_ratio":
        return ModalRatio(keys.number("ratio", positive=True))
    if rule == "loss_factor":
        return LossFactor(keys.number("factor", positive=True))
    at = keys.interval("at_hz", positive=True)
    return rayleigh_damping(keys.number("ratio", positive=True), *at)


def _base(keys: Keys, ground: dict[str, Point], taken: set[str]) -> Base:
    mounts = read_mounts(keys, taken)
    places = ground | {mount.name: mount.at for mount in mounts}
    return Base(read_rigid(keys, GROUND, places), mounts)


def _rigid_body(keys: Keys, name: str) -> RigidBody:
    points = keys["points"]
    return read_rigid(keys, name, {point: points.point(point) for point in points})


def read_rigid(keys: Keys, name: str, places: dict[str, Point]) -> RigidBody:
    """Read mass, inertia and centre of gravity of a rigid body with points at places (x, z), m."""
    centre = _centre_of_gravity(keys, places)
    mass, inertia = keys.number("mass", positive=True), keys.number("inertia", positive=True)
    if mass > _HEAVIEST:
        raise keys.error(
            "mass",
            f"beside {mass:g} kg the links lose their digits; write kg, up to {_HEAVIEST:g}.",
        )
    size = max((math.dist(centre, place) for place in places.values()), default=0.0)
    radius = math.sqrt(inertia / mass)
    if radius > _WIDEST * max(size, 1.0):
        raise keys.error(
            "inertia",
            f"it gives a radius of gyration of {radius:.3g} m with {mass:g} kg, but the points are "
            f"within {size:.3g} m of the centre of gravity; write kg and kg m2.",
        )
    return RigidBody(name, tuple(places.items()), centre, mass, inertia)


def _centre_of_gravity(keys: Keys, points: dict[str, Point]) -> Point:
    """Read the place of the centre of gravity: coordinates, or distances from two points."""
    if not keys.is_mapping("centre_of_gravity"):
        return keys.point("centre_of_gravity")
    tape = keys["centre_of_gravity"]
    side = tape.choice("side", ["left", "right"])
    names = [name for name in tape if name != "side"]
    if len(names) != 2 or not all(name in points for name in names):
        raise MechanismError(
            tape.path, f"give the distances from two of the body's points ({', '.join(points)})."
        )
    first, second = (tape.number(name, positive=True) for name in names)
    (x1, z1), (x2, z2) = (points[name] for name in names)
    base = math.hypot(x2 - x1, z2 - z1)
    along = (first**2 - second**2 + base**2) / (2.0 * base) if base > 0.0 else math.inf
    if abs(along) > first:
        raise MechanismError(
            tape.path,
            f"no point lies {first:g} m from {names[0]} and {second:g} m from {names[1]}, which "
            f"are {base:g} m apart; measure again.",
        )
    across = math.sqrt(first**2 - along**2) * (1.0 if side == "left" else -1.0)
    ux, uz = (x2 - x1) / base, (z2 - z1) / base
    return (x1 + along * ux - across * uz, z1 + along * uz + across * ux)


def _spring(
    keys: Keys, name: str, points: dict[str, dict[str, Point]], stroke: tuple[float, float]
) -> Spring:
    """Read a spring: on the joint of two bodies, or between two points."""
    owners: dict[str, list[str]] = {}
    for body, places in points.items():
        for point in places:
            owners.setdefault(point, []).append(body)
    ends, bodies = _joint(keys, owners) if "joint" in keys else _ends(keys, owners)
    damping = keys.number("damping", default=0.0)
    if damping < 0.0:
        raise keys.error(
            "damping", f"{damping:g} would add energy; give 0 or a positive damping constant."
        )
    keys.refuse_rigid("damping", damping, DAMPEST)
    stiffness = read_stiffness(keys, stroke)
    if stiffness == damping == 0.0:
        raise keys.error("stiffness", "is 0, as is damping; give a positive stiffness or damping.")
    return Spring(name, bodies, ends, stiffness, damping)


def _joint(keys: Keys, owners: dict[str, list[str]]) -> tuple[tuple[str, ...], tuple[str, str]]:
    """Read the joint on which a spring acts, and which two of its bodies."""
    point = keys.choice("joint", [point for point, bodies in owners.items() if len(bodies) > 1])
    bodies = owners[point]
    if len(bodies) > 2 or "bodies" in keys:
        chosen = keys.words("bodies")
        if len(chosen) != 2 or not set(chosen) <= set(bodies) or chosen[0] == chosen[1]:
            raise keys.error("bodies", f"choose two of the bodies there: {', '.join(bodies)}.")
        bodies = list(chosen)
    return (point,), (bodies[0], bodies[1])


def _ends(keys: Keys, owners: dict[str, list[str]]) -> tuple[tuple[str, ...], tuple[str, str]]:
    """Read the two points between which a spring acts, and the bodies that have them."""
    ends = keys.words("between")
    if len(ends) != 2 or ends[0] == ends[1] or not set(ends) <= owners.keys():
        raise keys.error("between", f"give two points, of: {', '.join(owners)}.")
    first, second = (owners[point][0] for point in ends)
    if first == second:
        raise keys.error("between", f"both points are on {first}; a spring joins two bodies.")
    return ends, (first, second)


def _check_lengths(mechanism: Mechanism) -> None:
    places = {"ground": mechanism.ground}
    places.update({f"links.{link.name}.points": link.points for link in mechanism.links})
    places.update({f"rigid_bodies.{b.name}.points": b.points for b in mechanism.rigid_bodies})
    if mechanism.base is not None:
        places["base.mounts"] = mechanism.base.body.points
    pairs = [
        (path, *pair)
        for path, points in places.items()
        for pair in itertools.combinations(points, 2)
    ]
    for body in mechanism.rigid:
        path = "base" if body.name == GROUND else f"rigid_bodies.{body.name}"
        centre = ("centre_of_gravity", body.centre_of_gravity)
        pairs += [(path, centre, point) for point in body.points]
    for path, (first, place), (second, other) in pairs:
        longest = FARTHEST if first == "centre_of_gravity" else _LONGEST
        if math.dist(place, other) > longest:
            raise MechanismError(
                path,
                f"{first} and {second} are {math.dist(place, other):g} m apart; lengths are in m, "
                "so divide millimetres by 1000.",
            )


def _check_topology(mechanism: Mechanism) -> None:
    for name, _ in mechanism.ground:
        springs = [spring for spring in mechanism.springs if name in spring.points]
        if len(mechanism.owners(name)) == 1 and not springs:
            raise MechanismError(f"ground.{name}", "no body has a point of this name; remove it.")
    freedom = 3 * len(mechanism.bodies) - 2 * len(mechanism.joints)
    shared: dict[tuple[str, ...], list[str]] = {}
    for point in dict.fromkeys(point for point, _, _ in mechanism.joints):
        for pair in itertools.combinations(mechanism.owners(point), 2):
            shared.setdefault(pair, []).append(point)
    twice = {pair: points for pair, points in shared.items() if len(points) > 1}
    if freedom < 1 and twice:
        (first, second), points = next(iter(twice.items()))
        raise MechanismError(
            "links",
            f"{first} and {second} are joined at {' and '.join(points)}, which holds them to one "
            "another as one body; join two bodies at one point, and give equal links side by side "
            "as one with `count: 2`.",
        )
    if freedom != 1:
        raise MechanismError(
            "links",
            f"{len(mechanism.bodies)} bodies with {len(mechanism.joints)} pins leave {freedom} "
            "degrees of freedom where one input angle needs exactly 1; points are joined where "
            "their names are the same, so look for a misspelt one.",
        )
