# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The path of a message in the node with a clock of its own: what waits too long is left out."""

import math
import re
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from linkage_vibration.messages.topics import LOAD_STATE, OUTPUT_TOPICS
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.health import Level
from linkage_vibration.prediction.levels import kept_levels
from linkage_vibration.prediction.predictor import Predictor, Status
from linkage_vibration.prediction.resonance import ResonanceMonitor
from linkage_vibration.prediction.settings import Parameters, with_values
from linkage_vibration.prediction.severity import ResonanceState, Unknown
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.ros import arrivals, live_pipeline
from linkage_vibration.ros.live_inputs import live_topics
from linkage_vibration.ros.live_pipeline import LivePipeline
from linkage_vibration.ros.statistics import Statistics
from linkage_vibration.support.resources import (
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    PAPER_TABLE,
    config_file,
)
from linkage_vibration.table.table import load_table
from linkage_vibration_interfaces.msg import LoadState as LoadStateMessage
from test.support.ros_process import JOINT

PACKAGE = Path(live_pipeline.__file__).parents[1]
START = 1_700_000_000.0  # s


class Bench:
    """A path of messages whose clock is set by hand."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, table: str = PAPER_TABLE) -> None:
        self.now, self.numbers = 100.0, Counter[str]()
        self.statistics, self.recorded, self.times = Statistics(), list[str](), list[int]()
        self.queues = dict[str, list[tuple[bytes, dict[str, int]]]]()
        self._callbacks = dict[str, Any]()
        self.publishers: list[Any] = []
        clock = SimpleNamespace(
            monotonic=lambda: self.now, time_ns=lambda: round(1e9 * (START + self.now))
        )
        for module in (live_pipeline, arrivals):
            monkeypatch.setattr(module, "time", clock)
        self.published = list[str]()  # types
        outputs = {
            kind: SimpleNamespace(
                publish=lambda _, kind=kind: self.published.append(kind), topic_name="/answer"
            )
            for kind in [output.type for output in OUTPUT_TOPICS]
        }
        node = SimpleNamespace(
            get_clock=lambda: SimpleNamespace(ros_time_is_active=False),
            get_publishers_info_by_topic=lambda topic: self.publishers,
            get_subscriptions_info_by_topic=lambda topic: [],
            count_publishers=lambda topic: 1,
        )
        self.mismatches: dict[str, list[str]] = {}
        listener = SimpleNamespace(
            subscribe=self._subscribe, lost=Counter, unmatched=lambda: self.mismatches
        )
        self.warned = list[str]()
        throttle = SimpleNamespace(
            warn=lambda key, _: self.warned.append(key), report=lambda *_: None
        )
        self.topics = live_topics(Parameters(), lambda name: f"/{name}")
        predictor = Predictor(load_table(config_file(table)))
        self.monitor = ResonanceMonitor(
            read_excitations(Parameters().excitation_path()), rate=Parameters().resonance_rate
        )
        self.path = LivePipeline(
            *(node, listener, outputs, Parameters()),  # type: ignore[arg-type]
            self.topics,
            predictor,
            self.monitor,
            None,
            self._record,
            self.statistics,
            throttle,  # type: ignore[arg-type]
        )
        self.path.subscribe()

    def _subscribe(self, kind: Any, topic: str, on_message: Any) -> Any:
        queue = self.queues[topic] = list[tuple[bytes, dict[str, int]]]()
        self._callbacks[topic] = on_message
        take = SimpleNamespace(take_message=lambda *_: queue.pop(0) if queue else None)
        return SimpleNamespace(handle=take, msg_type=kind)

    def _record(self, topic: str, data: bytes, received: int, *_: Any) -> None:
        self.recorded.append(topic)
        self.times.append(received)

    def spin(self) -> None:
        """Announce the messages that wait, those that arrived first before the others."""
        order = [(info["received_timestamp"], t) for t, q in self.queues.items() for _, info in q]
        for _, topic in sorted(order):
            if self.queues[topic]:  # what has gone is announced, too, but not found
                self._callbacks[topic](*self.queues[topic].pop(0))

    def put_speed(self, wait: float, value: float = 1500.0, topic: str = "/engine_speed") -> None:
        """Let a speed wait (s) in its queue."""
        self._put(topic, Float64(data=value), wait)

    def give(self, wait: float, age: float = 0.0, joint: str = JOINT) -> None:
        """Give a reading with an age (s) at its arrival, which waited (s)."""
        self.put(wait, age, joint)
        self.spin()

    def put(
        self,
        wait: float,
        age: float = 0.0,
        joint: str = JOINT,
        position: float = 2.0,
        since: float = math.inf,
    ) -> None:
        """Let a reading with an age (s) at its arrival wait (s) in its queue.

        Its stamp is not later than the time ``since``, s.
        """
        arrived = round(1e9 * (START + self.now - wait))
        message = JointState(name=[joint] * bool(joint), position=[position])
        latest = arrived if math.isinf(since) else round(1e9 * (START + since))
        stamp = divmod(min(arrived, latest) - round(1e9 * age), 10**9)
        message.header.stamp.sec, message.header.stamp.nanosec = stamp
        self._put("/joint_states", message, wait)

    def _put(self, topic: str, message: Any, wait: float) -> None:
        self.numbers[topic] += 1
        arrived = round(1e9 * (START + self.now - wait))
        info = {
            "source_timestamp": arrived,
            "received_timestamp": arrived,
            "publication_sequence_number": self.numbers[topic],
        }
        self.queues[topic].append((serialize_message(message), info))

    def faults(self) -> str:
        """Return the sentences about the readings of the last second."""
        self.now += 0.1
        self.path.judge(self.now)
        return " ".join(fault.sentence for fault in self.path.reading_faults)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    """Return a path of messages."""
    return Bench(monkeypatch)


def test_speeds_follow_the_same_rule(bench: Bench) -> None:
    """The newest reading is answered with the newest speeds, and in the order of arrival."""
    for i in range(5):
        bench.put(0.2 - 0.04 * i)  # the newest one waited for 0.04 s
        bench.put_speed(0.19 - 0.04 * i)  # and for 0.03 s
    bench.put_speed(0.045, topic="/pto_speed")
    bench.put_speed(0.035, topic="/pto_speed")
    bench.spin()
    assert bench.statistics.dropped == {"/joint_states": 4, "/engine_speed": 4}
    expected = ["/pto_speed", "/joint_states", "/pto_speed", "/engine_speed"]
    assert bench.recorded == expected
    now = round(1e9 * (START + bench.now))
    assert [now - time for time in bench.times] == pytest.approx([45e6, 40e6, 35e6, 30e6], abs=500)


def test_times_in_the_log_do_not_go_back(bench: Bench) -> None:
    """A thread of the middleware may pass on later what another received before."""
    bench.give(0.01)
    bench.put_speed(0.02)
    bench.spin()
    assert bench.times[0] == bench.times[1]
    bench.now -= 3600.0  # the clock was set back
    bench.give(0.01)
    assert bench.times[2] == round(1e9 * (START + bench.now))


@pytest.mark.parametrize(("wait", "named"), [(0.04, True), (0.06, False)])
def test_a_busy_machine_is_no_fault_of_the_sensor(bench: Bench, wait: float, named: bool) -> None:
    """The rate of readings is not judged in a second in which the node leaves some out."""
    for bursts, size in [(50, 1)] * 4 + [(5, 5)] * 2:  # 50 readings a second, and then 25
        for _ in range(bursts):
            bench.now += 0.9 / bursts
            for i in range(size):
                bench.put(wait - 0.001 * i)
            bench.spin()
        faults = bench.faults()
    assert ("Hz instead of" in faults) == named


@pytest.mark.parametrize("simulated", [False, True])
@pytest.mark.parametrize(("wait", "age"), [(20.0, 0.0), (0.0, 20.0)])
def test_a_backlog_is_no_fault_of_clocks(
    bench: Bench, wait: float, age: float, simulated: bool
) -> None:
    """Only a reading that was old when it arrived has a clock that is wrong."""
    path: Any = bench.path
    if simulated:
        now = SimpleNamespace(nanoseconds=round(1e9 * (START + bench.now)))
        path._clock = SimpleNamespace(ros_time_is_active=True, now=lambda: now)
    bench.give(wait, age)
    assert ("synchronise" in bench.faults()) == (age > 0.0)


@pytest.mark.parametrize(("readings", "messages"), [(1, 1), (6, 1), (11, 2), (26, 3)])
def test_windows_of_readings(bench: Bench, readings: int, messages: int) -> None:
    """Of readings each 10 ms, the first one is published, and then one in each 100 ms."""
    bench.put_speed(0.0)
    bench.spin()
    bench.now += 0.101
    for _ in range(readings):
        bench.give(0.0)
        bench.now += 0.01
    counts = [kind for kind in bench.published if kind == LOAD_STATE]
    assert len(counts) == messages
    assert bench.statistics.predicted == readings
    assert bench.path.resonance is not None
    assert int(bench.path.resonance.count) == messages


def test_other_threads_see_a_whole_assessment(bench: Bench) -> None:
    """Whenever the diagnostics look, the last assessment has a state with a name."""
    seen, kind = list[bool](), type(bench.path)

    class Watched(kind):  # type: ignore[misc, valid-type]
        def __setattr__(self, name: str, value: Any) -> None:
            super().__setattr__(name, value)
            if name == "resonance" and value is not None:
                seen.append(isinstance(value.state, ResonanceState))

    bench.path.__class__ = Watched
    test_windows_of_readings(bench, 11, 2)
    assert seen == [True, True]


def publisher(kind: str) -> SimpleNamespace:
    """Return what the graph says of a publisher."""
    return SimpleNamespace(node_name="arm", topic_type=kind)


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
    bench.give(0.0, joint="boom")
    assert "It came before; check its sender. /joint_states has no joint hitch" in bench.faults()


def test_names_are_limited(bench: Bench) -> None:
    """Of many nodes that share a topic, the names of a thousand joints are kept."""
    for k in range(1001):
        bench.give(0.0, joint=f"joint {k}")
    assert len(bench.path._other_names) == 1000


@pytest.mark.parametrize(
    ("status", "named"), [(Status.OUT_OF_RANGE, True), (Status.NEAR_TOGGLE, False)]
)
def test_an_angle_near_a_toggle_is_in_the_table(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, status: Status, named: bool
) -> None:
    """Only angles that the table does not have raise the fault that they are outside."""
    predict = Predictor.predict
    monkeypatch.setattr(
        Predictor, "predict", lambda *given: replace(predict(*given), status=status)
    )
    for _ in range(20):
        bench.now += 0.1
        bench.give(0.0)
    assert ("check hitch_sign, hitch_scale" in bench.faults()) == named


def test_names_expire(bench: Bench) -> None:
    """The joints of a topic on which nothing arrives any more are not named for more than 3 s."""
    bench.publishers = [publisher("sensor_msgs/msg/JointState")]
    bench.now += 2.0
    bench.give(0.0, joint="boom")
    assert "it has boom" in bench.faults()
    bench.now += 2.8
    assert "it has boom" in bench.faults()
    bench.now += 0.1
    words = "Nothing has arrived from the publishers of /joint_states (arm) for 3 s, although"
    assert words in bench.faults()


def test_a_sensor_is_silent_after_5_s(bench: Bench) -> None:
    """What it measured is then no longer shown."""
    sample: Any = SimpleNamespace()
    bench.path.measured = {"imu": (bench.now, sample)}
    for pause, kept in ((4.8, True), (0.1, False)):
        bench.now += pause
        bench.faults()
        assert ("imu" in bench.path.measured) is kept


def test_publishers_that_cannot_be_received(bench: Bench) -> None:
    """Another type or QoS of the publishers is named as the cause only if it is one."""
    bench.publishers = [publisher("std_msgs/msg/String")]
    bench.now += 2.0
    words = "The publishers of /joint_states (arm) send std_msgs/msg/String, not sensor_msgs/msg/J"
    assert words in bench.faults()
    bench.publishers += [publisher("sensor_msgs/msg/JointState")]
    assert "although one has the right type and QoS" in bench.faults()
    bench.mismatches = {"/joint_states": ["The QoS of arm."], "/pto_speed": ["That of pto."]}
    faults = bench.faults()
    assert faults.count("The QoS of arm.") == faults.count("That of pto.") == 1
    assert "although" not in faults
    bench.give(0.0)
    assert bench.faults() == "The QoS of arm. That of pto."


def test_a_sensor_that_stopped_is_not_one_without_joints(bench: Bench) -> None:
    """Once nothing arrives any more, nothing is said about what the messages before contained."""
    bench.publishers = [publisher("sensor_msgs/msg/JointState")]
    bench.give(0.0)
    bench.faults()
    for _ in range(5):
        bench.now += 1.0
        faults = bench.faults()
        assert "at all" not in faults
    assert "Nothing has arrived from the publishers of /joint_states (arm) for 5 s" in faults


def test_joint_states_without_names(bench: Bench) -> None:
    """Positions without names are said to have none, also after readings."""
    bench.give(0.0)
    bench.faults()
    bench.now += 2.0
    bench.give(0.0, joint="")
    assert "has 0 names but 1 elements in position, so the one of hitch" in bench.faults()


def test_a_joint_that_never_comes_is_logged(bench: Bench) -> None:
    """A warning in the log names it after 5 s of messages without it, and none before."""
    for warned, steps in ((False, 24), (True, 2)):  # of 0.2 s
        for _ in range(steps):
            bench.now += 0.1
            bench.give(0.0, joint="other")
            bench.faults()
        assert ("missing" in bench.warned) is warned


def test_readings_that_are_left_out_are_no_fault_of_the_sensor(bench: Bench) -> None:
    """A sensor at 100 Hz of which the node leaves out most has no fault itself."""
    for _ in range(5):
        for _ in range(100):
            bench.now += 0.009
            bench.give(0.0)
        assert bench.faults() == ""
    for _ in range(5):
        for _ in range(5):
            for _ in range(20):
                bench.now += 0.009
                bench.put(0.0)
            bench.spin()
        assert bench.faults() == ""
    assert bench.statistics.dropped["/joint_states"] > 300
    for _ in range(3):
        for _ in range(50):
            bench.now += 0.018
            bench.give(0.0)
        faults = bench.faults()
    assert "The readings come at 50.0 Hz instead of 100.0 Hz" in faults


def test_speeds_may_arrive_one_after_the_other(bench: Bench) -> None:
    """One that has not arrived so soon after the start is no warning."""
    bench.put_speed(0.0)
    bench.spin()
    bench.faults()
    assert bench.path.speed_faults[-1].level is Level.STALE


@pytest.mark.parametrize(
    ("wait", "why"), [(0.49, "check its publisher"), (0.51, "messages wait for the node")]
)
def test_a_speed_that_waits_has_not_stopped(bench: Bench, wait: float, why: str) -> None:
    """Messages that wait for more than half a second may have a later speed."""
    bench.put_speed(0.0)
    bench.spin()
    bench.now += 1.5
    bench.statistics.wait = wait
    bench.faults()
    assert f"stopped 1.6 s ago; {why}" in bench.path.speed_faults[0].sentence


def test_speeds_that_did_not_arrive(bench: Bench) -> None:
    """Until a speed that an excitation needs has arrived, `speeds` is not OK."""
    for pause, level in ((0.1, Level.STALE), (2.0, Level.STALE)):
        bench.now += pause
        bench.faults()
        [fault] = bench.path.speed_faults
        assert fault.level is level
        words = "The engine speed on /engine_speed, PTO speed on /pto_speed, ground speed on /grou"
        assert fault.sentence.startswith(words)
    bench.put_speed(0.0, topic="/engine_speed")
    bench.spin()
    bench.faults()
    assert bench.path.speed_faults[-1].level is Level.WARN  # as one speed has arrived
    values = dict.fromkeys(("engine_speed", "ground_speed"), 0.0)
    bench.path.apply(with_values(Parameters(), values), bench.topics)
    bench.faults()
    [fault] = bench.path.speed_faults
    assert fault.level is Level.WARN
    assert fault.sentence.startswith("The PTO speed on /pto_speed did not arrive in the ")
    bench.path.excitations = tuple(
        each for each in bench.path.excitations if each.source is not Source.PTO
    )
    bench.faults()
    assert bench.path.speed_faults == []


@pytest.mark.parametrize("apart", [0.0, 0.1])
def test_a_doubt_survives_a_parameter(bench: Bench, apart: float) -> None:
    """While publishers disagree, the angle stays unknown at the first reading after a new limit."""
    bench.put_speed(0.0)
    for i in range(10):
        bench.now += 0.05
        bench.put(0.0, position=2.0 + apart * (i % 2))
        bench.spin()
    assert bench.path.resonance is not None
    assert bool(bench.path.resonance.unknown_sources & Unknown.CRANK_ANGLE) == bool(apart)
    bench.path.apply(with_values(Parameters(), {"warning_load_ratio": 0.2}), bench.topics)
    bench.now += 0.1
    bench.put(0.0)
    bench.spin()
    assert bench.path.resonance.load_ratio_limit == pytest.approx(0.2)
    assert bool(bench.path.resonance.unknown_sources & Unknown.CRANK_ANGLE) == bool(apart)


@pytest.mark.parametrize(
    ("step", "stamps_move", "unknown_after"),
    [(0.05, True, 1.05), (0.05, False, 1.05), (0.9, True, None)],
)
def test_a_clock_that_stands(
    bench: Bench, step: float, stamps_move: bool, unknown_after: float | None
) -> None:
    """Once the time on /clock has stood for a second, each load state is unknown until it moves.

    It stands from 2 to 6 s, or comes in steps of 0.9 s, which are no standing. The stamps of the
    readings go on, or stand as well, so that there is one load state in a second, with the time of
    the clock.
    """
    states, stamps, sim = list[tuple[float, int]](), list[tuple[int, int]](), [0]
    path, began = bench.path, bench.now
    fixed = {"pto_speed": 0.0, "ground_speed": 0.0, "engine_speed": 1500.0}
    path.apply(with_values(Parameters(), fixed), bench.topics)
    clock = SimpleNamespace(
        ros_time_is_active=True, now=lambda: SimpleNamespace(nanoseconds=sim[0])
    )

    def on_state(data: bytes) -> None:
        message = deserialize_message(data, LoadStateMessage)
        states.append((bench.now - began, message.state))
        stamp = message.header.stamp
        if message.state == LoadStateMessage.STATE_UNKNOWN:
            stamps.append((stamp.sec * 10**9 + stamp.nanosec, sim[0]))

    monkey: Any = path
    monkey._clock = clock
    monkey._outputs[LOAD_STATE] = on_state, "/load_state"
    for i in range(1, 161):
        bench.now = began + 0.05 * i
        elapsed = bench.now - began
        stands = unknown_after is not None and 2.0 < elapsed < 5.99
        if not stands:
            sim[0] = 10**18 + round(1e9 * step * int(elapsed / step + 1e-6))
        bench.put(0.0, since=began + 2.0 if stands and not stamps_move else math.inf)
        bench.spin()
        if i % 20 == 0:
            path.judge(bench.now)
    unknown = [at for at, state in states if state == LoadStateMessage.STATE_UNKNOWN]
    if unknown_after is None:
        assert unknown == []
        assert len(states) > 50
        return
    assert unknown[0] == pytest.approx(2.0 + unknown_after, abs=1.0)
    between = [state for at, state in states if unknown[0] <= at < unknown[-1]]
    assert set(between) == {LoadStateMessage.STATE_UNKNOWN}
    assert unknown[-1] == pytest.approx(6.0, abs=1.05)
    assert (len(unknown) > 20) == stamps_move
    assert stamps_move or all(stamp == time for stamp, time in stamps)
    assert states[-1][1] != LoadStateMessage.STATE_UNKNOWN


@pytest.mark.parametrize(("span", "jumps"), [(3.1, True), (2.0 * math.pi, False)])
def test_only_a_crank_that_turns_may_be_fast(bench: Bench, span: float, jumps: bool) -> None:
    """A step of 1 rad in 0.1 s is a jump of a hitch, whose range is less than half a turn."""
    table = bench.path.predictor.table
    turning = replace(table, alpha3=np.linspace(1.0, 1.0 + span, len(table.alpha3)))
    bench.path.predictor = Predictor(turning)
    bench.path.subscribe()
    for i in range(10):
        bench.now += 0.1
        bench.put(0.0, position=2.0 + (i > 5))
        bench.spin()
    assert ("jump by up to" in bench.faults()) == jumps


def test_the_largest_message(bench: Bench) -> None:
    """A message of a megabyte is answered, and one byte more is refused."""
    for size, answered in ((1_000_001, 0), (1_000_000, 1)):
        bench.put(0.0)
        [(data, info)] = bench.queues["/joint_states"]
        bench.queues["/joint_states"] = [(data.ljust(size, b"\0"), info)]
        bench.spin()
        assert len(bench.recorded) == answered


def entered(call: Callable[[], None]) -> list[str]:
    """Return the files of the package that a call enters from others, in this order."""
    files, stack = list[str](), [""]

    def follow(frame: FrameType, event: str, _: object) -> None:
        path = Path(frame.f_code.co_filename)
        if event == "call":
            inside = path.is_relative_to(PACKAGE)
            stack.append(path.relative_to(PACKAGE).as_posix() if inside else stack[-1])
            if stack[-1] != stack[-2]:
                files.append(stack[-1])
        elif event == "return" and len(stack) > 1:
            stack.pop()

    sys.setprofile(follow)
    try:
        call()
    finally:
        sys.setprofile(None)
    return files


def test_walk_of_a_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    """A reading that ends a window walks through the files in the order that CONTRIBUTING tells.

    It enters each that predicts or judges at most twice, but for two of times and velocities.
    """
    bench = Bench(monkeypatch, DEFAULT_TABLE)
    mechanism = read_mechanism(config_file(DEFAULT_MECHANISM))
    # Tabulating the ground takes long.
    excitations = [replace(each, terrain=None) for each in bench.monitor.rules.excitations]
    bench.monitor.use(levels=kept_levels(bench.path.predictor, mechanism, excitations))
    walks = []
    for _ in range(12):
        bench.now += 0.02
        bench.put_speed(0.001, 2000.0)
        bench.put_speed(0.001, 540.0, "/pto_speed")
        bench.spin()
        bench.put(0.001)
        before = len(bench.published)
        files = entered(bench.spin)
        if LOAD_STATE in bench.published[before:]:
            walks.append(files)
    walk = walks[-1]
    text = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text()
    text = text.partition("## The walk")[2].partition("\n## ")[0]
    told = re.findall(r"^\d+\. `([\w/]+\.py)`", text, re.MULTILINE)
    assert len(told) == 10
    firsts = [walk.index(file) for file in told]
    assert firsts == sorted(firsts)
    often = {"prediction/motion.py": 3, "prediction/periods.py": 3}
    counts = Counter(file for file in walk if file.startswith(("prediction/", "table/")))
    assert {file: n for file, n in counts.items() if n > often.get(file, 2)} == {}
