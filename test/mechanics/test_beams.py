# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Beams against closed forms, exact transfer matrices and invariants."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import eigh, expm
from scipy.optimize import brentq
from scipy.sparse.csgraph import connected_components

from linkage_vibration.mechanics.bodies.beam import Beam, Segment, beam_matrices
from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.components import Drawing
from linkage_vibration.mechanics.description import Material, MechanismError, Point, Section
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.sections.rectangle import rectangle
from linkage_vibration.mechanics.sections.tube import tube

FloatArray = NDArray[np.float64]
Points = Sequence[tuple[str, Point]]

STEEL = Material(210e9, 7800.0, 0.3)
E, G, RHO = STEEL.youngs_modulus, STEEL.shear_modulus, STEEL.density
LENGTH = 1.2
ENDS: Points = (("A", (0.0, 0.0)), ("B", (LENGTH, 0.0)))
ARM: Points = (("A", (0.0, 0.0)), ("B", (LENGTH, 0.05)))
TRIANGLE: Points = (("A", (0.0, 0.0)), ("P", (0.5, 0.07)), ("B", (LENGTH, 0.02)))
SLENDER = rectangle(0.01, 0.0012, 0.3)
DEEP = rectangle(0.05, 0.15, 0.3)


def uniform(section: Section, elements: int) -> Beam:
    """Return a beam of 1.2 m with one section."""
    return Beam(STEEL, (Segment(LENGTH, section),), elements)


def drawing(actual: Matrices) -> Drawing:
    """Return how the coordinates of a beam move its nodes."""
    assert actual.drawing is not None
    return actual.drawing


def nodes(actual: Matrices) -> FloatArray:
    """Return the places of the nodes of a beam along its axis, m."""
    return drawing(actual).places[:, 0]


def coupled(actual: Matrices, directions: str) -> NDArray[np.intp]:
    """Return all coordinates that couple with the DoFs of some directions, theta with x and z."""
    links = (actual.mass != 0.0) | (actual.stiffness != 0.0)
    labels = connected_components(links, directed=False)[1]
    chosen = [i for i, dof in enumerate(actual.dofs) if dof.direction in directions]
    return np.flatnonzero(np.isin(labels, labels[chosen]))


def part(actual: Matrices, directions: str) -> tuple[FloatArray, FloatArray]:
    """Return mass and stiffness of those coordinates."""
    block = np.ix_(*[coupled(actual, directions)] * 2)
    return actual.mass[block], actual.stiffness[block]


def bending_part(section: Section, elements: int) -> tuple[FloatArray, FloatArray]:
    """Return the matrices of bending of a beam.

    Coordinates: displacement of both ends, rotation of the first end, then the others.
    """
    return part(beam_matrices(uniform(section, elements), ENDS), "z")


def omega(mass: FloatArray, stiffness: FloatArray, held: Sequence[int] = ()) -> FloatArray:
    """Return natural frequencies in rad/s, ascending, with some coordinates held."""
    free = np.setdiff1d(np.arange(len(mass)), np.array(held, dtype=int))
    block = np.ix_(free, free)
    return np.sqrt(np.abs(eigh(stiffness[block], mass[block], eigvals_only=True)))


def rows(actual: Matrices, *dofs: str) -> list[int]:
    """Return the indices of DoFs such as "A x"."""
    return [actual.dofs.index(InterfaceDof(*dof.split())) for dof in dofs]


def compliance(actual: Matrices, held: Sequence[str]) -> FloatArray:
    """Return the static compliance on all coordinates, with zeros where DoFs are held."""
    free = np.setdiff1d(np.arange(len(actual.mass)), rows(actual, *held))
    result = np.zeros_like(actual.stiffness)
    result[np.ix_(free, free)] = np.linalg.inv(actual.stiffness[np.ix_(free, free)])
    return result


def moved_rigidly(actual: Matrices, motions: FloatArray) -> FloatArray:
    """Let the inner coordinates follow the interface statically, (n, n_motions)."""
    b, i = slice(0, len(actual.dofs)), slice(len(actual.dofs), None)
    inner = -np.linalg.solve(actual.stiffness[i, i], actual.stiffness[i, b] @ motions)
    return np.vstack([motions, inner])


