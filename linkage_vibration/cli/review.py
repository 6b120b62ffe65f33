# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Write an HTML page that shows a log."""

import argparse
from pathlib import Path

from linkage_vibration.support.exit_codes import add_strict, exit_code


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("log", type=Path, metavar="LOG", help="MCAP file")
    parser.add_argument(
        "-o", "--output", type=Path, help="HTML file to write (default: LOG with .html)"
    )
    parser.add_argument("--png", type=Path, help="also write a picture to this file")
    parser.add_argument("--csv", type=Path, help="also write a table of all predictions")
    add_strict(parser, "a prediction is missing, out of range or invalid")


def run(options: argparse.Namespace) -> int:
    """Write the page and what else was asked for; return the exit code."""
    from linkage_vibration.drawing.plots import plot_predictions
    from linkage_vibration.review.html import write_page
    from linkage_vibration.review.log import problems, read_log, write_csv
    from linkage_vibration.review.review_page import review_page
    from linkage_vibration.support.atomic_files import check_outputs, check_suffix, messages_beside

    output = options.output or options.log.with_suffix(".html")
    written = [output, *filter(None, [options.csv, options.png])]
    check_outputs(written, [options.log])
    for path, suffix in ((output, ".html"), (options.csv, ".csv"), (options.png, ".png")):
        if path is not None:
            check_suffix(path, suffix)
    log = read_log(options.log)
    write_page(review_page(log), output)
    if options.csv:
        write_csv(log, options.csv)
    if options.png:
        plot_predictions(options.log, options.png)
    print(f"Written: {', '.join(map(str, written))}", file=messages_beside(*written))
    return exit_code(problems(log), options.strict)
