# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of every format are read alike, and unreadable ones give a clear error."""

import shutil
import sqlite3
import sys
import tracemalloc
from array import array
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import JointState

from linkage_vibration.bags.field_reader import FieldReader
from linkage_vibration.bags.message_columns import read_columns
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.bags.reading import BagError
from linkage_vibration.bags.streams import open_bags
from linkage_vibration.messages.definitions import message_definition

PREDICTION = "linkage_vibration_interfaces/msg/VibrationPrediction"
PLUGINS = {"mcap": StoragePlugin.MCAP, "db3": StoragePlugin.SQLITE3}
KINDS = ["ros1", "mcap", "db3", "mcap folder", "db3 folder"]


def store_of(kind: str) -> Any:
    """Return the types of ROS 1 or of ROS 2, including ours."""
    if kind == "ros1":
        return get_typestore(Stores.ROS1_NOETIC)
    store = get_typestore(Stores.LATEST)
    store.register(get_types_from_msg(message_definition(PREDICTION), PREDICTION))
    return store


def joint_state(store: Any, k: int) -> Any:
    """Return the k-th joint state of a made-up recording."""
    header = store.types["std_msgs/msg/Header"]
    stamp = store.types["builtin_interfaces/msg/Time"](sec=100 + k, nanosec=250)
    sequence = {"seq": k} if "seq" in header.__dataclass_fields__ else {}
    return store.types[JOINT_STATE](
        header=header(stamp=stamp, frame_id="base", **sequence),
        name=["a", "b"] if k % 2 else ["b", "a"],
        position=np.array([k + 0.5, -1.0]),
        velocity=np.array([]),
        effort=np.array([np.nan, 3.0]),
    )


def write_bag(folder: Path, kind: str, topics: dict[str, str], count: int = 5) -> Path:
    """Write a bag with rosbags and return the path to read it by."""
    store = store_of(kind)
    plugin = kind.split()[0]
    path = folder / ("bag.bag" if kind == "ros1" else "bag")
    writer: Any = (
        Writer1(path)
        if kind == "ros1"
        else Writer2(path, version=9, storage_plugin=PLUGINS[plugin])
    )
    with writer:
        connections = [
            (writer.add_connection(topic, type_name, typestore=store), type_name)
            for topic, type_name in topics.items()
        ]
        for k in range(count):
            for connection, type_name in connections:
                message: Any = (
                    joint_state(store, k)
                    if type_name == JOINT_STATE
                    else store.types[type_name](data=float(k))
                )
                serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
                writer.write(connection, 10**9 + k, serialize(message, type_name))
    return path if kind == "ros1" or kind.endswith("folder") else path / f"bag.{plugin}"


def read(path: Path, topic: str, store: Any = None) -> list[tuple[int, Any]]:
    """Return the log times and the messages of a topic, decoded by rosbags."""
    store = store or store_of("mcap")
    actual = []
    with open_bags([path]) as bags:
        [kind] = [each.type for each in bags.topics if each.name == topic]
        for block in bags.blocks([topic]):
            messages = [store.deserialize_cdr(block.message(k), kind) for k in range(len(block))]
            actual += list(zip(block.log_times.tolist(), messages, strict=True))
    return actual


@pytest.mark.parametrize("kind", KINDS)
def test_joint_states_of_every_kind_of_bag(tmp_path: Path, kind: str) -> None:
    """Each joint state is as written, also beside another topic."""
    path = write_bag(tmp_path, kind, {"/joints": JOINT_STATE, "/x": "std_msgs/msg/Float64"})
    records = read(path, "/joints")
    assert len(records) == 5
    for k, (log_time, message) in enumerate(records):
        assert log_time == 10**9 + k
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == (100 + k, 250)
        assert message.header.frame_id == "base"
        assert message.name == (["a", "b"] if k % 2 else ["b", "a"])
        np.testing.assert_array_equal(message.position, [k + 0.5, -1.0])
        assert message.velocity.shape == (0,)
        np.testing.assert_array_equal(message.effort, [np.nan, 3.0])
    assert [(time, x.data) for time, x in read(path, "/x")] == [
        (10**9 + k, float(k)) for k in range(5)
    ]


@pytest.mark.parametrize("plugin", PLUGINS)
def test_types_come_from_the_file(tmp_path: Path, plugin: str) -> None:
    """A type that is not part of ROS 2 is decoded by its definition in the bag."""
    store = store_of(plugin)
    with Writer2(tmp_path / "bag", version=9, storage_plugin=PLUGINS[plugin]) as writer:
        connection = writer.add_connection("/p", PREDICTION, typestore=store)
        message = store.types[PREDICTION](
            header=joint_state(store, 0).header,
            crank_angle=2.0,
            status=0,
            natural_frequencies=np.array([4.0, 95.0, 170.0]),
            frequency_stddevs=np.array([0.0, 0.1, 0.2]),
            damping_ratios=np.array([0.01, 0.02, 0.03]),
            damping_ratio_stddevs=np.array([0.0, 0.001, 0.002]),
            frf_peak_frequency=4.0,
            frf_peak_magnitude=1e-4,
            interpolation_error=1e-6,
            table_id="a table",
        )
        writer.write(connection, 7, store.serialize_cdr(message, PREDICTION))
    path = tmp_path / "bag" / f"bag.{plugin}"
    columns = read_columns(path, {"/p": PREDICTION})["/p"]
    assert columns["log_time"] == [7]
    assert columns["header.frame_id"] == ["base"]
    np.testing.assert_array_equal(columns["natural_frequencies"], [[4.0, 95.0, 170.0]])
    assert (columns["frf_peak_magnitude"], columns["table_id"]) == ([1e-4], ["a table"])


