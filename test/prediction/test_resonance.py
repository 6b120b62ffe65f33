# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Excitations and natural frequencies: margins, approach, warnings and stale speeds."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.predictor import Prediction, Predictor
from linkage_vibration.prediction.resonance import (
    ResonanceMonitor,
    ResonanceState,
    described,
    half_power_probability,
)
from linkage_vibration.prediction.severity import Unknown
from linkage_vibration.support.resources import PAPER_TABLE, config_file
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


def assessed(watch: ResonanceMonitor, *args: Any, **options: float) -> Any:
    """Return an assessment with what follows from its fields."""
    return described(watch.assess(*args, **options))


def rpm(frequency: float) -> float:
    """Return the engine speed whose first order has a frequency in Hz."""
    return 60.0 * frequency


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
        resonance = assessed(watch, prediction, 0.0, end)
        assert resonance.approach == approach
        assert resonance.time_to_crossing == pytest.approx(
            crossing - 0.05 if approach > 0 else crossing
        )
        assert abs(resonance.approach_rate) == pytest.approx(2.0)
        assert 0.0 < resonance.approach_rate_error < 1.0


def test_a_direction_that_is_not_known(prediction: Prediction) -> None:
    """Without rates, and with rates below their errors, no direction and no time is reported."""
    natural, watch = float(prediction.natural_frequencies[1]), monitor()
    watch.set_speed(Source.ENGINE, rpm(natural - 2.0), 0)
    first = assessed(watch, prediction, 0.0, 0)  # one speed has no rate
    end = ramp(watch, natural - 6.0, 2.0, 2.0)
    still = assessed(watch, prediction, math.nan, end)  # the motion of the hitch is not known
    within = assessed(watch, prediction, 0.0, end, velocity_error=1.0)
    for each in (first, still, within):
        assert each.state is not ResonanceState.UNKNOWN
        assert each.approach == 0
        assert math.isnan(each.time_to_crossing)
    assert within.approach_rate_error > abs(within.approach_rate)
    watch.set_fixed(Source.ENGINE, rpm(natural - 2.0))
    fixed = assessed(watch, prediction, 0.0, end)  # nothing moves, so they never meet
    assert (fixed.approach, fixed.time_to_crossing) == (0, math.inf)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_tyres_excite_in_reverse(prediction: Prediction, direction: float) -> None:
    """The magnitude of a ground speed counts, and its rate is that of the magnitude."""
    tyre = [Excitation("tyre_lugs 1", Source.GROUND, 4.0)]
    watch = ResonanceMonitor(tyre)
    for i in range(30):
        speed = direction * (5.0 + 0.1 * i)  # m/s, 1 m/s^2
        watch.set_speed(Source.GROUND, speed, i * SECOND // 10)
    resonance = assessed(watch, prediction, 0.0, 29 * SECOND // 10)
    assert resonance.excitation_frequency == pytest.approx(4.0 * 7.9)
    assert abs(resonance.approach_rate) == pytest.approx(4.0)
    assert resonance.approach == -1 if resonance.margin > 0.0 else 1


def test_approach_of_a_hitch_that_moves(predictor: Predictor) -> None:
    """With the velocity of the crank, the predicted time of the crossing is that of the table."""
    watch, alpha3, velocity = monitor(), 2.9, 0.02
    before, after = predictor.predict(alpha3), predictor.predict(alpha3 + velocity)  # 1 s on
    target = float(after.natural_frequencies[1])
    watch.set_fixed(Source.ENGINE, rpm(target))
    resonance = assessed(watch, before, velocity, 0)
    assert resonance.mode == 1
    assert resonance.approach == 1
    assert resonance.time_to_crossing == pytest.approx(1.0, rel=0.1)  # the slope changes on the way
    assert assessed(watch, before, -velocity, 0).approach == -1
    assert assessed(watch, before, 0.0, 0).approach == 0


def test_stale_speeds(predictor: Predictor, prediction: Prediction) -> None:
    """Without a fresh speed or a prediction the state is unknown, and recovers at once."""
    watch = monitor(stale_after=1.0)
    stale = assessed(watch, prediction, 0.0, 0)
    assert stale.state is ResonanceState.UNKNOWN
    assert (stale.excitation, stale.mode, stale.approach) == ("", -1, 0)
    assert stale.excitation_index == -1
    assert math.isnan(stale.margin)
    assert math.isnan(stale.time_to_crossing)
    watch.set_speed(Source.ENGINE, 2000.0, 5 * SECOND)
    for at, expected in ((5.0, False), (5.99, False), (6.01, True), (3.9, True)):
        actual = assessed(watch, prediction, 0.0, round(at * SECOND)).state
        assert (actual is ResonanceState.UNKNOWN) == expected
    outside = predictor.predict(0.0)
    assert assessed(watch, outside, 0.0, 5 * SECOND).state is ResonanceState.UNKNOWN
    watch.set_fixed(Source.ENGINE, 2000.0)
    assert assessed(watch, prediction, 0.0, 10**18).state is not ResonanceState.UNKNOWN


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0])
def test_invalid_speed(prediction: Prediction, value: float) -> None:
    """NaN, infinity and a negative speed make the speed unknown."""
    watch = monitor()
    watch.set_speed(Source.ENGINE, 2000.0, 0)
    watch.set_speed(Source.ENGINE, value, SECOND // 10)
    assert assessed(watch, prediction, 0.0, SECOND // 10).state is ResonanceState.UNKNOWN


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
        return assessed(watch, prediction, 0.0, at).state is ResonanceState.UNKNOWN

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


def test_shaft_at_rest_is_clear(prediction: Prediction) -> None:
    """An engine at rest is known to excite nothing, while a speed that is not known is named."""
    watch = monitor()
    watch.set_speed(Source.ENGINE, 0.0, 0)
    still = assessed(watch, prediction, 0.0, 0)
    assert (still.state, still.unknown_sources) == (ResonanceState.CLEAR, 0)
    watch.set_speed(Source.ENGINE, math.nan, SECOND)
    lost = assessed(watch, prediction, 0.0, SECOND)
    assert (lost.state, lost.unknown_sources) == (ResonanceState.UNKNOWN, Unknown.ENGINE_SPEED)


def test_clock_that_jumps_back(prediction: Prediction) -> None:
    """After a jump of the clock there is no rate; two values at one time keep the rate."""
    natural, watch = float(prediction.natural_frequencies[1]), monitor(stale_after=10.0)
    end = ramp(watch, natural - 8.0, 2.0, 2.0)
    watch.set_speed(Source.ENGINE, rpm(natural - 8.0 + 2.0 * 1.9), end)
    assert assessed(watch, prediction, 0.0, end).approach == 1
    watch.set_speed(Source.ENGINE, rpm(natural - 5.0), end - SECOND)
    assert assessed(watch, prediction, 0.0, end - SECOND).approach == 0


def test_burst_makes_no_rate_of_its_own(prediction: Prediction) -> None:
    """The rate of noisy values at 5 kHz is that of their means."""
    watch, natural = monitor(), float(prediction.natural_frequencies[1])
    for i, noise in enumerate(np.random.default_rng(1).normal(0.0, 0.01, 2500)):
        time = i * SECOND // 5000  # the noise changes by some 100 Hz/s from one to the next
        watch.set_speed(Source.ENGINE, rpm(natural - 4.0 + 2e-9 * time + noise), time)
        resonance = assessed(watch, prediction, 0.0, time)
        if resonance.approach_rate == resonance.approach_rate:
            assert abs(resonance.approach_rate - 2.0) < resonance.approach_rate_error
    assert resonance.approach == 1
    assert resonance.time_to_crossing == pytest.approx(2.0 - 0.5, rel=0.1)


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


def test_a_speed_is_fresh_up_to_its_limit(prediction: Prediction) -> None:
    """It counts at an age of exactly one second, before or after, and no longer."""
    for age, fresh in ((10**9, True), (-(10**9), True), (10**9 + 1, False), (-(10**9) - 1, False)):
        watch = monitor()
        watch.set_speed(Source.ENGINE, 2000.0, 10**12)
        resonance = assessed(watch, prediction, 0.0, 10**12 + age)
        assert (resonance.state != ResonanceState.UNKNOWN) == fresh
