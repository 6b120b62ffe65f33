# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Turns a mapping, as read from YAML, into a validated mechanism."""

import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import partial
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
    ReferenceForce,
    Response,
    RigidBody,
    Spring,
    rayleigh_damping,
)
from linkage_vibration.mechanics.keys import DAMPEST, RIGID, CheckedMapping
from linkage_vibration.mechanics.lateral_keys import with_lateral
from linkage_vibration.mechanics.paths import Data, number_at, split_paths, with_numbers
from linkage_vibration.mechanics.springs import read_stiffness
from linkage_vibration.mechanics.uncertainty import read_uncertainty

# No linkage comes near these limits; numbers in millimetres or tonnes go beyond them.
_LONGEST = 100.0  # m; longest distance between two points of a body
_FARTHEST = 200.0  # m; longest distance of a centre of gravity from a point of its body
_WIDEST = 10.0  # largest radius of gyration of a rigid body, in m and in sizes of the body
_HEAVIEST = 1e9  # kg; largest mass of a rigid body
_SLOWEST = 0.1  # Hz; lowest frequency at which a spring has a loss factor

_Ends = tuple[tuple[str, ...], tuple[str, str]]
"""The points and the two bodies of a spring."""


def _no_files(keys: CheckedMapping, _: dict[str, Point]) -> Body:
    """Refuse links from files, where nothing can read them."""
    problem = "its body is in a file, which neither a fit nor a mapping reads; describe a beam."
    raise MechanismError(keys.path, problem)


def mechanism_from_mapping(
    mapping: Any, read_body: BodyReader = _no_files, *, drawn: bool = False
) -> Mechanism:
    """Validate the mapping of a mechanism; `drawn` inertias may be impossible."""
    top = CheckedMapping("", mapping)
    if "uncertainty" in top:  # of numbers that are valid
        return _uncertain(top["uncertainty"], mapping, read_body)
    ground = _points(top, "ground")
    links = tuple(_link(top["links"][name], name, ground, read_body) for name in top["links"])
    rigid = [(top["rigid_bodies"][name], name) for name in top.names("rigid_bodies")]
    rigid_bodies = tuple(read_rigid(keys, name, _points(keys, "points")) for keys, name in rigid)
    taken = {point for body in links + rigid_bodies for point, _ in body.points} | ground.keys()
    base = _base(top["base"], ground, taken) if "base" in top else None
    points = {GROUND: ground if base is None else dict(base.body.points)}
    bodies: tuple[Link | RigidBody, ...] = links + rigid_bodies
    for body in bodies:
        if body.name in points:
            raise MechanismError(body.name, "two bodies have this name; rename one.")
        points[body.name] = dict(body.points)
    grounded = [name for name in points if name != GROUND and points[name].keys() & ground.keys()]
    given = points.get(top["input"].text("link"), ground)
    _check_grounded(top["input"], "link", given, ground, f", or give one of: {', '.join(grounded)}")
    input_body = top["input"].choice("link", grounded)
    assembly = top["assembly"]
    others = [name for name in points if name not in (GROUND, input_body)]
    alpha3 = assembly.number("alpha3_deg")
    # A single body has no other angle, but may have an empty list of them.
    directions = assembly["angles_deg"] if others or "angles_deg" in assembly else assembly
    angles = [directions.number(name) for name in others]
    low, high = _stroke(top["input"], alpha3, angles)
    mechanism = Mechanism(
        name=top.text("name"),
        ground=tuple(ground.items()),
        links=links,
        rigid_bodies=rigid_bodies,
        springs=tuple(_spring(top["springs"][name], name, points) for name in top.names("springs")),
        input_body=input_body,
        stroke=(math.radians(low), math.radians(high)),
        assembly_alpha3=math.radians(alpha3),
        assembly_angles=tuple(zip(others, map(math.radians, angles), strict=True)),
        damping=_damping(top["damping"]),
        response=_response(top["response"], points, base=base is not None),
        base=base,
    )
    if "lateral" in top:
        keys = top["lateral"]["response"]
        response = _response(keys, points, base=base is not None, band=mechanism.response.band)
        mechanism = with_lateral(mechanism, top["lateral"], response, drawn=drawn)
    top.refuse_unknown()
    _check_topology(mechanism)
    return mechanism


def _stroke(keys: CheckedMapping, alpha3: float, angles: list[float]) -> tuple[float, float]:
    """Read the stroke, deg, with the angles of the assembly; one in radians is refused."""
    low, high = keys.interval("range_deg")
    turn = 6.2832  # rad, as a whole turn is rounded up
    if -turn <= low and high <= turn:
        small = all(abs(angle) <= turn for angle in (alpha3, *angles))
        if small or not low <= alpha3 <= high:
            given = f"[{low:g}, {high:g}] is a stroke of {high - low:.3g} deg"
            first, last = (f"{math.degrees(angle):.5g}" for angle in (low, high))
            hint = f"if these are radians, write [{first}, {last}]"
            hint += ", and if not, give assembly.alpha3_deg within them"
            raise keys.error("range_deg", f"{given}; {hint}.")
    return low, high


