# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Primal assembly against closed forms and against Lagrange multipliers."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag

from linkage_vibration.mechanics import coupling
from linkage_vibration.mechanics.compatibility import CouplingError, Joining
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.coupling import assembled_frf, couple, uncoupled_system
from linkage_vibration.mechanics.description import Mechanism, Rayleigh
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.modes import damp_modes, solve_modes
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.response import pole_residue
from test.support.two_linkages import two_linkages

FloatArray = NDArray[np.float64]

PLACES = [("E1", "z"), ("E1", "x"), ("E2", "x"), ("V1", "z")]
FREQUENCIES = np.linspace(0.5, 200.0, 40)


@pytest.fixture(scope="module")
def undamped(mechanism: Mechanism) -> LinkageModel:
    """Return the paper's linkage without damping."""
    return LinkageModel(replace(mechanism, damping=Rayleigh(0.0, 0.0)))


def oscillator(name: str, mass: float, stiffness: float) -> Component:
    """Return a mass on a spring whose foot and head are both interface DoFs."""
    k = stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
    dofs = (InterfaceDof("foot", "x"), InterfaceDof("head", "x"))
    return Component(name, dofs, np.diag([0.0, mass]), k, 0.0 * k, 0.0, None)


def joined(rows: list[list[float]], springs: list[list[float]], stiffness: list[float]) -> Joining:
    """Return constraints and springs given by their rows."""
    labels = tuple(f"row {i}" for i in range(len(rows)))
    stretch = np.array(springs).reshape(-1, len(rows[0]))
    return Joining(np.array(rows), labels, stretch, np.array(stiffness), np.zeros(len(stretch)))


def test_two_masses_in_closed_form() -> None:
    """Two equal oscillators in a row: w^2 = k/m (3 -+ sqrt 5) / 2."""
    system = uncoupled_system([oscillator("a", 2.0, 800.0), oscillator("b", 2.0, 800.0)])
    b = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, -1.0, 0.0]]  # foot held; head of a, foot of b
    omega = solve_modes(couple(system, joined(b, [], [])))[0].omega
    expected = [math.sqrt(400.0 * (3 + sign * math.sqrt(5)) / 2) for sign in (-1, 1)]
    assert omega == pytest.approx(expected, rel=1e-12)


def test_a_spring_in_closed_form() -> None:
    """A spring to the ground adds to the oscillator's own: w^2 = (k + s) / m."""
    system = uncoupled_system([oscillator("a", 2.0, 800.0)])
    sprung = joined([[1.0, 0.0]], [[0.0, 1.0]], [1000.0])
    assert solve_modes(couple(system, sprung))[0].omega == pytest.approx([30.0], rel=1e-12)


def repeated(joining: Joining, rows: list[FloatArray], labels: list[str]) -> Joining:
    """Return a joining with further rows of B."""
    return replace(
        joining,
        compatibility=np.vstack([joining.compatibility, *rows]),
        labels=(*joining.labels, *labels),
    )


def test_repeated_constraints_are_left_out() -> None:
    """Rows of B that say the same twice change nothing."""
    system = uncoupled_system([oscillator("a", 2.0, 800.0), oscillator("b", 2.0, 800.0)])
    rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
    once = couple(system, joined(rows, [], []))
    twice = couple(system, joined([*rows, [-2.0, 0.0, 0.0, 0.0]], [], []))
    np.testing.assert_allclose(solve_modes(twice)[0].omega, solve_modes(once)[0].omega, rtol=1e-13)


@pytest.mark.parametrize("alpha3_deg", [90.0, 140.0, 180.0])
def test_linkage_with_joints_closed_twice(model: LinkageModel, alpha3_deg: float) -> None:
    """A pin closed twice, one in turned axes, a body joined to itself: unchanged to 1e-8."""
    solution = model.solve(math.radians(alpha3_deg))
    joining, interface = solution.joining, model.interface
    pin = [i for i, label in enumerate(joining.labels) if "pin V1" in label]
    x, z = joining.compatibility[pin]
    point = interface.displacement("implement", "E2", solution.configuration)
    once_more = ["V1 again in x", "V1 again in z", "V1 aslant", "E2 on itself", "E2 on itself"]
    more = repeated(joining, [x, z, 0.6 * x + 0.8 * z, *(point - point)], once_more)
    coupled = couple(model.system, more)
    omega = solve_modes(coupled)[0].omega
    np.testing.assert_allclose(omega[:10], solution.modes.omega[:10], rtol=1e-8)
    rows = model.rows(PLACES, solution.configuration)
    receptances = assembled_frf(coupled, FREQUENCIES, rows, rows)
    exact = assembled_frf(solution.coupled, FREQUENCIES, rows, rows)
    np.testing.assert_allclose(receptances, exact, rtol=1e-8)


