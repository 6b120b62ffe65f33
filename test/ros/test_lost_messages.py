# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A stopped node counts the messages that it cannot take; no other publisher is in this module."""

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from linkage_vibration.playback.replay import replay
from test.ros.test_faults import Tractor
from test.ros.test_same_bytes import PREDICTION
from test.support.messages import raw_messages
from test.support.ros_process import until


def test_lost_messages(
    start: Callable[..., Any], meet: Callable[[str], Any], tmp_path: Path
) -> None:
    """Each message that a stopped node cannot take is counted, and the log has equal answers."""
    node = start(name="flooded", record=True, log_directory=tmp_path)
    tractor = Tractor(meet("flooded"), tmp_path, "flooded")

    def counts() -> tuple[int, ...]:
        tractor.received.clear()
        tractor.peer.spin(lambda: [s for s in tractor.received if s.values], "diagnostics")
        [values] = [{v.key: v.value for v in s.values} for s in tractor.received if s.values]
        lost, left_out = (
            values[name].removeprefix("/joint_states ")
            for name in ("messages lost", "messages left out")
        )
        numbers = values["messages received"], lost, values["predictions"], left_out
        return tuple(map(int, numbers))

    def publish(_: int = 0) -> None:
        nonlocal published
        tractor.say(2.0)
        published += 1

    count = tractor.peer.node.count_publishers
    tractor.peer.spin(lambda: count("/joint_states") == 1, "the end of earlier publishers")
    before, published = sum(counts()[:2]), 0
    node.process.send_signal(signal.SIGSTOP)
    for _ in range(6000):
        publish()
    node.process.send_signal(signal.SIGCONT)
    tractor.wait_for("input", DiagnosticStatus.WARN, "messages of /joint_states were lost", publish)
    assert not any("synchronise" in status.message for status in tractor.received)

    def all_counted() -> bool:
        publish()
        return sum(counts()[:2]) == before + published

    until(all_counted, "the count of every message")
    received, lost, predicted, left_out = counts()
    assert lost > 0
    assert node.stop() == 0
    [log] = tmp_path.glob("*.mcap")
    again = tmp_path / "again.mcap"
    # On a busy machine, old readings are left out for newer ones.
    assert replay(log, again).predictions == predicted == received - left_out
    answers = raw_messages(log, "/flooded/prediction"), raw_messages(again, PREDICTION)
    assert [each[1:] for each in answers[0]] == [each[1:] for each in answers[1]]
