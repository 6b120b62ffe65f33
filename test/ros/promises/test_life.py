# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the node promises about its lifecycle, its end and its start, in each condition."""

import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from mcap.reader import make_reader
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from linkage_vibration.prediction.predictor import Status
from linkage_vibration_interfaces.srv import PredictVibration
from test.support.conditions import Promised, promise
from test.support.ros_process import LIMIT, RunningNode, installed_command

CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
NOT_STARTED = "a node that does not start has no services, and reads nothing"
NO_SERVICE = "a node that is not configured has no action"


@pytest.fixture(scope="module")
def node(begin: Callable[..., Promised]) -> Promised:
    """Return a node that starts by itself."""
    return begin("living")


def change(node: Promised, transition: int) -> bool:
    """Ask the node for a transition, and return whether it succeeded."""
    asked = Transition(id=transition)
    return bool(node.ask("change_state", ChangeState, transition=asked).success)


def state(node: Promised) -> int:
    """Return the state of the node."""
    return int(node.ask("get_state", GetState).current_state.id)


@promise("node.md#lifecycle")
def test_fulfilled(node: Promised) -> None:
    """A node that starts by itself answers a request to configure or activate it as fulfilled."""
    for transition in (CONFIGURE, ACTIVATE):
        assert change(node, transition)
    assert state(node) == State.PRIMARY_STATE_ACTIVE
    assert not change(node, CLEANUP)  # an active node has to be deactivated first
    assert node.peer.ask().status == Status.OK


@promise("node.md#lifecycle")
def test_inactive(node: Promised) -> None:
    """An inactive node answers services and predicts no reading; an active one predicts."""
    assert change(node, DEACTIVATE)
    assert state(node) == State.PRIMARY_STATE_INACTIVE
    assert node.ask("predict", PredictVibration, crank_angles=[2.0]).success
    node.peer.predictions.clear()
    for _ in range(20):
        node.peer.publish()
        node.peer.pause(0.02)
    assert not node.peer.predictions
    assert change(node, ACTIVATE)
    assert node.peer.ask().status == Status.OK


@promise("node.md#lifecycle", goal=NO_SERVICE)
def test_managed(begin: Callable[..., Promised]) -> None:
    """Without autostart a manager configures the node, also once a problem has been fixed.

    The publishers, except those of the diagnostics and the lifecycle, exist while it is configured.
    """
    managed = begin("managed", autostart=False, mechanism_file="/none.yaml", reads=False)

    def published() -> set[str]:
        by_node = managed.peer.node.get_publisher_names_and_types_by_node("managed", "/")
        return {name for name, _ in by_node if name.startswith("/managed/")}

    assert published() <= {"/managed/transition_event"}
    assert not change(managed, CONFIGURE)
    assert "/none.yaml: cannot be opened" in managed.node.printed
    fixed = Parameter("mechanism_file", value="").to_parameter_msg()
    assert managed.ask("set_parameters", SetParameters, parameters=[fixed]).results[0].successful
    assert change(managed, CONFIGURE)
    managed.peer.spin(lambda: "/managed/prediction" in published(), "the publisher of predictions")
    assert change(managed, ACTIVATE)
    assert managed.peer.ask().status == Status.OK
    assert change(managed, DEACTIVATE)
    assert change(managed, CLEANUP)
    managed.peer.spin(lambda: "/managed/prediction" not in published(), "the end of publishers")
    assert managed.stop() == 0


@promise("node.md#lifecycle")
@pytest.mark.parametrize(
    "by", [signal.SIGINT, signal.SIGHUP, pytest.param(signal.SIGTERM, marks=pytest.mark.nightly)]
)
def test_signals(begin: Callable[..., Promised], tmp_path: Path, by: signal.Signals) -> None:
    """SIGINT, SIGTERM and SIGHUP stop the node with exit code 0 and a complete log."""
    ending = begin(f"ended_{by.name.lower()}", record=True, log_directory=tmp_path)
    ending.peer.ask()
    assert ending.stop(by) == 0
    assert {line.split()[0] for line in ending.node.printed.splitlines()} <= {"[INFO]", "[WARN]"}
    [log] = tmp_path.glob("*.mcap")
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count > 0


REFUSED = {
    "-p hitch_sign:=3": "Parameter hitch_sign must be 1 or -1, not 3",
    "-p qos_overrides./joint_state.subscription.depth:=3": "did you mean qos_overrides./joint_stat",
}


@promise("node.md#parameters", goal=NOT_STARTED, kilohertz=NOT_STARTED)
@pytest.mark.parametrize("arguments", REFUSED)
def test_refused_start(start: Callable[..., RunningNode], arguments: str) -> None:
    """At the start, an invalid value or an unknown parameter ends the node with exit code 1."""
    failed = start(*arguments.split(), name="failed")
    assert failed.process.wait(LIMIT) == 1
    assert REFUSED[arguments] in failed.printed.splitlines()[-1]


@promise("node.md#parameters", goal=NOT_STARTED, kilohertz=NOT_STARTED)
def test_file_for_another_node(start: Callable[..., RunningNode], tmp_path: Path) -> None:
    """The node does not start if no params file has parameters for it."""
    path = tmp_path / "other.yaml"
    path.write_text("other: {ros__parameters: {joint_name: arm}}")
    failed = start("--params-file", str(path), name="failed")
    assert failed.process.wait(LIMIT) == 1
    assert f"{path} has no parameters for the node" in failed.printed


@promise("start_the_node.md#start-it", goal=NOT_STARTED, kilohertz=NOT_STARTED)
def test_help(environment: dict[str, str]) -> None:
    """The option --help lists the parameters."""
    command = [str(installed_command()), "--help"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0
    assert "\n  joint_name\n" in done.stdout


@promise("node.md#parameters")
def test_qos_overrides(begin: Callable[..., Promised]) -> None:
    """The QoS of inputs and outputs can be overridden at the start."""
    node = begin(
        "tuned",
        "-p",
        "qos_overrides./joint_states.subscription.reliability:=reliable",
        "-p",
        "qos_overrides./tuned/prediction.publisher.durability:=transient_local",
        reads=False,  # the joint states of the tests are best effort
    )

    def profile(infos: Callable[[str], list[Any]], topic: str) -> Any:
        own = lambda: [e for e in infos(topic) if e.node_name.startswith("tuned")]  # noqa: E731
        node.peer.spin(own, f"the endpoint of {topic}")
        return own()[0].qos_profile

    inputs = profile(node.peer.node.get_subscriptions_info_by_topic, "/joint_states")
    outputs = profile(node.peer.node.get_publishers_info_by_topic, "/tuned/prediction")
    assert inputs.reliability.name == "RELIABLE"
    assert outputs.durability.name == "TRANSIENT_LOCAL"
    assert node.stop() == 0
