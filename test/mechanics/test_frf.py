# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""An FRF knows its places, its units and its error, and becomes a dataset; so does a solution."""

import math

import numpy as np
import pytest

import linkage_vibration as lv
from linkage_vibration.mechanics.response import ResponseError, oscillators
from linkage_vibration.support.resources import config_file
from test.support.measured_links import FloatArray

ALPHA3 = 2.3
LINES = np.linspace(0.5, 60.0, 120)
OUTPUTS, INPUTS = ["E1.z", "lower_link:E1.force_x"], ["E1.z", "V1.x"]


@pytest.fixture(scope="module")
def solution() -> lv.Solution:
    """Return the shipped hitch at an angle."""
    return lv.LinkageModel(lv.read_mechanism()).solve(ALPHA3)


def size(values: FloatArray) -> FloatArray:
    """Return norms of FRFs of each output, (n_out,), over frequency."""
    return np.asarray(np.linalg.norm(values, axis=(0, 2)))


def test_an_frf_has_places_units_and_values(solution: lv.Solution) -> None:
    """Values are those of the sum of modes, per newton or per metre of the soil."""
    terms = solution.frf(OUTPUTS, INPUTS)
    frf = terms.at(LINES.tolist())
    np.testing.assert_array_equal(frf.values, terms.frf(LINES))
    np.testing.assert_array_equal(frf.frequencies, LINES)
    assert frf.outputs == (("E1", "z"), ("lower_link:E1", "force_x"))
    assert frf.inputs == (("E1", "z"), ("V1", "x"))
    assert frf.units == [["m/N", "m/N"], ["N/N", "N/N"]]
    assert repr(frf) == "Frf(E1.z, lower_link:E1.force_x per E1.z, V1.x at 120 frequencies)"
    soil = lv.transmissibility(solution, OUTPUTS, "base:rear_axle.z").at([0.0, 5.0])
    assert (soil.units, soil.inputs) == ([["m/m"], ["N/m"]], (("base:rear_axle", "z"),))
    section = solution.frf(["lower_link:V1.moment"], ["E1.z"]).at([1.0])
    assert section.units == [["N m/N"]]
    with pytest.raises(ResponseError, match=r"do not know their places; use `frf`, or"):
        oscillators([1.0], [0.1], [1.0]).at([1.0])


def test_the_error_of_an_frf(solution: lv.Solution) -> None:
    """A table differs from its model by at most the error, and a sum of few modes is not judged."""
    table, exact = lv.load_table(), solution.frf(OUTPUTS, INPUTS).at(LINES)
    assert not exact.error.any()
    coupled = solution.model.coupled_frf(ALPHA3, LINES, INPUTS, INPUTS)
    assert not coupled.error.any()
    assert coupled.inputs == coupled.outputs == exact.inputs
    frf = table.frf(ALPHA3, OUTPUTS, INPUTS).at(LINES)
    assert frf.error.tolist() == [table.frf_error, table.force_error]
    apart = size(frf.values - exact.values) / size(exact.values)
    assert 0.0 < apart[0] < table.frf_error
    assert 0.0 < apart[1] < table.force_error
    few = solution.frf(OUTPUTS, INPUTS, band=(0.5, 60.0)).at(LINES)
    assert np.isnan(few.error).all()
    drive = solution.drive_point.at(LINES)
    assert drive.outputs == drive.inputs == (("E1", "z"),)


def test_datasets(solution: lv.Solution) -> None:
    """FRFs are found by their places, and modes and their shapes by numbers, places and angles."""
    pytest.importorskip("xarray", reason="xarray is not installed")
    frf = solution.frf(OUTPUTS, INPUTS).at(LINES)
    data = frf.to_xarray()
    cell = data.sel(output="lower_link:E1.force_x", input="V1.x")
    np.testing.assert_array_equal(cell, frf.values[:, 1, 1])
    assert (cell.unit, data.frequency.units) == ("N/N", "Hz")
    shapes = solution.to_xarray()
    np.testing.assert_array_equal(shapes.natural_frequencies, solution.natural_frequencies)
    assert shapes.natural_frequencies.units == "Hz"
    expected = solution.mode_shapes(["E2.x"])[0]
    np.testing.assert_allclose(shapes.shapes.sel(place="E2.x"), expected, rtol=1e-9, atol=1e-15)
    assert "P1.x" in shapes.place  # as the base moves
    several = solution.model.stack(np.array([2.0, ALPHA3])).to_xarray()
    assert several.alpha3.values.tolist() == [2.0, ALPHA3]
    found = several.damping_ratios.sel(alpha3=ALPHA3)
    np.testing.assert_allclose(found, solution.damping_ratios, rtol=1e-9)
    fixed = lv.LinkageModel(lv.read_mechanism(config_file("three_point_linkage.yaml")))
    assert "P1.x" not in fixed.solve(ALPHA3).to_xarray().place


def test_a_shape_that_does_not_exist(solution: lv.Solution) -> None:
    """The first and the last mode have a shape; others, fractions and stacks are errors."""
    count = len(solution.modes.omega)
    assert [solution.shape(mode).mode for mode in (0, count - 1)] == [0, count - 1]
    for mode in (-1, count):
        with pytest.raises(lv.LinkageVibrationError, match=rf"mode {mode}; .*0 to {count - 1}\."):
            solution.shape(mode)
    with pytest.raises(lv.LinkageVibrationError, match=r"float is given in place of int"):
        solution.shape(math.pi)
    with pytest.raises(lv.LinkageVibrationError, match=r"take one of its `rows`"):
        solution.model.stack(np.array([2.0, 2.1])).shape(0)
