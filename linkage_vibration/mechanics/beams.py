# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Straight links as chains of Timoshenko beam elements, in the plane of motion or in space.

The bending element is the two-node one whose cubic field solves the static equations (Przemieniecki
1968), with the consistent mass of that field, rotary inertia included (Friedman and Kosmatka 1993).
Statics are exact for loads at nodes, whatever the mesh. Natural frequencies are approached from
above, as h^4 in the length h of the elements while these are slender, and as h^2 when they get as
short as they are deep.

A node moves by u, w and v along the local x, z and y axes and turns by theta from x towards z; in
space also by chi from x towards y and by psi from y towards z. Bending in the plane (w, theta) and
out of it (v, chi) is one element with other numbers, and so are extension (u) and torsion (psi).
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import astuple, dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import hilbert

from linkage_vibration.mechanics.description import Beam, Material, MechanismError, Point, Section
from linkage_vibration.mechanics.dofs import InterfaceDof

FloatArray = NDArray[np.float64]

_U, _W, _THETA, _V, _CHI, _PSI = range(6)  # order in a node; the first three are the plane's
_COORDINATE = {"x": _U, "y": _V, "z": _W, "theta": _THETA}
_SAME_PLACE = 1e-9  # of the beam's length: what lies closer together is one place


@dataclass(frozen=True, slots=True, eq=False)
class BeamMatrices:
    """A free beam on its interface DoFs and inner coordinates.

    Attributes
    ----------
    mass, stiffness : ndarray, (n, n)
        Symmetric to the last bit; ``dofs`` first and in their order, then inner coordinates; SI.
    dofs : tuple of InterfaceDof, (n_dofs,)
        Point by point x, (y,) z and, where asked for, theta.
    nodes : ndarray, (n_nodes,)
        Places along the axis, ascending, m.
    displacement : ndarray, (n_nodes, 3, n)
        Local x, y and z displacement of the nodes for each coordinate; y is zero in the plane.
    """

    mass: FloatArray
    stiffness: FloatArray
    dofs: tuple[InterfaceDof, ...]
    nodes: FloatArray
    displacement: FloatArray


def beam_matrices(
    beam: Beam,
    points: Sequence[tuple[str, Point]],
    *,
    rotations: Collection[str] = (),
    masses: Sequence[tuple[str, float]] = (),
    clamped: str | None = None,
    spatial: bool = False,
) -> BeamMatrices:
    """Put a beam on its points.

    The axis is z = 0. The beam begins at x = 0, or at a point before that, and ends where its last
    segment ends; it may stick out beyond its points. Each point and each end of a segment is a
    node; ``beam.elements`` are shared out among the spans between them by length, to the nearest
    number, at least one each. A point beside the axis sits on a rigid, massless arm that stands on
    its node, so that u = u_point + z theta and v = v_point + z psi.

    Pins are ball joints in space, but for a clamped one. If all lie on one line, none of them holds
    or excites a spin of the whole beam about that line, so that the first point is kept from
    turning about it. If the line is the axis, no pin can twist the beam at all, and torsion is left
    out.

    Parameters
    ----------
    beam : Beam
        Its segments ascend and reach the last point.
    points : sequence of (name, (x, z))
        In m and in any order, two or more; no two at the same x.
    rotations : collection of str
        Points whose rotation theta is an interface DoF.
    masses : sequence of (name, mass)
        Point masses at points, kg.
    clamped : str, optional
        A point that in space does not turn out of the plane (chi and psi).
    spatial : bool
        Whether the beam moves out of the plane of motion too.

    Raises
    ------
    MechanismError
        With a path within the link, if two points share a node, the segments do not reach the
        last point, or a section lacks what the spatial beam needs.

    Examples
    --------
    >>> from linkage_vibration.mechanics.description import Segment
    >>> from linkage_vibration.mechanics.sections import rectangle
    >>> steel = Material(210e9, 7800.0, 0.3)
    >>> beam = Beam(steel, (Segment(0.5, rectangle(0.02, 0.04, 0.3)),), elements=4)
    >>> found = beam_matrices(beam, [("A", (0.0, 0.0)), ("B", (0.5, 0.03))], rotations={"A"})
    >>> [str(dof) for dof in found.dofs]
    ['A x', 'A z', 'A theta', 'B x', 'B z']
    >>> found.mass.shape, found.nodes
    ((15, 15), array([0.   , 0.125, 0.25 , 0.375, 0.5  ]))
    """
    size = 6 if spatial else 3
    nodes, sections = _mesh(beam, [x for _, (x, _) in points])
    if spatial and any(math.isnan(value) for section in sections for value in astuple(section)):
        raise MechanismError(
            "section",
            "a spatial model needs second_moment_out and torsion_constant too; give them.",
        )
    start = _first_coordinates(points, nodes, size)
    mass, stiffness = _chain(nodes, sections, beam.material, spatial)
    displacement = np.zeros((len(nodes), 3, len(mass)))
    for axis, coordinate in enumerate((_U, _V, _W)):
        if coordinate < size:
            displacement[:, axis, coordinate::size] = np.eye(len(nodes))

    arms, held = _arms(points, start, len(mass), clamped, spatial)
    for old, other, factor in arms:  # old = its successor + factor * other
        for matrix in (mass, stiffness):
            matrix[:, other] += factor * matrix[:, old]
            matrix[other] += factor * matrix[old]
        displacement[:, :, other] += factor * displacement[:, :, old]
    for name, value in masses:
        at = [start[name] + coordinate for coordinate in (_U, _W, _V) if coordinate < size]
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


