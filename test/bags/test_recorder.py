# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder counts every message that it loses, and its caller never waits."""

import contextlib
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader

from linkage_vibration.bags import recorder as module
from linkage_vibration.bags.mcap_file import McapFile
from linkage_vibration.bags.recorder import (
    PROVENANCE_METADATA,
    RECORDING_METADATA,
    LogLimits,
    Provenance,
    Recorder,
    package_versions,
)
from linkage_vibration.bags.recovery import recover
from linkage_vibration.bags.writing import COMPRESSIONS, Attachment, DiskError, LogError, Topic
from linkage_vibration.support.resources import share_directory

FLOAT = "std_msgs/msg/Float64"
TOPICS = [Topic(name, FLOAT, "float64 data\n", "", "") for name in ("/a", "/b")]
PROVENANCE = Provenance(
    (Attachment("linkage.yaml", "application/yaml", b"name: linkage\n"),), package_versions()
)


def cdr(number: int, size: int = 12) -> bytes:
    """Return a message of this size that contains its number."""
    return b"\0\1\0\0" + number.to_bytes(8, "little") + bytes(size - 12)


def recorder(
    folder: Path, limits: LogLimits = module.UNLIMITED, compression: str = "zstd"
) -> Recorder:
    """Return a recorder of two topics."""
    return Recorder(folder, TOPICS, PROVENANCE, limits, compression)


def write(log: Recorder, numbers: range, size: int = 12) -> None:
    """Write numbered messages to the two topics in turn."""
    for k in numbers:
        log.write([(TOPICS[k % 2].name, cdr(k, size), k, k)])


def logs(folder: Path) -> list[Path]:
    """Return the logs in a folder in the order of their beginning, and then other files."""
    numbered = re.compile(r"linkage_vibration_(\d+)_\d{8}-\d{6}\.mcap")
    found = [(numbered.fullmatch(path.name), path) for path in folder.glob("*.mcap")]
    ours = sorted((int(match[1]), path) for match, path in found if match)
    return [path for _, path in ours] + sorted(path for match, path in found if not match)


def numbers(path: Path) -> list[int]:
    """Return the numbers of the messages of a complete log."""
    with path.open("rb") as file:
        return [
            int.from_bytes(message.data[4:12], "little")
            for _, _, message in make_reader(file, validate_crcs=True).iter_messages(
                log_time_order=False
            )
        ]


def metadata(path: Path, name: str) -> list[dict[str, str]]:
    """Return the metadata records of a name, and of this name with a number; none repeats."""
    with path.open("rb") as file:
        records = list(make_reader(file).iter_metadata())
    names = [record.name for record in records]
    assert len(set(names)) == len(names)
    numbered = re.compile(re.escape(name) + r"(\.\d+)?")
    return [record.metadata for record in records if numbered.fullmatch(record.name)]


def wait(condition: Callable[[], object], seconds: float = 120.0) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "the condition does not become true"
        time.sleep(0.005)


class Clock:
    """A clock that the test sets; it counts how often the recorder looks at it."""

    def __init__(self) -> None:
        self.now, self.looks = 0.0, 0

    def monotonic(self) -> float:
        """Return the time, s."""
        self.looks += 1
        return self.now

    def wait_for_looks(self, count: int = 3) -> None:
        """Wait until the recorder has looked at the clock so often."""
        end = self.looks + count
        wait(lambda: self.looks >= end)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Return the clock of the recorder."""
    clock = Clock()
    monkeypatch.setattr(
        module, "time", SimpleNamespace(monotonic=clock.monotonic, strftime=time.strftime)
    )
    return clock


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Flush, and retry after failures, ten times as often."""
    monkeypatch.setattr(module, "FLUSH_PERIOD", 0.05)
    monkeypatch.setattr(module, "RETRY_PERIOD", 0.2)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_every_message_arrives_in_order(tmp_path: Path, compression: str) -> None:
    """All messages are in the file, also with times that jump or repeat; rosbags reads it."""
    log = recorder(tmp_path, compression=compression)
    log.start()
    times = [(k * 7919) % 1000 for k in range(5000)]
    for k, at in enumerate(times):
        log.write([("/a", cdr(k), at, at + 1)])
    assert (log.active, log.recording) == (True, True)
    log.stop()
    assert (log.active, log.recording, log.error) == (False, False, None)
    assert (log.written, log.dropped) == (5000, 0)
    [path] = logs(tmp_path)
    assert path == log.path
    assert numbers(path) == list(range(5000))
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    used = {"none": ""}.get(compression, compression)
    assert {chunk.compression for chunk in summary.chunk_indexes} == {used}
    with AnyReader([path]) as reader:
        read = sorted((time, bytes(data)) for _, time, data in reader.messages())
    assert read == sorted((at, cdr(k)) for k, at in enumerate(times))


