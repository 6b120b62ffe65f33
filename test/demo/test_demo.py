# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The demo, end to end over DDS in two processes, and its errors."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.bags.reading import BagError
from linkage_vibration.demo.demo import NODE_OUTPUT, DemoError, _node, run_demo
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.topics import PREDICTION_TOPIC
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from test.support.drive import HITCH_JOINT
from test.support.messages import plain, read_messages
from test.support.ros_process import slowness, until

SHARED_BAG = Path(__file__).parents[3] / "shared" / "data" / "fake_joint_state.bag"


def demo(output: Path, *arguments: str, busy: bool = False) -> str:
    """Run the command as a user does, on a domain that it chooses, and return what it prints.

    On a busy machine the node may leave readings out, which the command says with the code 1.
    """
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE")
    }
    command = [sys.executable, "-m", "linkage_vibration.cli", "demo", "-o", str(output), *arguments]
    result = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    left_out = busy and "The machine is too busy" in result.stderr and slowness() > 1.0
    assert result.returncode == left_out, result.stdout + result.stderr
    return result.stdout


def written(output: Path, printed: str) -> Path:
    """Check that the log and its picture are where the demo says, and return the log."""
    [log], [picture] = output.glob("*.mcap"), output.glob("*.png")
    assert re.search(r"^log +(.*)$", printed, re.MULTILINE)[1] == str(log)  # type: ignore[index]
    assert re.search(r"^picture +(.*)$", printed, re.MULTILINE)[1] == str(picture)  # type: ignore[index]
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    return log


def write_bag(path: Path, count: int) -> Path:
    """Write a .db3 at 200 Hz whose messages have empty arrays and do not all hold the joint."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    header, stamp = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/joints", JOINT_STATE, typestore=store)
        for k in range(count):
            message = store.types[JOINT_STATE](
                header=header(stamp=stamp(sec=50, nanosec=k * 5_000_000), frame_id=f"frame {k}"),
                name=["123", "still"] if k % 5 else ["other"],
                position=np.array(
                    [np.nan if k == 7 else np.sin(0.05 * k), 1.0][: 2 if k % 5 else 1]
                ),
                velocity=np.array([]),
                effort=np.array([]),
            )
            writer.write(connection, k * 5_000_000, store.serialize_cdr(message, JOINT_STATE))
    return path / f"{path.name}.db3"


def published(log: Path, topic: str) -> dict[int, int]:
    """Return when the messages of a topic were published, by their log times, ns."""
    with log.open("rb") as file:
        messages = make_reader(file).iter_messages([topic])
        return {message.log_time: message.publish_time for _, _, message in messages}


def test_every_joint_state_is_answered_and_logged(tmp_path: Path) -> None:
    """The log holds what was played and, for each message, the shipped table's prediction."""
    bag = write_bag(tmp_path / "bag", 300)
    printed = demo(tmp_path / "out", "--bag", str(bag), "--joint", "123")
    assert re.search(r"^joint states in +240$", printed, re.MULTILINE)
    assert re.search(r"^predictions out +240$", printed, re.MULTILINE)
    [stated] = re.findall(
        r"^latency +median (\d+\.\d\d) ms, 99th percentile (\d+\.\d\d) ms$", printed, re.MULTILINE
    )
    log = written(tmp_path / "out", printed)
    sent = {topic: published(log, topic) for topic in ("/joint_states", PREDICTION_TOPIC)}
    waits = [1e-6 * (at - sent["/joint_states"][key]) for key, at in sent[PREDICTION_TOPIC].items()]
    actual = np.percentile(waits, (50, 99))
    np.testing.assert_allclose(np.array(stated, float), actual, atol=0.006)

    with AnyReader([bag]) as any_reader:
        messages: list[Any] = [
            any_reader.deserialize(data, c.msgtype) for c, _, data in any_reader.messages()
        ]
    played = [message for message in messages if "123" in message.name]
    logged = [message for _, message in read_messages(log, "/joint_states")]
    predictions = [message for _, message in read_messages(log, PREDICTION_TOPIC)]
    assert len(played) == len(logged) == len(predictions) == 240
    predictor = Predictor(load_table(config_file("tables/three_point_linkage_on_tractor.npz")))
    first, last = predictor.table.alpha3_range
    positions = np.array([record.position[0] for record in played])
    low, high = np.nanmin(positions), np.nanmax(positions)
    for record, each, prediction in zip(played, logged, predictions, strict=True):
        assert plain(each) == plain(record)
        assert plain(prediction.header) == plain(record.header)
        expected = predictor.predict(prediction.crank_angle)
        assert prediction.status == expected.status
        np.testing.assert_array_equal(prediction.natural_frequencies, expected.natural_frequencies)
        np.testing.assert_equal(prediction.frf_peak_magnitude, expected.frf_peak_magnitude)
    angles = np.array([prediction.crank_angle for prediction in predictions])
    mapped = first + (last - first) * (positions - low) / (high - low)
    np.testing.assert_allclose(angles, mapped, atol=1e-8)
    assert [prediction.status for prediction in predictions].count(0) == 239  # one angle is NaN

    with log.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [message for _, channel, _, message in reader.iter_decoded_messages()]
    assert len(decoded) == 480


