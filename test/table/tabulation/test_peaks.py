# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The highest peak along the stroke: where it jumps, and where maxima come and go."""

from dataclasses import replace

import numpy as np
import pytest

from linkage_vibration.mechanics.description import Mechanism, rayleigh_damping
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.tabulation import build_table
from test.support.crossing import STROKE, crossing_crank


def test_jump_from_one_mode_to_the_other() -> None:
    """Right up to the angle of the jump, on both sides, the higher of two maxima is found."""
    model = LinkageModel(crossing_crank(1.0, 0.8))
    table = build_table(model)
    angles = np.linspace(*STROKE, 300)
    maxima = [model.solve(float(a)).drive_point.local_peaks(np.arange(2)) for a in angles]
    at, size = np.swapaxes(np.array(maxima), 0, 1)
    high = size.argmax(axis=1)
    assert set(high) == {0, 1}
    # At the very jump either is right to the peak's own error.
    clear = np.abs(size[:, 0] / size[:, 1] - 1.0) > 2.0 * table.peak_error
    assert clear.mean() > 0.99
    rows = np.arange(len(angles))
    values = table.evaluate(angles)
    np.testing.assert_allclose(values[clear, -2], at[rows, high][clear], rtol=1e-4)
    np.testing.assert_allclose(values[:, -1], size.max(axis=1), rtol=1e-4)


@pytest.mark.nightly(short="test_jump_from_one_mode_to_the_other")
@pytest.mark.parametrize("tolerance", [2e-4, 1e-6])
def test_maxima_that_come_and_go(tolerance: float) -> None:
    """Over a full turn, where maxima merge and vanish, the peak is as good as was asked for."""
    model = LinkageModel(read_mechanism(config_file("four_bar.yaml")))
    table = build_table(model, tolerance)
    angles = np.random.default_rng(1).uniform(*table.alpha3_range, 200)
    angles = np.concatenate([angles, np.radians([19.5, 26.5])])
    band = model.mechanism.response.band
    exact = [model.solve(float(angle)).peak(band) for angle in angles]
    magnitude = table.evaluate(angles)[:, -1] / [peak.magnitude for peak in exact] - 1.0
    assert table.peak_error <= 100.0 * tolerance
    assert np.abs(magnitude).max() <= 100.0 * tolerance


@pytest.mark.nightly(alone="test/table/test_on_tractor.py shows it of the shipped table")
def test_peak_in_a_part_of_the_band() -> None:
    """It is the highest of dense lines there, also at an end, and FRFs hold in the whole band."""
    mechanism = read_mechanism(config_file("four_bar.yaml"))
    response = replace(mechanism.response, peak_part=(100.0, 300.0))
    model = LinkageModel(replace(mechanism, response=response))
    table, lines = build_table(model, 1e-4), np.linspace(100.0, 300.0, 20001)
    frequencies = []
    for angle in np.linspace(*table.alpha3_range, 25)[1:-1].tolist():
        solution = model.solve(angle)
        place = [(response.point, response.direction)]
        sizes = np.abs(solution.frf(place, place).frf(lines))[:, 0, 0]
        _, frequency, magnitude, _ = table.interpolate(angle)
        assert magnitude == pytest.approx(sizes.max(), rel=1e-2)
        assert sizes[np.abs(lines - frequency) < 0.02].max() >= 0.98 * sizes.max()
        frequencies.append(frequency)
        outside = np.array([50.0, 405.0, 667.0, 950.0])
        exact = solution.frf(place, place).frf(outside)
        np.testing.assert_allclose(table.frf(angle, place, place).frf(outside), exact, rtol=0.01)
    assert max(frequencies) == pytest.approx(300.0)
    assert min(frequencies) < 230.0


def test_sharp_peaks_are_not_missed(mechanism: Mechanism) -> None:
    """With 0.02 % of damping, where 0.1 Hz lines miss most of it, the table has the peak."""
    light = replace(mechanism, damping=rayleigh_damping(2e-4, 4.0, 180.0))
    model = LinkageModel(light)
    table = build_table(model, 1e-4)
    lines, seen = np.arange(0.0, 200.05, 0.1), []
    for angle in np.linspace(*mechanism.stroke, 12)[1:-1]:
        solution = model.solve(float(angle))
        exact = solution.peak(mechanism.response.band)
        seen.append(np.abs(solution.drive_point.frf(lines)).max() / exact.magnitude)
        assert table.interpolate(float(angle))[2] == pytest.approx(exact.magnitude, rel=1e-2)
    assert max(seen) < 0.9
    assert min(seen) < 0.2
