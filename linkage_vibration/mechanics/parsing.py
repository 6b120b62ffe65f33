# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A mapping, as read from YAML, goes in; a validated mechanism comes out.

The first wrong, missing or unknown key raises `MechanismError` with its path and the mend.
"""

import difflib
import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal

from linkage_vibration.mechanics.description import (
    GROUND,
    Beam,
    Damping,
    Frfs,
    Link,
    LossFactor,
    Material,
    Matrices,
    Mechanism,
    MechanismError,
    ModalRatio,
    Point,
    Response,
    RigidBody,
    Section,
    Segment,
    Spring,
    rayleigh_damping,
)
from linkage_vibration.mechanics.sections import rectangle, tube

# No linkage comes near these limits; numbers in millimetres, tonnes, GPa or N/mm2 go beyond them.
_LONGEST = 100.0  # m, between two points of a body
_HEAVIEST = 1e6  # kg, a link
_SOFTEST = 1e6  # Pa, rubber; metals in N/mm2 are below
_STIFFEST = 1e18  # Pa; beside what is stiffer, rounding moves the first mode by more than 1e-5
_STIFF, _FLIMSY = 1e9, (0.5, 25.0)  # Pa, and kg/m3 that no solid so stiff has; in g/cm3 all have
_WIDEST = 10.0  # m and times the size of a rigid body, its radius of gyration
_HEAVIEST_BODY = 1e9  # kg, a rigid body

_LARGEST = 1e30  # SI; powers of what is larger overflow


def no_files(keys: "Keys", points: dict[str, Point]) -> Matrices | Frfs:
    """Refuse links from files, where no reader stands by."""
    raise MechanismError(
        keys.path, "a file cannot be read here; describe a beam, or read the mechanism from a file."
    )


def mechanism_from_mapping(
    mapping: Any,
    read_body: "Callable[[Keys, dict[str, Point]], Matrices | Frfs]" = no_files,
) -> Mechanism:
    """Validate a mapping and return the mechanism that it describes.

    Parameters
    ----------
    mapping : Any
        Nested mappings of numbers and text; the shipped ``three_point_linkage.yaml`` shows every
        key. Keys that end in ``_deg`` are in degrees, all else is SI.
    read_body : callable
        Turns the keys of a link that has a ``file``, and its points, into matrices or FRFs.

    Raises
    ------
    MechanismError
        At the first wrong, missing or unknown key, naming it, the problem and the mend.
    """
    top = Keys("", mapping)
    ground = tuple((name, top["ground"].point(name)) for name in top["ground"])
    links = tuple(_link(top["links"][name], name, dict(ground), read_body) for name in top["links"])
    rigid_bodies = tuple(
        _rigid_body(top["rigid_bodies"][name], name) for name in top.names("rigid_bodies")
    )
    points = {GROUND: dict(ground)}
    bodies: tuple[Link | RigidBody, ...] = links + rigid_bodies
    for body in bodies:
        if body.name in points:
            raise MechanismError(body.name, "two bodies have this name; rename one.")
        points[body.name] = dict(body.points)

    drive = top["input"]
    grounded = [name for name in points if name != GROUND and points[name].keys() & dict(ground)]
    input_body = drive.choice("link", grounded)
    stroke_deg = drive.interval("range_deg")
    assembly = top["assembly"]
    others = [name for name in points if name not in (GROUND, input_body)]
    guesses = tuple((name, math.radians(assembly["angles_deg"].number(name))) for name in others)
    response = top["response"]
    movable = {point: None for name in points if name != GROUND for point in points[name]}
    direction: Literal["x", "z"] = "x" if response.choice("direction", ["x", "z"]) == "x" else "z"
    mechanism = Mechanism(
        name=top.text("name"),
        ground=ground,
        links=links,
        rigid_bodies=rigid_bodies,
        springs=tuple(_spring(top["springs"][name], name, points) for name in top.names("springs")),
        input_body=input_body,
        stroke=(math.radians(stroke_deg[0]), math.radians(stroke_deg[1])),
        assembly_alpha3=math.radians(assembly.number("alpha3_deg")),
        assembly_angles=guesses,
        damping=_damping(top["damping"]),
        response=Response(
            point=response.choice("drive_point", list(movable)),
            direction=direction,
            band=response.interval("band_hz"),
            modes=response.integer("modes"),
        ),
    )
    if mechanism.response.band[0] < 0.0:
        raise MechanismError("response.band_hz", "frequencies are not negative; begin at 0.")
    top.refuse_unknown()
    _check_lengths(mechanism)
    _check_topology(mechanism)
    return mechanism


def _link(
    keys: "Keys",
    name: str,
    ground: dict[str, Point],
    read_body: "Callable[[Keys, dict[str, Point]], Matrices | Frfs]",
) -> Link:
    points = keys["points"]
    places = {point: points.place(point) for point in points}
    if len(places) < 2:
        raise MechanismError(points.path, "a link has at least two points; add one.")
    straight = [(point, place[0]) for point, place in places.items() if place[1] == 0.0]
    for (_, before), (point, after) in zip(straight, straight[1:], strict=False):
        if after <= before:
            raise MechanismError(
                f"{points.path}.{point}",
                f"{after:g} m does not lie beyond the point before it ({before:g} m); list the "
                "points in the order in which they lie along the link.",
            )
    body = read_body(keys, places) if "file" in keys else _beam(keys, places)
    return Link(
        name=name,
        points=tuple(places.items()),
        body=body,
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


def read_material(keys: "Keys") -> Material:
    """Read an isotropic material."""
    poisson = keys.number("poisson_ratio")
    if not -1.0 < poisson < 0.5:
        raise MechanismError(
            f"{keys.path}.poisson_ratio", f"{poisson:g} is not between -1 and 0.5; steel: 0.3."
        )
    modulus = keys.number("youngs_modulus", positive=True)
    if modulus < _SOFTEST:
        raise MechanismError(
            f"{keys.path}.youngs_modulus",
            f"{modulus:g} Pa is softer than rubber; write it in Pa (steel: 210.0e+9).",
        )
    if modulus > _STIFFEST:
        raise MechanismError(
            f"{keys.path}.youngs_modulus",
            f"{modulus:g} Pa leaves no digits to the other links; describe what is rigid under "
            "rigid_bodies.",
        )
    density = keys.number("density", positive=True)
    if modulus > _STIFF and _FLIMSY[0] < density < _FLIMSY[1]:
        raise MechanismError(
            f"{keys.path}.density",
            f"no solid of {modulus:g} Pa weighs {density:g} kg/m3; write it in kg/m3 (steel: "
            "7800.0; 0.001 for a link without mass).",
        )
    return Material(modulus, density, poisson)


def _beam(keys: "Keys", places: dict[str, Point]) -> Beam:
    material = read_material(keys["material"])
    poisson = material.poisson_ratio
    end = max(x for x, _ in places.values())
    if "sections" not in keys:
        segments: tuple[Segment, ...] = (Segment(end, _section(keys["section"], poisson)),)
    else:
        steps = keys.items("sections")
        segments = tuple(
            Segment(step.number("until", default=end), _section(step, poisson)) for step in steps
        )
        for step, before, after in zip(steps[1:], segments, segments[1:], strict=False):
            if after.end <= before.end:
                raise MechanismError(
                    f"{step.path}.until",
                    f"{after.end:g} m does not lie beyond the section before it, which ends at "
                    f"{before.end:g} m; list the sections along the link.",
                )
        if segments[-1].end < end:
            raise MechanismError(
                steps[-1].path, f"the last section ends before the last point ({end:g} m)."
            )
    begin = min(0.0, *(x for x, _ in places.values()))
    _check_proportions(keys, segments, begin, material.density)
    return Beam(material, segments, keys.integer("elements", default=24))


def _check_proportions(
    keys: "Keys", segments: tuple[Segment, ...], begin: float, density: float
) -> None:
    """Refuse a link that is no beam, or has its section and its length in different units."""
    length = segments[-1].end - begin
    depth = min(math.sqrt(12.0 * s.section.second_moment / s.section.area) for s in segments)
    if depth > length:
        raise MechanismError(
            f"{keys.path}.{'sections' if 'sections' in keys else 'section'}",
            f"a bar {depth:g} m deep and {length:g} m long is no beam; if both are in m, describe "
            "it under rigid_bodies, or by matrices.",
        )
    starts = (begin, *(segment.end for segment in segments))
    volume = sum(s.section.area * (s.end - a) for a, s in zip(starts, segments, strict=False))
    if volume * density > _HEAVIEST:
        raise MechanismError(
            keys.path,
            f"{length:g} m long it weighs {volume * density:.3g} kg, as no link does; write "
            "lengths in m (millimetres divided by 1000), areas in m2 and densities in kg/m3.",
        )


def _section(keys: "Keys", poisson_ratio: float) -> Section:
    shape = keys.choice("shape", ["rectangle", "tube", "round", "general"])
    if shape == "rectangle":
        width, height = keys.number("width", positive=True), keys.number("height", positive=True)
        return rectangle(width, height, poisson_ratio)
    if shape == "round":
        return tube(keys.number("diameter", positive=True), 0.0, poisson_ratio)
    if shape == "general":
        return Section(
            area=keys.number("area", positive=True),
            second_moment=keys.number("second_moment", positive=True),
            shear_coefficient=keys.number("shear_coefficient", positive=True, default=5 / 6),
            second_moment_out=keys.number("second_moment_out", positive=True, default=math.nan),
            shear_coefficient_out=keys.number(
                "shear_coefficient_out", positive=True, default=5 / 6
            ),
            torsion_constant=keys.number("torsion_constant", positive=True, default=math.nan),
        )
    outer = keys.number("outer_diameter", positive=True)
    inner = keys.number("inner_diameter", positive=True)
    if inner >= outer:
        raise MechanismError(
            f"{keys.path}.inner_diameter",
            f"{inner:g} m does not fit into the outer diameter of {outer:g} m.",
        )
    return tube(outer, inner, poisson_ratio)


def _damping(keys: "Keys") -> Damping:
    rule = keys.choice("rule", ["rayleigh", "modal_ratio", "loss_factor"], default="rayleigh")
    if rule == "modal_ratio":
        return ModalRatio(keys.number("ratio", positive=True))
    if rule == "loss_factor":
        return LossFactor(keys.number("factor", positive=True))
    at = keys.interval("at_hz", positive=True)
    return rayleigh_damping(keys.number("ratio", positive=True), *at)


def _rigid_body(keys: "Keys", name: str) -> RigidBody:
    points = keys["points"]
    places = {point: points.point(point) for point in points}
    centre = _centre_of_gravity(keys, places)
    mass, inertia = keys.number("mass", positive=True), keys.number("inertia", positive=True)
    if mass > _HEAVIEST_BODY:
        raise MechanismError(
            f"{keys.path}.mass",
            f"{mass:g} kg leaves no digits to the links; write kg, up to {_HEAVIEST_BODY:g}.",
        )
    size = max((math.dist(centre, place) for place in places.values()), default=0.0)
    radius = math.sqrt(inertia / mass)
    if radius > _WIDEST * max(size, 1.0):
        raise MechanismError(
            f"{keys.path}.inertia",
            f"with {mass:g} kg it makes a radius of gyration of {radius:.3g} m, but the points are "
            f"within {size:.3g} m of the centre of gravity; write kg and kg m2.",
        )
    return RigidBody(name, tuple(places.items()), centre, mass, inertia)


def _centre_of_gravity(keys: "Keys", points: dict[str, Point]) -> Point:
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


def _spring(keys: "Keys", name: str, points: dict[str, dict[str, Point]]) -> Spring:
    """Read a spring: on the joint of two bodies, or between two points."""
    owners: dict[str, list[str]] = {}
    for body, places in points.items():
        for point in places:
            owners.setdefault(point, []).append(body)
    if "joint" in keys:
        joints = [point for point, bodies in owners.items() if len(bodies) > 1]
        ends: tuple[str, ...] = (keys.choice("joint", joints),)
        bodies = owners[ends[0]]
        if len(bodies) > 2 or "bodies" in keys:
            chosen = keys.words("bodies")
            if len(chosen) != 2 or not set(chosen) <= set(bodies) or chosen[0] == chosen[1]:
                raise MechanismError(
                    f"{keys.path}.bodies", f"choose two of the bodies there: {', '.join(bodies)}."
                )
            bodies = list(chosen)
    else:
        words = keys.words("between")
        if len(words) != 2 or words[0] == words[1] or not set(words) <= owners.keys():
            raise MechanismError(
                f"{keys.path}.between", f"give two points, of: {', '.join(owners)}."
            )
        ends = words
        bodies = [owners[point][0] for point in ends]
        if bodies[0] == bodies[1]:
            raise MechanismError(
                f"{keys.path}.between",
                f"both points are on {bodies[0]}; a spring joins two bodies.",
            )
    return Spring(
        name=name,
        bodies=(bodies[0], bodies[1]),
        points=ends,
        stiffness=keys.number("stiffness", positive=True),
        damping=keys.number("damping", default=0.0),
    )


def _check_lengths(mechanism: Mechanism) -> None:
    places = {"ground": mechanism.ground}
    places.update({f"links.{link.name}.points": link.points for link in mechanism.links})
    places.update({f"rigid_bodies.{b.name}.points": b.points for b in mechanism.rigid_bodies})
    for path, points in places.items():
        for (first, place), (second, other) in itertools.combinations(points, 2):
            if math.dist(place, other) > _LONGEST:
                raise MechanismError(
                    path,
                    f"{first} and {second} are {math.dist(place, other):g} m apart; lengths are in "
                    "m, so divide millimetres by 1000.",
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
        (one, other), points = next(iter(twice.items()))
        raise MechanismError(
            "links",
            f"{one} and {other} are joined at {' and '.join(points)}, which holds them to one "
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


class Keys:
    """A mapping with its path, read key by key with checks; remembers what was read."""

    def __init__(self, path: str, value: Any) -> None:
        if not isinstance(value, Mapping):
            raise MechanismError(path or "(top)", f"{value!r} is not a mapping of keys to values.")
        for key in value:
            if not isinstance(key, str):
                raise MechanismError(
                    path or "(top)", f"the key {key!r} is not text; put it in quotes."
                )
        self.path = path
        self._value = value
        self._children: dict[str, Keys] = {}
        self._lists: dict[str, list[Keys]] = {}
        self._read: set[str] = set()

    def __iter__(self) -> Iterator[str]:
        """Return the keys, in their order."""
        return iter(self._value)

    def __contains__(self, key: str) -> bool:
        """Tell whether a key is there."""
        return key in self._value

    def __getitem__(self, key: str) -> "Keys":
        """Return the mapping below a key."""
        if key not in self._children:
            self._children[key] = Keys(self._at(key), self._get(key))
        return self._children[key]

    def names(self, key: str) -> list[str]:
        """Return the keys of the mapping below a key that may be missing."""
        return list(self[key]) if key in self else []

    def items(self, key: str) -> "list[Keys]":
        """Return the mappings of the list below a key."""
        value = self._get(key)
        if not isinstance(value, list) or not value:
            raise MechanismError(self._at(key), f"{value!r} is not a list of mappings.")
        if key not in self._lists:
            self._lists[key] = [Keys(f"{self._at(key)}[{i}]", v) for i, v in enumerate(value)]
        return self._lists[key]

    def is_mapping(self, key: str) -> bool:
        """Tell whether a mapping stands below a key."""
        return isinstance(self._value.get(key), Mapping)

    def member(self, key: str, allowed: Mapping[str, object]) -> str:
        """Return a key that must be one of those allowed."""
        if key not in allowed:
            raise MechanismError(self._at(key), f"{key!r} is none of: {', '.join(allowed)}.")
        return key

    def number(self, key: str, *, positive: bool = False, default: float | None = None) -> float:
        """Return a finite number."""
        if default is not None and key not in self:
            return default
        value = self._finite(self._at(key), self._get(key))
        if positive and value <= 0.0:
            raise MechanismError(self._at(key), f"{value:g} is not greater than zero.")
        return value

    def integer(self, key: str, *, default: int | None = None, least: int = 1) -> int:
        """Return a whole number from the least, 0 or 1, to 10000."""
        value = default if default is not None and key not in self else self._get(key)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= 10_000:
            raise MechanismError(
                self._at(key), f"{value!r} is not a whole number from {least} to 10000."
            )
        return value

    def text(self, key: str) -> str:
        """Return text that is not empty."""
        value = self._get(key)
        if not isinstance(value, str) or not value:
            raise MechanismError(self._at(key), f"{value!r} is not text.")
        return value

    def words(self, key: str) -> tuple[str, ...]:
        """Return a list of texts."""
        value = self._get(key)
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise MechanismError(self._at(key), f"{value!r} is not a list of names.")
        return tuple(value)

    def choice(self, key: str, allowed: list[str], *, default: str | None = None) -> str:
        """Return one of the texts allowed."""
        value = default if default is not None and key not in self else self._get(key)
        if value not in allowed:
            raise MechanismError(self._at(key), f"{value!r} is none of: {', '.join(allowed)}.")
        return str(value)

    def place(self, key: str) -> Point:
        """Return a place on a link: a number along its axis, or [x, z] beside it."""
        if isinstance(self._value.get(key), list | tuple):
            return self.point(key)
        return (self.number(key), 0.0)

    def point(self, key: str) -> Point:
        """Return a pair of coordinates."""
        return self._pair(key, "a point [x, z] in m")

    def interval(self, key: str, *, positive: bool = False) -> tuple[float, float]:
        """Return an ascending pair of numbers."""
        low, high = self._pair(key, "an interval [from, to]")
        if high <= low or (positive and low <= 0.0):
            above = " and both are greater than zero" if positive else ""
            raise MechanismError(
                self._at(key), f"[{low:g}, {high:g}] does not ascend{above}; give [from, to]."
            )
        return low, high

    def refuse_unknown(self) -> None:
        """Refuse keys that nothing asked for: a misspelt key must not be ignored in silence."""
        children = [*self._children.values()]
        for some in self._lists.values():
            children += some
        for child in children:
            child.refuse_unknown()
        for key in self._value:
            if key not in self._read:
                near = difflib.get_close_matches(key, self._read, 1)
                mend = f"did you mean {near[0]}?" if near else "remove it."
                raise MechanismError(self._at(key), f"this key is not known here; {mend}")

    def _at(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key

    def _get(self, key: str) -> Any:
        self._read.add(key)
        if key not in self._value:
            near = [
                other
                for other in difflib.get_close_matches(key, self._value, 1)
                if other not in self._read
            ]
            hint = f" ({near[0]} stands there: is it misspelt?)" if near else ""
            raise MechanismError(self._at(key), f"this key is missing; add it{hint}.")
        return self._value[key]

    def _pair(self, key: str, what: str) -> tuple[float, float]:
        value = self._get(key)
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise MechanismError(self._at(key), f"{value!r} is not {what}.")
        first, second = (self._finite(f"{self._at(key)}[{i}]", v) for i, v in enumerate(value))
        return first, second

    @staticmethod
    def _finite(path: str, value: Any) -> float:
        if isinstance(value, str):
            raise MechanismError(
                path, f"{value!r} is text, not a number; YAML wants 2.1e+11, not 2.1e11 or 21e10."
            )
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise MechanismError(path, f"{value!r} is not a number.")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise MechanismError(path, f"{value!r} is not a finite number.")
        if abs(number) > _LARGEST:
            raise MechanismError(
                path, f"{number:g} is larger than any number of a mechanism; check its unit."
            )
        return number
