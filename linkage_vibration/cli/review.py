# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Show what drives did: as pages, as JSON, beside an earlier log, or against limits.

A page is written unless --json, --against or --limits asks for another view; then it is written if
-o names it.
"""

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from linkage_vibration.support.exit_codes import FAILED, INCOMPLETE, add_strict, exit_code

if TYPE_CHECKING:
    from linkage_vibration.review.log import Log

SCHEMA_VERSION = 1  # of the JSON; it rises when a field is removed or changes its meaning


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    text = "MCAP files, folders of bags, or folders of MCAP files"
    add("logs", nargs="+", type=Path, metavar="LOG", help=text)
    text = "HTML file to write (default: LOG with .html; of several logs overview.html)"
    add("-o", "--output", type=Path, help=text)
    add("--png", type=Path, help="also write a picture of one log to this file")
    add("--csv", type=Path, help="also write all predictions of one log")
    view = parser.add_mutually_exclusive_group().add_argument
    view("--json", action="store_true", help="print what the page says of each drive as JSON")
    text = "print how one log, B, differs from this earlier one of the same drive, A"
    view("--against", type=Path, metavar="LOG", help=text)
    text = "check one log against a YAML file of the fields of `Limits`, and end with exit code 3 "
    text += "if one is exceeded; a bag without predictions is replayed"
    view("--limits", type=Path, metavar="FILE", help=text)
    add("--junit", type=Path, metavar="FILE", help="also write the result of --limits as JUnit XML")
    text = "earlier log of the same drive, from which predictions may differ as far as the limits "
    add("--baseline", type=Path, metavar="LOG", help=f"{text} say")
    text = "a prediction is missing, out of range or invalid; with --json also if there are "
    text += "warnings, loads above the limit, or less than 95 %% of a drive known; with --against "
    add_strict(parser, f"{text} if the predictions differ")


def run(options: argparse.Namespace) -> int:
    """Write and print what was asked for; return the exit code."""
    import json

    from tqdm import tqdm

    from linkage_vibration.errors import LinkageVibrationError
    from linkage_vibration.review.log import ReviewError, read_log
    from linkage_vibration.review.overview import drive_summary, logs_of, overview_html
    from linkage_vibration.support.atomic_files import write_bytes, write_text
    from linkage_vibration.testing.bag_checks import read_drive
    from linkage_vibration.testing.junit import junit_error

    logs = logs_of(options.logs)
    several = len(logs) > 1 or logs != options.logs
    overview, pages = _outputs(options, logs, several)
    drives: list[tuple[dict[str, Any], str]] = []
    faults, failures, written = list[str](), list[dict[str, str]](), list[Path]()
    for path, page in zip(tqdm(logs, disable=None, unit="log", delay=1.0), pages, strict=True):
        try:
            log = read_drive(path) if options.limits else read_log(path)
            # Limits or an earlier log that cannot be read leave older files as they are.
            faults += [f"{path}: {text}" for text in _view(log, options)]
            written += _write(log, page, options)
            if several or options.json:
                drives.append((drive_summary(log), page.name if page else ""))
        except LinkageVibrationError as error:
            failures.append({"log": str(path), "error": str(error)})
            if options.junit:  # a CI service shows why there is no result
                write_bytes(options.junit, junit_error(path, str(error)), ReviewError)
    texts = [each["error"] for each in failures]
    if len(failures) < len(logs):
        if several and overview:
            write_text(overview, overview_html(drives, texts), ReviewError)
            written.insert(0, overview)
        if options.json:
            each = [drive for drive, _ in drives]
            content = {"schema_version": SCHEMA_VERSION, "drives": each, "failures": failures}
            print(json.dumps(content, indent=2, allow_nan=False))
        if written:
            names = ", ".join(map(str, written))
            print(f"Written: {names}", file=sys.stderr if options.json else sys.stdout)
    code = exit_code(texts + faults, options.strict or options.limits is not None)
    return code if not failures else INCOMPLETE if len(failures) < len(logs) else FAILED


def _outputs(
    options: argparse.Namespace, logs: Sequence[Path], several: bool
) -> tuple[Path | None, Sequence[Path | None]]:
    """Return the page or the overview, and the page of each log, if they are written."""
    from linkage_vibration.review.log import ReviewError
    from linkage_vibration.support.atomic_files import check_outputs, check_suffix

    if several and any((options.csv, options.png, options.against, options.limits)):
        problem = "--csv, --png, --against and --limits take one log; give one, or leave them out."
        raise ReviewError(problem)
    if (options.junit or options.baseline) and not options.limits:
        raise ReviewError("--junit and --baseline belong to --limits; give its file.")
    output, pages = options.output, list[Path]()
    if not (output or options.json or options.against or options.limits):
        output = Path("overview.html") if several else logs[0].with_suffix(".html")
    if output:
        pages = _pages(logs, output) if several else [output]
    suffixes = (options.csv, ".csv"), (options.png, ".png"), (options.junit, ".xml")
    given = [(path, suffix) for path, suffix in ((output, ".html"), *suffixes) if path]
    inputs = [*logs, *filter(None, (options.against, options.limits, options.baseline))]
    check_outputs([*(path for path, _ in given), *(pages if several else [])], inputs)
    for path, suffix in given:
        check_suffix(path, suffix)
    return output, pages or [None] * len(logs)


def _write(log: "Log", page: Path | None, options: argparse.Namespace) -> list[Path]:
    """Write the page, the table and the picture of a log that were asked for; return the files."""
    from linkage_vibration.drawing.plots import png_bytes
    from linkage_vibration.review.log import ReviewError, csv_text
    from linkage_vibration.review.picture import plot
    from linkage_vibration.review.review_page import page_of
    from linkage_vibration.support.atomic_files import write_files

    files: dict[Path, Iterable[bytes]] = {page: page_of(log)} if page else {}
    if options.csv:
        files[options.csv] = [csv_text(log).encode()]
    if options.png:
        files[options.png] = [png_bytes(plot(log))]
    write_files(files, ReviewError)
    return list(files)


def _view(log: "Log", options: argparse.Namespace) -> list[str]:
    """Print a log beside an earlier one or against limits; return its problems, in sentences."""
    from linkage_vibration.review.difference import compare, difference_summary, problems
    from linkage_vibration.review.findings import load_problems
    from linkage_vibration.review.log import ReviewError, read_log
    from linkage_vibration.review.log import problems as problems_of
    from linkage_vibration.support.atomic_files import write_bytes
    from linkage_vibration.testing.bag_checks import check_log
    from linkage_vibration.testing.junit import junit_xml
    from linkage_vibration.testing.limits import read_limits

    if options.against:
        difference = compare(read_log(options.against), log)
        print(difference_summary(difference))
        return problems(difference) if options.strict else []
    if options.limits:
        report = check_log(log, read_limits(options.limits), baseline=options.baseline)
        if options.junit:
            write_bytes(options.junit, junit_xml(report), ReviewError)
        for line in [str(report)] if report.passed else report.input_faults:
            print(line)
        return list(map(str, report.failures))
    return problems_of(log) + (load_problems(log) if options.json else [])


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
