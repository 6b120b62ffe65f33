# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Choose the cheapest model that meets a tolerance, and measure its errors and costs."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

_TOLERANCE = 1e-4  # by default, of a mechanism whose numbers count as exact


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "mechanism", nargs="?", type=Path, help="YAML file (default: the shipped linkage)"
    )
    parser.add_argument(
        "--band-hz",
        nargs=2,
        type=float,
        metavar=("LOW", "HIGH"),
        help="frequency band of interest (default: the mechanism's response.band_hz)",
    )
    parser.add_argument(
        "--points",
        nargs="+",
        default=[],
        metavar="POINT DIRECTION",
        help="places between which FRFs are needed, for example: E1 z V1 x (default: no FRFs)",
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        help="largest relative error of a natural frequency; for FRFs and their peak it is a "
        "hundred times as large (default: a tenth of the least standard deviation by uncertain "
        "numbers of the mechanism; 1e-4 without these)",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--angle-deg", type=float, help="one crank angle alpha3")
    where.add_argument(
        "--range-deg",
        nargs=2,
        type=float,
        metavar=("LOW", "HIGH"),
        help="range of the crank angle alpha3 (default: the mechanism's stroke)",
    )
    parser.add_argument(
        "--microseconds-per-prediction", type=float, help="longest time that a prediction may take"
    )
    parser.add_argument("-o", "--output", type=Path, help="planned mechanism to write")


def run(options: argparse.Namespace) -> int:
    """Plan, print what was chosen and measured; return 1 if the model is too slow."""
    from tqdm import tqdm

    from linkage_vibration.readers.mechanism import load_yaml, read_mechanism
    from linkage_vibration.studies import plan
    from linkage_vibration.support.atomic_files import check_outputs, check_suffix
    from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file

    words = options.points
    if len(words) % 2:
        raise plan.PlanError("--points takes a direction after each point, as in: E1 z V1 x.")
    places = tuple(zip(words[::2], words[1::2], strict=True))
    source = options.mechanism or config_file(DEFAULT_MECHANISM)
    if options.output:
        check_outputs([options.output], [source])
        check_suffix(options.output, ".yaml")
    mechanism = read_mechanism(source, spatial="y" in words[1::2])
    low, high = options.range_deg or [options.angle_deg, options.angle_deg]
    limit = options.microseconds_per_prediction
    band = tuple(options.band_hz or mechanism.response.band)
    angles = mechanism.stroke if low is None else (math.radians(low), math.radians(high))
    few = list(dict.fromkeys([angles[0], sum(angles) / 2.0, angles[1]]))
    unknown = plan.unknowns(mechanism, band, few)
    tolerance = options.tolerance
    if tolerance is None:
        tolerance = _TOLERANCE if unknown is None else unknown.tolerance
    scene = plan.Scene(
        mechanism,
        band,
        places,
        tolerance,
        angles,
        None if limit is None else 1e-6 * limit,
    )
    with tqdm(disable=None, desc=mechanism.name, unit=" solves", delay=2.0) as bar:
        chosen, measured = plan.plan_and_measure(scene, lambda: bar.update(1))
    print(plan.plan_report(chosen, measured))
    print(f"\n{plan.physics_table(plan.effects(chosen.mechanism, band, few), tolerance)}")
    if unknown is not None:
        print(f"\n{unknown}")
    if options.output:
        plan.write_planned(chosen, load_yaml(source)[1], options.output)
        print(_written(options.output, chosen.table_tolerance, scene.points))
    return 0 if limit is None or measured.costs.prediction <= 1e-6 * limit else 1


def _written(output: Path, tolerance: float | None, points: Sequence[str]) -> str:
    """Return which file was written, and how to build the table if the plan has one."""
    text = f"\nWritten: {output}"
    if tolerance is None:
        return text
    at = " ".join(["", "--frf-points", *points]) if points else ""
    build = f"linkage-vibration build {output} --tolerance {tolerance:.3g}{at}"
    return f"{text}\nTo build its table: {build}"
