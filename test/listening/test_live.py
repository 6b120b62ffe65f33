# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors beside predictions while a drive goes on: one message a second, known in closed form."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from linkage_vibration.listening.live import SensorMonitor, _at, difference_sentence
from linkage_vibration.listening.signals import SignalError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.topics import MEASURED
from linkage_vibration.prediction.answers import LoadedModel
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.periods import second
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.loaded_model import load_model
from linkage_vibration.support.resources import config_file
from test.listening.test_signals import sensor

NS, START = 10**9, 1_700_000_000 * 10**9 + 300_000_000  # ns, in the middle of a second
RATE, ANGLE, ENGINE = 200, 2.3, 1500.0  # Hz, rad, rpm: crankshaft 1 is at 25 Hz
EXCITATIONS = read_excitations(config_file("excitations.yaml"))
CRANKSHAFT = [each.name for each in EXCITATIONS].index("crankshaft 1")
AMPLITUDE = 0.2  # m/s2, along z


@cache
def served() -> LoadedModel:
    """Return the shipped linkage."""
    return load_model(Parameters())


def monitor(fixed: float | None = ENGINE, at: str = "E1") -> SensorMonitor:
    """Return the monitor of one sensor."""
    speeds = {} if fixed is None else {Source.ENGINE: fixed}
    first = replace(sensor(), at=at)
    return SensorMonitor([first], served().predictor, served().mechanism, EXCITATIONS, speeds, 1.0)


def samples(k: int) -> tuple[float, ...]:
    """Return sample number k: gravity, and 25 Hz along z."""
    return 0.0, 0.0, 9.81 + AMPLITUDE * math.cos(2.0 * math.pi * 25.0 * k / RATE)


def drive(
    listening: SensorMonitor,
    seconds: float,
    also: Callable[[SensorMonitor, int, int], None] = lambda *_: None,
    left_out: range = range(0),
    start: int = START,
) -> list[tuple[int, MessageColumns]]:
    """Feed samples and a crank angle that stays; return the stamps and messages."""
    actual = []
    for k in range(int(seconds * RATE)):
        stamp = start + k * NS // RATE
        if k % 10 == 0:
            listening.set_angle(ANGLE, stamp)
        also(listening, k, stamp)
        if k not in left_out:
            message = listening.take(0, stamp, samples(k))
            if message is not None:
                actual.append((second(stamp), message))
    return actual


