# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The predictor: numbers inside the range, and a status for every other float."""

import math
import sys
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.predictor import (
    Prediction,
    Predictor,
    Status,
    fault,
    predict_many,
    uncertain_modes,
)
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from linkage_vibration.table.tabulation import build_table
from test.support.served import turning_table


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """Return a predictor on the shipped table."""
    return Predictor(load_table(config_file("tables/three_point_linkage.npz")))


@given(st.floats(math.pi / 2, math.pi))
def test_predictions_are_the_models(
    predictor: Predictor, model: LinkageModel, alpha3: float
) -> None:
    """In the stroke, frequencies agree with the model to 5e-7 and the peak to 1e-6."""
    prediction, exact = predictor.predict(alpha3), model.solve(alpha3)
    assert prediction.status is Status.OK
    np.testing.assert_allclose(
        prediction.natural_frequencies, exact.natural_frequencies[:3], rtol=5e-7
    )
    np.testing.assert_allclose(prediction.damping_ratios, exact.damping_ratios[:3], rtol=5e-6)
    assert prediction.frf_peak_frequency == pytest.approx(
        exact.peak((0.0, 200.0)).frequency, rel=1e-6
    )
    assert prediction.frf_peak_magnitude == pytest.approx(
        exact.peak((0.0, 200.0)).magnitude, rel=1e-6
    )
    assert 0.0 < prediction.interpolation_error < 1e-6


@given(st.floats())
def test_any_float_is_answered(predictor: Predictor, alpha3: float) -> None:
    """No float raises an error; numbers occur only with the status OK, and are finite."""
    prediction = predictor.predict(alpha3)
    numbers = [
        *prediction.natural_frequencies,
        *prediction.damping_ratios,
        *prediction.frequency_slopes,
        *prediction.frequency_stddevs,
        prediction.frf_peak_frequency,
        prediction.frf_peak_magnitude,
        prediction.interpolation_error,
    ]
    assert len(numbers) == 15
    good = prediction.status is Status.OK
    turns = (alpha3, alpha3 + 2.0 * math.pi, alpha3 - 2.0 * math.pi)  # a sensor may wrap
    assert good == any(math.pi / 2 <= angle <= math.pi for angle in turns)
    assert all(math.isfinite(number) == good for number in numbers)
    assert prediction.table_id == predictor.table.table_id


def test_numpy_numbers_are_answered_as_floats(predictor: Predictor) -> None:
    """An angle of another precision is predicted with the arithmetic of a float."""
    angle: Any = np.float32(2.3)
    answer, expected = predictor.predict(angle), predictor.predict(float(angle))
    assert type(answer.crank_angle) is float
    np.testing.assert_array_equal(answer.natural_frequencies, expected.natural_frequencies)


def test_the_ends_belong_to_the_range(predictor: Predictor) -> None:
    """The ends of the range are included, and the next floats are out of range."""
    low, high = predictor.table.alpha3_range
    assert predictor.predict(low).status is Status.OK
    assert predictor.predict(high).status is Status.OK
    assert predictor.predict(math.nextafter(low, 0.0)).status is Status.OUT_OF_RANGE
    assert predictor.predict(math.nextafter(high, 9.0)).status is Status.OUT_OF_RANGE
    assert predictor.predict(sys.float_info.max).status is Status.OUT_OF_RANGE
    for invalid in (math.nan, math.inf, -math.inf):
        assert predictor.predict(invalid).status is Status.INVALID_ANGLE


def test_predictions_do_not_share_numbers(predictor: Predictor) -> None:
    """A later prediction does not change an earlier one."""
    first = predictor.predict(2.0)
    before = first.natural_frequencies.copy()
    predictor.predict(3.0)
    np.testing.assert_array_equal(first.natural_frequencies, before)


@given(st.floats(1.58, 3.13))
def test_slopes_are_the_models(predictor: Predictor, model: LinkageModel, alpha3: float) -> None:
    """Slopes are the derivatives of the exact frequencies, to the table's own smoothness."""
    step = 1e-4
    before, after = (model.solve(alpha3 + s).natural_frequencies[:3] for s in (-step, step))
    slopes = predictor.predict(alpha3).frequency_slopes
    # An error of 5e-7 that waves once between the table's points, some degrees apart.
    room = 5e-7 * after / math.radians(1.0) * math.pi
    assert (np.abs((after - before) / (2.0 * step) - slopes) <= room + 1e-3 * np.abs(slopes)).all()


