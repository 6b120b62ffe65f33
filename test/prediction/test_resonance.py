# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Excitations and natural frequencies: margins, approach, warnings and stale speeds."""

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.topics import RESONANCE
from linkage_vibration.prediction.excitation import (
    Excitation,
    Source,
    excitations_from_mapping,
)
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Prediction, Predictor
from linkage_vibration.prediction.resonance import (
    ResonanceMonitor,
    ResonanceState,
    WarningLimits,
    half_power_probability,
    never_warned,
)
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import DEFAULT_TABLE, PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table

SECOND = 10**9  # ns
NOTE = ResonanceState.NOTE
BUS = Path(__file__).parents[3] / "shared" / "data" / "tractor_can_gears.csv"


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """Return a predictor on the table of the paper's linkage."""
    return Predictor(load_table(config_file(PAPER_TABLE)))


@pytest.fixture
def prediction(predictor: Predictor) -> Prediction:
    """Return a prediction in mid-stroke."""
    return predictor.predict(2.3)


def monitor(stale_after: float = 1.0) -> ResonanceMonitor:
    """Return a monitor of the engine's first order alone."""
    engine = [Excitation("engine 1", Source.ENGINE, 1.0 / 60.0)]
    return ResonanceMonitor(engine, stale_after=stale_after)


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
    watch, states = monitor(), []
    for i, margin in enumerate([0.13, 0.11, 0.101, 0.099, 0.101, 0.115, 0.099, 0.119, 0.121, 0.11]):
        watch.set_speed(Source.ENGINE, rpm(natural * (1.0 + margin)), i * SECOND // 10)
        states.append(int(watch.assess(prediction, 0.0, i * SECOND // 10).state))
    assert states == [0, 0, 0, 1, 1, 1, 1, 1, 0, 0]


def ramp(watch: ResonanceMonitor, first: float, rate: float, seconds: float) -> int:
    """Report an engine speed at 10 Hz whose first order changes by a rate, Hz/s; return the end."""
    for i in range(round(10.0 * seconds)):
        speed = rpm(first + rate * i / 10.0)
        watch.set_speed(Source.ENGINE, speed, i * SECOND // 10)
    return i * SECOND // 10


def test_approach_of_an_engine_that_speeds_up(prediction: Prediction) -> None:
    """An excitation approaches until it crosses; the time is the margin over its rate."""
    natural = float(prediction.natural_frequencies[1])
    for first, approach, crossing in ((-6.5, 1, 1.5), (-4.5, -1, math.inf)):
        watch = monitor()
        end = ramp(watch, natural + first, 2.0, 1.9 if approach > 0 else 3.1)
        found = watch.assess(prediction, 0.0, end)
        assert found.approach == approach
        assert found.time_to_crossing == pytest.approx(
            crossing - 0.05 if approach > 0 else crossing
        )
        assert abs(found.approach_rate) == pytest.approx(2.0)
        assert 0.0 < found.approach_rate_error < 1.0


def test_a_direction_that_is_not_known(prediction: Prediction) -> None:
    """Without rates, and with rates below their errors, no direction and no time is reported."""
    natural, watch = float(prediction.natural_frequencies[1]), monitor()
    watch.set_speed(Source.ENGINE, rpm(natural - 2.0), 0)
    first = watch.assess(prediction, 0.0, 0)  # one speed has no rate
    end = ramp(watch, natural - 6.0, 2.0, 2.0)
    still = watch.assess(prediction, math.nan, end)  # the motion of the hitch is not known
    within = watch.assess(prediction, 0.0, end, velocity_error=1.0)
    for found in (first, still, within):
        assert found.state is not ResonanceState.STALE
        assert found.approach == 0
        assert math.isnan(found.time_to_crossing)
    assert within.approach_rate_error > abs(within.approach_rate)
    watch.set_fixed(Source.ENGINE, rpm(natural - 2.0))
    fixed = watch.assess(prediction, 0.0, end)  # nothing moves, so they never meet
    assert (fixed.approach, fixed.time_to_crossing) == (0, math.inf)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_tyres_excite_in_reverse(prediction: Prediction, direction: float) -> None:
    """The magnitude of a ground speed counts, and its rate is that of the magnitude."""
    tyre = [Excitation("tyre_lugs 1", Source.GROUND, 4.0)]
    watch = ResonanceMonitor(tyre)
    for i in range(30):
        speed = direction * (5.0 + 0.1 * i)  # m/s, 1 m/s^2
        watch.set_speed(Source.GROUND, speed, i * SECOND // 10)
    found = watch.assess(prediction, 0.0, 29 * SECOND // 10)
    assert found.excitation_frequency == pytest.approx(4.0 * 7.9)
    assert abs(found.approach_rate) == pytest.approx(4.0)
    assert found.approach == -1 if found.margin > 0.0 else 1


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
    """After a jump of the clock there is no rate; two values at one time keep the rate."""
    natural, watch = float(prediction.natural_frequencies[1]), monitor(stale_after=10.0)
    end = ramp(watch, natural - 8.0, 2.0, 2.0)
    watch.set_speed(Source.ENGINE, rpm(natural - 8.0 + 2.0 * 1.9), end)
    assert watch.assess(prediction, 0.0, end).approach == 1
    watch.set_speed(Source.ENGINE, rpm(natural - 5.0), end - SECOND)
    assert watch.assess(prediction, 0.0, end - SECOND).approach == 0


def test_burst_makes_no_rate_of_its_own(prediction: Prediction) -> None:
    """The rate of noisy values at 5 kHz is that of their means."""
    watch, natural = monitor(), float(prediction.natural_frequencies[1])
    for i, noise in enumerate(np.random.default_rng(1).normal(0.0, 0.01, 5000)):
        time = i * SECOND // 5000  # the noise changes by some 100 Hz/s from one to the next
        watch.set_speed(Source.ENGINE, rpm(natural - 4.0 + 2e-9 * time + noise), time)
        found = watch.assess(prediction, 0.0, time)
        if found.approach_rate == found.approach_rate:
            assert abs(found.approach_rate - 2.0) < found.approach_rate_error
    assert found.approach == 1
    assert found.time_to_crossing == pytest.approx(1.0, rel=0.1)


def test_two_pairs_that_take_turns_do_not_chatter(prediction: Prediction) -> None:
    """The warning stays with the excitation that warns while another one is nearer at times."""
    natural = float(prediction.natural_frequencies[1])
    below, above = (Excitation(f"e {r}", Source.ENGINE, r / 60.0) for r in (0.85, 1.05))
    watch = ResonanceMonitor([below, above])
    found = []
    for i in range(40):  # 0.85 x is 9 to 11 % too low while 1.05 x is 12 to 10 % too high
        watch.set_speed(Source.ENGINE, rpm(natural * (1.06 + 0.01 * (-1) ** i)), 2 * i * SECOND)
        found.append(watch.assess(prediction, 0.0, 2 * i * SECOND))
    assert {one.excitation for one in found} == {"e 0.85"}
    assert {one.state for one in found} == {ResonanceState.WARNING}


def test_probability_is_that_of_a_sample() -> None:
    """Of random excitations and modes, the stated share lies within the half-power band."""
    rng = np.random.default_rng(4)
    for frequency, own, natural, spread, zeta in [
        (10.0, 0.1, 10.2, 0.3, 0.05),
        (4.0, 0.0, 4.0, 0.32, 0.02),
        (52.0, 1.0, 50.0, 0.0, 0.03),
    ]:
        forced, free = rng.normal((frequency, natural), (own, spread), (200_000, 2)).T
        share = float((np.abs(forced - free) < zeta * free).mean())
        numbers = (np.array([x]) for x in (frequency, own, natural, spread, zeta))
        assert half_power_probability(*numbers)[0] == pytest.approx(share, abs=0.004)


def test_modes_that_never_warn() -> None:
    """A mode is named if no excitation in its half-power band could reach the limit."""
    mechanism = read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    predictor = Predictor(load_table(config_file(DEFAULT_TABLE), mechanism))
    assert never_warned(predictor, 0.1) == ""
    sentence = never_warned(predictor, 0.2)
    assert "mode 5" in sentence
    assert "mode 1" not in sentence
    sharp = [predictor.predict(at) for at in np.linspace(*predictor.table.alpha3_range, 7)]
    for one in sharp:  # erf(zeta / (sqrt(2) sigma)) is the probability at a perfect match
        sigma = one.frequency_stddev[4] / one.natural_frequencies[4]
        assert math.erf(one.damping_ratios[4] / math.sqrt(2.0) / sigma) < 0.2
    known = load_table(config_file(PAPER_TABLE))
    assert never_warned(Predictor(known), 0.9) == ""  # its frequencies are known


def uncertain_monitor(limits: WarningLimits, **load: float) -> ResonanceMonitor:
    """Return a monitor of the linkage on the tractor, whose numbers are uncertain."""
    mechanism = read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    predictor = Predictor(load_table(config_file("tables/three_point_linkage_on_tractor.npz")))
    force = {"force": [load["force"]] * 2, "at": "E1.z", "at_speed": 600.0} if load else {}
    shaft = {"speed": "engine", "orders": [1, 4], "no_warning": [4], **force}
    excitations = excitations_from_mapping({"shaft": shaft})
    return ResonanceMonitor(excitations, limits, 1.0, LevelTable(predictor, mechanism, excitations))


def test_warning_by_probability_or_level() -> None:
    """With known deviations the probability counts, and with an amplitude the level alone."""
    predictor = Predictor(load_table(config_file("tables/three_point_linkage_on_tractor.npz")))
    prediction = predictor.predict(2.3)
    natural = float(prediction.natural_frequencies[3])
    for limits, load, expected in [
        (WarningLimits(probability=0.1), {}, ResonanceState.WARNING),
        (WarningLimits(probability=0.9), {}, ResonanceState.CLEAR),
        (WarningLimits(probability=0.9, level=1e-4), {"force": 100.0}, ResonanceState.WARNING),
        (WarningLimits(probability=0.1, level=10.0), {"force": 100.0}, ResonanceState.CLEAR),
    ]:
        watch = uncertain_monitor(limits, **load)
        watch.set_fixed(Source.ENGINE, rpm(natural))
        found = watch.assess(prediction, 0.0, 0)
        assert found.state is expected
        assert 0.1 < found.probability < 0.9
        assert math.isnan(found.velocity) == (not load)
        assert found.states.tolist()[1] == ResonanceState.CLEAR  # it never warns


def test_a_fast_pass_is_a_note(prediction: Prediction) -> None:
    """A mode that has no time to build up causes a note; one that has time causes a warning."""
    natural, zeta = float(prediction.natural_frequencies[0]), float(prediction.damping_ratios[0])
    slowest = 4.0 * math.pi * zeta**2 * natural**2  # Hz/s: the band is passed in 1 / (zeta omega)
    for rate, expected in ((0.5 * slowest, ResonanceState.WARNING), (9.0 * slowest, NOTE)):
        watch, found = monitor(), None
        for i in range(400):
            time = i * SECOND // 100
            frequency = 0.95 * natural + rate * (i / 100.0 - 4.0)  # at the end in the margin
            watch.set_speed(Source.ENGINE, rpm(frequency), time)
            found = watch.assess(prediction, 0.0, time)
            if abs(found.relative_margin) < 0.1:
                break
        assert found is not None
        assert found.state is expected
    # If it stays, the note becomes a warning when the mode has built up.
    built_up = math.ceil(SECOND / (zeta * 2.0 * math.pi * natural))
    for after, state in ((built_up // 2, NOTE), (built_up, ResonanceState.WARNING)):
        again = monitor(stale_after=100.0)
        end = ramp(again, 0.0, 0.999 * natural, 1.1)
        begin = again.assess(prediction, 0.0, end)
        assert begin.state is NOTE
        assert again.assess(prediction, 0.0, end + after).state is state


def test_dwell_delays_a_warning(prediction: Prediction) -> None:
    """Until the limit has been exceeded for the dwell time, there is a note."""
    engine = [Excitation("engine 1", Source.ENGINE, 1.0 / 60.0)]
    watch = ResonanceMonitor(engine, WarningLimits(dwell=2.0))
    watch.set_fixed(Source.ENGINE, rpm(float(prediction.natural_frequencies[1])))
    states = [watch.assess(prediction, 0.0, i * SECOND).state for i in range(4)]
    assert states == [NOTE, NOTE, ResonanceState.WARNING, ResonanceState.WARNING]


def test_same_calls_give_the_same_answers(predictor: Predictor) -> None:
    """The monitor has no clock and no randomness, so a replay gives the live results."""

    def played() -> list[Any]:
        watch, answers = monitor(), []
        for i in range(300):
            time = i * SECOND // 50
            if i % 5 == 0:
                watch.set_speed(Source.ENGINE, 4000.0 + 700.0 * math.sin(0.03 * i), time)
            found = watch.assess(predictor.predict(1.6 + 0.005 * i), 0.25, time)
            answers.append(encode_message(RESONANCE, found, i, 0, ""))
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