def disk_that_hangs(monkeypatch: pytest.MonkeyPatch) -> tuple[threading.Event, threading.Event]:
    """Let the disk hang until the first event; the second says that something waits for it."""
    answers, stuck = threading.Event(), threading.Event()

    def fsync(_: int) -> None:
        stuck.set()
        answers.wait()

    monkeypatch.setattr(os, "fsync", fsync)
    return answers, stuck


def test_disk_that_does_not_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing continues, and messages that do not fit are counted in the file."""
    monkeypatch.setattr(module, "QUEUE_MESSAGES", 1000)
    answers, stuck = disk_that_hangs(monkeypatch)
    log = recorder(tmp_path)
    log.start()
    write(log, range(10))
    assert stuck.wait(120.0)
    write(log, range(10, 5010))  # it returns although the disk does not respond
    assert log.dropped == 4000
    answers.set()
    wait(lambda: log.written == 1010)
    write(log, range(5010, 5020))
    log.stop()
    assert (log.written, log.dropped, log.error) == (1020, 4000, None)
    [path] = logs(tmp_path)
    assert numbers(path) == [*range(1010), *range(5010, 5020)]
    counts = [record["dropped"] for record in metadata(path, RECORDING_METADATA)]
    assert (counts[0], counts[-1]) == ("0", "4000")


def test_queue_is_bounded_in_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Large messages do not use unbounded memory; the manual states the limits."""
    limits = f"{module.QUEUE_MESSAGES:,} messages and {module.QUEUE_BYTES / 2**20:g} MiB"
    assert limits in (share_directory() / "docs/logs.md").read_text()
    monkeypatch.setattr(module, "QUEUE_BYTES", 10_000)
    monkeypatch.setattr(module, "POLL_PERIOD", 0.5)
    log = recorder(tmp_path)
    log.start()
    write(log, range(30), size=1000)
    log.stop()
    assert (log.written, log.dropped) == (10, 20)


