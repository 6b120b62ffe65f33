# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Straight links as chains of Timoshenko beam elements.

The bending element is the two-node one whose cubic field solves the static equations (Przemieniecki
1968), with the consistent mass of that field, rotary inertia included (Friedman and Kosmatka 1993).
Statics are exact for loads at nodes, whatever the mesh. Natural frequencies are approached from
above, as h^4 in the length h of the elements while these are slender, and as h^2 when they get as
short as they are deep.

A node moves by u and w along the local x and z axes and turns by theta from x towards z.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray, symmetric
from linkage_vibration.mechanics.bodies.matrices import Matrices, component_of
from linkage_vibration.mechanics.components import Component, Drawing
from linkage_vibration.mechanics.description import (
    Link,
    Material,
    Mechanism,
    MechanismError,
    Point,
    Section,
)
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.keys import CheckedMapping
from linkage_vibration.mechanics.sections import SHAPES

U, W, THETA = range(3)
"""Order of the coordinates of a node."""

_POWERS = 1.0 / np.add.outer(range(4), range(1, 5))  # integrals of s^i s^j from 0 to 1
_ALONG, _BENDING = (np.ix_(each, each) for each in ([U, 3 + U], [W, THETA, 3 + W, 3 + THETA]))
_COORDINATE = {"x": U, "z": W, "theta": THETA}
_ACROSS = {"y": W, "chi": THETA}
_SAME_PLACE = 1e-9  # Places that are nearer, as a share of the beam's length, are one place.
_REMEMBERED = 64  # Elements of one kind occur often in a link, and again in its forces.
_HEAVIEST = 1e6  # kg; no link is heavier, but numbers in millimetres or tonnes give more
_SOFTEST = 1e6  # Pa, of rubber; the moduli of metals in N/mm2 are lower
_STIFFEST = 1e18  # Pa; beside a stiffer link, rounding moves the first mode by more than 1e-5
_LIGHTEST = 1e-9  # kg/m3; below, products of masses become zero
_STIFF, _FLIMSY = 1e9, (0.5, 25.0)  # Pa, and kg/m3 that no solid so stiff has; in g/cm3 all have


@dataclass(frozen=True, slots=True)
class Segment:
    """A stretch of a beam with one section."""

    end: float  # m along the axis; it begins at the end of the one before, the first at the start
    section: Section


@dataclass(frozen=True, slots=True)
class Beam:
    """An elastic body made of beam elements along a straight axis."""

    material: Material
    segments: tuple[Segment, ...]
    elements: int

    def with_elements(self, elements: int) -> "Beam":
        """Return the beam with another number of elements."""
        return replace(self, elements=elements)

    def component(self, link: Link, mechanism: Mechanism, *, reduced: bool) -> Component:
        """Return the component of the beam in true length; its DoFs are as seen from the side."""
        try:
            beam, points = self.in_space(link.points, link.stretch)
            rotations = mechanism.rotations(link.name)
            matrices = beam_matrices(beam, points, rotations=rotations, masses=link.masses)
        except MechanismError as error:
            raise MechanismError(f"links.{link.name}.{error.path}", error.problem) from None
        projected = _projected(matrices, link.stretch)
        return component_of(link, mechanism, projected, projected.dofs, reduced=reduced)

    def in_space(
        self, points: Sequence[tuple[str, Point]], stretch: float
    ) -> tuple["Beam", tuple[tuple[str, Point], ...]]:
        """Return the beam and its points in true length, which is longer by `stretch`."""
        segments = tuple(replace(each, end=stretch * each.end) for each in self.segments)
        moved = tuple((name, (stretch * x, z)) for name, (x, z) in points)
        return replace(self, segments=segments), moved

    def sections(self, link: Link, component: Component) -> Mapping[str, FloatArray]:
        """Return the forces of the element beside each point, as `description.Body` says."""
        assert component.drawing is not None
        scale = np.array([link.stretch, 1.0, 1.0])  # of what is seen from the side
        motion = component.drawing.displacement / scale[:, np.newaxis]
        beam, points = self.in_space(link.points, link.stretch)
        nodes, sections = _mesh(beam, [x for _, (x, _) in points])
        forces = {}
        along = sorted(_nodes_of(points, nodes).items(), key=lambda pair: pair[1])
        for i, (point, node) in enumerate(along):
            at = node - 1 if i else node
            length = float(nodes[at + 1] - nodes[at])
            stiffness = element_matrices(length, sections[at], self.material)[1]
            stiffness = stiffness[3:] if i else -stiffness[:3]
            forces[point] = stiffness @ motion[at : at + 2].reshape(6, -1)
        return forces


