# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The inputs of the node: where a number comes from, and the crank angle or speed that it means."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from linkage_vibration.bags.blocks import Block
from linkage_vibration.bags.can_frames import FRAME_TYPES
from linkage_vibration.bags.can_reader import CanReader, find_signal
from linkage_vibration.bags.can_signals import FORCES
from linkage_vibration.bags.field_reader import FieldReader
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.bags.scalar_reader import (
    Integers,
    NumberReader,
    Scalar,
    ScalarBatch,
    SkippedMessages,
)
from linkage_vibration.bags.schemas import FieldError, Schema, find_path
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.messages.columns import MessageColumns, joined
from linkage_vibration.messages.topics import MEASUREMENT
from linkage_vibration.prediction.inputs.presets import PRESETS
from linkage_vibration.prediction.inputs.units import HitchScale, InputError, Reading, wrong_unit

HEADER_TIME, RECEIPT_TIME = TIMES = ("header", "receipt")

_NONE = np.zeros(0)
_NO_NUMBERS = ScalarBatch(
    _NONE.astype(np.int64), _NONE, _NONE, _NONE.astype(np.int32), _NONE.astype(np.uint32), ""
)
MAX_BYTES = 1_000_000  # of a message of an input; a joint state of 10,000 joints has a third


def too_large(size: int) -> str:
    """Return why a message of so many bytes is refused."""
    return (
        f"A message of {size} bytes was refused; an input may have {MAX_BYTES}, so publish what it "
        "needs on a topic of its own."
    )


@dataclass(frozen=True, slots=True)
class SourceSettings:
    """Where an input comes from, as the parameters say."""

    name: str  # "hitch", "engine", "pto" or "ground"
    topic: str
    type: str
    field: str  # path to the number in the messages
    time: str  # "header", "receipt", or empty for the default
    delay: float  # s, from the moment of a value to its receipt
    low: float  # a number outside of this range means that the value is not available
    high: float
    chosen: bool  # whether a parameter names the topic
    database: str = ""  # path of the DBC file of CAN signals, or empty
    unit: str = ""  # in which the number has to be; empty if a scale converts it
    own_field: bool = False  # whether a parameter gives the field

    def reader(self, schema: Schema) -> NumberReader:
        """Return the reader of the number in messages of a schema, or raise an `InputError`."""
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
    reader = FieldReader(schema, source.type, source.field)
    reader.remedy = f"Write one of them in the brackets of {source.name}_field."
    return reader


def _joint_reader(schema: Schema, source: SourceSettings) -> NumberReader:
    """Return the reader of a joint's position and velocity, or the reader of another field."""
    last = find_path(schema, source.type, source.field)[-1]
    if last.field.name != "position" or not last.name:
        return _field_reader(schema, source)
    reader = FieldReader(schema, source.type, source.field, rates="velocity")
    reader.what, reader.kind = f"joint {last.name}", "joint"
    reader.remedy = "Set joint_name (`--joint`) to one of them, or choose another topic."
    if source.own_field:  # joint_name is not used
        reader.remedy = _field_reader(schema, source).remedy
    return reader


def _can_reader(schema: Schema, source: SourceSettings) -> NumberReader:
    if [field.name for field in schema[source.type]] != FRAME_TYPES[source.type].fields:
        package = source.type.partition("/")[0]
        raise InputError(
            f"{source.type} is defined in another way than by {package}; convert the messages."
        )
    signal = find_signal(source.field, source.database)
    if source.unit and signal.name in FORCES:
        fit = PRESETS[source.name]["can"].field
        raise InputError(f"Parameter {source.name}_field: {signal.name} is a force; write {fit}.")
    if wrong := wrong_unit(signal.unit, source.unit, source.name):
        raise InputError(f"Parameter {source.name}_field: {signal.name} {wrong}")
    return CanReader(signal, source.type)


def _measurement_reader(schema: Schema, source: SourceSettings) -> NumberReader:
    """Return the reader of our own message, whose publisher may say that it is not valid."""
    return FieldReader(schema, source.type, source.field, flagged=source.field == "value")


READERS: dict[str, Callable[[Schema, SourceSettings], NumberReader]] = {
    JOINT_STATE: _joint_reader,
    MEASUREMENT: _measurement_reader,
    **dict.fromkeys(FRAME_TYPES, _can_reader),
}
"""The readers of types that `FieldReader` does not read, or reads more slowly."""

Stamped: TypeAlias = tuple[Reading, int, int, str, int]
"""A reading, its stamp (s and ns), its frame, and when it is assessed, ns."""


