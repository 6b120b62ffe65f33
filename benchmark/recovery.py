# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures the recovery of a large log: ``python -m benchmark.recovery [MB ...]``.

The log is the shipped drive with its predictions, repeated, in chunks as the node writes them. The
temporary folder (TMPDIR) needs three times its size. The writer of mcap takes minutes for 1 GB, and
is measured with the first size alone.
"""

import multiprocessing
import os
import re
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from benchmark.report import machine, publish, table
from linkage_vibration.bags.log_writer import CHUNK_BYTES
from linkage_vibration.bags.mcap_file import Integers, McapFile
from linkage_vibration.bags.mcap_records import MESSAGE, MESSAGE_RECORD, RECORD
from linkage_vibration.bags.recovery import recover
from linkage_vibration.playback.replay import replay
from linkage_vibration.support.resources import config_file
from test.support.drive import DURATION

MEGABYTES = 150.0
DAMAGED_EVERY, CUT = 100, 1000  # chunks, and bytes at the end
COLUMNS = ["log", "MB", "messages", "by", "saved", "lost", "s", "processor s", "peak [MiB]"]
Recover = Callable[[Path, Path], tuple[int, int]]


def main() -> None:
    """Recover logs of the given sizes, and publish times and memory."""
    rows = []
    for k, megabytes in enumerate([float(word) for word in sys.argv[1:]] or [MEGABYTES]):
        with tempfile.TemporaryDirectory() as name:
            log = Path(name) / "log.mcap"
            count, chunks = write(log, 1e6 * megabytes)
            about = [f"{log.stat().st_size / 1e6:.0f}", f"{count}"]
            rows.append(["intact", *about, "ours", *measured(by_ours, log)])
            if k == 0:
                rows.append(["intact", *about, "mcap", *measured(by_mcap, log)])
            damage(log, chunks)
            rows.append(["damaged", *about, "ours", *measured(by_ours, log)])
    publish(
        "recovery",
        "Recovery of large logs",
        [
            "This page shows how long `linkage-vibration recover` takes. Each log is the shipped "
            "drive with its predictions and resonances, repeated, in chunks of "
            f"{CHUNK_BYTES // 1024} KiB that zstd compressed. The damaged log has a wrong byte in "
            f"one of {DAMAGED_EVERY} chunks, and lacks its last {CUT} bytes. For comparison, the "
            "reader and the writer of mcap copy the messages of the intact log one by one. Other "
            "programs ran beside, which the time of the processor shows less. The peak "
            "is the resident memory of the process, including Python and NumPy.",
            table(COLUMNS, rows),
        ],
        machine("mcap", "zstandard"),
    )


def write(path: Path, size: float) -> tuple[int, list[int]]:
    """Write a log; return its number of messages and the offsets of its chunks.

    Parameters
    ----------
    path : Path
        The file to create.
    size : float
        Its least size, bytes.
    """
    with tempfile.TemporaryDirectory() as name:
        once = Path(name) / "once.mcap"
        replay(config_file("drives/hitch_duty_cycle.mcap"), once)
        with once.open("rb") as file:
            summary = make_reader(file).get_summary()
        pieces = list(contents(once))
    assert summary is not None
    shift, offsets = 0, []
    with path.open("wb") as stream:
        log = McapFile(stream, "ros2")
        for schema in summary.schemas.values():
            log.define(schema)
        for channel in summary.channels.values():
            log.define(channel)
        while stream.tell() < size:
            for content, begins in pieces:
                offsets.append(stream.tell())
                log.add_chunk(shifted(content, begins, shift), begins)
            shift += round(1e9 * DURATION)
        log.close()
    return log.counts.total(), offsets


def contents(log: Path) -> Iterator[tuple[bytes, Integers]]:
    """Yield the messages of a log as contents of chunks, with their positions."""
    records: list[bytes] = []
    with log.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            head = MESSAGE.pack(channel.id, message.sequence, message.log_time, message.log_time)
            size = len(head) + len(message.data)
            records.append(RECORD.pack(5, size) + head + message.data)
            if sum(map(len, records)) >= CHUNK_BYTES:
                lengths = np.array(list(map(len, records)))
                yield b"".join(records), np.cumsum(lengths) - lengths
                records = []


def shifted(content: bytes, begins: Integers, shift: int) -> bytes:
    """Return the content of a chunk with later log times."""
    array = np.frombuffer(content, np.uint8).copy()
    at = begins[:, np.newaxis] + np.arange(MESSAGE_RECORD.itemsize)
    heads = array[at].view(MESSAGE_RECORD)
    heads["log_time"] += np.uint64(shift)
    array[at] = heads.view(np.uint8)
    return array.tobytes()


def damage(log: Path, chunks: list[int]) -> None:
    """Spoil a byte of some chunks, and cut off the end."""
    with log.open("r+b") as file:
        for offset in chunks[::DAMAGED_EVERY]:
            file.seek(offset + CHUNK_BYTES // 16)
            [byte] = file.read(1)
            file.seek(-1, os.SEEK_CUR)
            file.write(struct.pack("B", byte ^ 1))
        file.truncate(log.stat().st_size - CUT)


def measured(function: Recover, log: Path) -> list[str]:
    """Return what a recovery saved and lost, its time, its speed and its peak memory."""
    output = log.with_name("whole.mcap")
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        (saved, lost), took, used, peak = pool.submit(timed, function, log, output).result()
    output.unlink()
    return [f"{saved}", f"{lost}", f"{took:.1f}", f"{used:.1f}", f"{peak:.0f}"]


def timed(
    function: Recover, log: Path, output: Path
) -> tuple[tuple[int, int], float, float, float]:
    """Return the result of a recovery, its time and that of the processor, s, and its peak, MiB."""
    begin, before = time.perf_counter(), time.process_time()
    result = function(log, output)
    took, used = time.perf_counter() - begin, time.process_time() - before
    [kibibytes] = re.findall(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())
    return result, took, used, int(kibibytes) / 1024.0


def by_ours(log: Path, output: Path) -> tuple[int, int]:
    """Return how many messages were saved and lost."""
    recovery = recover(log, output)
    return sum(recovery.saved.values()), sum(recovery.lost.values())


def by_mcap(log: Path, output: Path) -> tuple[int, int]:
    """Copy a log message by message; return how many messages were copied, and 0."""
    count, ids = 0, {}
    with log.open("rb") as file, output.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        for record in StreamReader(file, validate_crcs=True).records:
            if isinstance(record, Schema):
                writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.id not in ids:
                arguments = record.topic, record.message_encoding, record.schema_id
                ids[record.id] = writer.register_channel(*arguments, record.metadata)
            elif isinstance(record, Message):
                times = record.log_time, record.data, record.publish_time, record.sequence
                writer.add_message(ids[record.channel_id], *times)
                count += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return count, 0


if __name__ == "__main__":
    main()
