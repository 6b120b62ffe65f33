# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes: orthogonality, precision, mechanism modes, tracking."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh

from linkage_vibration.mechanics.coupling import CoupledSystem, couple
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.modes import Modes, mac, solve_modes, track


def test_shapes_are_orthonormal(model: LinkageModel) -> None:
    """Shapes have unit modal mass in the uncoupled mass matrix, and open no joint."""
    solution = model.solve(math.radians(120.0))
    shapes = solution.modes.shapes[:, :10]
    np.testing.assert_allclose(shapes.T @ model.system.mass @ shapes, np.eye(10), atol=1e-9)
    b = model.compatibility(solution.configuration)
    assert np.abs(b @ shapes[: b.shape[1]]).max() < 1e-12 * np.abs(shapes).max() * 100
    energy = shapes.T @ model.system.stiffness @ shapes
    assert np.diag(energy) == pytest.approx(solution.modes.omega[:10] ** 2, rel=1e-7)


def test_same_frequencies_as_the_plain_eigenproblem(model: LinkageModel) -> None:
    """The inverted problem has the eigenvalues of the plain one, to the plain one's precision."""
    solution = model.solve(math.radians(150.0))
    system = couple(model.system, model.compatibility(solution.configuration))
    plain = np.sqrt(eigh(system.stiffness, system.mass, eigvals_only=True))
    np.testing.assert_allclose(solution.modes.omega[:20], plain[:20], rtol=1e-6)


def test_mechanism_mode_is_at_zero() -> None:
    """A free-free pair of masses on a spring has one mode at 0 Hz and one at sqrt(2 k / m)."""
    k = 50.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    omega = solve_modes(CoupledSystem(np.eye(2), k, np.eye(2))).omega
    assert omega[0] < 1e-6
    assert omega[1] == pytest.approx(10.0, rel=1e-12)


@given(st.permutations(range(4)), st.lists(st.sampled_from([-1.0, 1.0]), min_size=4, max_size=4))
def test_tracking_undoes_order_and_sign(order: list[int], signs: list[float]) -> None:
    """Modes found in another order and with other signs are put back as they were."""
    rng = np.random.default_rng(5)
    mass = np.diag(rng.uniform(1.0, 5.0, 6))
    shapes = eigh(np.diag(rng.uniform(1.0, 9.0, 6)) + 0.3, mass)[1][:, :4]
    shuffled = Modes(np.arange(4.0)[order], shapes[:, order] * signs)
    tracked = track(shapes[:, :2], shuffled, mass)
    np.testing.assert_array_equal(tracked.omega, [0.0, 1.0])
    np.testing.assert_allclose(tracked.shapes, shapes[:, :2], atol=1e-12)
    np.testing.assert_allclose(mac(shapes, shapes, mass), np.eye(4), atol=1e-12)
