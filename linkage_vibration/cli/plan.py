# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Choose the cheapest model that meets a tolerance."""

import argparse
import math
from pathlib import Path
from typing import Any

from linkage_vibration.cli.arguments import SHIPPED, mechanism_file
from linkage_vibration.support.commands import command


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add("mechanism", nargs="?", type=Path, help=SHIPPED)
    ends: dict[str, Any] = {"nargs": 2, "type": float, "metavar": ("LOW", "HIGH")}
    text = "frequency band of interest (default: the mechanism's response.band_hz)"
    add("--band-hz", **ends, help=text)
    text = "places between which FRFs are needed, for example: E1 z V1 x (default: no FRFs)"
    add("--points", nargs="+", default=[], metavar="POINT DIRECTION", help=text)
    text = "largest relative error of a natural frequency; for FRFs and their peak it is a "
    text += "hundred times as large (default: a tenth of the least standard deviation by uncertain "
    text += "numbers of the mechanism; 1e-4 without these)"
    add("--tolerance", type=float, help=text)
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--angle-deg", type=float, help="one crank angle alpha3")
    text = "range of the crank angle alpha3 (default: the mechanism's stroke)"
    where.add_argument("--range-deg", **ends, help=text)
    add("-o", "--output", type=Path, help="planned mechanism to write")


def run(options: argparse.Namespace) -> int:
    """Plan, and print what was chosen; return the exit code."""
    from tqdm import tqdm

    from linkage_vibration.readers.mechanism import load_yaml, read_mechanism
    from linkage_vibration.studies.plan import PlanError, Scene, plan, plan_report, write_planned
    from linkage_vibration.studies.unknowns import needed_tolerance
    from linkage_vibration.support.atomic_files import check_output

    words = options.points
    if len(words) % 2:
        raise PlanError("--points takes a direction after each point, as in: E1 z V1 x.")
    places = tuple(zip(words[::2], words[1::2], strict=True))
    source = mechanism_file(options)
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
            at = " ".join(["", "--frf-points", *scene.points]) if places else ""
            build = f"build {options.output} --tolerance {chosen.table_tolerance:.3g}{at}"
            print(f"To build its table: {command(build)}")
    return 0
