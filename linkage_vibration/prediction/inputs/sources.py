# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The inputs of the node: where a number comes from, and the crank angle or speed that it means."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.can_reader import CanReader, find_signal
from linkage_vibration.bags.field_reader import FieldReader
from linkage_vibration.bags.message_types import CAN_FRAME, JOINT_STATE
from linkage_vibration.bags.numbers import Integers, LeftOut, NumberReader, Numbers
from linkage_vibration.bags.schemas import FieldError, Schema, SchemaField, find_path
from linkage_vibration.bags.streams import Block
from linkage_vibration.prediction.inputs.joint_state import JointReader
from linkage_vibration.prediction.inputs.units import HitchScale, InputError, Reading, wrong_unit

FloatArray = NDArray[np.float64]

HEADER_TIME, RECEIPT_TIME = TIMES = ("header", "receipt")

_JOINT_LISTS = [SchemaField(n, "float64", 0) for n in ("position", "velocity", "effort")]
_HEADER = SchemaField("header", "std_msgs/msg/Header")
_JOINT_FIELDS = (_HEADER, SchemaField("name", "string", 0), *_JOINT_LISTS)
_FRAME_FIELDS = (
    _HEADER,
    SchemaField("id", "uint32"),
    *(SchemaField(name, "bool") for name in ("is_rtr", "is_extended", "is_error")),
    SchemaField("dlc", "uint8"),
    SchemaField("data", "uint8", 8),
)


@dataclass(frozen=True, slots=True)
class SourceSettings:
    """Where an input comes from, as the parameters say.

    Attributes
    ----------
    name : str
        The input: "hitch", "engine", "pto" or "ground".
    topic, type, field : str
        Name of the topic, type of its messages, and path to the number in them.
    time : str
        "header", "receipt", or empty for the default.
    delay : float
        Time from the moment of a value to its receipt, s.
    low, high : float
        A number outside of this range means that the value is not available.
    chosen : bool
        Whether a parameter names the topic.
    database : str
        Path of the DBC file of CAN signals, or empty.
    unit : str
        The unit in which the number has to be; empty if ``scale`` converts it.
    """

    name: str
    topic: str
    type: str
    field: str
    time: str
    delay: float
    low: float
    high: float
    chosen: bool
    database: str = ""
    unit: str = ""

    def reader(self, schema: Schema) -> NumberReader:
        """Return the reader of the number.

        Parameters
        ----------
        schema : Schema
            The fields of the type.

        Raises
        ------
        InputError
            If the type has no such number, or if its messages have no header, from which the time
            is to come.
        """
        try:
            reader = READERS.get(self.type, _field_reader)(schema, self)
        except FieldError as error:
            raise InputError(f"Parameter {self.name}_field: {error}") from None
        if self.time == HEADER_TIME and not reader.has_header:
            raise InputError(
                f"Messages of {self.type} do not begin with a header; write `{self.name}_time: "
                f"{RECEIPT_TIME}`."
            )
        return reader


def _field_reader(schema: Schema, source: SourceSettings) -> NumberReader:
    return FieldReader(schema, source.type, source.field)


def _joint_reader(schema: Schema, source: SourceSettings) -> NumberReader:
    """Return the reader of a joint's position and velocity, or the reader of another field."""
    last = find_path(schema, source.type, source.field)[-1]
    standard = schema[source.type] == _JOINT_FIELDS
    if standard and last.field.name == "position" and last.name:
        return JointReader(schema, source.type, source.field, last)
    return _field_reader(schema, source)


def _can_reader(schema: Schema, source: SourceSettings) -> NumberReader:
    if schema[source.type] != _FRAME_FIELDS:
        raise InputError(
            f"{source.type} is defined in another way than by can_msgs; convert the messages."
        )
    signal = find_signal(source.field, source.database)
    if wrong := wrong_unit(signal.unit, source.unit, source.name):
        raise InputError(f"Parameter {source.name}_field: {signal.name} {wrong}")
    return CanReader(signal)


