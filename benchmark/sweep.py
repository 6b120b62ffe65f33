# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How many designs a second a sweep builds, against its workers, in local processes and with Dask.

Run by `python -m benchmark.sweep`, with one BLAS thread, as `make bench` sets it.
"""

import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from distributed import Client, LocalCluster
from matplotlib.figure import Figure
from tqdm import tqdm

from benchmark.report import machine, publish, table
from linkage_vibration.drawing.palette import COLOURS, GREY
from linkage_vibration.studies.sweep import Designs, read_designs, sweep
from linkage_vibration.support.process_pool import LocalPool
from linkage_vibration.support.resources import config_file

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "sweep.png"
REPEATS = 3
ALONE, LOCAL, DASK = "none: one thread of the caller", "local processes", "Dask, local cluster"


@contextmanager
def dask_cluster(workers: int) -> Iterator[Executor]:
    """Start a Dask cluster on this machine, one process a worker."""
    with (
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client.get_executor()


def rate(designs: Designs, executor: Executor, folder: Path) -> float:
    """Return how many designs a second a whole sweep builds, its files included."""
    output = folder / "sweep.nc"
    started = time.perf_counter()
    sweep(designs, output, executor)
    elapsed = time.perf_counter() - started
    output.unlink()
    return designs.size / elapsed


def draw(rates: dict[tuple[str, int], list[float]]) -> None:
    """Draw the rates over the workers, beside those in proportion to the first."""
    figure = Figure(figsize=(6.4, 4.2), dpi=150, layout="constrained")
    axes = figure.add_subplot()
    for kind, colour in ((LOCAL, COLOURS[0]), (DASK, COLOURS[1])):
        workers = [n for name, n in rates if name == kind]
        spread = [sorted(rates[kind, n]) for n in workers]
        middle = [statistics.median(some) for some in spread]
        ends = [
            [m - some[0] for m, some in zip(middle, spread, strict=True)],
            [some[-1] - m for m, some in zip(middle, spread, strict=True)],
        ]
        axes.errorbar(workers, middle, ends, marker="o", capsize=4, color=colour, label=kind)
    most = max(n for _, n in rates)
    first = statistics.median(rates[LOCAL, 1])
    axes.plot([1, most], [first, most * first], ":", color=GREY, label="in proportion")
    axes.set_xticks(sorted({n for _, n in rates}))
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("workers")
    axes.set_ylabel("designs a second")
    axes.set_title(f"Median of {REPEATS} sweeps, from the slowest to the fastest", fontsize=10)
    axes.legend(frameon=False)
    figure.savefig(PICTURE)


def main() -> None:
    """Measure in rounds, so that what else the machine does falls on all alike."""
    shipped = read_designs(config_file("sweeps/implement.yaml"))
    designs = replace(shipped, paths=shipped.paths[:3], values=shipped.values[:3])
    counts = [2**k for k in range(16) if 2**k <= (os.cpu_count() or 1)]
    setups = [(ALONE, 1), *((LOCAL, n) for n in counts), *((DASK, n) for n in counts)]
    rates: dict[tuple[str, int], list[float]] = {setup: [] for setup in setups}
    starts = {ALONE: ThreadPoolExecutor, LOCAL: LocalPool, DASK: dask_cluster}
    with tqdm(total=len(setups) * REPEATS, unit="sweep") as bar:
        for _ in range(REPEATS):
            for kind, workers in setups:
                with tempfile.TemporaryDirectory() as name, starts[kind](workers) as executor:
                    few = replace(designs, values=(designs.values[0][:1], *designs.values[1:]))
                    rate(few, executor, Path(name))  # starts the workers and warms them up
                    rates[kind, workers].append(rate(designs, executor, Path(name)))
                bar.update()
    first = statistics.median(rates[LOCAL, 1])
    rows = [
        [
            kind,
            str(workers),
            f"{statistics.median(found):.2f}",
            f"{min(found):.2f} to {max(found):.2f}",
            f"{statistics.median(found) / first:.2f}",
        ]
        for (kind, workers), found in rates.items()
    ]
    columns = ["executor", "workers", "designs a second", "slowest to fastest", "to one process"]
    told = (
        f"{designs.size} designs of the default linkage at {len(designs.alpha3)} angles, tables to "
        f"{designs.tolerance:g}; medians of {REPEATS} sweeps with workers that run already, parts "
        "and file written. Rounds over all rows, so that what else the machine does falls on all "
        f"alike. OPENBLAS_NUM_THREADS is {os.environ.get('OPENBLAS_NUM_THREADS', 'not set')}."
    )
    publish(
        "sweep",
        "Throughput of a sweep against its workers",
        [told, table(columns, rows), "![](../../docs/pictures/sweep.png)"],
        machine("dask", "distributed"),
    )
    draw(rates)


if __name__ == "__main__":
    main()