def test_one_message_a_second_after_the_first_window() -> None:
    """A window of 4 s has to be full; then each second of the stamps has one message."""
    actual = drive(monitor(), 8.5)
    assert [stamp // NS - START // NS for stamp, _ in actual] == [5, 6, 7, 8]


@pytest.mark.parametrize(("before", "first"), [(60, 4), (40, 5)])
def test_samples_before_the_first_window(before: int, first: int) -> None:
    """Even samples of a window of 4 s need those of 50 ms before it, of a whole second here."""
    whole = START // NS * NS
    [(stamp, _), *_] = drive(monitor(), 5.5, start=whole - before * 10**6)
    assert (stamp - whole) // NS == first


def test_the_numbers_are_those_of_the_signal_and_of_the_whole_model() -> None:
    """Level, order and prediction are those of closed forms, and of the model without its table."""
    [*_, (_, message)] = drive(monitor(), 7.0)
    assert message.rate == pytest.approx(RATE)
    assert message.crank_angle == pytest.approx(ANGLE)
    rms = AMPLITUDE / math.sqrt(2.0)
    assert message.level == pytest.approx(rms / (2.0 * math.pi * 25.0), rel=0.02)
    assert message.order_levels[CRANKSHAFT] == pytest.approx(rms, rel=1e-3)
    # 340 N at 2200 rpm, with the square of the speed, at the front axle.
    force = 340.0 * (ENGINE / 2200.0) ** 2
    solution = LinkageModel(served().mechanism).solve(ANGLE)
    frf = solution.frf([("E1", "x"), ("E1", "z")], [("front_axle", "z")]).frf(np.array([25.0]))
    expected = np.linalg.norm(frf) * (2.0 * math.pi * 25.0) ** 2 * force / math.sqrt(2.0)
    assert message.predicted_levels[CRANKSHAFT] == pytest.approx(expected, rel=0.01)
    factor = message.predicted_factors[CRANKSHAFT]
    stddev = math.hypot(math.log(factor), message.order_stddevs[CRANKSHAFT] / rms)
    assert message.differences[CRANKSHAFT] == pytest.approx(
        math.log(rms / expected) / stddev, rel=0.02
    )
    assert np.isnan(message.order_levels[[each.source is Source.PTO for each in EXCITATIONS]]).all()


def test_what_differs_is_named() -> None:
    """An order that is 30 times as strong as predicted is named; one as predicted is not."""
    listening = monitor()
    [*_, (_, message)] = drive(listening, 7.0)
    predicted = message.predicted_levels[CRANKSHAFT]
    for ratio, named in ((30.0, True), (1.0, False)):
        message.order_levels[CRANKSHAFT] = ratio * predicted
        message.differences = np.full(len(EXCITATIONS), math.nan)
        message.differences[CRANKSHAFT] = math.log(ratio) / 0.5
        message.doubts = ""
        sentence = difference_sentence(message, EXCITATIONS)
        assert ("crankshaft 1 is 30 times as strong as predicted" in sentence) == named
        assert bool(sentence) == named


def test_without_speeds_nothing_is_compared() -> None:
    """The level is measured, orders are not known, and the message says why."""
    [*_, (_, message)] = drive(monitor(fixed=None), 7.0)
    assert message.level > 0.0
    assert np.isnan(message.order_levels).all()
    assert math.isnan(message.predicted_level)
    assert "No speed is known" in message.doubts


@pytest.mark.parametrize(("pause", "known"), [(0.9, True), (1.2, False)])
def test_a_speed_that_is_late_is_not_used(pause: float, known: bool) -> None:
    """A speed that is silent for less than 1 s is known; beyond, its orders are not."""
    silent = range(int(5.0 * RATE), int((5.0 + pause) * RATE))

    def speed(listening: SensorMonitor, k: int, stamp: int) -> None:
        if k % 10 == 0 and k not in silent:
            listening.set_speed(Source.ENGINE, ENGINE, stamp)

    *_, (_, message) = drive(monitor(fixed=None), 7.8, speed)
    assert np.isfinite(message.order_levels[CRANKSHAFT]) == known


def test_an_unknown_angle_leaves_the_measured_order() -> None:
    """Without a crank angle, an order is measured but not predicted."""
    listening = monitor()
    actual = [listening.take(0, START + k * NS // RATE, samples(k)) for k in range(6 * RATE)]
    message = next(each for each in actual if each is not None)
    assert math.isnan(message.crank_angle)
    assert message.order_levels[CRANKSHAFT] > 0.0
    assert np.isnan(message.predicted_levels).all()


@pytest.mark.parametrize("number", [1e13, 1e300, math.inf, math.nan])
def test_numbers_that_nothing_has_are_not_known(number: float) -> None:
    """Beyond 1e12, a speed and an angle are not known, and the message can still be encoded."""
    listening, actual = monitor(), list[MessageColumns | None]()
    for k in range(7 * RATE):
        stamp = START + k * NS // RATE
        listening.set_angle(number, stamp)
        listening.set_speed(Source.PTO, number, stamp)
        actual.append(listening.take(0, stamp, samples(k)))
    [*_, message] = [each for each in actual if each is not None]
    assert math.isnan(message.crank_angle)
    assert message.order_levels[CRANKSHAFT] > 0.0
    assert np.isnan(message.order_levels[[each.source is Source.PTO for each in EXCITATIONS]]).all()
    assert len(encode_message(MEASURED, message, 0, 0, "")) > 100


def test_a_gap_is_named_and_a_pause_has_one_message() -> None:
    """Windows with a gap say so; after a pause of 30 s, a whole window comes first."""
    actual = drive(monitor(), 12.0, left_out=range(6 * RATE, 6 * RATE + 100))
    assert [("gaps" in message.doubts) for _, message in actual] == [0, 0, 1, 1, 1, 1, 0, 0]
    cut = [math.isnan(message.level) for _, message in actual]
    assert cut == [0, 0, 1, 1, 1, 1, 0, 0]
    assert [("Readings are missing" in message.doubts) for _, message in actual] == cut
    actual = drive(monitor(), 50.0, left_out=range(6 * RATE, 36 * RATE))
    assert [stamp // NS - START // NS for stamp, _ in actual][:4] == [5, 6, 41, 42]


def test_a_clock_that_goes_back_begins_again() -> None:
    """After a bag begins anew, messages come again once a window is full."""
    listening = monitor()
    once, again = drive(listening, 7.0), drive(listening, 7.0)
    assert [stamp for stamp, _ in once] == [stamp for stamp, _ in again]
    for (_, first), (_, other) in zip(once, again, strict=True):
        assert repr(vars(first)) == repr(vars(other))


def test_angles_at_times() -> None:
    """An angle is known from the first reading to the last one, where readings are close enough."""
    readings = np.array([0.0, 1.0, 2.5]), np.array([2.0, 3.0, 6.0])
    at = np.array([-0.01, 0.0, 0.5, 1.0, 1.01, 2.5, 2.51])
    for stale_after, apart in ((1.5, [3.02, 6.0]), (1.49, [np.nan, np.nan])):
        expected = [np.nan, 2.0, 2.5, 3.0, *apart, np.nan]
        np.testing.assert_allclose(_at(*readings, at, stale_after), expected)


def test_another_place_is_refused() -> None:
    """A point that the table lacks has no response."""
    with pytest.raises(SignalError, match="no response at X9"):
        monitor(at="X9")
