# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of CAN buses are read as bags with a topic for each channel."""

import gzip
import random
import struct
import sys
from contextlib import nullcontext
from datetime import datetime, timezone
from pathlib import Path
from time import tzset
from typing import NamedTuple

import numpy as np
import pytest

from linkage_vibration.bags.blocks import Block
from linkage_vibration.bags.can_frames import (
    EXTENDED,
    REMOTE,
    frame_columns,
    frame_key,
    frame_places,
)
from linkage_vibration.bags.can_reader import CanReader, find_signal
from linkage_vibration.bags.cdr import Layouts
from linkage_vibration.bags.message_columns import read_columns, topic_types
from linkage_vibration.bags.message_types import ISOBUS_FRAME
from linkage_vibration.bags.reading import BagError
from linkage_vibration.bags.scalar_reader import CdrError, SkippedMessages
from linkage_vibration.bags.streams import open_bags
from test.support.can_bus import EPOCH, BusFrame, identifier, write_candump

can = pytest.importorskip("can", reason="logs are written with python-can (extra can)")

HITCH = identifier(65093, 0xF0)


class Frame(NamedTuple):
    """A frame: stamp and frame of its header, key, number of bytes, and data."""

    sec: int
    nanosec: int
    frame_id: str
    key: int
    dlc: int
    payload: bytes


def decoded(block: Block, left_out: SkippedMessages) -> dict[int, Frame]:
    """Return the frames of a block by their rows, read together; each one alone has the same key.

    Other messages are counted.
    """
    layouts, frames = Layouts("can_msgs/msg/Frame", frame_places), {}
    for layout, rows, messages in layouts.groups(block, np.arange(len(block)), left_out):
        (sec, nanosec), (key, dlc, payload) = (
            layout.stamps(messages),
            frame_columns(layout, messages),
        )
        for i, row in enumerate(rows.tolist()):
            data = block.message(row)
            assert frame_key(layouts.find(data), data) == key[i]
            stamp = int(sec[i]), int(nanosec[i]), layout.places[0]
            frames[row] = Frame(*stamp, int(key[i]), int(dlc[i]), payload[i].tobytes())
    return frames


def frames_of(
    paths: Path | list[Path], topics: list[str] | None = None
) -> list[tuple[int, str, Frame]]:
    """Return log time, topic and frame of each message of logs, read in blocks and one by one."""
    actual = []
    with open_bags([paths] if isinstance(paths, Path) else paths) as bags:
        names = topics or [topic.name for topic in bags.topics]
        for block in bags.blocks(names):
            left_out = SkippedMessages()
            frames = decoded(block, left_out)
            assert not left_out.unreadable
            for row in range(len(block)):
                actual.append((int(block.log_times[row]), names[block.topics[row]], frames[row]))
    return actual


def write(path: Path, frames: list[BusFrame]) -> Path:
    """Write a log with python-can."""
    with can.Logger(path) as logger:
        for frame in frames:
            channel = int(frame.channel[-1])
            logger(
                can.Message(
                    timestamp=1e-9 * frame.time,
                    arbitration_id=frame.identifier,
                    is_extended_id=frame.extended,
                    data=frame.data,
                    channel=channel,
                )
            )
    return path


def drive(n: int = 500) -> list[BusFrame]:
    """Return frames of two channels, of all lengths."""
    rng = random.Random(4)
    actual = []
    for k in range(n):
        extended = rng.random() < 0.8
        number = rng.randrange(1 << (29 if extended else 11))
        data = rng.randbytes(rng.randrange(9))
        time = EPOCH + 1_000_000 * k
        actual.append(BusFrame(time, number, data, extended, f"can{rng.randrange(2)}"))
    return actual


def expected(frames: list[BusFrame]) -> list[tuple[int, Frame]]:
    """Return time and message of each frame."""
    return [
        (
            frame.time,
            Frame(
                frame.time // 10**9,
                frame.time % 10**9,
                "can",
                frame.identifier | (EXTENDED if frame.extended else 0),
                len(frame.data),
                frame.data.ljust(8, b"\0"),
            ),
        )
        for frame in frames
    ]


