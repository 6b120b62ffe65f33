# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads a signal from ``can_msgs/Frame``; see `linkage_vibration.bags.can_signals`."""

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.can_frames import EXTENDED, read_frame, read_frames, read_key
from linkage_vibration.bags.can_signals import SIGNALS, CanSignal
from linkage_vibration.bags.dbc import dbc_signal
from linkage_vibration.bags.numbers import (
    Integers,
    LeftOut,
    Number,
    NumberReader,
    Numbers,
)
from linkage_vibration.bags.schemas import FieldError
from linkage_vibration.bags.streams import Block

_MAX_NAMES = 20
_LAST_ADDRESS = 253  # 254 is that of a sender without an address, and 255 stands for all


def find_signal(field: str, database: str) -> CanSignal:
    """Return the signal that a field names.

    Parameters
    ----------
    field : str
        A built-in signal, or the message and the signal of a DBC file with a dot between them. An
        ``@`` and a source address choose one sender, as in ``engine_speed@0``.
    database : str
        Path of the DBC file; empty if there is none.

    Raises
    ------
    FieldError
        If there is no such signal, or the address is not one of J1939.
    DbcError
        If the DBC file cannot be read, or has no such signal.
    """
    name, at, address = field.partition("@")
    if name in SIGNALS:
        signal = SIGNALS[name]
    elif database:
        signal = dbc_signal(Path(database).expanduser(), name)
    else:
        raise FieldError(
            f"There is no CAN signal {name!r}; choose one of {', '.join(SIGNALS)}, or name a DBC "
            "file in can_database and its signal as MESSAGE.SIGNAL."
        )
    if not at:
        return signal
    chosen = int(address, 0) if re.fullmatch(r"\d{1,3}|0x[0-9a-fA-F]{1,2}", address) else -1
    if not 0 <= chosen <= _LAST_ADDRESS:
        raise FieldError(
            f"{field!r} does not end with a source address; write one from 0 to {_LAST_ADDRESS}, "
            f"such as {name}@0."
        )
    if not signal.any_sender:
        raise FieldError(
            f"{field!r} chooses a source address, but the frames of {name} are recognised by their "
            f"whole identifier; write {name} without an address."
        )
    return signal.from_address(chosen)


class CanReader(NumberReader):
    """Reads a signal of a CAN bus.

    Parameters
    ----------
    signal : CanSignal
    """

    has_header = True

    def __init__(self, signal: CanSignal) -> None:
        self._signal = signal

    def describe(self) -> str:
        """Return the name of the signal."""
        return f"CAN signal {self._signal.name}"

    def read_one(self, data: bytes) -> Number | None:
        """Return the value of the signal in a frame, NaN for none; see `NumberReader.read_one`."""
        if not self._signal.matches(read_key(data)):
            return None
        sec, nanosec, frame_id, key, dlc, payload = read_frame(data)
        keys, counts = np.array([key], np.uint32), np.array([dlc], np.uint8)
        rows = np.frombuffer(payload, np.uint8)[np.newaxis]
        if self._signal.selectors and not self._signal.present(keys, counts, rows)[0]:
            return None
        value = float(self._signal.values(counts, rows)[0])
        self.note = self._signal.explain(dlc, payload) if math.isnan(value) else ""
        return Number(value, math.nan, sec, nanosec, frame_id)

    def read(self, block: Block, rows: Integers, left_out: LeftOut) -> Iterator[Numbers]:
        """Read many frames; see `NumberReader.read`.

        Parameters
        ----------
        block, rows, left_out : Block, ndarray and LeftOut
            As in `NumberReader.read`.
        """
        signal = self._signal
        groups, unreadable = read_frames(block, rows)
        if len(unreadable):
            left_out.unreadable += len(unreadable)
            left_out.fault = left_out.fault or "a message is not a can_msgs/Frame in plain CDR"
        for frames in groups:
            present = signal.present(frames.key, frames.dlc, frames.payload)
            left_out.others += int((~present).sum())
            if not present.all():
                left_out.names.update(_names(frames.key[~present]))
            if present.any():
                self.note = ""
                dlc, payload = frames.dlc[present], frames.payload[present]
                values = signal.values(dlc, payload)
                if np.isnan(values).any():
                    row = int(np.isnan(values).argmax())
                    self.note = signal.explain(int(dlc[row]), payload[row].tobytes())
                yield Numbers(
                    frames.rows[present],
                    values,
                    np.full(len(values), math.nan),
                    frames.sec[present],
                    frames.nanosec[present],
                    frames.frame_id,
                )

    def other_names(self, data: bytes) -> Sequence[str]:
        """Return which frame a message is."""
        return [_name(read_key(data))]

    def explain_missing(self, topic: str, names: Sequence[str]) -> str:
        """Return that no frame contains the signal, which frames there are, and the remedy.

        Parameters
        ----------
        topic, names : str and sequence of str
            The topic that was read, and its frames, see `other_names`.
        """
        if not names:
            return f"{topic} has no frames at all; check its publisher, or choose another topic."
        listing = ", ".join(sorted(names)[:_MAX_NAMES])
        page = " whose multiplexer selects it" if self._signal.selectors else ""
        return (
            f"{topic} has no frame with {self._signal.name} ({_name(self._signal.key)}{page}); it "
            f"has {listing}. Check the source address and the channel, or choose another signal."
        )


def _names(keys: NDArray[np.uint32]) -> list[str]:
    """Return what frames with these keys are, at most 20."""
    found = np.unique(np.where(keys & EXTENDED, keys & ~np.uint32(0xFF), keys))
    return [_name(key) for key in found[:_MAX_NAMES].tolist()]


def _name(key: int) -> str:
    return f"parameter group {key >> 8 & 0x3FFFF}" if key & EXTENDED else f"identifier 0x{key:X}"
