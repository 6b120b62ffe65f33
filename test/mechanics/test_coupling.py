# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Primal assembly against closed forms and against Lagrange multipliers."""

import math

import numpy as np
import pytest

from linkage_vibration.mechanics.components import Component, InterfaceDof
from linkage_vibration.mechanics.coupling import CouplingError, couple, uncoupled_system
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.modes import solve_modes


def oscillator(name: str, mass: float, stiffness: float) -> Component:
    """Return a mass on a spring whose foot and head are both interface DoFs."""
    k = stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
    dofs = (InterfaceDof("foot", "x"), InterfaceDof("head", "x"))
    return Component(name, dofs, np.diag([0.0, mass]), k)


def test_two_masses_in_closed_form() -> None:
    """Two equal oscillators in a row: w^2 = k/m (3 -+ sqrt 5) / 2."""
    system = uncoupled_system([oscillator("a", 2.0, 800.0), oscillator("b", 2.0, 800.0)])
    b = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, -1.0, 0.0]])  # foot held; head of a, foot of b
    omega = solve_modes(couple(system, b)).omega
    expected = [math.sqrt(400.0 * (3 + sign * math.sqrt(5)) / 2) for sign in (-1, 1)]
    assert omega == pytest.approx(expected, rel=1e-12)


def test_repeated_constraints_are_refused() -> None:
    """Rows of B that say the same twice are counted in the error."""
    system = uncoupled_system([oscillator("a", 2.0, 800.0)])
    with pytest.raises(CouplingError, match="1 of the 2 constraints"):
        couple(system, np.array([[1.0, 0.0], [-2.0, 0.0]]))


@pytest.mark.parametrize("alpha3_deg", [90.0, 140.0, 180.0])
def test_primal_equals_dual(model: LinkageModel, alpha3_deg: float) -> None:
    """Forced response on the null space equals that with Lagrange multipliers (eq. 8)."""
    solution = model.solve(math.radians(alpha3_deg))
    b = model.compatibility(solution.configuration)
    n, rows = len(model.system.mass), len(b)
    omega = 2 * math.pi * 37.0
    z = model.system.stiffness - omega**2 * model.system.mass
    saddle = np.zeros((n + rows, n + rows))
    saddle[:n, :n] = z
    saddle[n:, : b.shape[1]] = b
    saddle[: b.shape[1], n:] = b.T
    force = np.zeros(n + rows)
    force[: b.shape[1]] = solution.drive_row
    dual = solution.drive_row @ np.linalg.solve(saddle, force)[: b.shape[1]]
    primal = couple(model.system, b)
    reduced = primal.stiffness - omega**2 * primal.mass
    row = np.zeros(len(reduced))
    row[: primal.basis.shape[1]] = solution.drive_row @ primal.basis
    assert row @ np.linalg.solve(reduced, row) == pytest.approx(dual, rel=1e-9)