def test_date_of_blf_is_utc(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The date in a BLF log is read as UTC, in whatever time zone the machine is."""
    monkeypatch.setenv("TZ", "UTC")
    tzset()
    try:
        path, frames = tmp_path / "bus.blf", drive()
        write(path, frames)
        monkeypatch.setenv("TZ", "America/New_York")
        tzset()
        assert [each[0] for each in frames_of(path)] == [frame.time for frame in frames]
    finally:
        monkeypatch.undo()
        tzset()


KINDS = ["bus.log", "bus.txt", "bus.asc", "bus.blf.gz"]


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_of_log(tmp_path: Path, name: str) -> None:
    """Each log that python-can writes has the frames that were written, by their channels."""
    frames = drive()
    path = tmp_path / name
    kind = Path(name.removesuffix(".gz")).suffix.replace(".txt", ".log")
    plain = write(tmp_path / f"plain{kind}", frames)
    if name.endswith(".gz"):
        path.write_bytes(gzip.compress(plain.read_bytes()))
    else:
        plain.rename(path)
    actual = frames_of(path)
    first = 0 if kind == ".log" else 1
    names = [f"/{'channel_' if first else 'can'}{int(f.channel[-1]) + first}" for f in frames]
    assert [topic for _, topic, _ in actual] == names
    wanted = expected(frames)
    # The text of ASC begins in the time zone of the machine that writes it.
    shift = actual[0][0] - frames[0].time
    assert shift % (900 * 10**9) == 0 if kind == ".asc" else shift == 0
    for (time, _, frame), (wanted_time, wanted_frame) in zip(actual, wanted, strict=True):
        assert time == wanted_time + shift
        assert frame[2:] == wanted_frame[2:]
        assert 10**9 * frame.sec + frame.nanosec == time
    assert topic_types(path) == dict.fromkeys(sorted(set(names)), "can_msgs/msg/Frame")
    columns = read_columns(path, {names[0]: "can_msgs/msg/Frame"})[names[0]]
    assert [columns[name][0] for name in ("log_time", "id", "dlc")] == [
        actual[0][0],
        frames[0].identifier,
        len(frames[0].data),
    ]


def test_channels_and_bags_are_merged(tmp_path: Path) -> None:
    """One channel can be read by itself, and several logs are read as one."""
    frames = drive()
    halves = [frames[:250], frames[250:]]
    paths = [write(tmp_path / f"{k}.log", half) for k, half in enumerate(halves)]
    wanted = [pair for pair, f in zip(expected(frames), frames, strict=True) if f.channel == "can1"]
    actual = frames_of(paths, ["/can1"])
    assert [(time, frame) for time, _, frame in actual] == wanted


LOG = """\
(1700000000.000100) can0 0CFE45F0#7DFFFFFFFFFFFFFF
(1700000000.000200) can0 123#112233
(1700000000.000300) can0 0CFE45F0#7E R
(1700000000.000400) can0 0CFE45F0#R
(1700000000.000500) can0 20000080#0000000000000000
(1700000000.000600) can0 0CFE45F0##10102030405060708090A0B0C
(1700000000.000700) can0 0CFE45F0#41424327 T
(1700000000.000800000) can0 0CFE45F0#
"""


def test_text_of_candump(tmp_path: Path) -> None:
    """A text of candump has data, remote and CAN FD frames, and frames without data; no errors."""
    path = tmp_path / "candump-2023-11-14.log"
    path.write_text(LOG)
    frames = frames_of(path)
    assert [time - EPOCH for time, *_ in frames] == [100_000 * k for k in (1, 2, 3, 4, 6, 7, 8)]
    extended = EXTENDED | 0x0CFE45F0
    assert [(frame.key, frame.dlc, frame.payload.hex()) for *_, frame in frames] == [
        (extended, 8, "7dffffffffffffff"),
        (0x123, 3, "1122330000000000"),
        (extended, 1, "7e00000000000000"),
        (REMOTE | extended, 0, 16 * "0"),
        (extended, 12, "0102030405060708"),
        (extended, 4, "4142432700000000"),
        (extended, 0, 16 * "0"),
    ]


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf"])
def test_error_frames_make_no_topic(tmp_path: Path, suffix: str) -> None:
    """An error frame that python-can writes, of whatever channel, is no message of any topic."""
    path = tmp_path / f"bus{suffix}"
    with can.Logger(path) as logger:
        for k in range(10):
            error, channel = k % 3 == 1, k % 4
            number = {} if error else {"arbitration_id": HITCH, "data": [k]}
            stamp = 1e-9 * EPOCH + k
            message = can.Message(stamp, is_error_frame=error, channel=channel, **number)
            if error or channel == 0:
                logger(message)
    actual = frames_of(path)
    assert {topic for _, topic, _ in actual} == {"/can0" if suffix == ".log" else "/channel_1"}
    assert [frame.payload[0] for *_, frame in actual] == [0, 8]


@pytest.mark.parametrize("number", ["20000004", "20000080", "2000010c"])
def test_errors_of_candump(tmp_path: Path, number: str) -> None:
    """Errors of the interface, of the bus and of a driver (linux/can/error.h) are no frames."""
    path = tmp_path / "bus.log"
    path.write_text(f"(1.0) can0 123#11\n(2.0) can0 {number}#0004000000000000\n(3.0) can0 123#22\n")
    assert read_bad(path) == ([(10**9, 0x123, "11"), (3 * 10**9, 0x123, "22")], 0, "")
    assert [topic for _, topic, _ in frames_of(path)] == ["/can0", "/can0"]


LINE = "(1700000000.000100) can0 0CFE45F0#7D\n"
FAULTS = {
    "empty": ("", r"is empty, as its recording ended before"),
    "no frames": ("\n\n", r"has no frames"),
    "too late": (
        LINE.replace("1700000000", "2147483648"),
        r"its time is before 1970 or after 2038",
    ),
    "too early": (LINE.replace("1700000000", "-1"), r"its time is before 1970 or after 2038"),
    "console": (
        " (1700000000.000100)  can0  RX - -  0CFE45F0   [1]  7D\n",
        r"cannot be read: line 1 is .*candump -l",
    ),
    "a hundred bad lines": (LINE + "x\n" * 300, r"has 101 lines that cannot be read: line 2 is"),
    "one long line": ("x" * 10**6, r"cannot be read: line 1 is"),
    "a long line between others": (LINE + "x" * 10**4 + "\n" + LINE, r"cannot be read: line 2 is"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_text(tmp_path: Path, fault: str) -> None:
    """An error names the file, the line or the frame, and the remedy."""
    text, words = FAULTS[fault]
    path = tmp_path / "bus.log"
    path.write_text(text)
    with pytest.raises(BagError, match=rf"bus\.log .*{words}"):
        frames_of(path)


def test_byte_order_mark(tmp_path: Path) -> None:
    """A text that an editor of Windows has saved is read, with the date of an ASC log."""
    (tmp_path / "bus.log").write_text("\ufeff" + LINE, encoding="utf-8")
    assert [time for time, _, _ in frames_of(tmp_path / "bus.log")] == [1_700_000_000_000_100_000]
    header = "date Thu Jan 1 00:00:10.000 1970\nbase hex timestamps absolute\n"
    header += "no internal events logged\n"
    frame = "   1.000000 1  0CFE45F0x       Rx   d 1 7D\n"
    path = tmp_path / "bus.asc"
    path.write_text("\ufeff" + header + frame, encoding="utf-8")
    assert [time for time, _, _ in frames_of(path)] == [11 * 10**9]


def read_bad(path: Path) -> tuple[list[tuple[int, int, str]], int, str]:
    """Return time, key and data of each frame, and how many lines were left out, and why."""
    with open_bags([path]) as bags:
        bad, fault = bags.bad_lines, bags.fault
    return [(time, f.key, f.payload[: f.dlc].hex()) for time, _, f in frames_of(path)], bad, fault


GOOD = [(1_700_000_000_000_100_000 + k * 10**7, EXTENDED | 0xCFE45F0, "7d") for k in range(9)]
BAD_LINES = {
    "digits": "(1700000000.1) can0 0CFE45F0#7Z",
    "half of a byte": "(1700000000.1) can0 0CFE45F0#7D1",
    "half of a byte of FD": "(1700000000.1) can0 0CFE45F0##17D1",
    "time": "(1700000000.x) can0 0CFE45F0#7D",
    "a late time": "(9700000000.1) can0 0CFE45F0#7D",
    "a negative time": "(-5.1) can0 0CFE45F0#7D",
    "an odd time": "(1600000000.1) can0 0CFE45F0#7D",
    "words": "the log was rotated here",
    "zeros": 40 * "\0",
    "a long line": 5000 * "x",
}


@pytest.mark.parametrize("bad", BAD_LINES)
def test_one_bad_line_is_one(tmp_path: Path, bad: str) -> None:
    """One bad line is counted and named, and the frames of all others are read."""
    lines = [
        f"({time // 10**9}.{time % 10**9 // 1000:06d}) can0 0CFE45F0#7D\n" for time, *_ in GOOD
    ]
    path = tmp_path / "bus.log"
    path.write_text("".join([*lines[:2], BAD_LINES[bad] + "\n", *lines[2:]]))
    frames, count, fault = read_bad(path)
    assert frames == GOOD
    assert count == (5 if bad == "a long line" else 1)
    assert fault.startswith("a time lies far" if bad == "an odd time" else "line 3 is '")


def test_raw_length_of_candump(tmp_path: Path) -> None:
    """The raw length behind 8 bytes, as ``candump -8`` writes it, is no fault."""
    path = tmp_path / "bus.log"
    path.write_text("(1.000000) can0 123#1122334455667788_9\n(2.000000) can0 123#11\n")
    frames = [(10**9, 0x123, "1122334455667788"), (2 * 10**9, 0x123, "11")]
    assert read_bad(path) == (frames, 0, "")


HEADERS = {
    "of BusMaster": "date Tue Nov 14 10:13:20.500 pm 2023\nbase hex  timestamps absolute\n",
    "only a comment": "// written by a program\n",
    "none": "",
    "with an empty line": "\ndate Tue Nov 14 10:13:20.500 pm 2023\nbase hex  timestamps absolute\n",
    "with a trigger": "base hex  timestamps absolute\n"
    "Begin Triggerblock Tue Nov 14 10:13:20.500 pm 2023\n",
    "with all lines": "date Tue Nov 14 10:13:20.500 pm 2023\nbase hex  timestamps absolute\n"
    "internal events logged\n// version 9\nBegin Triggerblock Tue Nov 14 10:13:20.500 pm 2023\n"
    "   0.000000 Start of measurement\n",
}


@pytest.mark.parametrize("header", HEADERS)
def test_first_frame_of_asc(tmp_path: Path, header: str) -> None:
    """No frame is lost, whatever lines come before the first one; python-can would drop it."""
    lines = [f"   {k}.250000 1  CFE45F0x        Rx   d 1 7D\n" for k in range(1, 5)]
    path = tmp_path / "bus.asc"
    path.write_text(HEADERS[header] + "".join(lines))
    start = EPOCH + 500_000_000 if "Nov" in HEADERS[header] else 0
    times = [start + k * 10**9 + 250_000_000 for k in range(1, 5)]
    assert read_bad(path) == ([(time, EXTENDED | 0xCFE45F0, "7d") for time in times], 0, "")


@pytest.mark.parametrize(
    ("month", "encoding", "bad"),
    [("Mär", "utf-8", 0), ("Mär", "cp1252", 0), ("févr.", "cp1252", 1), ("ene", "utf-8", 1)],
)
def test_month_in_another_language(tmp_path: Path, month: str, encoding: str, bad: int) -> None:
    """A German month is read; without the date of another one, which is named, times begin at 0."""
    text = f"date Die {month} 14 10:13:20.500 2023\nbase hex  timestamps absolute\n"
    text += (
        "internal events logged\n   0.250000 1  CFE45F0x  Rx d 1 7D\n   0.5 1  7FFx  Rx d 1 7E\n"
    )
    path = tmp_path / "bus.asc"
    path.write_bytes(text.encode(encoding))
    frames, count, fault = read_bad(path)
    march = int(datetime(2023, 3, 14, 10, 13, 20, tzinfo=timezone.utc).timestamp()) * 10**9
    start = 0 if bad else march + 500_000_000
    assert [time - start for time, *_ in frames] == [250_000_000, 500_000_000]
    assert count == bad
    assert ("date Die" in fault) == bool(bad)


BUSMASTER = """\
***BUSMASTER Ver 3.2.2***
***PROTOCOL CAN***
***[START LOGGING SESSION]***
***START DATE AND TIME 14:11:2023 22:13:20:466***
***HEX***
***SYSTEM MODE***
***<Time><Tx/Rx><Channel><CAN ID><Type><DLC><DataBytes>***
22:13:21:0500 Rx 1 0x0CFE45F0 x 8 7D FF 01 02 03 04 05 06
22:13:21:0600 Tx 2 0x123 s 2 AA 0B
22:13:21:0700 Rx 1 0x124 sr 4
22:13:21:0800 Rx 1 0x124 s 0
22:13:21:0900 Rx 1 0x124 s 3 11 22
***[STOP LOGGING SESSION]***
"""
GVRET = """\
Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8
1700000001050000,0CFE45F0,true,Rx,0,8,7D,FF,01,02,03,04,05,06,
1700000001060000,00000123,false,Tx,1,2,AA,0B,
1700000001080000,00000124,false,Rx,0,0,
1700000001090000,00000124,false,Rx,0,3,11,22,
"""


@pytest.mark.parametrize("kind", ["BusMaster", "SavvyCAN", "GVRET"])
def test_text_of_other_programs(tmp_path: Path, kind: str) -> None:
    """Logs of BusMaster, GVRET and SavvyCAN are read; a line of a wrong length is named."""
    path = tmp_path / ("bus.log" if kind == "BusMaster" else "bus.csv")
    text = BUSMASTER if kind == "BusMaster" else GVRET
    if kind == "GVRET":
        text = text.replace(",Dir,", ",").replace(",Rx,", ",").replace(",Tx,", ",")
    path.write_text(text, newline="\r\n")
    expected = [
        (50, EXTENDED | 0xCFE45F0, "7dff010203040506"),
        (60, 0x123, "aa0b"),
        (70, REMOTE | 0x124, "00000000"),
        (80, 0x124, ""),
    ]
    if kind != "BusMaster":
        del expected[2]  # these programs write no remote frames
    frames, count, fault = read_bad(path)
    assert [(time - EPOCH - 10**9, *rest) for time, *rest in frames] == [
        (milli * 10**6, *rest) for milli, *rest in expected
    ]
    assert (count, "has not 3 bytes" in fault) == (1, True)
    with open_bags([path]) as bags:
        assert len(bags.topics) == 2
    if kind == "BusMaster":
        path.write_text(text.replace("HEX", "DEC"))
        with pytest.raises(BagError, match="has decimal numbers or no times of day; save it with"):
            frames_of(path)


TRC = {
    "1.1": ";$FILEVERSION=1.1\n;$STARTTIME=45244.9259259259\n;\n"
    "  1)      1050.0  Rx     0CFE45F0  8  7D FF 01 02 03 04 05 06\n"
    "  2)      1060.0  Rx         0123  2  AA 0B\n"
    "  3)      1070.0  Rx         0123  2  AA\n"
    "  4)      1080.0  Rx         0124  0\n",
    "2.1": ";$FILEVERSION=2.1\n;$STARTTIME=45244.9259259259\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"
    "      1      1050.000 DT 1 0CFE45F0 Rx -  8    7D FF 01 02 03 04 05 06\n"
    "      2      1060.000 DT 1     0123 Rx -  2    AA 0B\n"
    "      3      1070.000 DT 1     0123 Rx -  2    A\n"
    "      4      1080.000 DT 1     0124 Rx -  0    \n",
}


@pytest.mark.parametrize("version", TRC)
def test_trc_of_peak(tmp_path: Path, version: str) -> None:
    """The frames of a log of PEAK are read, and the bad line is named."""
    path = tmp_path / "bus.trc"
    path.write_text(TRC[version])
    frames, count, fault = read_bad(path)
    days = datetime(1899, 12, 30, tzinfo=timezone.utc).timestamp() + 86400.0 * 45244.9259259259
    expected = [
        (1.05, EXTENDED | 0xCFE45F0, "7dff010203040506"),
        (1.06, 0x123, "aa0b"),
        (1.08, 0x124, ""),
    ]
    for (time, key, data), (since, *rest) in zip(frames, expected, strict=True):
        assert time == pytest.approx(1e9 * (days + since), abs=2000)
        assert [key, data] == rest
    assert (count, fault.startswith("line 6 is ")) == (1, True)
    with open_bags([path]) as bags:
        assert [topic.name for topic in bags.topics] == ["/channel_1"]


def test_mf4(tmp_path: Path) -> None:
    """The frames of an MF4 file that asammdf has written through python-can are read."""
    pytest.importorskip("asammdf")
    frames = drive(50)
    path = write(tmp_path / "bus.mf4", frames)
    assert [(frame.key, frame.payload) for _, _, frame in frames_of(path)] == [
        (frame.key, frame.payload) for _, frame in expected(frames)
    ]


def test_mf4_without_its_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without asammdf, the error names the extra."""
    monkeypatch.setattr("can.io.mf4.asammdf", None)
    (tmp_path / "bus.mf4").write_bytes(b"MDF     4.10    ")
    with pytest.raises(BagError, match=r"bus.mf4 needs asammdf; run `pip install .*\[mf4\]`"):
        frames_of(tmp_path / "bus.mf4")


def test_slight_disorder_is_sorted(tmp_path: Path) -> None:
    """Frames of two channels that were written a little late are read in the order of times."""
    frames = drive()
    path = write_candump(tmp_path / "bus.log", frames)
    lines = path.read_text().splitlines(keepends=True)
    random.Random(1).shuffle(lines)
    path.write_text("".join(lines))
    assert [(time, frame) for time, _, frame in frames_of(path)] == expected(frames)
    for late, words in (("0.999", ""), ("1.009", "goes back in time by 1.009 s")):
        times = (f"170000000{each}" for each in (late, "0.000", "0.090"))
        path.write_text("".join(f"({time}) can0 123#11\n" for time in times))
        with pytest.raises(BagError, match=words) if words else nullcontext():
            assert len(frames_of(path)) == 3


@pytest.mark.parametrize(("back", "refused"), [(10, False), (11, True)])
def test_a_tenth_of_relative_times_may_descend(tmp_path: Path, back: int, refused: bool) -> None:
    """More of them are differences of times."""
    times = np.cumsum([1.0] + [0.01, -0.005] * back + [0.01] * (100 - 2 * back))
    path = tmp_path / "bus.log"
    path.write_text("".join(f"({time:010.6f}) can0 123#11\n" for time in times.tolist()))
    with pytest.raises(BagError, match="differences of times") if refused else nullcontext():
        assert len(frames_of(path)) == 101


def test_relative_times(tmp_path: Path) -> None:
    """A log whose times begin at 0 keeps them, unless they are differences."""
    path = tmp_path / "bus.log"
    path.write_text("(000.000000) can0 123#11\n(001.250000) can0 123#12\n")
    assert [time for time, *_ in frames_of(path)] == [0, 1_250_000_000]
    asc = tmp_path / "bus.asc"
    text = "date Tue Nov 14 10:13:20.500 pm 2023\nbase hex  timestamps absolute\n"
    text += "no internal events logged\n   0.250000 1  CFE45F0x        Rx   d 1 7D\n"
    asc.write_text(text)
    assert [time for time, *_ in frames_of(asc)] == [EPOCH + 750_000_000]
    asc.write_text(text.partition("\n")[2])
    assert [time for time, *_ in frames_of(asc)] == [250_000_000]
    asc.write_text(text.replace("absolute", "relative"))
    with pytest.raises(BagError, match=r"bus\.asc has times since the previous event"):
        frames_of(asc)


@pytest.mark.parametrize("kind", [".log", ".asc", ".blf", ".blf.gz"])
def test_truncated_logs(tmp_path: Path, kind: str) -> None:
    """A log that was cut off has the frames before the cut, or gives an error."""
    frames = drive(30)
    path = write(tmp_path / f"bus{kind.removesuffix('.gz')}", frames)
    whole = path.read_bytes()
    if kind.endswith(".gz"):
        whole, path = gzip.compress(whole), tmp_path / f"bus{kind}"
        path.write_bytes(whole)
    complete = frames_of(path)
    read = 0
    for size in [
        *range(0, len(whole), max(1, len(whole) // 30)),
        *range(len(whole) - 20, len(whole)),
    ]:
        path.write_bytes(whole[:size])
        try:
            actual = frames_of(path)
        except BagError as error:
            assert str(error).startswith(str(path))
            continue
        read += 1
        # The last frame of a text may have lost bytes, which its length says.
        assert [each[0] for each in actual[:-1]] == [
            each[0] for each in complete[: len(actual) - 1]
        ]
        assert [each[2] for each in actual[:-1]] == [
            each[2] for each in complete[: len(actual) - 1]
        ]
        last, truth = actual[-1][2], complete[len(actual) - 1][2]
        if last.key & 0xFF == truth.key & 0xFF:
            assert last.payload[: last.dlc] == truth.payload[: last.dlc]
    assert read or kind.endswith(".gz")


@pytest.mark.parametrize("kind", [".log", ".asc", ".blf", ".log.gz"])
def test_garbage(tmp_path: Path, kind: str) -> None:
    """Random bytes, and logs with changed bytes, give an error of this package or frames."""
    rng = random.Random(7)
    suffix = kind.removesuffix(".gz").replace(".txt", ".log")
    data = write(tmp_path / f"plain{suffix}", drive(30)).read_bytes()
    whole = gzip.compress(data) if kind.endswith(".gz") else data
    path = tmp_path / f"bus{kind}"
    for k in range(60):
        damaged = bytearray(whole)
        for _ in range(rng.randrange(1, 5)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        path.write_bytes(damaged if k % 4 else rng.randbytes(300))
        try:
            assert frames_of(path)
        except BagError as error:
            assert str(path) in str(error)


def test_python_can_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without python-can, the error names the extra."""
    monkeypatch.setitem(sys.modules, "can", None)
    path = tmp_path / "bus.log"
    path.write_text(LINE)
    with pytest.raises(
        BagError, match=r"bus.log needs python-can; run `pip install linkage_vibration\[can\]`"
    ):
        frames_of(path)


def cdr(name: str, order: str = "<", key: int = HITCH) -> bytes:
    """Return a frame in CDR, with garbage between its name and its identifier."""
    head = bytes([0, order == "<", 0, 0]) + struct.pack(f"{order}iI", 3, 4)
    text = struct.pack(f"{order}I", len(name) + 1) + name.encode() + b"\0"
    padding = b"\xee" * (-len(text) % 4)
    return head + text + padding + struct.pack(f"{order}I4B", key, 0, 1, 0, 8) + bytes(range(8))


def test_frames_of_other_publishers() -> None:
    """Frames with any name, in both orders of bytes, are decoded; other bytes are counted."""
    good = [cdr(name, order) for name in ("", "can", "can0", "längerer Name") for order in "<>"]
    bad = [b"", b"\0", good[0][:-1], b"\1" + good[0][1:], good[0][:12] + b"\xff" * 28, bytes(40)]
    messages = [*good, *bad, *good, *bad]
    sizes = np.array([len(message) for message in messages])
    zeros = np.zeros(len(messages), np.int64)
    buffer = np.frombuffer(b"".join(messages), np.uint8)
    block = Block(buffer, np.cumsum(sizes) - sizes, sizes, zeros, zeros, zeros)
    left_out = SkippedMessages()
    frames = decoded(block, left_out)
    n = len(good)
    zeroed = {n + 5, 2 * n + 11}  # 40 bytes of zeros are a frame without a name
    assert frames.keys() - zeroed == {*range(n), *range(n + 6, 2 * n + 6)}
    assert left_out.unreadable == len(messages) - len(frames)
    layouts = Layouts("can_msgs/msg/Frame", frame_places)
    for message in bad[:5]:
        with pytest.raises(CdrError):
            layouts.find(message)
    for row in range(n):
        assert frames[row][:2] == (3, 4)
        assert frames[row].key == EXTENDED | HITCH
        assert frames[row].payload == bytes(range(8))
    names = [frames[row].frame_id for row in range(0, n, 2)]
    assert names == ["", "can", "can0", "längerer Name"]


def test_frames_of_ros2_isobus() -> None:
    """Frames whose identifier is in parts are those of the identifier; 0.125 rpm is one step.

    A group in the other data page, and one that is sent to a destination, are others.
    """
    groups = [61444, 61444, 1 << 16 | 61444, 65093, 61444 & 0xFF00]
    raw = [14400, 0xFF00, 8000, 8000, 8000]
    messages = [
        struct.pack(
            "<4xBBxxIBBB3xHxxx",
            3,
            group >> 16,
            group & 0xFFFF,
            7,
            group >> 8 & 0xFF,
            group & 0xFF,
            n,
        )
        for group, n in zip(groups, raw, strict=True)
    ]
    assert {len(message) for message in messages} == {4 + 19}
    messages = [bytes([0, 1]) + message[2:] for message in messages]
    sizes = np.array([len(message) for message in messages])
    zeros = np.zeros(len(messages), np.int64)
    buffer = np.frombuffer(b"".join(messages), np.uint8)
    block = Block(buffer, np.cumsum(sizes) - sizes, sizes, zeros, zeros, zeros)
    left_out = SkippedMessages()
    reader = CanReader(find_signal("engine_speed@7", ""), ISOBUS_FRAME)
    [numbers] = reader.read(block, np.arange(len(messages)), left_out)
    assert numbers.rows.tolist() == [0, 1]
    np.testing.assert_array_equal(numbers.value, [1800.0, np.nan])
    assert left_out.others == 3
    assert "parameter group 65093" in left_out.names
    alone = [reader.read_one(message) for message in messages]
    assert [each and each.value for each in alone[:1] + alone[2:]] == [1800.0, None, None, None]
    assert alone[1] is not None
    assert np.isnan(alone[1].value)
    assert reader.note == "engine_speed is not available (0xFF00)."
    assert CanReader(find_signal("engine_speed@8", ""), ISOBUS_FRAME).read_one(messages[0]) is None
