# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Lets the n-th operation of commands fail, n = 1, 2, 3...: ``python -m benchmark.failing``.

An operation is an open, a write, an fsync, a rename or an allocation of at least 64 KiB; see
``failing.c``, which needs gcc. Calls on files count below the folder of the command.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmark.failing.runs import COMMANDS, DENSE, KINDS
from benchmark.report import machine, publish, table

COLUMNS = ["command", "operation", "runs", "passed at", "outcomes"]


def main() -> None:
    """Let operations of each command fail, and publish the outcomes."""
    rows = []
    for command in COMMANDS:
        for kind in KINDS if command != "numpy" else ("allocation",):
            result = outcomes(command, kind)
            ends = "; ".join(f"{count} {text}" for text, count in result["outcomes"].items())
            rows.append([command, kind, f"{result['runs']}", f"{result['last']}", ends])
            print(" | ".join(rows[-1]), flush=True)
    publish(
        "failing",
        "Commands with failing operations",
        [
            "This page shows what commands leave when one operation fails: in the first run the "
            "first one, in the second run the second one, and so on, until a run passes because it "
            f"has fewer operations: the column *passed at* has its number. Beyond {DENSE}, the "
            "number grows by a tenth from run to run, as a run takes seconds. The files of an "
            "output are old or new, all of them. A log that the recorder leaves can be read or "
            "recovered. One sentence stands with exit code 1, and no word with exit code 0. "
            "Allocations count from 64 KiB. Each run is a fork of a process that has imported the "
            "libraries.",
            table(COLUMNS, rows),
            "A signal 11 is a fault of NumPy, which does not check an allocation of the buffers in "
            "which it converts real numbers to complex ones: the row numpy multiplies an array of "
            "each kind, without any code of this package. The output of a command that dies in "
            "this way is the old file; a temporary folder may be left.",
        ],
        machine("mcap"),
    )


def outcomes(command: str, kind: str) -> dict[str, Any]:
    """Return how runs of a command ended, each with another operation of a kind that fails."""
    here = Path(__file__).parent
    with tempfile.TemporaryDirectory() as name:
        library = Path(name) / "failing.so"
        options = ["-shared", "-fPIC", "-O1", "-o", str(library)]
        subprocess.run(["gcc", *options, str(here / "failing.c"), "-ldl"], check=True)
        done = subprocess.run(
            [sys.executable, "-m", "benchmark.failing.runs", command, kind],
            cwd=here.parents[1],
            env={**os.environ, "LD_PRELOAD": str(library)},
            check=True,
            capture_output=True,
        )
    result: dict[str, Any] = json.loads(done.stdout)
    return result


if __name__ == "__main__":
    main()
