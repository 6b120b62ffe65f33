# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Excitations and natural frequencies: margins, approach, warnings and stale speeds."""

import csv
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.prediction.excitation import (
    Excitation,
    Source,
    excitations_from_mapping,
)
from linkage_vibration.prediction.predictor import Prediction, Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor, ResonanceState
from linkage_vibration.support.resources import DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table

SECOND = 10**9  # ns
BUS = Path(__file__).parents[3] / "shared" / "data" / "tractor_can_gears.csv"


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """Return a predictor on the shipped table."""
    return Predictor(load_table(config_file(DEFAULT_TABLE)))


@pytest.fixture
def prediction(predictor: Predictor) -> Prediction:
    """Return a prediction in mid-stroke."""
    return predictor.predict(2.3)


def monitor(**settings: float) -> ResonanceMonitor:
    """Return a monitor of the engine's first order alone."""
    return ResonanceMonitor([Excitation("engine 1", Source.ENGINE, 1.0 / 60.0)], **settings)


def rpm(frequency: float) -> float:
    """Return the engine speed whose first order has a frequency in Hz."""
    return 60.0 * frequency


@given(st.floats(100.0, 12_000.0), st.floats(1.6, 3.1))
def test_nearest_of_all_pairs(predictor: Predictor, speed: float, alpha3: float) -> None:
    """The resonance is the pair of order and mode with the least relative margin."""
    orders = [0.5, 1.0, 2.0, 3.0]
    watch = ResonanceMonitor([Excitation(f"e {o}", Source.ENGINE, o / 60.0) for o in orders])
    watch.set_speed(Source.ENGINE, speed, 0)
    prediction = predictor.predict(alpha3)
    found = watch.assess(prediction, 0.0, 0)
    margins = [
        (o / 60.0 * speed - f) / f for o in orders for f in prediction.natural_frequencies.tolist()
    ]
    assert found.relative_margin == pytest.approx(min(margins, key=abs), rel=1e-9, abs=1e-12)
    assert found.margin == pytest.approx(found.excitation_frequency - found.natural_frequency)
    assert (found.state is ResonanceState.WARNING) == (abs(found.relative_margin) < 0.1)