def element_matrices(
    length: float, section: Section, material: Material, *, spatial: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return mass and stiffness of one element, (6, 6), or (12, 12) in space, SI.

    Coordinates are u, w, theta (v, chi, psi) of the first node, then of the second.
    """
    youngs, shear, density = material.youngs_modulus, material.shear_modulus, material.density
    size = 6 if spatial else 3
    mass, stiffness = np.zeros((2 * size, 2 * size)), np.zeros((2 * size, 2 * size))

    def add(coordinates: list[int], element: tuple[FloatArray, FloatArray]) -> None:
        at = np.ix_(*[[*coordinates, *(size + i for i in coordinates)]] * 2)
        mass[at], stiffness[at] = element

    def bending(second_moment: float, coefficient: float) -> tuple[FloatArray, FloatArray]:
        return _bending_element(
            length,
            youngs * second_moment,
            coefficient * shear * section.area,
            density * section.area,
            density * second_moment,
        )

    add([_U], _bar_element(length, youngs * section.area, density * section.area))
    add([_W, _THETA], bending(section.second_moment, section.shear_coefficient))
    if spatial:
        add([_V, _CHI], bending(section.second_moment_out, section.shear_coefficient_out))
        polar = section.second_moment + section.second_moment_out
        add([_PSI], _bar_element(length, shear * section.torsion_constant, density * polar))
    return mass, stiffness


def _bar_element(length: float, rigidity: float, inertia: float) -> tuple[FloatArray, FloatArray]:
    """Extension by E A and rho A, or torsion by G J and rho times the polar second moment."""
    mass = inertia * length / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    return mass, rigidity / length * np.array([[1.0, -1.0], [-1.0, 1.0]])


def _bending_element(
    length: float, rigidity: float, shear_rigidity: float, line_mass: float, rotary: float
) -> tuple[FloatArray, FloatArray]:
    """Bending by E I, kappa G A, rho A and rho I, on w and theta = dw/dx of both nodes.

    With s = x / L the static field is w = a0 + a1 s + a2 s^2 + a3 s^3 and
    theta = (a1 + phi a3 / 2 + 2 a2 s + 3 a3 s^2) / L, where phi = 12 E I / (kappa G A L^2) is shear
    over bending flexibility. The values at s = 0 and 1 give the coefficients. Integrals of
    s^i s^j over the element are the entries of a Hilbert matrix.
    """
    phi = 12.0 * rigidity / (shear_rigidity * length**2)
    # Bending by equal and opposite end moments, and by end forces.
    even, odd = np.array([0.0, -length, 0.0, length]), np.array([2.0, length, -2.0, length])
    a3 = odd / (1.0 + phi)
    a2 = (even - 3.0 * a3) / 2.0
    theta_start = np.array([0.0, length, 0.0, 0.0])
    w = np.array([[1.0, 0.0, 0.0, 0.0], theta_start - phi / 2.0 * a3, a2, a3])
    theta = np.array([theta_start, 2.0 * a2, 3.0 * a3]) / length
    mass = length * (line_mass * w.T @ hilbert(4) @ w + rotary * theta.T @ hilbert(3) @ theta)
    pure, sheared = np.outer(even, even), 3.0 / (1.0 + phi) * np.outer(odd, odd)
    return (mass + mass.T) / 2.0, rigidity / length**3 * (pure + sheared)


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
            "sections", "they do not ascend along the link to its last point; list them so."
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
                f"it lies at the same place along the link as {owner[node]} ({x:g} m), and a "
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
    arms = [(start[name] + _U, start[name] + _THETA, z) for name, (_, z) in points]
    if not spatial:
        return arms, []
    arms += [(start[name] + _V, start[name] + _PSI, z) for name, (_, z) in points]
    held = [] if clamped is None else [start[clamped] + _CHI]
    if all(z == 0.0 for _, (_, z) in points):
        return arms, [*held, *range(_PSI, n, 6)]
    if clamped is not None:
        return arms, [*held, start[clamped] + _PSI]
    slope = _common_slope([place for _, place in points])
    if slope is None:
        return arms, []
    first = start[points[0][0]]  # does not turn about the line: psi + slope chi = 0
    return [*arms, (first + _PSI, first + _CHI, -slope)], [first + _PSI]


def _common_slope(places: Sequence[Point]) -> float | None:
    """Return dz/dx of the line on which all places lie, or None."""
    (x0, z0), *others = sorted(places)
    x1, z1 = others[-1]
    slope = (z1 - z0) / (x1 - x0)
    off = max(abs(z - z0 - slope * (x - x0)) for x, z in others)
    return slope if off <= _SAME_PLACE * (x1 - x0) else None
