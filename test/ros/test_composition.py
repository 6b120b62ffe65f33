# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node in an executor of somebody else predicts, answers and reports as in its own process."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import GetState
from rclpy.action import ActionClient

from linkage_vibration_interfaces.action import SetImplement
from test.support.ros_process import Peer, RunningNode, start_node

COMPOSED = """
import sys
import rclpy
from rclpy.executors import {executor}
from linkage_vibration.ros.lifecycle import LinkageVibrationNode

if __name__ == "__main__":  # the process that builds a table imports this file
    rclpy.init(args=sys.argv)
    executor = {executor}()
    executor.add_node(rclpy.create_node("other", use_global_arguments=False))
    executor.add_node(LinkageVibrationNode())
    executor.spin()
"""


SINGLE = pytest.param("SingleThreadedExecutor", marks=pytest.mark.nightly)


@pytest.fixture(params=["MultiThreadedExecutor", SINGLE])
def composed(
    request: pytest.FixtureRequest, environment: dict[str, str], tmp_path: Path
) -> Iterator[tuple[RunningNode, str]]:
    """Return a node beside another one in an executor, and its name."""
    name, script = request.param.lower(), tmp_path / "composed.py"
    script.write_text(COMPOSED.format(executor=request.param))
    output = tmp_path / "printed.txt"
    node = start_node(output, environment, name=name, program=[str(script)])
    yield node, name
    node.process.kill()
    node.process.wait()


def test_composed_node(composed: tuple[RunningNode, str], meet: Callable[..., Peer]) -> None:
    """It starts by itself, predicts, reports every second, and answers while it builds a table."""
    _, name = composed
    peer, received = meet(name), list[Any]()

    def keep(message: DiagnosticArray) -> None:
        received.extend(s for s in message.status if s.name == f"/{name}: predictions")

    peer.node.create_subscription(DiagnosticArray, "/diagnostics", keep, 10)
    for _ in range(60):
        peer.publish()
        peer.pause(0.02)
    peer.spin(lambda: len(received) >= 3, "diagnostics")
    last = peer.publish()
    peer.spin(lambda: peer.predictions[-1].header.stamp.nanosec == last, "the last prediction")
    assert len(peer.predictions) == 61
    client: Any = ActionClient(peer.node, SetImplement, f"{name}/set_implement")
    peer.spin(client.server_is_ready, "the action")
    feedback: list[Any] = []
    wanted = SetImplement.Goal(mass=1600.0, inertia=400.0)
    sent = client.send_goal_async(wanted, feedback.append)
    peer.spin(sent.done, "the goal")
    peer.spin(lambda: feedback, "feedback")
    assert peer.call([2.0]).success
    state = peer.node.create_client(GetState, f"{name}/get_state")
    assert peer.request(state, GetState.Request()).current_state.label == "active"
    before = len(received)
    peer.spin(lambda: len(received) >= before + 2, "diagnostics while the table is built")
    cancelled = sent.result().cancel_goal_async()
    peer.spin(cancelled.done, "the cancel")
    result = sent.result().get_result_async()
    peer.spin(result.done, "the end of the goal")
    assert not result.result().result.success
