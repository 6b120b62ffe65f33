# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""FRFs and peaks against one oscillator's closed form, dense grids and direct solutions."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.mechanics.description import (
    Damping,
    LossFactor,
    Mechanism,
    ModalRatio,
    Rayleigh,
)
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import (
    FarPoles,
    PoleResidue,
    ResponseError,
    far_poles,
    in_reach,
    oscillators,
)


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
    first = oscillators([2 * math.pi * 50.0], [0.01], [1.0])
    assert first.peak((0.0, 30.0)).frequency == pytest.approx(30.0)
    assert first.peak((80.0, 200.0)).frequency == pytest.approx(80.0)
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
    receptances = solution.frf(places, places).frf(np.array([frequency]))[0]
    np.testing.assert_allclose(receptances, direct, rtol=1e-8)
    np.testing.assert_allclose(receptances, receptances.T, rtol=1e-12)


def test_undamped_pole_is_infinite_and_reported() -> None:
    """On an undamped pole the receptance is infinite, without a warning, and so is the peak."""
    first = oscillators([2 * math.pi * 50.0], [0.0], [1.0])
    at_pole, beside = first.frf(np.array([50.0, 49.0]))[:, 0, 0]
    assert at_pole == math.inf
    assert beside == pytest.approx(1 / ((100 * math.pi) ** 2 - (98 * math.pi) ** 2))
    assert first.peak((0.0, 100.0)).magnitude == math.inf
    assert first.peak((0.0, 100.0)).frequency == pytest.approx(50.0)


def test_local_peaks_are_maxima_of_a_dense_grid() -> None:
    """Of well separated, of overlapping and of hidden resonances each maximum is found."""
    frf = oscillators(2 * math.pi * np.array([10.0, 40.0, 44.0, 90.0]), [0.02] * 4, [1, 2, 1, 1e-3])
    actual, sizes = frf.local_peaks(np.arange(4))
    lines = np.linspace(0.0, 120.0, 1_200_001)
    dense = np.abs(frf.frf(lines)[:, 0, 0])
    top = np.flatnonzero((dense[1:-1] > dense[:-2]) & (dense[1:-1] > dense[2:])) + 1
    assert len(top) == 3  # the weak mode at 90 Hz makes none
    np.testing.assert_allclose(actual[:3], lines[top], atol=1e-4)
    np.testing.assert_allclose(sizes[:3], dense[top], rtol=1e-8)
    assert np.isnan([actual[3], sizes[3]]).all()


@pytest.mark.parametrize(("n_far", "bound"), [(2, 1e-2), (4, 1e-4), (6, 1e-6)])
def test_far_poles_stand_for_the_modes_above_a_band(
    model: LinkageModel, n_far: int, bound: float
) -> None:
    """Each pole divides the error of every single FRF by ten; four leave less than 1e-4.

    Leaving the modes above the band out altogether is wrong by 100 % between some points.
    """
    band = (0.0, 200.0)
    lines = np.linspace(*band, 1001)
    places = [(point, direction) for point in ("E1", "E2", "V1", "V2") for direction in "xz"]
    worst = {"far poles": 0.0, "left out": 0.0}
    for angle in np.radians([90.0, 140.0, 180.0]):
        full = model.solve(float(angle)).frf(places, places)
        kept = in_reach(full.stiffness, band)
        assert kept.sum() == 4
        far = far_poles(full.stiffness[~kept], full.decay[~kept], band, n_far)
        terms = full.residues[:, :, kept], full.rates[:, :, kept]
        nothing = PoleResidue(full.stiffness[kept], full.decay[kept], *terms, full.residual)
        exact = full.frf(lines)
        for name, sums in (("far poles", full.condensed(kept, far)), ("left out", nothing)):
            apart = np.linalg.norm(sums.frf(lines) - exact, axis=0)
            worst[name] = max(worst[name], (apart / np.linalg.norm(exact, axis=0)).max())
    assert worst["left out"] > 0.99
    assert worst["far poles"] < bound
    none = far_poles(np.empty(0, complex), np.empty(0), band, n_far)  # as no mode is above it
    assert (len(none.stiffness), len(none.decay)) == (0, 0)


@pytest.mark.parametrize("rule", [LossFactor(0.03), ModalRatio(0.02)])
def test_far_poles_with_other_damping(mechanism: Mechanism, rule: Damping) -> None:
    """Structural damping and modes that it couples are followed as well."""
    links = tuple(
        replace(link, damping=rule) if link.name != "lift_rod" else link for link in mechanism.links
    )
    if isinstance(rule, LossFactor):
        links = tuple(replace(link, damping=rule) for link in mechanism.links)
    model = LinkageModel(replace(mechanism, links=links, damping=Rayleigh(0.0, 0.0)))
    places, band = [("E1", "z"), ("V1", "x")], (0.0, 200.0)
    solution, lines = model.solve(2.3), np.linspace(*band, 1001)
    exact = solution.frf(places, places).frf(lines)
    receptances = solution.frf(places, places, band).frf(lines)
    apart = np.linalg.norm(receptances - exact, axis=0) / np.linalg.norm(exact, axis=0)
    assert apart.max() < 1e-4


@pytest.mark.parametrize("frequencies", [5.0, [[1.0, 2.0]], None])
def test_frequencies_of_another_shape(model: LinkageModel, frequencies: Any) -> None:
    """A number, a table and nothing are refused with the shape."""
    with pytest.raises(ResponseError, match=r"an array of shape \(.*\); give a list of Hz"):
        model.solve(2.0).drive_point.frf(frequencies)


def test_frequencies_that_are_no_numbers(model: LinkageModel) -> None:
    """NaN and infinity are refused; no frequency and no place give an empty FRF."""
    solution = model.solve(2.0)
    for value in (math.nan, math.inf):
        with pytest.raises(ResponseError, match="not a finite number; give Hz"):
            solution.drive_point.frf(np.array([1.0, value]))
    assert solution.drive_point.frf(np.empty(0)).shape == (0, 1, 1)
    assert solution.frf([], ["E1.z"]).frf(np.array([1.0])).shape == (1, 0, 1)
    assert solution.frf(["E1.z"], []).frf(np.array([1.0])).shape == (1, 1, 0)


def test_sum_of_one_far_pole_and_its_slope() -> None:
    """By hand at s = 2i: 1 + (3 + 4 s) / (5 + s + s^2) and i times its derivative with s."""
    far, w, weights = FarPoles(np.array([5.0 + 0j]), np.array([1.0])), np.array([2.0]), [1, 3, 4]
    s, below = 2j, 1.0 + 2j
    value, slope = far.with_slopes(w, np.array([weights]))
    assert value[0] == pytest.approx(1.0 + (3.0 + 4.0 * s) / below)
    assert slope[0] == pytest.approx(
        1j * (4.0 * below - (3.0 + 4.0 * s) * (1.0 + 2.0 * s)) / below**2
    )
    assert far.sums(w, np.array(weights)[:, np.newaxis])[0, 0] == pytest.approx(value[0])
