# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Replays of bags whose messages have types that are not installed, in every kind of bag."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from linkage_vibration.bags.reading import BagError
from linkage_vibration.playback.remapping import ReplayError
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.inputs.units import InputError
from linkage_vibration.prediction.settings import Parameters, with_values
from test.support.messages import read_messages

START = 1_700_000_000 * 10**9
PREDICTION = "/linkage_vibration/prediction"
TIME, HEADER = "builtin_interfaces/msg/Time", "std_msgs/msg/Header"
STATE = "farm_msgs/msg/TractorState"
TEXT = """std_msgs/Header header
string[] names
farm_msgs/Lift[] lifts
float32 engine
uint16[2] shafts
float64[] speeds
================================================================================
MSG: farm_msgs/Lift
string side
uint8[] raw
float32 angle
"""
ROS1 = "float32 engine\nstring label\nfloat64 angle\ntime at\nHeader header\n"
CHOSEN = {
    "hitch_topic": "/state",
    "hitch_type": "farm_msgs/TractorState",
    "hitch_field": "lifts[1].angle",
    "hitch_unit": "deg",
    "hitch_offset": 90.0,
    "engine_topic": "/state",
    "engine_type": "farm_msgs/TractorState",
    "engine_field": "engine",
    "engine_unit": "Hz",
    "pto_topic": "/state",
    "pto_type": "farm_msgs/TractorState",
    "pto_field": "shafts[0]",
    "ground_topic": "/state",
    "ground_type": "farm_msgs/TractorState",
    "ground_field": "speeds[ground]",
    "ground_unit": "km/h",
}
SETTINGS = with_values(Parameters(), CHOSEN)
ANGLES = [3.5 * k for k in range(24)]


def states(store: Any) -> list[Any]:
    """Return messages in which texts and lists have various lengths."""
    store.register(get_types_from_msg(TEXT, STATE))
    stamp, header, lift, state = (
        store.types[name]
        for name in (
            "builtin_interfaces/msg/Time",
            "std_msgs/msg/Header",
            f"{STATE[:-12]}Lift",
            STATE,
        )
    )
    actual = []
    for k, angle in enumerate(ANGLES):
        lifts = [lift("x" * (j + k % 3), np.zeros(k % 2, np.uint8), angle) for j in range(2)]
        names = ["ground", "other"][:: 1 - 2 * (k % 2)]
        speeds = np.array([7.2 if name == "ground" else 0.0 for name in names])
        shafts = np.array([540, 0], np.uint16)
        sent = header(stamp(k, 5), "tractor")
        actual.append(state(sent, names, lifts, 30.0 + k, shafts, speeds))
    return actual


