# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of the shape that ROS2ISOBUS publishes, over DDS and in bags."""

import os
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import rclpy
from mcap.reader import make_reader
from rclpy.executors import SingleThreadedExecutor

from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.testing.bag_checks import Limits, check_bag
from linkage_vibration_interfaces.msg import Resonance, VibrationPrediction
from test.support.interface_packages import built_package, environment_with, import_here
from test.support.ros_process import RunningNode, own_context, start_node, until

CALIBRATION = (0.0, 3.1, 40.0, 2.6, 100.0, 1.6)
CHOSEN = {"input": "ros2_isobus", "pto_input": "ros2_isobus", "ground_input": "ros2_isobus"}
SETTINGS = Parameters(calibration=CALIBRATION, **CHOSEN)  # type: ignore[arg-type]
DEFINITIONS = {
    "TecuRearHitchStatus": "float64 position_percent\nuint8 in_work\nfloat64 draft_n\n",
    "TecuRearPtoStatus": "float64 rpm\nfloat64 setpoint_rpm\nuint8 engagement\n",
    "TecuGroundSpeed": "float64 speed_ms\nfloat64 distance_m\nbool forward\n",
}
TYPES = {
    "rear_hitch_status": "TecuRearHitchStatus",
    "rear_pto_status": "TecuRearPtoStatus",
    "ground_speed": "TecuGroundSpeed",
}


@pytest.fixture(scope="module")
def with_isobus(environment: dict[str, str]) -> dict[str, str]:
    """Return an environment that has ros2_isobus, which this process can import as well."""
    prefix = built_package("ros2_isobus", DEFINITIONS)
    import_here(prefix)
    return environment_with(environment, prefix)


@pytest.fixture
def begin(with_isobus: dict[str, str], tmp_path: Path) -> Iterator[Callable[..., RunningNode]]:
    """Return a function that starts a node which finds the package."""
    nodes: list[RunningNode] = []

    def start(**parameters: Any) -> RunningNode:
        output = tmp_path / f"printed_{len(nodes)}.txt"
        nodes.append(start_node(output, with_isobus, name="foreign", **parameters))
        return nodes[-1]

    yield start
    for node in nodes:
        node.process.kill()
        node.process.wait()


def messages(log: Path, *topics: str) -> list[tuple[str, int, bytes]]:
    """Return topic, log time and bytes of each message of some topics."""
    with log.open("rb") as file:
        found = make_reader(file).iter_messages(topics)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in found]


def test_isobus_over_dds_and_in_a_bag(
    begin: Callable[..., RunningNode], domain: int, tmp_path: Path
) -> None:
    """Presets read the messages; "not available" is no value; a replay gives the same bytes."""
    node = begin(**CHOSEN, calibration=list(CALIBRATION), record=True, log_directory=tmp_path)
    node.wait_for("Predicting for field position_percent on /ISOBUS/tecu/rear_hitch_status")
    predictions, resonances = list[Any](), list[Any]()
    with own_context(domain) as context:
        tractor = rclpy.create_node("tractor", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(tractor)
        types = import_module("ros2_isobus.msg")
        publishers = {
            topic: tractor.create_publisher(getattr(types, kind), f"/ISOBUS/tecu/{topic}", 10)
            for topic, kind in TYPES.items()
        }
        tractor.create_subscription(
            VibrationPrediction, "/foreign/prediction", predictions.append, 99
        )
        tractor.create_subscription(Resonance, "/foreign/resonance", resonances.append, 99)

        def send(percent: float, rpm: float, speed: float, done: Callable[[], object]) -> None:
            """Publish a moment of the drive until something is done."""

            def publish() -> None:
                sent = {"rear_pto_status": {"rpm": rpm}, "ground_speed": {"speed_ms": speed}}
                sent["rear_hitch_status"] = {"position_percent": percent}
                for topic, fields in sent.items():
                    publishers[topic].publish(getattr(types, TYPES[topic])(**fields))
                for _ in range(4):
                    executor.spin_once(0.05)

            until(done, f"an answer at {percent} % and {rpm} rpm", publish)

        send(40.0, 540.0, 2.5, lambda: any(p.crank_angle == 2.6 for p in predictions))
        send(40.0, 540.0, 2.5, lambda: resonances)
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
        recorded = [(at, data) for _, at, data in messages(log, f"/foreign/{name}")]
        answers = [(at, data) for _, at, data in messages(again, f"/linkage_vibration/{name}")]
        assert recorded
        assert answers == recorded
    names = [f"/ISOBUS/tecu/{topic}" for topic in TYPES]
    assert messages(again, *names) == messages(log, *names)
    report = check_bag(log, Limits(statuses=(Status.OK, Status.INVALID_ANGLE)), SETTINGS)
    assert report.passed
    assert report.predictions == len(messages(log, "/foreign/prediction"))


def test_types_that_cannot_be_read(begin: Callable[..., RunningNode]) -> None:
    """A wrong path, and a type that is not installed, end the node with one sentence."""
    for parameters, words in (
        ({"hitch_field": "position", "input": "ros2_isobus"}, "did you mean position_percent? its"),
        (
            {"engine_type": "other_msgs/msg/Engine"},
            "engine_type: the type other_msgs/msg/Engine is",
        ),
    ):
        node = begin(**parameters)
        assert node.process.wait(120.0) == 1
        assert words in node.printed
        assert "Traceback" not in node.printed