@pytest.mark.parametrize("degrees", [95.0, 110.0, 130.0, 150.0, 170.0])
def test_uncertainty_is_that_of_samples(predictor: Predictor, degrees: float) -> None:
    """The predicted standard deviation is that of the frequencies at scattered angles."""
    alpha3, stddev = math.radians(degrees), math.radians(0.2)
    angles = alpha3 + np.random.default_rng(6).normal(scale=stddev, size=40_000)
    sampled = predictor.table.evaluate(angles)[:, :3].std(axis=0)
    predicted = predictor.predict(alpha3, stddev).frequency_stddevs
    # What the first order leaves out, and the scatter of 40,000 samples.
    bend = np.abs(
        predictor.predict(alpha3 + stddev).frequency_slopes
        - predictor.predict(alpha3 - stddev).frequency_slopes
    ) / (2.0 * stddev)
    assert (
        np.abs(sampled - predicted) <= bend * stddev**2 / math.sqrt(2.0) + 0.02 * predicted
    ).all()
    assert (predicted > 0.0).all()


def test_uncertainty_at_an_extremum_is_of_second_order(predictor: Predictor) -> None:
    """At a maximum of a frequency the first order is zero, and the rest is small."""
    angles = np.linspace(1.6, 3.1, 3001)
    slopes = predictor.table.evaluate_slopes(angles)[:, :3]
    turning = np.argwhere(slopes[:-1] * slopes[1:] < 0.0)
    assert len(turning)
    row, mode = turning[0]
    alpha3, stddev = float(angles[row]), math.radians(0.2)
    scatter = alpha3 + np.random.default_rng(6).normal(scale=stddev, size=40_000)
    sampled = float(predictor.table.evaluate(scatter)[:, mode].std())
    bend = abs(slopes[row + 1, mode] - slopes[row, mode]) / (angles[1] - angles[0])
    assert predictor.predict(alpha3, stddev).frequency_stddevs[mode] < 0.5 * sampled
    assert sampled == pytest.approx(bend * stddev**2 / math.sqrt(2.0), rel=0.3)


def test_uncertainty_near_a_toggle() -> None:
    """Near a toggle the standard deviation is too small by 7/16 (stddev / d)^2."""
    mechanism = read_mechanism(config_file("three_point_linkage_as_printed.yaml"))
    toggles = LinkageModel(mechanism).kinematics.toggles
    assert toggles is not None
    toggle = toggles[1].alpha3
    stroke = (mechanism.stroke[0], toggle - math.radians(0.01))
    predictor = Predictor(build_table(LinkageModel(replace(mechanism, stroke=stroke)), 1e-5))
    distance = math.radians(0.4)
    for share in (0.02, 0.2):
        alpha3, stddev = toggle - distance, share * distance
        angles = alpha3 + np.random.default_rng(6).normal(scale=stddev, size=200_000)
        sampled = float(predictor.table.evaluate(angles[angles < stroke[1]])[:, 1].std())
        prediction = predictor.predict(alpha3, stddev)
        assert prediction.status is Status.NEAR_TOGGLE
        missing = sampled / prediction.frequency_stddevs[1] - 1.0
        scatter = 3.0 / math.sqrt(2.0 * angles.size)
        # What the root itself leaves to higher orders and to the smooth rest is a fifth of it.
        assert missing == pytest.approx(7.0 / 16.0 * share**2, rel=0.2, abs=scatter)


def test_slopes_at_many_angles(predictor: Predictor) -> None:
    """Predictions at many angles at once are the same to the last bit."""
    angles = np.random.default_rng(0).uniform(*predictor.table.alpha3_range, 500)
    alone = [predictor.predict(angle).frequency_slopes for angle in angles.tolist()]
    np.testing.assert_array_equal(predictor.table.evaluate_slopes(angles)[:, :3], alone)


def test_table_of_a_whole_turn_serves_every_turn() -> None:
    """A crank that turns all the way repeats after a turn, up to a limit."""
    turning = Predictor(turning_table())
    for turns in (-3, 1, 1000):
        here, there = turning.predict(1.0), turning.predict(1.0 + 2.0 * math.pi * turns)
        assert there.status is Status.OK
        np.testing.assert_allclose(there.natural_frequencies, here.natural_frequencies, rtol=1e-9)
    assert turning.predict(1e7).status is Status.OUT_OF_RANGE


