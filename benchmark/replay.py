# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures how fast bags are replayed: ``python -m benchmark.replay [SECONDS]``.

The bags hold joint states at 1 kHz, as a joint_state_broadcaster sends them: three joints with
velocities. One bag also holds the speeds of engine, PTO and ground at 20 Hz.
"""

import cProfile
import pstats
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from tqdm import tqdm

from benchmark.paper_linkage import PARAMETERS as PAPER
from benchmark.report import machine, publish, table
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.support.resources import DEFAULT_EXCITATIONS, config_file

RATE = 1000  # Hz
SECONDS = 600
NAMES = ["front_axle_steering_joint", "hitch_rockshaft_joint", "rear_pto_joint"]
START = 1_767_225_600 * 10**9  # ns
SPEEDS_RATE = 20  # Hz, a divisor of the rate of joint states
SPEEDS = {"/engine_speed": 1800.0, "/pto_speed": 540.0, "/ground_speed": 3.0}  # rpm, rpm, m/s
TRACTOR = Parameters()
COLUMNS = ["linkage", "bag", "joint states", "messages/s", "times real time", "CPU [us/message]"]
STAGES = {
    "_uncompressed": "reading and decompressing chunks",
    "_chunk_block": "finding messages in chunks",
    "_joined": "ordering messages by time",
    "rows": "ordering messages by time",
    "_read": "decoding joint states",
    "predict_many": "predicting",
    "encode_columns": "encoding messages",
    "_records": "laying out the log's records",
    "_resonances": "assessing resonances",
}


def main() -> None:
    """Replay each bag in several ways, each three times, and publish the best."""
    seconds = int(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plain = write_mcap(folder / "joint_states.mcap", seconds)
        speeds = write_mcap(folder / "speeds.mcap", seconds, speeds=True)
        sqlite = write_ros2(folder / "sqlite", seconds // 4)
        ros1 = write_ros1(folder / "ros1.bag", seconds // 4)
        cases = {
            ("tractor", "MCAP"): (plain, TRACTOR),
            ("tractor", "MCAP, speeds"): (speeds, TRACTOR),
            ("tractor without amplitudes", "MCAP, speeds"): (speeds, silent(folder)),
            ("tractor", "SQLite"): (sqlite, TRACTOR),
            ("tractor", "ROS 1"): (ros1, TRACTOR),
            ("paper", "MCAP"): (plain, PAPER),
            ("paper", "MCAP, speeds"): (speeds, PAPER),
        }
        for words, (bag, settings) in tqdm(cases.items()):
            took, busy, count = min(timed(bag, folder / "out.mcap", settings) for _ in range(3))
            speed = [f"{count / took:,.0f}", f"{count / took / RATE:,.0f}"]
            rows.append([*words, f"{count}", *speed, f"{1e6 * busy / count:.1f}"])
        shares = {
            ", ".join(words): profiled(bag, folder / "out.mcap", settings)
            for words, (bag, settings) in list(cases.items())[:4]
        }
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    publish(
        "replay",
        "Replay",
        [
            "This page shows how fast bags are replayed and which steps take the time. The bags "
            "hold three joints with velocities at 1 kHz; one also has the speeds of engine, PTO "
            "and ground at 20 Hz each. The tractor has the shipped excitations with their "
            "amplitudes and deviations, or their frequencies alone. The replay writes the joint "
            "states, the predictions and, if a speed is known, the resonances, as MCAP with zstd. "
            "The best of three runs is shown.",
            table(COLUMNS, rows),
            f"Peak memory of the process, which also wrote the bags: {peak:.0f} MiB.",
            "The next tables show the time of each step in the main thread, under a profiler. "
            "Another thread compresses and writes chunks at the same time.",
            *(f"{kind}:\n\n{table(['part', 'share'], rows)}" for kind, rows in shares.items()),
        ],
        machine("mcap", "rosbags", "zstandard"),
    )


def silent(folder: Path) -> Parameters:
    """Return parameters with the frequencies of the shipped excitations, but no amplitudes."""
    shipped = yaml.safe_load(config_file(DEFAULT_EXCITATIONS).read_text())
    kept = "speed", "orders", "ratio", "rolling_radius"
    orders = {
        name: {key: value for key, value in keys.items() if key in kept}
        for name, keys in shipped.items()
        if "orders" in keys
    }
    path = folder / "silent.yaml"
    path.write_text(yaml.safe_dump(orders))
    return Parameters(excitation_file=str(path))


def timed(bag: Path, output: Path, settings: Parameters) -> tuple[float, float, int]:
    """Replay a bag; return wall-clock and processor time (s) and the number of predictions."""
    begin, busy = time.perf_counter(), time.process_time()
    done = replay([bag], output, settings)
    return time.perf_counter() - begin, time.process_time() - busy, done.predictions


def profiled(bag: Path, output: Path, settings: Parameters) -> list[list[str]]:
    """Replay a bag; return the share of time of each step."""
    profile = cProfile.Profile()
    profile.runcall(replay, [bag], output, settings)
    stages: dict[str, float] = {}
    stats = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    total = max(cumulative for *_, cumulative, _ in stats.values())
    for (_, _, function), (*_, cumulative, _) in stats.items():
        if function in STAGES:
            stage = STAGES[function]
            stages[stage] = stages.get(stage, 0.0) + cumulative
    rest = total - sum(stages.values())
    named = sorted(stages.items(), key=lambda item: -item[1])
    return [[name, f"{100 * took / total:.0f} %"] for name, took in [*named, ("rest", rest)]]


def joint_states(seconds: int, motion: float = 0.5, rate: int = RATE) -> Iterator[tuple[int, Any]]:
    """Yield the times (ns) and messages of the joint states; the hitch swings at rad/s."""
    store = get_typestore(Stores.LATEST)
    state, header, stamp = (
        store.types[name]
        for name in (JOINT_STATE, "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    random = np.random.default_rng(1)
    for k in range(seconds * rate):
        now = START + k * 10**9 // rate
        angle = 2.3 + 0.6 * np.sin(motion * k / rate) + random.normal(scale=1e-4)
        yield (
            now,
            state(
                header=header(stamp=stamp(now // 10**9, now % 10**9), frame_id="base_link"),
                name=NAMES,
                position=np.array([0.01 * k / rate, angle, 56.5 * k / rate]),
                velocity=np.array([0.01, 0.6 * motion * np.cos(motion * k / rate), 56.5]),
                effort=np.array([]),
            ),
        )


def write_mcap(
    path: Path, seconds: int, *, speeds: bool = False, motion: float = 0.5, rate: int = RATE
) -> Path:
    """Write the joint states to MCAP as rosbag2 does, with chunks of 768 KiB."""
    store = get_typestore(Stores.LATEST)
    float64 = store.types["std_msgs/msg/Float64"]
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=768 * 1024)
        writer.start("ros2", "benchmark")
        channels = []
        topics = dict.fromkeys(SPEEDS, "std_msgs/msg/Float64") if speeds else {}
        for topic, kind in {"/joint_states": JOINT_STATE, **topics}.items():
            text = store.generate_msgdef(kind, ros_version=2)[0].encode()
            schema = writer.register_schema(kind, "ros2msg", text)
            channels.append(
                writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": ""})
            )
        for k, (now, message) in enumerate(joint_states(seconds, motion, rate)):
            if k * SPEEDS_RATE % rate == 0:
                for channel, speed in zip(channels[1:], SPEEDS.values(), strict=speeds):
                    value = float64(speed * (1.0 + 0.1 * np.sin(0.1 * k / rate)))
                    data = store.serialize_cdr(value, "std_msgs/msg/Float64")
                    writer.add_message(channel, now, bytes(data), now)
            data = store.serialize_cdr(message, JOINT_STATE)
            writer.add_message(channels[0], now, bytes(data), now)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def write_ros2(folder: Path, seconds: int) -> Path:
    """Write the joint states to a SQLite bag."""
    store = get_typestore(Stores.LATEST)
    with Writer2(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/joint_states", JOINT_STATE, typestore=store)
        for now, message in joint_states(seconds):
            writer.write(connection, now, store.serialize_cdr(message, JOINT_STATE))
    return folder


def write_ros1(path: Path, seconds: int) -> Path:
    """Write the joint states to a ROS 1 bag."""
    ros1 = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(path) as writer:
        connection = writer.add_connection("/joint_states", JOINT_STATE, typestore=ros1)
        for now, message in joint_states(seconds):
            stamp = ros1.types["builtin_interfaces/msg/Time"](**vars(message.header.stamp))
            header = ros1.types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="base_link")
            numbered = ros1.types[JOINT_STATE](**{**vars(message), "header": header})
            writer.write(connection, now, ros1.serialize_ros1(numbered, JOINT_STATE))
    return path


if __name__ == "__main__":
    main()
