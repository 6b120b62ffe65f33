# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a mechanism is made of, as frozen data.

Points of the same name on two bodies are joined by a pin; a point whose name is also one of the
ground's is pinned to the ground. This defines the whole topology.
"""

import dataclasses
import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
import scipy

from linkage_vibration.errors import LinkageVibrationError, check_type
from linkage_vibration.mechanics.arrays import FloatArray, symmetric
from linkage_vibration.mechanics.components import CENTRE_OF_GRAVITY, Component, FrfComponent
from linkage_vibration.mechanics.dofs import Dofs, InterfaceDof

GROUND = "ground"
"""The name of the ground; a base that moves has it too."""

FORMULATION = 3
"""Part of every model hash; raise it when a change of the mechanics changes its numbers."""

_LATER = {"later": True}  # Such a field enters the model hash only if it differs from its default.

Point = tuple[float, float]

ReferenceForce = float | tuple[tuple[str, float], ...]
"""N: one for all places of forces, or names of places with theirs."""


class MechanismError(LinkageVibrationError):
    """The description of a mechanism is invalid at a path; the text names the key and the fix."""

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
    """The cross-section of a beam."""

    area: float  # m2
    second_moment: float  # m4, for bending in the plane of motion
    shear_coefficient: float  # 1, effective shear area over area, in the plane of motion
    # The same across the plane; NaN if they do not follow from dimensions. They do not enter the
    # hash, which the dimensions enter through the others.
    second_moment_across: float = field(default=math.nan, compare=False)
    shear_coefficient_across: float = field(default=math.nan, compare=False)

    @property
    def turned(self) -> "Section":
        """The section for bending across the plane of motion."""
        return Section(self.area, self.second_moment_across, self.shear_coefficient_across)


@dataclass(frozen=True, slots=True)
class Rayleigh:
    """C = a M + b K; the same a and b for all components leaves the modes real."""

    loss_factor: ClassVar[float] = 0.0
    mass_coefficient: float  # a, 1/s
    stiffness_coefficient: float  # b, s

    def viscous(self, mass: FloatArray, stiffness: FloatArray) -> FloatArray:
        """Return the viscous damping of a component, (n, n), from its mass and stiffness."""
        return self.mass_coefficient * mass + self.stiffness_coefficient * stiffness


@dataclass(frozen=True, slots=True)
class ModalRatio:
    """One damping ratio for every elastic mode of the free component."""

    loss_factor: ClassVar[float] = 0.0
    ratio: float  # 1

    def viscous(self, mass: FloatArray, stiffness: FloatArray) -> FloatArray:
        """Return C = sum over r of 2 zeta w_r M phi_r phi_r^T M, which damps no rigid motion."""
        values, shapes = scipy.linalg.eigh(stiffness, mass)
        momenta = mass @ shapes
        floor = values.max(initial=0.0) * 1e-13  # rigid motions, apart from rounding
        omega = np.sqrt(np.where(values > floor, values, 0.0))
        return symmetric((momenta * (2.0 * self.ratio * omega)) @ momenta.T)


@dataclass(frozen=True, slots=True)
class LossFactor:
    """Structural damping: the stiffness is K (1 + i eta)."""

    factor: float  # eta, 1

    @property
    def loss_factor(self) -> float:
        """The eta of the stiffness, 1."""
        return self.factor

    def viscous(self, mass: FloatArray, stiffness: FloatArray) -> FloatArray:
        """Return zeros, (n, n), as there is no viscous damping."""
        return np.zeros_like(mass)


Damping = Rayleigh | ModalRatio | LossFactor


class Body(Protocol):
    """What an elastic link is made of; each kind of body is one file in ``bodies/``."""

    @property
    def elements(self) -> int | None:
        """How many elements its mesh has; None if it has no mesh that could be changed."""
        return None

    def with_elements(self, elements: int) -> "Body":
        """Return the body with another number of elements; itself if it has no mesh."""
        return self

    def sections(self, link: "Link", component: Component) -> Mapping[str, FloatArray]:
        """Return tension, shear (N) and moment (N m) before the points of a link, (3, n) each.

        They are those of one of its equal bodies per coordinate of its component, after the first
        point instead; there are none if it has no elements.
        """
        return {}

    def component(
        self, link: "Link", mechanism: "Mechanism", *, reduced: bool
    ) -> Component | FrfComponent:
        """Put the body on its interface DoFs; if not `reduced`, with every other DoF."""


@dataclass(frozen=True, slots=True)
class Link:
    """An elastic body; its local x axis runs along it from its first point."""

    name: str
    points: tuple[tuple[str, Point], ...]  # name and local x, z in m
    body: Body
    count: int  # equal links side by side, which move as one
    modes: int  # fixed-interface modes kept
    clamped: str | None  # a ground point at which the ground holds the link's rotation too
    masses: tuple[tuple[str, float], ...]  # point masses: name of the point and kg
    damping: Damping | None  # its own rule, or None for the mechanism's
    # m away from the middle of the linkage for each m along the link, seen from the side
    slope: float = field(default=0.0, metadata=_LATER)

    @property
    def stretch(self) -> float:
        """The true length over that seen from the side, 1."""
        return math.hypot(1.0, self.slope)

    def meshed(self, elements: int, modes: int) -> "Link":
        """Return the link with other numbers of elements and of fixed-interface modes."""
        return dataclasses.replace(self, modes=modes, body=self.body.with_elements(elements))

    def positions(self, wanted: Sequence[InterfaceDof], have: Sequence[InterfaceDof]) -> list[int]:
        """Return where the DoFs that the linkage needs are among those that the link's body has."""
        for dof in wanted:
            if dof not in have:
                problem = f"its body lacks the DoF {dof}; it has {', '.join(map(str, have))}."
                raise MechanismError(f"links.{self.name}", problem)
        return [have.index(dof) for dof in wanted]


