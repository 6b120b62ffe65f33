# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a mechanism is made of: a mapping goes in, validated frozen dataclasses come out.

Points that carry the same name on two bodies are joined by a pin there; a name that stands under
``ground`` as well is pinned to the ground. Nothing else has to be said about the topology.
"""

import difflib
import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from linkage_vibration.errors import LinkageVibrationError

GROUND = "ground"

FORMULATION = 1
"""Part of every model hash; to be raised when a change of the mechanics changes its numbers."""

Point = tuple[float, float]


class MechanismError(LinkageVibrationError):
    """The description of a mechanism is wrong; the text names the key and the mend.

    Parameters
    ----------
    path : str
        Where in the description, such as ``links.lower_link.section.width``.
    problem : str
        What is wrong there, and what would mend it.
    """

    def __init__(self, path: str, problem: str) -> None:
        super().__init__(f"{path}: {problem}")
        self.path = path
        self.problem = problem


@dataclass(frozen=True, slots=True)
class Material:
    """An isotropic linear-elastic material."""

    youngs_modulus: float  # Pa
    density: float  # kg/m3
    poisson_ratio: float  # 1

    @property
    def shear_modulus(self) -> float:
        """G = E / (2 (1 + nu)), in Pa."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))


@dataclass(frozen=True, slots=True)
class Section:
    """The cross-section of a beam, as bending in the plane of motion needs it."""

    area: float  # m2
    second_moment: float  # m4, about the axis normal to the plane of motion
    shear_coefficient: float  # 1, effective shear area over area


@dataclass(frozen=True, slots=True)
class Link:
    """A straight elastic link with its pins on its axis.

    The local x axis runs along the link from its first point; ``count`` equal links side by side
    move as one in the plane.
    """

    name: str
    points: tuple[tuple[str, float], ...]  # name and m along the axis, ascending
    material: Material
    section: Section
    count: int
    elements: int
    modes: int
    clamped: str | None  # a ground point at which the ground holds the link's rotation too


@dataclass(frozen=True, slots=True)
class RigidBody:
    """A rigid body with points in its own frame."""

    name: str
    points: tuple[tuple[str, Point], ...]  # name and m in the body's own axes
    centre_of_gravity: Point  # m in the body's own axes
    mass: float  # kg
    inertia: float  # kg m2, about the centre of gravity


@dataclass(frozen=True, slots=True)
class Damping:
    """Rayleigh damping C = a M + b K, the same a and b for every component.

    Being proportional with one pair for all, it gives each component its C (as coupling by FRFs
    needs) and leaves the modes of the assembly real.
    """

    mass_coefficient: float  # a, 1/s
    stiffness_coefficient: float  # b, s


@dataclass(frozen=True, slots=True)
class Response:
    """What is asked of the model at every angle."""

    point: str
    direction: Literal["x", "z"]
    band: tuple[float, float]  # Hz
    modes: int


@dataclass(frozen=True, slots=True)
class Mechanism:
    """A planar linkage with one input angle, alpha3."""

    name: str
    ground: tuple[tuple[str, Point], ...]  # name and m in the global x, z axes
    links: tuple[Link, ...]
    rigid_bodies: tuple[RigidBody, ...]
    input_link: str
    stroke: tuple[float, float]  # rad, the range of alpha3 that is used
    assembly_alpha3: float  # rad, where the branch is told
    assembly_angles: tuple[tuple[str, float], ...]  # rad, about where each other body points there
    damping: Damping
    response: Response

    @property
    def bodies(self) -> tuple[Link | RigidBody, ...]:
        """Links, then rigid bodies, each in the order of the description."""
        return self.links + self.rigid_bodies

    @property
    def model_hash(self) -> str:
        """Hash of every number that a prediction depends on, 64 hexadecimal digits.

        Comments, spelling and the order of keys in a file do not enter it; numbers do with 12
        digits, so that the last bit of another machine's square root makes no other model.
        """
        content = _rounded({"formulation": FORMULATION, **asdict(self)})
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def local_points(self, body: str) -> dict[str, Point]:
        """Return a body's points in its own axes, in m; the ground's in the global axes."""
        if body == GROUND:
            return dict(self.ground)
        for link in self.links:
            if link.name == body:
                return {name: (x, 0.0) for name, x in link.points}
        for rigid in self.rigid_bodies:
            if rigid.name == body:
                return dict(rigid.points)
        raise KeyError(body)

    def owners(self, point: str) -> tuple[str, ...]:
        """Return the bodies that carry a point, the ground first."""
        names = (GROUND, *(body.name for body in self.bodies))
        return tuple(name for name in names if point in self.local_points(name))

    def joints(self) -> tuple[tuple[str, str, str], ...]:
        """Return every pin as (point, one body, other body); k bodies at a point make k - 1."""
        found: dict[str, None] = {}
        for name in (GROUND, *(body.name for body in self.bodies)):
            found.update(dict.fromkeys(self.local_points(name)))
        pins = []
        for point in found:
            first, *others = self.owners(point)
            pins += [(point, first, other) for other in others]
        return tuple(pins)


