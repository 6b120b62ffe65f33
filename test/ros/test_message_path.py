# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The path of a message in the node with a clock of its own: what waits too long is left out."""

from collections import Counter
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from linkage_vibration.messages.topics import PREDICTION
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.ros import message_path
from linkage_vibration.ros.live_inputs import live_topics
from linkage_vibration.ros.message_path import LONGEST_WAIT, Predicting
from linkage_vibration.ros.statistics import Statistics
from linkage_vibration.support.resources import PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table
from test.support.ros_process import JOINT

START = 1_700_000_000.0  # s


class Bench:
    """A path of messages whose clock is set by hand."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now, self.number = 100.0, 0
        self.statistics, self.recorded = Statistics(), list[bytes]()
        clock = SimpleNamespace(
            monotonic=lambda: self.now, time_ns=lambda: round(1e9 * (START + self.now))
        )
        monkeypatch.setattr(message_path, "time", clock)
        topic = SimpleNamespace(publish=lambda data: None, topic_name="/answer")
        node = SimpleNamespace(
            get_clock=lambda: SimpleNamespace(ros_time_is_active=False),
            get_publishers_info_by_topic=lambda topic: [],
            count_publishers=lambda topic: 1,
        )
        listener = SimpleNamespace(subscribe=self._subscribe, lost=Counter)
        throttle = SimpleNamespace(warn=lambda *_: None, report=lambda *_: None)
        self.path = Predicting(
            *(node, listener, {PREDICTION: topic}, Parameters()),  # type: ignore[arg-type]
            live_topics(Parameters(), lambda name: f"/{name}"),
            Predictor(load_table(config_file(PAPER_TABLE))),
            ResonanceMonitor(read_excitations(Parameters().excitation_path())),
            None,
            lambda name, data, *_: self.recorded.append(data),
            self.statistics,
            throttle,  # type: ignore[arg-type]
        )
        self.path.subscribe()

    def _subscribe(self, kind: Any, topic: str, on_message: Any, depth: int) -> None:
        if kind is JointState:
            self._on_message = on_message

    def give(self, wait: float, age: float = 0.0, joint: str = JOINT) -> None:
        """Give a reading with an age (s) at its arrival, which waited (s)."""
        self.number += 1
        arrived = round(1e9 * (START + self.now - wait))
        message = JointState(name=[joint], position=[2.0])
        stamp = divmod(arrived - round(1e9 * age), 10**9)
        message.header.stamp.sec, message.header.stamp.nanosec = stamp
        info = {
            "source_timestamp": arrived,
            "received_timestamp": arrived,
            "publication_sequence_number": self.number,
        }
        self._on_message(serialize_message(message), info)

    def faults(self) -> str:
        """Return the sentences about the readings of the last second."""
        self.now += 0.1
        self.path.judge(self.now)
        return " ".join(fault.sentence for fault in self.path.reading_faults)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    """Return a path of messages."""
    return Bench(monkeypatch)


@pytest.mark.parametrize(("wait", "left_out"), [(LONGEST_WAIT - 0.01, 0), (LONGEST_WAIT + 0.01, 9)])
def test_newer_readings_are_preferred(bench: Bench, wait: float, left_out: int) -> None:
    """Of readings that waited for too long, two a second are answered; others are not recorded."""
    for _ in range(10):
        bench.now += 0.01
        bench.give(wait)
    assert bench.statistics.dropped == left_out
    assert bench.statistics.predicted == len(bench.recorded) == 10 - left_out
    bench.give(0.0)  # the newest one
    assert bench.statistics.predicted == 11 - left_out
    assert bench.statistics.wait == pytest.approx(wait)


def test_a_slow_sensor_is_answered(bench: Bench) -> None:
    """Nothing newer waits if the readings come once in 2 s."""
    for _ in range(3):
        bench.now += 2.0
        bench.give(1.5)
    assert (bench.statistics.predicted, bench.statistics.dropped) == (3, 0)


@pytest.mark.parametrize(("wait", "age"), [(20.0, 0.0), (0.0, 20.0)])
def test_a_backlog_is_no_fault_of_clocks(bench: Bench, wait: float, age: float) -> None:
    """Only a reading that was old when it arrived has a clock that is wrong."""
    bench.give(wait, age)
    assert ("synchronise" in bench.faults()) == (age > 0.0)


def test_gaps_are_counted(bench: Bench) -> None:
    """Numbers that are missing between messages are counted for their topic."""
    bench.give(0.0)
    bench.number, bench.now = bench.number + 3, bench.now + 0.1
    bench.give(0.0)
    assert bench.statistics.lost == {"/joint_states": 3}


def test_readings_that_stop(bench: Bench) -> None:
    """What is said depends on what arrived: nothing, no joint, or readings that have ended."""
    bench.now += 2.0
    assert "for 2.1 s. /joint_states has no publisher; start it" in bench.faults()
    bench.give(0.0, joint="boom")
    assert "has no joint hitch_rockshaft_joint; it has boom" in bench.faults()
    bench.give(0.0)
    assert "not received" not in bench.faults()
    bench.now += 1.3
    assert "for 1.5 s. /joint_states has no publisher" in bench.faults()
