# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads logs of a CAN bus as bags through python-can, with a topic for each channel.

The frames of a log are kept in memory, 22 bytes for each, because a log has no index and need not
be in the order of its times.
"""

import gzip
import io
import re
import struct
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime, timezone
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.message_types import CAN_FRAME
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.missing_library import needed
from linkage_vibration.support.progress import shown_bar
from linkage_vibration.support.version import check_versions

if TYPE_CHECKING:
    from can import Message
    from rosbags.interfaces import Connection

SUFFIXES = (".log", ".txt", ".candump", ".csv", ".asc", ".trc", ".blf", ".mf4")
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
_BLF_HEADER = 56  # bytes, of which the last 16 are the date of the start
# Channel; and time in ns, identifier, remote, extended, error, number of bytes, data.
_Row: TypeAlias = tuple[str, tuple[int, int, bool, bool, bool, int, bytes]]

_ASC_HEADER = re.compile(r"\s*(date|base|//)", re.IGNORECASE)
_BUSMASTER_DATE = re.compile(r"\*\*\*START DATE AND TIME (\d+):(\d+):(\d+) ")
_REFUSED = ("***DEC", "***RELATIVE MODE", "***ABSOLUTE MODE")
_BUSMASTER = re.compile(
    r"(?P<hour>\d+):(?P<minute>\d+):(?P<second>\d+):(?P<part>\d{4}) [RT]x (?P<channel>\d+) "
    r"(?:0x)?(?P<id>[0-9A-F]+) (?P<extended>[sx])(?P<remote>r?) (?P<count>\d+)"
    r"(?P<data>[\s0-9A-F]*)$",
    re.IGNORECASE,
)
_GVRET = re.compile(
    r"(?P<micro>\d+),(?P<id>[0-9A-F]+),(?P<extended>true|false),(?:[RT]x,)?(?P<channel>\d+),"
    r"(?P<count>\d+)(?P<data>[\s,0-9A-F]*)(?P<remote>$)",
    re.IGNORECASE,
)
_PARTS = {"hour": 3600.0, "minute": 60.0, "second": 1.0, "part": 1e-4, "micro": 1e-6}  # s
_ERROR = re.compile(r"\S+ \S+ [23][0-9A-F]{7}#", re.IGNORECASE)  # of the interface, by candump
_RAW_LENGTH = re.compile("_[9A-Fa-f]$")  # of a frame of 8 bytes
_FEW_BAD = 100  # lines, beyond which half of all may be bad
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
    bad: int  # lines and frames that were left out
    fault: str  # why the first of them was

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
    suffix = can_log_suffix(path)
    with path.open("rb") as raw, shown_bar(path, path.stat().st_size) as bar:
        file: Any = gzip.GzipFile(fileobj=raw) if path.suffix.lower() == ".gz" else raw
        lines = _Lines(file, suffix)
        # Errors have no values, and some readers of python-can do not know their channel.
        rows = (row for row in _rows(file, suffix, lines) if not row[1][4])
        names, frames = _table(rows, lambda: raw.closed or bar.update(raw.tell() - bar.n), lines)
    kept = _in_order(frames)
    lines.bad += len(frames) - len(kept)
    _check_times(kept["time"])
    counts = np.bincount(kept["channel"], minlength=len(names)).tolist()
    connections = [_connection(i, name, counts[i]) for i, name in enumerate(names)]
    ordered = kept[np.argsort(kept["time"], kind="stable")]
    fault = lines.fault or "a time lies far from those beside it"
    return CanLog(connections, ordered, lines.bad, fault)


def _in_order(frames: NDArray[Any]) -> NDArray[Any]:
    """Leave out single frames whose time is far from those beside it, which are near each other."""
    steps = np.abs(np.diff(frames["time"])) > _DISORDER
    across = np.abs(frames["time"][2:] - frames["time"][:-2]) <= _DISORDER
    odd = np.zeros(len(frames), bool)
    odd[1:-1] = steps[1:] & steps[:-1] & across
    return frames[~odd]


def _connection(number: int, name: str, count: int) -> "Connection":
    import rosbags.interfaces as ros

    definition = ros.MessageDefinition(ros.MessageDefinitionFormat.MSG, DEFINITION)
    about = CAN_FRAME, definition, "", count, ros.ConnectionExtRosbag2("cdr", []), None
    return ros.Connection(number, "/" + re.sub(r"\W", "_", name), *about)


def _table(
    rows: Iterator[_Row], progress: Callable[[], object], lines: "_Lines"
) -> tuple[list[str], NDArray[Any]]:
    """Return the names of the channels, and the frames in the order of the log."""
    names: dict[str, int] = {}
    parts = [np.empty(0, _FRAME)]
    while chunk := list(islice(rows, _GATHERED)):
        numbers = [names.setdefault(channel, len(names)) for channel, _ in chunk]
        if len(names) > _CHANNELS:
            raise CanLogError(f"has more than {_CHANNELS} channels; give a log of fewer.")
        packed = [_PACKED.pack(*row, n) for (_, row), n in zip(chunk, numbers, strict=True)]
        parts.append(np.frombuffer(b"".join(packed), _FRAME))
        progress()
    frames = np.concatenate(parts)
    if lines.bad > len(frames):
        problem = f"has {lines.bad} lines that cannot be read: {lines.fault}"
        raise CanLogError(f"{problem}; correct or delete them, or record with `candump -l`.")
    if not len(frames):
        why = "none was received, or the file has another format, such as decimal commas"
        raise CanLogError(f"has no frames that can be read: {why}; give another file.")
    return list(names), frames


def _check_times(times: NDArray[np.int64]) -> None:
    """Raise an error for times that are not those of the frames."""
    if times.min() < 0 or times.max() > _LATEST:
        raise CanLogError("has a time before 1970 or after 2038; set the clock, and record again.")
    steps = np.diff(times)
    if times[0] < _ABSOLUTE and (steps < 0).sum() > _MIXED * len(steps):
        raise CanLogError("has differences of times instead of times; record it with `candump -l`.")
    behind = np.maximum.accumulate(times) - times
    if behind.max() > _DISORDER:
        at = int(np.argmax(behind > _DISORDER))
        problem = f"goes back in time by {1e-9 * behind[at]:.3f} s at frame {at + 1}"
        hint = "split the log there, and replay the parts one by one"
        raise CanLogError(f"{problem}, as the clock was set; {hint}.")


def _rows(file: BinaryIO, suffix: str, lines: "_Lines") -> Iterator[_Row]:
    """Yield the frames of a log, and count the lines of a text that are bad."""
    with needed("can", "needs python-can", CanLogError):
        import can
    text: Any = lines
    if suffix == ".blf":
        start, size = _blf_head(file)
        if size and file.seek(min(size, 2**40) - 1) and not file.read(1):
            lines.bad, lines.fault = 1, "the end of the file is missing"
        elif size and file.read(4) == b"LOGG":  # only where `.gz` has hidden it before
            hint = "unpack it with `gunzip`, and replay what comes out"
            raise CanLogError(f"holds another log from byte {size} of its content on; {hint}.")
        file.seek(0)
        reader = can.BLFReader(file)
        # Older versions of python-can read the date in the time zone of this machine.
        ahead = start - reader.start_timestamp if start and reader.start_timestamp else 0.0
        for message in reader:
            message.timestamp += ahead
            yield _row(message)
    elif suffix == ".mf4":
        if not file.read(8).startswith((b"MDF", b"UnFinMF")):
            raise CanLogError("does not begin like an MF4 file; give another file.")
        file.seek(0)
        try:
            yield from map(_row, can.MF4Reader(file))
        except NotImplementedError:
            raise CanLogError("needs asammdf; run `pip install linkage_vibration[mf4]`.") from None
    elif suffix == ".asc":
        yield from _text_rows(can.ASCReader(text, relative_timestamp=False), lines)
    elif suffix == ".trc":
        trace: Any = can.TRCReader(text)
        # That of python-can drops a bad line; older ones have no number of columns.
        trace._parse_line = lambda line: trace._parse_cols(
            (*line.split(None, getattr(trace, "_num_columns", -1)),)
        )
        yield from _text_rows(trace, lines)
    else:
        yield from _text_rows(can.CanutilsLogReader(text), lines)


def _blf_head(file: BinaryIO) -> tuple[float, int]:
    """Return the date of a BLF log as UTC, s since 1970, and its size in bytes; 0 if unknown."""
    header = file.read(_BLF_HEADER)
    size = int.from_bytes(header[16:24], "little")
    try:
        year, month, _, day, hour, minute, second, ms = struct.unpack("<8H", header[-16:])
        date = datetime(year, month, day, hour, minute, second, 1000 * ms, timezone.utc)
    except (struct.error, ValueError):
        return 0.0, size
    return date.timestamp(), size


def _text_rows(reader: "Iterable[Message]", lines: "_Lines") -> Iterator[_Row]:
    """Yield the frames of a text; after a bad line, the loop of python-can begins again."""
    while not lines.at_end and lines.bad <= max(_FEW_BAD, lines.number // 2):
        lines.begins = True
        try:
            for message in _dated(reader):
                row = _row(message)
                if not 0 <= row[1][0] <= _LATEST:
                    raise ValueError("its time is before 1970 or after 2038")
                yield row
        except (ValueError, LookupError, OverflowError) as error:
            lines.bad += 1
            lines.fault = lines.fault or f"line {lines.number} is {lines.last[:60]!r} ({error})"


def _row(message: "Message") -> _Row:
    data, channel = bytes(message.data), message.channel
    return (
        f"channel_{channel + 1}" if isinstance(channel, int) else str(channel or "channel_1"),
        (
            min(1000 * round(1e6 * message.timestamp), _LATEST + 1),
            message.arbitration_id & 0x1FFFFFFF,
            message.is_remote_frame,
            message.is_extended_id,
            message.is_error_frame,
            message.dlc if message.is_remote_frame else len(data),
            data,
        ),
    )


def _dated(reader: Any) -> "Iterator[Message]":
    """Yield frames, of ASC in UTC, whose date python-can takes for local time, of TRC from 0."""
    for message in reader:
        if getattr(reader, "timestamps_format", "") == "relative":
            problem = "has times since the previous event"
            why = "which do not add up where events are missing"
            raise CanLogError(f"{problem}, {why}; save it with absolute times.")
        if isinstance(start := getattr(reader, "start_time", None), float) and start:
            date = datetime.fromtimestamp(start).replace(tzinfo=timezone.utc)
            message.timestamp += date.timestamp() - start
        elif hasattr(reader, "file_version"):
            message.channel -= 1
        yield message


class _Lines(io.TextIOBase):
    """The lines of a text, all as candump writes them, without a last line that was cut off."""

    def __init__(self, file: BinaryIO, suffix: str) -> None:
        self._file, self._suffix, self._held, self._midnight = file, suffix, "", 0.0
        self.number, self.last, self.at_end = 0, "", False
        self.begins = True  # whether python-can reads a header
        self.bad, self.fault = 0, ""

    def __next__(self) -> str:  # type: ignore[override]
        """Return the next line that is not empty."""
        line, self._held = self._held, ""
        while not line.strip():
            content = self._file.readline(_LONGEST)
            if not content.endswith(b"\n") and len(content) < _LONGEST:
                self.at_end = True
                raise StopIteration
            try:
                line = content.decode("utf-8-sig")
            except UnicodeDecodeError:
                line = content.decode("cp1252", errors="replace")
            self.number, self.last = self.number + 1, line.strip()
            if "\0" in line:
                raise ValueError("a null character")
            if self._suffix not in (".asc", ".trc"):
                line = self._as_candump(line.strip())
        if self._suffix == ".asc" and self.begins and not _ASC_HEADER.match(line):
            # python-can drops the line that ends its header, so this one does.
            self._held, self.begins = line, False
            return "internal events logged\n"
        return line

    def _as_candump(self, line: str) -> str:
        """Return a line as candump writes it; empty for a line of a header, or an error."""
        if date := _BUSMASTER_DATE.match(line):
            day, month, year = map(int, date.groups())
            self._midnight = datetime(year, month, day, tzinfo=timezone.utc).timestamp()
        elif line.startswith(_REFUSED):
            problem = "has decimal numbers or no times of day"
            raise CanLogError(f"{problem}; save it with `***HEX***` and `***SYSTEM MODE***`.")
        if line.startswith(("***", "Time Stamp,")):
            return ""
        match = _BUSMASTER.match(line) or _GVRET.match(line)
        if match is None:
            if _ERROR.match(line):
                return ""
            digits = line.rpartition("#")[2].split(" ")[0]
            if len(digits) % 2 != ("##" in line) and digits.isalnum() and digits[0] not in "Rr":
                raise ValueError("half of a byte is missing")
            return _RAW_LENGTH.sub("", line)
        found = match.groupdict(default="0")
        time = self._midnight + sum(float(found.get(part, 0)) * _PARTS[part] for part in _PARTS)
        data, count = re.sub(r"[\s,]", "", found["data"]), int(found["count"])
        if found["remote"] == "r":
            data = f"R{count}"
        elif len(data) != 2 * count:
            raise ValueError(f"it has not {count} bytes")
        number = f"{int(found['id'], 16):0{8 if found['extended'] in 'xtrueTRUE' else 3}X}"
        return f"({time:.6f}) can{found['channel']} {number}#{data}"
