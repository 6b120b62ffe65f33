# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Load ratios, states and warnings: both sides of each limit, and both ends of the dwell time."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.prediction.excitation import Source, excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor, described
from linkage_vibration.prediction.severity import (
    WarningLimits,
    WarningTimer,
    present_sentence,
    states,
)
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import DEFAULT_MECHANISM, DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table

SECOND = 10**9  # ns
RPM = 30.0 / math.pi  # of 1 rad/s
HEAVE = 7  # mode of the shipped hitch, from 0
UNKNOWN, CLEAR, NOTE, WARNING = range(4)


def followed(
    times: Iterable[float], exceeds: Iterable[bool | None], dwell: float = 1.0
) -> list[bool]:
    """Return when a limit warns that is exceeded at some of the times, s; None if not known."""
    nanoseconds, flags = np.array([round(time * SECOND) for time in times]), list(exceeds)
    known, exceeded = (
        np.array([[f is not None for f in flags]]),
        np.array([[bool(f) for f in flags]]),
    )
    result: list[bool] = WarningTimer(1).follow(exceeded, known, nanoseconds, dwell)[0].tolist()
    return result


def test_a_warning_begins_and_ends_after_the_dwell_time() -> None:
    """At 10 Hz, ten readings later there is a warning, and ten readings after its end none."""
    exceeds = [False] * 5 + [True] * 20 + [False] * 20
    warns = followed(np.arange(45) / 10.0, exceeds)
    assert warns == [False] * 15 + [True] * 20 + [False] * 10


def test_short_excesses_and_short_pauses_change_nothing() -> None:
    """What lasts less than the dwell time neither begins nor ends a warning."""
    short = [True] * 9 + [False] + [True] * 9 + [False]
    assert not any(followed(np.arange(20) / 10.0, short))
    pauses = [True] * 15 + ([False] * 9 + [True]) * 3
    assert followed(np.arange(45) / 10.0, pauses) == [False] * 10 + [True] * 35


def test_without_a_dwell_time_each_reading_decides() -> None:
    """With a dwell time of 0, a warning is there exactly where the limit is exceeded."""
    exceeds = [False, True, False, True, True]
    assert followed(range(5), exceeds, dwell=0.0) == exceeds


@pytest.mark.parametrize(
    ("gap", "expected"), [(2.9, True), (3.1, False), (-0.9, True), (-1.0, False)]
)
def test_a_gap_or_a_jump_back_ends_a_warning(gap: float, expected: bool) -> None:
    """A warning goes on after 2.9 s without a reading; 3.1 s, or a second back, end it."""
    times = [*(k / 10.0 for k in range(20)), 1.9 + gap]
    assert followed(times, [True] * 21)[19:] == [True, expected]


@pytest.mark.parametrize("behind", [0.0, 0.7])
def test_publishers_with_interleaved_times(behind: float) -> None:
    """Two publishers whose times differ by less than a second warn as one of them does."""
    times = [k / 10.0 - behind * (k % 2) for k in range(10, 40)]
    assert followed(times, [True] * 30) == [False] * 10 + [True] * 20


def test_a_reading_without_numbers_neither_ends_nor_restarts_a_dwell() -> None:
    """One in ten readings is not known: the warning begins and ends when it would without them."""
    rising = [False] * 5 + [True, True, None, True, True, None, None] + [True] * 13
    assert followed(np.arange(25) / 10.0, rising) == [False] * 15 + [True] * 10
    falling = [True] * 15 + [False, None, False, False, None] + [False] * 10
    assert followed(np.arange(30) / 10.0, falling) == [False] * 10 + [True] * 15 + [False] * 5


@pytest.mark.parametrize(("unknown", "expected"), [(29, True), (31, False)])
def test_what_is_not_known_for_long_ends_a_warning(unknown: int, expected: bool) -> None:
    """After 2.9 s that are not known a warning goes on, and after 3.1 s it begins anew."""
    exceeds = [True] * 20 + [None] * (unknown - 1) + [True]
    assert followed(np.arange(len(exceeds)) / 10.0, exceeds)[-1] is expected


