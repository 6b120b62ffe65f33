# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node under bursts, stamps out of order, clocks that jump and peers that die."""

import subprocess
import sys
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from builtin_interfaces.msg import Time
from lifecycle_msgs.srv import ChangeState, GetState
from mcap.reader import make_reader
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from linkage_vibration.prediction.predictor import Status
from test.support.messages import read_messages
from test.support.ros_process import JOINT, SENSOR, until

UNKNOWN_TYPE = ParameterMessage(name="hitch_sign", value=ParameterValue(type=77))


@pytest.fixture(scope="module")
def node(start: Callable[..., Any]) -> Any:
    """Return a node whose angle has a standard deviation of a hundredth of a radian."""
    return start(name="robust", angle_stddev=0.01)


@pytest.fixture(scope="module")
def peer(node: Any, meet: Callable[[str], Any]) -> Any:
    """Return a peer that the node has found."""
    return meet("robust")


def stamped(peer: Any, sec: int, nanosec: int, angle: float) -> None:
    """Publish a joint state with this stamp."""
    message = JointState(name=[JOINT], position=array("d", [angle]))
    message.header.stamp = Time(sec=sec, nanosec=nanosec)
    peer.publisher.publish(message)


def set_parameter(peer: Any, node: str, name: str, value: Any) -> Any:
    """Set a parameter as `ros2 param set` does, and return the result."""
    client = peer.node.create_client(SetParameters, f"{node}/set_parameters")
    parameter = Parameter(name, value=value).to_parameter_msg()
    result = peer.request(client, SetParameters.Request(parameters=[parameter]))
    peer.node.destroy_client(client)
    return result.results[0]


def test_invalid_requests_do_not_end_the_node(peer: Any, node: Any) -> None:
    """A parameter of a type that does not exist and an invalid transition are refused."""
    for kind, name, request in (
        (SetParameters, "set_parameters", SetParameters.Request(parameters=[UNKNOWN_TYPE])),
        (ChangeState, "change_state", ChangeState.Request()),
    ):
        client = peer.node.create_client(kind, f"robust/{name}")
        peer.request(client, request)
    node.wait_for(
        "A request was refused while the node is active: 77 is not a valid Parameter.Type"
    )
    node.wait_for("No transition matching 0 found")
    client = peer.node.create_client(GetState, "robust/get_state")
    assert peer.request(client, GetState.Request()).current_state.label == "active"
    assert "rcl_lifecycle.c" not in node.printed  # files of rcl tell a user nothing
    assert peer.ask([JOINT], [2.0]).status == Status.OK


def test_burst(peer: Any, node: Any) -> None:
    """As many readings as wait are answered; of a longer burst perhaps some, in order."""
    peer.predictions.clear()
    for i in range(10):
        stamped(peer, 9, i, 2.0)
    peer.spin(lambda: len(peer.predictions) == 10)
    peer.predictions.clear()
    for i in range(5000):
        stamped(peer, 10, i, 2.0)
    peer.ask()
    stamps = [p.header.stamp.nanosec for p in peer.predictions if p.header.stamp.sec == 10]
    assert stamps == sorted(stamps)
    assert node.process.poll() is None


def test_publisher_that_dies_and_returns(peer: Any, environment: dict[str, str]) -> None:
    """A killed publisher leaves nothing behind, and the next publisher is received."""
    script = (
        "import rclpy\n"
        "from array import array\n"
        "from sensor_msgs.msg import JointState\n"
        "rclpy.init()\n"
        "node = rclpy.create_node('short_lived')\n"
        "publisher = node.create_publisher(JointState, 'joint_states', 10)\n"
        f"message = JointState(name=['{JOINT}'], position=array('d', [2.25]))\n"
        "node.create_timer(0.01, lambda: publisher.publish(message))\n"
        "rclpy.spin(node)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", script], env=environment)
    try:
        peer.predictions.clear()
        peer.spin(lambda: any(p.crank_angle == 2.25 for p in peer.predictions))
    finally:
        process.kill()
        process.wait()
    assert peer.ask([JOINT], [2.0]).status == Status.OK


def test_calibration_while_active(
    start: Callable[..., Any], meet: Callable[[str], Any], tmp_path: Path
) -> None:
    """A new offset or input applies from the next message on, in a log of its own."""
    process = start(name="calibrated", record=True, log_directory=tmp_path)
    peer = meet("calibrated")
    hitch = peer.node.create_publisher(Float64, "hitch_position", SENSOR)
    for offset in (0.25, 1):
        assert set_parameter(peer, "calibrated", "hitch_offset", offset).successful
        assert peer.ask([JOINT], [1.7]).crank_angle == 1.7 + offset
    calibration = [0.0, 3.0, 50.0, 2.5, 100.0, 2.0]
    assert set_parameter(peer, "calibrated", "calibration", calibration).successful
    for _ in range(80):  # some are still queued when the node unsubscribes
        peer.publish([JOINT], [1.7])
    assert set_parameter(
        peer, "calibrated", "hitch_offset", 0.0
    ).successful  # it applies to percent too
    assert set_parameter(peer, "calibrated", "hitch_input", "percent").successful

    def publish() -> None:
        hitch.publish(Float64(data=50.0))
        peer.pause(0.2)

    until(lambda: any(p.crank_angle == 2.5 for p in peer.predictions), "a percent", publish)
    assert process.stop() == 0
    offsets = set()
    for path in tmp_path.iterdir():
        with path.open("rb") as file:
            attached = {a.name: a.data for a in make_reader(file).iter_attachments()}
        settings = yaml.safe_load(attached["parameters.yaml"])["/calibrated"]["ros__parameters"]
        positions = [message.position[0] for _, message in read_messages(path, "/joint_states")]
        angles = [m.crank_angle for _, m in read_messages(path, "/calibrated/prediction")]
        if settings["hitch_input"] == "joint_states" and positions:
            assert angles == [position + settings["hitch_offset"] for position in positions]
            offsets.add(settings["hitch_offset"])
    assert offsets == {0.0, 0.25, 1.0}
