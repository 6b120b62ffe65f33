# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Amplitudes of excitations from measured orders hold within their intervals."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml

from linkage_vibration.listening.amplitudes import (
    MeasuredOrder,
    _amplitude,
    amplitude_numbers,
    measure_orders,
    unit_responses,
)
from linkage_vibration.listening.orders import Orders
from linkage_vibration.listening.sensor_response import SensorResponse
from linkage_vibration.listening.signals import SignalError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.excitation import Excitation, excitations_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.studies.yaml_editing import edit_text
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from test.listening.test_signals import sensor
from test.prediction.test_level_deviations import drawn_models

TEXT = """\
rotor:                 # a comment
  speed: pto
  orders: [1, 2]
  force: [50.0, 20.0]
  at: E1.x
  at_speed: 500.0
  exponent: 2
  amplitude_stddev: 0.5
"""
TRUE = 80.0, 40.0  # N
NOISE = 1e-6  # (m/s2)^2
ANGLES = np.radians([105.0, 120.0, 135.0, 150.0, 165.0])
SPEEDS = np.array([480.0, 500.0, 520.0])  # rpm


def excitations() -> tuple[Excitation, ...]:
    """Return two orders, of forces on the implement."""
    return excitations_from_mapping(yaml.safe_load(TEXT))


@cache
def predicted() -> SensorResponse:
    """Return what the shipped table predicts at E1."""
    mechanism = read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    return SensorResponse(load_table(), mechanism, excitations(), sensor())


def orders(amplitudes: FloatArray, random: np.random.Generator) -> Orders:
    """Return what is tracked of amplitudes along x and z, (m, 2, 2), in noise."""
    shape = amplitudes.shape
    noise = random.normal(0.0, math.sqrt(NOISE / 4.0), (*shape, 2)) @ np.array([1.0, 1j])
    squares = (np.abs(amplitudes + noise) ** 2).sum(axis=1)
    speeds = np.tile(np.tile(SPEEDS, len(ANGLES))[:, np.newaxis], (1, 2))
    hertz = speeds / 60.0 * [1.0, 2.0]
    return Orders(np.arange(len(speeds)) * 4.0, speeds, hertz, squares, 0.0 * squares + NOISE)


def measured(actual: Orders) -> list[MeasuredOrder]:
    """Return both orders, measured and predicted."""
    units = unit_responses(predicted(), actual, np.repeat(ANGLES, len(SPEEDS)))
    return measure_orders(excitations(), actual, units, predicted())


def test_the_transfer_is_that_of_the_model() -> None:
    """The response to 1 N along x is that of the whole model, within 1 %; members surround it."""
    table_mechanism = read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    omega = 2.0 * math.pi * np.array([8.0, 16.0])
    frf = LinkageModel(table_mechanism).solve(2.3).frf([("E1", "x"), ("E1", "z")], [("E1", "x")])
    expected = np.sqrt((np.abs(frf.frf(omega / 2.0 / math.pi)[:, :, 0]) ** 2).sum(axis=1))
    gains = predicted().gains(2.3, omega)
    np.testing.assert_allclose(gains[0], expected * omega**2, rtol=0.01)
    assert (gains[1:].min(axis=0) < gains[0]).all()
    assert (gains[1:].max(axis=0) > gains[0]).all()
    assert np.isnan(predicted().gains(2.3, np.array([math.nan, 50.0]))[:, 0]).all()


@pytest.mark.parametrize(
    ("drives", "least"), [(12, 20 / 24), pytest.param(60, 0.9, marks=pytest.mark.nightly)]
)
def test_intervals_of_amplitudes_hold(drives: int, least: float) -> None:
    """Of drives of machines with other numbers, 90 to 99 % lie within the intervals of 95 %.

    Of 24 amplitudes, less than 20 do so with a probability of 1 %.
    """
    random, scores = np.random.default_rng(7), []
    for _, model in zip(range(drives), drawn_models(), strict=False):
        rows = []
        for angle in ANGLES.tolist():
            frf = model.solve(angle).frf([("E1", "x"), ("E1", "z")], [("E1", "x")])
            for speed in SPEEDS.tolist():
                hertz = speed / 60.0 * np.array([1.0, 2.0])
                receptance = frf.frf(hertz)[:, :, 0].T * (2.0 * math.pi * hertz) ** 2
                rows.append(receptance * np.array(TRUE) * (speed / 500.0) ** 2)
        for row, true in zip(measured(orders(np.array(rows), random)), TRUE, strict=True):
            assert row.is_detected
            scores.append(math.log(row.amplitude / true) / row.relative_stddev)
    share = float((np.abs(scores) < 1.96).mean())
    assert least <= share
    assert drives == 12 or share <= 0.99


