# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of ros2_control and ROS2ISOBUS, over DDS and in bags, with the manual's parameters."""

import math
import os
from array import array
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import TwistStamped
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState

from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.settings import Parameters, with_values
from linkage_vibration.testing.bag_checks import check_bag
from linkage_vibration.testing.limits import Limits
from linkage_vibration_interfaces.msg import LoadState, VibrationPrediction
from test.support.interface_packages import built_package, environment_with, import_here
from test.support.messages import raw_messages
from test.support.ros_process import JOINT, RunningNode, documented, own_context, start_node, until

ISOBUS = documented("start_the_node.md", "engine_input: ros2_isobus")
SETTINGS = with_values(Parameters(), ISOBUS)
CONTROL = documented("start_the_node.md", "rear_pto_joint")
DEFINITIONS = {
    "IsobusFrame": (
        "uint8 priority\nbool page\nuint32 pgn\nuint8 sa\nuint8 pf\nuint8 ps\nuint8[8] data\n"
    ),
    "TecuRearHitchStatus": "float64 position_percent\nuint8 in_work\nfloat64 draft_n\n",
    "TecuRearPtoStatus": "float64 rpm\nfloat64 setpoint_rpm\nuint8 engagement\n",
    "TecuGroundSpeed": "float64 speed_ms\nfloat64 distance_m\nbool forward\n",
}
TYPES = {
    "bus_rx_frames": "IsobusFrame",
    "tecu/rear_pto_status": "TecuRearPtoStatus",
    "tecu/ground_speed": "TecuGroundSpeed",
    "tecu/rear_hitch_status": "TecuRearHitchStatus",
}


@pytest.fixture
def isobus_node(environment: dict[str, str], tmp_path: Path) -> Iterator[RunningNode]:
    """Return a node that records and finds ros2_isobus, which this process can import as well."""
    prefix = built_package("ros2_isobus", DEFINITIONS)
    import_here(prefix)
    variables, parameters = environment_with(environment, prefix), ISOBUS | {"record": True}
    output = tmp_path / "printed.txt"
    node = start_node(output, variables, name="foreign", **parameters, log_directory=tmp_path)
    yield node
    node.process.kill()
    node.process.wait()