@given(st.lists(st.booleans(), min_size=1, max_size=80), st.integers(1, 40))
def test_blocks_follow_each_other(exceeds: list[bool], size: int) -> None:
    """Where a block ends changes no warning, and no warning or pause is shorter than the dwell."""
    times = np.arange(len(exceeds)) * SECOND // 10
    known = np.ones((1, len(exceeds)), np.bool_)
    whole = WarningTimer(1).follow(np.array([exceeds]), known, times, 0.5)[0]
    timer, parts = WarningTimer(1), []
    for start in range(0, len(exceeds), size):
        rows = slice(start, start + size)
        parts.append(timer.follow(np.array([exceeds[rows]]), known[:, rows], times[rows], 0.5)[0])
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    changes = np.flatnonzero(np.diff(whole.astype(int))) + 1
    assert (np.diff(changes) >= 5).all()


def test_states_on_both_sides_of_each_limit() -> None:
    """Notes begin above 0.1 of the load ratio, and where it is not known below the margin."""
    ratio = np.array([0.1, 0.1001, 0.5, math.nan, math.nan, 0.5, math.nan])
    apart = np.array([0.0, 0.5, 0.5, 0.1, 0.0999, 0.5, math.inf])
    known = np.array([True] * 5 + [True, False])
    warns = np.array([False] * 5 + [True, False])
    ratio, apart, known, warns = (v[:, np.newaxis] for v in (ratio, apart, known, warns))
    actual = states(ratio, apart, known, warns, WarningLimits())[0][:, 0]
    assert actual.tolist() == [CLEAR, NOTE, NOTE, CLEAR, NOTE, WARNING, UNKNOWN]


def shaken(force: float, limits: WarningLimits = WarningLimits()) -> ResonanceMonitor:  # noqa: B008
    """Return a monitor of the linkage on its tractor, with a force at the implement by the PTO."""
    mechanism = read_mechanism(config_file(DEFAULT_MECHANISM))
    load = {"force": [force], "at": "E1.z", "at_speed": 540.0, "exponent": 2}
    excitations = excitations_from_mapping({"rotor": {"speed": "pto", "orders": [1], **load}})
    predictor = Predictor(load_table(config_file(DEFAULT_TABLE), mechanism))
    levels = LevelTable(predictor, mechanism, excitations)
    return ResonanceMonitor(excitations, limits, levels=levels)


