# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the description of sensors, and what they measured: in bags, on a CAN bus, and as CSV."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from linkage_vibration.bags.can_frames import FRAME_TYPES
from linkage_vibration.bags.can_reader import CanReader, find_signal
from linkage_vibration.bags.field_reader import FieldReader
from linkage_vibration.bags.message_types import IMU
from linkage_vibration.bags.numbers import Integers, LeftOut, NumberReader
from linkage_vibration.bags.schemas import FieldError, Schema
from linkage_vibration.bags.streams import Bags, open_bags
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.keys import Keys
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.readers.recordings import read_recording

GRAVITY = 9.80665  # m/s^2
_UNITS = {
    "acceleration": {"m/s2": 1.0, "g": GRAVITY},
    "force": {"N": 1.0, "kN": 1e3, "%": 0.01},
    "pressure": {"Pa": 1.0, "kPa": 1e3, "bar": 1e5},
}
_FORCES = {"%": "full_scale", "Pa": "area", "kPa": "area", "bar": "area"}  # keys that give newtons
_PATHS = {IMU: "linear_acceleration", "geometry_msgs/msg/AccelStamped": "accel.linear"}
_AXES = {f"{sign}{axis}": i for sign in ("", "-") for i, axis in enumerate("xyz")}


class SensorError(LinkageVibrationError):
    """A description of sensors is invalid, or what they measured cannot be read."""


@dataclass(frozen=True, slots=True, eq=False)
class Sensor:
    """What a sensor measures, where, and how it is read.

    Attributes
    ----------
    name : str
    at : str
        A point of the mechanism, ``seat``, or a force of the table such as "lift_cylinders.force".
    accelerates : bool
        Whether it measures an acceleration along three axes, or else one force.
    scale : float
        m/s^2 or N per unit.
    axes : ndarray, (3, 3) or (1, 1)
        Turns readings into the axes of the tractor, of which z points up.
    limit : float
        The largest reading, in its unit; infinity if it is not known.
    file : Path, optional
        A bag or a CSV file; None for the log itself.
    topic, fields, columns
        Where the numbers are in a bag, or in a CSV file, whose first column is the time.
    starts_at : float
        Time of the first sample of a CSV file since the first prediction, s.
    filtered : bool
        Whether it has an anti-aliasing filter.
    """

    name: str
    at: str
    accelerates: bool
    scale: float
    axes: FloatArray
    limit: float
    file: Path | None
    topic: str
    fields: tuple[str, ...]
    columns: tuple[int, ...]
    starts_at: float
    filtered: bool


def read_sensors(path: Path) -> list[Sensor]:
    """Read the sensors in a YAML file; a SensorError names the key and the fix."""
    try:
        keys = Keys(f"{path}: sensors", load_yaml(path)[0])
        sensors = [_sensor(keys[name], name, path.parent) for name in keys]
        keys.refuse_unknown()
    except MechanismError as error:
        raise SensorError(str(error)) from None
    if not sensors:
        raise SensorError(f"{path}: there is no sensor; describe at least one by its name.")
    return sensors


def _sensor(keys: Keys, name: str, folder: Path) -> Sensor:
    quantity = keys.choice("quantity", list(_UNITS), default="acceleration")
    unit = keys.choice("unit", list(_UNITS[quantity]))
    factor = keys.number(_FORCES[unit], positive=True) if unit in _FORCES else 1.0
    accelerates = quantity == "acceleration"
    count, file, topic = 3 if accelerates else 1, None, ""
    fields, columns = tuple[str, ...](), tuple[int, ...]()
    if "file" in keys:
        file = folder / keys.text("file")
    if file is not None and file.suffix.lower() == ".csv":
        usual = [2.0, 3.0, 4.0][:count]
        columns = tuple(int(n) for n in (keys.numbers("columns") if "columns" in keys else usual))
    else:
        topic = keys.text("topic")
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
        limit=keys.number("range", default=np.inf) if "range" in keys else np.inf,
        file=file,
        topic=topic,
        fields=fields,
        columns=columns,
        starts_at=keys.number("starts_at", default=0.0),
        filtered=keys.flag("filtered") if "filtered" in keys else False,
    )


def _axes(keys: Keys) -> FloatArray:
    """Return the rotation from the axes of a sensor to those of the tractor, (3, 3)."""
    if "axes" not in keys:
        return np.eye(3)
    if keys.is_mapping("axes"):
        angles = [keys["axes"].number(each, default=0.0) for each in ("roll", "pitch", "yaw")]
        return np.asarray(Rotation.from_euler("xyz", angles, degrees=True).as_matrix())
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
        times, every = read_recording(path)
        if not len(times) or max(sensor.columns) > every.shape[1] + 1 or min(sensor.columns) < 2:
            known = f"it has {every.shape[1] + 1} columns and {len(times)} lines of numbers"
            raise SensorError(f"{path}: {sensor.name} needs columns that it lacks; {known}.")
        chosen = every[:, [column - 2 for column in sensor.columns]]
        return times - times[0] + sensor.starts_at, chosen
    with open_bags([path]) as bags:
        types, defined = {one.name: one.type for one in bags.topics}, bags.defined(sensor.topic)
        if defined is None or sensor.topic not in types:
            names = f"it has {', '.join(types) or 'none'}"
            raise SensorError(f"{path}: has no topic {sensor.topic} for {sensor.name}; {names}.")
        try:
            readers = _readers(sensor, types[sensor.topic], defined[2])
        except FieldError as error:
            raise SensorError(f"{sensor.name}: {error}") from None
        stamps, values = _numbers(bags, sensor.topic, readers)
    if not len(stamps):
        raise SensorError(f"{path}: {sensor.topic} has no reading for {sensor.name}; record more.")
    order = np.argsort(stamps, kind="stable")
    return np.asarray((stamps[order] - start) / 1e9), values[order]


def _readers(sensor: Sensor, type_name: str, schema: Schema) -> list[NumberReader]:
    """Return a reader for each number; the fields of usual messages are known."""
    if type_name in FRAME_TYPES:
        return [CanReader(find_signal(field, ""), type_name) for field in sensor.fields]
    usual = [f"{_PATHS[type_name]}.{axis}" for axis in "xyz"] if type_name in _PATHS else []
    if not (sensor.fields or usual):
        raise SensorError(f"{sensor.name}: name the three fields of {type_name} under fields.")
    return [FieldReader(schema, type_name, field) for field in sensor.fields or usual]


def _numbers(bags: Bags, topic: str, readers: list[NumberReader]) -> tuple[Integers, FloatArray]:
    """Return stamps of messages, ns, (n,), and the numbers that all readers find in them."""
    stamps, values = [np.empty(0, np.int64)], [np.empty((0, len(readers)))]
    for block in bags.blocks([topic]):
        rows, left_out = np.arange(len(block)), LeftOut()
        numbers, at = np.full((len(block), len(readers)), np.nan), block.log_times.copy()
        for column, reader in enumerate(readers):
            for part in reader.read(block, rows, left_out):
                numbers[part.rows, column] = part.value
                stamped = part.sec.astype(np.int64) * 10**9 + part.nanosec
                at[part.rows] = np.where(stamped > 0, stamped, at[part.rows])
        known = np.isfinite(numbers).all(axis=1)
        stamps.append(at[known])
        values.append(numbers[known])
    return np.concatenate(stamps), np.concatenate(values)