def rigid_motions(actual: Matrices, places: dict[str, Point], pivot: Point) -> FloatArray:
    """Return interface motions: along x, along z, by theta about a pivot."""
    motions = np.zeros((len(actual.dofs), 3))
    for row, dof in zip(motions, actual.dofs, strict=True):
        x, z = places[dof.point]
        row[:] = {
            "x": [1.0, 0.0, pivot[1] - z],
            "z": [0.0, 1.0, x - pivot[0]],
            "theta": [0.0, 0.0, 1.0],
        }[dof.direction]
    return motions


def euler(root: float) -> float:
    """Return (root / L)^2 sqrt(E I / rho A) of the slender beam, in rad/s."""
    return (root / LENGTH) ** 2 * math.sqrt(E * SLENDER.second_moment / (RHO * SLENDER.area))


def exact_frequency(
    segments: Sequence[Segment], near: float, *, free_root: bool = False, tip_mass: float = 0.0
) -> float:
    """Return the exact Timoshenko frequency next to a given one, in rad/s.

    The state w, theta, M, Q along each segment is a matrix exponential; at the tip M = 0 and
    Q = w^2 m w.
    """

    def determinant(frequency: float) -> float:
        state, begin = np.eye(4), 0.0
        for segment in segments:
            s = segment.section
            slope = np.zeros((4, 4))  # of w, theta, M / E I0, Q / E I0
            scale = E * segments[0].section.second_moment
            slope[0, 1], slope[0, 3] = 1.0, scale / (s.shear_coefficient * G * s.area)
            slope[1, 2] = scale / (E * s.second_moment)
            slope[2, 1], slope[2, 3] = -(frequency**2) * RHO * s.second_moment / scale, -1.0
            slope[3, 0] = -(frequency**2) * RHO * s.area / scale
            state, begin = expm(slope * (segment.end - begin)) @ state, segment.end
        tip = state[2:].copy()
        tip[1] -= frequency**2 * tip_mass / scale * state[0]
        return float(np.linalg.det(tip[:, :2] if free_root else tip[:, 2:]))

    return float(brentq(determinant, 0.97 * near, 1.03 * near, xtol=1e-13, rtol=1e-13))


@pytest.mark.parametrize(
    ("held", "roots", "rigid"),
    [
        ([0, 1], [math.pi, 2 * math.pi, 3 * math.pi], 0),
        ([0, 2], [1.8751040687, 4.6940911330, 7.8547574382], 0),
        ([], [4.7300407449, 7.8532046241, 10.9956078380], 2),
    ],
    ids=["pinned", "clamped-free", "free-free"],
)
def test_slender_beams(held: list[int], roots: list[float], rigid: int) -> None:
    """A very slender beam has Euler's frequencies, and its rigid modes at zero."""
    actual = omega(*bending_part(SLENDER, 40), held)
    assert actual[rigid : rigid + 3] == pytest.approx([euler(root) for root in roots], rel=2e-5)
    assert (actual[:rigid] < 1e-3 * actual[rigid]).all()


@pytest.mark.parametrize("n", [1, 2, 3])
def test_fourth_order_while_elements_are_slender(n: int) -> None:
    """Elements much longer than deep approach the exact frequency from above as h^4."""
    thin = rectangle(0.001, 0.001, 0.3)
    exact = math.sqrt(E * thin.second_moment / (RHO * thin.area)) * (n * math.pi / LENGTH) ** 2
    errors = [omega(*bending_part(thin, k), [0, 1])[n - 1] / exact - 1 for k in (4, 8)]
    assert errors[1] > 0.0
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.2)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_second_order_when_elements_are_as_short_as_deep(n: int) -> None:
    """A deep beam approaches Timoshenko's frequency from above, in the end as h^2.

    With w = sin(k x), k = n pi / L: the smaller root of
    E I k^4 - (rho A + rho I k^2 (1 + E / (kappa G))) w^2 + rho^2 I / (kappa G) w^4 = 0.
    """
    k, shear = n * math.pi / LENGTH, DEEP.shear_coefficient * G
    a = RHO**2 * DEEP.second_moment / shear
    b = RHO * (DEEP.area + DEEP.second_moment * k**2 * (1 + E / shear))
    c = E * DEEP.second_moment * k**4
    exact = math.sqrt((b - math.sqrt(b**2 - 4 * a * c)) / (2 * a))
    errors = [omega(*bending_part(DEEP, m), [0, 1])[n - 1] / exact - 1 for m in (8, 16, 32)]
    assert all(error > 0.0 for error in errors)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.03)


