# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of CAN buses are read as bags with a topic for each channel."""

import gzip
import random
import struct
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from linkage_vibration.bags.blocks import Block
from linkage_vibration.bags.can_frames import (
    ERROR,
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
from linkage_vibration.bags.numbers import CdrError, LeftOut
from linkage_vibration.bags.reading import BagError
from linkage_vibration.bags.streams import open_bags
from test.support.can_bus import EPOCH, BusFrame, identifier, recorded_frames, write_candump

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


def decoded(block: Block, left_out: LeftOut) -> dict[int, Frame]:
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
            left_out = LeftOut()
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


KINDS = ["bus.log", "bus.txt", "bus.asc", "bus.blf", "bus.log.gz", "bus.asc.gz", "bus.blf.gz"]


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
    """A text of candump has data, remote, error and CAN FD frames, and frames without data."""
    path = tmp_path / "candump-2023-11-14.log"
    path.write_text(LOG)
    frames = frames_of(path)
    assert [time - EPOCH for time, *_ in frames] == [100_000 * k for k in range(1, 9)]
    extended = EXTENDED | 0x0CFE45F0
    assert [(frame.key, frame.dlc, frame.payload.hex()) for *_, frame in frames] == [
        (extended, 8, "7dffffffffffffff"),
        (0x123, 3, "1122330000000000"),
        (extended, 1, "7e00000000000000"),
        (REMOTE | extended, 0, 16 * "0"),
        (ERROR, 0, 16 * "0"),
        (extended, 12, "0102030405060708"),
        (extended, 4, "4142432700000000"),
        (extended, 0, 16 * "0"),
    ]


def test_recorded_tractor(tmp_path: Path) -> None:
    """The frames of a real tractor come out of a log as they went in."""
    frames = recorded_frames()
    actual = frames_of(write_candump(tmp_path / "tractor.log", frames))
    ordered = sorted(frames, key=lambda frame: frame.time)
    assert [(time, frame) for time, _, frame in actual] == expected(ordered)


LINE = "(1700000000.000100) can0 0CFE45F0#7D\n"
FAULTS = {
    "empty": ("", r"is empty, as its recording ended before"),
    "no frames": ("\n\n", r"has no frames"),
    "other text": (
        "[INFO] [1700000000.1] [node]: hello\n",
        r"has a line that cannot be read: line 1 is .*or record with `candump -l`",
    ),
    "one word": ("hello\n", r"cannot be read: line 1 is 'hello'"),
    "a damaged line": (
        LINE + "(1700000000.1) can0 0CFE45F0#7Z\n" + LINE,
        r"line 2 is .*7Z.*correct or",
    ),
    "too late": (LINE.replace("1700000000", "2147483648"), r"a time before 1970 or after 2038"),
    "much too late": (LINE.replace("1700000000", "9" * 20), r"a time before 1970 or after 2038"),
    "endless": (LINE.replace("1700000000.000100", "inf"), r"cannot be read: line 1 is"),
    "too early": (LINE.replace("1700000000", "-1"), r"a time before 1970 or after 2038"),
    "console": (
        " (1700000000.000100)  can0  RX - -  0CFE45F0   [1]  7D\n",
        r"cannot be read: line 1 is .*candump -l",
    ),
    "console without times": ("  can0  123   [1]  7D\n", r"cannot be read: line 1 is "),
    "one long line": ("x" * 10**6, r"cannot be read: line 1 is"),
    "a long line between others": (LINE + "x" * 10**4 + "\n" + LINE, r"cannot be read: line 2 is"),
    "clock set back": (
        LINE + LINE.replace("1700000000", "1699999998"),
        r"goes back in time by 2.000 s at frame 2.*split the log there",
    ),
    "differences": (
        "".join(f"(000.0{10 + k * 7 % 5}000) can0 123#11\n" for k in range(20)),
        r"has differences of times instead of times; record it with `candump -l`",
    ),
    "many channels": (
        "".join(LINE.replace("can0", f"can{k}") for k in range(65)),
        r"more than 64 channels",
    ),
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


def test_faults_of_asc(tmp_path: Path) -> None:
    """A damaged line is named."""
    frame, path = "   1.000000 1  0CFE45F0x       Rx   d 1 7D\n", tmp_path / "bus.asc"
    path.write_text("internal events logged\n" + frame + frame.replace("7D", "7Z"))
    with pytest.raises(BagError, match=r"bus.asc has a line .* line 3 is .*7Z.* delete this line"):
        frames_of(path)
    path.write_text(frame.replace(".", ","))
    with pytest.raises(BagError, match=r"bus.asc has no frames that can be read.*decimal commas"):
        frames_of(path)


def test_slight_disorder_is_sorted(tmp_path: Path) -> None:
    """Frames of two channels that were written a little late are read in the order of times."""
    frames = drive()
    path = write_candump(tmp_path / "bus.log", frames)
    lines = path.read_text().splitlines(keepends=True)
    random.Random(1).shuffle(lines)
    path.write_text("".join(lines))
    assert [(time, frame) for time, _, frame in frames_of(path)] == expected(frames)


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
    asc.write_text(text.replace("Nov", "Gov"))
    with pytest.raises(BagError, match=r"line 1 is 'date Tue Gov .* correct or delete this line"):
        frames_of(asc)
    asc.write_text(text.partition("\n")[2])
    assert [time for time, *_ in frames_of(asc)] == [250_000_000]
    asc.write_text(text.replace("absolute", "relative"))
    with pytest.raises(BagError, match=r"bus\.asc has times since the previous event"):
        frames_of(asc)


@pytest.mark.parametrize("kind", [".log", ".asc", ".blf", ".log.gz", ".blf.gz"])
def test_truncated_logs(tmp_path: Path, kind: str) -> None:
    """A log that was cut off has the frames before the cut, or gives an error."""
    frames = drive(60)
    path = write(tmp_path / f"bus{kind.removesuffix('.gz')}", frames)
    whole = path.read_bytes()
    if kind.endswith(".gz"):
        whole, path = gzip.compress(whole), tmp_path / f"bus{kind}"
        path.write_bytes(whole)
    complete = frames_of(path)
    read = 0
    for size in [
        *range(0, len(whole), max(1, len(whole) // 150)),
        *range(len(whole) - 60, len(whole)),
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


@pytest.mark.parametrize("kind", [".log", ".txt", ".asc", ".blf", ".log.gz", ".asc.gz", ".blf.gz"])
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
    left_out = LeftOut()
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
    left_out = LeftOut()
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