def read(keys: CheckedMapping, places: dict[str, Point]) -> Beam:
    """Read a beam from the keys of a link and the places of its points, x and z, m."""
    material = _material(keys["material"])
    poisson = material.poisson_ratio
    end = max(x for x, _ in places.values())
    if "sections" not in keys:
        segments: tuple[Segment, ...] = (Segment(end, _section(keys["section"], poisson)),)
    else:
        steps = keys.items("sections")
        segments = tuple(
            Segment(step.number("until", default=end), _section(step, poisson)) for step in steps
        )
    beam = Beam(material, segments, keys.integer("elements", default=24))
    try:
        nodes, _ = _mesh(beam, [x for x, _ in places.values()])
        _nodes_of(list(places.items()), nodes)
    except MechanismError as error:
        raise MechanismError(f"{keys.path}.{error.path}", error.problem) from None
    _check_proportions(keys, segments, float(nodes[0]), material.density)
    return beam


def _material(keys: CheckedMapping) -> Material:
    """Read an isotropic material, and refuse numbers that suggest another unit."""
    poisson = keys.number("poisson_ratio")
    if not -1.0 < poisson < 0.5:
        raise keys.error("poisson_ratio", f"{poisson:g} is not between -1 and 0.5; steel has 0.3.")
    hint = "write it in Pa (steel: 210.0e+9), and describe what is rigid under rigid_bodies"
    modulus = keys.number("youngs_modulus", least=_SOFTEST, most=_STIFFEST, hint=hint)
    hint = "write it in kg/m3 (steel: 7800.0; 0.001 for a link without mass)"
    density = keys.number("density", positive=True, least=_LIGHTEST, hint=hint)
    if modulus > _STIFF and _FLIMSY[0] < density < _FLIMSY[1]:
        raise keys.error("density", f"no such solid weighs {density:g} kg/m3; {hint}.")
    return Material(modulus, density, poisson)


def _check_proportions(
    keys: CheckedMapping, segments: tuple[Segment, ...], begin: float, density: float
) -> None:
    """Refuse a link too deep for a beam, or with its section and length in different units."""
    length = segments[-1].end - begin
    depth = min(math.sqrt(12.0 * s.section.second_moment / s.section.area) for s in segments)
    if depth > length:
        hint = "if both are in m, describe it under rigid_bodies, or by matrices"
        problem = f"a bar {depth:g} m deep and {length:g} m long is not a beam; {hint}."
        raise keys.error("sections" if "sections" in keys else "section", problem)
    starts = (begin, *(segment.end for segment in segments))
    volume = sum(s.section.area * (s.end - a) for a, s in zip(starts, segments, strict=False))
    if volume * density > _HEAVIEST:
        problem = f"it is {length:g} m long and weighs {volume * density:.3g} kg, as no link does"
        hint = "write m (millimetres divided by 1000), m2 and kg/m3"
        raise MechanismError(keys.path, f"{problem}; {hint}.")


def _section(keys: CheckedMapping, poisson_ratio: float) -> Section:
    return SHAPES[keys.choice("shape", SHAPES)](keys, poisson_ratio)


