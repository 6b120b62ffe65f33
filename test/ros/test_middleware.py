# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the node keeps, offers and accepts beside its numbers: memory, QoS, YAML, and a manager."""

import os
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter, get_parameter_value, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from linkage_vibration.prediction.inputs.sources import MAX_BYTES
from linkage_vibration.prediction.predictor import Status
from test.support.ros_process import JOINT, SENSOR, Peer, RunningNode, until

MIDDLE = "/middle/prediction.publisher"
OVERRIDES = {
    "/engine_speed.subscription.reliability": "reliable",
    "/engine_speed.subscription.depth": 3,
    f"{MIDDLE}.durability": "transient_local",
}


@pytest.fixture(scope="module")
def node(start: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> RunningNode:
    """Return a node with other QoS for an input and an output."""
    path = tmp_path_factory.mktemp("middleware") / "params.yaml"
    overrides = {f"qos_overrides.{name}": value for name, value in OVERRIDES.items()}
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": overrides}}))
    return start("--params-file", str(path), name="middle")


@pytest.fixture(scope="module")
def peer(node: RunningNode, meet: Callable[[str], Peer]) -> Peer:
    """Return a peer that the node has found."""
    return meet("middle")


def done(peer: Peer, future: Any) -> Any:
    """Return the result of a request."""
    peer.spin(future.done, "a response")
    return future.result()


def test_own_parameters_are_loaded_again(peer: Peer, tmp_path: Path) -> None:
    """A dump as `ros2 param dump` writes it is accepted by rclpy's `ros2 param load`.

    A joint whose name is a number can be set, and a changed QoS is refused.
    """
    client = AsyncParameterClient(peer.node, "/middle")
    assert client.wait_for_services(120.0)
    listed = done(peer, client.list_parameters()).result.names
    values = done(peer, client.get_parameters(listed)).values
    dump: dict[str, Any] = {}
    for name, value in zip(listed, values, strict=True):
        *above, last = name.split(".")
        inside = dump
        for part in above:
            inside = inside.setdefault(part, {})
        plain = parameter_value_to_python(value)
        inside[last] = list(plain) if isinstance(plain, array) else plain
    assert dump["qos_overrides"]["/engine_speed"]["subscription"]["depth"] == 3
    path = tmp_path / "middle.yaml"
    path.write_text(yaml.dump({"/middle": {"ros__parameters": dump}}, default_flow_style=False))
    results = done(peer, client.load_parameter_file(str(path))).results
    assert len(results) == len(listed)
    assert [result.reason for result in results if not result.successful] == []

    def set_as_a_shell(name: str, text: str) -> Any:
        message = Parameter(name, value=0).to_parameter_msg()
        message.value = get_parameter_value(text)
        return done(peer, client.set_parameters([message])).results[0]

    assert get_parameter_value("123").type == ParameterType.PARAMETER_INTEGER
    assert set_as_a_shell("joint_name", "123").successful
    assert peer.ask(["123"], [2.25]).crank_angle == 2.25
    assert set_as_a_shell("joint_name", JOINT).successful
    assert "must be none or lz4 or zstd" in set_as_a_shell("compression", "off").reason
    refused = set_as_a_shell(f"qos_overrides.{MIDDLE}.durability", "volatile")
    assert "is read at the start" in refused.reason


def test_large_messages_are_refused(peer: Peer, node: RunningNode) -> None:
    """Joint states of 2 MB are refused and counted, and the memory holds a few of them only.

    Each has other names. While a node parsed them and kept 1000, those of 25 s took 1 GB.
    """
    count = -(-2 * MAX_BYTES // 24)
    names = [JOINT, *(f"joint_{i:07}" for i in range(count - 1))]
    large = serialize_message(JointState(name=names, position=array("d", [2.0] * count)))
    before = resident(node)
    publisher = peer.node.create_publisher(JointState, "joint_states", SENSOR)
    until(publisher.get_subscription_count, "a subscription to the joint states")
    for sent in range(60):
        publisher.publish(large.replace(b"joint_00000", b"joint_%05d" % (7 * sent)))
        peer.executor.spin_once(0.02)
    node.wait_for(f"bytes was refused; an input may have {MAX_BYTES}")
    assert peer.ask([JOINT], [2.0]).status == Status.OK
    assert resident(node) - before < 60e6
    peer.node.destroy_publisher(publisher)


def resident(node: RunningNode) -> int:
    """Return how many bytes of a node's process are in use in memory."""
    pages = Path(f"/proc/{node.process.pid}/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")
