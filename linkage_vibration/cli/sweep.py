# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Build the tables of many designs into one netCDF file."""

import argparse
import sys
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("designs", type=Path, help="YAML file of a mechanism and parameters")
    text = "netCDF file to write (default: DESIGNS with .nc)"
    parser.add_argument("-o", "--output", type=Path, help=text)
    parser.add_argument("--workers", type=int, help="processes (default: one for each core)")


def run(options: argparse.Namespace) -> int:
    """Build what is missing in the file; return 1 if another run should try some designs again."""
    from tqdm import tqdm

    from linkage_vibration.studies.sweep import read_designs, sweep
    from linkage_vibration.support.atomic_files import check_output
    from linkage_vibration.support.process_pool import LocalPool

    output = options.output or Path(options.designs.name).with_suffix(".nc")
    check_output(output, ".nc", [options.designs])
    designs = read_designs(options.designs)
    with (
        LocalPool(options.workers) as pool,
        tqdm(disable=None, total=designs.size, unit="design") as bar,
    ):
        result = sweep(designs, output, pool, bar.update)
    print(
        f"{output}: {designs.size} designs at {len(designs.alpha3)} angles; {result.built} were "
        f"computed now, {result.kept} were in the file already."
    )
    if result.messages:
        index, message = next(iter(result.messages.items()))
        print(
            f"{len(result.messages)} designs have no result; the first is {designs.name(index)}: "
            f"{message}",
            file=sys.stderr,
        )
    if result.given_up:
        print(f"The next run tries {result.given_up} of them again.", file=sys.stderr)
    return 1 if result.given_up else 0