def test_warning_has_hysteresis(prediction: Prediction) -> None:
    """The warning begins below 10 %, ends above 12 %, and does not flicker in between."""
    natural = float(prediction.natural_frequencies[1])
    watch, states = monitor(warning_margin=0.1, hysteresis=0.02), []
    for i, margin in enumerate([0.13, 0.11, 0.101, 0.099, 0.101, 0.115, 0.099, 0.119, 0.121, 0.11]):
        watch.set_speed(Source.ENGINE, rpm(natural * (1.0 + margin)), i * SECOND // 10)
        states.append(int(watch.assess(prediction, 0.0, i * SECOND // 10).state))
    assert states == [0, 0, 0, 1, 1, 1, 1, 1, 0, 0]


def test_approach_of_an_engine_that_speeds_up(prediction: Prediction) -> None:
    """An excitation approaches until it crosses; the time is the margin over its rate."""
    natural, watch = float(prediction.natural_frequencies[1]), monitor()
    for i, apart in enumerate([-2.0, -1.5]):
        watch.set_speed(Source.ENGINE, rpm(natural + apart), i * SECOND // 2)
    found = watch.assess(prediction, math.nan, SECOND // 2)
    assert found.margin == pytest.approx(-1.5)
    assert found.approach == 1
    assert found.time_to_crossing == pytest.approx(1.5, rel=1e-9)  # 1 Hz/s
    for i, apart in enumerate([0.5, 1.0], start=2):
        watch.set_speed(Source.ENGINE, rpm(natural + apart), i * SECOND // 2)
    passed = watch.assess(prediction, math.nan, 3 * SECOND // 2)
    assert (passed.approach, passed.time_to_crossing) == (-1, math.inf)


def test_approach_of_a_hitch_that_moves(predictor: Predictor) -> None:
    """With the velocity of the crank, the predicted time of the crossing is that of the table."""
    watch, alpha3, velocity = monitor(), 2.9, 0.02
    before, after = predictor.predict(alpha3), predictor.predict(alpha3 + velocity)  # 1 s on
    target = float(after.natural_frequencies[1])
    watch.set_fixed(Source.ENGINE, rpm(target))
    found = watch.assess(before, velocity, 0)
    assert found.mode == 1
    assert found.approach == 1
    assert found.time_to_crossing == pytest.approx(1.0, rel=0.1)  # the slope changes on the way
    assert watch.assess(before, -velocity, 0).approach == -1
    assert watch.assess(before, 0.0, 0).approach == 0


def test_stale_speeds(predictor: Predictor, prediction: Prediction) -> None:
    """Without a fresh speed or a prediction the state is stale, and recovers at once."""
    watch = monitor(stale_after=1.0)
    stale = watch.assess(prediction, 0.0, 0)
    assert stale.state is ResonanceState.STALE
    assert (stale.excitation, stale.mode, stale.approach) == ("", 0, 0)
    assert math.isnan(stale.margin)
    assert math.isnan(stale.time_to_crossing)
    watch.set_speed(Source.ENGINE, 2000.0, 5 * SECOND)
    for at, expected in ((5.0, False), (5.99, False), (6.01, True), (3.9, True)):
        found = watch.assess(prediction, 0.0, round(at * SECOND)).state
        assert (found is ResonanceState.STALE) == expected
    outside = predictor.predict(0.0)
    assert watch.assess(outside, 0.0, 5 * SECOND).state is ResonanceState.STALE
    watch.set_fixed(Source.ENGINE, 2000.0)
    assert watch.assess(prediction, 0.0, 10**18).state is not ResonanceState.STALE


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0])
def test_invalid_speed(prediction: Prediction, value: float) -> None:
    """NaN, infinity and a negative speed make the speed unknown."""
    watch = monitor()
    watch.set_speed(Source.ENGINE, 2000.0, 0)
    watch.set_speed(Source.ENGINE, value, SECOND // 10)
    assert watch.assess(prediction, 0.0, SECOND // 10).state is ResonanceState.STALE


def test_any_speed_reported() -> None:
    """The monitor knows whether any speed was reported, also after it was forgotten."""
    for tell in (lambda w: w.set_speed(Source.PTO, 540.0, 0), lambda w: w.set_fixed(Source.PTO, 1)):
        watch = monitor()
        assert not watch.any_speed_reported
        tell(watch)
        assert watch.any_speed_reported
        watch.set_speed(Source.PTO, math.nan, 0)
        assert watch.any_speed_reported


def test_fixed_speeds(prediction: Prediction) -> None:
    """A speed is fixed until it is freed or reported; freeing a reported speed changes nothing."""
    watch = monitor()

    def is_stale(at: int) -> bool:
        return watch.assess(prediction, 0.0, at).state is ResonanceState.STALE

    watch.set_fixed(Source.ENGINE, None)
    assert not watch.any_speed_reported
    assert is_stale(0)
    watch.set_fixed(Source.ENGINE, 2000.0)
    assert not is_stale(100 * SECOND)
    watch.set_fixed(Source.ENGINE, None)
    assert is_stale(0)
    watch.set_fixed(Source.ENGINE, 2000.0)
    watch.set_speed(Source.ENGINE, 2000.0, 0)
    assert is_stale(100 * SECOND)
    watch.set_fixed(Source.ENGINE, None)
    assert not is_stale(0)


def test_shaft_that_stands_excites_nothing(prediction: Prediction) -> None:
    """An engine at rest does not excite at 0 Hz."""
    watch = monitor()
    watch.set_speed(Source.ENGINE, 0.0, 0)
    assert watch.assess(prediction, 0.0, 0).state is ResonanceState.STALE


def test_clock_that_jumps_back(prediction: Prediction) -> None:
    """A jump of the clock gives no rate; two values at one time keep the rate."""
    watch = monitor(stale_after=10.0)
    for value, time in ((1000.0, 100), (1100.0, 101), (1100.0, 101), (500.0, 2)):
        watch.set_speed(Source.ENGINE, value, time * SECOND)
        if time == 101:
            assert watch.assess(prediction, 0.0, time * SECOND).approach != 0
    assert watch.assess(prediction, 0.0, 2 * SECOND).approach == 0


def test_burst_makes_no_rate_of_its_own(prediction: Prediction) -> None:
    """The rate of values at 5 kHz is that over 5 ms, even if they are noisy or delayed."""
    watch, natural = monitor(), float(prediction.natural_frequencies[1])
    for i in range(500):
        time = i * SECOND // 5000
        noise = 0.01 * (-1) ** i  # Hz: 100 Hz/s from one to the next
        watch.set_speed(Source.ENGINE, rpm(natural - 2.0 + 1e-9 * time + noise), time)
        found = watch.assess(prediction, 0.0, time)
        if i > 50:
            # At most 0.02 Hz of noise in 5 ms, on 1 Hz/s
            assert -found.margin / found.time_to_crossing <= 1.0 + 4.01
    jammed = monitor()
    for time, apart in ((0.0, -2.0), (0.1, -1.9), (0.1001, -1.8), (0.1002, -1.7)):  # type: ignore[assignment]
        jammed.set_speed(Source.ENGINE, rpm(natural + apart), round(time * SECOND))
    found = jammed.assess(prediction, 0.0, SECOND // 10)
    assert found.margin == pytest.approx(-1.7)
    assert found.time_to_crossing == pytest.approx(1.7)  # at 1 Hz/s


def test_two_pairs_that_take_turns_do_not_chatter(prediction: Prediction) -> None:
    """The warning stays while the nearest pair changes, and reports the nearest pair."""
    natural = float(prediction.natural_frequencies[1])
    below, above = (Excitation(f"e {r}", Source.ENGINE, r / 60.0) for r in (0.85, 1.05))
    watch = ResonanceMonitor([below, above])
    found = []
    for i in range(40):  # 0.85 x is 9 to 11 % too low while 1.05 x is 12 to 10 % too high
        watch.set_speed(Source.ENGINE, rpm(natural * (1.06 + 0.01 * (-1) ** i)), i * SECOND // 10)
        found.append(watch.assess(prediction, 0.0, i * SECOND // 10))
    assert {one.excitation for one in found} == {"e 0.85", "e 1.05"}
    assert {one.state for one in found} == {ResonanceState.WARNING}


def test_same_calls_give_the_same_answers(predictor: Predictor) -> None:
    """The monitor has no clock and no randomness, so a replay gives the live results."""

    def played() -> list[Any]:
        watch, answers = monitor(), []
        for i in range(300):
            time = i * SECOND // 50
            if i % 5 == 0:
                watch.set_speed(Source.ENGINE, 4000.0 + 700.0 * math.sin(0.03 * i), time)
            answers.append(watch.assess(predictor.predict(1.6 + 0.005 * i), 0.25, time))
        return answers

    assert played() == played()


@pytest.mark.skipif(not BUS.exists(), reason=f"{BUS.name} is not there")
def test_real_engine_speeds(predictor: Predictor) -> None:
    """The recorded engine speeds of a tractor (J1939, PGN 61444) cross the resonances."""
    watch = ResonanceMonitor(
        excitations_from_mapping({"engine": {"speed": "engine", "orders": [0.5, 1, 2, 3, 6]}})
    )
    speeds, states, crossings, sign = [], [], 0, 0.0
    prediction = predictor.predict(math.radians(150.0))
    with BUS.open(newline="") as file:
        for row in csv.DictReader(file):
            if row["pgn"] != "61444":
                continue
            data = bytes.fromhex(row["data"])
            raw = int.from_bytes(data[3:5], "little")  # bytes 4 and 5, 0.125 rpm a bit
            time = round(float(row["time"]) * 1e6)
            # From 0xFB00 on the bus says that there is no number.
            speed = 0.125 * raw if raw < 0xFB00 else math.nan
            watch.set_speed(Source.ENGINE, speed, time)
            found = watch.assess(prediction, 0.0, time)
            speeds.append(speed)
            states.append(found.state)
            if found.state is ResonanceState.WARNING:
                crossings += found.margin * sign < 0.0
                sign = found.margin
                assert found.excitation_frequency == pytest.approx(
                    float(found.excitation.split()[1]) * speed / 60.0
                )
    running = [speed for speed in speeds if speed > 0.0]
    assert len(speeds) > 1000
    assert 1000.0 < max(running) < 3000.0  # and it is started and stopped on the way
    assert {ResonanceState.CLEAR, ResonanceState.WARNING} <= set(states)
    assert crossings > 0
    for speed, state in zip(speeds, states, strict=True):
        assert (state is ResonanceState.STALE) == (not speed > 0.0)