def test_db3_of_before_iron(tmp_path: Path) -> None:
    """A file without definitions has messages, but not their fields."""
    path = write_bag(tmp_path, "db3", {"/joints": JOINT_STATE, "/x": "std_msgs/msg/Float64"})
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM message_definitions")
    assert len(read(path, "/joints")) == 5
    with open_bags([path]) as bags:
        assert bags.defined("/joints") is None


@pytest.mark.parametrize("velocity", [[], [5.0, 6.0]])
def test_bytes_of_rclpy_with_empty_arrays(tmp_path: Path, velocity: list[float]) -> None:
    """The bytes that rclpy adds to a message that ends in empty arrays do not matter."""
    message = JointState(name=["a", "b"], position=array("d", [1.0, 2.0]))
    message.velocity = array("d", velocity)
    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joints", JOINT_STATE, typestore=store_of("mcap"))
        writer.write(connection, 1, serialize_message(message))
    with open_bags([tmp_path / "bag"]) as bags:
        defined, [block] = bags.defined("/joints"), bags.blocks(["/joints"])
    assert defined is not None
    for k in range(2):
        reader = FieldReader(defined[2], JOINT_STATE, f"position[{k}]")
        number = reader.read_one(block.message(0))
        assert number is not None
        assert number.value == k + 1.0


@pytest.mark.parametrize("kind", ["ros1", "mcap", "db3"])
def test_truncated_at_any_place(tmp_path: Path, kind: str) -> None:
    """A file that ends early gives all of its messages or one sentence."""
    whole = write_bag(tmp_path, kind, {"/joints": JOINT_STATE}, count=300)
    content = whole.read_bytes()
    cut = tmp_path / f"cut{whole.suffix}"
    refused = 0
    for size in np.linspace(0, len(content) - 1, 40).astype(int):
        cut.write_bytes(content[:size])
        try:
            assert len(read(cut, "/joints")) == 300
        except BagError as error:
            refused += 1
            assert str(error).startswith(str(cut))
            assert "\n" not in str(error)
    assert refused > 35
    cut.write_bytes(b"")
    with pytest.raises(BagError, match="is empty"):
        read(cut, "/joints")
    cut.write_bytes(content[: len(content) // 2])
    with pytest.raises(
        BagError, match=r"is damaged or incomplete .*; try `.*(reindex|recover|sqlite3) .*`"
    ):
        read(cut, "/joints")


def test_what_is_no_bag(tmp_path: Path) -> None:
    """Missing paths, other files and plain folders have errors of their own."""
    with pytest.raises(BagError, match=r"There is no bag .*nothing\.bag"):
        read(tmp_path / "nothing.bag", "/joints")
    (tmp_path / "notes.md").write_text("hello")
    with pytest.raises(BagError, match=r"notes\.md is not a bag; give a \.bag, \.mcap or \.db3"):
        read(tmp_path / "notes.md", "/joints")
    shutil.copy(tmp_path / "notes.md", tmp_path / "notes.mcap")
    (tmp_path / "folder").mkdir()
    with pytest.raises(BagError, match=r"folder has no file of a bag; give another folder, or a"):
        read(tmp_path / "folder", "/joints")
    with pytest.raises(BagError, match=r"notes\.mcap does not begin like a \.mcap file"):
        read(tmp_path / "notes.mcap", "/joints")


def test_missing_rosbags(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the extra, the error names the command that installs it."""
    store = store_of("mcap")
    monkeypatch.setitem(sys.modules, "rosbags.interfaces", None)
    with pytest.raises(BagError, match=r"pip install linkage_vibration\[bags\]"):
        read(tmp_path / "a.bag", "/joints", store=store)


@pytest.mark.parametrize("kind", ["mcap", pytest.param("db3", marks=pytest.mark.nightly)])
def test_memory_does_not_grow_with_the_bag(tmp_path: Path, kind: str) -> None:
    """Twice as many messages need nearly the same memory."""
    peaks = []
    for count in (20_000, 40_000):
        folder = tmp_path / str(count)
        folder.mkdir()
        path = write_bag(folder, kind, {"/joints": JOINT_STATE}, count)
        tracemalloc.start()
        with open_bags([path]) as bags:
            for _ in bags.blocks(["/joints"]):
                pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.3 * peaks[0]
