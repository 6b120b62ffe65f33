# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Photographs the pages of five drives, wide and on a phone: ``python -m benchmark.pages FOLDER``.

It needs a Chromium. A person looks at the pictures after each change of the page.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

import linkage_vibration as lv
from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.cli.main import main as command
from linkage_vibration.messages.topics import log_topic
from test.support.browser import Browser
from test.support.drive import HITCH_JOINT, JOINTS, START

FloatArray = NDArray[np.float64]

SECONDS, RATE = 60.0, 20.0  # s, and Hz of the readings
LIMIT = 0.25  # load ratio
SIZES = {"wide": (1400, 900, False), "phone": (390, 800, True)}


def drives() -> dict[str, tuple[FloatArray, FloatArray, FloatArray]]:
    """Return the times, s, the crank angles, deg, and the ground speeds, km/h, of each drive."""
    times = np.arange(0.0, SECONDS, 1.0 / RATE)
    angles = 163.0 + 2.0 * np.sin(0.4 * times)
    steady = np.full(len(times), 20.0)
    fast, sparse = 35.0 + 15.0 * np.sin(0.1 * times), times[::62]
    return {
        "normal": (times, angles, steady),
        # The lugs are too coarse below 14 km/h, so the ground is not known there.
        "unknown_ground": (times, angles, np.where(times < 0.57 * SECONDS, 8.0, 45.0)),
        "out_of_range": (times, angles + 180.0, steady),
        "warnings": (times, angles, fast),
        "sparse": (sparse, angles[::62], np.full(len(sparse), 45.0)),
    }


def write_bag(path: Path, times: FloatArray, angles: FloatArray, ground: FloatArray) -> None:
    """Write a bag of readings, and of speeds at their times: the engine's, no PTO, the ground's."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    header, stamp = (
        store.types[f"{name}"] for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    number, joint = store.types[FLOAT64], store.types[JOINT_STATE]
    speeds = {"engine": np.full(len(times), 1800.0), "pto": 0.0 * times, "ground": ground / 3.6}
    topics = {JOINTS: JOINT_STATE} | {f"/{name}_speed": FLOAT64 for name in speeds}
    with LogWriter(path, [log_topic(*each) for each in topics.items()]) as log:
        for k, time in enumerate(times.tolist()):
            at = START * 10**9 + round(1e9 * time)
            for name, values in speeds.items():
                data = store.serialize_cdr(number(data=float(values[k])), FLOAT64)
                log.write(f"/{name}_speed", bytes(data), at, at)
            head = header(stamp=stamp(*divmod(at, 10**9)), frame_id="")
            reading, none = np.radians(angles[k : k + 1]), np.zeros(0)
            message = joint(head, [HITCH_JOINT], reading, none, none)
            log.write(JOINTS, bytes(store.serialize_cdr(message, JOINT_STATE)), at, at)


def write_pages(folder: Path) -> list[Path]:
    """Write the page and the plot of each drive, and the overview; return the pages."""
    pages = [folder / f"{name}.html" for name in drives()]
    with tempfile.TemporaryDirectory() as name:
        logs = [Path(name) / f"{page.stem}.mcap" for page in pages]
        for page, log, drive in zip(pages, logs, drives().values(), strict=True):
            bag = log.with_suffix(".bag.mcap")
            write_bag(bag, *drive)
            lv.replay(bag, log, lv.Parameters(warning_load_ratio=LIMIT))
            plot = page.with_name(f"{page.stem}_plot.png")
            command(["review", str(log), "-o", str(page), "--png", str(plot)])
        overview = folder / "overview" / "overview.html"
        overview.parent.mkdir(exist_ok=True)
        command(["review", *map(str, logs), "-o", str(overview)])
    return [*pages, overview]


def main() -> None:
    """Write the pages, and photograph each in both sizes."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    pages = write_pages(folder)
    with Browser() as browser:
        for size, (width, height, mobile) in SIZES.items():
            browser.resize(width, height, mobile=mobile)
            for page in pages:
                browser.open(page)
                browser.settle()
                browser.screenshot(folder / f"{page.stem}_{size}.png", whole=True)
        assert not browser.problems, browser.problems


if __name__ == "__main__":
    main()
