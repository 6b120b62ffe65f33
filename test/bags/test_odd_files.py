# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Valid but unusual files give the values that an independent reader finds in them."""

import random
import sqlite3
import struct
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader
from rosbags.rosbag1 import Reader as Reader1

from linkage_vibration.bags.can_frames import frame_columns, frame_places
from linkage_vibration.bags.cdr import Layouts
from linkage_vibration.bags.streams import open_bags
from test.support.odd_files import Entry, entries, odd_candump, odd_database, odd_mcap, odd_ros1

Judge = Callable[[Path], list[Entry]]


def value_of(data: bytes) -> float:
    """Return the number in a Float64 in CDR of either order of bytes."""
    [value] = struct.unpack_from("<d" if data[1] else ">d", data, 4)
    return float(value)


def by_mcap(path: Path) -> list[Entry]:
    """Return what mcap finds when it reads a file from its beginning, without the summary."""
    with path.open("rb") as file:
        messages = NonSeekingReader(file, validate_crcs=True).iter_messages()
        return [(channel.topic, m.log_time, value_of(m.data)) for _, channel, m in messages]


def by_sqlite(path: Path) -> list[Entry]:
    """Return what SQLite finds."""
    query = "SELECT name, timestamp, data FROM messages JOIN topics ON topic_id = topics.id"
    with closing(sqlite3.connect(path)) as database:
        return [(topic, time, value_of(data)) for topic, time, data in database.execute(query)]


def by_rosbags(path: Path) -> list[Entry]:
    """Return what rosbags finds in a bag of ROS 1."""
    with Reader1(path) as bag:
        return [
            (connection.topic, time, struct.unpack("<d", data)[0])
            for connection, time, data in bag.messages()
        ]


KINDS: dict[str, tuple[Callable[[Path, list[Entry], random.Random], Path], Judge]] = {
    ".mcap": (odd_mcap, by_mcap),
    ".db3": (odd_database, by_sqlite),
    ".bag": (odd_ros1, by_rosbags),
}


def check(folder: Path, suffix: str, seed: int) -> None:
    """Compare the messages of a file, their order and their counts with those of the judge."""
    rng = random.Random(seed)
    write, judge = KINDS[suffix]
    written = entries(rng)
    path = write(folder / f"{seed}{suffix}", written, rng)
    judged = judge(path)
    assert sorted(judged) == sorted(written), seed
    topics = sorted({topic for topic, *_ in written})
    found: list[Entry] = []
    with open_bags([path]) as bags:
        counts = {topic.name: topic.count for topic in bags.topics}
        types = {topic.type for topic in bags.topics}
        for block in bags.blocks(topics):
            for row in range(len(block)):
                topic, time = topics[block.topics[row]], int(block.log_times[row])
                found.append((topic, time, value_of(block.message(row))))
    assert sorted(found) == sorted(judged), seed
    assert [time for _, time, _ in found] == sorted(time for _, time, _ in judged), seed
    assert counts == Counter(topic for topic, *_ in judged), seed
    assert types == {"std_msgs/msg/Float64"}, seed
    path.unlink()


def check_candump(folder: Path, seed: int) -> None:
    """Compare the frames of a log with those that were written, and with those of python-can."""
    can = pytest.importorskip("can")
    rng = random.Random(seed)
    path = folder / f"{seed}.log"
    written = odd_candump(path, entries(rng), rng)
    with path.open(encoding="utf-8-sig") as file:
        judged = [
            (m.timestamp, m.arbitration_id, bytes(m.data)) for m in can.CanutilsLogReader(file)
        ]
    layouts, found = Layouts("can_msgs/msg/Frame", frame_places), list[tuple[float, int, bytes]]()
    with open_bags([path]) as bags:
        assert (bags.bad_lines, len(bags.topics)) == (0, 1), seed
        for block in bags.blocks(["/can0"]):
            for row in range(len(block)):
                [number], [dlc], [data] = frame_of(layouts, block.message(row))
                time = round(1e-9 * int(block.log_times[row]), 6)
                found.append((time, number & 0x1FFFFFFF, data[:dlc].tobytes()))
    assert found == [(round(t, 6), *rest) for t, *rest in judged], seed
    assert [rest for _, *rest in found] == [[*rest] for _, *rest in written], seed
    path.unlink()


def check_can(folder: Path, suffix: str, seed: int) -> None:
    """Compare the frames of a log that python-can writes with those that it was given."""
    can = pytest.importorskip("can")
    rng, path = random.Random(seed), folder / f"{seed}{suffix}"
    written = list[tuple[float, int, int, bytes, str]]()
    with can.Logger(str(path)) as log:
        for k, _ in enumerate(entries(rng)):
            extended, remote = rng.random() < 0.5, suffix != ".trc" and rng.random() < 0.1
            number, channel = rng.randrange(2 ** (29 if extended else 11)), rng.randrange(3)
            data = b"" if remote else rng.randbytes(rng.randrange(9))
            dlc, time = rng.randrange(9) if remote else len(data), 1_700_000_000 + 0.01 * k
            about = {"is_extended_id": extended, "is_remote_frame": remote, "channel": channel}
            log(can.Message(time, number, dlc=dlc, data=data, **about))
            key = number | extended << 31 | remote << 30
            written.append((round(time, 3), key, dlc, data, f"/channel_{channel + 1}"))
    layouts, found = Layouts("can_msgs/msg/Frame", frame_places), []
    with open_bags([path]) as bags:
        names = [topic.name for topic in bags.topics]
        assert bags.bad_lines == 0, seed
        for block in bags.blocks(names):
            for row in range(len(block)):
                [key], [dlc], [data] = frame_of(layouts, block.message(row))
                content = data[:dlc].tobytes() if not key >> 30 & 1 else b""
                time = round(1e-9 * int(block.log_times[row]), 3)
                found.append((time, int(key), int(dlc), content, names[block.topics[row]]))
    assert found == written, seed
    path.unlink()


def frame_of(layouts, data):  # type: ignore[no-untyped-def]
    """Return key, length and data of a frame, each as an array of one."""
    import numpy as np

    return frame_columns(layouts.find(data), np.frombuffer(data, np.uint8)[np.newaxis])


SEEDS = [range(1, 2), pytest.param(range(300), marks=pytest.mark.nightly)]


@pytest.mark.parametrize("seeds", SEEDS, ids=len)
@pytest.mark.parametrize("suffix", KINDS)
def test_odd_files(tmp_path: Path, suffix: str, seeds: range) -> None:
    """Files are read as their judges read them."""
    for seed in seeds:
        check(tmp_path, suffix, seed)


@pytest.mark.parametrize("seeds", SEEDS, ids=len)
def test_odd_logs(tmp_path: Path, seeds: range) -> None:
    """Logs of candump are read as python-can reads them."""
    for seed in seeds:
        check_candump(tmp_path, seed)


@pytest.mark.parametrize("seeds", SEEDS, ids=len)
@pytest.mark.parametrize("suffix", [".asc", ".trc", ".blf"])
def test_odd_logs_of_other_programs(tmp_path: Path, suffix: str, seeds: range) -> None:
    """Logs of Vector and PEAK have the frames that were written."""
    for seed in seeds:
        check_can(tmp_path, suffix, seed)
