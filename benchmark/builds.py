# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares builds with those of another checkout: ``python -m benchmark.builds --against PATH``.

Each checkout builds the tables of the paper's linkage and of the tractor without `lateral`. That of
both halves of the tractor is built here alone. All are built in turn, each in a new process with
one thread of BLAS. Differences of the tables are printed.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml

from benchmark.report import machine, publish, table
from linkage_vibration.mechanics.arrays import ComplexArray
from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file
from linkage_vibration.table.table import Table, TableError, load_table
from test.support.in_plane import in_plane

HERE = Path(__file__).parent.parent
TRACTOR = "three_point_linkage_on_tractor"
GOALS = {"three_point_linkage": 1.0, TRACTOR: 0.5}
BOTH, BOTH_GOAL = "both halves", 1.8
BUILD = """
import sys, time
import linkage_vibration as lv
lv.load_table, lv.save_table  # imports are no part of a build
model = lv.LinkageModel(lv.read_mechanism(sys.argv[1]))
build, start = lv.build_table, time.process_time()
table = build(model)
print(time.process_time() - start)
lv.save_table(table, sys.argv[2])
"""


def main() -> None:
    """Build in turn, and publish times and sizes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", type=Path, required=True, help="another checkout")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    there = options.against.resolve()
    command = ["git", "-C", str(there), "log", "-1", "--format=%h of %cs"]
    other = subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for each in GOALS:
            mapping = in_plane(yaml.safe_load(config_file(f"{each}.yaml").read_text()))
            for mount in mapping.get("base", {}).get("mounts", {}).values():
                mount.pop("track", None)  # No table needs it, and older versions do not know it.
            (folder / f"{each}.yaml").write_text(yaml.safe_dump(mapping, sort_keys=False))
        tasks = {
            (each, where): (where, folder / f"{each}.yaml")
            for each in GOALS
            for where in (HERE, there)
        }
        tasks[BOTH, HERE] = HERE, config_file(DEFAULT_MECHANISM)
        files = {key: folder / f"{i}.npz" for i, key in enumerate(tasks)}
        seconds = {key: list[float]() for key in tasks}
        for _ in range(options.rounds):
            for key, task in tasks.items():
                seconds[key].append(_built(*task, files[key]))
        keys = (BOTH, HERE), (TRACTOR, HERE)
        sizes = [[files[key].stat().st_size / 1e6] for key in keys]
        for each in GOALS:
            print(each)
            try:
                _print_differences(*(load_table(files[each, where]) for where in (HERE, there)))
            except TableError as error:  # The other checkout wrote another format.
                print(f"  not compared: {error}")
    rows = [
        _row(f"{each}.yaml, s", f"commit {other}", seconds[each, HERE], seconds[each, there], goal)
        for each, goal in GOALS.items()
    ]
    times = [seconds[key] for key in keys]
    for unit, (both, alone) in (("s", times), ("MB", sizes)):
        rows += [_row(f"{BOTH}, {unit}", "without `lateral`", both, alone, BOTH_GOAL)]
    publish(
        "builds",
        "What a table costs to build",
        [
            "This page compares the processor times of builds, without `lateral`, with those of an "
            "older version, and time and size of the tractor's table of both halves with those of "
            "the vertical half alone. They "
            f"are medians of {options.rounds} turns, with the least and the largest. A goal is the "
            "largest ratio that was asked for.",
            table(["table", "compared with", "it", "the other", "ratio", "goal"], rows),
        ],
        machine(),
    )


def _row(name: str, against: str, ours: list[float], others: list[float], goal: float) -> list[str]:
    """Return a row of the page: medians, their ratio and its goal."""
    cells = [f"{np.median(x):.2f} ({min(x):.2f} to {max(x):.2f})" for x in (ours, others)]
    ratio = np.median(ours) / np.median(others)
    return [name, against, *cells, f"{ratio:.2f}", f"{goal:.1f}"]


def _built(checkout: Path, mechanism: Path, file: Path) -> float:
    """Build a table with a checkout, save it, and return the processor time, s."""
    command = [sys.executable, "-c", BUILD, str(mechanism), str(file)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=checkout, env=environment, check=True, capture_output=True)
    return float(done.stdout)


def _print_differences(here: Table, there: Table) -> None:
    """Print the largest relative differences of what two tables hold and predict."""
    angles = np.linspace(*here.alpha3_range, 1001)
    n = here.n_modes
    rows = here.evaluate(angles), there.evaluate(angles)
    parts = {
        "frequencies": [x[:, :n] for x in rows],
        "damping ratios": [x[:, n : 2 * n] for x in rows],
        "peaks": [x[:, 2 * n :] for x in rows],
        "FRFs": [np.array([_frfs(x, a) for a in angles[::50].tolist()]) for x in (here, there)],
        "static forces": [x.static_forces for x in (here, there)],
        "deviations": [x.parameter_stddev for x in (here, there)],
        "ensemble poles": [x.ensemble_poles for x in (here, there)],
        "ensemble forces": [x.ensemble_static for x in (here, there)],
    }
    for name, (ours, others) in parts.items():
        if ours is None or not ours.size:
            continue
        if ours.shape != others.shape or (np.isnan(ours) != np.isnan(others)).any():
            print(f"  {name}: of other shapes, {ours.shape} and {others.shape}")
            continue
        scale = np.abs(others).max(axis=0) if "FRFs" in name or "forces" in name else np.abs(others)
        off = np.abs(ours - others) / np.maximum(scale, np.finfo(float).tiny)
        print(f"  {name}: {np.nanmax(off):.1e}")


def _frfs(table: Table, alpha3: float) -> ComplexArray:
    """Return all FRFs of a table over its band at an angle, (n_freq, n_out, n_in)."""
    outputs = [*table.places, *table.forces]
    return table.frf(alpha3, outputs, list(table.places)).frf(np.linspace(*table.band, 401)[1:])


if __name__ == "__main__":
    main()