@pytest.mark.nightly(short="test_every_joint_state_is_answered_and_logged")
@pytest.mark.skipif(not SHARED_BAG.is_file(), reason=f"{SHARED_BAG} is not there")
def test_foreign_recording(tmp_path: Path) -> None:
    """A ROS 1 bag at 1 kHz with jitter is played, answered and logged without loss.

    What a busy machine leaves out, the node counts.
    """
    printed = demo(tmp_path, "--bag", str(SHARED_BAG), "--joint", "joint_3", busy=True)
    assert re.search(r"^joint states in +2725$", printed, re.MULTILINE)
    predictions = [m for _, m in read_messages(written(tmp_path, printed), PREDICTION_TOPIC)]
    answered = f"2725 messages received, {len(predictions)} predictions made"
    assert answered in (tmp_path / NODE_OUTPUT).read_text()
    assert {prediction.status for prediction in predictions} == {0}
    angles = np.rad2deg([prediction.crank_angle for prediction in predictions])
    if len(predictions) == 2725:
        np.testing.assert_allclose((angles.min(), angles.max()), (90, 180), atol=1e-6)


@pytest.mark.nightly(short="test_every_joint_state_is_answered_and_logged")
def test_shipped_drive(tmp_path: Path) -> None:
    """The demo, run as `make demo` does, answers all 2000 joint states of the shipped drive."""
    printed = demo(tmp_path)
    assert re.search(r"^predictions out +2000$", printed, re.MULTILINE)
    log = written(tmp_path, printed)
    drive = config_file("drives/hitch_duty_cycle.mcap")
    played = [message for _, message in read_messages(drive, "/joint_states")]
    predictions = [message for _, message in read_messages(log, PREDICTION_TOPIC)]
    assert [prediction.crank_angle for prediction in predictions] == [
        record.position[record.name.index(HITCH_JOINT)] for record in played
    ]


def test_joint_must_be_there_and_move(tmp_path: Path) -> None:
    """The error lists the joints, or says that the joint is at rest."""
    bag = write_bag(tmp_path / "bag", 20)
    listing = "; it has 123, other, still. Set joint_name"
    for joint, words in [
        (None, f"has no joint {HITCH_JOINT}{listing}"),
        ("hitch", f"has no joint hitch{listing}"),
        ("still", "Joint still of .* does not move .* choose another one with --joint"),
    ]:
        with pytest.raises(LinkageVibrationError, match=words):
            run_demo(bag, joint, tmp_path / "out")
    with pytest.raises(LinkageVibrationError, match=f"has no joint hitch; it has .*{HITCH_JOINT}"):
        run_demo(None, "hitch", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_wrong_paths_are_named(tmp_path: Path) -> None:
    """The error names a missing bag, or a file where the folder should be."""
    with pytest.raises(BagError, match="There is no bag"):
        run_demo(tmp_path / "none.bag", "a", tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(DemoError, match="file: the folder cannot be created"):
        run_demo(None, None, tmp_path / "file")


def test_node_that_does_not_start_says_why(tmp_path: Path) -> None:
    """The error contains what the node printed before it ended."""
    words = r"(?s)exit code 1.*[Pp]arameter joint_name"
    with pytest.raises(DemoError, match=words), _node({"joint_name": ""}, tmp_path) as check:
        until(lambda: False, "the node's end", check)
