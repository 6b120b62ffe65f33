# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Print where, when and how strongly drives met resonances, as JSON for a dashboard."""

import argparse
from pathlib import Path

from linkage_vibration.support.exit_codes import add_strict, exit_code


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = "MCAP files, or folders of them"
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG", help=text)
    add_strict(parser, "a prediction is missing, out of range or invalid")


def run(options: argparse.Namespace) -> int:
    """Print a list with one object for each drive; return the exit code."""
    import json

    from tqdm import tqdm

    from linkage_vibration.review.log import problems, read_log
    from linkage_vibration.review.overview import drive_summary, logs_of

    drives, faults = [], []
    for path in tqdm(logs_of(options.logs), disable=None, unit="log", delay=1.0):
        log = read_log(path)
        drives.append(drive_summary(log))
        faults += [f"{path}: {text}" for text in problems(log)]
    print(json.dumps(drives, indent=2, allow_nan=False))
    return exit_code(faults, options.strict)
