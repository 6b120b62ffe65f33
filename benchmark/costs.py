# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The costs of the calls that the node makes for each message: ``python -m benchmark.costs``.

The benchmark fails if a cost exceeds its limit.
"""

import sys
import tempfile
import time
import timeit
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmark.report import machine, publish, table
from linkage_vibration.bags.recorder import Provenance, Recorder
from linkage_vibration.bags.writing import Topic
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor, predict_many
from linkage_vibration.prediction.resonance import ReportedSpeed, ResonanceMonitor
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import DEFAULT_EXCITATIONS, PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table

MESSAGES = 5_000
BLOCK = 4_096  # joint states
SECOND = 10**9  # ns


def main() -> int:
    """Measure every cost, publish the table, and return 1 if a limit is exceeded."""
    predictor = Predictor(load_table(config_file(PAPER_TABLE)))
    lookup = _lowest(lambda: predictor.predict(2.3), 200)
    single, many = _resonance_costs(predictor)
    twelve, write = _twelve_excitations(predictor), _write_cost()
    level, block = _level_costs()
    costs = [
        ("prediction, one lookup of the table", lookup, None),
        ("resonance of one prediction, shipped excitations", single, None),
        ("resonance of one prediction in a block", many, single / 3.0),
        ("resonance of one prediction, 12 excitations", twelve, 8.0 * lookup),
        ("levels of ten orders with deviations, one prediction (goal: 20 us)", level, None),
        ("levels of ten orders with deviations, in a block (goal: 5 us)", block, None),
        ("recorder's write at 10 kHz, median", write, 5e-6),
    ]
    rows = [
        [name, f"{1e6 * cost:.2f}", "" if limit is None else f"{1e6 * limit:.2f}"]
        for name, cost, limit in costs
    ]
    text = (
        "This page shows how long the calls take that the node makes for each message. Times are "
        "the lowest of 20 repetitions, except where the row says median."
    )
    publish(
        "costs",
        "Costs of the node's calls",
        [text, table(["call", "us", "limit, us"], rows)],
        machine(),
    )
    return int(any(limit is not None and cost > limit for _, cost, limit in costs))


def _lowest(call: Callable[[], object], number: int) -> float:
    """Return the lowest time of a call, s."""
    return min(timeit.repeat(call, number=number, repeat=20)) / number


def _resonance_costs(predictor: Predictor) -> tuple[float, float]:
    """Return the times of a resonance alone and in a block at 1 kHz with speeds at 100 Hz, s."""
    monitor = ResonanceMonitor(read_excitations(config_file(DEFAULT_EXCITATIONS)))
    times = np.arange(BLOCK) * SECOND // 1000
    predictions = predict_many(predictor, np.linspace(1.6, 3.1, BLOCK), np.zeros(BLOCK))
    numbers = predictions, np.zeros(BLOCK), times
    speeds = [
        ReportedSpeed(i, Source.ENGINE, 1800.0 + i, int(times[i])) for i in range(0, BLOCK, 10)
    ]
    many = _lowest(lambda: monitor.assess_many(*numbers, speeds, np.zeros(BLOCK)), 1) / BLOCK
    first = predictor.predict(1.6)
    return _lowest(lambda: monitor.assess(first, 0.0, SECOND), 200), many


def _twelve_excitations(predictor: Predictor) -> float:
    """Return the time of a resonance with twelve excitations and three modes, s."""
    orders = [Excitation(f"e {o}", Source.ENGINE, o / 120.0) for o in range(1, 13)]
    monitor, prediction = ResonanceMonitor(orders), predictor.predict(2.3)
    monitor.set_speed(Source.ENGINE, 2000.0, 0)
    return _lowest(lambda: monitor.assess(prediction, 0.1, 0), 200)


def _level_costs() -> tuple[float, float]:
    """Return the times of levels of one angle and in a block, s."""
    mechanism = read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    predictor = Predictor(load_table(config_file("tables/three_point_linkage_on_tractor.npz")))
    shaft = {"speed": "engine", "orders": list(range(1, 11)), "force": [10.0] * 10}
    orders = {"shaft": {**shaft, "at": "E2.x", "at_speed": 600.0, "amplitude_stddev": 0.5}}
    levels = LevelTable(predictor, mechanism, excitations_from_mapping(orders))
    alpha3, speeds = np.linspace(1.6, 3.1, BLOCK), np.full((3, BLOCK), 600.0)
    many = _lowest(lambda: levels.at(alpha3, speeds), 1) / BLOCK
    first = alpha3[:1], speeds[:, :1]
    return _lowest(lambda: levels.at(*first), 200), many


def _write_cost() -> float:
    """Return the median time of a write while the recorder's thread compresses and writes, s."""
    topic = Topic("/a", "std_msgs/msg/Float64", "float64 data\n", "", "")
    data, times = b"\0\1\0\0" + bytes(496), []
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(Path(folder), [topic], Provenance((), {}))
        recorder.start()
        for k in range(MESSAGES):
            before = time.perf_counter()
            recorder.write([("/a", data, k, k)])
            times.append(time.perf_counter() - before)
            time.sleep(1e-4)
        recorder.stop()
    return float(np.median(times))


if __name__ == "__main__":
    sys.exit(main())
