# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares builds with those of another checkout: ``python -m benchmark.builds --against PATH``.

Both build the tables of the paper's linkage and of the tractor in turn, each in a new process with
one thread of BLAS. Printed are processor times, and the largest differences of the tables.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from linkage_vibration.mechanics.arrays import ComplexArray
from linkage_vibration.table.table import Table, TableError, load_table

HERE = Path(__file__).parent.parent
NAMES = "three_point_linkage", "three_point_linkage_on_tractor"
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
    """Build in turn, and print figures and differences."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", type=Path, required=True, help="another checkout")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    checkouts = {"this": HERE, "other": options.against.resolve()}
    with tempfile.TemporaryDirectory() as folder:
        for name in NAMES:
            seconds: dict[str, list[float]] = {key: [] for key in checkouts}
            files = {key: Path(folder) / f"{name}_{key}.npz" for key in checkouts}
            for _ in range(options.rounds):
                for key, checkout in checkouts.items():
                    seconds[key].append(_built(checkout, name, files[key]))
            for key, times in seconds.items():
                spread = f"{min(times):.2f} to {max(times):.2f}"
                print(f"{name}, {key}: {np.median(times):.2f} s of processor time ({spread})")
            print(f"  ratio {np.median(seconds['this']) / np.median(seconds['other']):.2f}")
            try:
                _print_differences(*(load_table(file) for file in files.values()))
            except TableError as error:  # The other checkout wrote another format.
                print(f"  not compared: {error}")


def _built(checkout: Path, name: str, file: Path) -> float:
    """Build a table with a checkout, save it, and return the processor time, s."""
    command = [sys.executable, "-c", BUILD, str(HERE / "config" / f"{name}.yaml"), str(file)]
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
