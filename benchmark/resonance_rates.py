# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures what a rate of resonances misses, and costs: ``python -m benchmark.resonance_rates``.

Drives are replayed at several values of ``resonance_rate``. The largest total load ratio in each
second is compared with that of a replay in which each reading is assessed.
"""

import tempfile
import time
from pathlib import Path

import numpy as np

from benchmark.replay import RATE as READINGS
from benchmark.replay import write_mcap
from benchmark.report import machine, publish, table
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import DECLARED, Parameters
from linkage_vibration.prediction.severity import ResonanceState
from linkage_vibration.review.log import read_log
from linkage_vibration.support.resources import config_file

RATES = 20.0, 10.0, 4.0, 2.0  # Hz; five times as many readings are assessed
SECONDS = 60  # of the moving hitch
MOTIONS = {"hitch at 0.3 rad/s": 0.5, "hitch at 1.2 rad/s": 2.0}  # rad/s: of its swing of 0.6 rad
COLUMNS = ["drive", "rate [Hz]", "seconds", "load", "median", "99 %", "largest", "warns", "CPU"]


def main() -> None:
    """Replay each drive at each rate, and publish what is missed."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bags = {"shipped drive": config_file("drives/hitch_duty_cycle.mcap")}
        for drive, motion in MOTIONS.items():
            path = folder / f"{motion:g}.mcap"
            bags[drive] = write_mcap(path, SECONDS, speeds=True, motion=motion)
        for drive, bag in bags.items():
            replay([bag], folder / "first.mcap", Parameters())  # fills the caches
            true, warned, every = replayed(bag, folder / "out.mcap", 0.0)
            counted = true > 0.0
            load = f"{true.max():.2f}"
            rows.append([drive, "each", "", load, "", "", "", f"{warned:.2f} s", "1"])
            for rate in RATES:
                largest, seconds, took = replayed(bag, folder / "out.mcap", rate)
                missed = 100.0 * (1.0 - largest[counted] / true[counted])
                quantiles = np.quantile(missed, [0.5, 0.99, 1.0]).tolist()
                shares = [f"{share:.2f} %" for share in quantiles]
                warns = f"{seconds:.2f} s"
                rows.append(
                    [
                        drive,
                        f"{rate:g}",
                        f"{counted.sum()}",
                        "",
                        *shares,
                        warns,
                        f"{took / every:.2f}",
                    ]
                )
    default = DECLARED["resonance_rate"].default
    publish(
        "resonance_rates",
        "The rate of resonances",
        [
            f"This page shows why `resonance_rate` is {default:g} Hz by default: how much of the "
            "largest total load ratio in a second is missed by messages of the most severe of five "
            "readings, which are published at a rate, against a message for each reading (median, "
            "99 % and largest over all seconds with a known load). `load` is the largest of all, "
            "`warns` for how long there is a warning, and `CPU` the processor time of a whole "
            "replay, start included, over that of a message for each reading. The shipped drive "
            "has the speeds that it holds. The moving hitches are read at "
            f"{READINGS} Hz, and swing by 0.6 rad while engine, PTO and ground speed vary.",
            table(COLUMNS, rows),
        ],
        machine(),
    )


def replayed(bag: Path, output: Path, rate: float) -> tuple[FloatArray, float, float]:
    """Return the largest total load ratio of each second, warnings (s), and processor time (s)."""
    begin = time.process_time()
    replay([bag], output, Parameters(resonance_rate=rate))
    took = time.process_time() - begin
    drive = read_log(output).drive
    assert drive is not None
    second = drive.times.astype(np.int64)
    largest = np.zeros(second.max() + 1)
    np.maximum.at(largest, second, drive.severity())
    return largest, drive.time_in(drive.resonances.state == ResonanceState.WARNING), took


if __name__ == "__main__":
    main()
