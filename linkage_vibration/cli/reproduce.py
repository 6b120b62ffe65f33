# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Write the numbers and figures of the paper beside ours."""

import argparse
from pathlib import Path
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = "folder to write to (default: %(default)s)"
    parser.add_argument("-o", "--output", type=Path, default=Path("reproduction"), help=text)


def run(options: argparse.Namespace) -> int:
    """Reproduce the paper, with a progress bar for each step; return the exit code."""
    from tqdm import tqdm

    from linkage_vibration.paper.reproduction import reproduce

    bars: dict[str, Any] = {}

    def show(step: str, done: int, total: int) -> None:
        if step not in bars:
            bars[step] = tqdm(disable=None, total=total, desc=step)
        bars[step].update(done - bars[step].n)
        if done == total:
            bars[step].close()

    reproduce(options.output, show)
    print(f"Written: {options.output}")
    return 0