def heard(amplitude: float) -> list[MeasuredOrder]:
    """Return the orders of a signal with the same amplitude of both along x in each window."""
    amplitudes = np.zeros((len(ANGLES) * len(SPEEDS), 2, 2))
    amplitudes[:, 0] = amplitude
    return measured(orders(amplitudes, np.random.default_rng(1)))


@pytest.mark.parametrize(("above", "expected"), [(1.8, False), (5.0, True)])
def test_an_order_stands_out_of_the_noise(above: float, expected: bool) -> None:
    """1.8 times the noise, and that noise, are below 4 times the noise; 5 times are above."""
    assert [row.is_detected for row in heard(math.sqrt(above * NOISE))] == [expected, expected]


def test_an_order_that_is_not_heard_has_a_bound() -> None:
    """Where much more than the noise is predicted, silence is a difference, too."""
    for row in heard(0.0):
        assert math.isnan(row.amplitude)
        assert row.measured == pytest.approx(math.sqrt(NOISE / 2.0), rel=0.5)
        assert row.difference < -2.0


def test_the_file_of_excitations_keeps_what_was_not_heard() -> None:
    """Only amplitudes and deviations of orders that were heard change, and it can be read."""
    loud, _ = heard(0.1)
    _, silent = heard(0.0)
    numbers = amplitude_numbers([loud, silent], yaml.safe_load(TEXT))
    text = edit_text(TEXT, numbers, SignalError)
    first, two = excitations_from_mapping(yaml.safe_load(text))
    assert first.load is not None
    assert two.load is not None
    assert first.load.amplitude == pytest.approx(loud.amplitude, rel=1e-3)
    assert first.load.relative_stddev == pytest.approx(loud.relative_stddev, rel=0.1)
    assert (two.load.amplitude, two.load.relative_stddev) == (20.0, 0.5)
    assert "# a comment" in text
    assert amplitude_numbers([silent], yaml.safe_load(TEXT)) == []


@pytest.mark.parametrize(("at", "accelerates"), [("P9", True), ("E1", False)])
def test_a_place_without_a_response(at: str, accelerates: bool) -> None:
    """The error names the places of the table."""
    mechanism = read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    with pytest.raises(SignalError, match=r"no response at .*; name one of .*(E1|lift_cylinders)"):
        SensorResponse(
            load_table(), mechanism, excitations(), sensor(at=at, accelerates=accelerates)
        )


def test_a_force_is_not_integrated() -> None:
    """The force of the lift cylinders per newton at the implement is that of the table at rest."""
    mechanism = read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    force = sensor(at="lift_cylinders.force", accelerates=False, axes=np.eye(1))
    gains = SensorResponse(load_table(), mechanism, excitations(), force).gains(
        2.3, np.full(2, 1e-3)
    )
    output = ("lift_cylinders", "force")
    static = load_table().frf(2.3, [output], [("E1", "x")]).frf(np.array([0.0]))
    assert gains[0] == pytest.approx(abs(static[0, 0, 0]), rel=1e-3)


def test_amplitude_of_an_order_in_a_few_windows() -> None:
    """Where noise exceeds most squares, the amplitude is still the root of their mean.

    The deviation of a mean of 0.34 is the root of 1.452 / 25, and half of its share counts.
    """
    squares = np.array([-0.1, -0.1, -0.1, 1.0, 1.0])
    amplitude, relative = _amplitude(squares, np.full(5, 0.1), np.ones((5, 1)))
    assert amplitude == pytest.approx(math.sqrt(1.7 / 5.0))
    assert relative == pytest.approx(math.sqrt(1.452 / 25.0) / 0.34 / 2.0)


def test_the_deviation_of_a_measured_rms() -> None:
    """Of m lines that are far above noise of a variance s, the mean rms deviates by sqrt(s/m)/2."""
    amplitudes = np.full((15, 1, 2), 100.0 * math.sqrt(NOISE))
    actual = orders(amplitudes, np.random.default_rng(2))
    plain = tuple(replace(each, load=None) for each in excitations())
    for row in measure_orders(plain, actual, np.empty((15, 1, 0)), predicted()):
        assert row.measured == pytest.approx(100.0 * math.sqrt(NOISE / 2.0), rel=0.01)
        assert row.measured_stddev == pytest.approx(math.sqrt(NOISE / 15.0) / 2.0, rel=0.01)