READERS: dict[str, Callable[[Schema, SourceSettings], NumberReader]] = {
    JOINT_STATE: _joint_reader,
    CAN_FRAME: _can_reader,
}
"""The readers of types for which there is another one than `FieldReader`."""


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The crank angles of messages that have the same frame, by columns.

    Attributes
    ----------
    rows : ndarray, (n,)
        Which messages of the block they are.
    crank_angle, velocity, stddev : ndarray, (n,)
        As those of `Reading`.
    sec, nanosec : ndarray, (n,)
        Stamps, s and ns.
    times : ndarray, (n,)
        When they are assessed, ns.
    frame_id : str
        Frame of the headers; empty for messages without a header.
    """

    rows: Integers
    crank_angle: FloatArray
    velocity: FloatArray
    stddev: FloatArray
    sec: NDArray[np.int32]
    nanosec: NDArray[np.uint32]
    times: Integers
    frame_id: str


Stamped: TypeAlias = tuple[Reading, int, int, str, int]
"""A reading, its stamp (s and ns), its frame, and when it is assessed, ns."""


class Input:
    """A source with the reader of its numbers.

    Parameters
    ----------
    settings : SourceSettings
    schema : Schema
        The fields of the type of its messages.

    Attributes
    ----------
    settings : SourceSettings
    reader : NumberReader

    Raises
    ------
    LinkageVibrationError
        If the type has no such number, or the settings cannot be used.
    """

    def __init__(self, settings: SourceSettings, schema: Schema) -> None:
        self.settings, self.reader = settings, settings.reader(schema)
        self._delay = round(1e9 * settings.delay)

    def describe(self, topic: str) -> str:
        """Return what is read from a topic, in words."""
        return f"{self.reader.describe()} on {topic}"

    def available(self, number: float) -> bool:
        """Return whether a number means that there is a value."""
        return self.settings.low <= number <= self.settings.high

    def _numbers(self, block: Block, rows: Integers, left_out: LeftOut) -> Iterator[Numbers]:
        """Read many messages, with NaN for values that are not available."""
        for found in self.reader.read(block, rows, left_out):
            wrong = ~((self.settings.low <= found.value) & (found.value <= self.settings.high))
            if wrong.any():
                found.value[wrong] = math.nan
                note = self.reader.note or self.reader.describe()
                left_out.unavailable[note] = left_out.unavailable.get(note, 0) + int(wrong.sum())
            yield found


class CrankInput(Input):
    """The crank angle.

    Its stamp is that of the header of its message, or else the time of receipt less the delay.

    Parameters
    ----------
    settings, schema : SourceSettings, Schema
        As those of `Input`.
    scale : HitchScale
        How numbers become crank angles.
    """

    def __init__(self, settings: SourceSettings, schema: Schema, scale: HitchScale) -> None:
        super().__init__(settings, schema)
        self.scale = scale
        self._stamped = self.reader.has_header and settings.time != RECEIPT_TIME

    def read_one(self, data: bytes, received: int) -> Stamped | None:
        """Return what a message reports; None if it does not contain the number.

        Parameters
        ----------
        data : bytes
            The message in plain CDR.
        received : int
            When it was received, ns.

        Raises
        ------
        CdrError
            If the bytes are not such a message.
        ReadingError
            If its number is not reliable.
        """
        number = self.reader.read_one(data)
        if number is None:
            return None
        value, rate, sec, nanosec, frame_id = number
        if not self.available(value):
            value = math.nan
        time = received - self._delay
        if not self._stamped:
            sec, nanosec = divmod(time, 10**9)
        return self.scale.reading(value, rate), sec, nanosec, frame_id, time

    def read_block(self, block: Block, rows: Integers, left_out: LeftOut) -> Iterator[Readings]:
        """Read many messages of a bag, which gives the same values as `read_one` for each.

        Parameters
        ----------
        block, rows, left_out : Block, ndarray and LeftOut
            As in `NumberReader.read`.
        """
        for found in self._numbers(block, rows, left_out):
            times = block.log_times[found.rows] - self._delay
            sec, nanosec = found.sec, found.nanosec
            if not self._stamped:
                whole, rest = np.divmod(times, 10**9)
                sec, nanosec = whole.astype(np.int32), rest.astype(np.uint32)
            angle, velocity, stddev = self.scale.columns(found.value, found.rate)
            yield Readings(found.rows, angle, velocity, stddev, sec, nanosec, times, found.frame_id)


class SpeedInput(Input):
    """A speed: gain * number + offset.

    Its time is that of its receipt less the delay, or that of the header of its message.

    Parameters
    ----------
    settings, schema : SourceSettings, Schema
        As those of `Input`.
    gain, offset : float
        The speed (rpm or m/s) per unit of the number, and the speed at the number 0.
    """

    def __init__(
        self, settings: SourceSettings, schema: Schema, gain: float, offset: float
    ) -> None:
        super().__init__(settings, schema)
        self._gain, self._offset = gain, offset
        self._stamped = settings.time == HEADER_TIME

    def read_one(self, data: bytes, received: int) -> tuple[float, int] | None:
        """Return a speed (rpm or m/s; NaN if it is not available) and its time, ns.

        It is None if the message does not contain the number.

        Parameters
        ----------
        data, received : bytes, int
            As in `CrankInput.read_one`.

        Raises
        ------
        CdrError, ReadingError
            As in `CrankInput.read_one`.
        """
        number = self.reader.read_one(data)
        if number is None:
            return None
        value = number.value if self.available(number.value) else math.nan
        time = received - self._delay
        if self._stamped:
            time = 10**9 * number.sec + number.nanosec
        return self._gain * value + self._offset, time

    def read_block(
        self, block: Block, rows: Integers, left_out: LeftOut
    ) -> Iterator[tuple[Integers, FloatArray, Integers]]:
        """Yield rows, speeds and times of many messages, each (n,); see `read_one`.

        Parameters
        ----------
        block, rows, left_out : Block, ndarray and LeftOut
            As in `NumberReader.read`.
        """
        for found in self._numbers(block, rows, left_out):
            times = block.log_times[found.rows] - self._delay
            if self._stamped:
                times = 10**9 * found.sec.astype(np.int64) + found.nanosec
            yield found.rows, self._gain * found.value + self._offset, times
