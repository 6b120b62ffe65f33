# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's process answers while it builds a table, and ends by a signal within a second."""

import re
import signal
import time
from array import array
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient

from linkage_vibration.ros import lifecycle
from linkage_vibration.ros.lifecycle import LinkageVibrationNode
from linkage_vibration_interfaces.action import SetImplement
from linkage_vibration_interfaces.srv import GetTable, PredictVibration
from test.support.ros_process import Peer, slowness, until

SOON = 1.0  # s, within which an idle machine answers everything, and ends by each signal
CANCELED, ABORTED = 5, 6  # of action_msgs/msg/GoalStatus
HEAVY = SetImplement.Goal(mass=1600.0, inertia=400.0)  # its table takes over 10 s to build
REQUESTS = {
    "get_table": (GetTable, GetTable.Request()),
    "predict": (PredictVibration, PredictVibration.Request(crank_angles=array("d", [2.0]))),
    "get_parameters": (GetParameters, GetParameters.Request(names=["joint_name"])),
    "get_state": (GetState, GetState.Request()),
}


def timed(peer: Peer, future: Any) -> tuple[Any, float]:
    """Return the result of a future, and how many seconds it took."""
    began = time.monotonic()
    until(future.done, "an answer", lambda: peer.executor.spin_once(SOON))
    return future.result(), time.monotonic() - began


def times_of_answers(peer: Peer, node: str) -> dict[str, float]:
    """Return how many seconds each of the requests takes."""
    seconds = {}
    for name, (kind, request) in REQUESTS.items():
        client = peer.node.create_client(kind, f"{node}/{name}")
        peer.request(client, request)  # both sides have found each other
        seconds[name] = timed(peer, client.call_async(request))[1]
        peer.node.destroy_client(client)
    return seconds


def test_answers_during_a_goal(start: Callable[..., Any], meet: Callable[..., Peer]) -> None:
    """While a table is built, feedback, diagnostics, services and the cancel are on time."""
    start(name="building")
    peer = meet("building")
    feedback, diagnostics = list[float](), list[float]()

    def on_diagnostics(message: DiagnosticArray) -> None:
        if message.status[0].name.startswith("/building"):
            diagnostics.append(time.monotonic())

    peer.node.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, 10)
    client: Any = ActionClient(peer.node, SetImplement, "building/set_implement")
    peer.spin(client.server_is_ready, "the action")
    peer.spin(lambda: len(diagnostics) >= 2, "diagnostics")
    before = len(diagnostics)
    goal, accepted = timed(
        peer, client.send_goal_async(HEAVY, lambda _: feedback.append(time.monotonic()))
    )
    assert goal.accepted
    peer.spin(lambda: feedback, "feedback")
    first = time.monotonic()
    seconds = {"goal": accepted, **times_of_answers(peer, "building")}
    other, _ = timed(peer, client.send_goal_async(HEAVY))
    refused, seconds["second goal"] = timed(peer, other.get_result_async())
    assert "is being built" in refused.result.message
    peer.spin(lambda: len(diagnostics) > before, "diagnostics")
    cancelled, seconds["cancel"] = timed(peer, goal.cancel_goal_async())
    # This ends once the building process has seen it, between two solutions of the model.
    ended = timed(peer, goal.get_result_async())[0]
    lasted = time.monotonic() - first
    assert len(cancelled.goals_canceling) == 1
    assert ended.status == CANCELED
    print(f"\nfor {lasted:.1f} s: {len(feedback)} x feedback, {len(diagnostics)} x diagnostics")
    print({name: round(value, 3) for name, value in seconds.items()})
    assert max(seconds.values()) < SOON * slowness(), seconds
    assert len(feedback) > lasted  # it comes four times a second
    steps = [b - a for a, b in pairwise(diagnostics)]
    assert len(steps) >= 2
    assert max(steps) < 1.0 + SOON * slowness()


