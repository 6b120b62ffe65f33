# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures what the frames of a CAN bus cost: live in the node, and offline in a log.

`python -m benchmark.can_bus` needs ROS 2 from wheels, for which it builds messages with pip.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmark.report import machine, publish, table
from linkage_vibration.bags.can_logs import DEFINITION
from linkage_vibration.demo.domain import reserve_domain
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters, with_values
from test.support.can_bus import EPOCH, BusFrame, identifier, synthetic_hitch, write_candump
from test.support.interface_packages import built_package, environment_with
from test.support.ros_process import start_node

SECONDS = 10
CAN = {"hitch_input": "can", "engine_input": "can", "pto_input": "can", "ground_input": "can"}
SECOND = 10**9


def used_frames(seconds: int) -> list[BusFrame]:
    """Return what the inputs use: a hitch, a PTO and a speed at 10 Hz, an engine at 50 Hz."""
    times = [EPOCH + k * SECOND // 10 for k in range(10 * seconds)]
    raw = [round(125 + 120 * np.sin(k / 20)) for k in range(len(times))]
    frames = synthetic_hitch(times, raw)
    for group, rate, data in ((61444, 50, 14400), (65091, 10, 4320), (65096, 10, 2500)):
        value = data.to_bytes(2, "little")
        payload = 3 * b"\xff" + value + 3 * b"\xff" if group == 61444 else value + 6 * b"\xff"
        frames += [
            BusFrame(EPOCH + k * SECOND // rate, identifier(group, 0x47), payload)
            for k in range(rate * seconds)
        ]
    return frames


def bus(rate: int, seconds: int) -> list[BusFrame]:
    """Return the used frames and others, together at a rate in Hz."""
    used = used_frames(seconds)
    others = rate * seconds - len(used)
    return used + [
        BusFrame(EPOCH + k * seconds * SECOND // others, identifier(0xFF00 + k % 60, 3), bytes(8))
        for k in range(others)
    ]


def processor_time(pid: int) -> float:
    """Return the processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def live(folder: Path, rate: int) -> float:
    """Return the share of a processor that the node needs for a bus, 1."""
    prefix = built_package("can_msgs", {"Frame": DEFINITION.partition("=====")[0]})
    environment = environment_with({"AMENT_PREFIX_PATH": sys.prefix, **os.environ}, prefix)
    environment["ROS_DOMAIN_ID"] = str(reserve_domain())
    path = write_candump(folder / f"bus_{rate}.log", bus(rate, SECONDS))
    node = start_node(folder / "node.txt", environment, **CAN)
    node.wait_for("on /from_can_bus")
    time.sleep(2.0)
    play = [sys.executable, "-m", "linkage_vibration.cli", "play", str(path)]
    with subprocess.Popen(play, env=environment, stdout=subprocess.PIPE, text=True) as player:
        assert player.stdout is not None
        while "Playing" not in player.stdout.readline():
            pass
        before, began = processor_time(node.process.pid), time.monotonic()
        player.wait()
        share = (processor_time(node.process.pid) - before) / (time.monotonic() - began)
    node.stop()
    return share


def offline(folder: Path) -> tuple[int, float]:
    """Return the number of frames in two minutes of a busy bus, and the time of their replay, s."""
    path = write_candump(folder / "hour.log", bus(1500, 120))
    began = time.process_time()
    replay(path, folder / "out.mcap", with_values(Parameters(), CAN))
    return 180_000, time.process_time() - began


def main() -> None:
    """Measure both, and write the results."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rates = [80, 2000]
        shares = [live(folder, rate) for rate in rates]
        frames, seconds = offline(folder)
    each = (shares[-1] - shares[0]) / (rates[-1] - rates[0])
    rows = [[str(r), f"{100 * s:.1f} %"] for r, s in zip(rates, shares, strict=True)]
    parts = [
        "The node reads the hitch position, the speeds of engine and PTO, and the wheel-based "
        "speed from one topic of `can_msgs/Frame`. In each second, 80 frames contain them; the "
        "others are dismissed.",
        table(["frames in a second", "of one processor"], rows),
        f"A frame that is dismissed costs {1e6 * each:.0f} us of processor time, in the "
        "middleware, in rclpy and in the node.",
        f"The replay of two minutes of a bus with 1500 frames in a second ({frames} frames, as "
        f"text of candump) took {seconds:.1f} s of processor time, {1e6 * seconds / frames:.1f} us "
        "for each frame.",
    ]
    publish("can_bus", "Frames of a CAN bus", parts, machine())


if __name__ == "__main__":
    main()
