# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Write an HTML page that shows a log, or an overview of several logs with a page for each."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from linkage_vibration.support.exit_codes import add_strict, exit_code


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = "MCAP files, folders of bags, or folders of MCAP files"
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG", help=text)
    text = "HTML file to write (default: LOG with .html; of several logs overview.html)"
    parser.add_argument("-o", "--output", type=Path, help=text)
    parser.add_argument("--png", type=Path, help="also write a picture of one log to this file")
    parser.add_argument("--csv", type=Path, help="also write all predictions of one log")
    add_strict(parser, "a prediction is missing, out of range or invalid")


def run(options: argparse.Namespace) -> int:
    """Write the page and what else was asked for; return the exit code."""
    from tqdm import tqdm

    from linkage_vibration.review.log import ReviewError
    from linkage_vibration.review.overview import logs_of
    from linkage_vibration.support.atomic_files import check_outputs, check_suffix

    logs, extra = logs_of(options.logs), [path for path in (options.csv, options.png) if path]
    several = len(logs) > 1 or logs != options.logs
    if several and extra:
        raise ReviewError("--csv and --png take one log; give one, or leave them out.")
    single = Path("overview.html") if several else logs[0].with_suffix(".html")
    output = options.output or single
    pages = _pages(logs, output) if several else []
    check_outputs([output, *extra, *pages], logs)
    for path, suffix in ((output, ".html"), (options.csv, ".csv"), (options.png, ".png")):
        if path is not None:
            check_suffix(path, suffix)
    with tqdm(disable=None, total=2 * len(logs) + len(extra), unit="step", delay=1.0) as bar:
        if several:
            problems = _write_pages(logs, pages, output, bar.update)
        else:
            problems = _write_page(logs[0], output, options, bar.update)
    written = ", ".join(map(str, [output, *extra, *pages]))
    print(f"Written: {written}")
    return exit_code(problems, options.strict)


def _pages(logs: Sequence[Path], output: Path) -> list[Path]:
    """Return the page of each log, beside the overview; logs of one name get a number."""
    pages: list[Path] = []
    for log in logs:
        name, number = log.stem, 1
        while (page := output.with_name(f"{name}.html")) in (output, *pages):
            number += 1
            name = f"{log.stem}_{number}"
        pages.append(page)
    return pages


def _write_page(
    path: Path, output: Path, options: argparse.Namespace, step: Callable[[int], object]
) -> list[str]:
    """Write the page, the table and the picture of one log; return its problems."""
    from linkage_vibration.review.html import write_page
    from linkage_vibration.review.log import problems, read_log, write_csv
    from linkage_vibration.review.picture import plot_log
    from linkage_vibration.review.review_page import review_page

    log = read_log(path)
    step(1)
    write_page(review_page(log), output)
    step(1)
    if options.csv:
        write_csv(log, options.csv)
        step(1)
    if options.png:
        plot_log(log, options.png)
        step(1)
    return problems(log)


def _write_pages(
    logs: Sequence[Path], pages: Sequence[Path], output: Path, step: Callable[[int], object]
) -> list[str]:
    """Write the overview and a page for each log that can be read; return their problems."""
    from linkage_vibration.errors import LinkageVibrationError
    from linkage_vibration.review.html import write_page
    from linkage_vibration.review.log import ReviewError, problems, read_log
    from linkage_vibration.review.overview import drive_summary, overview_html
    from linkage_vibration.review.review_page import review_page
    from linkage_vibration.support.atomic_files import write_text

    drives, failures, faults = [], [], []
    for path, page in zip(logs, pages, strict=True):
        try:
            log = read_log(path)
        except LinkageVibrationError as error:
            failures.append(str(error))
            step(2)
            continue
        step(1)
        write_page(review_page(log), page)
        step(1)
        drives.append((drive_summary(log), page.name))
        faults += [f"{path}: {text}" for text in problems(log)]
    if not drives:
        raise ReviewError(failures[0])
    write_text(output, overview_html(drives, failures), ReviewError)
    return failures + faults
