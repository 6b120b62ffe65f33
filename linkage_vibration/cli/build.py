# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compute the lookup table of a mechanism, or with --plan the smallest model that is enough.

A plan models no more than a scene needs: a band, FRFs between places, and a range of angles.
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from linkage_vibration.cli.arguments import add_mechanism, mechanism_file, read_model
from linkage_vibration.support.resources import command

if TYPE_CHECKING:
    from linkage_vibration.mechanics.description import Mechanism
    from linkage_vibration.table.table import Table

_TOLERANCE = 1e-6  # of a table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add_mechanism(parser, "mechanism")
    text = "table to write (default: MECHANISM with .npz), or planned mechanism (default: none)"
    add("-o", "--output", type=Path, help=text)
    text = "largest relative error of a natural frequency; for FRFs and their peak it is a "
    text += f"hundred times as large (default: {_TOLERANCE:g}; of a plan a tenth of the least "
    text += "standard deviation by uncertain numbers of the mechanism, 1e-4 without these)"
    add("--tolerance", type=float, help=text)
    text = "points between which the table holds FRFs (default: all moving points and mounts, if "
    text += "there are at most 8)"
    add("--frf-points", nargs="+", metavar="POINT", help=text)
    text = "choose the fewest elements and modes a link for a scene, and write no table"
    add("--plan", action="store_true", help=text)
    scene = parser.add_argument_group("the scene of a plan")
    ends: dict[str, Any] = {"nargs": 2, "type": float, "metavar": ("LOW", "HIGH")}
    text = "frequency band of interest (default: the mechanism's response.band_hz)"
    scene.add_argument("--band-hz", **ends, help=text)
    text = "places between which FRFs are needed, for example: E1 z V1 x (default: no FRFs)"
    given: dict[str, Any] = {"nargs": "+", "default": [], "metavar": "POINT DIRECTION"}
    scene.add_argument("--points", **given, help=text)
    where = scene.add_mutually_exclusive_group()
    where.add_argument("--angle-deg", type=float, help="one crank angle alpha3")
    text = "range of the crank angle alpha3 (default: the mechanism's stroke)"
    where.add_argument("--range-deg", **ends, help=text)


def run(options: argparse.Namespace) -> int:
    """Build the table and print its errors, or plan; return the exit code."""
    from linkage_vibration.support.atomic_files import check_output
    from linkage_vibration.support.progress import table_bar
    from linkage_vibration.table.table import save_table
    from linkage_vibration.table.tabulation import build_table

    source = mechanism_file(options)
    if options.plan:
        return _plan(options, source)
    output = options.output or Path(source.name).with_suffix(".npz")
    check_output(output, ".npz", [source])
    model = read_model(source)
    tolerance = _TOLERANCE if options.tolerance is None else options.tolerance
    with table_bar(model.mechanism.name) as progress:
        table = build_table(model, tolerance, options.frf_points, progress)
    save_table(table, output)
    for line in _description(table, progress.solutions, output, model.mechanism):
        print(line)
    return 0


def _plan(options: argparse.Namespace, source: Path) -> int:
    """Plan, print what was chosen, and write it; return the exit code."""
    from tqdm import tqdm

    from linkage_vibration.readers.mechanism import load_yaml, read_mechanism
    from linkage_vibration.studies.plan import PlanError, Scene, plan, plan_report, write_planned
    from linkage_vibration.studies.unknowns import needed_tolerance
    from linkage_vibration.support.atomic_files import check_output

    words = options.points
    if len(words) % 2:
        raise PlanError("--points takes a direction after each point, as in: E1 z V1 x.")
    places = tuple(zip(words[::2], words[1::2], strict=True))
    check_output(options.output, ".yaml", [source])
    mechanism = read_mechanism(source)
    low, high = options.range_deg or [options.angle_deg, options.angle_deg]
    band = tuple(options.band_hz or mechanism.response.band)
    angles = mechanism.stroke if low is None else (math.radians(low), math.radians(high))
    few = angles[0], sum(angles) / 2.0, angles[1]
    tolerance, unknown = needed_tolerance(mechanism, band, few)
    if options.tolerance is not None:
        tolerance = options.tolerance
    scene = Scene(mechanism, band, places, tolerance, angles)
    with tqdm(disable=None, desc=mechanism.name, unit=" solves", delay=2.0) as bar:
        chosen = plan(scene, lambda: bar.update(1))
    print(plan_report(chosen))
    if unknown:
        print(f"\n{unknown}")
    if options.output:
        write_planned(chosen, load_yaml(source)[1], options.output)
        print(f"\nWritten: {options.output}")
        if not scene.one_angle:
            points = " ".join(dict.fromkeys(point for point, _ in places))
            at = f" --frf-points {points}" if places else ""
            build = f"build {options.output} --tolerance {chosen.table_tolerance:.3g}{at}"
            print(f"To build its table: {command(build)}")
    return 0


def _description(
    table: "Table", solutions: int, output: Path, mechanism: "Mechanism"
) -> Iterator[str]:
    """Yield the lines that say what was built."""
    from linkage_vibration.prediction.predictor import uncertain_modes

    low, high = (math.degrees(angle) for angle in table.alpha3_range)
    frfs = f", FRFs {table.frf_error:.1e}, forces {table.force_error:.1e}"
    frfs = frfs if table.places else "; the table holds no FRFs"
    yield (
        f"{output}: table {table.table_id}, {len(table.alpha3)} angles from {low:g} to {high:g} "
        f"deg by {solutions} solutions; bounds of relative errors: natural frequencies and damping "
        f"ratios {table.interpolation_error.max():.1e}, FRF peak {table.peak_error:.1e}{frfs}."
    )
    if table.measured:
        deviations = table.frequency_stddev, table.damping_ratios, table.damping_ratio_stddev
        yield from uncertain_modes(table.natural_frequencies, *deviations, table.mode_label)
    for mode, shares in enumerate(table.mode_shares):
        base, bodies, links = (f"{100.0 * share:.0f} %" for share in shares)
        yield f"{table.mode_label(mode)}: base {base}, rigid bodies {bodies}, links {links}"
    for half in table.halves:
        if not half.free_modes:
            continue
        single = half.free_modes == 1
        left_out = "1 mode at 0 Hz is" if single else f"{half.free_modes} modes at 0 Hz are"
        fix = "clamp the input link or put a spring on its joint"
        if mechanism.base is not None and not mechanism.base.mounts:
            fix = "give its base mounts"
        aside = " along y" if half is table.lateral else ""
        fix = "give `lateral` chains, and axles with a stiffness" if aside else fix
        problem = f"Nothing holds {mechanism.name}{aside}: {left_out} left out of the table"
        yield f"{problem}. To hold it, {fix}."
    if table.unknown_deviations:
        yield table.unknown_deviations