@pytest.mark.parametrize("apart", [1e-11, 1e-9, 1e-7])
def test_joints_nearly_closed_twice_are_refused(model: LinkageModel, apart: float) -> None:
    """Between rounding and a joint it is unclear: the error names the two, and no other."""
    joining = model.solve(2.0).joining
    row = joining.compatibility[joining.labels.index("pin V1 of lower_link and lift_rod in x")]
    aslant = row + apart * np.roll(row, 1)
    with pytest.raises(CouplingError, match="nearly repeat") as caught:
        couple(model.system, repeated(joining, [aslant], ["another V1"]))
    message = str(caught.value)
    assert "another V1" in message
    assert "pin V1 of lower_link and lift_rod in x" in message
    assert "P1" not in message


def test_static_limit_in_closed_form() -> None:
    """At 0 Hz a row of springs yields the sum of their compliances."""
    system = uncoupled_system([oscillator("a", 2.0, 800.0), oscillator("b", 3.0, 200.0)])
    coupled = couple(system, joined([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, -1.0, 0.0]], [], []))
    heads = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    receptances = assembled_frf(coupled, np.zeros(1), heads, heads)[0]
    yields = 1 / 800 + 1 / 200
    np.testing.assert_allclose(receptances, [[1 / 800, 1 / 800], [1 / 800, yields]], rtol=1e-14)


@pytest.mark.parametrize("alpha3_deg", [90.0, 140.0, 180.0])
def test_static_limit_of_the_linkage(model: LinkageModel, alpha3_deg: float) -> None:
    """At 0 Hz: as the saddle point K u + B^T g = f, B u = 0, and as a tiny frequency, to 1e-8."""
    solution = model.solve(math.radians(alpha3_deg))
    rows = model.rows(PLACES, solution.configuration)
    receptances = assembled_frf(solution.coupled, np.array([0.0, 1e-4]), rows, rows)
    assert np.abs(receptances[0].imag).max() == 0.0
    largest = np.abs(receptances[0]).max()
    assert np.abs(receptances[1].real - receptances[0].real).max() < 1e-8 * largest

    stiffness, n = model.system.stiffness, len(model.system.stiffness)
    b = np.pad(solution.joining.compatibility, ((0, 0), (0, n - rows.shape[1])))
    unit = np.diag(stiffness).max()  # interface forces in its units, so that rows compare
    saddle = np.block([[stiffness, unit * b.T], [unit * b, np.zeros((len(b), len(b)))]])
    force = np.pad(rows, ((0, 0), (0, len(saddle) - rows.shape[1])))
    assert np.abs(force @ np.linalg.solve(saddle, force.T) - receptances[0]).max() < 1e-8 * largest


def test_mechanism_has_no_static_limit(mapping: Any) -> None:
    """With the crank free there is a mode at 0 Hz, and 0 Hz is refused with the fix."""
    del mapping["links"]["input_crank"]["clamped"]
    free = LinkageModel(mechanism_from_mapping(mapping))
    for angle in np.radians([90.0, 135.0, 180.0]):
        solution = free.solve(angle)
        assert solution.natural_frequencies[0] < 1e-5
        rows = free.rows(PLACES, solution.configuration)
        with pytest.raises(CouplingError, match=r"can move without a force.*`clamped`"):
            assembled_frf(solution.coupled, np.array([0.0, 1.0]), rows, rows)
        moved = assembled_frf(solution.coupled, np.array([1.0]), rows, rows)
        assert np.isfinite(moved).all()


