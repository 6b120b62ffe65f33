# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the page says of measured vibration beside a log, and what it says is not known."""

from dataclasses import replace

import numpy as np
import pytest

from linkage_vibration.listening.signals import Signal
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.review.listening_page import hear, kinds
from linkage_vibration.review.log import Log, read_log
from test.listening.test_signals import sensor
from test.review.conftest import WriteLog

RATE = 200.0  # Hz


@pytest.fixture(scope="module")
def log(write_log: WriteLog, tmp_path_factory: pytest.TempPathFactory) -> Log:
    """Return a log of 40 s without faults."""
    times = np.arange(0.0, 40.0, 0.05)
    path = tmp_path_factory.mktemp("heard") / "log.mcap"
    return read_log(write_log(path, times.tolist(), (2.4 + 0.1 * np.sin(times)).tolist()))


def shaken(log: Log, start: float, end: float) -> Signal:
    """Return a signal of 10 Hz and 1 m/s2 along z, in noise, around the times of a log."""
    times = np.arange(start, log.times[-1] + end, 1.0 / RATE)
    values = np.random.default_rng(2).normal(0.0, 0.01, (len(times), 3))
    values[:, 2] += np.sin(2.0 * np.pi * 10.0 * times)
    return Signal(sensor(), times, values, RATE, ())


@pytest.mark.parametrize(("end", "kind"), [(0, 1), (1, 2)])
def test_kinds_of_work_follow_the_stroke(log: Log, end: int, kind: int) -> None:
    """A hitch that never moves works at one end of its stroke, and is raised at the other.

    Nothing is known 2 s before the log and 3 s after it, and without a speed over ground.
    """
    assert log.table is not None
    angle = np.full(len(log.times), log.table.alpha3_range[end])
    ground = {Source.GROUND: (log.times, np.full(len(log.times), 2.0))}
    signal = shaken(log, -2.0, 3.0)
    found = kinds(replace(log, crank_angle=angle, speeds=ground), signal)
    inside = (signal.times >= 0.0) & (signal.times <= log.times[-1])
    assert set(found[inside].tolist()) == {kind}
    assert set(found[~inside].tolist()) == {3}
    assert set(kinds(replace(log, crank_angle=angle), signal).tolist()) == {3}


def test_a_level_is_not_known_where_a_speed_or_the_angle_is_not(log: Log) -> None:
    """It is known inside the log; not where the engine's speed is NaN, and not outside of the log.

    A PTO that the log lacks is named, and one at rest adds nothing.
    """
    times = log.times
    known = np.where(times < 20.1, 1500.0, np.nan)
    engine = {Source.ENGINE: (times, known)}
    both = engine | {Source.PTO: (times, np.zeros(len(times)))}
    signal = shaken(log, 0.0, 8.0)
    found = [hear(replace(log, speeds=each), signal) for each in (engine, both)]
    assert [Source.PTO.value in each.unknown for each in found] == [True, False]
    for each in found:
        middle = each.orders.times
        np.testing.assert_array_equal(np.isfinite(each.predicted), middle < 20.0)
    np.testing.assert_array_equal(found[0].predicted, found[1].predicted)
