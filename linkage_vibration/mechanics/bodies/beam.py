# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Straight links as chains of Timoshenko beam elements, in the plane of motion or in space."""

import math
from collections.abc import Collection, Sequence
from dataclasses import astuple, dataclass, replace
from itertools import pairwise

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray, IntArray, symmetric
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
from linkage_vibration.mechanics.keys import Keys
from linkage_vibration.mechanics.material import read_material
from linkage_vibration.mechanics.sections import SHAPES
from linkage_vibration.mechanics.timoshenko import (
    CHI,
    PSI,
    THETA,
    U,
    V,
    W,
    element_matrices,
    prestress_matrices,
)

_COORDINATE = {"x": U, "y": V, "z": W, "theta": THETA}
_SAME_PLACE = 1e-9  # Places that are nearer, as a share of the beam's length, are one place.
_HEAVIEST = 1e6  # kg; no link is heavier, but numbers in millimetres or tonnes give more


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

    def component(
        self, link: Link, mechanism: Mechanism, *, spatial: bool, reduced: bool
    ) -> Component:
        """Return the component of the beam, as `description.Body.component` says."""
        try:
            matrices = beam_matrices(
                self,
                link.points,
                rotations=mechanism.rotations(link.name),
                masses=link.masses,
                clamped=link.clamped,
                spatial=spatial,
            )
        except MechanismError as error:
            raise MechanismError(f"links.{link.name}.{error.path}", error.problem) from None
        body = Matrices(matrices.dofs, matrices.mass, matrices.stiffness)
        places = np.column_stack([matrices.nodes, np.zeros(len(matrices.nodes))])
        drawing = Drawing(places, matrices.displacement)
        component = component_of(link, mechanism, body, drawing, spatial=spatial, reduced=reduced)
        if spatial or not mechanism.gravity:
            return component
        return replace(component, prestress=_prestress(self, link, component))


@dataclass(frozen=True, slots=True, eq=False)
class BeamPrestress:
    """How the forces on a beam stiffen it: its tension and its shear force, and its arms."""

    motion: FloatArray  # (3 n_nodes, n): u, w and theta of the nodes per coordinate
    middles: FloatArray  # (n_elements,): places along the axis, m
    unit: FloatArray  # (2, n_elements, 6, 6): stiffness per newton of tension, and of shear
    carried: FloatArray  # (n_elements,): mass before the middle of each element, kg
    places: FloatArray  # (n_points, 2): x and z of the points, m
    masses: FloatArray  # (n_points,): point masses, kg
    turns: tuple[int, ...]  # (n_points,): rows of `motion` that are the points' rotations
    loaded: IntArray  # (n_points, 2): interface DoFs along x and z

    def stiffness(self, forces: FloatArray, gravity: FloatArray) -> FloatArray:
        """Return the stiffness that forces at rest add, (n, n), as `components.Prestress` says."""
        applied = forces[self.loaded] + self.masses[:, np.newaxis] * gravity
        before = self.places[:, 0] < self.middles[:, np.newaxis]
        cut = -(before @ applied + self.carried[:, np.newaxis] * gravity)  # tension and shear
        elements = np.einsum("ec,ceij->eij", cut, self.unit)
        nodal = np.zeros((len(self.motion),) * 2)
        for i, element in enumerate(elements):
            nodal[3 * i : 3 * i + 6, 3 * i : 3 * i + 6] += element
        nodal[self.turns, self.turns] += applied[:, 1] * self.places[:, 1]
        return symmetric(self.motion.T @ nodal @ self.motion)


@dataclass(frozen=True, slots=True, eq=False)
class BeamMatrices:
    """A free beam on its interface DoFs and inner coordinates."""

    mass: FloatArray  # (n, n), ``dofs`` first, SI; symmetric to the last bit
    stiffness: FloatArray  # (n, n)
    dofs: tuple[InterfaceDof, ...]  # point by point x, (y,) z and, where asked for, theta
    nodes: FloatArray  # (n_nodes,): places along the axis, ascending, m
    displacement: FloatArray  # (n_nodes, 4, n): local x, y, z and theta of nodes per coordinate


def read(keys: Keys, places: dict[str, Point]) -> Beam:
    """Read a beam from the keys of a link and the places of its points, x and z, m."""
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
                raise step.error(
                    "until",
                    f"{after.end:g} m is not beyond the end of the section before it, at "
                    f"{before.end:g} m; list the sections along the link.",
                )
        if segments[-1].end < end:
            raise MechanismError(
                steps[-1].path,
                f"the last section ends before the last point ({end:g} m); extend it.",
            )
    begin = min(0.0, *(x for x, _ in places.values()))
    _check_proportions(keys, segments, begin, material.density)
    beam = Beam(material, segments, keys.integer("elements", default=24))
    try:
        _first_coordinates(list(places.items()), _mesh(beam, [x for x, _ in places.values()])[0], 3)
    except MechanismError as error:
        raise MechanismError(f"{keys.path}.{error.path}", error.problem) from None
    return beam


