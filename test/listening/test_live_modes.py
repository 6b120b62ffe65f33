# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes that are identified while a simulated drive goes on, in parts that hold up no reading."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmark.listening.simulation import HEAVE, RATE, Drive, Scene, simulate
from linkage_vibration.listening import live_modes, output_only
from linkage_vibration.listening.drive_modes import DriveMode
from linkage_vibration.listening.live import SensorMonitor
from linkage_vibration.listening.live_modes import NOTED, LiveModes
from linkage_vibration.listening.output_only import PausableTask
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.topics import MEASURED
from linkage_vibration.prediction.excitation import Source, excitations_from_mapping
from linkage_vibration.prediction.predictor import Predictor
from test.listening.test_signals import sensor
from test.support.first_order import first_order
from test.support.in_plane import plane_mechanism, plane_table

NS = 10**9
START = 1_700_000_010 * NS  # ns; a multiple of 30 s
MODE = DriveMode(2.5, HEAVE, 8.0, 0.03, 0.0, 7.36, 0.01, 0.02, 0.002, (30.0,))


def messages(drive: Drive) -> list[MessageColumns]:
    """Return the messages of a sensor on the implement about a drive."""
    shafts = {"pto": {"speed": "pto", "orders": [1, 0.45]}}
    parts = [replace(sensor(), at="E2")], Predictor(plane_table()), plane_mechanism()
    listening = SensorMonitor(*parts, excitations_from_mapping(shafts), {}, 1.0)
    actual = []
    for k in range(len(drive.times)):
        stamp = START + round(k * NS / RATE)
        if k % 10 == 0:
            listening.set_angle(float(drive.crank_angle[k]), stamp)
            for name, speed in drive.speeds.items():
                listening.set_speed(Source(name), float(speed[k]), stamp)
        sample = float(drive.signals[k, 0]), 0.0, float(drive.signals[k, 1])
        actual.append(listening.take(0, stamp, sample))
    return [message for message in actual if message is not None]


@pytest.mark.nightly(short="test_modes_need_a_minute_at_one_height")
def test_heave_of_a_heavier_implement(monkeypatch: pytest.MonkeyPatch) -> None:
    """The heave of a drive is within three deviations of the truth, and below the prediction.

    It is known after the first half minute that follows 60 s at one height. It moves at 95 s.
    Each sample waits for one decomposition at most, which takes two milliseconds.
    """
    counts, real, step = [0], output_only.poles_and_shapes, LiveModes.step

    def count(*given: FloatArray) -> object:
        counts[-1] += 1
        return real(*given)

    def next_sample(modes: LiveModes, stamp: int) -> None:
        counts.append(0)
        step(modes, stamp)

    monkeypatch.setattr(output_only, "poles_and_shapes", count)
    monkeypatch.setattr(LiveModes, "step", next_sample)
    drive = simulate(3, Scene(road=256e-6, seconds=190.0))  # it moves in the middle
    actual = messages(drive)
    assert max(counts) == 1
    assert sum(counts) > 20
    known = [int(message.modes_age) for message in actual if message.modes_age >= 0.0]
    assert known == [*range(1, 30), *range(1, 10)]  # after 90 s, not after 120 s, and after 180 s
    message = next(each for each in actual if each.modes_age >= 0.0)
    frequency, stddev = (message.mode_frequencies[HEAVE], message.mode_stddevs[HEAVE])
    true = drive.frequencies[2000:16000, HEAVE].mean()
    assert abs(frequency - true) < 3.0 * stddev < 0.1 * true
    assert frequency < message.mode_predictions[HEAVE]
    assert message.mode_differences[HEAVE] < 0.0
    others = np.delete(message.mode_frequencies, HEAVE)
    assert np.isnan(others).all()
    assert len(encode_message(MEASURED, message, 0, 0, "")) > 100


@pytest.mark.parametrize(("still", "sought"), [(59, False), (60, True)])
def test_modes_need_a_minute_at_one_height(
    still: int, sought: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At a height 5 deg away, the crank was before; 60 s at the present one are enough."""
    given: list[FloatArray] = []

    def search(*arguments: Any, damped: bool) -> PausableTask[tuple[DriveMode, ...]]:
        times, angles = arguments[3]
        given.append(times[np.isfinite(angles)])
        yield
        return (MODE,)

    monkeypatch.setattr(live_modes, "search_signals", search)
    modes = LiveModes([sensor()], ())
    modes.use(plane_table(), plane_mechanism(), 50.0)
    times, random = np.arange(0.0, 4.0, 0.01), np.random.default_rng(1)
    for second in range(1, 91):
        angle = 2.5 if second > 90 - still else 2.5 + math.radians(5.0)
        noted = np.full(len(NOTED), angle)
        readings = np.array([0.0, 0.0, 9.81]) + random.normal(0.0, 0.1, (len(times), 3))
        modes.add(START + second * NS, noted, {}, 0, times, readings)
        for part in range(10):
            modes.step(START + second * NS + part * NS // 10)
    assert bool(given) == sought
    message = MessageColumns()
    modes.fill(message, START + 91 * NS)
    assert (message.modes_age == 1.0) == sought
    if sought:
        assert given[0][0] == pytest.approx(-61.0)  # s before the search, with a margin of 1 s
        assert given[0][-1] == pytest.approx(-1.1)
        assert message.mode_frequencies[HEAVE] == 7.36


def test_sentence() -> None:
    """Beyond two standard deviations, the mode and what changes it most are named."""
    mechanism = plane_mechanism()
    modes = LiveModes([], ())
    modes.use(plane_table(), mechanism, 50.0)
    assert modes.sentence() == ""
    rates = first_order(LinkageModel(mechanism), [2.5], HEAVE + 1)[0, :, HEAVE]
    assert mechanism.uncertainty is not None
    numbers = mechanism.uncertainty.numbers
    first, second = (numbers[i].path for i in np.argsort(-np.abs(rates))[:2])
    modes._modes = (replace(MODE, predicted_stddev=0.0425),)  # 1.96 deviations
    assert modes.sentence() == ""
    modes._modes = (MODE, replace(MODE, mode=2, frequency=9.9, doubt="an order"))
    assert modes.compared == 1
    assert modes.sentence() == (
        "The implement heave at 143.2 deg is 8.0 % lower than predicted, 7.360 +- 0.010 Hz: "
        f"not consistent, 2.8 standard deviations. Is it {first} or {second}?"
    )
