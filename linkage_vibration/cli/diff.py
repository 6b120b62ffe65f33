# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Show how two logs of the same drive differ."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("logs", nargs=2, type=Path, metavar="LOG", help="MCAP files, A and B")
    text = "HTML file to write (default: %(default)s)"
    parser.add_argument("-o", "--output", type=Path, default=Path("diff.html"), help=text)


def run(options: argparse.Namespace) -> int:
    """Print a summary and write the page; return the exit code."""
    from linkage_vibration.review.difference import compare, difference_page, summary
    from linkage_vibration.review.html import write_page

    found = compare(*options.logs)
    print(summary(found))
    write_page(difference_page(found), options.output)
    print(f"\nWritten: {options.output}")
    return 0
