# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes: orthogonality, precision, mechanism modes, damping."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from linkage_vibration.mechanics.coupling import CoupledSystem
from linkage_vibration.mechanics.description import LossFactor, Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.modes import ModesError, damp_modes, solve_modes
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.response import pole_residue

FloatArray = NDArray[np.float64]


def system(
    mass: FloatArray,
    stiffness: FloatArray,
    damping: FloatArray | None = None,
    loss: FloatArray | None = None,
) -> CoupledSystem:
    """Return an assembly whose generalised coordinates are its interface DoFs."""
    zero = np.zeros_like(mass)
    return CoupledSystem(
        mass,
        stiffness,
        zero if damping is None else damping,
        zero if loss is None else loss,
        np.eye(len(mass)),
    )


def test_shapes_are_orthonormal(model: LinkageModel) -> None:
    """Shapes have unit modal mass in the uncoupled mass matrix, and open no joint."""
    solution = model.solve(math.radians(120.0))
    shapes = solution.modes.shapes[:, :10]
    np.testing.assert_allclose(shapes.T @ model.system.mass @ shapes, np.eye(10), atol=1e-9)
    b = solution.joining.compatibility
    assert np.abs(b @ shapes[: b.shape[1]]).max() < 1e-12 * np.abs(shapes).max() * 100
    energy = shapes.T @ model.system.stiffness @ shapes
    assert np.diag(energy) == pytest.approx(solution.modes.omega[:10] ** 2, rel=1e-7)


def test_same_frequencies_as_the_plain_eigenproblem(model: LinkageModel) -> None:
    """The inverted problem has the eigenvalues of the plain one, to the plain one's precision."""
    solution = model.solve(math.radians(150.0))
    coupled = solution.coupled
    plain = np.sqrt(eigh(coupled.stiffness, coupled.mass, eigvals_only=True))
    np.testing.assert_allclose(solution.modes.omega[:20], plain[:20], rtol=1e-6)


def test_mechanism_mode_is_at_zero() -> None:
    """A free-free pair of masses on a spring has one mode at 0 Hz and one at sqrt(2 k / m)."""
    k = 50.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    modes, vectors = solve_modes(system(np.eye(2), k))
    assert modes.omega[0] < 1e-6
    assert modes.omega[1] == pytest.approx(10.0, rel=1e-12)
    ratios = damp_modes(system(np.eye(2), k, damping=0.02 * k), modes.omega, vectors).damping_ratios
    assert ratios[1] == pytest.approx(0.1, rel=1e-9)


def test_crank_that_is_free_has_a_mechanism_mode(mapping: Any) -> None:
    """Without its clamp the linkage moves at 0 Hz, along its own kinematics."""
    del mapping["links"]["input_crank"]["clamped"]
    free = LinkageModel(mechanism_from_mapping(mapping)).solve(math.radians(120.0))
    assert free.natural_frequencies[0] < 1e-3
    assert free.natural_frequencies[1] > 50.0


def test_stiff_spring_tends_to_the_clamp(mapping: Any, model: LinkageModel) -> None:
    """A rotational spring at P3, ever stiffer, lets frequencies rise to those of the clamp."""
    del mapping["links"]["input_crank"]["clamped"]
    clamped = model.solve(math.radians(120.0)).natural_frequencies[:3]
    before = np.zeros(3)
    for stiffness in (1e4, 1e5, 1e6, 1e10):
        mapping["springs"] = {"oil": {"joint": "P3", "stiffness": stiffness}}
        sprung = LinkageModel(mechanism_from_mapping(mapping)).solve(math.radians(120.0))
        frequencies = sprung.natural_frequencies[:3]
        assert (frequencies > before).all()
        assert (frequencies < clamped).all()
        before = frequencies
    np.testing.assert_allclose(before, clamped, rtol=1e-4)


CHAIN = 1e4 * (2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1))
DASHPOTS = np.diag([30.0, 0.0, 5.0, 0.0])


@pytest.mark.parametrize(
    "which", ["proportional", "viscous", "overdamped", "structural", "proportional loss"]
)
def test_damped_modes_give_the_direct_response(which: str) -> None:
    """The sum over damped modes is the inverse of K (1 + i eta) - w^2 M + i w C, for each kind."""
    mass = np.diag([1.0, 2.0, 1.5, 3.0])
    damping = {
        "proportional": 0.3 * mass + 1e-4 * CHAIN,
        "viscous": DASHPOTS,
        "overdamped": 200.0 * DASHPOTS,
    }.get(which)
    loss = {"structural": 50 * DASHPOTS, "proportional loss": 0.05 * CHAIN}.get(which)
    coupled = system(mass, CHAIN, damping, loss)
    modes, vectors = solve_modes(coupled)
    damped = damp_modes(coupled, modes.omega, vectors)
    assert (damped.shapes is None) == which.startswith("proportional")
    frequencies = np.linspace(0.0, 40.0, 41)
    receptances = pole_residue(damped, vectors, vectors).frf(frequencies)
    for frequency, matrix in zip(frequencies, receptances, strict=True):
        w = 2 * math.pi * frequency
        z = CHAIN - w**2 * mass + 1j * w * coupled.damping + 1j * coupled.loss
        np.testing.assert_allclose(matrix @ z, np.eye(4), atol=1e-9)
    assert (damped.damping_ratios > 0.0).all()
    assert (damped.damping_ratios < 1.0).all()
    assert (np.diff(np.abs(damped.stiffness)) > 0.0).all()
    assert len(damped.damping_ratios) == (2 if which == "overdamped" else 4)


