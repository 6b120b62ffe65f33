# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the time of table builds: ``python -m benchmark.build_time --against COMMIT``.

COMMIT is any commit of the repository. Its files are put into a temporary folder.
"""

import argparse
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmark.report import machine, publish, table

LINKAGES = (
    "three_point_linkage",
    "three_point_linkage_as_printed",
    "four_bar",
    "three_point_linkage_on_tractor",
)
BUILDS, ROUNDS = 3, 6
HERE = Path(__file__).parents[1]
PROGRAM = """
import json, sys, time
import linkage_vibration as lv
times = []
for name in sys.argv[2:]:
    mechanism, own = lv.read_mechanism(f"config/{name}.yaml"), []
    for _ in range(int(sys.argv[1])):
        model = lv.LinkageModel(mechanism)
        model.system
        start = time.process_time()
        lv.build_table(model)
        own.append(time.process_time() - start)
    times.append(min(own))
print(json.dumps(times))
"""


def git(*arguments: str) -> bytes:
    """Return what git prints.

    Parameters
    ----------
    *arguments : str
        Of its command line, in this repository.
    """
    return subprocess.run(["git", *arguments], cwd=HERE, check=True, capture_output=True).stdout


def build_times(tree: Path) -> list[float]:
    """Return the processor time of a build of each linkage by the code of a tree, s.

    Parameters
    ----------
    tree : Path
        A checkout. The shortest of some builds counts, on which other processes had least effect.
    """
    command = [sys.executable, "-c", PROGRAM, str(BUILDS), *LINKAGES]
    path = {"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
    run = subprocess.run(
        command, cwd=tree, env={**os.environ, **path}, check=True, capture_output=True, text=True
    )
    return [float(each) for each in json.loads(run.stdout)]


def main() -> None:
    """Build the tables by both versions in turns, and publish the times."""
    parser = argparse.ArgumentParser(prog="python -m benchmark.build_time", description=__doc__)
    parser.add_argument("--against", metavar="COMMIT", required=True, help="the other version")
    options = parser.parse_args()
    commit = git("rev-parse", "--short", options.against).decode().strip()
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(git("archive", commit))) as files:
            files.extractall(folder, filter="data")
        trees, rounds = (Path(folder), HERE), tqdm(range(ROUNDS), unit="round")
        times = np.array([[build_times(tree) for tree in trees] for _ in rounds])
    best = times.min(axis=0)
    spread = np.percentile(times[:, 1] / times[:, 0], [25.0, 75.0], axis=0)
    rows = [
        [
            name,
            f"{1e3 * old:.0f}",
            f"{1e3 * new:.0f}",
            f"{new / old:.2f}",
            f"{low:.2f} to {high:.2f}",
        ]
        for name, old, new, low, high in zip(LINKAGES, *best, *spread, strict=True)
    ]
    columns = ["linkage", f"commit {commit}, ms", "now, ms", "ratio", "ratio of each round"]
    publish(
        "build_time",
        "Time to build the shipped tables",
        [
            f"The shortest processor time of {ROUNDS * BUILDS} builds by commit {commit} and by "
            f"this version, in {ROUNDS} turns of {BUILDS} each; the last column has the quartiles.",
            table(columns, rows),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
