# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures how many designs a sweep builds per second: ``python -m benchmark.sweep``.

It compares numbers of workers, in local processes and with Dask, with the one BLAS thread that
`make bench` sets.
"""

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
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
    """Start a Dask cluster on this machine, with one process per worker."""
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
    """Return how many designs a whole sweep builds per second, including its files."""
    output = folder / "sweep.nc"
    started = time.perf_counter()
    sweep(designs, output, executor)
    elapsed = time.perf_counter() - started
    output.unlink()
    return designs.size / elapsed


def draw(rates: dict[tuple[str, int], list[float]]) -> None:
    """Draw the rates over the workers, and a line in proportion to one worker."""
    figure = Figure(figsize=(6.4, 4.2), dpi=150, layout="constrained")
    axes = figure.add_subplot()
    for kind, colour in ((LOCAL, COLOURS[0]), (DASK, COLOURS[1])):
        workers = [n for name, n in rates if name == kind]
        spread = [sorted(rates[kind, n]) for n in workers]
        middle = [statistics.median(values) for values in spread]
        ends = [
            [m - values[0] for m, values in zip(middle, spread, strict=True)],
            [values[-1] - m for m, values in zip(middle, spread, strict=True)],
        ]
        axes.errorbar(workers, middle, ends, marker="o", capsize=4, color=colour, label=kind)
    most = max(n for _, n in rates)
    first = statistics.median(rates[LOCAL, 1])
    axes.plot([1, most], [first, most * first], ":", color=GREY, label="in proportion")
    axes.set_xticks(sorted({n for _, n in rates}))
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("workers")
    axes.set_ylabel("designs per second")
    axes.set_title(f"Median of {REPEATS} sweeps, from the slowest to the fastest", fontsize=10)
    axes.legend(frameon=False)
    figure.savefig(PICTURE)


def main() -> None:
    """Measure all setups in turns, so that the load of the machine affects them equally."""
    shipped = read_designs(config_file("sweeps/implement.yaml"))
    designs = replace(shipped, paths=shipped.paths[:3], values=shipped.values[:3])
    counts = [2**k for k in range(16) if 2**k <= (os.cpu_count() or 1)]
    setups = [(ALONE, 1), *((LOCAL, n) for n in counts), *((DASK, n) for n in counts)]
    rates: dict[tuple[str, int], list[float]] = {setup: [] for setup in setups}
    starts: dict[str, Callable[[int], AbstractContextManager[Executor]]] = {
        ALONE: ThreadPoolExecutor,
        LOCAL: LocalPool,
        DASK: dask_cluster,
    }
    with tqdm(total=len(setups) * REPEATS, unit="sweep") as bar:
        for _ in range(REPEATS):
            for kind, workers in setups:
                with tempfile.TemporaryDirectory() as name, starts[kind](workers) as executor:
                    few = replace(designs, values=(designs.values[0][:1], *designs.values[1:]))
                    rate(few, executor, Path(name))  # this starts the workers
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
    columns = ["executor", "workers", "designs per second", "slowest to fastest"]
    columns.append("relative to one process")
    text = (
        "This page shows how many designs a sweep builds per second, depending on its workers. It "
        f"has {designs.size} designs of the paper's linkage at {len(designs.alpha3)} angles, with "
        f"tables to a tolerance of {designs.tolerance:g}. Values are medians of {REPEATS} sweeps, "
        "which include writing the files but not the start of the workers. All rows take turns, so "
        "that the load of the machine affects them equally. OPENBLAS_NUM_THREADS is "
        f"{os.environ.get('OPENBLAS_NUM_THREADS', 'not set')}."
    )
    publish(
        "sweep",
        "Throughput of a sweep by its workers",
        [text, table(columns, rows), "![](../../docs/pictures/sweep.png)"],
        machine("dask", "distributed"),
    )
    draw(rates)


if __name__ == "__main__":
    main()