def test_rod() -> None:
    """A held-free rod's first frequency is c / (4 L), approached from above as h^2."""
    exact = math.pi / 2 * math.sqrt(E / RHO) / LENGTH
    errors = [
        omega(*part(beam_matrices(uniform(DEEP, n), ENDS), "x"), [0])[0] / exact - 1.0
        for n in (4, 8, 16)
    ]
    assert 0.0 < errors[-1] < 5e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.02)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.02)


STEPPED = (
    Segment(0.5, rectangle(0.03, 0.08, 0.3)),
    Segment(0.9, tube(0.06, 0.04, 0.3)),
    Segment(LENGTH, rectangle(0.02, 0.03, 0.3)),
)


def test_stepped_cantilever_deflects_exactly_with_one_element_a_segment() -> None:
    """The tip moves by the integral of M^2 / E I + Q^2 / kappa G A, whatever the mesh."""
    expected = begin = 0.0
    for segment in STEPPED:
        s, from_tip = segment.section, (LENGTH - begin, LENGTH - segment.end)
        expected += (from_tip[0] ** 3 - from_tip[1] ** 3) / (3 * E * s.second_moment)
        expected += (segment.end - begin) / (s.shear_coefficient * G * s.area)
        begin = segment.end
    for elements in (1, 17):
        matrices = beam_matrices(Beam(STEEL, STEPPED, elements), ENDS, rotations={"A"})
        tip = rows(matrices, "B z")[0]
        held = compliance(matrices, ["A x", "A z", "A theta"])
        assert held[tip, tip] == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("tip_mass", [0.0, 15.0])
def test_stepped_cantilever_vibrates_as_its_transfer_matrices_do(tip_mass: float) -> None:
    """A stepped Timoshenko beam, with a point mass or without, has its exact frequencies."""
    matrices = beam_matrices(
        Beam(STEEL, STEPPED, 240), ENDS, rotations={"A"}, masses=[("B", tip_mass)]
    )
    held = rows(matrices, "A x", "A z", "A theta", "B x")
    for value in omega(matrices.mass, matrices.stiffness, held)[:3]:
        assert value == pytest.approx(exact_frequency(STEPPED, value, tip_mass=tip_mass), rel=2e-5)


def test_free_stepped_beam_vibrates_as_its_transfer_matrices_do() -> None:
    """A stepped beam that is free at both ends has its exact frequencies."""
    matrices = beam_matrices(Beam(STEEL, STEPPED, 240), ENDS)
    values = omega(*part(matrices, "z"))
    assert values[1] < 1e-3 * values[2]
    for value in values[2:4]:
        assert value == pytest.approx(exact_frequency(STEPPED, value, free_root=True), rel=2e-5)


@pytest.mark.parametrize("ratio", [0.1, 1.0, 10.0])
def test_tip_mass_on_a_slender_cantilever(ratio: float) -> None:
    """1 + cos b cosh b + ratio b (cos b sinh b - sin b cosh b) = 0 gives the first frequency."""

    def characteristic(b: float) -> float:
        bracket = math.cos(b) * math.sinh(b) - math.sin(b) * math.cosh(b)
        return 1.0 + math.cos(b) * math.cosh(b) + ratio * b * bracket

    exact = euler(brentq(characteristic, 0.1, 1.8751))
    tip = ratio * RHO * SLENDER.area * LENGTH
    matrices = beam_matrices(uniform(SLENDER, 20), ENDS, rotations={"A"}, masses=[("B", tip)])
    held = rows(matrices, "A x", "A z", "A theta")
    assert omega(matrices.mass, matrices.stiffness, held)[0] == pytest.approx(exact, rel=5e-5)


