# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What holds for every linkage, whatever its lengths, masses, sections and angle.

Each property is tried on a few random linkages at every run, and on ten thousand by
``pytest -m nightly test/properties``.

Tolerances follow from the rounding of double precision: see `rounding`.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import eigvalsh

from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.fbs import FbsError
from linkage_vibration.mechanics.model import Place, Solution
from linkage_vibration.mechanics.response import pole_residue

from .linkages import ANGLE, DRIVE_POINT, LEAST_BEND, SHORTEST, Linkage, beyond, linkages

FloatArray = NDArray[np.float64]

FEW, MANY = 6, 10_000
EPS = float(np.finfo(float).eps)
FBS_ROUNDING = 1e-6  # of the assembly's largest receptance: `couple_frfs` refuses more
DRIVE: list[Place] = [(DRIVE_POINT, "x"), (DRIVE_POINT, "z")]
FREQUENCY = st.floats(0.0, 3.0).map(lambda power: 10.0**power)  # Hz

Property = Callable[..., None]


def holds_for(*drawn: st.SearchStrategy[Any]) -> Callable[[Property], Callable[[int], None]]:
    """Try a property on a few examples, and in the nightly setting on many."""

    def decorate(body: Property) -> Callable[[int], None]:
        @pytest.mark.parametrize("examples", [FEW, pytest.param(MANY, marks=pytest.mark.nightly)])
        def test(examples: int) -> None:
            # The few are the same in every run; the many are drawn again each night.
            tried = settings(max_examples=examples, derandomize=examples == FEW, database=None)
            tried(given(*drawn)(body))()

        test.__doc__ = body.__doc__
        return test

    return decorate


def rounding(solution: Solution, turned: float = 0.0) -> FloatArray:
    """How far rounding may move each squared natural frequency, (n_modes,), (rad/s)^2.

    A product of matrices of size n is rounded by n EPS / 2 abs(A) abs(B) (Higham, Accuracy and
    Stability of Numerical Algorithms, 3.13), and each of both has up to sqrt(n) times the spectral
    norm that it has with its signs (lemma 6.6), which makes n^2 EPS / 2 of them. M and K come
    from four such products (reduction and assembly, from both sides); that moves a squared
    frequency by as much of the largest of the parts (Weyl). The modes take four more (a factor, its
    application from both sides, the solution) and are solved for 1 / w^2, so that these move w^2 by
    as much of w^4 / w_1^2. Bodies that are ``turned`` (rad) enter from both sides too.
    """
    squared = solution.modes.omega**2
    share = product_rounding(solution, 4)
    from_modes = share * squared**2 / squared[0]
    return np.asarray((share + 2.0 * turned) * highest(solution) + from_modes)


def product_rounding(solution: Solution, products: int) -> float:
    """By what share of the factors' norms some products of a solution's matrices are rounded."""
    n = len(solution.model.system.mass)
    return products * n**2 * EPS / 2.0


def turned_by_rounding(reach: float) -> float:
    """By how much bodies turn when coordinates up to ``reach`` (m, rad) are rounded, rad."""
    return EPS * reach / (SHORTEST * math.sin(math.radians(LEAST_BEND)))


def highest(solution: Solution) -> float:
    """Return the largest squared natural frequency of the parts and of the whole, (rad/s)^2."""
    system = solution.model.system
    parts = float(eigvalsh(system.stiffness, system.mass)[-1])
    return max(parts, float(solution.modes.omega[-1]) ** 2)


def frf_rounding(
    solution: Solution, places: list[Place], frequency: float, turned: float = 0.0
) -> FloatArray:
    """How far rounding may move each receptance between places, (n, n), m/N.

    Moving Z by E moves H = phi^T Z^-1 phi by phi^T Z^-1 E Z^-1 phi, here in modal coordinates. The
    damping D is rounded as K is and enters with w. Complex modes come from [[0, W], [-W, -D]],
    rounded by its size; without its upper half that is w or the largest w_r times as much in Z.
    Bodies that are turned mix what phi has along x and z.
    """
    omega, coupled = 2.0 * math.pi * frequency, solution.coupled
    vectors, natural = solution.vectors, solution.modes.omega
    damping = vectors.T @ coupled.damping @ vectors
    largest = natural[-1] if solution.damped.poles is not None else 0.0
    share = product_rounding(solution, 4) + 2.0 * turned
    damped = share * (np.linalg.norm(damping, 2) + largest) * (omega + largest)
    dynamic = np.diag(natural**2 - omega**2) + 1j * omega * damping
    inverse = np.linalg.inv(dynamic + 1j * vectors.T @ coupled.loss @ vectors)
    own = solution.participation(places)
    points = list(dict.fromkeys(point for point, _ in places))
    both = [np.abs(solution.participation([(p, "x"), (p, "z")])).sum(axis=0) for p in points]
    mixed = turned * np.array([both[points.index(point)] for point, _ in places])
    motion, more = np.abs(own @ inverse), mixed @ np.abs(inverse)
    moved = (motion + more) * np.sqrt(rounding(solution, turned) + damped)
    return np.asarray(moved @ moved.T + motion @ mixed.T + mixed @ motion.T + more @ mixed.T)


