# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the time of table builds with another version: ``python -m benchmark.build_time TREE``.

TREE is a checkout of the other version, which `git worktree add --detach TREE COMMIT` makes.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmark.report import machine, publish, table

LINKAGES = ("three_point_linkage", "three_point_linkage_as_printed", "four_bar")
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
    parser.add_argument("tree", type=Path, help="checkout of the other version")
    tree = parser.parse_args().tree.resolve()
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=tree,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.strip()
    times = np.array(
        [[build_times(each) for each in (tree, HERE)] for _ in tqdm(range(ROUNDS), unit="round")]
    )
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
