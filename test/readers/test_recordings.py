# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of accelerometers are read from CSV files of phones and from bags with an IMU."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.readers.recordings import (
    RecordingError,
    ordered,
    read_recording,
    shows_sides,
    vibrating,
)

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types


def imu_bag(path: Path, topics: dict[str, int], *, stamped: bool) -> Path:
    """Write a bag in which each topic has so many IMU messages, 10 ms apart."""
    vector, stamp = TYPES["geometry_msgs/msg/Vector3"], TYPES["builtin_interfaces/msg/Time"]
    turn = TYPES["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    kind, unknown = "sensor_msgs/msg/Imu", np.zeros(9)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        for topic, count in topics.items():
            connection = bag.add_connection(topic, kind, typestore=STORE)
            for i in range(count):
                ns = 10_000_000 * i
                time = stamp(sec=5, nanosec=ns) if stamped else stamp(sec=0, nanosec=0)
                message = TYPES[kind](
                    header=TYPES["std_msgs/msg/Header"](stamp=time, frame_id="implement"),
                    orientation=turn,
                    orientation_covariance=unknown,
                    angular_velocity=vector(x=0.1 * i, y=0.2, z=0.3),
                    angular_velocity_covariance=unknown,
                    linear_acceleration=vector(x=1.0 * i, y=2.0, z=9.81),
                    linear_acceleration_covariance=unknown,
                )
                bag.write(connection, 10**9 + ns, STORE.serialize_cdr(message, kind))
    return path


@pytest.mark.parametrize("stamped", [True, False])
def test_bag(tmp_path: Path, stamped: bool) -> None:
    """Accelerations and rates are the channels, at the stamps or at the times of recording."""
    path = imu_bag(tmp_path / "bag", {"/imu": 30}, stamped=stamped)
    times, signals = read_recording(path)
    np.testing.assert_allclose(times, 0.01 * np.arange(30), atol=1e-9)
    assert signals.shape == (30, 6)
    np.testing.assert_allclose(signals[:, 0], np.arange(30))
    np.testing.assert_allclose(signals[:, 3], 0.1 * np.arange(30))


@pytest.mark.parametrize(
    "text",
    [
        "time,x,z\n0.0,1.0,2.0\n0.1,3.0,4.0\n",
        '"Time (s)";"Acceleration x (m/s^2)";"z"\n0,0;1,0;2,0\n0,1;3,0;4,0\n',
        "t\tx\tz\n0.1\t3\t4\n0.0\t1\t2\n",
        "t\tx\tz\r\n0,0\t1,0\t2,0\r\n0,1\t3,0\t4,0\r\n",
        'sep=,\n# phone\n"t","x","z",\n"0.0","1","2",\n0.05,,,\n"0.1","3","4",\n\n',
        "0.0,1.0,2.0\n0.1,3.0,4.0\n",
    ],
)
def test_csv(tmp_path: Path, text: str) -> None:
    """Commas, and semicolons or tabs with decimal commas, separate; empty cells are left out."""
    path = tmp_path / "phone.csv"
    path.write_text(text)
    times, signals = read_recording(path)
    np.testing.assert_array_equal(times, [0.0, 0.1])
    np.testing.assert_array_equal(signals, [[1.0, 2.0], [3.0, 4.0]])


@pytest.mark.parametrize(
    ("titles", "sides"),
    [
        ("t,acceleration x (m/s2),acceleration_z", False),
        ("Time (s);Y;Z", True),
        ("time,x,y,z", True),
        ("time,axial,zenith", True),  # no letter alone
        ("0.0,1.0,2.0", True),
    ],
)
def test_titles_without_y_are_in_the_plane(tmp_path: Path, titles: str, sides: bool) -> None:
    """Only titles that name x or z say that nothing across was recorded; a bag has all axes."""
    path = tmp_path / "phone.csv"
    path.write_text(f"\ufeff{titles}\n0.1,3.0,4.0\n", encoding="utf-8")
    assert shows_sides(path) is sides
    assert shows_sides(tmp_path / "bag.mcap")


def test_messages_may_overtake_one_another() -> None:
    """Times that go back by up to half a second are sorted; by more, they are of two recordings."""
    times, signals = ordered(Path("a"), np.array([0.0, 1.0, 0.51]), np.eye(3))
    assert times.tolist() == [0.0, 0.51, 1.0]
    assert signals.argmax(axis=1).tolist() == [0, 2, 1]
    with pytest.raises(RecordingError, match=r"a: the times go back by 0\.51 s; give one"):
        ordered(Path("a"), np.array([0.0, 1.0, 0.49]), np.eye(3))


@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize("digits", [2, 9])
def test_magnitudes_are_left_out(gravity: float, digits: int) -> None:
    """The root of the sum of squares is no channel, wherever it stands; what it is made of is one.

    A phone rounds to the digits that it writes.
    """
    random, decay = np.random.default_rng(0), np.exp(-np.arange(2000) / 400.0)[:, np.newaxis]
    waves = np.sin(np.outer(np.arange(2000), [0.1, 0.23, 0.31])) * [1.0, 0.5, 2.0]
    axes = (decay * waves + random.normal(0.0, 0.05, waves.shape) + [0.0, 0.0, gravity]).round(2)
    size = np.linalg.norm(axes, axis=1).round(digits)
    for i in (0, 2, 3):
        kept, [note] = vibrating(np.insert(axes, i, size, axis=1))
        np.testing.assert_array_equal(kept, np.insert(axes, i, 0.0, axis=1))
        assert note.startswith(f"channel {i + 1} is the magnitude of others")
    other = np.linalg.norm(axes + random.normal(0.0, 0.05, axes.shape), axis=1)
    for signals in (axes, axes[:, 2:], np.column_stack([axes, other])):
        kept, notes = vibrating(signals)
        assert (kept == signals).all()
        assert not notes


@pytest.mark.parametrize(
    ("column", "vibrates"),
    [
        (np.arange(1000), False),  # a counter
        (np.arange(1000) % 256, False),  # one of a byte
        (1.7e9 + 0.0025 * np.arange(1000), False),  # a time
        (99.0 - np.arange(1000) // 300, False),  # a battery
        (np.cumsum(np.where(np.arange(1000) % 50 < 2, -1.0, 1.0)), False),  # 92 % more rise
        (np.cumsum(np.where(np.arange(1000) % 50 < 3, -1.0, 1.0)), True),  # 88 %
        (np.sin(0.1 * np.arange(1000)) + 0.01 * np.arange(1000), True),
        (np.full(1000, 9.81), True),  # it is left out elsewhere
    ],
)
def test_times_and_counters_are_left_out(column: FloatArray, vibrates: bool) -> None:
    """What hardly ever changes in both directions shows no vibration."""
    wave = np.sin(0.3 * np.arange(1000))
    kept, notes = vibrating(np.column_stack([column, wave]))
    assert (kept[:, 1] == wave).all()
    assert (kept[:, 0] == (column if vibrates else 0.0)).all()
    words = [] if vibrates else ["channel 1 changes in one direction, as a time or counter"]
    assert [note.partition(", and")[0] for note in notes] == words