def test_stop_does_not_wait_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If the disk hangs, `stop` returns, and the error says how to complete the log."""
    monkeypatch.setattr(module, "DRAIN_TIME", 0.2)
    answers, stuck = disk_that_hangs(monkeypatch)
    log = recorder(tmp_path)
    log.start()
    write(log, range(10))
    assert stuck.wait(120.0)
    log.stop()  # it returns although the disk does not respond
    assert "does not respond" in str(log.error)
    with pytest.raises(LogError, match="recorded already"):
        log.start()
    answers.set()
    wait(lambda: not log.recording)


def test_slow_disk_has_limited_time_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    """Messages that `stop` could not write in 0.3 s, at 0.05 s for two, are counted as dropped."""
    monkeypatch.setattr(module, "DRAIN_TIME", 0.3)
    monkeypatch.setattr(module, "POLL_PERIOD", 120.0)  # so that only `stop` wakes the recorder
    monkeypatch.setattr("linkage_vibration.bags.log_writer.CHUNK_BYTES", 100)
    add_chunk = McapFile.add_chunk

    def slow(file: McapFile, content: bytes, begins: NDArray[np.int64]) -> None:
        clock.now += 0.05
        add_chunk(file, content, begins)

    monkeypatch.setattr(McapFile, "add_chunk", slow)
    log = recorder(tmp_path)
    log.start()
    write(log, range(1000), size=50)
    log.stop()
    assert 2 * 6 <= log.written <= 2 * 8
    assert log.written + log.dropped == 1000
    [path] = logs(tmp_path)
    assert numbers(path) == list(range(log.written))
    assert metadata(path, RECORDING_METADATA)[-1] == {"dropped": str(log.dropped)}


def test_splits_by_size_are_complete_in_themselves(tmp_path: Path) -> None:
    """No file exceeds the limit, no message is lost, and each file has its provenance."""
    log = recorder(tmp_path, LogLimits(split_size=300_000), "none")
    log.start()
    for first in range(0, 20_000, 500):  # so few fit into the queue
        write(log, range(first, first + 500), size=100)
        wait(lambda first=first: log.written > first - 500)
    log.stop()
    assert (log.written, log.dropped, log.error) == (20_000, 0, None)
    paths = logs(tmp_path)
    assert len(paths) > 5
    assert [number for path in paths for number in numbers(path)] == list(range(20_000))
    assert all(path.stat().st_size <= 300_000 for path in paths)
    assert all(path.stat().st_size > 150_000 for path in paths[:-1])
    for path in paths:
        with path.open("rb") as file:
            reader = make_reader(file)
            assert [a.data for a in reader.iter_attachments()] == [b"name: linkage\n"]
            summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert len(summary.channels) == 2
        assert metadata(path, PROVENANCE_METADATA) == [package_versions()]
        assert len(metadata(path, "rosbag2")) == 1


def test_split_by_duration(tmp_path: Path, clock: Clock) -> None:
    """The first message after the time begins a new file; an idle recorder begins none."""

    def written() -> bool:
        clock.now += module.FLUSH_PERIOD
        return log.written == 3

    log = recorder(tmp_path, LogLimits(split_duration=1e6))
    log.start()
    write(log, range(3))
    wait(written)
    clock.now += 1e6
    clock.wait_for_looks()
    assert len(logs(tmp_path)) == 1
    write(log, range(3, 6))
    wait(lambda: len(logs(tmp_path)) == 2)
    log.stop()
    assert [numbers(path) for path in logs(tmp_path)] == [[0, 1, 2], [3, 4, 5]]


def test_disk_limit_ends_the_recording(tmp_path: Path) -> None:
    """At the limit, recording ends with an error, and nothing is deleted."""
    (tmp_path / "linkage_vibration_20200101-000000.mcap").write_bytes(bytes(100_000))
    (tmp_path / "other.mcap").write_bytes(
        bytes(10**6)
    )  # the last in order, and not one of our logs
    log = recorder(tmp_path, LogLimits(split_size=200_000, disk_limit=500_000), "none")
    log.start()
    # At once, because a recording that has ended does not count messages.
    log.write([(TOPICS[k % 2].name, cdr(k, 100), k, k) for k in range(20_000)])
    wait(lambda: not log.active)
    assert not log.recording
    assert "reached disk_limit, 500000 bytes; delete logs, set delete_oldest" in str(log.error)
    log.stop()
    assert log.written + log.dropped == 20_000
    *ours, old, _ = logs(tmp_path)
    assert 400_000 < sum(path.stat().st_size for path in [*ours, old]) <= 500_000
    assert [number for path in ours for number in numbers(path)] == list(range(log.written))
    with pytest.raises(LogError, match="reached disk_limit"):
        log.start()


@pytest.mark.usefixtures("quick")
def test_oldest_are_deleted_if_asked(tmp_path: Path) -> None:
    """The newest messages are kept within the limit, and other files are not deleted."""
    old = tmp_path / "linkage_vibration_20200101-000000.mcap"
    old.write_bytes(bytes(100_000))
    (tmp_path / "other.mcap").write_bytes(bytes(10**6))
    log = recorder(tmp_path, LogLimits(disk_limit=800_000, delete_oldest=True), "none")
    log.start()
    for k in range(0, 20_000, 1000):
        write(log, range(k, k + 1000), size=100)
        wait(lambda: log.written == k + 1000)  # noqa: B023
        ours = logs(tmp_path)[:-1]
        assert sum(path.stat().st_size for path in ours) <= 800_000
    log.stop()
    assert (log.written, log.dropped, log.error) == (20_000, 0, None)
    assert not old.exists()
    (tmp_path / "other.mcap").unlink()
    kept = [number for path in logs(tmp_path) for number in numbers(path)]
    assert 2000 < len(kept) < 10_000
    # A file has a quarter of the limit, but for the last one.
    sizes = sorted(path.stat().st_size for path in logs(tmp_path))
    assert 150_000 < sizes[1] <= sizes[-1] <= 200_000
    assert kept == list(range(20_000 - len(kept), 20_000))


def test_message_larger_than_a_log_may_be(tmp_path: Path) -> None:
    """It is dropped with an error, and the messages after it are recorded."""
    log = recorder(tmp_path, LogLimits(split_size=100_000))
    log.start()
    log.write([("/a", bytes(10**6), 1, 1)])
    write(log, range(5))
    log.stop()
    assert (log.written, log.dropped) == (5, 1)
    assert "1000000 bytes on /a" in str(log.error)


def test_topic_that_is_added_later(tmp_path: Path) -> None:
    """A topic that is added during a recording is in its file and in later ones."""
    log = recorder(tmp_path)
    log.start()
    write(log, range(4))
    log.add_topic(Topic("/c", FLOAT, "float64 data\n", "", ""))
    log.write([("/c", cdr(4), 4, 4)])
    log.change_provenance(Provenance())
    log.write([("/b", cdr(5), 5, 5)])
    log.stop()
    with pytest.raises(KeyError):
        log.start()
        log.write([("/nobody", b"", 0, 0)])
    log.stop()
    first, second, _ = logs(tmp_path)
    assert (numbers(first), numbers(second)) == ([0, 1, 2, 3, 4], [5])
    for path in (first, second):
        with AnyReader([path]) as reader:
            assert sorted(c.topic for c in reader.connections) == ["/a", "/b", "/c"]


def test_changed_provenance_begins_a_file(tmp_path: Path) -> None:
    """Messages are in the file with their provenance."""
    log = recorder(tmp_path)
    log.start()
    write(log, range(100))
    log.change_provenance(Provenance((Attachment("other.yaml", "", b"x"),), {"load": "1200 kg"}))
    write(log, range(100, 200))
    log.stop()
    assert [numbers(path) for path in logs(tmp_path)] == [[*range(100)], [*range(100, 200)]]
    names = []
    for path in logs(tmp_path):
        with path.open("rb") as file:
            names.append([a.name for a in make_reader(file).iter_attachments()])
    assert names == [["linkage.yaml"], ["other.yaml"]]
    assert metadata(logs(tmp_path)[1], PROVENANCE_METADATA) == [{"load": "1200 kg"}]


def test_messages_that_belong_together_stay_together(tmp_path: Path) -> None:
    """However often another thread stops and starts a log, it has both of two messages."""
    log, ended = recorder(tmp_path), threading.Event()
    number = 0

    def write_pairs() -> None:
        nonlocal number
        while not ended.is_set():
            number += 1
            log.write([(topic.name, cdr(number), number, number) for topic in TOPICS])

    thread = threading.Thread(target=write_pairs)
    thread.start()
    for _ in range(5):
        log.start()
        later = number + 100
        wait(lambda later=later: number > later)
        log.stop()
        assert log.path is not None
        actual = numbers(log.path)
        assert actual
        assert actual[0::2] == actual[1::2]
    ended.set()
    thread.join()


def test_stops_and_starts(tmp_path: Path) -> None:
    """Each start begins a file and resets the counts; messages in between are ignored."""
    log = recorder(tmp_path)
    log.stop()
    write(log, range(5))
    for k in range(3):
        log.start()
        write(log, range(k))
        log.stop()
        log.stop()
        write(log, range(5))
        assert (log.written, log.dropped) == (k, 0)
    assert [numbers(path) for path in logs(tmp_path)] == [[], [0], [0, 1]]


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (LogLimits(split_size=1000), "split_size is 1000 bytes.*set it to [0-9]+ or more"),
        (LogLimits(disk_limit=1000), "disk_limit is 1000 bytes.*set it to [0-9]+ or more"),
        (LogLimits(disk_limit=1000, delete_oldest=True), "disk_limit is 1000.*set it to [0-9]+"),
    ],
)
def test_start_reports_errors(tmp_path: Path, limits: LogLimits, words: str) -> None:
    """`start` raises an error and leaves no file."""
    log = recorder(tmp_path, limits)
    with pytest.raises(LogError, match=words):
        log.start()
    assert (log.active, log.recording) == (False, False)
    assert not logs(tmp_path)


@pytest.mark.parametrize("delete_oldest", [False, True])
def test_least_disk_limit_that_is_stated_works(tmp_path: Path, delete_oldest: bool) -> None:
    """The value that an error states is enough to record."""
    with pytest.raises(LogError, match="disk_limit is 1000 bytes") as error:
        recorder(tmp_path, LogLimits(disk_limit=1000, delete_oldest=delete_oldest)).start()
    [least] = map(int, re.findall(r"set it to (\d+) or more", str(error.value)))
    log = recorder(tmp_path, LogLimits(disk_limit=least, delete_oldest=delete_oldest), "none")
    log.start()
    write(log, range(10))
    log.stop()
    assert (log.written, log.dropped, log.error) == (10, 0, None)
    [path] = logs(tmp_path)
    assert numbers(path) == list(range(10))
    assert path.stat().st_size <= least


def test_least_disk_limit_beside_other_logs(tmp_path: Path) -> None:
    """Where logs take up the room, the stated value is enough beside them, and no byte less."""
    (tmp_path / "linkage_vibration_20200101-000000.mcap").write_bytes(bytes(100_000))
    with pytest.raises(LogError, match="reached disk_limit") as error:
        recorder(tmp_path, LogLimits(disk_limit=100_000)).start()
    [least] = map(int, re.findall(r"raise it to (\d+) or more", str(error.value)))
    with pytest.raises(LogError, match=f"raise it to {least} or more"):
        recorder(tmp_path, LogLimits(disk_limit=least - 1)).start()
    log = recorder(tmp_path, LogLimits(disk_limit=least))
    log.start()
    write(log, range(10))
    log.stop()
    assert numbers(logs(tmp_path)[0]) == list(range(10))


def fill(log: Recorder, count: int, size: int = 100) -> None:
    """Record so many messages; none may be dropped."""
    log.start()
    for k in range(0, count, 500):
        write(log, range(k, k + 500), size)
        wait(lambda k=k: log.written == k + 500)
    log.stop()
    assert (log.written, log.dropped, log.error) == (count, 0, None)


OLD_NAMES = [f"linkage_vibration_20991231-00000{k}.mcap" for k in range(4)]


@pytest.mark.parametrize("days", [4, -4])
@pytest.mark.parametrize(
    "names",
    [OLD_NAMES, [f"linkage_vibration_00000{k + 1}_20991231-000000.mcap" for k in range(4)]],
    ids=["without_number", "numbered"],
)
@pytest.mark.usefixtures("quick")
def test_clock_does_not_decide_what_is_deleted(tmp_path: Path, names: list[str], days: int) -> None:
    """Logs of earlier sessions are deleted before those of this one, whatever their times are."""
    at = time.time() + 86_400 * days
    for name in names:
        (tmp_path / name).write_bytes(bytes(190_000))
        os.utime(tmp_path / name, (at, at))
    log = recorder(tmp_path, LogLimits(disk_limit=800_000, delete_oldest=True), "none")
    fill(log, 2000)
    # 2,000 messages of about 150 bytes fill two files of at most 200,000 bytes.
    left = [name for name in names if (tmp_path / name).exists()]
    assert left == names[-len(left) :] != names
    own = [path for path in logs(tmp_path) if path.name not in names]
    assert [number for path in own for number in numbers(path)] == list(range(2000))
    deleted = [str(line).split(", the oldest log, was deleted")[0] for line in log.news]
    assert deleted == [str(tmp_path / name) for name in names[: len(names) - len(left)]]
    assert log.deleted == len(deleted) > 0


@pytest.mark.usefixtures("quick")
def test_only_our_logs_are_deleted(tmp_path: Path) -> None:
    """Renamed and recovered logs, links and folders stay, and do not count."""
    (tmp_path / "elsewhere").write_bytes(bytes(10**6))
    others = [
        "linkage_vibration_000001_20260712-141503_recovered.mcap",
        "linkage_vibration_000001_20260712-141503_2.mcap",
        "linkage_vibration_00001_20260712-141503.mcap",
        "linkage_vibration_00000\u0661_20260712-141503.mcap",
        "linkage_vibration_field.mcap",
    ]
    for name in others:
        (tmp_path / name).write_bytes(bytes(10**6))
    link = tmp_path / "linkage_vibration_000001_20260712-141503.mcap"
    link.symlink_to(tmp_path / "elsewhere")
    broken = tmp_path / "linkage_vibration_20260712-141503.mcap"
    broken.symlink_to(tmp_path / "nowhere")
    (tmp_path / "linkage_vibration_20260712-141504.mcap").mkdir()
    before = set(tmp_path.iterdir())
    log = recorder(tmp_path, LogLimits(disk_limit=800_000, delete_oldest=True), "none")
    fill(log, 10_000)
    assert before < set(tmp_path.iterdir())
    assert link.is_symlink()
    assert broken.is_symlink()
    assert log.deleted > 0
    own = [path for path in logs(tmp_path) if path not in before]
    kept = [number for path in own for number in numbers(path)]
    assert kept == list(range(10_000 - len(kept), 10_000))


def test_numbers_exceed_their_width(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind 999999 comes 1000000, which is newer, and a clock before 1980 is no problem."""
    monkeypatch.setattr(time, "strftime", lambda _: "19700101-000000")
    (tmp_path / "linkage_vibration_999998_20260712-141503.mcap").write_bytes(bytes(10))
    log = recorder(tmp_path)
    for _ in range(3):
        fill(log, 500)
    names = [f"linkage_vibration_{number}_19700101-000000.mcap" for number in (999999, 10**6)]
    assert [path.name for path in logs(tmp_path)][1:3] == names
    found = module._logs(tmp_path)
    assert [number for number, *_ in found] == [999_998, 999_999, 1_000_000, 1_000_001]


