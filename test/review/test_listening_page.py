# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the page says of measured vibration beside a log, and what it says is not known."""

from dataclasses import replace

import numpy as np
import pytest

from linkage_vibration.listening.signals import Signal
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.review.listening_page import kinds
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
