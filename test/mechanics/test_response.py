# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""FRFs and peaks against one oscillator's closed form, dense grids and direct solutions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import oscillators


@given(frequency=st.floats(1.0, 150.0), ratio=st.floats(1e-4, 0.6), mass=st.floats(1e-2, 1e4))
def test_peak_of_one_oscillator(frequency: float, ratio: float, mass: float) -> None:
    """Peak at w sqrt(1 - 2 zeta^2), of 1 / (2 m w^2 zeta sqrt(1 - zeta^2))."""
    omega = 2 * math.pi * frequency
    peak = oscillators([omega], [ratio], [1 / mass]).peak((0.0, 200.0))
    assert peak.frequency == pytest.approx(frequency * math.sqrt(1 - 2 * ratio**2), rel=1e-6)
    expected = 1 / (2 * mass * omega**2 * ratio * math.sqrt(1 - ratio**2))
    assert peak.magnitude == pytest.approx(expected, rel=1e-12)


def test_peak_at_the_edges_of_a_band() -> None:
    """Below resonance the band's end is the peak, above it the beginning; 0 Hz counts."""
    one = oscillators([2 * math.pi * 50.0], [0.01], [1.0])
    assert one.peak((0.0, 30.0)).frequency == pytest.approx(30.0)
    assert one.peak((80.0, 200.0)).frequency == pytest.approx(80.0)
    stiff = oscillators([2 * math.pi * 50.0], [0.9], [1.0])
    assert stiff.peak((0.0, 200.0)).frequency == 0.0


def test_peak_between_grid_lines(model: LinkageModel) -> None:
    """No dense grid finds a larger value than the peak, and a dense one comes close to it."""
    for alpha3 in np.radians([90.0, 125.0, 180.0]):
        solution = model.solve(float(alpha3))
        dense = np.abs(solution.drive_point.frf(np.linspace(0.0, 200.0, 40_001))).max()
        assert dense <= solution.peak((0.0, 200.0)).magnitude * (1 + 1e-12)
        assert dense == pytest.approx(solution.peak((0.0, 200.0)).magnitude, rel=2e-3)


@pytest.mark.parametrize("frequency", [0.0, 4.0, 30.0, 97.0, 200.0])
def test_pole_residue_sum_equals_direct_solution(model: LinkageModel, frequency: float) -> None:
    """Between any points, the sum over all modes is rows (K - w^2 M + i w C)^-1 rows^T."""
    solution = model.solve(math.radians(140.0))
    coupled = solution.coupled
    omega = 2 * math.pi * frequency
    z = coupled.stiffness - omega**2 * coupled.mass + 1j * omega * coupled.damping
    places = [("E1", "z"), ("E2", "x"), ("V1", "z")]
    rows = coupled.restrict(model.rows(places, solution.configuration))
    direct = rows @ np.linalg.solve(z, rows.T)
    found = solution.frf(places, places).frf(np.array([frequency]))[0]
    np.testing.assert_allclose(found, direct, rtol=1e-8)
    np.testing.assert_allclose(found, found.T, rtol=1e-12)
