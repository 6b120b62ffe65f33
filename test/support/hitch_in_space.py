# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A three-point hitch in space by finite elements of its own: both sides, six DoFs a node.

It shares no code with the package: the loops are closed by intersecting circles, beams are elements
in space between nodes, and ball joints share displacements. x points forward, y left, z up; numbers
are those of the shipped hitch, and of the lateral half that the tests describe.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh

FloatArray = NDArray[np.float64]

E, RHO, NU = 210e9, 7800.0, 0.3
G = E / (2.0 * (1.0 + NU))
P1, P2, P3 = np.array([0.0, 0.0]), np.array([-0.334, 0.403]), np.array([-0.064, 0.385])
ASIDE = {"P1": 0.20, "E1": 0.40, "P3": 0.25, "V2": 0.25, "P2": 0.0, "E2": 0.0}
ASIDE["V1"] = 0.20 + 0.20 * 0.366 / 0.810
IMPLEMENT = (800.0, (550.0, 200.0, 650.0))  # mass, and inertias in roll, pitch and yaw
TRACTOR = (4500.0, (2200.0, 6000.0, 6000.0))
CYLINDERS = 5e5  # N m/rad; the lateral half does not depend on it
CHAIN, CHAIN_AT, CHAIN_END = 5e6, 0.45, np.array([0.0, 0.45, 0.0])
# x, z, track, stiffness along x, y and z of both wheels, height of the contact
AXLES = (
    (0.6, -0.05, 1.6, 700e3, 400e3, 700e3, -0.85),
    (3.1, -0.05, 0.0, 600e3, 350e3, 600e3, -0.75),
)
DAMPING = ((4460.0, 2600.0, 4460.0), (3820.0, 2300.0, 3820.0))  # of the axles, along x, y, z
# Of links and implement, on mass and stiffness: a damping ratio of 0.02 at 4 and 180 Hz.
RAYLEIGH = 0.04 * 2.0 * math.pi * 4.0 * 180.0 / 184.0, 0.04 / (2.0 * math.pi * 184.0)
CUBOID = 10.0 * (1.0 + NU) / (12.0 + 11.0 * NU)  # Cowper's shear coefficients


def _tube(outer: float, inner: float) -> tuple[float, float, float, float]:
    second, m2 = math.pi * (outer**4 - inner**4) / 64.0, (inner / outer) ** 2
    below = (7.0 + 6.0 * NU) * (1.0 + m2) ** 2 + (20.0 + 12.0 * NU) * m2
    shear = 6.0 * (1.0 + NU) * (1.0 + m2) ** 2 / below
    return math.pi * (outer**2 - inner**2) / 4.0, second, second, shear


def _rectangle(width: float, height: float) -> tuple[float, float, float, float]:
    return width * height, width * height**3 / 12.0, height * width**3 / 12.0, CUBOID


# Area, second moments in and across the plane, shear coefficient.
SECTIONS = {
    "lower": _rectangle(0.050, 0.032),
    "upper": _tube(0.080, 0.040),
    "crank": _rectangle(0.020, 0.036),
    "rod": _tube(0.029, 0.0),
}


def _meet(a: FloatArray, ra: float, b: FloatArray, rb: float, left: bool) -> FloatArray:
    """Return where circles about a and b meet, left or right of the way from a to b."""
    away = b - a
    d = float(np.hypot(*away))
    along = (ra**2 - rb**2 + d**2) / (2.0 * d)
    across = math.sqrt(ra**2 - along**2) * (1.0 if left else -1.0)
    unit = away / d
    return np.asarray(a + along * unit + across * np.array([-unit[1], unit[0]]))


def pose(alpha3: float) -> dict[str, FloatArray]:
    """Return x and z of every joint and of the implement's centre of gravity, m."""
    v2 = P3 + 0.203 * np.array([math.cos(alpha3), math.sin(alpha3)])
    v1 = _meet(P1, 0.366, v2, 0.534, left=True)
    e1 = P1 + 0.810 / 0.366 * (v1 - P1)
    e2 = _meet(P2, 0.520, e1, 0.438, left=False)
    m = _meet(e1, 1.020, e2, 1.095, left=True)
    return {"P1": P1, "P2": P2, "P3": P3, "V1": v1, "V2": v2, "E1": e1, "E2": e2, "M": m}