def write_mcap(path: Path, text: str = TEXT, more: str = "") -> Path:
    """Write the messages to MCAP, with the definition of their type."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    actual = states(store)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "test")
        parts = store.generate_msgdef(STATE, ros_version=2)[0] if text is TEXT else text
        schema = writer.register_schema(STATE, "ros2msg", parts.encode())
        channels = [writer.register_channel("/state", "cdr", schema)]
        if more:
            schema = writer.register_schema(STATE, "ros2msg", more.encode())
            channels.append(writer.register_channel("/state", "cdr", schema))
        for k, message in enumerate(actual):
            data = bytes(store.serialize_cdr(message, STATE))
            writer.add_message(channels[k % len(channels)], START + k * 10**8, data, START)
        writer.finish()
    return path


def write_folder(path: Path, plugin: StoragePlugin) -> Path:
    """Write the messages to a folder of rosbag2."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    actual = states(store)
    with Writer2(path, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/state", STATE, typestore=store)
        for k, message in enumerate(actual):
            writer.write(connection, START + k * 10**8, store.serialize_cdr(message, STATE))
    return path


@pytest.mark.parametrize(
    "write",
    [
        lambda folder: write_mcap(folder / "bag.mcap"),
        lambda folder: write_folder(folder / "bag", StoragePlugin.SQLITE3),
        lambda folder: write_folder(folder / "bag", StoragePlugin.MCAP),
    ],
    ids=["mcap", "sqlite3", "folder"],
)
def test_types_from_the_bag(write: Callable[[Path], Path], tmp_path: Path) -> None:
    """Nested fields, elements and names are read; the log can be replayed in its turn."""
    log, again = tmp_path / "log.mcap", tmp_path / "again.mcap"
    done = replay([write(tmp_path)], log, SETTINGS)
    assert (done.predictions, done.resonances, done.fault) == (len(ANGLES), len(ANGLES), "")
    actual = [message for _, message in read_messages(log, PREDICTION)]
    expected = [np.deg2rad(1.0) * np.float32(angle) + np.deg2rad(90.0) for angle in ANGLES]
    np.testing.assert_allclose([m.crank_angle for m in actual], expected, rtol=1e-15)
    assert [(m.header.stamp.sec, m.header.frame_id) for m in actual] == [
        (k, "tractor") for k in range(len(ANGLES))
    ]
    replay([log], again, SETTINGS)
    for topic in (PREDICTION, "/linkage_vibration/resonance", "/state"):
        first, other = ([str(m) for m in read_messages(bag, topic)] for bag in (log, again))
        assert first == other
        assert len(first) == len(ANGLES)


def test_byte_of_ros1(tmp_path: Path) -> None:
    """A byte of ROS 1 has a sign, which that of ROS 2 does not have."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("byte angle", "farm_msgs/msg/Old"))
    bag, log = tmp_path / "bag.bag", tmp_path / "log.mcap"
    with Writer1(bag) as writer:
        connection = writer.add_connection("/old", "farm_msgs/msg/Old", typestore=store)
        for angle in (-100, 100):
            first = store.types["farm_msgs/msg/Old"](angle)
            writer.write(connection, START, store.serialize_ros1(first, "farm_msgs/msg/Old"))
    chosen = {"hitch_topic": "old", "hitch_type": "farm_msgs/Old", "hitch_unit": "deg"}
    replay([bag], log, with_values(Parameters(), {**chosen, "hitch_field": "angle"}))
    actual = [math.degrees(m.crank_angle) for _, m in read_messages(log, PREDICTION)]
    assert actual == pytest.approx([-100.0, 100.0])


def test_types_of_ros1(tmp_path: Path) -> None:
    """A type of ROS 1 with a time and a header is read as it is converted."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(ROS1, "farm_msgs/msg/Old"))
    stamp = store.types["builtin_interfaces/msg/Time"](7, 8)
    header = store.types["std_msgs/msg/Header"](3, stamp, "old")
    bag, log = tmp_path / "bag.bag", tmp_path / "log.mcap"
    with Writer1(bag) as writer:
        connection = writer.add_connection("/old", "farm_msgs/msg/Old", typestore=store)
        for k, angle in enumerate(ANGLES):
            first = store.types["farm_msgs/msg/Old"](1.0 + k, "y" * (k % 4), angle, stamp, header)
            data = store.serialize_ros1(first, "farm_msgs/msg/Old")
            writer.write(connection, START + k * 10**8, data)
    chosen = {"hitch_topic": "old", "hitch_type": "farm_msgs/Old", "hitch_unit": "deg"}
    settings = with_values(Parameters(), {**chosen, "hitch_field": "angle", "hitch_offset": 90.0})
    assert replay([bag], log, settings).predictions == len(ANGLES)
    actual = [m for _, m in read_messages(log, PREDICTION)]
    np.testing.assert_allclose([m.crank_angle for m in actual], np.deg2rad(ANGLES) + np.pi / 2)
    assert actual[1].header.stamp.nanosec == 10**8  # the header is not the first field
    with pytest.raises(InputError, match=r"hitch_field: .* header.stamp.nanosec"):
        replay([bag], log, with_values(settings, {"hitch_field": "header.seq"}))


@pytest.mark.parametrize(
    ("text", "more", "kind", "words"),
    [
        (TEXT, "float64 x", BagError, "define the type of topic /state in different ways"),
        ("", "", ReplayError, "does not define the type of topic /state.* install farm_msgs"),
        ("float64 x", "", InputError, "no number 'lifts.1..angle'; its numbers are x"),
        ("farm_msgs/Lift[] lifts\n", "", InputError, "it has no numbers"),
        ("float64[", "", BagError, "bag.mcap"),
    ],
)
def test_definitions_that_cannot_be_used(
    tmp_path: Path, text: str, more: str, kind: type[Exception], words: str
) -> None:
    """Two definitions of one topic, none, or one without the field are refused in a sentence."""
    bag = write_mcap(tmp_path / "bag.mcap", text, more)
    with pytest.raises(kind, match=words):
        replay([bag], tmp_path / "log.mcap", SETTINGS)


def test_topic_that_is_named_but_missing(tmp_path: Path) -> None:
    """A topic that a parameter names must be in the bag, with its type."""
    bag = write_mcap(tmp_path / "bag.mcap")
    for changes, words in (
        ({"engine_topic": "/engine"}, "has no topic /engine of type farm_msgs/msg/TractorState"),
        ({"pto_type": "farm_msgs/Pto"}, "holds farm_msgs/msg/TractorState, not farm_msgs/msg/Pto"),
    ):
        with pytest.raises(ReplayError, match=words):
            replay([bag], tmp_path / "log.mcap", with_values(SETTINGS, changes))