@pytest.mark.nightly(short="test_messages_of_ros2_control")
def test_isobus_over_dds_and_in_a_bag(
    isobus_node: RunningNode, domain: int, tmp_path: Path
) -> None:
    """Presets read the messages; "not available" is no value; a replay gives the same bytes."""
    node = isobus_node
    node.wait_for("Predicting for field position_percent on /ISOBUS/tecu/rear_hitch_status")
    predictions, states = list[Any](), list[Any]()
    with own_context(domain) as context:
        tractor = rclpy.create_node("tractor", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(tractor)
        types = import_module("ros2_isobus.msg")
        publishers = {
            topic: tractor.create_publisher(getattr(types, kind), f"/ISOBUS/{topic}", 10)
            for topic, kind in TYPES.items()
        }
        tractor.create_subscription(
            VibrationPrediction, "/foreign/prediction", predictions.append, 99
        )
        tractor.create_subscription(LoadState, "/foreign/load_state", states.append, 99)

        def send(percent: float, rpm: float, speed: float, done: Callable[[], object]) -> None:
            """Publish a moment of the drive until something is done."""

            def publish() -> None:
                engine = bytes([0xFF, 0xFF, 0xFF, *(8 * 1800).to_bytes(2, "little"), *bytes(3)])
                other = {"pgn": 61443, "pf": 0xF0, "ps": 3, "data": [*bytes(8)]}
                sent = [
                    {"pgn": 61444, "pf": 0xF0, "ps": 4, "data": [*engine]},
                    {"rpm": rpm},
                    {"speed_ms": speed},
                    {"position_percent": percent},
                ]
                publishers["bus_rx_frames"].publish(types.IsobusFrame(**other))
                for (topic, kind), fields in zip(TYPES.items(), sent, strict=True):
                    publishers[topic].publish(getattr(types, kind)(**fields))
                for _ in range(4):
                    executor.spin_once(0.05)

            until(done, f"an answer at {percent} % and {rpm} rpm", publish)

        send(40.0, 540.0, 2.5, lambda: any(p.crank_angle == 2.6 for p in predictions))
        send(40.0, 540.0, 2.5, lambda: any(map(has_all_speeds, states)))
        send(102.0, 540.0, 2.5, lambda: predictions[-1].status == Status.INVALID_ANGLE)
        send(40.0, 8191.875, 2.5, lambda: "has no pto speed now, so it is unknown" in node.printed)
        send(40.0, 540.0, 2.5, lambda: predictions[-1].status == Status.OK)
        executor.shutdown()
        tractor.destroy_node()
    assert node.stop() == 0
    assert node.printed.count("has no pto speed now") == 1
    assert node.printed.count("crank angle nan deg") == 1

    assert "ros2_isobus" not in os.environ.get("AMENT_PREFIX_PATH", "")
    [log] = tmp_path.glob("linkage_vibration_*.mcap")
    again = tmp_path / "again.mcap"
    replay([log], again, SETTINGS)
    for name in ("prediction", "resonance"):
        recorded = [(at, data) for _, at, data in raw_messages(log, f"/foreign/{name}")]
        answers = [(at, data) for _, at, data in raw_messages(again, f"/linkage_vibration/{name}")]
        assert recorded
        assert answers == recorded
    names = [f"/ISOBUS/{topic}" for topic in TYPES]
    assert raw_messages(again, *names) == raw_messages(log, *names)
    # The drive has one position and one speed that are no numbers.
    limits = Limits(statuses=(Status.OK, Status.INVALID_ANGLE), input_faults=2)
    report = check_bag(log, limits, SETTINGS)
    assert report.passed, str(report)
    assert report.predictions == len(raw_messages(log, "/foreign/prediction"))


def has_all_speeds(state: Any) -> bool:
    """Return whether every speed is known."""
    speeds = LoadState.UNKNOWN_ENGINE_SPEED | LoadState.UNKNOWN_PTO_SPEED
    return not state.unknown_sources & (speeds | LoadState.UNKNOWN_GROUND_SPEED)


def test_messages_of_ros2_control(start: Callable[..., RunningNode], domain: int) -> None:
    """A joint state has the hitch and two shafts in rad/s, and a twist has the ground speed."""
    node = start(name="foreign", **CONTROL)
    node.wait_for("Predicting for joint hitch_rockshaft_joint on /joint_states")
    predictions, states = list[Any](), list[Any]()
    with own_context(domain) as context:
        tractor = rclpy.create_node("tractor", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(tractor)
        joints = tractor.create_publisher(JointState, "joint_states", 10)
        twists = tractor.create_publisher(TwistStamped, "vehicle/twist", 10)
        tractor.create_subscription(
            VibrationPrediction, "/foreign/prediction", predictions.append, 99
        )
        tractor.create_subscription(LoadState, "/foreign/load_state", states.append, 99)
        state = JointState(name=["rear_pto_joint", JOINT, "engine_crankshaft_joint"])
        state.position = array("d", [9.0, 2.25, 9.0])
        state.velocity = array("d", [540.0 * math.pi / 30.0, 0.0, 1800.0 * math.pi / 30.0])
        twist = TwistStamped()
        twist.twist.linear.x = 2.5

        def publish() -> None:
            state.header.stamp = tractor.get_clock().now().to_msg()
            twists.publish(twist)
            joints.publish(state)
            for _ in range(4):
                executor.spin_once(0.05)

        until(lambda: any(map(has_all_speeds, states)), "all speeds", publish)
        assert predictions[-1].crank_angle == 2.25
        executor.shutdown()
        tractor.destroy_node()
    assert node.stop() == 0