@dataclass(frozen=True, slots=True)
class RigidBody:
    """A rigid body with points in its own axes."""

    name: str
    points: tuple[tuple[str, Point], ...]  # name and local x, z in m
    centre_of_gravity: Point  # m, in the body's own axes
    mass: float  # kg
    inertia: float  # kg m2, about the centre of gravity

    def component(self, rule: Damping) -> Component:
        """Put the body on the three DoFs of its centre of gravity, along the global axes."""
        return self.on({"x": self.mass, "z": self.mass, "theta": self.inertia}, rule)

    def on(self, inertias: Mapping[str, float], rule: Damping) -> Component:
        """Put the body on DoFs of its centre of gravity, with the mass or inertia of each, SI."""
        dofs = tuple(InterfaceDof(CENTRE_OF_GRAVITY, axis) for axis in inertias)
        mass, stiffness = np.diag([*inertias.values()]), np.zeros((len(dofs), len(dofs)))
        return Component(self.name, dofs, mass, stiffness, rule.viscous(mass, stiffness), 0.0, None)


@dataclass(frozen=True, slots=True)
class Mount:
    """Springs and dampers along x and z between a point of the base and the soil."""

    name: str
    at: Point  # m, global
    stiffness: tuple[float, float]  # along x and z, N/m
    damping: tuple[float, float]  # along x and z, N s/m
    # m, between both wheels of an axle; 0 is one wheel. No table depends on it, so no hash does.
    track: float = field(default=0.0, compare=False)


