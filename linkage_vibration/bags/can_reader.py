# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads a signal from frames of a CAN bus; see `linkage_vibration.bags.can_signals`."""

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Block, Bytes
from linkage_vibration.bags.can_frames import EXTENDED, FRAME_TYPES, FramePlaces
from linkage_vibration.bags.can_signals import SIGNALS, CanSignal
from linkage_vibration.bags.cdr import Layout, Layouts
from linkage_vibration.bags.dbc import dbc_signal
from linkage_vibration.bags.message_types import CAN_FRAME
from linkage_vibration.bags.scalar_reader import (
    Integers,
    NumberReader,
    Scalar,
    ScalarBatch,
    SkippedMessages,
)
from linkage_vibration.bags.schemas import FieldError

_FIRST = np.zeros(1, np.int64)
_LAST_ADDRESS = 253  # 254 is that of a sender without an address, and 255 stands for all


def find_signal(field: str, database: str) -> CanSignal:
    """Return a built-in signal, or MESSAGE.SIGNAL of a DBC file; ``@0`` chooses a sender."""
    name, at, address = field.partition("@")
    if name in SIGNALS:
        signal = SIGNALS[name]
    elif database:
        signal = dbc_signal(Path(database).expanduser(), name)
    else:
        hint = f"choose one of {', '.join(SIGNALS)}, or name a DBC file in can_database"
        problem = f"There is no CAN signal {name!r}"
        raise FieldError(f"{problem}; {hint} and its signal as MESSAGE.SIGNAL.")
    if not at:
        return signal
    chosen = int(address, 0) if re.fullmatch(r"\d{1,3}|0x[0-9a-fA-F]{1,2}", address) else -1
    if not 0 <= chosen <= _LAST_ADDRESS:
        problem = f"{field!r} does not end with a source address"
        raise FieldError(f"{problem}; write one from 0 to {_LAST_ADDRESS}, such as {name}@0.")
    if not signal.any_sender:
        why = f"the frames of {name} are recognised by their whole identifier"
        problem = f"{field!r} chooses a source address, but {why}"
        raise FieldError(f"{problem}; write {name} without an address.")
    return signal.from_address(chosen)


class CanReader(NumberReader):
    """Reads a signal of a CAN bus from messages of a type."""

    kind = "frame"

    def __init__(self, signal: CanSignal, type_name: str = CAN_FRAME) -> None:
        self._frames = FRAME_TYPES[type_name]
        self.has_header = self._frames.fields[0] == "header"
        self._signal, self.what = signal, f"CAN signal {signal.name}"
        page = " whose multiplexer selects it" if signal.selectors else ""
        hint = "check the source address and the channel, or choose another signal"
        self.remedy = f"It is in frames of {_name(signal.key)}{page}; {hint}."
        self._layouts = Layouts(type_name, self._frames.places)

    def read_one(self, data: bytes) -> Scalar | None:
        """Return the value of the signal in a frame, NaN for none; see `NumberReader.read_one`."""
        layout = self._layouts.find(data)
        key = self._frames.key(layout, data)
        if not self._signal.matches(key):
            return None
        if self._signal.any_sender:
            self.sender = f"{self._signal.name}@0x{key & 0xFF:02X}"
        message = np.frombuffer(data, np.uint8)[np.newaxis]
        numbers = self._numbers(layout, _FIRST, message, SkippedMessages())
        if numbers is None:
            return None
        value, sec, nanosec = numbers.value.item(), numbers.sec.item(), numbers.nanosec.item()
        return Scalar(value, math.nan, sec, nanosec, numbers.frame_id)

    def read(
        self, block: Block, rows: Integers, left_out: SkippedMessages
    ) -> Iterator[ScalarBatch]:
        """Read many frames; see `NumberReader.read`."""
        for layout, alike, messages in self._layouts.groups(block, rows, left_out):
            numbers = self._numbers(layout, alike, messages, left_out)
            if numbers is not None:
                yield numbers

    def _numbers(
        self,
        layout: Layout[FramePlaces],
        rows: Integers,
        messages: Bytes,
        left_out: SkippedMessages,
    ) -> ScalarBatch | None:
        """Return the values of the signal in the frames that contain it, and explain a NaN."""
        signal = self._signal
        key, dlc, payload = self._frames.columns(layout, messages)
        present = signal.present(key, dlc, payload)
        if not present.all():
            left_out.others += int((~present).sum())
            left_out.names.update(_names(key[~present]))
            if not present.any():
                return None
            rows, messages, key = rows[present], messages[present], key[present]
            dlc, payload = dlc[present], payload[present]
        values = signal.values(dlc, payload)
        invalid = np.flatnonzero(np.isnan(values))
        self.note = ""
        if len(invalid):
            row = invalid[0]
            self.note = signal.explain(int(dlc[row]), payload[row].tobytes())
        rates = np.full(len(values), math.nan)
        stamps = np.zeros(len(values), np.int32), np.zeros(len(values), np.uint32)
        if self.has_header:
            stamps = layout.stamps(messages)
        senders = key & np.uint32(0xFF) if signal.any_sender else None
        return ScalarBatch(rows, values, rates, *stamps, layout.places[0], senders)

    def other_names(self, data: bytes) -> Sequence[str]:
        """Return which frame a message is."""
        return [_name(self._frames.key(self._layouts.find(data), data))]


def _names(keys: NDArray[np.uint32]) -> set[str]:
    """Return what frames with these keys are."""
    distinct = np.unique(np.where(keys & EXTENDED, keys & ~np.uint32(0xFF), keys))
    return {_name(key) for key in distinct.tolist()}


def _name(key: int) -> str:
    """Return what a frame is; below 0xF000, the low byte of a group is its destination."""
    if not key & EXTENDED:
        return f"identifier 0x{key:X}"
    group = key >> 8 & 0x3FFFF
    return f"parameter group {group if group >> 8 & 0xFF >= 0xF0 else group & ~0xFF}"
