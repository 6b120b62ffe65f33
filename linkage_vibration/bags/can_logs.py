# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads logs of a CAN bus as bags: text of candump, and Vector's ASC and BLF through python-can.

Each channel is a topic of type ``can_msgs/msg/Frame``. The frames of a log are kept in memory, 22
bytes for each, because a log has no index and need not be in the order of its times.
"""

import gzip
import io
import re
from codecs import BOM_UTF8
from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import datetime, timezone
from itertools import count, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TextIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.message_types import CAN_FRAME
from linkage_vibration.errors import LinkageVibrationError

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

_VECTOR = (".asc", ".blf")
SUFFIXES = (".log", ".txt", ".candump", *_VECTOR)
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
_MESSAGE = np.dtype(
    [
        ("head", "u1", 4),
        ("sec", "<i4"),
        ("nanosec", "<u4"),
        ("length", "<u4"),
        ("frame_id", "S4"),
        ("id", "<u4"),
        ("flags", "u1", 3),
        ("dlc", "u1"),
        ("data", "u1", 8),
    ]
)
"""A ``can_msgs/msg/Frame`` in CDR whose header has the frame ``can``, as drivers write it."""
# Time in ns, channel, identifier, remote, extended, error, number of bytes, data.
_Row: TypeAlias = tuple[int, str, int, bool, bool, bool, int, bytes]

_GATHERED = 1 << 16  # frames that are converted to an array at a time
_LONGEST = 1000  # bytes of a line; the longest line of candump has about 400
_ABSOLUTE = 10**9 * 10**6  # ns; earlier times are relative to the beginning of the log
_LATEST = 2**31 - 1  # s; a stamp of ROS 2 cannot be later
_DISORDER = 10**9  # ns; channels are written one after the other, but no later than this
_MIXED = 0.1  # share of descending times, above which they are differences
_CHANNELS = 64
_HEADER = 20  # lines of an ASC log, in which its beginning is
_ERROR = 1 << 29  # SocketCAN's flag of an error frame

_LINE = re.compile(
    rb"\s*\((\d{1,11})\.(\d{1,9})\)\s+(\S+)\s+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})"
    rb"#(?:(R)([0-8]?)|(?:#[0-9A-Fa-f])?((?:[0-9A-Fa-f]{2}\.?)*))(?:_[0-9A-Fa-f])?(?:\s+[RT])?\s*"
)
_SHOWN = re.compile(rb"\s*(\(.*\)\s+)?\S+\s.*\b[0-9A-Fa-f]{3,8}\s+\[\d+\]")  # on a console


class CanLogError(LinkageVibrationError):
    """A log of a CAN bus cannot be read; the text follows the name of the file."""


def can_log_suffix(path: Path) -> str:
    """Return the suffix of a log of a CAN bus without that of gzip; empty for other files."""
    suffix = Path(path.name.lower().removesuffix(".gz")).suffix
    return suffix if suffix in SUFFIXES and not path.is_dir() else ""


class CanLogReader:
    """A log of a CAN bus with the interface of a reader of rosbags.

    Attributes
    ----------
    connections : list of Connection
        One for each channel; its identifier is the index of the channel.
    times : ndarray, (n,)
        Times of the frames, ns, in ascending order.
    channels : ndarray, (n,)
        Their channels.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._frames = np.empty(0, _FRAME)
        self.connections: list[Connection] = []
        if can_log_suffix(path) in _VECTOR:
            import can  # noqa: F401, so that a missing library is reported first

    @property
    def times(self) -> NDArray[np.int64]:
        """Times of the frames, ns, in ascending order."""
        return self._frames["time"]

    @property
    def channels(self) -> NDArray[np.uint8]:
        """Indices of the channels of the frames."""
        return self._frames["channel"]

    @property
    def message_count(self) -> int:
        """The number of frames."""
        return len(self._frames)

    def __enter__(self) -> "CanLogReader":
        """Read the log; see `open`."""
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        """Forget the frames."""
        self._frames = self._frames[:0]

    def open(self) -> None:
        """Read the log; damage may raise any exception, such as a `CanLogError`."""
        with _opened(self._path) as file:
            suffix = can_log_suffix(self._path)
            names, frames = _table(_vector(file, suffix) if suffix in _VECTOR else _candump(file))
        _check_times(frames["time"])
        self._frames = frames[np.argsort(frames["time"], kind="stable")]
        counts = np.bincount(frames["channel"], minlength=len(names)).tolist()
        self.connections = [_connection(i, name, counts[i]) for i, name in enumerate(names)]

    def messages(
        self, connections: "Sequence[Connection]"
    ) -> "Iterator[tuple[Connection, int, bytes]]":
        """Yield the connection, the time (ns) and the bytes of each frame of these connections."""
        for row in np.flatnonzero(np.isin(self.channels, [c.id for c in connections])):
            connection = self.connections[self.channels[row]]
            yield connection, int(self.times[row]), self.encoded(np.array([row])).tobytes()

    def encoded(self, rows: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Return frames as messages in CDR, (n, 36), by their indices, (n,)."""
        frames, messages = self._frames[rows], np.zeros(len(rows), _MESSAGE)
        messages["head"] = np.array([0, 1, 0, 0])
        messages["sec"], messages["nanosec"] = np.divmod(frames["time"], 10**9)
        messages["length"], messages["frame_id"] = 4, b"can"
        for name in ("id", "flags", "dlc", "data"):
            messages[name] = frames[name]
        return messages.view(np.uint8).reshape(len(rows), _MESSAGE.itemsize)


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
        time, channel, identifier, remote, extended, error, dlc, data = zip(*chunk, strict=True)
        part = np.zeros(len(chunk), _FRAME)
        part["time"], part["id"], part["dlc"] = time, identifier, dlc
        part["flags"] = np.array([remote, extended, error]).T
        padded = b"".join([each[:8].ljust(8, b"\0") for each in data])
        part["data"] = np.frombuffer(padded, np.uint8).reshape(-1, 8)
        numbers = [names.setdefault(name, len(names)) for name in channel]
        if len(names) > _CHANNELS:
            raise CanLogError(f"has more than {_CHANNELS} channels; it is damaged.")
        part["channel"] = numbers
        parts.append(part)
    frames = np.concatenate(parts)
    if not len(frames):
        raise CanLogError(
            "has no frames that can be read: none was received, or the file has another format, "
            "such as decimal commas; give another file."
        )
    return list(names), frames


def _check_times(times: NDArray[np.int64]) -> None:
    """Raise an error for times that are not those of the frames."""
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


def _candump(file: BinaryIO) -> Iterator[_Row]:
    """Yield the frames of a text of candump, as `candump -l` or `candump -L` writes it."""
    for number in count(1):
        line = file.readline(_LONGEST)
        if number == 1:
            line = line.removeprefix(BOM_UTF8)
        if not line:
            return
        match = _LINE.fullmatch(line)
        if match is None:
            cut_off = number > 1 and not line.endswith(b"\n") and len(line) < _LONGEST
            if cut_off or not line.strip():
                continue
            raise _foreign(number, line)
        seconds, fraction, channel, identifier, remote, length, text = match.groups()
        if int(seconds) > _LATEST:
            raise _foreign(number, line)
        time = int(seconds) * 10**9 + int(fraction.ljust(9, b"0"))
        data = bytes.fromhex((text or b"").replace(b".", b"").decode())
        value = int(identifier, 16)
        error = len(identifier) == 8 and bool(value & _ERROR)
        dlc = len(data) if remote is None else int(length or 0)
        extended = len(identifier) == 8 and not error
        yield (
            time,
            channel.decode(errors="replace"),
            value & 0x1FFFFFFF,
            remote is not None,
            extended,
            error,
            dlc,
            data,
        )


def _foreign(number: int, line: bytes) -> CanLogError:
    text = line[:60].decode(errors="replace").rstrip()
    if _SHOWN.match(line):
        return CanLogError(
            f"is what candump shows on a console (line {number} is {text!r}); record it with "
            "`candump -l` or `candump -L`."
        )
    return CanLogError(
        f"is not a log of candump, as line {number} is {text!r}; correct or delete this line, or "
        "give another file."
    )


def _vector(file: BinaryIO, suffix: str) -> Iterator[_Row]:
    """Yield the frames of a log of Vector's tools, which python-can reads."""
    import can

    reader: Any
    if suffix == ".asc":
        text = io.TextIOWrapper(file, encoding="utf-8-sig", errors="replace")
        start = _asc_start(text)
        text.seek(0)
        reader = _asc_messages(text)
    else:
        start, reader = 0, can.BLFReader(file)
    for message in reader:
        data = bytes(message.data)
        yield (
            start + 1000 * round(1e6 * message.timestamp),
            f"channel_{1 + (message.channel or 0)}",
            message.arbitration_id & 0x1FFFFFFF,
            message.is_remote_frame,
            message.is_extended_id and not message.is_error_frame,
            message.is_error_frame,
            message.dlc if message.is_remote_frame else len(data),
            data,
        )


def _asc_messages(text: TextIO) -> Iterator[Any]:
    """Yield the frames of an ASC log as python-can decodes them."""
    import can

    lines: Any = _WholeLines(text)
    try:
        yield from can.ASCReader(lines, relative_timestamp=True)
    except ValueError as error:
        raise CanLogError(
            f"has a frame that cannot be read, as line {lines.number} is {lines.last[:60]!r} "
            f"({error}); correct or delete this line."
        ) from None


class _WholeLines(io.TextIOBase):
    """A text without its last line where that was cut off, as it may end within a number.

    Before the first frame it has the line that ends a header, as python-can takes any line for it.
    """

    def __init__(self, text: TextIO) -> None:
        self._text, self._held = text, ""
        self._begun = False
        self.number, self.last = 0, ""

    def __next__(self) -> str:  # type: ignore[override]
        """Return the next line."""
        line, self._held = self._held or next(self._text), ""
        if not self._begun and re.match(r"\s*\d+\.\d+\s", line):
            self._begun, self._held = True, line
            return "internal events logged\n"
        if not line.endswith("\n"):
            raise StopIteration
        self.number, self.last = self.number + 1, line.strip()
        return line


def _asc_start(text: TextIO) -> int:
    """Return when an ASC log begins, ns, as if its date was in UTC; 0 if that is not known."""
    start = 0
    for line in islice(text, _HEADER):
        if re.match(r"base\s+\w+\s+timestamps\s+relative", line, re.IGNORECASE):
            raise CanLogError(
                "has times since the previous event, which do not add up where events are missing; "
                "save it with absolute times."
            )
        match = re.match(r"(?:date|begin triggerblock)\s+\S+\s+(.+)", line, re.IGNORECASE)
        date = " ".join(match[1].split()) if match else ""
        for clock in ("%I:%M:%S.%f %p", "%I:%M:%S %p", "%H:%M:%S.%f", "%H:%M:%S"):
            with suppress(ValueError):
                begun = datetime.strptime(date, f"%b %d {clock} %Y")
                start = round(1e6 * begun.replace(tzinfo=timezone.utc).timestamp()) * 1000
    return start
