# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Values of an input that go to and fro are not known."""

import math
from collections.abc import Sequence
from random import Random

import pytest

from linkage_vibration.prediction.agreement import Agreement, StandingClock, crank_agreement
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.inputs.presets import ENGINE, GROUND, HITCH, PTO
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor
from linkage_vibration.support.resources import DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table

TENTH = 100_000_000  # ns


def lost(agreement: Agreement, values: Sequence[float], step: int = TENTH) -> list[bool]:
    """Return for each value whether it is lost."""
    return [agreement.loses(at * step, value) for at, value in enumerate(values)]


@pytest.mark.parametrize(
    ("name", "noise", "rate"),
    [(HITCH, 0.03, 0.5), (ENGINE, 50.0, 500.0), (PTO, 20.0, 150.0), (GROUND, 0.3, 1.0)],
)
@pytest.mark.parametrize("step", [TENTH, TENTH // 10])
def test_noise_and_motion(name: str, noise: float, rate: float, step: int) -> None:
    """Publishers whose values differ by no more than noise and motion agree; others do not."""
    apart = noise + rate * 1e-9 * step
    assert lost(Agreement(name), [0.0, 0.999 * apart] * 20, step) == [False] * 40
    assert lost(Agreement(name), [0.0, 1.001 * apart] * 20, step) == [False] * 6 + [True] * 34


@pytest.mark.parametrize("size", [1, 2, 3, 7])
def test_publishers_in_turn(size: int) -> None:
    """Two publishers whose values come in turn, each several times, disagree from then on."""
    values = ([540.0] * size + [500.0] * size) * 10
    assert lost(Agreement(PTO), values) == [n >= 6 * size for n in range(len(values))]


@pytest.mark.parametrize("name", [HITCH, PTO])
@pytest.mark.parametrize("share", [0.5, 0.1])
def test_publishers_in_any_order(name: str, share: float) -> None:
    """Values of two publishers at random, at 50 Hz, are not known after a second, and stay so.

    One of them may send a tenth of the values, and both move at the speed of a hitch.
    """
    random = Random(name)
    moves, apart = (0.01, 0.1) if name == HITCH else (1.0, 100.0)
    values = [
        moves * min(n % 100, 100 - n % 100) + apart * (random.random() < share) for n in range(1000)
    ]
    found = lost(Agreement(name), values, TENTH // 5)
    first = found.index(True)
    assert first < 100
    assert all(found[first:])


def test_three_publishers_in_turn() -> None:
    """Three publishers in turn disagree, too; a motion of two steps up and two down does not."""
    assert all(lost(Agreement(PTO), [100.0, 320.0, 540.0] * 30)[40:])
    glitch = [100.0, 320.0, 540.0, 320.0] * 30 + [540.0, 320.0]
    assert not any(lost(Agreement(PTO), glitch * 3))


@pytest.mark.parametrize("rate", [5, 10, 25, 50, 100])
@pytest.mark.parametrize("period", [0.2, 0.5, 1.0, 2.0])
def test_a_hitch_that_is_adjusted_agrees(rate: int, period: float) -> None:
    """Up and down at 0.5 rad/s without a pause, a hitch agrees with itself at each rate."""
    times = [n / rate for n in range(5 * rate)]
    angles = [2.0 + 0.5 * abs((t + 0.03) % period - 0.5 * period) for t in times]
    assert not any(lost(Agreement(HITCH), angles, 10**9 // rate))


@pytest.mark.parametrize("rate", [5, 10, 25, 50, 100])
@pytest.mark.parametrize("hertz", [0.3, 0.7, 1.0, 1.5, 2.0, 3.0])
def test_an_engine_that_hunts_agrees(rate: int, hertz: float) -> None:
    """A governor that hunts by 60 rpm to both sides, as 3 % of the speed, is no disagreement."""
    angle = [2.0 * math.pi * hertz * n / rate for n in range(10 * rate)]
    speeds = [2000.0 + 60.0 * math.sin(each) for each in angle]
    assert not any(lost(Agreement(ENGINE), speeds, 10**9 // rate))


def test_glitches() -> None:
    """Two glitches are no publishers that disagree; nor are more that are over 1 s apart."""
    glitches = [540.0] * 5 + [0.0] + [540.0] * 5
    assert not any(lost(Agreement(PTO), glitches + [0.0] + [540.0] * 9, 150 * 10**6))
    each = [540.0] * 9 + [0.0]
    assert not any(lost(Agreement(PTO), each * 9, 112_000_000))
    assert any(lost(Agreement(PTO), each * 9, 110_000_000))


@pytest.mark.parametrize(("behind", "found"), [(0.9, True), (1.2, False)])
def test_stamps_of_two_clocks(behind: float, found: bool) -> None:
    """Publishers whose clocks differ by less than a second disagree as others do."""
    agreement, found_now = Agreement(PTO), []
    for n in range(40):
        late = round(1e9 * behind) * (n % 2)
        found_now.append(agreement.loses(n * TENTH + 10**10 - late, 540.0 * (n % 2)))
    assert found_now[-1] is found


@pytest.mark.parametrize(("jump", "doubted"), [(0.459, False), (0.461, True)])
def test_a_jump(jump: float, doubted: bool) -> None:
    """A reading 0.1 s later by more than 0.06 rad and 4 rad/s is doubted, and so is the next."""
    actual = lost(Agreement(HITCH), [2.0] * 5 + [2.0 + jump] + [2.0] * 5)
    assert actual == [False] * 5 + [doubted] * 2 + [False] * 4
    far = Agreement(HITCH)  # after a gap of more than a second, nothing is known of a motion
    assert [far.loses(0, 2.0), far.loses(1_001_000_000, 3.0), far.loses(10**10, 2.0)] == [False] * 3
    assert not any(lost(Agreement(PTO), [0.0] * 5 + [540.0] * 5))


def test_it_ends_after_a_second() -> None:
    """The value is known again once none has gone to and fro for more than 1 s."""
    steps = lost(Agreement(ENGINE), [2000.0, 800.0] * 5 + [2000.0] * 20)
    last = 10  # the first 2000 after the last 800 goes to and fro, too
    assert steps == [False] * 6 + [True] * 15 + [False] * 9
    assert steps.index(False, last) - last == 11


def test_a_clock_that_jumps_back_ends_a_doubt() -> None:
    """What disagreed at later times does not count."""
    agreement = Agreement(PTO)
    assert lost(agreement, [540.0, 0.0] * 5)[-1]
    assert agreement.is_lost(-TENTH)  # a second before the last one
    assert not agreement.is_lost(-TENTH - 1)


@pytest.mark.parametrize("name", [HITCH, GROUND])
def test_only_angles_wrap(name: str) -> None:
    """An angle about half a turn is one value, but 3.1 and -3.1 m/s are not."""
    assert any(lost(Agreement(name), [3.14, -3.14] * 10)) is (name == GROUND)


def test_what_moves_agrees() -> None:
    """A hitch that swings by 0.2 rad at 2 Hz, read at 20 Hz, agrees with itself; so does a ramp."""
    swing = [2.0 + 0.2 * math.sin(2.0 * math.pi * 2.0 * 0.05 * k) for k in range(100)]
    assert not any(lost(Agreement(HITCH), swing, TENTH // 2))
    assert not any(lost(Agreement(PTO), [5.4 * k for k in range(100)]))


def test_cranks_that_turn_and_values_that_are_none() -> None:
    """A crank with a table of more than half a turn may be anywhere; NaN is no value."""
    turning = [0.0, 3.0] * 10
    assert not any(lost(crank_agreement((0.0, 2.0 * math.pi)), turning))
    assert any(lost(crank_agreement((0.0, 3.14)), turning))
    assert not any(lost(Agreement(PTO), [540.0, math.nan, 540.0, math.inf] * 10))


def test_a_speed_that_is_lost_is_unknown() -> None:
    """The monitor does not know a speed whose publishers disagree, until they agree."""
    monitor = ResonanceMonitor([Excitation("pto 1", Source.PTO, 1.0 / 60.0)])
    prediction = Predictor(load_table(config_file(DEFAULT_TABLE))).predict(2.0)
    states = []
    for k, speed in enumerate([540.0, 100.0] * 5 + [540.0] * 15):
        monitor.set_speed(Source.PTO, speed, k * TENTH)
        states.append(int(monitor.assess(prediction, 0.0, k * TENTH).unknown_sources))
    assert states == [0] * 6 + [4] * 15 + [0] * 4


def test_a_clock_that_stands() -> None:
    """A clock stands if its time is the same while stamps go on by more than a second."""
    clock = StandingClock()
    assert [clock.stands(5, n * TENTH) for n in range(14)] == [False] * 11 + [True] * 3
    assert not clock.stands(6, 14 * TENTH)
    assert not any(StandingClock().stands(5, 7) for _ in range(30))
    coarse = StandingClock()  # a clock in steps of a second
    assert not any(coarse.stands(n // 10, n * TENTH) for n in range(100))