@dataclass(frozen=True, slots=True)
class Base:
    """A rigid body that carries the points of the ground, and the mounts on which it rests."""

    body: RigidBody  # its name is that of the ground, its points are the ground's and the mounts'
    mounts: tuple[Mount, ...]

    def component(self) -> Component:
        """Put the base on the three DoFs of its centre of gravity."""
        # A rule's term in the mass would damp it against a frame that does not exist.
        return self.body.component(LossFactor(0.0))


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A hydraulic cylinder whose locked oil is a spring, as its data sheet describes it."""

    # On a joint: the ends, m, in the axes of its first and second body; None between two points.
    ends: tuple[Point, Point] | None
    count: int  # equal cylinders side by side
    bore: float  # m
    rod: float | None  # m; None if the oil on the rod's side is not locked
    stroke: float  # m
    closed_length: float  # m, between the ends where the piston is at the bottom
    hose_volume: float  # m3 of oil on each side beside that in the cylinder
    bulk_modulus: float  # Pa, of the oil with its hoses
    # m: how far the ends may be beyond the stroke; above 0 in models whose numbers are drawn
    margin: float = field(default=0.0, metadata=_LATER)


@dataclass(frozen=True, slots=True)
class Spring:
    """A massless spring, damper or both between two bodies.

    ``points`` names its two ends, and it acts along the line between them; or one point that the
    two bodies share, and it acts on the rotation of the one against the other.
    """

    name: str
    bodies: tuple[str, str]
    points: tuple[str, ...]
    # N/m, or N m/rad on a joint; 0 for a damper without a spring
    stiffness: float | Cylinder
    damping: float  # N s/m, or N m s/rad
    # s: damping per stiffness, which a loss factor at one frequency gives: eta / w
    retardation: float = field(default=0.0, metadata=_LATER)


@dataclass(frozen=True, slots=True)
class Response:
    """The response that the model predicts at every angle."""

    point: str
    direction: Literal["x", "y", "z"]  # y in the lateral half alone
    band: tuple[float, float]  # Hz
    modes: int
    # Names that replace those of the first modes; an empty name replaces nothing.
    mode_names: tuple[str, ...] = field(default=(), metadata=_LATER)
    # N: what dynamic forces are compared with; otherwise it is the static force under the weight
    reference_force: ReferenceForce | None = field(default=None, metadata=_LATER)
    # The part of the band in which the FRF peak is sought, Hz; None if it is the whole band.
    peak_part: tuple[float, float] | None = field(default=None, metadata=_LATER)

    @property
    def peak_band(self) -> tuple[float, float]:
        """The band in which the FRF peak is sought, Hz."""
        return self.band if self.peak_part is None else self.peak_part

    def with_band(self, band: tuple[float, float]) -> "Response":
        """Return the response in another band (Hz), the peak sought in the common part or all."""
        low, high = max(band[0], self.peak_band[0]), min(band[1], self.peak_band[1])
        whole = self.peak_part is None or low >= high or (low, high) == band
        return dataclasses.replace(self, band=band, peak_part=None if whole else (low, high))


@dataclass(frozen=True, slots=True)
class Chain:
    """A check chain or stabiliser, one on each side, between a link and the ground."""

    name: str
    link: str
    at: float  # m along the link, seen from the side
    end: tuple[float, float, float]  # m, of the left one: global x, y to the left, and z
    stiffness: float  # N/m, of one, which is tight
    damping: float  # N s/m, of one
    pretension: float | None  # N, of one; None if it is not known


@dataclass(frozen=True, slots=True)
class Axle:
    """What a mount of the base does across the plane of motion."""

    track: float  # m, between its wheels; 0 if the axle pivots
    stiffness: float  # N/m, along y, of both wheels
    damping: float  # N s/m, of both wheels
    contact: float  # m, the height z at which the soil holds the wheels


@dataclass(frozen=True, slots=True)
class Lateral:
    """What the lateral half of a linkage needs in addition: motions odd about the middle plane."""

    y: tuple[tuple[str, float], ...]  # m left of the middle, of each point that is not in it
    # kg m2, about the principal axes of roll and yaw through the centre of gravity
    inertia: tuple[tuple[str, tuple[float, float]], ...]
    # rad, from the x axis of a body to its axis of roll, which by default points forward in the
    # middle of the stroke
    roll_axes: tuple[tuple[str, float], ...]
    chains: tuple[Chain, ...]
    axles: tuple[Axle, ...]  # of each mount
    rockshaft: float  # N m/rad, between both cranks; infinite if it is rigid
    held: tuple[str, ...]  # rigid bodies that do not move out of the plane
    # second moment of area, m4, and shear coefficient across the plane, of links with `general`
    sections: tuple[tuple[str | float, ...], ...]
    response: Response
    weight: bool  # whether forces at rest under the weight stiffen it


@dataclass(frozen=True, slots=True)
class UncertainNumber:
    """A number of the description with its standard deviation."""

    path: str  # its paths, as `paths.split_paths` takes them
    value: float  # as in the description
    deviation: float  # its standard deviation, in the same unit
    step: float  # by which the number may differ to both sides, at least
    relative: bool  # whether its logarithm is normal, rather than the number itself

    def moved(self, steps: float) -> float:
        """Return the number after a change by so many of its standard deviations."""
        change = self.deviation * steps
        return self.value * math.exp(change / self.value) if self.relative else self.value + change


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """What is known about the errors of numbers of the description."""

    numbers: tuple[UncertainNumber, ...]
    correlation: tuple[tuple[float, ...], ...]  # (n, n), 1
    # The mechanism with other values of the numbers; it refuses those that are not possible.
    described: "Callable[[Sequence[float]], Mechanism]" = field(compare=False, repr=False)

    def draw(self, normal: FloatArray) -> FloatArray:
        """Return values of the numbers, (n_draws, n), from independent standard normal ones."""
        n = len(self.numbers)
        root = np.linalg.cholesky(np.array(self.correlation).reshape(n, n))
        values, deviations, logarithmic = (
            np.array([getattr(number, name) for number in self.numbers])
            for name in ("value", "deviation", "relative")
        )
        shift = (normal @ root.T) * deviations
        share = np.divide(shift, values, out=np.zeros_like(shift), where=logarithmic)
        return np.asarray(np.where(logarithmic, values * np.exp(share), values + shift))


@dataclass(frozen=True)
class Mechanism:
    """A linkage that moves in a plane, with one input angle, alpha3.

    Attributes
    ----------
    name : str
        What tables and logs call it.
    ground : tuple of (name, (x, z))
        Points of the ground, global, m.
    links, rigid_bodies, springs : tuple
        Elastic bodies, rigid ones, and springs, dampers and cylinders between them, with their
        names as `name`.
    input_body : str
        The body whose angle is alpha3.
    stroke : (float, float)
        The range of alpha3 that is used, rad.
    assembly_alpha3 : float
        rad, where the angles below select the branch.
    assembly_angles : tuple of (name, angle)
        Rough direction of each other body there, rad.
    damping
        The damping rule of links that have none of their own.
    response
        The drive point and its direction, the band and the number of modes of a prediction.
    base : optional
        What carries the ground, with its mounts; None if the ground does not move.
    uncertainty : optional
        The standard deviations of its numbers, and their correlations.
    lateral : optional
        What its lateral half needs; None if only motions in the plane are modelled.
    """

    name: str
    ground: tuple[tuple[str, Point], ...]
    links: tuple[Link, ...]
    rigid_bodies: tuple[RigidBody, ...]
    springs: tuple[Spring, ...]
    input_body: str
    stroke: tuple[float, float]
    assembly_alpha3: float
    assembly_angles: tuple[tuple[str, float], ...]
    damping: Damping
    response: Response
    base: Base | None = field(default=None, metadata=_LATER)
    uncertainty: Uncertainty | None = field(default=None, metadata=_LATER)
    lateral: Lateral | None = field(default=None, metadata=_LATER)
    # The mechanism with other numbers at paths; None if it was not read from data.
    described: "Callable[[Mapping[str, float]], Mechanism] | None" = field(
        default=None, compare=False, repr=False
    )

    def __repr__(self) -> str:
        """Return its name and its bodies, in a line."""
        return f"Mechanism({self.name}: {', '.join(body.name for body in self.bodies)})"

    def with_values(self, values: Mapping[str, float]) -> "Mechanism":
        """Return the mechanism with other numbers, by their paths in its file.

        Parameters
        ----------
        values : mapping of str to float
            Paths are keys joined by dots, as in ``rigid_bodies.implement.mass``. Positions in lists
            are counted from 0, and paths joined by commas share one number. Others stay, such as
            inertias if a mass changes.

        Raises
        ------
        MechanismError
            If a path does not exist, or the mechanism is not possible with these numbers.
        """
        check_type(values, "give numbers by their paths", Mapping)
        if self.described is None:
            raise MechanismError(self.name, "was not read from data; use `read_mechanism`.")
        return self.described(values)

    @cached_property
    def bodies(self) -> tuple[Link | RigidBody, ...]:
        """Links, then rigid bodies, each in the order of the description."""
        return self.links + self.rigid_bodies

    @property
    def rigid(self) -> tuple[RigidBody, ...]:
        """Every rigid body that can vibrate: the rigid bodies, and the base."""
        return self.rigid_bodies + (() if self.base is None else (self.base.body,))

    @cached_property
    def mount_springs(self) -> tuple[tuple[Mount, int], ...]:
        """Each mount of the base with 0 for its spring along x or 1 for that along z, if any."""
        return tuple(
            (mount, axis)
            for mount in (self.base.mounts if self.base else ())
            for axis in (0, 1)
            if mount.stiffness[axis] or mount.damping[axis]
        )

    @cached_property
    def model_hash(self) -> str:
        """Hash of every number that a prediction depends on, 64 hexadecimal digits.

        Comments, spelling and the order of keys in a file do not matter. Numbers enter with 12
        digits, so that the last bit of another machine's square root does not change the hash.
        """
        content = ["formulation", FORMULATION, _hashable(self)]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def local_points(self, body: str) -> Mapping[str, Point]:
        """Return the points of a body in its own axes, or of the ground in the global axes, m."""
        return self._points[body]

    @property
    def moving_points(self) -> tuple[str, ...]:
        """Names of the points that can vibrate: of the bodies, and of the base if there is one."""
        held = () if self.base else self.local_points(GROUND)
        names = [body.name for body in self.bodies] + ([GROUND] if self.base else [])
        points = dict.fromkeys(point for name in names for point in self.local_points(name))
        return tuple(point for point in points if point not in held)

    def owners(self, point: str) -> tuple[str, ...]:
        """Return the bodies that have a point, the ground first."""
        return tuple(name for name, points in self._points.items() if point in points)

    @cached_property
    def _points(self) -> dict[str, dict[str, Point]]:
        """Points of the ground and of every body."""
        ground = self.ground if self.base is None else self.base.body.points
        return {GROUND: dict(ground), **{body.name: dict(body.points) for body in self.bodies}}

    @cached_property
    def joints(self) -> tuple[tuple[str, str, str], ...]:
        """Every pin as (point, one body, other body); k bodies at a point make k - 1 pins."""
        owners = {point: self.owners(point) for places in self._points.values() for point in places}
        return tuple((point, a, b) for point, (a, *others) in owners.items() for b in others)

    def interface_dofs(self, link: Link) -> Dofs:
        """Return the DoFs at which one of the links is joined, point by point."""
        rotations = self.rotations(link.name)
        return tuple(
            InterfaceDof(point, direction)
            for point, _ in link.points
            for direction in ("x", "z", "theta")
            if direction != "theta" or point in rotations
        )

    def rotations(self, link: str) -> frozenset[str]:
        """Return the points at which a link's rotation is held or sprung, and must be kept."""
        turned = [each for each in self.springs if len(each.points) == 1 and link in each.bodies]
        points = {spring.points[0] for spring in turned}
        points.update(other.clamped for other in self.links if other.name == link and other.clamped)
        return frozenset(points)

    def components(self, *, reduced: bool = True) -> tuple[Component | FrfComponent, ...]:
        """Return the component of every body, in the order of `bodies`, and of the base.

        `reduced` is as `Body.component` takes it.
        """
        links = [link.body.component(link, self, reduced=reduced) for link in self.links]
        rigid = [body.component(self.damping) for body in self.rigid_bodies]
        return (*links, *rigid, *([] if self.base is None else [self.base.component()]))