def beam_matrices(
    beam: Beam,
    points: Sequence[tuple[str, Point]],
    *,
    rotations: Collection[str] = (),
    masses: Sequence[tuple[str, float]] = (),
    across: bool = False,
    clamped: Collection[str] = (),
) -> Matrices:
    """Put a beam on its points, of which no two have the same x, and draw it by its nodes.

    Points, beside the axis on massless arms, and ends of segments are nodes of the axis; masses in
    kg. Bending `across` the plane is on y and chi; points that are `clamped` do not turn.

    >>> from linkage_vibration.mechanics.sections.rectangle import rectangle
    >>> steel = Material(210e9, 7800.0, 0.3)
    >>> beam = Beam(steel, (Segment(0.5, rectangle(0.02, 0.04, 0.3)),), elements=4)
    >>> matrices = beam_matrices(beam, [("A", (0.0, 0.0)), ("B", (0.5, 0.03))], rotations={"A"})
    >>> [str(dof) for dof in matrices.dofs]
    ['A x', 'A z', 'A theta', 'B x', 'B z']
    """
    nodes, sections = _mesh(beam, [x for _, (x, _) in points])
    sections = [section.turned for section in sections] if across else sections
    start = {name: 3 * node for name, node in _nodes_of(points, nodes).items()}
    mass, stiffness = _chain(nodes, sections, beam.material)
    displacement = np.eye(len(mass)).reshape(len(nodes), 3, -1)
    for name, (_, z) in points:
        u, theta = start[name] + U, start[name] + THETA
        for matrix in (mass, stiffness):
            matrix[:, theta] += z * matrix[:, u]
            matrix[theta] += z * matrix[u]
        displacement[:, :, theta] += z * displacement[:, :, u]
    for name, value in masses:
        at = [start[name] + U, start[name] + W]
        mass[at, at] += value

    rows = {
        InterfaceDof(name, direction): start[name] + coordinate
        for name, _ in points
        for direction, coordinate in (_ACROSS if across else _COORDINATE).items()
        if coordinate != THETA or name in rotations
    }
    interface = list(rows.values())
    held = {start[name] + THETA for name in clamped}.union(range(U, len(mass), 3) if across else ())
    order = interface + [i for i in range(len(mass)) if i not in interface and i not in held]
    block = np.ix_(order, order)
    places = np.column_stack([nodes, np.zeros(len(nodes))])
    drawing = Drawing(places, displacement[:, :, order])
    return Matrices(tuple(rows), mass[block], stiffness[block], drawing=drawing)


def _projected(matrices: Matrices, stretch: float) -> Matrices:
    """Return a beam in true length with DoFs along x, and a drawing, as seen from the side."""
    assert matrices.drawing is not None
    along = [i for i, dof in enumerate(matrices.dofs) if dof.direction == "x"]
    scale = np.ones(len(matrices.mass))
    scale[along] /= stretch
    displacement = matrices.drawing.displacement * scale
    displacement[:, 0] *= stretch
    drawing = Drawing(matrices.drawing.places / [stretch, 1.0], displacement)
    column = scale[:, np.newaxis]
    mass, stiffness = column * matrices.mass * scale, column * matrices.stiffness * scale
    return Matrices(matrices.dofs, mass, stiffness, drawing=drawing)


def _chain(
    nodes: FloatArray, sections: Sequence[Section], material: Material
) -> tuple[FloatArray, FloatArray]:
    """Assemble elements from node to node; coordinates node by node."""
    mass, stiffness = np.zeros((2, 3 * len(nodes), 3 * len(nodes)))
    elements: dict[tuple[str, Section], tuple[FloatArray, FloatArray]] = {}
    for i, (length, section) in enumerate(zip(np.diff(nodes), sections, strict=True)):
        key = f"{length:.12g}", section  # equal elements differ by rounding
        if key not in elements:
            elements[key] = element_matrices(float(length), section, material)
        at = slice(3 * i, 3 * i + 6)
        mass[at, at] += elements[key][0]
        stiffness[at, at] += elements[key][1]
    return mass, stiffness