def receptance(solution: Solution, frequency: float) -> NDArray[np.complex128]:
    """Return that of the drive point in x and z, (2, 2), m/N."""
    return solution.frf(DRIVE, DRIVE).frf(np.array([frequency]))[0]


def assert_same(first: Solution, other: Solution, turned: float) -> None:
    """Check that two models have the same frequencies."""
    difference = np.abs(other.modes.omega**2 - first.modes.omega**2)
    assert (difference <= rounding(first, turned) + rounding(other, turned)).all()


def assert_no_higher(lower: Solution, upper: Solution) -> None:
    """Check that no frequency of the first, mode by mode, is above that of the second."""
    n = min(len(lower.modes.omega), len(upper.modes.omega))
    rise = lower.modes.omega[:n] ** 2 - upper.modes.omega[:n] ** 2
    assert (rise <= rounding(lower)[:n] + rounding(upper)[:n]).all()


@holds_for(linkages(), FREQUENCY)
def test_reciprocity(linkage: Linkage, frequency: float) -> None:
    """H_ij = H_ji between points of two links, from modes and by coupling FRFs, which agree."""
    solution = linkage.solve()
    model = solution.model
    places: list[Place] = [*DRIVE, ("B", "x"), ("B", "z")]
    line = np.array([frequency])
    frf = solution.frf(places, places).frf(line)[0]
    assert (np.abs(frf - frf.T) <= frf_rounding(solution, places, frequency)).all()
    try:
        coupled = model.coupled_frf(linkage.alpha3, line, places, places).values[0]
    except FbsError:  # as it promises where rounding leaves more than that of the largest
        return
    shapes = solution.modes.shapes[: len(model.interface)]
    largest = np.abs(pole_residue(solution.damped, shapes, shapes).frf(line)).max()
    assert np.abs(coupled - coupled.T).max() <= FBS_ROUNDING * largest
    assert np.abs(coupled - frf).max() <= FBS_ROUNDING * largest


@holds_for(linkages())
def test_positive_matrices(linkage: Linkage) -> None:
    """M is positive definite and K semi-definite, of each reduced component and assembled."""
    solution = linkage.solve()
    matrices = [(solution.coupled.mass, solution.coupled.stiffness)]
    for component in solution.model.components:
        assert isinstance(component, Component)
        matrices.append((component.mass, component.stiffness))
    for mass, stiffness in matrices:
        np.linalg.cholesky(mass)
        squared = eigvalsh(stiffness, mass)
        assert squared[0] >= -product_rounding(solution, 4) * highest(solution)


@holds_for(linkages(), st.floats(1e-3, 100.0), st.data())
def test_mass_lowers(linkage: Linkage, mass: float, data: st.DataObject) -> None:
    """A point mass, on a pin of a link or anywhere on a rigid body, raises no frequency."""
    heavier = linkage.copy()
    bodies = {**heavier.mapping["links"], **heavier.mapping["rigid_bodies"]}
    body = bodies[data.draw(st.sampled_from(sorted(bodies)))]
    if "mass" in body:
        add_mass(body, mass, data.draw(st.tuples(*[st.floats(-0.5, 0.5)] * 2)))
    else:
        body["masses"] = {data.draw(st.sampled_from(sorted(body["points"]))): mass}
    light = linkage.solve()
    assert_no_higher(heavier.solve(light), light)


def add_mass(body: dict[str, Any], mass: float, place: tuple[float, float]) -> None:
    """Fix a point mass to a rigid body at a place in its own axes."""
    total = body["mass"] + mass
    x, z = body["centre_of_gravity"]
    arm = math.hypot(place[0] - x, place[1] - z)
    share = mass / total
    body["centre_of_gravity"] = [x + share * (place[0] - x), z + share * (place[1] - z)]
    body["inertia"] += body["mass"] * share * arm**2
    body["mass"] = total


@holds_for(linkages(), st.floats(1.0, 7.0), st.data())
def test_spring_raises(linkage: Linkage, power: float, data: st.DataObject) -> None:
    """A spring, on a joint or between two points, lowers no frequency."""
    stiffer = linkage.copy()
    joints = ["B", "C", "D", *("EFP" if "F" in stiffer.mapping["ground"] else "")]
    spring: dict[str, Any] = {"stiffness": 10.0**power}
    if data.draw(st.booleans()):
        spring["joint"] = data.draw(st.sampled_from(joints))
    else:
        stiffer.mapping["ground"]["S"] = [
            data.draw(st.floats(-3.0, -2.0)),
            data.draw(st.floats(-3.0, 3.0)),
        ]
        spring["between"] = ["S", data.draw(st.sampled_from(["B", "C"]))]
    stiffer.mapping["springs"]["added"] = spring
    # Unreduced, as a spring on a joint changes what is kept of the links.
    soft = linkage.solve(reduced=False)
    assert_no_higher(soft, stiffer.solve(soft, reduced=False))