def coarser(mechanism: Mechanism, elements: int, modes: int) -> Mechanism:
    """Return a mechanism with at most so many elements and modes in each link."""
    links = tuple(
        link.meshed(min(elements, link.body.elements or elements), min(modes, link.modes))
        for link in mechanism.links
    )
    return dataclasses.replace(mechanism, links=links)


def rayleigh_damping(ratio: float, low: float, high: float) -> Rayleigh:
    """Rayleigh coefficients that give one damping ratio (1) at two frequencies (Hz).

    They solve zeta = a / (2 w) + b w / 2 at both; between them the ratio is lower, outside higher.

    >>> damping, omega = rayleigh_damping(0.02, 4.0, 180.0), 2.0 * np.pi * 180.0
    >>> round(damping.mass_coefficient / omega / 2 + damping.stiffness_coefficient * omega / 2, 12)
    0.02
    """
    w1, w2 = 2.0 * np.pi * low, 2.0 * np.pi * high
    return Rayleigh(float(2.0 * ratio * w1 * w2 / (w1 + w2)), float(2.0 * ratio / (w1 + w2)))


def _hashable(value: Any) -> Any:
    """Turn data into values for JSON: floats to 12 digits, and digests of arrays."""
    if dataclasses.is_dataclass(value):
        given = {f.name: getattr(value, f.name) for f in dataclasses.fields(value) if f.compare}
        for f in dataclasses.fields(value):
            if f.metadata == _LATER and given[f.name] == f.default:
                del given[f.name]
        return {"type": type(value).__name__, **{k: _hashable(v) for k, v in given.items()}}
    if isinstance(value, list | tuple):
        return [_hashable(item) for item in value]
    if isinstance(value, np.ndarray):
        return [value.shape, hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    return f"{value:.12g}" if isinstance(value, float) else value