def _uncertain(keys: CheckedMapping, mapping: Data, read_body: BodyReader) -> Mechanism:
    """Return the mechanism of a mapping with the uncertainty of its numbers."""
    exact = {key: value for key, value in mapping.items() if key != "uncertainty"}
    mechanism = mechanism_from_mapping(exact, read_body)
    parse = partial(again_from_mapping, mechanism=mechanism, drawn=True)
    uncertainty = read_uncertainty(keys, exact, parse)
    keys.refuse_unknown()
    return replace(mechanism, uncertainty=uncertainty)


def again_from_mapping(mapping: Data, mechanism: Mechanism, *, drawn: bool = False) -> Mechanism:
    """Validate a mapping whose links from files have the bodies of a mechanism read before."""
    bodies = {f"links.{link.name}": link.body for link in mechanism.links}
    given = mapping["links"].items()
    read = {"file", "mass"}  # by what reads files
    links = {
        name: {key: part for key, part in link.items() if key not in read} | {"file": {}}
        if "file" in link
        else link
        for name, link in given
    }

    def body(keys: CheckedMapping, points: dict[str, Point]) -> Body:
        keys["file"].refuse_unknown()
        return bodies[keys.path]

    return mechanism_from_mapping({**mapping, "links": links}, body, drawn=drawn)


def with_values(mapping: Data, mechanism: Mechanism, values: Mapping[str, float]) -> Mechanism:
    """Return the mechanism that a mapping describes with other numbers at paths."""
    numbers = [(path, number) for paths, number in values.items() for path in split_paths(paths)]
    for path, _ in numbers:
        number_at(mapping, path)  # it has to exist
    changed = with_numbers(mapping, numbers)
    again = again_from_mapping(changed, mechanism)
    return replace(again, described=partial(with_values, changed, again))


def _response(
    keys: CheckedMapping,
    points: dict[str, dict[str, Point]],
    *,
    base: bool,
    band: tuple[float, float] | None = None,
) -> Response:
    """Read a response; that of the lateral half is in the band of the vertical one."""
    movable = dict.fromkeys(p for name in points if name != GROUND or base for p in points[name])
    directions: tuple[Literal["x", "y", "z"], ...] = ("x", "z") if band is None else ("x", "y", "z")
    direction = directions[directions.index(keys.choice("direction", directions))]
    band = band or keys.interval("band_hz")
    keys.refuse_outside("band_hz", band[0], 0.0, band[1], "begin at 0 Hz")
    part = keys.interval("peak_band_hz") if "peak_band_hz" in keys else band
    for end in part:
        hint = "FRFs are valid in band_hz only, so give frequencies within it, or widen it"
        keys.refuse_outside("peak_band_hz", end, *band, hint)
    names = keys.words("mode_names") if "mode_names" in keys else ()
    for name in filter(None, names):
        if names.count(name) > 1 or name.strip() != name or name.isdecimal():
            problem = "occurs twice, is a number, or has spaces around it; give each mode one name"
            raise keys.error("mode_names", f"{name!r} {problem}.")
    return Response(
        keys.choice("drive_point", movable),
        direction,
        band,
        keys.integer("modes"),
        names,
        _reference_force(keys) if "reference_force" in keys else None,
        None if part == band else part,
    )


def _reference_force(keys: CheckedMapping) -> ReferenceForce:
    """Read what dynamic forces are compared with, N: for all places, or by their names."""
    if not keys.is_mapping("reference_force"):
        return keys.number("reference_force", positive=True)
    places = keys["reference_force"]
    return tuple((name, places.number(name, positive=True)) for name in places)


def _check_grounded(
    keys: CheckedMapping, key: str, places: Collection[str], ground: Collection[str], hint: str = ""
) -> None:
    """Refuse the points of a body none of which is one of the ground: a name is misspelt."""
    if not {*places} & {*ground}:
        problem = f"none of its points ({', '.join(places)}) is one of the ground"
        raise keys.error(key, f"{problem} ({', '.join(ground)}); correct a name{hint}.")


def _points(keys: CheckedMapping, key: str) -> dict[str, Point]:
    """Read the points of a body that is not a link, x and z, m."""
    return _checked(keys, key, {point: keys[key].point(point) for point in keys[key]})


def _checked(keys: CheckedMapping, key: str, places: dict[str, Point]) -> dict[str, Point]:
    """Return the places of the points of one body, none of which are far apart."""
    for (first, place), (second, other) in itertools.combinations(places.items(), 2):
        away = math.dist(place, other)
        if away > _LONGEST:
            hint = "lengths are in m, so divide millimetres by 1000"
            raise keys.error(key, f"{first} and {second} are {away:g} m apart; {hint}.")
    return places


