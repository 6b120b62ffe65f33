# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's process while its wall clock is set back or forward by an hour."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient

from linkage_vibration_interfaces.action import SetImplement
from test.support.messages import read_messages
from test.support.ros_process import Peer, RunningNode, slowness, start_node
from test.support.shifted_clock import ShiftedClock, shifted_clock

HOUR = 3600.0
# Only a step back can make a wait last, and only where no message ends it.
BACK = pytest.param(-HOUR, id="back")
NIGHTLY_FORWARD = pytest.param(HOUR, id="forward", marks=pytest.mark.nightly)
SOON = 1.0  # s, by which an idle machine is late at most, and within which a signal ends the node


@contextmanager
def clocked_node(
    environment: dict[str, str], folder: Path, name: str, **parameters: Any
) -> Iterator[tuple[RunningNode, ShiftedClock]]:
    """Give a node whose wall clock can be set."""
    clock = shifted_clock(folder)
    output = folder / "printed.txt"
    node = start_node(output, environment | clock.environment, name=name, **parameters)
    try:
        yield node, clock
    finally:
        node.process.kill()
        node.process.wait()


def watched(peer: Peer, name: str) -> list[tuple[float, Any]]:
    """Return a list that receives the times, s, and the first status of a node's diagnostics."""
    statuses: list[tuple[float, Any]] = []

    def keep(message: DiagnosticArray) -> None:
        if message.status[0].name.startswith(f"/{name}:"):
            statuses.append((time.monotonic(), message.status[0]))

    peer.node.create_subscription(DiagnosticArray, "/diagnostics", keep, 10)
    peer.spin(lambda: len(statuses) > 1, "diagnostics")
    return statuses


def check_jump(statuses: list[tuple[float, Any]]) -> None:
    """Check that diagnostics came every second, and that one of them reports one jump."""
    steps = [b - a for a, b in pairwise(at for at, _ in statuses)]
    counts = [next(v.value for v in s.values if v.key == "clock jumps") for _, s in statuses]
    print(f"\ndiagnostics: {len(statuses)}, at most {max(steps, default=0.0):.2f} s apart")
    assert max(steps) < 1.0 + SOON * slowness(), steps
    assert (counts[0], counts[-1]) == ("0", "1")


def ends(node: RunningNode) -> None:
    """Check that SIGINT ends a node cleanly and soon."""
    began = time.monotonic()
    assert node.stop() == 0
    lasted = time.monotonic() - began
    print(f"SIGINT: {lasted:.2f} s at {slowness():.1f}")
    assert lasted < SOON * slowness()


@pytest.mark.parametrize("ahead", [BACK, NIGHTLY_FORWARD])
def test_while_nothing_arrives(
    environment: dict[str, str], tmp_path: Path, meet: Callable[..., Peer], ahead: float
) -> None:
    """An idle node, which no message wakes, keeps its rhythm, and a signal ends it."""
    name = "idle_back" if ahead < 0.0 else "idle_forward"
    with clocked_node(environment, tmp_path, name) as (node, clock):
        peer = meet(name)
        statuses = watched(peer, name)
        peer.pause(2.5)  # the reading of the meeting is old
        clock.set(ahead)
        peer.pause(3.0)
        check_jump(statuses)
        ends(node)


@pytest.mark.nightly(short="test_while_nothing_arrives")
@pytest.mark.parametrize("ahead", [-HOUR, HOUR], ids=["back", "forward"])
def test_while_it_predicts_records_and_builds(
    environment: dict[str, str], tmp_path: Path, meet: Callable[..., Peer], ahead: float
) -> None:
    """Readings are predicted and recorded, and a goal's feedback comes, across the jump."""
    name = "busy_back" if ahead < 0.0 else "busy_forward"
    logged = {"record": True, "log_directory": tmp_path}
    with clocked_node(environment, tmp_path, name, **logged) as (node, clock):
        peer, feedback = meet(name), list[float]()
        statuses = watched(peer, name)
        client: Any = ActionClient(peer.node, SetImplement, f"{name}/set_implement")
        peer.spin(client.server_is_ready, "the action")
        wanted = SetImplement.Goal(mass=1600.0, inertia=400.0)
        sent = client.send_goal_async(wanted, lambda _: feedback.append(time.monotonic()))
        peer.spin(sent.done, "the goal")
        peer.spin(lambda: feedback, "feedback")
        first = peer.stamp + 1
        for part in range(100):
            if part == 30:
                clock.set(ahead)
                jumped = time.monotonic()
            last = peer.publish()
            peer.pause(0.05)
        peer.spin(lambda: peer.predictions[-1].header.stamp.nanosec == last, "the last prediction")
        answered = {p.header.stamp.nanosec for p in peer.predictions}
        after = [at for at in feedback if at > jumped]
        print(f"\nanswered: {len(answered)}, feedback after the jump: {len(after)}")
        assert answered >= set(range(first, last + 1))
        assert len(after) >= 2
        cancelled = sent.result().cancel_goal_async()
        peer.spin(cancelled.done, "the cancel")
        check_jump(statuses)
        result = sent.result().get_result_async()
        peer.spin(result.done, "the end of the goal")
        ends(node)
    recorded = {  # in two logs, if the table was ready before the cancel
        message.header.stamp.nanosec
        for log in tmp_path.glob("*.mcap")
        for _, message in read_messages(log, f"/{name}/prediction")
    }
    assert recorded >= set(range(first, last + 1))