@pytest.mark.usefixtures("quick")
def test_clock_that_jumps_during_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No name repeats and no message is lost, also where the clock shows one second for ever."""
    seconds = iter([1e9, 0.0, 3e9, 0.0, 0.0, 0.0, *[5e8] * 1000])
    real = time.strftime
    monkeypatch.setattr(time, "strftime", lambda form: real(form, time.gmtime(next(seconds))))
    log = recorder(tmp_path, LogLimits(split_size=50_000), "none")
    fill(log, 4000)
    paths = logs(tmp_path)
    assert len(paths) > 8
    assert [number for path in paths for number in numbers(path)] == list(range(4000))
    path = log.path
    for each in paths:
        each.unlink()
    fill(log, 500)  # in the emptied folder, at the same second
    assert logs(tmp_path)[0].name > path.name  # type: ignore[union-attr]


@pytest.mark.usefixtures("quick")
def test_two_recorders_in_one_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither deletes the file that the other records, and no name is taken twice."""
    monkeypatch.setattr(time, "strftime", lambda _: "20260712-141503")
    limits = LogLimits(disk_limit=800_000, delete_oldest=True)
    slow, quick = recorder(tmp_path, limits, "none"), recorder(tmp_path, limits, "none")
    slow.start()
    write(slow, range(10))
    fill(quick, 10_000)
    assert quick.deleted > 0
    write(slow, range(10, 20))
    slow.stop()
    assert (slow.written, slow.dropped, slow.error) == (20, 0, None)
    first, *others = logs(tmp_path)
    assert first == slow.path
    assert numbers(first) == list(range(20))
    kept = [number for path in others for number in numbers(path)]
    assert kept == list(range(10_000 - len(kept), 10_000))
    fill(quick, 10_000)  # which deletes the complete file of the other one
    assert not first.exists()


