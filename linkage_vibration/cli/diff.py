# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Show how two logs of the same drive differ."""

import argparse
from pathlib import Path

from linkage_vibration.support.exit_codes import add_strict, exit_code


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("logs", nargs=2, type=Path, metavar="LOG", help="MCAP files, A and B")
    text = "HTML file to write (default: %(default)s)"
    parser.add_argument("-o", "--output", type=Path, default=Path("diff.html"), help=text)
    add_strict(parser, "the predictions or their stamps differ")


def run(options: argparse.Namespace) -> int:
    """Print a summary and write the page; return the exit code."""
    from linkage_vibration.review.difference import (
        compare,
        difference_page,
        difference_summary,
        problems,
    )
    from linkage_vibration.review.html import write_page
    from linkage_vibration.support.atomic_files import check_output

    check_output(options.output, ".html", options.logs)
    difference = compare(*options.logs)
    write_page(difference_page(difference), options.output)
    print(difference_summary(difference))
    print(f"\nWritten: {options.output}")
    return exit_code(problems(difference) if options.strict else [], options.strict)