def assessed(monitor: ResonanceMonitor, alpha3: float, speed: float, seconds: float) -> Any:
    """Return the resonance after so many seconds at an angle and a PTO speed."""
    assert monitor.rules.levels is not None
    predictor = monitor.rules.levels.predictor
    monitor.set_fixed(Source.PTO, speed)
    for k in range(round(10.0 * seconds) + 1):
        resonance = monitor.assess(predictor.predict(alpha3), 0.0, k * SECOND // 10)
    return described(resonance)


def test_the_load_ratio_grows_with_the_force_and_warns_above_its_limit() -> None:
    """The load ratio is proportional to the force; below 0.33 is a note, above it a warning."""
    small = assessed(shaken(100.0), 2.0, 540.0, 0.0)
    per_newton = float(small.load_ratio) / 100.0
    assert small.load_place in load_table(config_file(DEFAULT_TABLE)).force_places
    for share, state in ((0.329, NOTE), (0.331, WARNING), (0.0999, CLEAR), (0.1001, NOTE)):
        actual = assessed(shaken(share / per_newton), 2.0, 540.0, 1.0)
        assert actual.load_ratio == pytest.approx(share, rel=1e-6)
        assert actual.total_load_ratio == pytest.approx(share, rel=1e-6)
        assert (actual.state, actual.states.tolist()) == (state, [state])
        assert actual.load_ratio_factor == pytest.approx(small.load_ratio_factor)


def test_a_warning_names_what_ends_it() -> None:
    """At the named speed, and at the named angle, the warning is gone after the dwell time."""
    monitor = shaken(6000.0)
    actual = assessed(monitor, 2.0, 540.0, 2.0)
    assert actual.state == WARNING
    sentence = present_sentence(actual, monitor.rules.excitations)
    quiet = actual.quiet_speed * RPM
    assert f"{quiet:.0f} rpm" in sentence
    assert assessed(shaken(6000.0), 2.0, float(quiet), 2.0).state != WARNING
    assert actual.speed_source == 2  # the PTO
    assert not math.isnan(actual.quiet_speed)
    if not math.isnan(actual.quiet_angle):
        assert assessed(shaken(6000.0), float(actual.quiet_angle), 540.0, 2.0).state != WARNING
    calm = assessed(shaken(1.0), 2.0, 540.0, 2.0)
    assert math.isnan(calm.quiet_speed)
    assert math.isnan(calm.quiet_angle)


def later(monitor: ResonanceMonitor, alpha3: float, speed: float) -> Any:
    """Return the resonance 0.1 s after those of `assessed` over 2 s."""
    assert monitor.rules.levels is not None
    monitor.set_fixed(Source.PTO, speed)
    predictor = monitor.rules.levels.predictor
    return described(monitor.assess(predictor.predict(alpha3), 0.0, 21 * SECOND // 10))


def test_what_ends_a_warning_follows_the_limits_and_the_levels() -> None:
    """A new limit, or a stronger excitation, gives another quiet speed at once, as if it were new.

    Without a change, the speed is held.
    """
    for force, limits in ((6000.0, WarningLimits(warning=0.2)), (12000.0, WarningLimits())):
        monitor, other = shaken(6000.0), shaken(force, limits)
        held = assessed(monitor, 2.0, 540.0, 2.0).quiet_speed
        assert later(monitor, 2.0, 540.0 + 1e-3).quiet_speed == held
        monitor.use(limits, other.rules.levels)
        expected = assessed(other, 2.0, 540.0, 2.0)
        actual = later(monitor, 2.0, 540.0)
        assert (actual.quiet_speed, actual.load_ratio_factor) == (
            expected.quiet_speed,
            expected.load_ratio_factor,
        )
        assert expected.quiet_speed != held


def test_what_ends_a_warning_is_sought_again_once_it_is_passed() -> None:
    """A speed that has not reached the quiet one keeps it; one beyond it gets the next one."""
    monitor = shaken(2000.0, WarningLimits(warning=0.13))
    modes = Predictor(load_table(config_file(DEFAULT_TABLE))).predict(2.0).natural_frequencies
    speed = 60.0 * 0.99 * float(modes[HEAVE])
    held = float(assessed(monitor, 2.0, speed, 2.0).quiet_speed)
    quiet = held * RPM
    assert quiet < speed
    assert later(monitor, 2.0, quiet + 0.1).quiet_speed == held
    beyond = later(monitor, 2.0, quiet - 0.1)
    assert beyond.state == WARNING  # it lasts for the dwell time
    assert beyond.quiet_speed * RPM == pytest.approx(quiet - 0.1)  # which is quiet itself


@pytest.mark.parametrize(("factor", "direction"), [(0.99, -1), (1.04, 1)])
def test_quiet_speeds_lead_away_from_a_resonance(factor: float, direction: int) -> None:
    """Below a mode's frequency a smaller speed ends the warning, and above it a larger one."""
    modes = Predictor(load_table(config_file(DEFAULT_TABLE))).predict(2.0).natural_frequencies
    monitor = shaken(2000.0, WarningLimits(warning=0.13))
    speed = 60.0 * factor * float(modes[HEAVE])  # the rotor's order is 1
    actual = assessed(monitor, 2.0, speed, 2.0)
    assert actual.state == WARNING
    assert (actual.quiet_speed - actual.excitation_speed) * direction > 0.0
    assert (actual.excitation_index, actual.mode, actual.load_ratio_limit) == (0, HEAVE, 0.13)