def test_name_that_another_recorder_takes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next number is used, and the file of the other one stays as it is."""
    monkeypatch.setattr(time, "strftime", lambda _: "20260712-141503")
    monkeypatch.setattr(module, "_logs", lambda _: [])  # as before the other file was there
    taken = tmp_path / "linkage_vibration_000001_20260712-141503.mcap"
    taken.write_bytes(b"of another recorder")
    log = recorder(tmp_path)
    fill(log, 500)
    assert taken.read_bytes() == b"of another recorder"
    assert log.path == tmp_path / "linkage_vibration_000002_20260712-141503.mcap"


def test_log_that_is_being_read_can_be_deleted(tmp_path: Path) -> None:
    """A reader of the oldest log keeps what it has opened, and delays nothing."""
    old = tmp_path / OLD_NAMES[0]
    old.write_bytes(bytes(700_000))
    log = recorder(tmp_path, LogLimits(disk_limit=800_000, delete_oldest=True), "none")
    with old.open("rb") as reader:
        fill(log, 500)
        assert not old.exists()
        assert len(reader.read()) == 700_000
    assert log.deleted == 1


def test_folder_with_ten_thousand_logs(tmp_path: Path) -> None:
    """Beginning a file and deleting 4,750 logs takes less than 2 s of processor time."""
    for k in range(10_000):
        (tmp_path / f"linkage_vibration_{k:06}_20260712-141503.mcap").write_bytes(bytes(100))
    limits = LogLimits(disk_limit=700_000, delete_oldest=True)
    # Of 1,000,000 bytes, 525,000 may stay, so that a file of 175,000 bytes has room.
    log = recorder(tmp_path, limits, "none")
    began = time.thread_time()
    log.start()
    assert time.thread_time() - began < 2.0
    log.stop()
    assert log.deleted == 4750
    assert logs(tmp_path)[0].name == "linkage_vibration_004750_20260712-141503.mcap"


@pytest.mark.usefixtures("quick")
def test_failing_header_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If a file fails while its head is written, it is removed, and a later one loses nothing."""
    fails = True
    add_metadata = McapFile.add_metadata

    def full(file: McapFile, name: str, data: dict[str, str]) -> None:
        if fails and name == PROVENANCE_METADATA:
            raise OSError(28, "No space left on device")
        add_metadata(file, name, data)

    monkeypatch.setattr(McapFile, "add_metadata", full)
    log = recorder(tmp_path)
    with pytest.raises(LogError, match="No space left"):
        log.start()
    assert not logs(tmp_path)
    fails = False
    log.start()
    write(log, range(5))
    fails = True
    log.change_provenance(PROVENANCE)
    write(log, range(5, 10))
    wait(lambda: log.error)
    assert len(logs(tmp_path)) == 1
    fails = False
    wait(lambda: log.recording)
    assert log.error is None
    log.stop()
    assert (log.written, log.dropped) == (10, 0)
    assert [numbers(path) for path in logs(tmp_path)] == [[*range(5)], [*range(5, 10)]]