class InputReader:
    """A source with the reader of its numbers; the schema has the fields of its messages."""

    def __init__(self, settings: SourceSettings, schema: Schema) -> None:
        self.settings, self.reader = settings, settings.reader(schema)
        self._delay = round(1e9 * settings.delay)

    def describe(self, topic: str) -> str:
        """Return what is read from a topic, in words."""
        return f"{self.reader.what} on {topic}"

    def _number(self, data: bytes, received: int) -> tuple[Scalar, int] | None:
        """Return the number of a message, NaN if not available, and its receipt less the delay."""
        number = self.reader.read_one(data)
        if number is None:
            return None
        if not self.settings.low <= number.value <= self.settings.high:
            number = number._replace(value=math.nan)
        return number, received - self._delay

    def _senders(self, numbers: ScalarBatch) -> list[str]:
        """Return the sender of each number on a bus, as the field names it; "" if it is chosen."""
        if numbers.senders is None:
            return [""] * len(numbers.value)
        return [f"{self.settings.field}@0x{sender:02X}" for sender in numbers.senders.tolist()]

    def numbers(
        self, block: Block, rows: Integers, left_out: SkippedMessages
    ) -> Iterator[ScalarBatch]:
        """Read many messages, with NaN for values that are not available."""
        large = block.sizes[rows] > MAX_BYTES
        if large.any():
            left_out.refused += int(large.sum())
            left_out.fault = left_out.fault or too_large(int(block.sizes[rows].max()))
            rows = rows[~large]
        for numbers in self.reader.read(block, rows, left_out):
            value = numbers.value
            wrong = ~((self.settings.low <= value) & (value <= self.settings.high))
            if wrong.any():
                value[wrong] = math.nan
                note = self.reader.note or self.reader.what
                left_out.unavailable[note] = left_out.unavailable.get(note, 0) + int(wrong.sum())
            yield numbers


class CrankInput(InputReader):
    """The crank angle with its scale, stamped by a header, or by the receipt less the delay."""

    def __init__(self, settings: SourceSettings, schema: Schema, scale: HitchScale) -> None:
        super().__init__(settings, schema)
        self.scale = scale
        self._stamped = self.reader.has_header and settings.time != RECEIPT_TIME

    def describe(self, topic: str) -> str:
        """Return what is read from a topic, in words."""
        fixed, described = self.scale.fixed, super().describe(topic)
        if math.isnan(fixed):
            return described
        return f"hitch position {fixed:g} {self.scale.unit} at each {described}"

    def read_one(self, data: bytes, received: int) -> Stamped | None:
        """Return the reading of a message, received at a time (ns); None without a number."""
        number_and_time = self._number(data, received)
        if number_and_time is None:
            return None
        (value, rate, sec, nanosec, frame_id), time = number_and_time
        if not self._stamped:
            sec, nanosec = divmod(time, 10**9)
        return self.scale.reading(value, rate), sec, nanosec, frame_id, time

    def read_block(self, block: Block, rows: Integers, left_out: SkippedMessages) -> MessageColumns:
        """Return what `read_one` returns for many messages of a bag, in the order of arrival.

        Columns are those of `Reading`, stamps as ``sec``, ``nanosec`` and ``stamp``, ns, ``time``,
        ns, ``sender``, ``frame_id``, one text if all are equal, and ``in_block``, their indices.
        """
        groups, parts = [*self.numbers(block, rows, left_out)] or [_NO_NUMBERS], []
        one_frame = len({numbers.frame_id for numbers in groups}) == 1
        for numbers in groups:
            time = block.log_times[numbers.rows] - self._delay
            sec, nanosec = numbers.sec, numbers.nanosec
            if not self._stamped:
                whole, rest = np.divmod(time, 10**9)
                sec, nanosec = whole.astype(np.int32), rest.astype(np.uint32)
            crank_angle, velocity, stddev = self.scale.columns(numbers.value, numbers.rate)
            part = MessageColumns(
                in_block=numbers.rows,
                crank_angle=crank_angle,
                velocity=velocity,
                stddev=stddev,
                sec=sec,
                nanosec=nanosec,
                stamp=10**9 * sec.astype(np.int64) + nanosec,
                time=time,
                sender=np.array(self._senders(numbers), object),
                frame_id=numbers.frame_id
                if one_frame
                else np.full(len(time), numbers.frame_id, object),
            )
            parts.append(part)
        readings = joined(parts)
        return readings.rows(np.argsort(readings.in_block))


class SpeedInput(InputReader):
    """A speed, gain * number + offset, rpm or m/s, at the receipt less the delay, or its header."""

    def __init__(
        self, settings: SourceSettings, schema: Schema, gain: float, offset: float
    ) -> None:
        super().__init__(settings, schema)
        self._gain, self._offset = gain, offset
        self._stamped = settings.time == HEADER_TIME

    def read_one(self, data: bytes, received: int) -> tuple[float, int] | None:
        """Return a speed, NaN if not available, and its time, ns; None without a number."""
        number_and_time = self._number(data, received)
        if number_and_time is None:
            return None
        number, time = number_and_time
        if self._stamped:
            time = 10**9 * number.sec + number.nanosec
        return self._gain * number.value + self._offset, time

    def read_block(
        self, block: Block, rows: Integers, left_out: SkippedMessages
    ) -> Iterator[tuple[Integers, FloatArray, Integers, list[str]]]:
        """Yield rows, speeds, times and senders of many messages, each (n,); see `read_one`."""
        for numbers in self.numbers(block, rows, left_out):
            times = block.log_times[numbers.rows] - self._delay
            if self._stamped:
                times = 10**9 * numbers.sec.astype(np.int64) + numbers.nanosec
            speeds = self._gain * numbers.value + self._offset
            yield numbers.rows, speeds, times, self._senders(numbers)
