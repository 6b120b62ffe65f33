# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Show how two logs of the same drive differ."""

import argparse
from pathlib import Path

from linkage_vibration.support.exit_codes import add_strict, exit_code


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("logs", nargs=2, type=Path, metavar="LOG", help="MCAP files, A and B")
    add_strict(parser, "the predictions or their stamps differ")


def run(options: argparse.Namespace) -> int:
    """Print what differs; return the exit code."""
    from linkage_vibration.review.difference import compare, difference_summary, problems

    difference = compare(*options.logs)
    print(difference_summary(difference))
    return exit_code(problems(difference) if options.strict else [], options.strict)