def rayleigh_damping(ratio: float, low: float, high: float) -> Damping:
    """Rayleigh coefficients that give one damping ratio at two frequencies.

    Solves zeta = a / (2 w) + b w / 2 at both; between them the ratio is lower, outside higher.

    Parameters
    ----------
    ratio : float
        Damping ratio zeta, 1.
    low, high : float
        The two frequencies, Hz.

    Examples
    --------
    >>> damping = rayleigh_damping(0.02, 4.0, 180.0)
    >>> omega = 2 * math.pi * 180.0
    >>> ratio = damping.mass_coefficient / (2 * omega) + damping.stiffness_coefficient * omega / 2
    >>> round(ratio, 12)
    0.02
    """
    w1, w2 = 2.0 * math.pi * low, 2.0 * math.pi * high
    return Damping(2.0 * ratio * w1 * w2 / (w1 + w2), 2.0 * ratio / (w1 + w2))


def rectangle(width: float, height: float, poisson_ratio: float) -> Section:
    """Return a full rectangle, ``height`` in the plane of motion, m; shear after Cowper (1966)."""
    shear = 10.0 * (1.0 + poisson_ratio) / (12.0 + 11.0 * poisson_ratio)
    return Section(width * height, width * height**3 / 12.0, shear)


def tube(outer: float, inner: float, poisson_ratio: float) -> Section:
    """Return a round tube of the given diameters in m (inner 0: a full bar); shear after Cowper."""
    area = math.pi * (outer**2 - inner**2) / 4.0
    second_moment = math.pi * (outer**4 - inner**4) / 64.0
    m2 = (inner / outer) ** 2
    nu = poisson_ratio
    shear = 6.0 * (1 + nu) * (1 + m2) ** 2 / ((7 + 6 * nu) * (1 + m2) ** 2 + (20 + 12 * nu) * m2)
    return Section(area, second_moment, shear)


def mechanism_from_mapping(mapping: Any) -> Mechanism:
    """Validate a mapping as read from YAML and return the mechanism that it describes.

    Parameters
    ----------
    mapping : Any
        Nested mappings of numbers and text; the shipped ``three_point_linkage.yaml`` shows every
        key. Keys that end in ``_deg`` are in degrees, all else is SI.

    Raises
    ------
    MechanismError
        At the first wrong, missing or unknown key, naming it, the problem and the mend.
    """
    top = _Keys("", mapping)
    ground = tuple((name, top["ground"].point(name)) for name in top["ground"])
    links = tuple(_link(top["links"][name], name, dict(ground)) for name in top["links"])
    rigid_bodies = tuple(
        _rigid_body(top["rigid_bodies"][name], name) for name in top.optional("rigid_bodies", {})
    )
    bodies = [body.name for body in links] + [body.name for body in rigid_bodies]
    for name in bodies:
        if name == GROUND or bodies.count(name) > 1:
            raise MechanismError(f"links.{name}", "two bodies have this name; rename one.")

    drive = top["input"]
    grounded = [link.name for link in links if any(name in dict(ground) for name, _ in link.points)]
    input_link = drive.choice("link", grounded)  # links with a pin on the ground
    stroke_deg = drive.interval("range_deg")
    assembly = top["assembly"]
    others = [name for name in bodies if name != input_link]
    angles = assembly["angles_deg"]
    guesses = tuple((name, math.radians(angles.number(name))) for name in others)

    damping = top["damping"]
    at = damping.interval("at_hz", positive=True)
    response = top["response"]
    points = [name for link in links for name, _ in link.points]
    points += [name for body in rigid_bodies for name, _ in body.points]
    direction: Literal["x", "z"] = "x" if response.choice("direction", ["x", "z"]) == "x" else "z"
    mechanism = Mechanism(
        name=top.text("name"),
        ground=ground,
        links=links,
        rigid_bodies=rigid_bodies,
        input_link=input_link,
        stroke=(math.radians(stroke_deg[0]), math.radians(stroke_deg[1])),
        assembly_alpha3=math.radians(assembly.number("alpha3_deg")),
        assembly_angles=guesses,
        damping=rayleigh_damping(damping.number("ratio", positive=True), *at),
        response=Response(
            point=response.choice("drive_point", list(dict.fromkeys(points))),
            direction=direction,
            band=response.interval("band_hz"),
            modes=response.integer("modes"),
        ),
    )
    if mechanism.response.band[0] < 0.0:
        raise MechanismError("response.band_hz", "frequencies are not negative; begin at 0.")
    top.refuse_unknown()
    _check_topology(mechanism)
    return mechanism


