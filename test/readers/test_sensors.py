# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors are described in YAML, and read from CSV files, bags and a CAN bus."""

import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.schemas import schema_of_store
from linkage_vibration.messages.topics import log_topic
from linkage_vibration.readers.sensors import SensorError, SensorReader, read_measured, read_sensors
from test.support.can_bus import EPOCH, BusFrame, identifier, write_candump

ACCEL = "geometry_msgs/msg/AccelStamped"


def sensors(folder: Path, text: str) -> Path:
    """Write a file with one sensor."""
    path = folder / "sensors.yaml"
    path.write_text(f"imu: {{{text}}}")
    return path


def test_csv_of_a_phone(tmp_path: Path) -> None:
    """Columns are counted from 1, the first one is the time, and it begins when the file says."""
    (tmp_path / "phone.csv").write_text("t,x,y,z,all\n5,0,0,1,1\n5.5,0.1,0.2,1.1,2\n")
    text = "file: phone.csv, unit: g, at: E1, columns: [4, 2, 3], starts_at: 2"
    [sensor] = read_sensors(sensors(tmp_path, text))
    times, values = read_measured(sensor, tmp_path / "log.mcap", 0)
    assert times.tolist() == [2.0, 2.5]
    assert values.tolist() == [[1.0, 0.0, 0.0], [1.1, 0.1, 0.2]]
    assert sensor.scale == 9.80665


def test_other_columns_of_a_csv_change_nothing(tmp_path: Path) -> None:
    """Empty columns count, lines keep their readings beside cells that nobody reads."""
    lines = [
        "t,gyro,x,y,z,gps",
        "0,,1,2,3,5",
        "1,,1,2,4,",
        "2,,1,,4,",
        "3,,1,2,inf,",
        "4,,1e12,2,6,",
        "5,,1,-1e12,6,",
    ]
    (tmp_path / "phone.csv").write_text("\n".join(lines))
    text = "file: phone.csv, unit: g, at: E1, columns: [3, 4, 5]"
    [sensor] = read_sensors(sensors(tmp_path, text))
    times, values = read_measured(sensor, tmp_path / "log.mcap", 0)
    assert times.tolist() == [0.0, 1.0]
    assert values.tolist() == [[1.0, 2.0, 3.0], [1.0, 2.0, 4.0]]
    [sensor] = read_sensors(sensors(tmp_path, "file: phone.csv, unit: g, at: E1"))
    with pytest.raises(SensorError, match=r"no line has numbers in .* and in 2, 3, 4 of imu"):
        read_measured(sensor, tmp_path / "log.mcap", 0)


def test_fields_of_a_message(tmp_path: Path) -> None:
    """The fields of an AccelStamped are known, and its stamps are the times.

    Numbers of 1e12 and more are no readings, in a bag and in a message of a running node.
    """
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind, vector = store.types[ACCEL], store.types["geometry_msgs/msg/Vector3"]
    header, stamp = (
        store.types[name] for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    messages = list[bytes]()
    with LogWriter(tmp_path / "log.mcap", [log_topic("/a", ACCEL)]) as log:
        for second, z in ((3, 3.0), (2, 2.0), (4, -1e12), (5, 1e12)):
            accel = store.types["geometry_msgs/msg/Accel"](
                vector(1.0, 2.0, z), vector(0.0, 0.0, 0.0)
            )
            message = kind(header(stamp(second, 5 * 10**8), ""), accel)
            messages.append(bytes(store.serialize_cdr(message, ACCEL)))
            log.write("/a", messages[-1], 10**9, 10**9)
    [sensor] = read_sensors(sensors(tmp_path, "topic: /a, unit: m/s2, at: E1"))
    reader = SensorReader(sensor, ACCEL, schema_of_store(store, ACCEL))
    newest, *others = (reader.read_one(data, 10**9) for data in messages)
    assert newest == (3_500_000_000, "", (1.0, 2.0, 3.0))
    assert [each is None for each in others] == [False, True, True]
    times, values = read_measured(sensor, tmp_path / "log.mcap", 10**9)
    assert times.tolist() == [1.5, 2.5]
    assert values.tolist() == [[1.0, 2.0, 2.0], [1.0, 2.0, 3.0]]


def test_draft_of_the_rear_hitch(tmp_path: Path) -> None:
    """Bytes 4 and 5 of group 65093 are the draft in 10 N from -320 kN; 0xFFFF is not available."""
    data = [0xFF, 0xFF, 125, *(32500).to_bytes(2, "little"), 0xFF, 0xFF, 0xFF]
    missing = [*data[:3], 0xFF, 0xFF, *data[5:]]
    frames = [
        BusFrame(EPOCH, identifier(65093), bytes(data)),
        BusFrame(EPOCH + 10**9, identifier(65093), bytes(missing)),
    ]
    write_candump(tmp_path / "bus.log", frames)
    for field, unit, more, expected in (
        ("rear_draft", "N", "", [5000.0]),
        ("rear_lower_link_force", "%", ", full_scale: 90000", [0.0, 0.0]),
    ):
        text = f"file: bus.log, topic: /can0, fields: [{field}], quantity: force, unit: '{unit}'"
        path = sensors(tmp_path, f"{text}, at: lower_link:P1.force_x{more}")
        [sensor] = read_sensors(path)
        _, values = read_measured(sensor, tmp_path / "log.mcap", EPOCH)
        assert values[:, 0].tolist() == expected
    assert sensor.scale == 900.0


@pytest.mark.parametrize(
    ("axes", "reading", "expected"),
    [
        ("[x, -y, -z]", (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)),
        ("[-z, y, x]", (1.0, 2.0, 3.0), (3.0, 2.0, -1.0)),
        ("{pitch: 90}", (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
        ("{roll: 180}", (0.0, 1.0, 1.0), (0.0, -1.0, -1.0)),
    ],
)
def test_axes(
    tmp_path: Path, axes: str, reading: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    """Axes say where x, y and z of the sensor point; angles are those of a URDF, in degrees."""
    path = sensors(tmp_path, f"topic: /a, unit: g, at: E1, axes: {axes}")
    [sensor] = read_sensors(path)
    np.testing.assert_allclose(sensor.axes @ reading, expected, atol=1e-12)
    assert math.isclose(np.linalg.det(sensor.axes), 1.0)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("topic: /a, unit: bar, at: E1", "imu.unit: 'bar' is not one of: m/s2, g"),
        ("topic: /a, unit: bar, at: x, quantity: pressure", "imu.area: this key is missing"),
        ("topic: /a, unit: g, at: E1, axes: [x, y, -z]", "is not a rotation; say where"),
        ("file: a.csv, unit: N, quantity: force, at: a, columns: [2, 3]", "2 are given; give one"),
        ("file: a.csv, unit: g, at: E1, columns: [1, 2, 3]", "1, 2, 3 are given; give different"),
        ("file: a.csv, unit: g, at: E1, columns: [2.5, 3, 4]", "2.5, 3, 4 are given; give diff"),
        ("topic: /a, unit: g, at: E1, range: 0", "imu.range: 0 is not greater than zero"),
        ("unit: g, at: E1", "imu.topic: this key is missing"),
        ("topic: /a, unit: g, at: E1, gain: 2", "imu.gain"),
    ],
)
def test_invalid_descriptions(tmp_path: Path, text: str, problem: str) -> None:
    """An error names the file, the key and the fix."""
    path = sensors(tmp_path, text)
    with pytest.raises(SensorError, match=r"sensors\.yaml") as error:
        read_sensors(path)
    assert problem in str(error.value)