@pytest.mark.parametrize("elements", [1, 8])
def test_compliance_at_the_end_of_an_arm(elements: int) -> None:
    """A force along x at an arm z moves its pin by L / E A + z^2 L / E I and across the axis."""
    s, z = rectangle(0.03, 0.04, 0.3), ARM[1][1][1]
    matrices = beam_matrices(uniform(s, elements), ARM, rotations={"A", "B"})
    x, w, theta = rows(matrices, "B x", "B z", "B theta")
    moved = compliance(matrices, ["A x", "A z", "A theta"])[:, x]
    bending = LENGTH / (E * s.second_moment)
    assert moved[x] == pytest.approx(LENGTH / (E * s.area) + z**2 * bending, rel=1e-10)
    assert moved[w] == pytest.approx(-z * LENGTH * bending / 2, rel=1e-10)
    assert moved[theta] == pytest.approx(-z * bending, rel=1e-10)


def test_inertia_about_an_offset_pin() -> None:
    """Turning about a pin beside the axis carries m (L^2 / 3 + z^2) + rho I L and its products."""
    s, (pivot, end) = rectangle(0.03, 0.06, 0.3), ((0.0, 0.08), (LENGTH, -0.03))
    places = {"A": pivot, "B": end}
    matrices = beam_matrices(uniform(s, 7), list(places.items()), masses=[("B", 2.0)])
    motions = moved_rigidly(matrices, rigid_motions(matrices, places, pivot))
    m, z, reach, drop = RHO * s.area * LENGTH, pivot[1], LENGTH, end[1] - pivot[1]
    turning = m * (LENGTH**2 / 3 + z**2) + RHO * s.second_moment * LENGTH
    turning += 2.0 * (reach**2 + drop**2)
    expected = np.diag([m + 2.0, m + 2.0, turning])
    expected[0, 2] = expected[2, 0] = m * z - 2.0 * drop
    expected[1, 2] = expected[2, 1] = m * LENGTH / 2 + 2.0 * reach
    np.testing.assert_allclose(motions.T @ matrices.mass @ motions, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("points", [ENDS, ARM, TRIANGLE])
def test_rigid_modes(points: Points) -> None:
    """A free beam has three rigid modes, and none if its interface is held."""
    body = beam_matrices(uniform(rectangle(0.03, 0.06, 0.3), 9), points)
    values = omega(body.mass, body.stiffness)
    assert values[2] < 1e-4 * values[3]
    assert values[3] > 100.0
    assert omega(body.mass, body.stiffness, range(len(body.dofs)))[0] > 100.0


@settings(max_examples=40, deadline=None)
@given(
    xs=st.lists(st.integers(-3, 40), min_size=2, max_size=4, unique=True),
    zs=st.lists(st.integers(-20, 20), min_size=4, max_size=4),
    step=st.floats(0.05, 1.0),
    elements=st.integers(1, 12),
)
def test_any_beam_is_symmetric_and_free_of_stress_when_rigid(
    xs: list[int], zs: list[int], step: float, elements: int
) -> None:
    """Symmetry to the last bit, rigid motions without stress, mass where it belongs."""
    places = {"ABCD"[i]: (x / 40 * LENGTH, zs[i] / 100) for i, x in enumerate(xs)}
    segments = (Segment(step, DEEP), Segment(1.1 * LENGTH, tube(0.08, 0.0, 0.3)))
    beam = Beam(STEEL, segments, elements)
    matrices = beam_matrices(beam, list(places.items()), rotations={"A"}, masses=[("A", 2.0)])
    assert np.array_equal(matrices.mass, matrices.mass.T)
    assert np.array_equal(matrices.stiffness, matrices.stiffness.T)
    assert np.linalg.eigvalsh(matrices.mass)[0] > 0.0

    begin = min(0.0, min(x for x, _ in places.values()))
    assert nodes(matrices)[0] == begin
    assert nodes(matrices)[-1] == pytest.approx(1.1 * LENGTH)
    motions = rigid_motions(matrices, places, (0.0, 0.0))
    shapes = moved_rigidly(matrices, motions)
    scale = np.sqrt(np.abs(np.diag(matrices.stiffness)))
    assert np.abs(matrices.stiffness @ shapes / scale[:, np.newaxis]).max() < 1e-8 * scale.max()
    x, moved = nodes(matrices)[:, np.newaxis], drawing(matrices).displacement @ shapes
    np.testing.assert_allclose(moved[:, 0, :3], 0 * x + [1.0, 0.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(moved[:, 1, :3], 0 * x + [0.0, 1.0, 0.0] + x * [0, 0, 1], atol=1e-7)
    total = 2.0 + RHO * segments[0].section.area * (step - begin)
    total += RHO * segments[1].section.area * (segments[1].end - step)
    carried = np.diag(shapes.T @ matrices.mass @ shapes)
    assert carried[[0, 1]] == pytest.approx(total, rel=1e-7)


def test_points_in_any_order() -> None:
    """Listing the points otherwise permutes the DoFs and changes nothing else."""
    beam = Beam(STEEL, STEPPED, 10)
    listed = beam_matrices(beam, TRIANGLE)
    shuffled = beam_matrices(beam, [TRIANGLE[i] for i in (2, 0, 1)])
    order = [shuffled.dofs.index(dof) for dof in listed.dofs]
    order += range(len(order), len(listed.mass))
    block = np.ix_(order, order)
    assert np.array_equal(shuffled.mass[block], listed.mass)
    assert np.array_equal(shuffled.stiffness[block], listed.stiffness)
    assert np.array_equal(drawing(shuffled).displacement[:, :, order], drawing(listed).displacement)


def test_points_and_steps_are_nodes() -> None:
    """Elements are shared out by length, one at least; what rounding parts is one place."""
    section = rectangle(0.01, 0.02, 0.3)
    points = [("A", (0.0, 0.0)), ("B", (0.011, 0.1)), ("C", (0.1 + 0.2, 0.0)), ("D", (0.8, 0.0))]
    segments = (Segment(0.3, section), Segment(0.5, section), Segment(1.0, section))
    places = nodes(beam_matrices(Beam(STEEL, segments, 10), points))
    assert len(places) == 1 + 1 + 3 + 2 + 3 + 2
    for place in (0.0, 0.011, 0.3, 0.5, 0.8, 1.0):
        assert np.isclose(places, place, rtol=0.0, atol=1e-12).sum() == 1
    assert (np.diff(places) > 0.01).all()
    rounded = Beam(STEEL, (Segment(0.3, section),), 3)  # 0.1 + 0.2 lies above 0.3
    assert len(nodes(beam_matrices(rounded, points[::2]))) == 4


def test_pins_within_the_beam() -> None:
    """A beam that sticks out beyond both pins is the same beam, seen from other points."""
    beam = Beam(STEEL, STEPPED, 24)
    inside = [("A", (0.5, 0.02)), ("B", (0.9, 0.0))]
    within, ends = beam_matrices(beam, inside), beam_matrices(beam, ENDS)
    np.testing.assert_allclose(nodes(within), nodes(ends), atol=1e-15)
    actual, expected = (omega(m.mass, m.stiffness)[3:] for m in (within, ends))
    np.testing.assert_allclose(actual, expected, rtol=1e-9)
    # A pin before x = 0 lets the beam begin there.
    earlier = beam_matrices(beam, [("A", (-0.2, 0.0)), ("B", (0.9, 0.0))])
    assert nodes(earlier)[0] == -0.2


def test_two_pins_at_one_place() -> None:
    """Pins above one another would be joined rigidly; the error says how to fix it."""
    points = [("A", (0.0, 0.0)), ("B", (0.4, 0.05)), ("C", (0.4, -0.05))]
    with pytest.raises(MechanismError, match=r"^points\.C: .*same place .* as B \(0\.4 m\).*move"):
        beam_matrices(uniform(DEEP, 4), points)


def test_sections_that_end_too_early() -> None:
    """Sections have to reach the last point."""
    with pytest.raises(MechanismError, match=r"sections: .*last point"):
        beam_matrices(uniform(DEEP, 4), [("A", (0.0, 0.0)), ("B", (1.3, 0.0))])