def _link(keys: "_Keys", name: str, ground: dict[str, Point]) -> Link:
    points = keys["points"]
    places = [(point, points.number(point)) for point in points]
    if len(places) < 2:
        raise MechanismError(points.path, "a link has at least two points; add one.")
    for (_, before), (point, after) in zip(places, places[1:], strict=False):
        if after <= before:
            raise MechanismError(
                f"{points.path}.{point}",
                f"{after:g} m does not lie beyond the point before it ({before:g} m); list the "
                "points in the order in which they lie along the link.",
            )
    clamped = None
    if "clamped" in keys:
        clamped = keys.choice("clamped", [point for point, _ in places if point in ground])
    material = keys["material"]
    poisson = material.number("poisson_ratio")
    if not -1.0 < poisson < 0.5:
        raise MechanismError(
            f"{material.path}.poisson_ratio", f"{poisson:g} is not between -1 and 0.5; steel: 0.3."
        )
    return Link(
        name=name,
        points=tuple(places),
        material=Material(
            material.number("youngs_modulus", positive=True),
            material.number("density", positive=True),
            poisson,
        ),
        section=_section(keys["section"], poisson),
        count=keys.integer("count", default=1),
        elements=keys.integer("elements", default=24),
        modes=keys.integer("modes", default=20),
        clamped=clamped,
    )


def _section(keys: "_Keys", poisson_ratio: float) -> Section:
    shape = keys.choice("shape", ["rectangle", "tube", "round"])
    if shape == "rectangle":
        width, height = keys.number("width", positive=True), keys.number("height", positive=True)
        return rectangle(width, height, poisson_ratio)
    if shape == "round":
        return tube(keys.number("diameter", positive=True), 0.0, poisson_ratio)
    outer = keys.number("outer_diameter", positive=True)
    inner = keys.number("inner_diameter", positive=True)
    if inner >= outer:
        raise MechanismError(
            f"{keys.path}.inner_diameter",
            f"{inner:g} m does not fit into the outer diameter of {outer:g} m.",
        )
    return tube(outer, inner, poisson_ratio)


def _rigid_body(keys: "_Keys", name: str) -> RigidBody:
    points = keys["points"]
    places = tuple((point, points.point(point)) for point in points)
    return RigidBody(
        name=name,
        points=places,
        centre_of_gravity=_centre_of_gravity(keys, dict(places)),
        mass=keys.number("mass", positive=True),
        inertia=keys.number("inertia", positive=True),
    )


def _centre_of_gravity(keys: "_Keys", points: dict[str, Point]) -> Point:
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


def _check_topology(mechanism: Mechanism) -> None:
    for name, _ in mechanism.ground:
        if len(mechanism.owners(name)) == 1:
            raise MechanismError(f"ground.{name}", "no body has a point of this name; remove it.")
    freedom = 3 * len(mechanism.bodies) - 2 * len(mechanism.joints())
    if freedom != 1:
        raise MechanismError(
            "links",
            f"{len(mechanism.bodies)} bodies with {len(mechanism.joints())} pins leave {freedom} "
            "degrees of freedom where one input angle needs exactly 1; points are joined where "
            "their names are the same, so look for a misspelt one.",
        )


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return f"{value:.12g}" if isinstance(value, float) else value


class _Keys:
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
        self._children: dict[str, _Keys] = {}
        self._read: set[str] = set()

    def __iter__(self) -> Iterator[str]:
        return iter(self._value)

    def __contains__(self, key: str) -> bool:
        return key in self._value

    def __getitem__(self, key: str) -> "_Keys":
        if key not in self._children:
            self._children[key] = _Keys(self._at(key), self._get(key))
        return self._children[key]

    def optional(self, key: str, default: Any) -> Any:
        return self[key] if key in self._value else default

    def is_mapping(self, key: str) -> bool:
        return isinstance(self._value.get(key), Mapping)

    def number(self, key: str, *, positive: bool = False) -> float:
        value = self._finite(self._at(key), self._get(key))
        if positive and value <= 0.0:
            raise MechanismError(self._at(key), f"{value:g} is not greater than zero.")
        return value

    def integer(self, key: str, *, default: int | None = None) -> int:
        value = default if default is not None and key not in self else self._get(key)
        if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= 10_000:
            raise MechanismError(self._at(key), f"{value!r} is not a whole number from 1 to 10000.")
        return value

    def text(self, key: str) -> str:
        value = self._get(key)
        if not isinstance(value, str) or not value:
            raise MechanismError(self._at(key), f"{value!r} is not text.")
        return value

    def choice(self, key: str, allowed: list[str]) -> str:
        value = self._get(key)
        if value not in allowed:
            raise MechanismError(self._at(key), f"{value!r} is none of: {', '.join(allowed)}.")
        return str(value)

    def point(self, key: str) -> Point:
        return self._pair(key, "a point [x, z] in m")

    def interval(self, key: str, *, positive: bool = False) -> tuple[float, float]:
        low, high = self._pair(key, "an interval [from, to]")
        if high <= low or (positive and low <= 0.0):
            above = " and both are greater than zero" if positive else ""
            raise MechanismError(
                self._at(key), f"[{low:g}, {high:g}] does not ascend{above}; give [from, to]."
            )
        return low, high

    def refuse_unknown(self) -> None:
        """Refuse keys that nothing asked for: a misspelt key must not be ignored in silence."""
        for child in self._children.values():
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
        return number