@pytest.mark.parametrize("rest", [0.0, 1e-3])
def test_equal_loss_factors_are_the_limit_of_unequal_ones(
    mechanism: Mechanism, rest: float
) -> None:
    """With one loss factor eta the poles are i w sqrt(1 + i eta), w undamped; `rest` is one more.

    So frequencies are above those without damping by (1 + eta^2)^(1/4), as they are in a table.
    """
    eta, angle = 0.5, math.radians(140.0)
    first, *others = mechanism.links
    links = (replace(first, damping=LossFactor(eta + rest)), *others)
    solution = LinkageModel(replace(mechanism, links=links, damping=LossFactor(eta))).solve(angle)
    coupled = solution.coupled
    undamped = np.sqrt(eigh(coupled.stiffness, coupled.mass, eigvals_only=True)[:5]) / math.tau
    natural = (1.0 + eta**2) ** 0.25 * undamped
    np.testing.assert_allclose(solution.natural_frequencies[:5], natural, rtol=1e-7 + rest)
    ratio = math.sin(math.atan(eta) / 2.0)
    np.testing.assert_allclose(solution.damping_ratios[:5], ratio, rtol=1e-12 + 2.0 * rest)


@pytest.mark.parametrize("dashpot", [0.0, 3.0, 17.3, 17.4, 1e3, 1e5])
def test_poles_of_a_dashpot_from_zero_to_rigid(dashpot: float) -> None:
    """Two equal masses on equal springs, and a dashpot between them, that damps one mode.

    In phase the masses oscillate at 10 rad/s without damping. Against each other they have
    s^2 + 2 c s + 300 = 0, which is overdamped from c = sqrt(300) on.
    """
    k = np.array([[200.0, -100.0], [-100.0, 200.0]])
    c = dashpot * np.array([[1.0, -1.0], [-1.0, 1.0]])
    c[0, 0] += 1e-3  # else both shapes are the undamped ones
    modes, vectors = solve_modes(system(np.eye(2), k, c))
    damped = damp_modes(system(np.eye(2), k, c), modes.omega, vectors)
    exact = np.roots(_characteristic(k, c))
    exact = exact[exact.imag > 0.0]
    exact = exact[np.argsort(np.abs(exact))]
    np.testing.assert_allclose(damped.oscillating, exact, rtol=1e-7)
    assert len(exact) == (1 if dashpot > math.sqrt(300.0) else 2)
    np.testing.assert_allclose(damped.damping_ratios, -exact.real / np.abs(exact), rtol=1e-4)


def _characteristic(k: FloatArray, c: FloatArray) -> FloatArray:
    """Return det(s^2 I + s C + K) of two masses, highest power first."""
    first, other = [1.0, c[0, 0], k[0, 0]], [1.0, c[1, 1], k[1, 1]]
    off = [c[0, 1], k[0, 1]]
    return np.polysub(np.polymul(first, other), np.polymul(off, off))


def test_real_roots_are_paired_with_their_neighbours() -> None:
    """Of two overdamped modes each term has roots of one magnitude: no fast one with a slow one."""
    omega, ratio = np.array([10.0, 1000.0]), 1.25  # roots at 0.5 and 2 times the frequency
    turn = np.array([[1.0, 1e-4], [0.0, 1.0]])  # so that damping couples the modes, by very little
    damping = turn.T @ np.diag(2.0 * ratio * omega) @ turn
    damped = damp_modes(system(np.eye(2), np.diag(omega**2), damping), omega, np.eye(2))
    assert damped.poles is not None
    np.testing.assert_allclose(damped.poles, [[-5.0, -500.0], [-20.0, -2000.0]], rtol=1e-3)
    assert len(damped.oscillating) == 0


def test_mixed_damping_is_refused() -> None:
    """Dashpots beside structural damping that both couple the modes have no such sum."""
    coupled = system(np.eye(4), CHAIN, DASHPOTS, 50 * DASHPOTS[::-1, ::-1])
    modes, vectors = solve_modes(coupled)
    with pytest.raises(ModesError, match="same kind"):
        damp_modes(coupled, modes.omega, vectors)