def _link(keys: CheckedMapping, name: str, ground: dict[str, Point], read_file: BodyReader) -> Link:
    points = keys["points"]
    places = _checked(keys, "points", {point: points.place(point) for point in points})
    if len(places) < 2:
        raise keys.error("points", "a link has at least two points; add one.")
    straight = [(point, place[0]) for point, place in places.items() if place[1] == 0.0]
    for (_, before), (point, after) in itertools.pairwise(straight):
        if after <= before:
            hint = "list the points in the order in which they lie along the link"
            raise points.error(point, f"{after:g} m is not beyond {before:g} m before it; {hint}.")
    masses = {point: keys["masses"].number(point, positive=True) for point in keys.names("masses")}
    for point in masses.keys() - places.keys():
        raise keys["masses"].error(point, f"{point!r} is not one of: {', '.join(places)}.")
    readers = {"file": read_file, **BODIES}
    kind = next((key for key in readers if key in keys), "material")
    grounded = [point for point in places if point in ground]
    if "clamped" in keys:
        _check_grounded(keys, "clamped", places, ground)
    return Link(
        name=name,
        points=tuple(places.items()),
        body=readers[kind](keys, places),
        count=keys.integer("count", default=1),
        modes=keys.integer("modes", default=20, least=0),
        clamped=keys.choice("clamped", grounded) if "clamped" in keys else None,
        masses=tuple(masses.items()),
        damping=_damping(keys["damping"]) if "damping" in keys else None,
    )


def _damping(keys: CheckedMapping) -> Damping:
    rule = keys.choice("rule", ["rayleigh", "modal_ratio", "loss_factor"], default="rayleigh")
    if rule == "modal_ratio":
        return ModalRatio(_damping_ratio(keys))
    if rule == "loss_factor":
        return LossFactor(keys.number("factor", positive=True))
    return rayleigh_damping(_damping_ratio(keys), *keys.interval("at_hz", positive=True))


def _damping_ratio(keys: CheckedMapping) -> float:
    hint = "nothing would oscillate; write 2 % as 0.02"
    return keys.number("ratio", positive=True, most=1.0, hint=hint)


def _base(keys: CheckedMapping, ground: dict[str, Point], taken: set[str]) -> Base:
    mounts = read_mounts(keys, taken)
    places = _checked(keys, "mounts", ground | {mount.name: mount.at for mount in mounts})
    return Base(read_rigid(keys, GROUND, places), mounts)


def read_rigid(keys: CheckedMapping, name: str, places: dict[str, Point]) -> RigidBody:
    """Read mass, inertia and centre of gravity of a rigid body with points at places (x, z), m."""
    centre = _centre_of_gravity(keys, places)
    hint = "beside it the links lose their digits, so write kg"
    mass = keys.number("mass", positive=True, most=_HEAVIEST, hint=hint)
    inertia = keys.number("inertia", positive=True)
    size = max((math.dist(centre, place) for place in places.values()), default=0.0)
    if size > _FARTHEST:
        problem = f"it is {size:g} m away from a point of the body; divide millimetres by 1000"
        raise keys.error("centre_of_gravity", f"{problem}.")
    radius = math.sqrt(inertia / mass)
    if radius > _WIDEST * max(size, 1.0):
        problem = f"it gives a radius of gyration of {radius:.3g} m with points within {size:.3g} m"
        raise keys.error("inertia", f"{problem}; write kg and kg m2.")
    return RigidBody(name, tuple(places.items()), centre, mass, inertia)


def _centre_of_gravity(keys: CheckedMapping, points: dict[str, Point]) -> Point:
    """Read the place of the centre of gravity: coordinates, or distances from two points."""
    if not keys.is_mapping("centre_of_gravity"):
        return keys.point("centre_of_gravity")
    tape = keys["centre_of_gravity"]
    side = tape.choice("side", ["left", "right"])
    names = [name for name in tape if name != "side"]
    if len(names) != 2 or not all(name in points for name in names):
        hint = f"give the distances from two of the body's points ({', '.join(points)})"
        raise MechanismError(tape.path, f"{hint}.")
    first, second = (tape.number(name, positive=True) for name in names)
    (x1, z1), (x2, z2) = (points[name] for name in names)
    base = math.hypot(x2 - x1, z2 - z1)
    along = (first**2 - second**2 + base**2) / (2.0 * base) if base > 0.0 else math.inf
    if abs(along) > first:
        places = f"{first:g} m from {names[0]} and {second:g} m from {names[1]}"
        raise MechanismError(tape.path, f"no point is {places}, {base:g} m apart; measure again.")
    across = math.sqrt(first**2 - along**2) * (1.0 if side == "left" else -1.0)
    ux, uz = (x2 - x1) / base, (z2 - z1) / base
    return (x1 + along * ux - across * uz, z1 + along * uz + across * ux)


