# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Check a log against limits, and against an earlier log, for a CI job."""

import argparse
from pathlib import Path

from linkage_vibration.support.exit_codes import exit_code


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add("log", type=Path, metavar="LOG", help="log of predictions, or a bag, which is replayed")
    text = "YAML file whose keys are the fields of `Limits`"
    add("--limits", type=Path, required=True, metavar="FILE", help=text)
    text = "also write the result to this file as JUnit XML"
    add("--junit", type=Path, metavar="FILE", help=text)
    text = "earlier log of the same drive, whose predictions have to be equal"
    add("--baseline", type=Path, metavar="LOG", help=text)


def run(options: argparse.Namespace) -> int:
    """Print a sentence for each limit that is exceeded; return the exit code."""
    from linkage_vibration.errors import LinkageVibrationError
    from linkage_vibration.support.atomic_files import check_output, write_bytes
    from linkage_vibration.testing.bag_checks import check_bag
    from linkage_vibration.testing.junit import junit_error, junit_xml
    from linkage_vibration.testing.limits import TestKitError, read_limits

    inputs = [options.log, options.limits, *filter(None, [options.baseline])]
    check_output(options.junit, ".xml", inputs)
    try:
        report = check_bag(options.log, read_limits(options.limits), baseline=options.baseline)
    except LinkageVibrationError as error:
        if options.junit:  # a CI service shows why there is no result
            write_bytes(options.junit, junit_error(options.log, str(error)), TestKitError)
        raise
    if options.junit:
        write_bytes(options.junit, junit_xml(report), TestKitError)
    for line in [str(report)] if report.passed else report.input_faults:
        print(line)
    return exit_code([f"{report.bag}: {failure}" for failure in report.failures], strict=True)