@pytest.mark.parametrize(("split_size", "refused"), [(1_900_000, True), (2_100_000, False)])
def test_split_size_has_room_for_messages(tmp_path: Path, split_size: int, refused: bool) -> None:
    """A file may be twice as large as one without messages, here with a provenance of 1 MB."""
    attachment = Attachment("large.bin", "application/octet-stream", os.urandom(1_000_000))
    provenance = Provenance((attachment,), package_versions())
    for name in ("empty", "split"):
        (tmp_path / name).mkdir()
    empty = Recorder(tmp_path / "empty", TOPICS, provenance, module.UNLIMITED, "none")
    empty.start()
    empty.stop()
    [path] = logs(tmp_path / "empty")
    assert path.stat().st_size == pytest.approx(1_000_000, rel=0.02)
    log = Recorder(tmp_path / "split", TOPICS, provenance, LogLimits(split_size=split_size), "none")
    if refused:
        with pytest.raises(LogError, match=f"split_size is {split_size} bytes"):
            log.start()
    else:
        log.start()
        log.stop()
        assert len(logs(tmp_path / "split")) == 1


@pytest.mark.usefixtures("quick")
def test_file_that_cannot_grow(tmp_path: Path) -> None:
    """The first error is reported, and a new file begins with the number of lost messages."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    log = recorder(tmp_path, compression="none")
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, limits[1]))
        log.start()
        write(log, range(3000), size=100)
        wait(lambda: len(logs(tmp_path)) == 2)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    log.stop()
    first, second = logs(tmp_path)
    # A flush of the second file ends the error, so it is not always the last one.
    assert f"linkage-vibration recover {first}" in str(log.news[0])
    assert log.dropped > 0
    assert log.written + log.dropped == 3000
    recover(first, tmp_path / "whole.mcap")
    saved, later = numbers(tmp_path / "whole.mcap"), numbers(second)
    # Recovery saves messages of the incomplete chunk that the recorder counted as lost.
    assert saved == list(range(len(saved)))
    assert later == list(range(3000 - len(later), 3000))
    assert 3000 - log.dropped <= len(saved) + len(later) <= 3000
    assert metadata(second, RECORDING_METADATA)[0] == {"dropped": str(log.dropped)}


@pytest.mark.usefixtures("quick")
def test_full_disk(small_disk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk is reported, and recording continues when it has room again."""
    disk_usage, tries = shutil.disk_usage, []

    def counted(folder: Path) -> object:
        tries.append(folder)
        return disk_usage(folder)

    monkeypatch.setattr(shutil, "disk_usage", counted)
    filler = small_disk / "filler"
    filler.write_bytes(bytes(3 * 2**20))
    log = recorder(small_disk, compression="none")
    log.start()
    write(log, range(10_000), size=200)
    wait(lambda: log.error)
    assert "No space left on device" in str(log.error)
    assert (log.active, log.recording) == (True, False)
    first = log.path
    assert first is not None
    wait(lambda: len(tries) > 2)
    assert logs(small_disk) == [first]
    filler.unlink()
    wait(lambda: log.recording)
    write(log, range(10_000, 10_100), size=200)
    log.stop()
    assert log.written + log.dropped == 10_100
    assert 0 < log.dropped < 1000
    _, second = logs(small_disk)
    assert numbers(second)[-100:] == list(range(10_000, 10_100))
    with first.open("rb") as file, pytest.raises(Exception):  # noqa: B017, PT011
        list(StreamReader(file).records)
    saved = recover(first, small_disk / "whole.mcap").saved
    assert sum(saved.values()) + len(numbers(second)) >= log.written


