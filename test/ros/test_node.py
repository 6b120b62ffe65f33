# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node in a process of its own, over real DDS: its numbers, its log, its end."""

import math
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader

from linkage_vibration.prediction.predictor import Predictor, Status
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from test.support.messages import read_messages
from test.support.ros_process import JOINT, slowness, start_node, until


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


@pytest.mark.nightly(short="test_signals_at_any_moment")
def test_signals_end_it_cleanly(start: Callable[..., Any]) -> None:
    """After Ctrl-C, even five times, the exit code is 0 without a complaint."""
    ended = start(name="ended")
    ended.wait_for("Predicting for joint")
    for _ in range(5):
        ended.process.send_signal(signal.SIGINT)
        until(lambda: not ended.has_waiting_signals(), "the handling of the signal")
    assert ended.stop() == 0
    assert [line.split()[0] for line in ended.printed.splitlines()] == ["[INFO]", "[INFO]"]
    assert "predictions made" in ended.printed


def test_signals_at_any_moment(start: Callable[..., Any]) -> None:
    """A signal also ends the node at once and cleanly while it imports or loads the table."""
    moments = ("", signal.SIGINT), ("fastrtps", signal.SIGTERM)
    for i, (library, by) in enumerate(moments):
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
    busy = start(name="busy")
    peer = meet("busy")
    for count in range(400):
        peer.publish()
        peer.executor.spin_once(0.0005)
        if count == 300:
            busy.process.send_signal(signal.SIGTERM)
    assert busy.stop(signal.SIGTERM) == 0
    assert {line.split()[0] for line in busy.printed.splitlines()} <= {"[INFO]"}, busy.printed


def test_signal_ends_a_table_under_way(environment: dict[str, str], tmp_path: Path) -> None:
    """A signal also ends a node that is still building its table."""
    variables = {**environment, "XDG_CACHE_HOME": str(tmp_path)}
    file = config_file("three_point_linkage_as_printed.yaml")
    builder = start_node(tmp_path / "out.txt", variables, name="builder", mechanism_file=file)
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
    for i in range(50):
        peer.publish(["other"], [0.0])
        peer.ask(["wheel", JOINT], [1.0, 1.6 + 0.028 * i], velocity=[0.0, 0.7])
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