@pytest.mark.parametrize("when", ["soon", "late", "asked"])
def test_goal_has_a_result_when_the_node_ends(
    start: Callable[..., Any], meet: Callable[..., Peer], when: str
) -> None:
    """A client whose goal is running when SIGTERM arrives learns that its table is not in use.

    That may be soon after the goal, while the process that builds the table still imports modules,
    or before the client asks for the result. This process ends, too.
    """
    node = start(name="leaving")
    peer = meet("leaving")
    feedback = list[object]()
    client: Any = ActionClient(peer.node, SetImplement, "leaving/set_implement")

    def read_until(done: Callable[[], object], event: str) -> None:
        """Wait with readings, as the node warns of a hitch that sends none for 5 s."""

        def read() -> None:
            peer.publish()
            peer.pause(0.5, done)

        until(done, event, read)

    read_until(client.server_is_ready, "the action")
    sent = client.send_goal_async(HEAVY, feedback.append)
    read_until(sent.done, "the answer to a goal")
    future = None if when == "late" else sent.result().get_result_async()
    if when != "soon":
        read_until(lambda: feedback, "feedback")
    building = every_child(node.process.pid)
    node.process.send_signal(signal.SIGTERM)
    if future is None:
        time.sleep(0.6)
        future = sent.result().get_result_async()
    read_until(future.done, "the result of a goal")
    result = future.result()
    assert result.status == ABORTED
    assert "The table is unchanged" in result.result.message
    assert node.stop() == 0
    assert set(re.findall(r"\[(\w+)\] \[", node.printed)) == {"INFO"}, node.printed
    assert building or when == "soon"
    ended = lambda: not any(Path(f"/proc/{child}").exists() for child in building)  # noqa: E731
    until(ended, "the end of the building process")


def every_child(pid: int) -> list[int]:
    """Return the children of every thread of a process."""
    lists = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for file in lists for child in file.read_text().split()]


BLOCKED = """
import sys, time
from rclpy.executors import SingleThreadedExecutor
from linkage_vibration.ros import spinning
from linkage_vibration.ros.node import main

spinning.END_LIMIT = 3.0
shutdown = SingleThreadedExecutor.shutdown

def block_the_end(*args, **options):
    time.sleep({seconds})
    return shutdown(*args, **options)

SingleThreadedExecutor.shutdown = block_the_end
sys.exit(main())
"""


@pytest.mark.nightly(short="test_requests_that_keep_waiting_delay_the_end_by_a_second")
@pytest.mark.parametrize(("seconds", "code"), [(0.5, 0), (3600.0, 1)])
def test_end_that_is_blocked(start: Callable[..., Any], seconds: float, code: int) -> None:
    """After the limit of its end, here 3 s, the process says where it is blocked, and ends."""
    program = "-c", BLOCKED.format(seconds=seconds)
    node = start(name=f"blocked_{code}", program=program)
    node.wait_for("Predicting for")
    assert node.stop() == code
    assert ("in block_the_end" in node.printed) == bool(code)


def test_requests_that_keep_waiting_delay_the_end_by_a_second() -> None:
    """A request that takes no answer, as by a fault of the middleware, is left after 1 s."""
    offered: Any = SimpleNamespace(refuse=lambda: None, busy=True)
    executor: Any = SimpleNamespace(spin_once=lambda _: time.sleep(0.02))
    began = time.monotonic()
    LinkageVibrationNode.answer_waiting(SimpleNamespace(_offered=offered), executor)
    assert 1.0 <= time.monotonic() - began < 1.0 + SOON * slowness()


def test_a_turn_rests_in_proportion_to_its_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """The processor time of a turn counts while readings are used, and none otherwise."""
    rests = list[float]()
    monkeypatch.setattr(lifecycle, "rest", rests.append)

    def work() -> None:
        end = time.thread_time() + 0.02
        while time.thread_time() < end:
            pass

    executor: Any = SimpleNamespace(spin_once=work)
    for active in (True, False):
        node: Any = SimpleNamespace(_listener=SimpleNamespace(active=active))
        LinkageVibrationNode.serve(node, executor)
    assert rests == [pytest.approx(0.02, rel=0.2)]
