# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a mechanism is made of, as frozen data.

Points that carry the same name on two bodies are joined by a pin there; a name that stands on the
ground as well is pinned to the ground. Nothing else has to be said about the topology.
"""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.dofs import InterfaceDof

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

GROUND = "ground"

FORMULATION = 2
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
    """The cross-section of a beam.

    The last three are NaN where only the plane of motion was described; a spatial model then
    refuses the section.
    """

    area: float  # m2
    second_moment: float  # m4, for bending in the plane of motion
    shear_coefficient: float  # 1, effective shear area over area, in the plane of motion
    second_moment_out: float  # m4, for bending out of the plane
    shear_coefficient_out: float  # 1
    torsion_constant: float  # m4


@dataclass(frozen=True, slots=True)
class Segment:
    """A stretch of a beam with one section."""

    end: float  # m along the axis; it begins where the one before it ends, the first at the start
    section: Section


@dataclass(frozen=True, slots=True)
class Beam:
    """An elastic body made of beam elements along a straight axis."""

    material: Material
    segments: tuple[Segment, ...]
    elements: int


@dataclass(frozen=True, slots=True, eq=False)
class Matrices:
    """An elastic body known by its matrices.

    Attributes
    ----------
    dofs : tuple of InterfaceDof, (n_dofs,)
        The first rows and columns; all others are inner coordinates of any kind.
    mass, stiffness : ndarray, (n, n)
        SI.
    damping : ndarray, (n, n), or None
        Viscous; None leaves it to the damping rule.
    digest : str
        Names what the matrices were computed from, where they were: their last bits may differ
        from machine to machine, and with them the model's hash. Empty: their bytes name them.
    """

    dofs: tuple[InterfaceDof, ...]
    mass: FloatArray
    stiffness: FloatArray
    damping: FloatArray | None = None
    digest: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Frfs:
    """An elastic body known by its frequency response functions alone, measured or computed.

    Attributes
    ----------
    dofs : tuple of InterfaceDof, (n_dofs,)
        Rows (responses) and columns (forces).
    frequencies : ndarray, (n_freq,)
        Hz, ascending.
    frf : ndarray, (n_freq, n_dofs, n_dofs)
        Receptances of the free body in its own axes; m/N between displacements.
    """

    dofs: tuple[InterfaceDof, ...]
    frequencies: FloatArray
    frf: ComplexArray


@dataclass(frozen=True, slots=True)
class Rayleigh:
    """C = a M + b K; the same a and b for all components leaves the modes real."""

    mass_coefficient: float  # a, 1/s
    stiffness_coefficient: float  # b, s


@dataclass(frozen=True, slots=True)
class ModalRatio:
    """One damping ratio for every elastic mode of the free component."""

    ratio: float  # 1


@dataclass(frozen=True, slots=True)
class LossFactor:
    """Structural damping: the stiffness is K (1 + i eta)."""

    factor: float  # eta, 1


Damping = Rayleigh | ModalRatio | LossFactor


@dataclass(frozen=True, slots=True)
class Link:
    """An elastic body; its local x axis runs along it from its first point."""

    name: str
    points: tuple[tuple[str, Point], ...]  # name and local x, z in m
    body: Beam | Matrices | Frfs
    count: int  # equal links side by side, which move as one
    modes: int  # fixed-interface modes kept
    clamped: str | None  # a ground point at which the ground holds the link's rotation too
    masses: tuple[tuple[str, float], ...]  # point masses: name of the point and kg
    damping: Damping | None  # its own rule, or None for the mechanism's


@dataclass(frozen=True, slots=True)
class RigidBody:
    """A rigid body with points in its own axes."""

    name: str
    points: tuple[tuple[str, Point], ...]  # name and local x, z in m
    centre_of_gravity: Point  # m, in the body's own axes
    mass: float  # kg
    inertia: float  # kg m2, about the centre of gravity


@dataclass(frozen=True, slots=True)
class Spring:
    """A massless spring between two bodies.

    ``points`` names its two ends, and it acts along the line between them; or one point that the
    two bodies share, and it acts on the rotation of the one against the other.
    """

    name: str
    bodies: tuple[str, str]
    points: tuple[str, ...]
    stiffness: float  # N/m, or N m/rad on a joint
    damping: float  # N s/m, or N m s/rad


@dataclass(frozen=True, slots=True)
class Response:
    """What is asked of the model at every angle."""

    point: str
    direction: Literal["x", "z"]
    band: tuple[float, float]  # Hz
    modes: int


@dataclass(frozen=True)
class Mechanism:
    """A planar linkage with one input angle, alpha3."""

    name: str
    ground: tuple[tuple[str, Point], ...]  # name and global x, z in m
    links: tuple[Link, ...]
    rigid_bodies: tuple[RigidBody, ...]
    springs: tuple[Spring, ...]
    input_body: str
    stroke: tuple[float, float]  # rad, the range of alpha3 that is used
    assembly_alpha3: float  # rad, where the branch is told
    assembly_angles: tuple[tuple[str, float], ...]  # rad, about where each other body points there
    damping: Damping
    response: Response

    @cached_property
    def bodies(self) -> tuple[Link | RigidBody, ...]:
        """Links, then rigid bodies, each in the order of the description."""
        return self.links + self.rigid_bodies

    @cached_property
    def model_hash(self) -> str:
        """Hash of every number that a prediction depends on, 64 hexadecimal digits.

        Comments, spelling and the order of keys in a file do not enter it; numbers do with 12
        digits, so that the last bit of another machine's square root makes no other model.
        """
        content = ["formulation", FORMULATION, _hashable(self)]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def local_points(self, body: str) -> Mapping[str, Point]:
        """Return a body's points in its own axes, in m; the ground's in the global axes."""
        return self._points[body]

    def owners(self, point: str) -> tuple[str, ...]:
        """Return the bodies that carry a point, the ground first."""
        return tuple(name for name, points in self._points.items() if point in points)

    @cached_property
    def _points(self) -> dict[str, dict[str, Point]]:
        """Points of the ground and of every body."""
        return {GROUND: dict(self.ground), **{body.name: dict(body.points) for body in self.bodies}}

    @cached_property
    def joints(self) -> tuple[tuple[str, str, str], ...]:
        """Every pin as (point, one body, other body); k bodies at a point make k - 1 pins."""
        found: dict[str, None] = {}
        for name in (GROUND, *(body.name for body in self.bodies)):
            found.update(dict.fromkeys(self.local_points(name)))
        pins = []
        for point in found:
            first, *others = self.owners(point)
            pins += [(point, first, other) for other in others]
        return tuple(pins)

    def rotations(self, link: str) -> frozenset[str]:
        """Return the points at which a link's rotation is held or sprung, and so has to be kept."""
        found = {
            spring.points[0]
            for spring in self.springs
            if len(spring.points) == 1 and link in spring.bodies
        }
        found.update(other.clamped for other in self.links if other.name == link and other.clamped)
        return frozenset(found)


def rayleigh_damping(ratio: float, low: float, high: float) -> Rayleigh:
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
    >>> omega = 2 * np.pi * 180.0
    >>> ratio = damping.mass_coefficient / (2 * omega) + damping.stiffness_coefficient * omega / 2
    >>> round(ratio, 12)
    0.02
    """
    w1, w2 = 2.0 * np.pi * low, 2.0 * np.pi * high
    return Rayleigh(float(2.0 * ratio * w1 * w2 / (w1 + w2)), float(2.0 * ratio / (w1 + w2)))


def _hashable(value: Any) -> Any:
    """Turn data into what JSON can write, floats to 12 digits and arrays by their digest."""
    if isinstance(value, Matrices) and value.digest:
        return ["matrices", [str(dof) for dof in value.dofs], value.digest]
    if dataclasses.is_dataclass(value):
        fields = {f.name: _hashable(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"type": type(value).__name__, **fields}
    if isinstance(value, list | tuple):
        return [_hashable(item) for item in value]
    if isinstance(value, np.ndarray):
        return [value.shape, hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    return f"{value:.12g}" if isinstance(value, float) else value
