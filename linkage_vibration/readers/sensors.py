# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the description of sensors, and what they measured: in bags, on a CAN bus, and as CSV."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from linkage_vibration.bags.blocks import Block
from linkage_vibration.bags.can_frames import FRAME_TYPES
from linkage_vibration.bags.can_reader import CanReader, find_signal
from linkage_vibration.bags.field_reader import FieldReader
from linkage_vibration.bags.message_types import IMU
from linkage_vibration.bags.scalar_reader import Integers, NumberReader, SkippedMessages
from linkage_vibration.bags.schemas import FieldError, Schema
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.forces import GRAVITY
from linkage_vibration.mechanics.keys import CheckedMapping
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.readers.recordings import ordered, read_table
from linkage_vibration.support.resources import command

_UNITS = {
    "acceleration": {"m/s2": 1.0, "g": GRAVITY},
    "force": {"N": 1.0, "kN": 1e3, "%": 0.01},
    "pressure": {"Pa": 1.0, "kPa": 1e3, "bar": 1e5},
}
_FORCES = {"%": "full_scale", "Pa": "area", "kPa": "area", "bar": "area"}  # keys that give newtons
_PATHS = {IMU: "linear_acceleration", "geometry_msgs/msg/AccelStamped": "accel.linear"}
LARGEST = 1e12
"""A larger number is not a measured one, whatever its unit; its square has no meaning."""
SENSORS = "sensors.yaml"
"""The name of the file of sensors in a log."""
_AXES = {f"{sign}{axis}": i for sign in ("", "-") for i, axis in enumerate("xyz")}


class SensorError(LinkageVibrationError):
    """A description of sensors is invalid, or what they measured cannot be read."""


@dataclass(frozen=True, slots=True, eq=False)
class Sensor:
    """What a sensor measures, where, and how it is read: by topic, or by columns of a CSV file."""

    name: str
    at: str  # a point, or a force such as "lift_cylinders.force"
    accelerates: bool  # along three axes; or else one force
    scale: float  # m/s^2 or N per unit
    axes: FloatArray  # (3, 3) or (1, 1): from readings to the tractor's axes, z up
    limit: float  # largest reading, in its unit, or infinity
    file: Path | None  # a bag or a CSV file; None for the log
    topic: str
    type: str
    fields: tuple[str, ...]
    columns: tuple[int, ...]
    starts_at: float  # s since the first prediction, of a CSV file
    filtered: bool  # against aliasing


def read_sensors(path: Path) -> list[Sensor]:
    """Read the sensors in a YAML file; a SensorError names the key and the fix."""
    try:
        keys = CheckedMapping(f"{path}: sensors", load_yaml(path)[0])
        sensors = [_sensor(keys[name], name, path.parent) for name in keys]
        keys.refuse_unknown()
    except MechanismError as error:
        raise SensorError(str(error)) from None
    if not sensors:
        raise SensorError(f"{path}: there is no sensor; describe at least one by its name.")
    return sensors


def sensor_files(path: Path | None) -> dict[str, bytes]:
    """Return the file of the sensors as a log attaches it, if there is one."""
    return {} if path is None else {SENSORS: path.read_bytes()}


def live_sensors(path: Path) -> list[Sensor]:
    """Read the sensors in a YAML file; a SensorError names one that is not on a topic."""
    sensors = read_sensors(path)
    for sensor in sensors:
        if not sensor.topic:
            text = f"{sensor.name} is in a CSV file, which only `{command('listen')}` reads"
            raise SensorError(f"{path}: {text}; give its topic.")
    return sensors


def _sensor(keys: CheckedMapping, name: str, folder: Path) -> Sensor:
    quantity = keys.choice("quantity", list(_UNITS), default="acceleration")
    unit = keys.choice("unit", list(_UNITS[quantity]))
    factor = keys.number(_FORCES[unit], positive=True) if unit in _FORCES else 1.0
    accelerates = quantity == "acceleration"
    count, file, topic, type_name = 3 if accelerates else 1, None, "", ""
    fields, columns = tuple[str, ...](), tuple[int, ...]()
    if "file" in keys:
        file = folder / keys.text("file")
    if file is not None and file.suffix.lower() == ".csv":
        columns = _columns(keys) if "columns" in keys else (2, 3, 4)[:count]
    else:
        topic = keys.text("topic")
        type_name = keys.text("type") if "type" in keys else IMU
        if "fields" in keys or not accelerates:
            fields = keys.words("fields")
    if (fields or columns) and len(fields or columns) != count:
        what = "columns" if columns else "fields"
        wanted = "three, along x, y and z of the sensor" if accelerates else "one"
        raise keys.error(what, f"{len(fields or columns)} are given; give {wanted}.")
    return Sensor(
        name=name,
        at=keys.text("at"),
        accelerates=accelerates,
        scale=_UNITS[quantity][unit] * factor,
        axes=_axes(keys) if accelerates else np.eye(1),
        limit=keys.number("range", positive=True, default=np.inf),
        file=file,
        topic=topic,
        type=type_name,
        fields=fields,
        columns=columns,
        starts_at=keys.number("starts_at", default=0.0),
        filtered=keys.flag("filtered"),
    )


def _columns(keys: CheckedMapping) -> tuple[int, ...]:
    """Return the columns of a CSV file, which count from 1; the first is the time."""
    numbers = keys.numbers("columns")
    if any(n < 2.0 or n != round(n) for n in numbers) or len(set(numbers)) < len(numbers):
        hint = "give different whole numbers from 2, as column 1 is the time"
        raise keys.error("columns", f"{', '.join(f'{n:g}' for n in numbers)} are given; {hint}.")
    return tuple(int(n) for n in numbers)