def implement_tensor(alpha3: float) -> FloatArray:
    """Return the inertias of the implement, (3, 3), whose axes are the global ones at 135 deg."""
    mast = [places["E2"] - places["E1"] for places in map(pose, (alpha3, math.radians(135.0)))]
    now, before = (math.atan2(z, x) for x, z in mast)
    c, s = math.cos(now - before), math.sin(now - before)
    turn = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    return np.asarray(turn @ np.diag(IMPLEMENT[1]) @ turn.T)


def element(length: float, section: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Return stiffness and mass, (12, 12): x, y, z and rotations about them, of both nodes."""
    area, in_plane, across, shear = section
    k, m = np.zeros((2, 12, 12))
    rod = np.array([[1.0, -1.0], [-1.0, 1.0]])
    polar = in_plane + across
    for at, rigidity, inertia in ((0, E * area, RHO * area), (3, G * polar, RHO * polar)):
        both = np.ix_([at, at + 6], [at, at + 6])
        k[both] = rigidity / length * rod
        m[both] = inertia * length / 6.0 * (np.abs(rod) + np.eye(2))
    # A rotation about y turns x towards -z, and one about z turns x towards y.
    for move, turn, second, sign in ((2, 4, in_plane, -1.0), (1, 5, across, 1.0)):
        phi = 12.0 * E * second / (shear * G * area * length**2)
        s = sign * length
        bend = np.array(
            [
                [12.0, 6.0 * s, -12.0, 6.0 * s],
                [6.0 * s, (4.0 + phi) * s * s, -6.0 * s, (2.0 - phi) * s * s],
                [-12.0, -6.0 * s, 12.0, -6.0 * s],
                [6.0 * s, (2.0 - phi) * s * s, -6.0 * s, (4.0 + phi) * s * s],
            ]
        )
        heavy = np.array(
            [
                [156.0, 22.0 * s, 54.0, -13.0 * s],
                [22.0 * s, 4.0 * s * s, 13.0 * s, -3.0 * s * s],
                [54.0, 13.0 * s, 156.0, -22.0 * s],
                [-13.0 * s, -3.0 * s * s, -22.0 * s, 4.0 * s * s],
            ]
        )
        both = np.ix_([move, turn, move + 6, turn + 6], [move, turn, move + 6, turn + 6])
        k[both] = E * second / ((1.0 + phi) * length**3) * bend
        m[both] = RHO * area * length / 420.0 * heavy
        m[turn, turn] += RHO * second * length / 2.0
        m[turn + 6, turn + 6] += RHO * second * length / 2.0
    return k, m


def _cross(r: FloatArray) -> FloatArray:
    """Return the matrix that turns a rotation into the displacement of a place at r."""
    x, y, z = r
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


Bodies = dict[str, tuple[FloatArray, tuple[float, tuple[float, float, float]]]]


@dataclass
class Assembly:
    """Blocks of raw coordinates, each given by generalised ones, that add up to K, M and C."""

    rows: dict[str, dict[int, FloatArray]] = field(default_factory=dict)
    size: int = 0
    parts: list[tuple[list[str], FloatArray, FloatArray, FloatArray]] = field(default_factory=list)
    # Vectors, axes, length, stiffness and mass of elements; centres of bodies, and what they carry.
    elements: list[tuple[list[str], FloatArray, float, FloatArray, FloatArray]] = field(
        default_factory=list
    )
    centres: dict[str, FloatArray] = field(default_factory=dict)
    carried: dict[str, tuple[str, FloatArray]] = field(default_factory=dict)

    def free(self, name: str, axes: FloatArray) -> None:
        """Let a vector move along axes, (3, k)."""
        self.rows[name] = {self.size + i: axes[:, i] for i in range(axes.shape[1])}
        self.size += axes.shape[1]

    def like(self, name: str, *others: tuple[str, FloatArray]) -> None:
        """Let a vector be the sum of matrices times other vectors."""
        self.rows[name] = {}
        for other, matrix in others:
            for at, column in self.rows[other].items():
                self.rows[name][at] = self.rows[name].get(at, np.zeros(3)) + matrix @ column

    def matrix(self, names: list[str]) -> FloatArray:
        """Return the vectors of these names per generalised coordinate."""
        s = np.zeros((3 * len(names), self.size))
        for i, name in enumerate(names):
            for at, column in self.rows[name].items():
                s[3 * i : 3 * i + 3, at] = column
        return s

    @cached_property
    def matrices(self) -> FloatArray:
        """Stiffness, mass and damping, (3, size, size)."""
        both = np.zeros((3, self.size, self.size))
        for names, *parts in self.parts:
            s = self.matrix(names)
            used = np.flatnonzero(s.any(axis=0))
            for matrix, part in zip(both, parts, strict=True):
                matrix[np.ix_(used, used)] += s[:, used].T @ part @ s[:, used]
        return both


def assembled(
    alpha3: float,
    *,
    tractor: bool,
    rockshaft: float = math.inf,
    paper: bool = False,
    n: int = 24,
    chain: float = CHAIN,
) -> tuple[Assembly, list[str]]:
    """Return the parts of a hitch, and the points of its pairs of links: those of the left first.

    `rockshaft` is between both cranks, N m/rad. The hitch of the paper is in the middle, without
    chains, and with an implement that does not move.
    """
    places, a = pose(alpha3), Assembly()
    bodies: Bodies = {} if paper else {"implement": (places["M"], IMPLEMENT)}
    aside = dict.fromkeys(ASIDE, 0.0) if paper else ASIDE
    if tractor:
        bodies["tractor"] = (np.array([1.6, 0.1]), TRACTOR)
    tensors = {"implement": implement_tensor(alpha3), "tractor": np.diag(TRACTOR[1])}
    for name, (_, (weight, _)) in bodies.items():
        a.free(f"{name} u", np.eye(3))
        a.free(f"{name} r", np.eye(3))
        m = block_diag(weight * np.eye(3), tensors[name])
        c = (name != "tractor") * RAYLEIGH[0] * m
        a.parts.append(([f"{name} u", f"{name} r"], np.zeros((6, 6)), m, c))

    def carried(name: str, body: str, place: FloatArray) -> None:
        if body not in bodies:
            a.rows[name] = {}
            return
        a.centres[body] = centre = np.insert(bodies[body][0], 1, 0.0)
        a.carried[name] = body, place - centre
        a.like(name, (f"{body} u", np.eye(3)), (f"{body} r", _cross(place - centre)))

    def spring(names: list[str], row: FloatArray, time: float = 0.0) -> None:
        k = np.outer(row, row)
        a.parts.append((names, k, 0.0 * k, time * k))

    held = {"P1": "tractor", "P2": "tractor", "P3": "tractor", "E1": "implement", "E2": "implement"}
    spots, beside = {}, []
    for side, sign in (("L", 1.0), ("R", -1.0)):
        for point in ASIDE:
            spots[point + side] = np.insert(places[point], 1, sign * aside[point])
            if point in held:
                carried(point + side, held[point], spots[point + side])
            else:
                a.free(point + side, np.eye(3))
    if tractor:
        for side in "LR" if rockshaft < math.inf else "L":
            a.free(f"shaft{side}", np.eye(3)[:, 1:2])
        if rockshaft == math.inf:
            a.rows["shaftR"] = a.rows["shaftL"]
    links = [
        (name, ends, side)
        for side in "LR"
        for name, ends in (
            ("lower", ("P1", "V1", "E1")),
            ("crank", ("P3", "V2")),
            ("rod", ("V2", "V1")),
        )
    ]
    for name, ends, side in [*links, ("upper", ("P2", "E2"), "L")]:
        joints = [end + side for end in ends]
        way = spots[joints[-1]] - spots[joints[0]]
        length = float(np.linalg.norm(way))
        x_axis = way / length
        z_axis = np.array([-way[2], 0.0, way[0]]) / math.hypot(way[0], way[2])
        axes = np.array([x_axis, np.cross(z_axis, x_axis), z_axis])
        at = {0.0: joints[0], length: joints[-1]}
        if name == "lower":
            at[length * 0.366 / 0.810] = joints[1]
            at[length * CHAIN_AT / 0.810] = f"hook{side}"
        cuts = sorted(at)
        nodes = [0.0]
        for begin, end in pairwise(cuts):
            count = 1 + max(3, round(n * (end - begin) / length))
            nodes.extend(np.linspace(begin, end, count).tolist()[1:])
        names = []
        for i, node in enumerate(nodes):
            base = f"{name}{side}{i}"
            shown = next((at[c] for c in cuts if abs(c - node) < 1e-9), base)
            names.append((shown, f"{base} r"))
            if shown not in a.rows:
                a.free(shown, np.eye(3))
            bearing = name == "crank" and i == 0
            if bearing and tractor:
                turn = np.diag([1.0, 0.0, 1.0])  # with the axis of the rockshaft
                a.like(f"{base} r", ("tractor r", turn), (f"shaft{side}", np.eye(3)))
            elif bearing:
                a.rows[f"{base} r"] = {}
            else:  # Nothing holds or excites the spin of a link, so its first node has none.
                a.free(f"{base} r", axes[1:].T if i == 0 else np.eye(3))
            if name != "upper":
                beside.append(shown)
        turned = np.kron(np.eye(4), axes)
        for i, (begin, end) in enumerate(pairwise(nodes)):
            k, m = element(end - begin, SECTIONS[name])
            parts = [*names[i], *names[i + 1]]
            a.elements.append((parts, turned, end - begin, k, m))
            k, m = turned.T @ k @ turned, turned.T @ m @ turned
            a.parts.append((parts, k, m, RAYLEIGH[0] * m + RAYLEIGH[1] * k))
    if tractor:
        oil = [0.0, 0.5, 0.0, 0.0, 0.5, 0.0, 0.0, -1.0, 0.0]  # in one circuit
        spring(["shaftL", "shaftR", "tractor r"], math.sqrt(CYLINDERS) * np.array(oil))
        if rockshaft < math.inf:
            twist = np.array([0.0, 1.0, 0.0, 0.0, -1.0, 0.0])
            spring(["shaftL", "shaftR"], math.sqrt(rockshaft) * twist)
    for side, sign in () if paper else (("L", 1.0), ("R", -1.0)):
        anchor = CHAIN_END * [1.0, sign, 1.0]
        carried(f"end{side}", "tractor", anchor)
        hook = spots["P1" + side] + CHAIN_AT / 0.810 * (spots["E1" + side] - spots["P1" + side])
        unit = (anchor - hook) / np.linalg.norm(anchor - hook)
        spring([f"hook{side}", f"end{side}"], math.sqrt(chain) * np.concatenate([-unit, unit]))
    for i, (x, z, track, kx, ky, kz, contact) in enumerate(AXLES if tractor else ()):
        tx, ty, tz = (c / k for c, k in zip(DAMPING[i], (kx, ky, kz), strict=True))
        for sign in (1.0, -1.0):
            wheel = f"wheel{i}{sign}"
            carried(wheel, "tractor", np.array([x, sign * track / 2.0, z]))
            spring([wheel], np.array([math.sqrt(kx / 2.0), 0.0, 0.0]), tx)
            spring([wheel], np.array([0.0, 0.0, math.sqrt(kz / 2.0)]), tz)
        carried(f"soil{i}", "tractor", np.array([x, 0.0, contact]))
        spring([f"soil{i}"], np.array([0.0, math.sqrt(ky), 0.0]), ty)
    return a, beside


def _turning(force: FloatArray, arm: FloatArray, along: FloatArray) -> FloatArray:
    """Return the stiffness, (3, 3), of a force on a body at an arm; `along` is 1 for all axes.

    It does the work F (t x (t x r)) / 2 = (F t) (t r) / 2 - (F r) (t t) / 2 as the body turns by t.
    """
    both = np.outer(force, arm)
    return np.asarray(force @ arm * along - (both + both.T) / 2.0)


def add_weight(a: Assembly, rest: Assembly) -> None:
    """Add the stiffness by the weight, whose forces are those in an assembly of equal parts.

    Elements under tension have the geometric stiffness of cubic beams. The tractor also turns the
    cranks about their axes, which these elements leave out, and stands on the soil.
    """

    def carry(body: str, *load: FloatArray) -> None:
        k = _turning(*load)
        a.parts.append(([f"{body} r"], k, 0.0 * k, 0.0 * k))

    k, m = rest.matrices[:2]
    up = np.zeros(rest.size)
    for name, columns in rest.rows.items():
        if not name.endswith(" r") and len(columns) == 3:
            for at, column in columns.items():
                up[at] = column[2]
    moved = np.linalg.solve(k + 1e-9 * m, -9.80665 * (m @ up))
    forces, reached = dict[str, FloatArray](), {"crankL": 0.0, "crankR": 0.0}
    falls = np.tile([0.0, 0.0, -9.80665, 0.0, 0.0, 0.0], 2)
    for names, turned, length, stiffness, mass in rest.elements:
        push = stiffness @ (turned @ rest.matrix(names) @ moved)
        both = np.array([push, push - mass @ turned @ falls]) @ turned
        for i in (0, 2):
            # The first is with the weight of the element, which its end also carries aside.
            ends, pulled = both[:, 3 * i : 3 * i + 3]
            forces[names[i]] = forces.get(names[i], 0.0) + pulled
            if (crank := names[1][:6]) in reached and "tractor" in rest.centres:
                axis, reached[crank] = turned[0, :3], reached[crank] + i / 2 * length
                carry("tractor", ends, reached[crank] * axis, np.outer(axis, axis))
        bending = np.zeros((12, 12))
        for shift, turn, s in ((2, 4, -length), (1, 5, length)):
            own = [shift, turn, shift + 6, turn + 6]
            bending[np.ix_(own, own)] = [
                [36.0, 3.0 * s, -36.0, 3.0 * s],
                [3.0 * s, 4.0 * s * s, -3.0 * s, -s * s],
                [-36.0, -3.0 * s, 36.0, -3.0 * s],
                [3.0 * s, -s * s, -3.0 * s, 4.0 * s * s],
            ]
        geometric = turned.T @ (push[6] / (30.0 * length) * bending) @ turned
        a.parts.append((names, geometric, 0.0 * geometric, 0.0 * geometric))
    for name, (body, arm) in rest.carried.items():
        carry(body, -forces.get(name, np.zeros(3)), arm, np.eye(3))
    for i, (x, *_, k_z, contact) in enumerate(AXLES if "tractor" in rest.centres else ()):
        push = -k_z * np.eye(3)[2] * (rest.matrix([f"wheel{i}1.0"]) @ moved)[2]
        carry("tractor", push, np.array([x, 0.0, contact]) - rest.centres["tractor"], np.eye(3))


def modes(a: Assembly) -> tuple[FloatArray, FloatArray]:
    """Return the lowest natural frequencies, Hz, and mass-normalised shapes, ascending."""
    stiffness, mass = a.matrices[:2]
    shift = (2.0 * math.pi) ** 2
    values, shapes = eigh(mass, stiffness + shift * mass, subset_by_index=[a.size - 60, a.size - 1])
    squares = np.maximum(1.0 / values[::-1] - shift, 0.0)
    return np.sqrt(squares) / (2.0 * math.pi), shapes[:, ::-1] * np.sqrt(shift + squares)


def hitch(alpha3: float, *, weight: bool = False, **given: Any) -> tuple[FloatArray, FloatArray]:
    """Return the natural frequencies of the lateral and of the vertical half, Hz, up to 400 Hz."""
    a, beside = assembled(alpha3, **given)
    if weight:
        add_weight(a, assembled(alpha3, **given | {"chain": 0.0})[0])
    hertz, shapes = modes(a)
    moved = (a.matrix(beside) @ shapes).reshape(2, len(beside) // 2, 3, -1)
    mirrored = moved[1] * np.array([1.0, -1.0, 1.0])[:, np.newaxis]
    odd = ((moved[0] - mirrored) ** 2).sum(axis=(0, 1))
    even = ((moved[0] + mirrored) ** 2).sum(axis=(0, 1))
    low = hertz < 400.0
    return hertz[low & (odd > even)], hertz[low & (even > odd)]