@holds_for(linkages(), st.integers(1, 3))
def test_reduction_interlaces(linkage: Linkage, modes: int) -> None:
    """Craig-Bampton frequencies lie above the exact ones, and fall with each mode that is kept."""
    more = linkage.copy()
    for reduced, kept in ((linkage, modes), (more, modes + 1)):
        for link in reduced.mapping["links"].values():
            link["modes"] = kept
    few = linkage.solve()
    many, exact = more.solve(few), linkage.solve(few, reduced=False)
    assert_no_higher(many, few)
    assert_no_higher(exact, many)


@holds_for(linkages(), FREQUENCY, ANGLE, st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_rigid_motion(linkage: Linkage, frequency: float, turn: float, x: float, z: float) -> None:
    """A linkage set up elsewhere and aslant has the same frequencies, and FRFs that turn along."""
    moved = Linkage(linkage.copy().mapping, linkage.alpha3_deg + turn)
    mapping = moved.mapping
    for name, place in mapping["ground"].items():
        mapping["ground"][name] = list(beyond((x, z), turn, tuple(place)))
    mapping["assembly"]["alpha3_deg"] += turn
    mapping["input"]["range_deg"] = [angle + turn for angle in mapping["input"]["range_deg"]]
    angles = mapping["assembly"]["angles_deg"]
    angles.update({name: angle + turn for name, angle in angles.items()})
    solution, other = linkage.solve(), moved.solve()
    rounded = turned_by_rounding(abs(x) + abs(z) + 2.0 * math.pi)
    assert_same(solution, other, rounded)
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    axes = np.array([[c, -s], [s, c]])
    back = axes.T @ receptance(other, frequency) @ axes
    # Turning back mixes the four by two factors up to 1.
    limit = sum(frf_rounding(each, DRIVE, frequency, rounded).max() for each in (solution, other))
    assert (np.abs(back - receptance(solution, frequency)) <= 2.0 * limit).all()


@holds_for(linkages(), FREQUENCY, st.data())
def test_renumbering(linkage: Linkage, frequency: float, data: st.DataObject) -> None:
    """Bodies and points in another order, and a link counted from its other end, change nothing."""
    other = linkage.copy()
    mapping = other.mapping
    if data.draw(st.booleans()):
        turn_round(mapping, data.draw(st.sampled_from(sorted(mapping["links"]))))
    for key in ("ground", "links", "rigid_bodies"):
        names = data.draw(st.permutations(sorted(mapping[key])))
        mapping[key] = {name: mapping[key][name] for name in names}
    other = Linkage(mapping, mapping["assembly"]["alpha3_deg"])
    solution, two = linkage.solve(), other.solve()
    rounded = turned_by_rounding(2.0 * math.pi)
    assert_same(solution, two, rounded)
    limit = sum(frf_rounding(each, DRIVE, frequency, rounded) for each in (solution, two))
    difference = receptance(two, frequency) - receptance(solution, frequency)
    assert (np.abs(difference) <= limit).all()


def turn_round(mapping: dict[str, Any], name: str) -> None:
    """Describe a link from its other end, with its own axes turned by half a turn."""
    link, assembly = mapping["links"][name], mapping["assembly"]
    points = link["points"]
    length = max(place for place in points.values() if isinstance(place, float))
    link["points"] = {
        point: [length - place[0], -place[1]] if isinstance(place, list) else length - place
        for point, place in reversed(points.items())
    }
    if name == mapping["input"]["link"]:
        assembly["alpha3_deg"] += 180.0
        mapping["input"]["range_deg"] = [a + 180.0 for a in mapping["input"]["range_deg"]]
    else:
        assembly["angles_deg"][name] += 180.0


@holds_for(linkages(), FREQUENCY)
def test_energy_balance(linkage: Linkage, frequency: float) -> None:
    """The power that a harmonic force puts in is what all dampers take out."""
    solution = linkage.solve()
    coupled, omega = solution.coupled, 2.0 * math.pi * frequency
    drive = solution.participation(DRIVE[:1])
    line = np.array([frequency])
    point = pole_residue(solution.damped, drive, drive).frf(line)[0, 0, 0]
    motion = pole_residue(solution.damped, solution.vectors, drive).frf(line)[0, :, 0]
    put_in = -0.5 * omega * point.imag
    losses = omega**2 * coupled.damping + omega * coupled.loss
    taken_out = 0.5 * float((motion.conj() @ losses @ motion).real)
    # The power put in is off by w / 2 times the receptance's error; what is taken out, as it goes
    # with the square of the motion, by twice that, and by the rounding of its own sum, in which
    # most of what bodies do as one cancels.
    limit = 1.5 * omega * float(frf_rounding(solution, DRIVE[:1], frequency)[0, 0])
    limit += 0.5 * len(motion) * EPS * float(np.abs(motion) @ np.abs(losses) @ np.abs(motion))
    assert put_in > 0.0
    assert abs(put_in - taken_out) <= limit
