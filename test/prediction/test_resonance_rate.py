# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Which readings are assessed, and which of a window is published, by stamps that are written here.

The states are those of margins: the only mode is at 10 Hz, and the order 1 of an engine is near it
at 600 rpm, and not at 300 rpm.
"""

from itertools import permutations

import numpy as np
import pytest

from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.motion import Rate
from linkage_vibration.prediction.periods import Windows, WindowStep
from linkage_vibration.prediction.predictor import Prediction, Predictor, Status
from linkage_vibration.prediction.resonance import Header, ResonanceMonitor, rows_of, window_headers
from linkage_vibration.prediction.severity import WINDOW_RANKS, ResonanceState, WarningLimits
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import (
    DEFAULT_EXCITATIONS,
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    config_file,
)
from linkage_vibration.table.table import load_table

MS = 10**6  # ns
UNKNOWN, CLEAR, NOTE, WARNING = ResonanceState
RPM = {UNKNOWN: np.nan, CLEAR: 300.0, NOTE: 600.0}
ONE = np.array([10.0])
PREDICTION = Prediction(2.0, Status.OK, ONE, 0.01 * ONE, 0.0 * ONE, 0.0 * ONE, 0, 0, 0, "t", ONE)
Readings = list[tuple[int, float]]  # stamps, ms, and rpm
Published = list[tuple[int, int, int]]  # stamps of the closing reading and of the message; states


def monitor(rate: float = 10.0) -> ResonanceMonitor:
    """Return a monitor with a rate, Hz, that has a speed."""
    watch = ResonanceMonitor([Excitation("engine 1", Source.ENGINE, 1.0 / 60.0)], rate=rate)
    watch.set_fixed(Source.ENGINE, RPM[CLEAR])
    return watch


def steps(rate: float, milliseconds: list[int]) -> str:
    """Return what each reading does: a letter for those that wait, close, or close alone."""
    windows = Windows(rate)
    return "".join("-wca"[windows.step(stamp * MS)] for stamp in milliseconds)


@pytest.mark.parametrize(
    ("rate", "milliseconds", "expected"),
    [
        (10.0, [0, 10, 19, 20, 39, 40, 60, 80, 90, 100], "a--w-www-c"),  # periods begin at 0
        (10.0, [7, 27, 47, 67, 87, 107, 127], "awwwwcw"),
        (10.0, [95, 105, 195, 205], "acwc"),
        (10.0, [0, 100, 200], "acc"),  # a slow input does not wait
        (10.0, [0, 101, 202], "aaa"),
        (10.0, [0, 33, 67, 100, 133], "awwcw"),
        (10.0, [0, 40, 140], "awc"),  # no gap
        (10.0, [0, 40, 141], "awa"),
        (2.0, [0, 99, 100, 400, 500], "a-wwc"),
        (0.0, [0, 1, 1, 2], "cccc"),  # each
        (10.0, [40, 40, 40, 60, 60], "a--w-"),  # equal stamps
        (10.0, [1000, 1020, 500, 501, 520], "awa-w"),  # the clock jumps back,
        (10.0, [1040, 1000], "aw"),  # within a period,
        (10.0, [1019, 1001], "a-"),  # or within a part of it
    ],
)
def test_steps(rate: float, milliseconds: list[int], expected: str) -> None:
    """Five readings of a period are assessed, and the first of the next one ends the window."""
    assert steps(rate, milliseconds) == expected


def test_another_rate_while_running() -> None:
    """A rate that is changed holds from the next reading on."""
    windows = Windows(10.0)
    assert [windows.step(0), windows.step(MS)] == [WindowStep.ALONE, WindowStep.LEFT_OUT]
    windows.rate = 0.0
    assert [windows.step(2 * MS), windows.step(3 * MS)] == [WindowStep.CLOSES] * 2


def live(readings: Readings) -> Published:
    """Return what is published of readings that arrive one by one, as in the node."""
    watch, published = monitor(), Published()
    for stamp, rpm in readings:
        watch.set_fixed(Source.ENGINE, rpm)
        windows = take(watch, stamp)
        if windows is not None:
            each = zip(windows.nanosec.tolist(), windows.state.tolist(), strict=True)
            published += [(stamp, *message) for message in each]
    return published


def take(
    watch: ResonanceMonitor, stamp: int, prediction: Prediction = PREDICTION
) -> MessageColumns | None:
    """Give a monitor a reading with a stamp, ms; return the messages that it publishes."""
    step = watch.windows.step(stamp * MS)
    if step is WindowStep.LEFT_OUT:
        return None
    header = Header(0, stamp, "", stamp, False, step)
    return watch.take(prediction, Rate(0.0, 0.0), stamp * MS, header)


def in_blocks(readings: Readings, size: int) -> Published:
    """Return what is published of blocks of so many assessed readings, as in a replay.

    Here the natural frequency is in the other ratio to that of the engine.
    """
    watch, published = monitor(), Published()
    every = [(stamp, rpm, watch.windows.step(stamp * MS)) for stamp, rpm in readings]
    assessed = [each for each in every if each[2] is not WindowStep.LEFT_OUT]
    for start in range(0, len(assessed), size):
        block = assessed[start : start + size]
        rows = rows_of([PREDICTION] * len(block))
        rows.natural_frequencies = np.array([[10.0 * RPM[CLEAR] / rpm] for _, rpm, _ in block])
        stamps, zero = np.array([stamp for stamp, *_ in block]), np.zeros(len(block))
        headers = window_headers([Header(0, s, "", s, False, step) for s, _, step in block])
        windows = watch.assess_many(rows, zero, stamps * MS, (), zero, headers)
        ends = stamps[windows.ends_at].tolist()
        published += zip(ends, windows.nanosec.tolist(), windows.state.tolist(), strict=True)
    return published


def published(readings: Readings) -> Published:
    """Return what is published, which is the same one by one and in blocks of any size."""
    one_by_one = live(readings)
    assert one_by_one == in_blocks(readings, 1) == in_blocks(readings, 4) == in_blocks(readings, 99)
    return one_by_one


def at_50_hz(*states: ResonanceState) -> Readings:
    """Return readings from 0 on with these states."""
    return [(20 * k, RPM[state]) for k, state in enumerate(states)]


def test_the_most_severe_of_a_window_is_published() -> None:
    """Its stamp is that of its reading, and the state of the last one follows if it differs."""
    first = (0, 0, CLEAR)
    readings = at_50_hz(CLEAR, CLEAR, NOTE, CLEAR, CLEAR, CLEAR)
    assert published(readings) == [first, (100, 40, NOTE), (100, 100, CLEAR)]
    readings = at_50_hz(CLEAR, CLEAR, CLEAR, CLEAR, CLEAR, NOTE)
    assert published(readings) == [first, (100, 100, NOTE)]
    assert published(at_50_hz(*[CLEAR] * 6)) == [first, (100, 100, CLEAR)]
    assert published(at_50_hz(*[CLEAR] * 5)) == [first]  # nothing has ended the window


def test_not_known_is_never_clear() -> None:
    """A window with readings that are not known and clear ones is not clear; a note is worse."""
    first = (0, 0, CLEAR)
    readings = at_50_hz(CLEAR, CLEAR, UNKNOWN, CLEAR, CLEAR, CLEAR)
    assert published(readings) == [first, (100, 40, UNKNOWN), (100, 100, CLEAR)]
    readings = at_50_hz(CLEAR, CLEAR, CLEAR, CLEAR, CLEAR, UNKNOWN)
    assert published(readings) == [first, (100, 100, UNKNOWN)]
    readings = at_50_hz(CLEAR, UNKNOWN, NOTE, UNKNOWN, NOTE, NOTE)
    assert published(readings) == [first, (100, 100, NOTE)]
    readings = at_50_hz(CLEAR, UNKNOWN, NOTE, CLEAR, UNKNOWN, UNKNOWN)
    assert published(readings) == [first, (100, 40, NOTE), (100, 100, UNKNOWN)]
    order = sorted(ResonanceState, key=lambda state: WINDOW_RANKS[state])
    assert order == [CLEAR, UNKNOWN, NOTE, WARNING]


def test_of_the_same_state_the_nearest_or_the_latest() -> None:
    """Where no load is known, the smallest margin counts, and of equal ones the latest."""
    speeds = [300.0, 300.0, 350.0, 400.0, 380.0, 300.0]
    readings = [(20 * k, speed) for k, speed in enumerate(speeds)]
    assert published(readings)[1:] == [(100, 60, CLEAR)]
    readings[4] = 80, 400.0
    assert published(readings)[1:] == [(100, 80, CLEAR)]


@pytest.mark.parametrize("later", [5000, -5000])
def test_readings_before_a_gap_have_a_message_of_their_own(later: int) -> None:
    """It comes late, with their stamp, and does not hide the state after a gap or a jump."""
    readings = [*at_50_hz(CLEAR, NOTE, NOTE), (later, RPM[CLEAR]), (later + 20, RPM[CLEAR])]
    expected = [(0, 0, CLEAR), (later, 40, NOTE), (later, later, CLEAR)]
    assert published(readings) == expected


@pytest.mark.parametrize("later", [5000, -5000])
@pytest.mark.parametrize("state", [CLEAR, UNKNOWN])
def test_no_all_clear_is_late(state: ResonanceState, later: int) -> None:
    """What waits before a gap or a jump is published late if it is not known, and not if clear."""
    readings = [*at_50_hz(CLEAR, state, CLEAR), (later, RPM[CLEAR])]
    waited = [(later, 20, UNKNOWN)] if state is UNKNOWN else []
    assert published(readings) == [(0, 0, CLEAR), *waited, (later, later, CLEAR)]


@pytest.mark.parametrize("step", [10, 20])
@pytest.mark.parametrize(("before", "after"), [*permutations([UNKNOWN, CLEAR, NOTE], 2)])
def test_changes_are_published_within_120_ms(
    step: int, before: ResonanceState, after: ResonanceState
) -> None:
    """Any change at any time of a window, at 50 or 100 Hz, to a worse or a better state."""
    for change in range(1000, 1100, step):
        stamps = range(900 + step // 2, 1250, step)
        messages = live([(at, RPM[before if at < change else after]) for at in stamps])
        assert 0 <= min(at for at, _, state in messages if state == after) - change <= 120


def test_messages_are_counted() -> None:
    """The counter counts messages, not readings, and begins again with a log, without a window."""
    watch = monitor()
    for _ in range(2):
        counts = list[int]()
        for stamp in range(0, 500, 20):
            windows = take(watch, stamp)
            if windows is not None:
                counts += windows.count.tolist()
                assert windows.nanosec.tolist() == [stamp]  # none of those before the restart
        assert counts == [1, 2, 3, 4, 5]
        watch.restart()


@pytest.fixture(scope="module")
def rotor() -> Excitation:
    """Return an excitation of the package whose amplitude is known."""
    every = read_excitations(config_file(DEFAULT_EXCITATIONS))
    return next(each for each in every if each.load and each.source is Source.PTO)


@pytest.fixture(scope="module")
def levels(rotor: Excitation) -> LevelTable:
    """Return its levels."""
    predictor = Predictor(load_table(config_file(DEFAULT_TABLE)))
    return LevelTable(predictor, read_mechanism(config_file(DEFAULT_MECHANISM)), [rotor])


def test_readings_of_another_table_are_forgotten(levels: LevelTable) -> None:
    """After a change of the table no message has numbers of the one before."""
    watch, ones = monitor(), np.ones(12)
    other = Prediction(2.0, Status.OK, ones, ones, ones, ones, 0, 0, 0, "other", ones)
    for stamp in [0, 20, 40, 60, 80]:
        if stamp == 60:
            watch.use(levels=levels)
        take(watch, stamp, PREDICTION if stamp < 60 else other)
    windows = take(watch, 100, other)
    assert windows is not None
    assert (windows.table_id, len(windows)) == ("other", 1)


@pytest.mark.parametrize(("dwell", "state"), [(0.17, WARNING), (0.19, NOTE)])
def test_dwell_counts_readings(
    rotor: Excitation, levels: LevelTable, dwell: float, state: ResonanceState
) -> None:
    """A limit that is exceeded from 20 ms on is exceeded for 180 ms at 200 ms.

    The first message above it has a later stamp, that of 100 ms.
    """
    limits = WarningLimits(warning=1e-9, note=1e-10, dwell=dwell)
    watch, states = ResonanceMonitor([rotor], limits, levels=levels, rate=10.0), list[int]()
    prediction = Predictor(load_table(config_file(DEFAULT_TABLE))).predict(2.0)
    for stamp in range(0, 220, 20):
        watch.set_fixed(Source.PTO, 540.0 if stamp else 0.0)
        windows = take(watch, stamp, prediction)
        states += [] if windows is None else windows.state.tolist()
    assert states == [CLEAR, NOTE, state]
