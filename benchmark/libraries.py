# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares our readers and writers with libraries that do the same.

This page compares the speed and the memory of our readers and writers with those of libraries. Ours
and the library's take turns in one process, so that the load of the machine affects both equally.
Times are medians of five rounds, with the lowest and the highest in brackets. Memory is the
increase of the peak of a process that calls the function once.
"""

import contextlib
import multiprocessing
import re
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader as Reader2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from benchmark.replay import write_mcap
from benchmark.report import machine, publish, table
from linkage_vibration.bags.field_reader import FieldReader
from linkage_vibration.bags.log_writer import ChunkLog, Messages
from linkage_vibration.bags.message_columns import read_columns
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.bags.recovery import recover
from linkage_vibration.bags.scalar_reader import SkippedMessages
from linkage_vibration.bags.schemas import schema_of_text
from linkage_vibration.bags.streams import open_bags
from linkage_vibration.bags.writing import Topic
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.definitions import message_definition
from linkage_vibration.messages.encoding import encode_columns
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import PREDICTION

SECONDS = 30  # of joint states at 1 kHz
ROUNDS = 5
TOPIC = "/joint_states"

Measured = Callable[[Path], int]


def _read_ours(path: Path) -> int:
    with open_bags([path]) as bags:
        return sum(len(block) for block in bags.blocks([TOPIC]))


def _read_by_rosbags(path: Path) -> int:
    with Reader2(path) as bag:
        return sum(1 for _ in bag.messages())


def _read_by_mcap(path: Path) -> int:
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())


def _decode_ours(path: Path) -> int:
    with open_bags([path]) as bags:
        schema = schema_of_text(message_definition(JOINT_STATE), JOINT_STATE)
        reader = FieldReader(schema, JOINT_STATE, "position[0]")
        return sum(
            len(numbers.rows)
            for block in bags.blocks([TOPIC])
            for numbers in reader.read(block, np.arange(len(block)), SkippedMessages())
        )


def _decode_by_rosbags(path: Path) -> int:
    store = get_typestore(Stores.LATEST)
    with Reader2(path) as bag:
        result: Iterator[Any] = (
            store.deserialize_cdr(data, JOINT_STATE) for *_, data in bag.messages()
        )
        return sum(len(message.position) > 0 for message in result)


def _decode_by_mcap(path: Path) -> int:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return sum(len(each[3].position) > 0 for each in reader.iter_decoded_messages())


def _write_ours(path: Path) -> int:
    rows, times = np.load(path), np.arange(len(np.load(path, mmap_mode="r"))) * 10**6
    output = path.with_suffix(".mcap")
    output.unlink(missing_ok=True)
    topic = Topic(TOPIC, PREDICTION, message_definition(PREDICTION), "", "")
    with ChunkLog(output, [topic], (), {}) as log:
        for k in range(0, len(rows), 4096):
            at = times[k : k + 4096]
            log.write([Messages(TOPIC, rows[k : k + 4096], at, at, at)])
    return len(rows)


def _write_by_mcap(path: Path) -> int:
    rows = np.load(path)
    with path.with_suffix(".other").open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start("ros2", "benchmark")
        channel = writer.register_channel(TOPIC, "cdr", writer.register_schema("a", "ros2msg", b""))
        for k, row in enumerate(rows):
            writer.add_message(channel, k * 10**6, row.tobytes(), k * 10**6)
        writer.finish()  # type: ignore[no-untyped-call]
    return len(rows)


def _columns_ours(path: Path) -> int:
    return len(read_columns(path, {TOPIC: PREDICTION})[TOPIC]["crank_angle"])


def _columns_by_rosbags(path: Path) -> int:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(message_definition(PREDICTION), PREDICTION))
    with Reader2(path) as bag:
        result = [vars(store.deserialize_cdr(data, PREDICTION)) for *_, data in bag.messages()]
    return len({name: np.array([row[name] for row in result]) for name in result[0]}["crank_angle"])


def _recover_ours(path: Path) -> int:
    path.with_suffix(".whole").unlink(missing_ok=True)
    return sum(recover(path, path.with_suffix(".whole")).saved.values())


def _recover_by_mcap(path: Path) -> int:
    count = 0
    with path.open("rb") as file, path.with_suffix(".copy").open("wb") as output:
        writer = Writer(output)
        writer.start()
        channel = writer.register_channel(TOPIC, "cdr", writer.register_schema("a", "ros2msg", b""))
        with contextlib.suppress(Exception):
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, Message):
                    writer.add_message(channel, record.log_time, record.data, record.publish_time)
                    count += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return count


def _turns(functions: Sequence[Measured], path: Path) -> list[list[float]]:
    took: list[list[float]] = [[] for _ in functions]
    counts = {function(path) for function in functions}
    assert len(counts) == 1, counts
    for _ in range(ROUNDS):
        for function, times in zip(functions, took, strict=True):
            begin = time.perf_counter()
            function(path)
            times.append(1e6 * (time.perf_counter() - begin) / max(counts))
    return took


def _peak(function: Measured, path: Path) -> float:
    def mebibytes(name: str) -> float:
        [result] = re.findall(rf"{name}:\s*(\d+) kB", Path("/proc/self/status").read_text())
        return int(result) / 1024.0

    Path("/proc/self/clear_refs").write_text("5")  # forget the peak
    before = mebibytes("VmRSS")
    function(path)
    return mebibytes("VmHWM") - before


def _apart(function: Callable[..., Any], *arguments: Any) -> Any:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def compared(path: Path, functions: Mapping[str, Measured]) -> str:
    """Return a table of functions that do the same with a file; the first is ours."""
    took = np.array(_apart(_turns, list(functions.values()), path))
    rows = []
    for (name, function), times in zip(functions.items(), took, strict=True):
        rows.append(
            [name]
            + [
                f"{np.median(values):.2f} ({values.min():.2f} to {values.max():.2f})"
                for values in (times, times / took[0])
            ]
            + [f"{_apart(_peak, function, path):.0f}"]
        )
    return table(["", "us each", "time, ours = 1", "peak memory [MiB]"], rows)


def recovered(folder: Path, path: Path) -> str:
    """Return a table of how many messages are recovered from a log damaged in one place."""
    content, rows = path.read_bytes(), []
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunks = summary.chunk_indexes
    half = chunks[len(chunks) // 2].chunk_start_offset + 999  # inside of its data
    for name, start, new in (
        ("none", 0, b""),
        ("one bit of a chunk in the middle", half, bytes([content[half] ^ 1])),
        ("4 KiB of zeros there", half, bytes(4096)),
        ("64 bytes of zeros at the beginning", 0, bytes(64)),
    ):
        damaged_log = folder / "damaged.mcap"
        damaged_log.write_bytes(content[:start] + new + content[start + len(new) :])
        rows.append([name, f"{_recover_ours(damaged_log)}", f"{_recover_by_mcap(damaged_log)}"])
    damaged_log.write_bytes(content[:half])
    rows.append(
        ["second half cut off", f"{_recover_ours(damaged_log)}", f"{_recover_by_mcap(damaged_log)}"]
    )
    return table(["damage", "recovered by ours", "recovered by mcap"], rows)


def _parts(folder: Path) -> Iterator[str]:
    bag = write_mcap(folder / "bag.mcap", SECONDS)
    yield f"{SECONDS * 1000:,} joint states of three joints at 1 kHz in MCAP with zstd, read:"
    yield compared(bag, {"ours": _read_ours, "rosbags": _read_by_rosbags, "mcap": _read_by_mcap})
    yield "The same, read and decoded:"
    decoders = {"ours": _decode_ours, "rosbags": _decode_by_rosbags}
    yield compared(bag, {**decoders, "mcap, mcap-ros2-support": _decode_by_mcap})
    n = 20_000
    slow = 1.0 + np.sin(0.5e-3 * np.arange(n))[:, np.newaxis] * np.arange(1, 7)
    values = {f.name: slow if f.is_sequence else slow[:, 0] for f in message_fields(PREDICTION)}
    values |= {"status": np.ones(n, np.uint8), "table_id": "0" * 64}
    stamps = np.arange(n, dtype=np.int32), np.arange(n, dtype=np.uint32)
    [(_, rows)] = encode_columns(PREDICTION, MessageColumns(**values), *stamps, "base_link")
    np.save(folder / "rows.npy", rows)
    yield f"{n:,} predictions of 6 modes, written to MCAP with zstd:"
    yield compared(folder / "rows.npy", {"ours": _write_ours, "mcap": _write_by_mcap})
    yield "The same, read into columns:"
    yield compared(folder / "rows.mcap", {"ours": _columns_ours, "rosbags": _columns_by_rosbags})
    yield "The joint states recovered from the MCAP file, undamaged:"
    yield compared(bag, {"ours": _recover_ours, "mcap": _recover_by_mcap})
    yield "The number of messages recovered from that file after damage:"
    yield recovered(folder, bag)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        results = [__doc__.split("\n", 2)[2].strip(), *_parts(Path(place))]
    libraries = ("mcap", "mcap-ros2-support", "rosbags", "zstandard")
    publish("libraries", "Our own code and libraries", results, machine(*libraries))