@pytest.mark.usefixtures("quick")
def test_disk_that_is_full_at_the_start(small_disk: Path) -> None:
    """A start that waits begins a file when the disk has room; another one is an error."""
    filler = small_disk / "filler"
    with contextlib.suppress(OSError), filler.open("wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))
    log = recorder(small_disk)
    with pytest.raises(DiskError, match="No space left on device"):
        log.start()
    assert (log.active, log.path, len(log.news)) == (False, None, 0)
    log.start(wait=True)
    assert (log.active, log.recording, log.path) == (True, False, None)
    assert log.news.popleft() is log.error
    write(log, range(10))
    assert not logs(small_disk)
    filler.unlink()
    wait(lambda: log.recording)
    log.stop()
    assert (log.written, log.dropped, log.error, len(log.news)) == (10, 0, None, 0)
    [path] = logs(small_disk)
    assert numbers(path) == list(range(10))
    missing = recorder(small_disk / "missing")
    with pytest.raises(LogError, match="cannot be created: No such file"):
        missing.start(wait=True)


@pytest.mark.usefixtures("quick")
def test_folder_is_removed_and_comes_back(tmp_path: Path) -> None:
    """A removed log is reported; recording continues when its folder exists again."""
    folder = tmp_path / "logs"
    folder.mkdir()
    log = recorder(folder)
    log.start()
    write(log, range(100))
    wait(lambda: log.written == 100)
    shutil.rmtree(folder)
    write(log, range(100, 200))
    wait(lambda: log.error)
    assert "was removed" in str(log.error)
    assert log.active
    wait(lambda: not log.recording)
    write(log, range(200, 300))
    folder.mkdir()
    wait(lambda: log.recording)
    log.stop()
    assert log.written + log.dropped == 300
    [path] = logs(folder)
    kept = numbers(path)
    assert kept[-100:] == list(range(200, 300))


@pytest.fixture
def ordinary_folder() -> Iterator[Path]:
    """Create a folder, and run the test as an ordinary user."""
    folder = Path(tempfile.mkdtemp())
    root = os.geteuid() == 0
    if root:
        os.chown(folder, 65534, -1)
        os.seteuid(65534)
    yield folder
    if root:
        os.seteuid(0)
    folder.chmod(0o700)
    shutil.rmtree(folder)


@pytest.mark.usefixtures("quick")
def test_permission_is_taken_and_given_back(ordinary_folder: Path) -> None:
    """The current file continues; the next one waits for permission and loses nothing."""
    log = recorder(ordinary_folder)
    log.start()
    write(log, range(100))
    ordinary_folder.chmod(0o500)
    log.change_provenance(PROVENANCE)
    write(log, range(100, 200))
    wait(lambda: log.error)
    assert "Permission denied" in str(log.error)
    wait(lambda: not log.recording)
    write(log, range(200, 300))
    ordinary_folder.chmod(0o700)
    wait(lambda: log.recording)
    log.stop()
    assert (log.written, log.dropped) == (300, 0)
    assert [numbers(p) for p in logs(ordinary_folder)] == [[*range(100)], [*range(100, 300)]]


def test_killed_process_loses_a_second_at_most(tmp_path: Path) -> None:
    """After SIGKILL, all messages except those of the last second are recovered.

    One message is written for each millisecond of a clock that waits for the recorder.
    """
    script = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from linkage_vibration.bags import recorder\n"
        "from linkage_vibration.bags.writing import Topic\n"
        "from test.bags.test_recorder import Clock, cdr\n"
        "clock = recorder.time = Clock()\n"
        "clock.strftime = time.strftime\n"
        "recorder.POLL_PERIOD = 0.001\n"
        "topic = Topic('/a', 'std_msgs/msg/Float64', 'float64 data', '', '')\n"
        "log = recorder.Recorder(Path(sys.argv[1]), [topic], recorder.Provenance())\n"
        "log.start()\n"
        "for k in range(1700):\n"
        "    log.write([('/a', cdr(k), k, k)])\n"
        "    clock.now = 1e-3 * k\n"
        "    if k % 100 == 0:\n"
        "        clock.wait_for_looks(300)\n"
        "print('written', flush=True)\n"
        "sys.stdin.read()\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"written\n"
    process.send_signal(signal.SIGKILL)
    process.communicate()
    [path] = logs(tmp_path)
    recover(path, tmp_path / "whole.mcap")
    actual = numbers(tmp_path / "whole.mcap")
    assert actual == list(range(len(actual)))
    assert len(actual) >= 1700 - 1000
