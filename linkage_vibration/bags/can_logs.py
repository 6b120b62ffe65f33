# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads logs of a CAN bus as bags through python-can: text of candump, and Vector's ASC and BLF.

Each channel is a topic of type ``can_msgs/msg/Frame``. The frames of a log are kept in memory, 22
bytes for each, because a log has no index and need not be in the order of its times.
"""

import gzip
import io
import re
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from datetime import datetime, timezone
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.message_types import CAN_FRAME
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.version import check_versions

if TYPE_CHECKING:
    from can import ASCReader, Message
    from rosbags.interfaces import Connection

SUFFIXES = (".log", ".txt", ".candump", ".asc", ".blf")
"""How the names of logs end; gzip may add ``.gz``."""

DEFINITION = """\
std_msgs/Header header
uint32 id
bool is_rtr
bool is_extended
bool is_error
uint8 dlc
uint8[8] data
{line}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{line}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
""".format(line=80 * "=")
"""The definition of ``can_msgs/msg/Frame``, as a bag stores it."""

_FRAME = np.dtype(
    [
        ("time", "<i8"),  # ns
        ("id", "<u4"),
        ("flags", "u1", 3),  # remote, extended, error
        ("dlc", "u1"),
        ("data", "u1", 8),
        ("channel", "u1"),
    ]
)
_PACKED = struct.Struct("<qI4B8sB")  # the same; data are cut or padded to 8 bytes
# A ``can_msgs/msg/Frame`` in CDR: encapsulation, stamp, frame of the header, and those fields.
_MESSAGE = struct.Struct("<4siII4sI4B8s")
# Channel; and time in ns, identifier, remote, extended, error, number of bytes, data.
_Row: TypeAlias = tuple[str, tuple[int, int, bool, bool, bool, int, bytes]]

_GATHERED = 1 << 16  # frames that are converted to an array at a time
_LONGEST = 1000  # characters of a line; the longest line of candump has about 400
_ABSOLUTE = 10**9 * 10**6  # ns; earlier times are relative to the beginning of the log
_LATEST = (2**31 - 1) * 10**9  # ns; a stamp of ROS 2 cannot be later
_DISORDER = 10**9  # ns; channels are written one after the other, but no later than this
_MIXED = 0.1  # share of descending times, above which they are differences
_CHANNELS = 64


class CanLogError(LinkageVibrationError):
    """A log of a CAN bus cannot be read; the text follows the name of the file."""


def can_log_suffix(path: Path) -> str:
    """Return the suffix of a log of a CAN bus without that of gzip; empty for other files."""
    suffix = Path(path.name.lower().removesuffix(".gz")).suffix
    return suffix if suffix in SUFFIXES and not path.is_dir() else ""


@dataclass(frozen=True, slots=True, eq=False)
class CanLog:
    """A log of a CAN bus that was read."""

    connections: "list[Connection]"  # one for each channel, whose index is the identifier
    frames: NDArray[Any]  # (n,) of `_FRAME`, by time

    def messages(
        self, connections: "Collection[Connection]"
    ) -> "Iterator[tuple[Connection, int, bytes]]":
        """Yield the frames of channels in CDR with their times, ns, as readers of rosbags do."""
        chosen = {connection.id: connection for connection in connections}
        for time, *fields, channel in _PACKED.iter_unpack(self.frames.data):
            if channel in chosen:
                head = b"\0\1\0\0", *divmod(time, 10**9), 4, b"can"
                yield chosen[channel], time, _MESSAGE.pack(*head, *fields)


def read_can_log(path: Path) -> CanLog:
    """Read a log; damage may raise any exception, such as a `CanLogError`."""
    check_versions("python-can")
    with _opened(path) as file:
        names, frames = _table(_rows(file, can_log_suffix(path)))
    _check_times(frames["time"])
    counts = np.bincount(frames["channel"], minlength=len(names)).tolist()
    connections = [_connection(i, name, counts[i]) for i, name in enumerate(names)]
    return CanLog(connections, frames[np.argsort(frames["time"], kind="stable")])


def _opened(path: Path) -> BinaryIO:
    if path.suffix.lower() == ".gz":
        return gzip.open(path, "rb")  # type: ignore[return-value]
    return path.open("rb")


def _connection(number: int, name: str, count: int) -> "Connection":
    from rosbags.interfaces import (
        Connection,
        ConnectionExtRosbag2,
        MessageDefinition,
        MessageDefinitionFormat,
    )

    definition = MessageDefinition(MessageDefinitionFormat.MSG, DEFINITION)
    topic = "/" + re.sub(r"\W", "_", name)
    ext = ConnectionExtRosbag2("cdr", [])
    return Connection(number, topic, CAN_FRAME, definition, "", count, ext, None)


def _table(rows: Iterator[_Row]) -> tuple[list[str], NDArray[Any]]:
    """Return the names of the channels, and the frames in the order of the log."""
    names: dict[str, int] = {}
    parts = [np.empty(0, _FRAME)]
    while chunk := list(islice(rows, _GATHERED)):
        numbers = [names.setdefault(channel, len(names)) for channel, _ in chunk]
        if len(names) > _CHANNELS:
            raise CanLogError(f"has more than {_CHANNELS} channels; it is damaged.")
        packed = [_PACKED.pack(*row, n) for (_, row), n in zip(chunk, numbers, strict=True)]
        parts.append(np.frombuffer(b"".join(packed), _FRAME))
    frames = np.concatenate(parts)
    if not len(frames):
        raise CanLogError(
            "has no frames that can be read: none was received, or the file has another format, "
            "such as decimal commas; give another file."
        )
    return list(names), frames


def _check_times(times: NDArray[np.int64]) -> None:
    """Raise an error for times that are not those of the frames."""
    if times.min() < 0 or times.max() > _LATEST:
        raise CanLogError("has a time before 1970 or after 2038; correct or delete its line.")
    steps = np.diff(times)
    if times[0] < _ABSOLUTE and (steps < 0).sum() > _MIXED * len(steps):
        raise CanLogError("has differences of times instead of times; record it with `candump -l`.")
    behind = np.maximum.accumulate(times) - times
    if behind.max() > _DISORDER:
        at = int(np.argmax(behind > _DISORDER))
        raise CanLogError(
            f"goes back in time by {1e-9 * behind[at]:.3f} s at frame {at + 1}, as the clock was "
            "set; split the log there, and replay the parts one by one."
        )


def _rows(file: BinaryIO, suffix: str) -> Iterator[_Row]:
    """Yield the frames of a log."""
    try:
        import can
    except ImportError:
        raise CanLogError("needs python-can; run `pip install linkage_vibration[can]`.") from None

    if suffix == ".blf":
        yield from map(_row, can.BLFReader(file))
        return
    lines: Any = _WholeLines(file)
    try:
        if suffix == ".asc":
            yield from map(_row, _dated(can.ASCReader(lines, relative_timestamp=False)))
        else:
            yield from map(_row, can.CanutilsLogReader(lines))
    except (ValueError, LookupError, OverflowError) as error:
        raise CanLogError(
            f"has a line that cannot be read: line {lines.number} is {lines.last[:60]!r} "
            f"({error}); correct or delete this line, or record with `candump -l`."
        ) from None


def _row(message: "Message") -> _Row:
    data, channel = bytes(message.data), message.channel
    return (
        f"channel_{channel + 1}" if isinstance(channel, int) else str(channel or "channel_1"),
        (
            min(1000 * round(1e6 * message.timestamp), _LATEST + 1),
            message.arbitration_id & 0x1FFFFFFF,
            message.is_remote_frame,
            message.is_extended_id and not message.is_error_frame,
            message.is_error_frame,
            message.dlc if message.is_remote_frame else len(data),
            data,
        ),
    )


def _dated(reader: "ASCReader") -> Iterator["Message"]:
    """Yield the frames of an ASC log, whose date python-can takes for local time, in UTC."""
    for message in reader:
        if reader.timestamps_format == "relative":
            raise CanLogError(
                "has times since the previous event, which do not add up where events are missing; "
                "save it with absolute times."
            )
        if reader.start_time:
            date = datetime.fromtimestamp(reader.start_time).replace(tzinfo=timezone.utc)
            message.timestamp += date.timestamp() - reader.start_time
        yield message


class _WholeLines(io.TextIOBase):
    """The lines of a text without a last one that was cut off, as it may end within a number."""

    def __init__(self, file: BinaryIO) -> None:
        self._text = io.TextIOWrapper(file, encoding="utf-8-sig", errors="replace")
        self.number, self.last = 0, ""

    def __next__(self) -> str:  # type: ignore[override]
        """Return the next line."""
        line = self._text.readline(_LONGEST)
        if not line.endswith("\n") and len(line) < _LONGEST:
            raise StopIteration
        self.number, self.last = self.number + 1, line.strip()
        return line