def _spring(keys: CheckedMapping, name: str, points: dict[str, dict[str, Point]]) -> Spring:
    """Read a spring: on the joint of two bodies, or between two points."""
    owners: dict[str, list[str]] = {}
    for body, places in points.items():
        for point in places:
            owners.setdefault(point, []).append(body)
    ends, bodies = _joint(keys, owners) if "joint" in keys else _ends(keys, owners)
    damping = keys.number("damping", default=0.0, least=0.0, most=DAMPEST, hint=RIGID)
    stiffness, retardation = read_stiffness(keys), 0.0
    if stiffness == damping == 0.0:
        raise keys.error("stiffness", "is 0, as is damping; give a positive stiffness or damping.")
    if "loss_factor" in keys:
        loss = keys["loss_factor"]
        if stiffness == 0.0:
            raise keys.error("loss_factor", "it needs a stiffness; give `damping` to a damper.")
        factor = loss.number("factor", least=0.0, most=2.0, hint="it is twice a damping ratio")
        frequency = loss.number("at_hz", least=_SLOWEST, hint="give that of the mode it damps")
        retardation = factor / (2.0 * math.pi * frequency)
    return Spring(name, bodies, ends, stiffness, damping, retardation)


def _joint(keys: CheckedMapping, owners: dict[str, list[str]]) -> _Ends:
    """Read the joint on which a spring acts, and which two of its bodies."""
    point = keys.choice("joint", [point for point, bodies in owners.items() if len(bodies) > 1])
    bodies = owners[point]
    if len(bodies) > 2 or "bodies" in keys:
        chosen = keys.words("bodies")
        if len(chosen) != 2 or not set(chosen) <= set(bodies) or chosen[0] == chosen[1]:
            raise keys.error("bodies", f"choose two of the bodies there: {', '.join(bodies)}.")
        bodies = list(chosen)
    return (point,), (bodies[0], bodies[1])


def _ends(keys: CheckedMapping, owners: dict[str, list[str]]) -> _Ends:
    """Read the two points between which a spring acts, and the bodies that have them."""
    ends = keys.words("between")
    if len(ends) != 2 or ends[0] == ends[1] or not set(ends) <= owners.keys():
        raise keys.error("between", f"give two points, of: {', '.join(owners)}.")
    first, second = (owners[point][0] for point in ends)
    if first == second:
        raise keys.error("between", f"both points are on {first}; a spring joins two bodies.")
    return ends, (first, second)


def _check_topology(mechanism: Mechanism) -> None:
    used = {mechanism.response.point, *(p for each in mechanism.springs for p in each.points)}
    places = [(point, body.name) for body in mechanism.bodies for point, _ in body.points]
    lonely = [(p, body) for p, body in places if len(mechanism.owners(p)) == 1 and p not in used]
    once = ", ".join(f"{point} of {body}" for point, body in lonely) or "none"
    for name, _ in mechanism.ground:
        if len(mechanism.owners(name)) == 1 and name not in used:
            hint = f"remove it, or correct a name (points that only one body has: {once})"
            raise MechanismError(f"ground.{name}", f"no body has a point of this name; {hint}.")
    for link, spring in itertools.product(mechanism.links, mechanism.springs):
        if spring.points == (link.clamped,) and set(spring.bodies) == {GROUND, link.name}:
            problem = f"the clamp locks the joint on which springs.{spring.name} acts"
            raise MechanismError(f"links.{link.name}.clamped", f"{problem}; remove one of them.")
    freedom = 3 * len(mechanism.bodies) - 2 * len(mechanism.joints)
    shared: dict[tuple[str, ...], list[str]] = {}
    for point in dict.fromkeys(point for point, _, _ in mechanism.joints):
        for pair in itertools.combinations(mechanism.owners(point), 2):
            shared.setdefault(pair, []).append(point)
    twice = {pair: points for pair, points in shared.items() if len(points) > 1}
    problem = (
        f"{len(mechanism.bodies)} bodies with {len(mechanism.joints)} pins leave {freedom} degrees "
        "of freedom where one input angle needs exactly 1; points are joined where their names are "
        f"the same (points that only one body has: {once})."
    )
    if freedom == 2:  # a missing pin leaves 3
        problem += " Describe a second input, such as a cylinder as upper link, as a link, with one"
        problem += " file for each of its lengths."
    if freedom < 1 and twice:
        (first, second), points = next(iter(twice.items()))
        problem = (
            f"{first} and {second} are joined at {' and '.join(points)}, as one body; join two "
            "bodies at one point, and give equal links side by side as one with `count: 2`."
        )
    if freedom != 1:
        raise MechanismError("links", problem)
