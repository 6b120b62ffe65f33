# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Save the readable messages of a log that was cut short or damaged."""

import argparse
from pathlib import Path

from linkage_vibration.support.exit_codes import INCOMPLETE, add_strict


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("log", type=Path, metavar="LOG", help="MCAP file, which is only read")
    text = "MCAP file to write (default: LOG with _recovered)"
    parser.add_argument("-o", "--output", type=Path, help=text)
    add_strict(parser, "the log was damaged or cut off")


def run(options: argparse.Namespace) -> int:
    """Recover the log and print what was lost; return the exit code."""
    from linkage_vibration.bags.recovery import recover, recovery_text
    from linkage_vibration.support.atomic_files import check_suffix

    log: Path = options.log
    output = options.output or log.with_name(f"{log.stem}_recovered.mcap")
    check_suffix(output, ".mcap")
    result = recover(log, output)
    print(recovery_text(result))
    return INCOMPLETE if options.strict and (result.damages or result.lost) else 0
