# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds signals in DBC files, which describe the frames of a CAN bus, with cantools."""

from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from linkage_vibration.bags.can_frames import EXTENDED, FLAGS, PAYLOAD
from linkage_vibration.bags.can_signals import Bits, CanSignal, j1939_key
from linkage_vibration.bags.schemas import FieldError
from linkage_vibration.support.atomic_files import read_text
from linkage_vibration.support.missing_library import needed
from linkage_vibration.support.version import check_versions

if TYPE_CHECKING:
    from cantools.database.can import Database, Message, Signal

Named = TypeVar("Named", "Message", "Signal")

_NULL_ADDRESS = 0xFE  # the source address that stands for any in DBC files of J1939


def dbc_signal(path: Path, name: str) -> CanSignal:
    """Return a signal of a DBC file, such as "RearHitch.Position", or raise a `FieldError`."""
    message_name, _, signal_name = name.partition(".")
    if not signal_name:
        raise FieldError(f"{name!r} is not the name of a signal; write MESSAGE.SIGNAL.")
    database = _load(path, path.stat().st_mtime_ns if path.exists() else 0)
    message = _choose(path, "message", message_name, database.messages)
    signal = _choose(path, f"signal of {message_name}", signal_name, message.signals)
    j1939, key, mask = _identifier(message)
    if message.length > PAYLOAD and j1939:
        problem = f"has {message.length} bytes, which J1939 sends in several frames"
        hint = "choose a signal of a message with at most 8 bytes"
        raise FieldError(f"Message {message_name} of {path} {problem}; {hint}.")
    bits = _bits(path, message, signal)
    least = -np.inf if signal.minimum is None else float(signal.minimum)
    largest = np.inf if signal.maximum is None else float(signal.maximum)
    return CanSignal(
        name,
        signal.unit or "",
        key,
        mask,
        bits,
        float(signal.conversion.scale),
        float(signal.conversion.offset),
        j1939 and not (bits.signed or bits.real) and bits.length in (8, 16, 24, 32),
        (least, largest) if least < largest else (-np.inf, np.inf),
        tuple(_selectors(path, message, signal)),
    )


@lru_cache(maxsize=4)  # several inputs may read one large file
def _load(path: Path, changed: int) -> "Database":
    """Return the content of a file that was changed at a time, ns."""
    check_versions("cantools")
    with needed("can", f"Reading {path} needs cantools", FieldError):
        from cantools.database.can import Database
    try:
        # Other messages than ours may overlap themselves; ours is checked by itself.
        database = Database(strict=False)
        database.add_dbc_string(_text(path))
    except OSError as error:
        raise FieldError(f"{path} cannot be opened: {error.strerror}; check the path.") from None
    # cantools raises errors of its own, of its parser and of Python for a file that is not DBC.
    except Exception as error:
        text = " ".join(str(error).split())
        raise FieldError(f"{path} is not a valid DBC file ({text}); correct it.") from error
    return database


def _text(path: Path) -> str:
    """Return the text of a file in UTF-8 or, as DBC files mostly are, in a code page of Windows."""
    try:
        return read_text(path, "utf-8-sig")
    except UnicodeDecodeError:
        return read_text(path, "latin-1")  # cp1252 is the same, but for signs that DBC files lack


def _choose(path: Path, what: str, name: str, among: Sequence[Named]) -> Named:
    named = [each for each in among if each.name == name]
    if len(named) > 1:
        problem = f"{path} has {what} {name} {len(named)} times"
        raise FieldError(f"{problem}; give each a name of its own, or keep one.")
    if named:
        return named[0]
    similar = ", ".join(get_close_matches(name, [each.name for each in among], 5, 0.0))
    remedy = f"choose for example {similar}" if similar else "it has none at all"
    raise FieldError(f"{path} has no {what} {name}; {remedy}.")


def _identifier(message: "Message") -> tuple[bool, int, int]:
    """Return whether a message is of J1939, and key and mask of its frames."""
    identifier = message.frame_id
    if not message.is_extended_frame:
        return False, identifier, FLAGS | 0x1FFFFFFF
    if message.protocol == "j1939" or identifier & 0xFF == _NULL_ADDRESS:
        return True, *j1939_key(identifier)
    return False, EXTENDED | identifier, FLAGS | 0x1FFFFFFF


def _selectors(
    path: Path, message: "Message", signal: "Signal"
) -> Iterator[tuple[Bits, tuple[int, ...]]]:
    """Yield the multiplexers of a signal, which may have multiplexers themselves."""
    signals = {each.name: each for each in message.signals}
    for _ in signals:
        if not signal.multiplexer_ids:
            return
        selector = signals[str(signal.multiplexer_signal)]
        yield _bits(path, message, selector), tuple(signal.multiplexer_ids)
        signal = selector


def _bits(path: Path, message: "Message", signal: "Signal") -> Bits:
    """Return where a signal is; a DBC file counts the bits of a big-endian one from its highest."""
    big, start, length = signal.byte_order == "big_endian", signal.start, signal.length
    before = 8 * (start // 8) + 7 - start % 8 if big else start
    n_bytes = (before + length + 7) // 8
    if n_bytes > min(message.length, PAYLOAD):
        counts = f"byte {n_bytes}, but a frame has {min(message.length, PAYLOAD)} bytes"
        problem = f"Signal {message.name}.{signal.name} of {path} reaches into {counts}"
        raise FieldError(f"{problem}; correct the file, or choose another signal.")
    first = 8 * PAYLOAD - before - length if big else start
    real = signal.conversion.is_float
    return Bits(first, length, n_bytes, big, signal.is_signed and not real, real)
