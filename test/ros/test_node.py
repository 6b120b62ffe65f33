# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node in a process of its own, over real DDS: its numbers, its log, its end."""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from linkage_vibration.prediction.predictor import Predictor, Status
from linkage_vibration.ros.node import main
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from linkage_vibration_interfaces.msg import VibrationPrediction
from test.support.messages import read_messages
from test.support.ros_process import JOINT, slowness, until


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """Return a predictor on the table that the node uses."""
    return Predictor(load_table(config_file("tables/three_point_linkage_on_tractor.npz")))


@pytest.fixture(scope="module")
def node(start: Callable[..., Any]) -> Any:
    """Return a node whose crank angle is the joint's position."""
    return start()


@pytest.fixture(scope="module")
def peer(node: Any, meet: Callable[[], Any]) -> Any:
    """Return a peer that the node has found."""
    return meet()


def same(message: Any, prediction: Any) -> bool:
    """Return whether a message holds exactly the numbers of a prediction."""
    pairs = [
        (message.crank_angle, prediction.crank_angle),
        (message.frf_peak_frequency, prediction.frf_peak_frequency),
        (message.frf_peak_magnitude, prediction.frf_peak_magnitude),
        (message.interpolation_error, prediction.interpolation_error),
        *zip(message.natural_frequencies, prediction.natural_frequencies, strict=True),
        *zip(message.damping_ratios, prediction.damping_ratios, strict=True),
    ]
    numbers = all(a == b or (math.isnan(a) and math.isnan(b)) for a, b in pairs)
    return numbers and (message.status, message.table_id) == (
        prediction.status,
        prediction.table_id,
    )


def test_bytes_that_are_not_a_joint_state(peer: Any, node: Any) -> None:
    """Bytes that no serializer made are reported, and the node continues."""
    for data in (b"", b"\0\1\0\0", b"\0\1\0\0" + b"\xff" * 60):
        peer.publisher.publish(data)
    assert peer.ask([JOINT], [2.0]).status == Status.OK
    node.wait_for("is not valid CDR")


def test_subscriber_of_another_qos_is_reported(peer: Any, node: Any) -> None:
    """A subscriber that asks for transient-local predictions gets none; the node says why."""
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    subscription = peer.node.create_subscription(
        VibrationPrediction, "linkage_vibration/prediction", print, qos
    )
    node.wait_for(
        "a QoS that does not match this node's, so nothing passes (Volatile publisher and transient"
    )
    peer.node.destroy_subscription(subscription)


def test_ten_thousand_joints(peer: Any, predictor: Predictor) -> None:
    """The joint is found among ten thousand joints."""
    names = [f"joint_{i}" for i in range(10_000)]
    names[7_777] = JOINT
    assert same(peer.ask(names, [2.5] * 10_000), predictor.predict(2.5))


def test_topic_bytes_are_exact(peer: Any) -> None:
    """DDS carries what a strict decoder reads, padded to four bytes (RTPS)."""
    peer.raw.clear()
    peer.ask([JOINT], [2.2], frame_id="frame")
    store = typestore()
    name = "linkage_vibration_interfaces/msg/VibrationPrediction"
    message: Any = store.deserialize_cdr(peer.raw[-1], name)
    assert message.header.frame_id == "frame"
    exact = bytes(store.serialize_cdr(message, name))
    assert peer.raw[-1][: len(exact)] == exact
    assert peer.raw[-1][len(exact) :] in (b"", b"\0", b"\0\0", b"\0\0\0")


def typestore() -> Any:
    """Return rosbags' types with ours among them."""
    from linkage_vibration.messages.definitions import message_definition

    name = "linkage_vibration_interfaces/msg/VibrationPrediction"
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = get_types_from_msg(message_definition(name), name)
    store.register({key: value for key, value in types.items() if key == name})
    return store


def test_console_script_is_installed() -> None:
    """`ros2 run` and a shell find the executable of the package."""
    [script] = entry_points(group="console_scripts", name="linkage_vibration_node")
    assert script.load() is main