def _check_proportions(
    keys: Keys, segments: tuple[Segment, ...], begin: float, density: float
) -> None:
    """Refuse a link too deep for a beam, or with its section and length in different units."""
    length = segments[-1].end - begin
    depth = min(math.sqrt(12.0 * s.section.second_moment / s.section.area) for s in segments)
    if depth > length:
        raise keys.error(
            "sections" if "sections" in keys else "section",
            f"a bar {depth:g} m deep and {length:g} m long is not a beam; if both are in m, "
            "describe it under rigid_bodies, or by matrices.",
        )
    starts = (begin, *(segment.end for segment in segments))
    volume = sum(s.section.area * (s.end - a) for a, s in zip(starts, segments, strict=False))
    if volume * density > _HEAVIEST:
        raise MechanismError(
            keys.path,
            f"it is {length:g} m long and weighs {volume * density:.3g} kg, as no link does; write "
            "lengths in m (millimetres divided by 1000), areas in m2 and densities in kg/m3.",
        )


def _section(keys: Keys, poisson_ratio: float) -> Section:
    return SHAPES[keys.choice("shape", SHAPES)](keys, poisson_ratio)


def beam_matrices(
    beam: Beam,
    points: Sequence[tuple[str, Point]],
    *,
    rotations: Collection[str] = (),
    masses: Sequence[tuple[str, float]] = (),
    clamped: str | None = None,
    spatial: bool = False,
) -> BeamMatrices:
    """Put a beam on its points, of which no two have the same x.

    The axis is z = 0. The beam begins at x = 0, or at a point before that, and ends where its last
    segment ends. Each point and each end of a segment is a node; `beam.elements` are distributed
    over the spans between them by length, rounded, at least one each. A point beside the axis is on
    a rigid, massless arm from its node, so that u = u_point + z theta and v = v_point + z psi.

    In space pins are ball joints, except for a clamped one, which turns neither by chi nor by psi.
    If all pins are on one line, none of them holds or excites a spin of the beam about it, so the
    first point is held against that rotation. If the line is the axis, no pin can twist the beam,
    and torsion is left out.

    `rotations` are points whose theta is an interface DoF; `masses` are point masses, kg.

    >>> from linkage_vibration.mechanics.sections.rectangle import rectangle
    >>> steel = Material(210e9, 7800.0, 0.3)
    >>> beam = Beam(steel, (Segment(0.5, rectangle(0.02, 0.04, 0.3)),), elements=4)
    >>> matrices = beam_matrices(beam, [("A", (0.0, 0.0)), ("B", (0.5, 0.03))], rotations={"A"})
    >>> [str(dof) for dof in matrices.dofs]
    ['A x', 'A z', 'A theta', 'B x', 'B z']
    >>> matrices.mass.shape, matrices.nodes
    ((15, 15), array([0.   , 0.125, 0.25 , 0.375, 0.5  ]))
    """
    size = 6 if spatial else 3
    nodes, sections = _mesh(beam, [x for _, (x, _) in points])
    if spatial and any(math.isnan(value) for section in sections for value in astuple(section)):
        raise MechanismError(
            "section",
            "a spatial model also needs second_moment_out and torsion_constant; add them.",
        )
    start = _first_coordinates(points, nodes, size)
    mass, stiffness = _chain(nodes, sections, beam.material, spatial)
    displacement = np.zeros((len(nodes), 4, len(mass)))
    for axis, coordinate in enumerate((U, V, W, THETA)):
        if coordinate < size:
            displacement[:, axis, coordinate::size] = np.eye(len(nodes))

    arms, held = _arms(points, start, len(mass), clamped, spatial)
    for old, other, factor in arms:  # old = its successor + factor * other
        for matrix in (mass, stiffness):
            matrix[:, other] += factor * matrix[:, old]
            matrix[other] += factor * matrix[old]
        displacement[:, :, other] += factor * displacement[:, :, old]
    for name, value in masses:
        at = [start[name] + coordinate for coordinate in (U, W, V) if coordinate < size]
        mass[at, at] += value

    rows = {
        InterfaceDof(name, direction): start[name] + coordinate
        for name, _ in points
        for direction, coordinate in _COORDINATE.items()
        if coordinate < size and (direction != "theta" or name in rotations)
    }
    interface = list(rows.values())
    order = interface + [i for i in range(len(mass)) if i not in {*interface, *held}]
    block = np.ix_(order, order)
    return BeamMatrices(
        mass[block], stiffness[block], tuple(rows), nodes, displacement[:, :, order]
    )


