# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures the memory of a replay of long bags: ``python -m benchmark.long_bag [GB]``.

The bags are like those of ``ros2 bag record``: MCAP in chunks of 768 KiB without compression. One
has a laser scanner in addition to the joints, the other has not. Each is compared with a bag of a
tenth of its size. The temporary folder (TMPDIR) needs twice the size of the largest bag.
"""

import multiprocessing
import re
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore
from tqdm import tqdm

from benchmark.paper_linkage import PARAMETERS
from benchmark.replay import NAMES, RATE, START
from benchmark.report import machine, publish, table
from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.playback.replay import replay

GIGABYTES = 10.0
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
CLOUD_EVERY, CLOUD_BYTES = 100, 16 * 1800 * 22  # joint states; 16 lines of 1800 points of 22 bytes
SPEED_EVERY = 10  # joint states
COLUMNS = ["bag", "GB", "joint states", "hours", "s", "states/s", "times real time", "peak [MiB]"]
KINDS = {True: "joints, engine speed, laser scanner", False: "joints, engine speed"}


def main() -> None:
    """Replay a long and a short bag of each kind, and publish the speed and the memory."""
    longest = float(sys.argv[1]) if len(sys.argv) > 1 else GIGABYTES
    rows, ratios = [], []
    for scanner, kind in KINDS.items():
        peaks = []
        for gigabytes in (longest / 10.0, longest):
            with tempfile.TemporaryDirectory() as name:
                bag = Path(name) / "bag.mcap"
                write(bag, gigabytes * 1e9, scanner=scanner)
                # The replay runs in its own process, so that no other memory is counted.
                spawn = multiprocessing.get_context("spawn")
                with ProcessPoolExecutor(1, spawn) as pool:
                    done = pool.submit(replayed, bag, Path(name) / "out.mcap")
                    took, states, peak = done.result()
                size = f"{bag.stat().st_size / 1e9:.2f}"
            rate = states / took
            speed = [f"{took:.1f}", f"{rate:,.0f}", f"{rate / RATE:,.0f}"]
            hours = f"{states / RATE / 3600:.2f}"
            rows.append([kind, size, f"{states}", hours, *speed, f"{peak:.0f}"])
            peaks.append(peak)
        ratios.append(f"{kind}: {peaks[1] / peaks[0]:.2f}")
    publish(
        "long_bag",
        "Replay of long bags",
        [
            "This page shows how fast long bags are replayed and how much memory that takes. The "
            f"bags hold three joints with velocities at {RATE} Hz, an engine speed at "
            f"{RATE // SPEED_EVERY} Hz and, if the row says laser scanner, "
            f"{CLOUD_BYTES / 1e3:.0f} kB of points at {RATE // CLOUD_EVERY} Hz, as MCAP without "
            "compression. The replay writes joints, speeds, predictions and resonances, as MCAP "
            "with zstd. The peak is the resident memory of the process that replays, including "
            "Python and NumPy.",
            table(COLUMNS, rows),
            "Ratio of the peak memory with the long bag to that with a tenth of it: "
            f"{'; '.join(ratios)}.",
        ],
        machine("mcap", "rosbags", "zstandard"),
    )


def replayed(bag: Path, output: Path) -> tuple[float, int, float]:
    """Replay a bag; return the time (s), the number of predictions and the peak memory (MiB)."""
    begin = time.perf_counter()
    done = replay([bag], output, PARAMETERS)
    took = time.perf_counter() - begin
    [kibibytes] = re.findall(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())
    return took, done.predictions, int(kibibytes) / 1024.0


def write(path: Path, size: float, *, scanner: bool) -> None:
    """Write a bag of about ``size`` bytes."""
    store = get_typestore(Stores.LATEST)
    with path.open("wb") as file, tqdm(desc="write", total=size, unit="B", unit_scale=True) as bar:
        writer = Writer(file, chunk_size=768 * 1024, compression=CompressionType.NONE)
        writer.start("ros2", "benchmark")
        channels = []
        for topic, kind in (
            ("/joint_states", JOINT_STATE),
            ("/engine_speed", FLOAT64),
            ("/points", POINT_CLOUD),
        ):
            text = store.generate_msgdef(kind, ros_version=2)[0].encode()
            schema = writer.register_schema(kind, "ros2msg", text)
            about = {"offered_qos_profiles": ""}
            channels.append(writer.register_channel(topic, "cdr", schema, about))
        joints, engine, points = channels
        speed, cloud = store.types[FLOAT64], point_cloud()
        first = 0
        while file.tell() < size:
            for k, state in enumerate(joint_states(first), first):
                now = START + k * 10**9 // RATE
                if k % SPEED_EVERY == 0:
                    rpm = speed(1600.0 + 500.0 * np.sin(1e-4 * k))
                    writer.add_message(engine, now, bytes(store.serialize_cdr(rpm, FLOAT64)), now)
                if scanner and k % CLOUD_EVERY == 0:
                    writer.add_message(points, now, cloud, now)
                writer.add_message(joints, now, state, now)
            first += RATE
            bar.update(file.tell() - bar.n)
        writer.finish()  # type: ignore[no-untyped-call]


def joint_states(first: int) -> Sequence[bytes]:
    """Return the joint states of one second, from number ``first`` on."""
    store = get_typestore(Stores.LATEST)
    state, header, stamp = (
        store.types[name]
        for name in (JOINT_STATE, "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    zero = header(stamp=stamp(sec=0, nanosec=0), frame_id="base_link")
    message = state(
        header=zero, name=NAMES, position=np.zeros(3), velocity=np.zeros(3), effort=np.zeros(0)
    )
    example = np.frombuffer(store.serialize_cdr(message, JOINT_STATE), np.uint8)
    k = first + np.arange(RATE)
    noise = np.random.default_rng(first).normal(scale=1e-4, size=RATE)
    angle = 2.3 + 0.6 * np.sin(0.5 * k / RATE) + noise
    rows = np.tile(example, (RATE, 1))
    sec, nanosec = np.divmod(START + k * 10**9 // RATE, 10**9)
    rows[:, 4:12] = np.column_stack([sec, nanosec]).astype("<u4").view(np.uint8)
    # The count of efforts follows the velocities; their own count, with padding, precedes them.
    velocity, position = len(example) - 28, len(example) - 60
    positions = np.column_stack([0.01 * k / RATE, angle, 56.5 * k / RATE])
    rates = np.column_stack(
        [np.full(RATE, 0.01), 0.3 * np.cos(0.5 * k / RATE), np.full(RATE, 56.5)]
    )
    rows[:, position : position + 24] = positions.view(np.uint8)
    rows[:, velocity : velocity + 24] = rates.view(np.uint8)
    return [row.tobytes() for row in rows]


def point_cloud() -> bytes:
    """Return the points of one revolution of a laser scanner."""
    store = get_typestore(Stores.LATEST)
    stamp = store.types["builtin_interfaces/msg/Time"](sec=START // 10**9, nanosec=0)
    message = store.types[POINT_CLOUD](
        header=store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="laser"),
        height=16,
        width=1800,
        fields=[],
        is_bigendian=False,
        point_step=22,
        row_step=1800 * 22,
        data=np.random.default_rng(1).integers(0, 256, CLOUD_BYTES, np.uint8),
        is_dense=True,
    )
    return bytes(store.serialize_cdr(message, POINT_CLOUD))


if __name__ == "__main__":
    main()