def test_undamped_resonance_of_the_assembly_is_refused(undamped: LinkageModel) -> None:
    """Where the receptance is infinite it is refused; beside it, it is that of the modes."""
    solution = undamped.solve(2.0)
    rows = undamped.rows(PLACES, solution.configuration)
    resonances = solution.natural_frequencies[:3]
    for resonance in resonances:
        with pytest.raises(CouplingError, match=f"At {resonance:g} Hz.*without damping"):
            assembled_frf(solution.coupled, np.array([1.0, resonance]), rows, rows)
    beside = resonances * (1 + 1e-3)
    receptances = assembled_frf(solution.coupled, beside, rows, rows)
    exact = solution.frf(PLACES, PLACES).frf(beside)
    assert np.abs(receptances - exact).max() < 1e-8 * np.abs(exact).max()


def test_coincident_poles(model: LinkageModel) -> None:
    """Two equal linkages side by side: each mode twice, and neither answers for the other."""
    alone = model.solve(math.radians(140.0))
    coupled = two_linkages(model, alone)
    modes, vectors = solve_modes(coupled)
    np.testing.assert_allclose(
        modes.omega[:20].reshape(-1, 2).T, [alone.modes.omega[:10]] * 2, rtol=1e-9
    )
    rows = model.rows(PLACES, alone.configuration)
    either = block_diag(rows, rows)
    exact = alone.frf(PLACES, PLACES).frf(FREQUENCIES)
    pair = np.zeros((len(FREQUENCIES), 8, 8), dtype=complex)
    pair[:, :4, :4] = pair[:, 4:, 4:] = exact
    largest = np.abs(exact).max(axis=(1, 2))[:, np.newaxis, np.newaxis]
    shares = either @ modes.shapes[: either.shape[1]]
    summed = pole_residue(damp_modes(coupled, modes.omega, vectors), shares, shares)
    assert (np.abs(summed.frf(FREQUENCIES) - pair) < 1e-8 * largest).all()
    solved = assembled_frf(coupled, FREQUENCIES, either, either)
    assert (np.abs(solved - pair) < 1e-8 * largest).all()


def test_lines_in_chunks(model: LinkageModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """However few lines are solved at a time, the answer is the same."""
    solution = model.solve(2.0)
    rows = model.rows(PLACES, solution.configuration)
    whole = assembled_frf(solution.coupled, FREQUENCIES, rows[:1], rows[1:])
    monkeypatch.setattr(coupling, "_CHUNK", 3 * solution.coupled.mass.size)
    parts = assembled_frf(solution.coupled, FREQUENCIES, rows[:1], rows[1:])
    np.testing.assert_array_equal(parts, whole)


@pytest.mark.parametrize("alpha3_deg", [90.0, 140.0, 180.0])
def test_primal_equals_dual(mapping: Any, alpha3_deg: float) -> None:
    """Forced response on the null space equals that with Lagrange multipliers (eq. 8)."""
    mapping["springs"] = {"stay": {"between": ["P2", "V1"], "stiffness": 3e5}}
    model = LinkageModel(mechanism_from_mapping(mapping))
    solution = model.solve(math.radians(alpha3_deg))
    joining = solution.joining
    b = joining.compatibility
    n, rows, n_interface = len(model.system.mass), len(b), b.shape[1]
    omega = 2 * math.pi * 37.0
    saddle = np.zeros((n + rows, n + rows))
    saddle[:n, :n] = model.system.stiffness - omega**2 * model.system.mass
    stretch = joining.elongation
    saddle[:n_interface, :n_interface] += stretch.T @ (joining.stiffness[:, None] * stretch)
    saddle[n:, :n_interface] = b
    saddle[:n_interface, n:] = b.T
    drive = model.rows([("E1", "z")], solution.configuration)
    force = np.zeros(n + rows)
    force[:n_interface] = drive[0]
    dual = drive[0] @ np.linalg.solve(saddle, force)[:n_interface]
    primal = solution.coupled
    row = primal.restrict(drive)[0]
    actual = row @ np.linalg.solve(primal.stiffness - omega**2 * primal.mass, row)
    assert actual == pytest.approx(dual, rel=1e-9)