def test_predictions_are_compared_by_identity(predictor: Predictor) -> None:
    """Arrays have no single answer to ==, so a prediction equals itself alone."""
    first, second = predictor.predict(2.0), predictor.predict(2.0)
    assert first == first
    assert first != second


def test_table_of_nearly_a_turn_does_not_turn(predictor: Predictor) -> None:
    """A crank turns all the way only if its table has a whole turn, up to 1e6 rad; else once."""
    table = predictor.table
    for turn, turns in ((2.0 * math.pi, True), (2.0 * math.pi * (1.0 - 1e-9), False)):
        alpha3 = 1.0 + turn * (table.alpha3 - table.alpha3[0]) / np.ptp(table.alpha3)
        around = Predictor(replace(table, alpha3=alpha3, toggles=None))
        assert around.angle_in_table(3.0 + 2.0 * math.pi) == pytest.approx(3.0)
        assert around.angle_in_table(0.5) == pytest.approx(0.5 + 2.0 * math.pi)
        actual = around.angle_in_table(3.0 + 4.0 * math.pi)
        assert actual == (pytest.approx(3.0) if turns else None)
        assert (around.angle_in_table(9.99e5) is None) != turns
        assert around.angle_in_table(1.01e6) is None


@pytest.mark.parametrize(
    ("frequency", "ratio", "uncertain"),
    [(0.0099, 0.199, False), (0.0101, 0.0, True), (0.0, 0.201, True)],
)
def test_modes_that_are_uncertain(frequency: float, ratio: float, uncertain: bool) -> None:
    """A mode is uncertain above 1 % of its frequency or 20 % of its damping ratio, once or more."""
    frequencies, ratios = np.array([[10.0, 20.0]] * 3), np.array([[0.02, 0.05]] * 3)
    stddevs = np.zeros((2, 3, 2))
    stddevs[0, 1, 1], stddevs[1, 2, 1] = 20.0 * frequency, 0.05 * ratio
    stddevs[:, 0, :] = math.nan  # it is not known there
    actual = uncertain_modes(frequencies, stddevs[0], ratios, stddevs[1])
    assert len(actual) == uncertain
    percent = f"{100.0 * frequency:.2g} % of its natural frequency and {100.0 * ratio:.2g} %"
    assert all("Mode 2 is uncertain" in text and percent in text for text in actual)


@pytest.mark.parametrize(
    ("degrees", "words"),
    [
        (400.0, "400 deg is not in the table's 90 to 180 deg"),
        (840.0, "but 120 deg is: is the joint's zero turns off?"),
        (-600.0, "but 120 deg is: is the joint's zero turns off?"),
        (2.3, "table's 90 to 180 deg; 2.3 rad is in range, so were radians given"),
        (math.degrees(150.0), "; 150 deg is in range, so were degrees given in place of rad?"),
        (math.nan, "is not a finite number"),
        (120.0, ""),
        (480.0, ""),
        (-240.0, ""),
    ],
)
def test_faults_of_angles(predictor: Predictor, degrees: float, words: str) -> None:
    """A fault names the angle and the range, and a turn that would bring it into the table."""
    actual = fault(predictor.predict(math.radians(degrees)), predictor.table.alpha3_range)
    assert words in actual
    assert bool(actual) == bool(words)
    assert ("turns off" in words) == ("turns off" in actual)
    far = predictor.predict(math.radians(120.0 + 360.0 * 2778))  # 1.00008e6 deg
    assert "turns off" not in fault(far, predictor.table.alpha3_range)
    near = predictor.predict(math.radians(120.0 + 360.0 * 2777))
    assert "turns off" in fault(near, predictor.table.alpha3_range)


def test_arrays_of_angles(predictor: Predictor) -> None:
    """An array gives a row for each angle, with the numbers that each angle gives alone."""
    angles, stddev = np.radians([95.0, 179.9, 200.0]), np.array([0.0, 0.01, 0.0])
    many = predictor.predict(angles, stddev)
    alone = [predictor.predict(a, s) for a, s in zip(angles, stddev, strict=True)]
    for field in ("status", "natural_frequencies", "frequency_stddevs", "frf_peak_magnitude"):
        rows = [getattr(each, field) for each in alone]
        np.testing.assert_array_equal(getattr(many, field), np.array(rows))
    row: Any
    for row in ([2.3], np.array([2.3], dtype=np.float32)):
        assert len(predictor.predict(row)) == 1
    for row in (2, np.float32(2.3), np.array(2.3)):
        assert isinstance(predictor.predict(row), Prediction)


