# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Primal assembly against closed forms and against Lagrange multipliers."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from linkage_vibration.mechanics.compatibility import Joining
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.coupling import CouplingError, couple, uncoupled_system
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.modes import solve_modes
from linkage_vibration.mechanics.parsing import mechanism_from_mapping

FloatArray = NDArray[np.float64]


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


def test_repeated_constraints_are_refused() -> None:
    """Rows of B that say the same twice are counted and named in the error."""
    system = uncoupled_system([oscillator("a", 2.0, 800.0), oscillator("b", 2.0, 800.0)])
    rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-2.0, 0.0, 0.0, 0.0]]
    with pytest.raises(CouplingError, match="1 of the 3 constraints.*: row 0; row 2"):
        couple(system, joined(rows, [], []))


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
    found = row @ np.linalg.solve(primal.stiffness - omega**2 * primal.mass, row)
    assert found == pytest.approx(dual, rel=1e-9)