def _prestress(beam: Beam, link: Link, component: Component) -> BeamPrestress:
    """Return how forces stiffen the equal beams of a link together."""
    assert component.drawing is not None
    places = np.array([place for _, place in link.points])
    nodes, sections = _mesh(beam, places[:, 0].tolist())
    lengths = np.diff(nodes)
    elements = zip(lengths.tolist(), sections, strict=True)
    unit = [prestress_matrices(length, section, beam.material) for length, section in elements]
    masses = link.count * beam.material.density * lengths * [section.area for section in sections]
    first = _first_coordinates(link.points, nodes, 3)
    extra = dict(link.masses)
    ends = [[InterfaceDof(point, axis) for axis in ("x", "z")] for point, _ in link.points]
    return BeamPrestress(
        motion=component.drawing.displacement[:, [0, 2, 3]].reshape(3 * len(nodes), -1),
        middles=(nodes[1:] + nodes[:-1]) / 2.0,
        unit=np.array(unit).swapaxes(0, 1),
        carried=np.cumsum(masses) - masses / 2.0,
        places=places,
        masses=np.array([link.count * extra.get(point, 0.0) for point, _ in link.points]),
        turns=tuple(first[point] + THETA for point, _ in link.points),
        loaded=np.array([[component.dofs.index(dof) for dof in pair] for pair in ends]),
    )


def _chain(
    nodes: FloatArray, sections: Sequence[Section], material: Material, spatial: bool
) -> tuple[FloatArray, FloatArray]:
    """Assemble elements from node to node; coordinates node by node."""
    size = 6 if spatial else 3
    mass, stiffness = np.zeros((2, size * len(nodes), size * len(nodes)))
    made: dict[tuple[str, Section], tuple[FloatArray, FloatArray]] = {}
    for i, (length, section) in enumerate(zip(np.diff(nodes), sections, strict=True)):
        key = f"{length:.12g}", section  # equal elements differ by rounding
        if key not in made:
            made[key] = element_matrices(float(length), section, material, spatial=spatial)
        at = slice(size * i, size * (i + 2))
        mass[at, at] += made[key][0]
        stiffness[at, at] += made[key][1]
    return mass, stiffness


def _mesh(beam: Beam, places: Sequence[float]) -> tuple[FloatArray, list[Section]]:
    """Return the nodes, (n_nodes,), and the section of each element between them."""
    ends = [segment.end for segment in beam.segments]
    begin = min(0.0, *places)
    same = _SAME_PLACE * (ends[-1] - begin)
    if max(places) > ends[-1] + same or any(b <= a for a, b in pairwise([begin, *ends])):
        raise MechanismError(
            "sections",
            "they do not ascend along the link to its last point; reorder or extend them.",
        )
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


def _first_coordinates(
    points: Sequence[tuple[str, Point]], nodes: FloatArray, size: int
) -> dict[str, int]:
    """Return where the coordinates of each point's node begin."""
    owner: dict[int, str] = {}
    for name, (x, _) in points:
        node = int(np.abs(nodes - x).argmin())
        if node in owner:
            raise MechanismError(
                f"points.{name}",
                f"it is at the same place along the link as {owner[node]} ({x:g} m), and a "
                "beam's section is rigid; move one of them along by about the link's depth.",
            )
        owner[node] = name
    return {name: size * node for node, name in owner.items()}


def _arms(
    points: Sequence[tuple[str, Point]],
    start: dict[str, int],
    n: int,
    clamped: str | None,
    spatial: bool,
) -> tuple[list[tuple[int, int, float]], list[int]]:
    """Return changes of coordinates, old = new + factor * other, and coordinates to hold."""
    arms = [(start[name] + U, start[name] + THETA, z) for name, (_, z) in points]
    if not spatial:
        return arms, []
    arms += [(start[name] + V, start[name] + PSI, z) for name, (_, z) in points]
    held = [] if clamped is None else [start[clamped] + CHI]
    if all(z == 0.0 for _, (_, z) in points):
        return arms, [*held, *range(PSI, n, 6)]
    if clamped is not None:
        return arms, [*held, start[clamped] + PSI]
    slope = _common_slope([place for _, place in points])
    if slope is None:
        return arms, []
    first = start[points[0][0]]  # does not turn about the line: psi + slope chi = 0
    return [*arms, (first + PSI, first + CHI, -slope)], [first + PSI]


def _common_slope(places: Sequence[Point]) -> float | None:
    """Return dz/dx of the line on which all places lie, or None."""
    (x0, z0), *others = sorted(places)
    x1, z1 = others[-1]
    slope = (z1 - z0) / (x1 - x0)
    off = max(abs(z - z0 - slope * (x - x0)) for x, z in others)
    return slope if off <= _SAME_PLACE * (x1 - x0) else None