def _mesh(beam: Beam, places: Sequence[float]) -> tuple[FloatArray, list[Section]]:
    """Return the nodes, (n_nodes,), and the section of each element between them."""
    ends = [segment.end for segment in beam.segments]
    begin = min(0.0, *places)
    same = _SAME_PLACE * (ends[-1] - begin)
    if max(places) > ends[-1] + same or any(b <= a for a, b in pairwise([begin, *ends])):
        problem = "they do not ascend along the link to its last point; reorder or extend them."
        raise MechanismError("sections", problem)
    cuts = [begin]
    for place in sorted([*places, *ends]):
        if place - cuts[-1] > same:
            cuts.append(place)
    spans = [
        np.linspace(a, b, 1 + max(1, round(beam.elements * (b - a) / (cuts[-1] - begin))))
        for a, b in pairwise(cuts)
    ]
    nodes = np.concatenate([cuts[:1], *(span[1:] for span in spans)])
    middles = (nodes[1:] + nodes[:-1]) / 2.0
    return nodes, [beam.segments[i].section for i in np.searchsorted(ends, middles)]


def _nodes_of(points: Sequence[tuple[str, Point]], nodes: FloatArray) -> dict[str, int]:
    """Return the index of each point's node."""
    owner: dict[int, str] = {}
    for name, (x, _) in points:
        node = int(np.abs(nodes - x).argmin())
        if node in owner:
            problem = f"it is at the same place along the link as {owner[node]} ({x:g} m)"
            hint = "sections are rigid, so move one of them along by about the link's depth"
            raise MechanismError(f"points.{name}", f"{problem}; {hint}.")
        owner[node] = name
    return {name: node for node, name in owner.items()}


@lru_cache(_REMEMBERED)
def element_matrices(
    length: float, section: Section, material: Material
) -> tuple[FloatArray, FloatArray]:
    """Return mass and stiffness of one element, (6, 6), SI: u, w, theta of both nodes."""
    youngs, density, area = material.youngs_modulus, material.density, section.area
    mass, stiffness = np.zeros((2, 6, 6))
    mass[_ALONG] = density * area * length / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    stiffness[_ALONG] = youngs * area / length * np.array([[1.0, -1.0], [-1.0, 1.0]])
    mass[_BENDING], stiffness[_BENDING] = _bending_element(
        length,
        youngs * section.second_moment,
        section.shear_coefficient * material.shear_modulus * area,
        density * area,
        density * section.second_moment,
    )
    return mass, stiffness


def _bending_element(
    length: float, rigidity: float, shear_rigidity: float, line_mass: float, rotary: float
) -> tuple[FloatArray, FloatArray]:
    """Bending by E I, kappa G A, rho A and rho I, on w and theta = dw/dx of both nodes.

    w = a0 + a1 s + a2 s^2 + a3 s^3 and theta L = a1 + phi a3 / 2 + 2 a2 s + 3 a3 s^2 with s = x / L
    and phi = 12 E I / (kappa G A L^2); integrals of s^i s^j are entries of a Hilbert matrix.
    """
    phi = 12.0 * rigidity / (shear_rigidity * length**2)
    # Bending by equal and opposite end moments, and by end forces.
    even, odd = np.array([0.0, -length, 0.0, length]), np.array([2.0, length, -2.0, length])
    a3 = odd / (1.0 + phi)
    a2 = (even - 3.0 * a3) / 2.0
    theta_start = np.array([0.0, length, 0.0, 0.0])
    w = np.array([[1.0, 0.0, 0.0, 0.0], theta_start - phi / 2.0 * a3, a2, a3])
    theta = np.array([theta_start, 2.0 * a2, 3.0 * a3]) / length
    mass = length * (line_mass * w.T @ _POWERS @ w + rotary * theta.T @ _POWERS[:3, :3] @ theta)
    pure, sheared = np.outer(even, even), 3.0 / (1.0 + phi) * np.outer(odd, odd)
    return symmetric(mass), rigidity / length**3 * (pure + sheared)
