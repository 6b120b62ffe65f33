# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compute the lookup table of a mechanism."""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from linkage_vibration.cli.arguments import SHIPPED, mechanism_file, read_model

if TYPE_CHECKING:
    from linkage_vibration.mechanics.description import Mechanism
    from linkage_vibration.table.table import Table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add("mechanism", nargs="?", type=Path, help=SHIPPED)
    add("-o", "--output", type=Path, help="table to write (default: MECHANISM with .npz)")
    text = "largest relative error of a natural frequency; for FRFs and their peak it is a "
    text += "hundred times as large (default: %(default)s)"
    add("--tolerance", type=float, default=1e-6, help=text)
    text = "points between which the table holds FRFs (default: all moving points and mounts, if "
    text += "there are at most 8)"
    add("--frf-points", nargs="+", metavar="POINT", help=text)


def run(options: argparse.Namespace) -> int:
    """Build the table and print its errors; return the exit code."""
    from linkage_vibration.support.atomic_files import check_output
    from linkage_vibration.support.progress import table_bar
    from linkage_vibration.table.table import save_table
    from linkage_vibration.table.tabulation import build_table

    source = mechanism_file(options)
    output = options.output or Path(source.name).with_suffix(".npz")
    check_output(output, ".npz", [source])
    model = read_model(source)
    with table_bar(model.mechanism.name) as progress:
        table = build_table(model, options.tolerance, options.frf_points, progress)
    save_table(table, output)
    for line in _description(table, progress.solutions, output, model.mechanism):
        print(line)
    return 0


def _description(
    table: "Table", solutions: int, output: Path, mechanism: "Mechanism"
) -> Iterator[str]:
    """Yield the lines that say what was built."""
    from linkage_vibration.prediction.predictor import uncertain_modes

    low, high = (math.degrees(angle) for angle in table.alpha3_range)
    frfs = f", FRFs {table.frf_error:.1e}" if table.places else "; the table holds no FRFs"
    yield (
        f"{output}: table {table.table_id}, {len(table.alpha3)} angles from {low:g} to {high:g} "
        f"deg by {solutions} solutions; bounds of relative errors: natural frequencies and damping "
        f"ratios {table.interpolation_error.max():.1e}, FRF peak {table.peak_error:.1e}{frfs}."
    )
    if table.measured:
        deviations = table.frequency_stddev, table.damping_ratios, table.damping_ratio_stddev
        yield from uncertain_modes(table.natural_frequencies, *deviations, table.mode_label)
    for half in filter(None, (table, table.lateral)):
        if half is table.lateral:
            yield "Sway, roll and yaw:"
        for mode, shares in enumerate(half.mode_shares):
            base, bodies, links = (f"{100.0 * share:.0f} %" for share in shares)
            yield f"{half.mode_label(mode)}: base {base}, rigid bodies {bodies}, links {links}"
    if table.free_modes:
        ground = mechanism.base
        single = table.free_modes == 1
        left_out = "1 mode at 0 Hz is" if single else f"{table.free_modes} modes at 0 Hz are"
        fix = "clamp the input link or put a spring on its joint"
        if ground is not None and not ground.mounts:
            fix = "give its base mounts"
        yield (
            f"Nothing holds {mechanism.name}: {left_out} left out of the table. To hold it, {fix}."
        )
    if table.unknown_deviations:
        yield table.unknown_deviations
