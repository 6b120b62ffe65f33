# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Print where, when and how strongly drives met resonances, as JSON for a dashboard."""

import argparse
from pathlib import Path

from linkage_vibration.support.exit_codes import FAILED, INCOMPLETE, add_strict, exit_code

SCHEMA_VERSION = 1  # of the output; it rises when a field is removed or changes its meaning


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = "MCAP files, or folders of them"
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG", help=text)
    what = "warnings, loads above the limit, less than 95 %% of a drive known, or a prediction is"
    add_strict(parser, f"there are {what} missing, out of range or invalid")


def run(options: argparse.Namespace) -> int:
    """Print an object with a list of drives, and of the logs that failed; return the exit code."""
    import json

    from tqdm import tqdm

    from linkage_vibration.errors import LinkageVibrationError
    from linkage_vibration.review.findings import load_problems
    from linkage_vibration.review.log import problems, read_log
    from linkage_vibration.review.overview import drive_summary, logs_of

    drives, faults, failures = list[object](), list[str](), list[dict[str, str]]()
    for path in tqdm(logs_of(options.logs), disable=None, unit="log", delay=1.0):
        try:
            log = read_log(path)
            drives.append(drive_summary(log))
        except LinkageVibrationError as error:
            failures.append({"log": str(path), "error": str(error)})
            continue
        faults += [f"{path}: {text}" for text in problems(log) + load_problems(log)]
    if drives:
        content = {"schema_version": SCHEMA_VERSION, "drives": drives, "failures": failures}
        print(json.dumps(content, indent=2, allow_nan=False))
    code = exit_code([each["error"] for each in failures] + faults, options.strict)
    return (INCOMPLETE if drives else FAILED) if failures else code