def test_humble_is_refused(environment: dict[str, str], tmp_path: Path) -> None:
    """On a ROS 2 before Jazzy, whose rclpy lacks modules, one sentence says what to use."""
    hidden = "import sys; sys.modules['rclpy.service_introspection'] = None"
    (tmp_path / "sitecustomize.py").write_text(hidden)
    path = os.pathsep.join([str(tmp_path), environment.get("PYTHONPATH", "")])
    run = subprocess.run(
        [sys.executable, "-m", "linkage_vibration.ros.node"],
        env={**environment, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 1
    [line] = run.stderr.splitlines()
    assert line.startswith("linkage_vibration_node: Python cannot import rclpy ")
    assert "source a ROS 2 installation (Jazzy or later)" in line


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_it_cleanly(start: Callable[..., Any], by: signal.Signals) -> None:
    """After Ctrl-C, SIGTERM or SIGHUP, even five times, the exit code is 0 without a complaint."""
    ended = start(name=f"ended_{by.name.lower()}")
    ended.wait_for("Predicting for joint")
    for _ in range(5):
        ended.process.send_signal(by)
        until(lambda: not ended.has_waiting_signals(), "the handling of the signal")
    assert ended.stop(by) == 0
    assert [line.split()[0] for line in ended.printed.splitlines()] == ["[INFO]", "[INFO]"]
    assert "predictions made" in ended.printed


def test_signals_at_any_moment(start: Callable[..., Any]) -> None:
    """A signal also ends the node at once and cleanly while it imports or loads the table."""
    moments = ("", signal.SIGINT), ("numpy", signal.SIGTERM), ("rclpy", signal.SIGHUP)
    later = ("scipy", signal.SIGINT), ("fastrtps", signal.SIGINT)
    for i, (library, by) in enumerate((*moments, *later)):
        early = start(name=f"early_{i}")
        early.wait_for_signal_handlers()
        until(lambda early=early, library=library: early.has_loaded(library), library)
        began = time.monotonic()
        assert early.stop(by) == 0
        lasted = time.monotonic() - began
        print(f"\n{library}: {lasted:.2f} s at {slowness():.1f}")
        assert lasted < 1.5 * slowness()
        assert {line.split()[0] for line in early.printed.splitlines()} <= {"[INFO]"}


def test_signals_amid_traffic(start: Callable[..., Any], meet: Callable[[str], Any]) -> None:
    """A callback that is about to publish keeps its context when a signal comes."""
    for i, by in enumerate((signal.SIGINT, signal.SIGTERM, signal.SIGHUP)):
        busy = start(name=f"busy_{i}")
        peer = meet(f"busy_{i}")
        for count in range(400):
            peer.publish()
            peer.executor.spin_once(0.0005)
            if count == 300:
                busy.process.send_signal(by)
        assert busy.stop(by) == 0
        assert {line.split()[0] for line in busy.printed.splitlines()} <= {"[INFO]"}, busy.printed


def test_signal_ends_a_table_under_way(start: Callable[..., Any]) -> None:
    """A signal also ends a node that is still building its table."""
    builder = start(
        name="builder", mechanism_file=config_file("three_point_linkage_as_printed.yaml")
    )
    builder.wait_for("Building the table")
    assert builder.stop(signal.SIGTERM) == 0
    assert "Predicting" not in builder.printed
    assert "Traceback" not in builder.printed


def test_log_holds_what_was_published(
    start: Callable[..., Any], meet: Callable[[str], Any], tmp_path: Path
) -> None:
    """Two independent readers find every joint state that was used and every prediction."""
    began = time.time_ns()
    recorder = start(name="recorder", record=True, log_directory=tmp_path)
    peer = meet("recorder")
    warmed_up = peer.stamp
    for i in range(200):
        peer.publish(["other"], [0.0])
        peer.ask(["wheel", JOINT], [1.0, 1.6 + 0.007 * i], velocity=[0.0, 0.7])
    assert recorder.stop() == 0
    [path] = tmp_path.glob("linkage_vibration_*.mcap")

    published = {p.header.stamp.nanosec: p for p in peer.predictions}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert {a.name for a in reader.iter_attachments()} >= {
            "mechanism.yaml",
            "excitations.yaml",
            "parameters.yaml",
        }
        decoded = [
            (channel.topic, message)
            for _, channel, _, message in reader.iter_decoded_messages()
            if message.header.stamp.nanosec > warmed_up
        ]
        assert all("offered_qos_profiles" in c.metadata for c in summary.channels.values())
    logged = {m.header.stamp.nanosec: m for t, m in decoded if t == "/recorder/prediction"}
    used = {m.header.stamp.nanosec: m for t, m in decoded if t == "/joint_states"}
    assert logged.keys() == published.keys() == used.keys()
    # RTPS pads what it carries by zeros, to four bytes.
    with path.open("rb") as file:
        messages = make_reader(file).iter_messages("/recorder/prediction")
        stored = {message.data.rstrip(b"\0") for _, _, message in messages}
    assert {data.rstrip(b"\0") for data in peer.raw} <= stored
    with path.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages("/joint_states"):
            assert began < message.publish_time < message.log_time  # sent, then received
    for stamp, message in logged.items():
        assert same(message, published[stamp])
        assert list(used[stamp].name) == ["wheel", JOINT]
        assert list(used[stamp].velocity) == [0.0, 0.7]

    again = [m for _, m in read_messages(path, "/recorder/prediction")]
    kept = [m for m in again if m.header.stamp.nanosec > warmed_up]
    assert [m.crank_angle for m in kept] == [p.crank_angle for p in published.values()]
    with Reader(path) as bag:
        assert bag.message_count == 2 * len(again)
