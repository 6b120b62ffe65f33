# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Write an HTML page that shows a log, or an overview of several logs with a page for each."""

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from linkage_vibration.support.exit_codes import INCOMPLETE, add_strict, exit_code

if TYPE_CHECKING:
    from linkage_vibration.review.log import Log


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

    from linkage_vibration.errors import LinkageVibrationError
    from linkage_vibration.review.log import ReviewError, problems
    from linkage_vibration.review.overview import drive_summary, logs_of, overview_html
    from linkage_vibration.support.atomic_files import check_outputs, check_suffix, write_text

    logs, extra = logs_of(options.logs), [path for path in (options.csv, options.png) if path]
    several = len(logs) > 1 or logs != options.logs
    if several and extra:
        raise ReviewError("--csv and --png take one log; give one, or leave them out.")
    single = Path("overview.html") if several else logs[0].with_suffix(".html")
    output = options.output or single
    pages = _pages(logs, output) if several else [output]
    outputs = [output, *extra, *(pages if several else [])]
    check_outputs(outputs, logs)
    for path, suffix in ((output, ".html"), (options.csv, ".csv"), (options.png, ".png")):
        if path is not None:
            check_suffix(path, suffix)
    drives: list[tuple[dict[str, Any], str]] = []
    faults, failures = list[str](), list[str]()
    for path, page in zip(tqdm(logs, disable=None, unit="log", delay=1.0), pages, strict=True):
        try:
            log = _review(path, page, options)
        except LinkageVibrationError as error:
            failures.append(str(error))
            continue
        faults += [f"{path}: {text}" if several else text for text in problems(log)]
        if several:
            drives.append((drive_summary(log), page.name))
    if len(failures) == len(logs):
        raise ReviewError(failures[0])
    if several:
        write_text(output, overview_html(drives, failures), ReviewError)
    print(f"Written: {', '.join(map(str, outputs))}")
    code = exit_code(failures + faults, options.strict)
    return INCOMPLETE if failures else code


def _review(path: Path, page: Path, options: argparse.Namespace) -> "Log":
    """Write the page of a log, and its table and its picture if they were asked for."""
    from linkage_vibration.drawing.plots import png_bytes
    from linkage_vibration.review.html import page_parts
    from linkage_vibration.review.log import ReviewError, csv_text, read_log
    from linkage_vibration.review.picture import plot
    from linkage_vibration.review.review_page import review_page
    from linkage_vibration.support.atomic_files import write_files

    log = read_log(path)
    files: dict[Path, Iterable[bytes]] = {page: page_parts(review_page(log))}
    if options.csv:
        files[options.csv] = [csv_text(log).encode()]
    if options.png:
        files[options.png] = [png_bytes(plot(log))]
    write_files(files, ReviewError)
    return log


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