def _axes(keys: CheckedMapping) -> FloatArray:
    """Return the rotation from the axes of a sensor to those of the tractor, (3, 3)."""
    if "axes" not in keys:
        return np.eye(3)
    if keys.is_mapping("axes"):
        angles = [keys["axes"].number(each, default=0.0) for each in ("roll", "pitch", "yaw")]
        rotation = scipy.spatial.transform.Rotation.from_euler("xyz", angles, degrees=True)
        return np.asarray(rotation.as_matrix())
    words, axes = keys.words("axes"), np.zeros((3, 3))
    for column, word in enumerate(words[:3]):
        if word in _AXES:
            axes[_AXES[word], column] = -1.0 if word.startswith("-") else 1.0
    if len(words) != 3 or not np.linalg.det(axes) > 0.0:
        hint = "say where x, y and z of the sensor point, such as [x, y, z] or [-x, -y, z]"
        raise keys.error("axes", f"{', '.join(words)} is not a rotation; {hint}.")
    return axes


def read_measured(sensor: Sensor, log: Path, start: int) -> tuple[FloatArray, FloatArray]:
    """Return times since a stamp (ns), s, (n,), and readings in units of the sensor, (n, k)."""
    path = sensor.file or log
    if sensor.columns:
        times, chosen = _read_csv(sensor, path)
        return times - times[0] + sensor.starts_at, chosen
    from linkage_vibration.bags.streams import open_bags  # a node may lack the library for bags

    with open_bags([path]) as bags:
        types, defined = {each.name: each.type for each in bags.topics}, bags.defined(sensor.topic)
        if defined is None or sensor.topic not in types:
            names = f"it has {', '.join(types) or 'none'}"
            raise SensorError(f"{path}: has no topic {sensor.topic} for {sensor.name}; {names}.")
        reader, left_out = SensorReader(sensor, types[sensor.topic], defined[2]), SkippedMessages()
        stamps, values = [np.empty(0, np.int64)], [np.empty((0, len(sensor.axes)))]
        for block in bags.blocks([sensor.topic]):
            for _, part, numbers, _ in reader.read(block, np.arange(len(block)), left_out):
                stamps.append(part)
                values.append(numbers)
    stamps_read, readings = np.concatenate(stamps), np.concatenate(values)
    if not len(stamps_read):
        raise SensorError(f"{path}: {sensor.topic} has no reading for {sensor.name}; record more.")
    order = np.argsort(stamps_read, kind="stable")
    return np.asarray((stamps_read[order] - start) / 1e9), readings[order]


def _read_csv(sensor: Sensor, path: Path) -> tuple[FloatArray, FloatArray]:
    """Return times, s, and readings of the lines of a CSV file in which no reading is missing."""
    table = read_table(path)
    if max(sensor.columns) > table.shape[1]:
        text = f"{sensor.name} needs column {max(sensor.columns)}, and it has {table.shape[1]}"
        raise SensorError(f"{path}: {text}; correct columns.")
    chosen = table[:, [column - 1 for column in sensor.columns]]
    chosen[~(np.abs(chosen) < LARGEST)] = np.nan
    times, readings = ordered(path, table[:, 0], chosen)
    if not len(times):
        names = ", ".join(map(str, sensor.columns))
        text = f"no line has numbers in column 1, the time, and in {names} of {sensor.name}"
        raise SensorError(f"{path}: {text}; correct columns, or the file.")
    return times, readings


class SensorReader:
    """Reads the numbers of a sensor from messages, with the stamps of headers, or of receipt."""

    def __init__(self, sensor: Sensor, type_name: str, schema: Schema) -> None:
        self.name, usual = sensor.name, list[str]()
        if type_name in _PATHS:
            usual = [f"{_PATHS[type_name]}.{axis}" for axis in "xyz"]
        fields = list(sensor.fields) or usual
        if not fields:
            raise SensorError(f"{sensor.name}: name the three fields of {type_name} under fields.")
        try:
            self._readers: list[NumberReader] = [
                CanReader(find_signal(field, ""), type_name)
                if type_name in FRAME_TYPES
                else FieldReader(schema, type_name, field)
                for field in fields
            ]
        except FieldError as error:
            raise SensorError(f"{sensor.name}: {error}") from None

    def read_one(self, data: bytes, received: int) -> tuple[int, str, tuple[float, ...]] | None:
        """Return the stamp, ns, the frame and the numbers of a message; None if it lacks one."""
        numbers = [reader.read_one(data) for reader in self._readers]
        values = tuple(math.nan if each is None else each.value for each in numbers)
        if not all(abs(value) < LARGEST for value in values) or numbers[0] is None:
            return None
        stamp = 10**9 * numbers[0].sec + numbers[0].nanosec
        return stamp if stamp > 0 else received, numbers[0].frame_id, values

    def read(
        self, block: Block, rows: Integers, left_out: SkippedMessages
    ) -> Iterator[tuple[Integers, Integers, FloatArray, str]]:
        """Yield rows, stamps, ns, numbers, (n, k), and frames of messages, as `read_one` does."""
        values, parts = np.full((len(block), len(self._readers)), math.nan), []
        for column, reader in enumerate(self._readers):
            for part in reader.read(block, rows, left_out):
                values[part.rows, column] = part.value
                if not column:
                    parts.append(part)
        for part in parts:
            numbers = values[part.rows]
            has_all = (np.abs(numbers) < LARGEST).all(axis=1)
            stamps = 10**9 * part.sec.astype(np.int64) + part.nanosec
            stamps = np.where(stamps > 0, stamps, block.log_times[part.rows])
            yield part.rows[has_all], stamps[has_all], numbers[has_all], part.frame_id
