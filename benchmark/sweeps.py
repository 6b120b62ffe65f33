# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Times a sweep of 200 variants with one worker and with two: ``python -m benchmark.sweeps``."""

import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from distributed import Client

import linkage_vibration as lv
from benchmark.report import machine, publish, table
from linkage_vibration.support.resources import config_file

MASSES = np.linspace(300.0, 2000.0, 20).tolist()  # kg
HOLES = np.linspace(0.30, 0.39, 10).tolist()  # m along the lower link
VALUES = {"rigid_bodies.implement.mass": MASSES, "links.lower_link.points.V1": HOLES}
ANGLES = np.radians([100.0, 120.0, 140.0])
ROUNDS = 3


def _dask(workers: int) -> AbstractContextManager[Any]:
    cluster: AbstractContextManager[Any] = Client(  # type: ignore[no-untyped-call]
        n_workers=workers, threads_per_worker=1, dashboard_address=None
    )
    return cluster


POOLS: dict[str, Callable[[int], AbstractContextManager[Any]]] = {
    "a process pool": ProcessPoolExecutor,
    "a Dask cluster": _dask,
}


def main() -> None:
    """Sweep in turn with one worker and with two, and publish the times."""
    mechanism = lv.read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    rows = []
    for name, make in POOLS.items():
        times = {workers: list[float]() for workers in (1, 2)}
        with make(1) as one, make(2) as two:
            for _ in range(1 + ROUNDS):  # the first imports
                for workers, pool in ((1, one), (2, two)):
                    start = time.perf_counter()
                    data = lv.sweep(mechanism, VALUES, ANGLES, map=pool.map)
                    times[workers].append(time.perf_counter() - start)
        assert not data.problem.values.any()
        single, double = (np.array(times[workers][1:]) for workers in (1, 2))
        ratio = double / single
        cells = [
            f"{np.median(each):.1f} ({each.min():.1f} to {each.max():.1f})"
            for each in (single, double)
        ]
        spread = f"{np.median(ratio):.2f} ({ratio.min():.2f} to {ratio.max():.2f})"
        rows.append([name, *cells, spread])
    publish(
        "sweeps",
        "A sweep on two workers",
        [
            f"This page shows the time by the clock in which {len(MASSES) * len(HOLES)} variants "
            f"of the shipped tractor were solved at {len(ANGLES)} angles, as the median with the "
            f"lowest and the highest of {ROUNDS} turns.",
            table(["map of", "one worker, s", "two workers, s", "two over one"], rows),
        ],
        machine("xarray", "distributed"),
    )


if __name__ == "__main__":
    main()