@pytest.mark.parametrize(
    "value",
    [
        np.zeros((2, 1)),
        [[2.0], [2.0, 2.1]],
        "2.0",
        None,
        2.0 + 0.0j,
        True,
        np.ma.masked_array([2.0, 2.1], [False, True]),
    ],
)
def test_what_is_no_angle_is_refused(predictor: Predictor, value: Any) -> None:
    """The error names the argument, for the angle and for its standard deviation."""
    for name in ("alpha3", "stddev"):
        with pytest.raises(LinkageVibrationError, match=f"^`{name}` is .*; give a real number"):
            predictor.predict(**{"alpha3": 2.0, name: value})


def test_numbers_of_angles_and_deviations(predictor: Predictor) -> None:
    """There is one standard deviation for all angles, or one for each."""
    assert len(predictor.predict(np.array([]))) == 0
    assert len(predictor.predict(np.array([2.0, 2.1]), 0.1)) == 2
    assert len(predictor.predict(np.array([2.0, 2.1]), np.array([0.1, 0.2]))) == 2
    for angles in (np.array([2.0, 2.1, 2.2]), np.array([2.0]), np.array(2.0)):
        with pytest.raises(LinkageVibrationError, match="`stddev` has 2 numbers for"):
            predictor.predict(angles, np.array([0.1, 0.2]))


def test_dataset_of_predictions(predictor: Predictor) -> None:
    """It has a row for each angle, which is a coordinate, and the modes are counted from 1."""
    pytest.importorskip("xarray", reason="xarray is not installed")
    many = predictor.predict(np.array([1.7, 2.3]))
    data = many.to_xarray()
    np.testing.assert_array_equal(data.frequency_slopes.sel(mode=3), many.frequency_slopes[:, 2])
    np.testing.assert_array_equal(data.crank_angle, [1.7, 2.3])
    assert data.attrs == {"table_id": predictor.table.table_id, "unknown_deviations": ""}


def test_parts_of_a_deviation(predictor: Predictor) -> None:
    """A deviation is the root of the sum of the squares of its parts, of which two are known here.

    That by the angle is the slope times its deviation, that by the table its bound of the error.
    """
    alpha3, stddev = 2.3, 1e-3
    prediction, shares = predictor.predict(alpha3, stddev), predictor.shares(alpha3, stddev)
    step = 1e-5
    ends = [predictor.predict(alpha3 + s) for s in (-step, step)]
    for row, name in enumerate(("natural_frequencies", "damping_ratios")):
        low, high = (getattr(each, name) for each in ends)
        turned = np.abs(high - low) / (2.0 * step) * stddev
        np.testing.assert_allclose(shares.angle[row], turned, rtol=1e-4)
        missed = prediction.interpolation_error * getattr(prediction, name)
        np.testing.assert_allclose(shares.table[row], missed, rtol=1e-12)
        total = (prediction.frequency_stddevs, prediction.damping_ratio_stddevs)[row]
        np.testing.assert_allclose(total, np.hypot(turned, missed), rtol=1e-4)
    assert not shares.links.any()
    assert not shares.parameters.any()
    assert np.isnan(predictor.shares(0.0).total).all()


def test_many_predictions_are_single_ones(predictor: Predictor) -> None:
    """Predictions at many angles, in and out of the table, are those at each of them."""
    angles = np.array([2.0, 0.0, math.nan, *predictor.table.alpha3_range, 10.0, 2.5, math.inf])
    stddevs = np.linspace(0.0, 0.01, len(angles))
    many = predict_many(predictor, angles, stddevs)
    assert many.status.tolist() == [0, 1, 2, 0, 0, 1, 0, 2]
    for i, (angle, stddev) in enumerate(zip(angles.tolist(), stddevs.tolist(), strict=True)):
        prediction = predictor.predict(angle, stddev)
        for column in fields(prediction):
            expected = getattr(prediction, column.name)
            if column.name == "table_id":
                assert many.table_id == expected
            else:
                np.testing.assert_array_equal(getattr(many, column.name)[i], expected)
