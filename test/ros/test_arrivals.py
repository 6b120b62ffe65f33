# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Which messages of a queue are used, by hand, and when they were received."""

import time
from collections import Counter
from types import SimpleNamespace

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from linkage_vibration.prediction.settings import Parameters, with_values
from linkage_vibration.ros import arrivals
from linkage_vibration.ros.arrivals import Arrival, arrival, in_time, waiting
from linkage_vibration.ros.live_inputs import LiveTopic, live_topics
from test.support.ros_process import JOINT

ENGINE = {"engine_topic": "s", "engine_type": "sensor_msgs/JointState"}
TOPICS = live_topics(
    with_values(
        Parameters(), {"hitch_topic": "s", **ENGINE, "engine_field": "velocity[crankshaft]"}
    ),
    lambda name: f"/{name}",
)
SHARED, PTO = TOPICS["/s"], TOPICS["/pto_speed"]
NOW = 1_700_000_000 * 10**9  # ns


def joints(*names: str) -> bytes:
    """Return a joint state with positions and velocities of joints."""
    numbers = [1.9] * len(names)
    return bytes(serialize_message(JointState(name=names, position=numbers, velocity=numbers)))


CONTENT = {
    "h": joints(JOINT),  # the hitch
    "e": joints("crankshaft"),  # the engine
    "b": joints("crankshaft", JOINT),  # both
    "o": joints("boom"),  # others
    "x": b"\x00\x01",  # damaged
}


def arrived(topic: LiveTopic, data: bytes, wait: float) -> Arrival:
    """Return a message that has waited, s."""
    return Arrival(topic, data, {}, NOW - round(1e9 * wait), wait)


@pytest.mark.parametrize(
    ("given", "used"),
    [
        ("h", "h"),  # the newest one, however long it waited
        ("hhh", "__h"),
        ("heheh", "___eh"),  # the newest of each of two publishers, in order of arrival
        ("eheehh", "___e_h"),
        ("ehb", "__b"),
        ("bhe", "_he"),
        ("bh", "bh"),  # the engine has no newer speed
        ("hohx", "_ohx"),  # what has no number is reported, and hides no number
        ("ohe", "_he"),  # what is older than all numbers is not looked at
        ("oxo", "oxo"),
    ],
)
@pytest.mark.parametrize("wait", [0.06, 20.0])
def test_newest_of_each_input(given: str, used: str, wait: float) -> None:
    """Of messages that all waited for too long, the newest for each input is used."""
    messages = [arrived(SHARED, CONTENT[kind], wait) for kind in given]
    left_out = Counter[str]()
    expected = [message for message, kind in zip(messages, used, strict=True) if kind != "_"]
    assert list(in_time(messages, 0.0, left_out)) == expected
    assert left_out.total() == left_out["/s"] == used.count("_")


@pytest.mark.parametrize("answering", [0.0, 0.03])
@pytest.mark.parametrize(("oldest", "left_out"), [(0.049, 0), (0.051, 1), (0.061, 2), (0.2, 3)])
def test_limit_of_a_wait(
    monkeypatch: pytest.MonkeyPatch, oldest: float, left_out: int, answering: float
) -> None:
    """What is answered in time is used, and so is the newest number of each input."""
    monkeypatch.setattr(arrivals, "time", SimpleNamespace(monotonic=lambda: 7.0))
    oldest -= answering
    messages = [arrived(SHARED, CONTENT["b"], oldest - 0.01 * i) for i in range(4)]
    messages.append(arrived(PTO, b"\x00\x01\x00\x00" + bytes(8), 0.03))
    counts = Counter[str]()
    assert list(in_time(messages, answering, counts)) == messages[left_out:]
    assert counts == ({"/s": left_out} if left_out else {})


def test_a_wait_continues_while_others_are_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    """With 12 ms for each answer, what waits for more than 50 ms by then is left out."""
    now = [7.0]
    monkeypatch.setattr(arrivals, "time", SimpleNamespace(monotonic=lambda: now[0]))
    messages = [arrived(SHARED, CONTENT["b"], 0.049 - 0.001 * i) for i in range(9)]
    counts, used = Counter[str](), list[Arrival]()
    for message in in_time(messages, 0.0, counts):
        used.append(message)
        now[0] += 0.012
    assert used == [messages[0], messages[8]]
    assert counts == {"/s": 7}


@pytest.mark.parametrize(
    ("seconds_ago", "wait"),
    [
        (0.3, 0.3),
        (86_399.0, 86_399.0),  # the process was stopped for a night
        (86_401.0, 0.0),  # the clock was set by years while the message waited
        (-0.1, 0.0),  # the clock was set back
        (1_700_000_000.0, 0.0),  # the middleware gives no time
    ],
)
def test_time_of_receipt(monkeypatch: pytest.MonkeyPatch, seconds_ago: float, wait: float) -> None:
    """The time of receipt is the middleware's, or now if that is not plausible."""
    monkeypatch.setattr(arrivals, "time", SimpleNamespace(time_ns=lambda: NOW))
    message = arrival(SHARED, b"", {"received_timestamp": NOW - round(1e9 * seconds_ago)})
    assert message.wait == pytest.approx(wait)
    assert NOW - message.received == round(1e9 * wait)


def test_queue_is_emptied() -> None:
    """All that waits is taken as bytes, in its order."""
    info = {"received_timestamp": time.time_ns()}
    queue = [(b"1", info), (b"2", info)]
    asked = []

    def take(kind: type, raw: bool) -> tuple[bytes, dict[str, int]] | None:
        asked.append((kind, raw))
        return queue.pop(0) if queue else None

    subscription = SimpleNamespace(handle=SimpleNamespace(take_message=take), msg_type=JointState)
    assert [each.data for each in waiting(SHARED, subscription)] == [b"1", b"2"]
    assert asked == 3 * [(JointState, True)]
