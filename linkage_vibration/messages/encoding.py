# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Encodes predictions and resonances as CDR, one at a time or many at once, without rclpy.

The same values always give the same bytes. A ROS 2 serializer does not promise that: it may leave
arbitrary bytes where CDR pads. `struct` and NumPy are also several times faster than rclpy.
"""

import struct
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.messages.fields import CODES, message_fields
from linkage_vibration.messages.topics import PREDICTION, RESONANCE
from linkage_vibration.prediction.batch import Predictions
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.predictor import Prediction
from linkage_vibration.prediction.resonance import Resonance, Resonances

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

# The encapsulation header of plain CDR (OMG DDS-RTPS, 10.2) names the byte order that follows.
_ENCAPSULATION = b"\x00\x01\x00\x00" if sys.byteorder == "little" else b"\x00\x00\x00\x00"
# The arguments of an encoder that fill the header.
_HEADER = {
    "header.stamp.sec": "sec",
    "header.stamp.nanosec": "nanosec",
    "header.frame_id": "frame_id",
}
_AS_BYTES = ".encode() + b'\\0'"  # CDR ends a text with a zero


def encode_prediction(prediction: Prediction, sec: int, nanosec: int, frame_id: str) -> bytes:
    """Encode a prediction as ``linkage_vibration_interfaces/msg/VibrationPrediction``.

    Parameters
    ----------
    prediction : Prediction
        It has at least one mode, as CDR pads an empty sequence differently.
    sec, nanosec, frame_id : int, int and str
        Stamp (s and ns) and frame of the header.

    Returns
    -------
    bytes
        The message with its encapsulation header, as DDS carries it and MCAP stores it.
    """
    return _encoder(PREDICTION)(prediction, sec, nanosec, frame_id)


def encode_resonance(resonance: Resonance, sec: int, nanosec: int, frame_id: str) -> bytes:
    """Encode a resonance as ``linkage_vibration_interfaces/msg/Resonance``.

    Parameters
    ----------
    resonance : Resonance
    sec, nanosec, frame_id : int, int and str
        As in `encode_prediction`.
    """
    return _encoder(RESONANCE)(resonance, sec, nanosec, frame_id)


def encode_predictions(
    predictions: Predictions, sec: NDArray[np.int32], nanosec: NDArray[np.uint32], frame_id: str
) -> Bytes:
    """Return what `encode_prediction` gives for each of many predictions, as rows of bytes.

    Parameters
    ----------
    predictions : Predictions
    sec, nanosec : ndarray, (n,)
        Stamps of the headers, s and ns.
    frame_id : str
        Frame of all headers.
    """
    texts = {"header.frame_id": frame_id, "table_id": predictions.table_id}
    return _encode_columns(PREDICTION, predictions, texts, sec, nanosec)


def encode_resonances(
    resonances: Resonances,
    excitations: Sequence[Excitation],
    table_id: str,
    sec: NDArray[np.int32],
    nanosec: NDArray[np.uint32],
    frame_id: str,
) -> Iterator[tuple[Integers, Bytes]]:
    """Encode many resonances whose headers have the same frame.

    Parameters
    ----------
    resonances : Resonances
    excitations, table_id : sequence of Excitation and str
        Those of the monitor, and the table of the predictions.
    sec, nanosec, frame_id : ndarray, (n,), ndarray, (n,), and str
        As in `encode_predictions`.

    Yields
    ------
    which, encoded : ndarray, (m,), and ndarray of uint8, (m, n_bytes)
        Indices of the resonances of one excitation, whose messages have the same size, and what
        `encode_resonance` returns for each of them.
    """
    for number in np.unique(resonances.excitation).tolist():
        [which] = np.nonzero(resonances.excitation == number)
        excitation = excitations[number].name if number >= 0 else ""
        texts = {"header.frame_id": frame_id, "excitation": excitation, "table_id": table_id}
        same = resonances.rows(which)
        yield which, _encode_columns(RESONANCE, same, texts, sec[which], nanosec[which])


@cache
def _encoder(type_name: str) -> Callable[[object, int, int, str], bytes]:
    """Return a function that encodes one message, given an object with its fields and its header.

    The function is generated as source, as a loop over the fields would take twice as long.
    """
    lines, formats, arguments = [], [], []
    for i, field in enumerate(message_fields(type_name)):
        value = _HEADER.get(field.name, f"message.{field.name}")
        code = np.dtype(CODES[field.type]).char
        if field.type == "string" or field.is_sequence:
            lines.append(f"v{i} = {value}{'.tolist()' if field.is_sequence else _AS_BYTES}")
            formats.append(f"I{{len(v{i})}}{code if field.is_sequence else 's'}")
            arguments += [f"len(v{i})", f"*v{i}" if field.is_sequence else f"v{i}"]
        else:
            formats.append(code)
            arguments.append(value)
    # CDR aligns every number to its own size, as `struct` does in native mode.
    lines.append(f"return encapsulation + pack(f'{''.join(formats)}', {', '.join(arguments)})")
    source = "\n    ".join(["def encode(message, sec, nanosec, frame_id):", *lines])
    scope: dict[str, Any] = {"encapsulation": _ENCAPSULATION, "pack": struct.pack}
    exec(source, scope)
    return cast(Callable[[object, int, int, str], bytes], scope["encode"])


@lru_cache(maxsize=256)
def _layout(type_name: str, *lengths: int) -> np.dtype[np.void]:
    """Return the data type of a whole message whose texts and sequences have these lengths."""
    columns: list[Any] = []
    remaining = iter(lengths)
    for field in message_fields(type_name):
        if field.type == "string" or field.is_sequence:
            columns.append((f"{field.name} length", "u4"))
            columns.append((field.name, CODES[field.type], (next(remaining),)))
        else:
            columns.append((field.name, CODES[field.type]))
    # CDR aligns every number to its own size, as NumPy does, but has no padding at the end.
    aligned: Any = np.dtype(columns, align=True)
    names = list(aligned.names)
    formats, places = zip(*(aligned.fields[name][:2] for name in names), strict=True)
    offsets = [len(_ENCAPSULATION) + place for place in places]
    itemsize = offsets[-1] + formats[-1].itemsize
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": itemsize})


def _encode_columns(
    type_name: str,
    columns: object,
    texts: Mapping[str, str],
    sec: NDArray[np.int32],
    nanosec: NDArray[np.uint32],
) -> Bytes:
    """Encode messages that have the same texts, and columns as attributes."""
    values: dict[str, Any] = {"header.stamp.sec": sec, "header.stamp.nanosec": nanosec}
    lengths: list[int] = []
    for field in message_fields(type_name):
        name = field.name
        if name in texts:
            values[name] = np.frombuffer(texts[name].encode() + b"\x00", np.uint8)
        elif name not in values:
            values[name] = getattr(columns, name)
        if field.is_sequence or name in texts:
            lengths.append(values[name].shape[-1])
            values[f"{name} length"] = lengths[-1]
    layout = _layout(type_name, *lengths)
    rows = np.zeros((len(sec), layout.itemsize), np.uint8)  # CDR pads with zeros
    rows[:, : len(_ENCAPSULATION)] = np.frombuffer(_ENCAPSULATION, np.uint8)
    messages = rows.view(layout)[:, 0]
    for name, value in values.items():
        messages[name] = value
    return rows
