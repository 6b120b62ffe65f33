# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Fit parameters of a mechanism to measured natural frequencies."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("calibration", type=Path, help="YAML file of parameters and targets")
    text = "mechanism to write (default: only print the fit)"
    parser.add_argument("-o", "--output", type=Path, help=text)
    text = "number of starting points of the search (default: %(default)s)"
    parser.add_argument("--starts", type=int, default=8, help=text)


def run(options: argparse.Namespace) -> int:
    """Fit, print the fit, and write the fitted mechanism; return the exit code."""
    from tqdm import tqdm

    from linkage_vibration.studies import calibration as study
    from linkage_vibration.support.atomic_files import check_output

    starts = options.starts
    if starts < 1:
        raise study.CalibrationError(f"--starts is {starts}; give 1 or more starting points.")
    check_output(options.output, ".yaml", [options.calibration])
    calibration = study.read_calibration(options.calibration)
    with tqdm(disable=None, total=starts, unit="start") as bar:

        def show(cost: float) -> None:
            bar.set_postfix(cost=f"{cost:.4g}")
            bar.update(1)

        result = study.calibrate(calibration, starts, show)
    print(study.fit_report(calibration, result))
    if options.output:
        study.write_mechanism(calibration, result, options.output)
        print(f"\nWritten: {options.output}")
    return 0
