# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The ``linkage-vibration`` command."""

import argparse
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import linkage_vibration
from linkage_vibration.errors import LinkageVibrationError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    options = _parser().parse_args(arguments)
    # Matrices here are small: BLAS threads cost more in waiting for one another than they save.
    # NumPy looks at this when it is first imported, so each command imports what it needs itself.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        return int(options.run(options))
    except LinkageVibrationError as error:
        print(f"linkage-vibration: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="linkage-vibration",
        description="How a linkage vibrates in the configuration that it is in.",
    )
    parser.add_argument("--version", action="version", version=linkage_vibration.__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    build = commands.add_parser("build", help="compute the lookup table of a mechanism")
    build.add_argument(
        "mechanism", nargs="?", type=Path, help="YAML file (default: the shipped linkage)"
    )
    build.add_argument(
        "-o", "--output", type=Path, help="table to write (default: MECHANISM with .npz)"
    )
    build.add_argument(
        "--tolerance",
        type=float,
        default=1e-6,
        help="relative, of natural frequencies; FRFs and their peak: a hundred times (%(default)s)",
    )
    build.add_argument(
        "--frf-points",
        nargs="+",
        metavar="POINT",
        help="points to hold FRFs between (default: all that move, if they are 8 at most)",
    )
    build.set_defaults(run=_build)

    predict = commands.add_parser("predict", help="predict at angles given in degrees")
    predict.add_argument("angle_deg", nargs="+", type=float, help="alpha3 in degrees")
    predict.add_argument("--mechanism", type=Path, help="YAML file (default: the shipped linkage)")
    predict.add_argument("--table", type=Path, help="table to use (default: the shipped one)")
    predict.set_defaults(run=_predict)

    calibrate = commands.add_parser(
        "calibrate", help="fit parameters of a mechanism to natural frequencies"
    )
    calibrate.add_argument("calibration", type=Path, help="YAML file of parameters and targets")
    calibrate.add_argument(
        "-o", "--output", type=Path, help="mechanism to write (default: print the fit alone)"
    )
    calibrate.add_argument(
        "--starts", type=int, default=8, help="starts of the search (%(default)s)"
    )
    calibrate.set_defaults(run=_calibrate)

    plan = commands.add_parser(
        "plan", help="choose the cheapest model that meets a tolerance, and measure it"
    )
    plan.add_argument(
        "mechanism", nargs="?", type=Path, help="YAML file (default: the shipped linkage)"
    )
    plan.add_argument(
        "--band-hz",
        nargs=2,
        type=float,
        metavar=("LOW", "HIGH"),
        help="(default: the mechanism's response.band_hz)",
    )
    plan.add_argument(
        "--points",
        nargs="+",
        default=[],
        metavar="POINT DIRECTION",
        help="places to have FRFs between, as in: E1 z V1 x (default: no FRFs)",
    )
    plan.add_argument(
        "--tolerance",
        type=float,
        default=1e-4,
        help="relative, of natural frequencies; FRFs and their peak: a hundred times (%(default)s)",
    )
    where = plan.add_mutually_exclusive_group()
    where.add_argument("--angle-deg", type=float, help="one angle of alpha3")
    where.add_argument(
        "--range-deg",
        nargs=2,
        type=float,
        metavar=("LOW", "HIGH"),
        help="range of alpha3 (default: the mechanism's stroke)",
    )
    plan.add_argument(
        "--microseconds-per-prediction", type=float, help="how quick predictions have to be"
    )
    plan.add_argument("-o", "--output", type=Path, help="planned mechanism to write")
    plan.set_defaults(run=_plan)

    sweep = commands.add_parser("sweep", help="build the tables of many designs into one file")
    sweep.add_argument("designs", type=Path, help="YAML file of a mechanism and parameters")
    sweep.add_argument(
        "-o", "--output", type=Path, help="netCDF file to write (default: DESIGNS with .nc)"
    )
    where = sweep.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, help="processes (default: one for each core)")
    where.add_argument("--dask", metavar="ADDRESS", help="scheduler of a Dask cluster to use")
    sweep.set_defaults(run=_sweep)

    reproduce = commands.add_parser(
        "reproduce", help="write the numbers and figures of the paper beside ours"
    )
    reproduce.add_argument(
        "-o", "--output", type=Path, default=Path("reproduction"), help="folder to write to"
    )
    reproduce.set_defaults(run=_reproduce)

    recover = commands.add_parser(
        "recover", help="save what is readable of a log that was cut short or damaged"
    )
    recover.add_argument("log", type=Path, metavar="LOG", help="MCAP file; it is only read")
    recover.add_argument(
        "-o", "--output", type=Path, help="MCAP file to write (default: LOG with _recovered)"
    )
    recover.set_defaults(run=_recover)

    replay = commands.add_parser("replay", help="predict for what bags hold, and write a log")
    replay.add_argument(
        "bags", nargs="+", type=Path, metavar="BAG", help=".mcap, .db3, .bag, or a bag's folder"
    )
    replay.add_argument("-o", "--output", type=Path, required=True, help="MCAP file to write")
    replay.add_argument("--params-file", type=Path, help="YAML file of the node's parameters")
    replay.add_argument("--joint", help="joint that turns the crank (default: joint_name)")
    replay.add_argument("--sign", type=int, help="crank angle = sign * scale * position + offset")
    replay.add_argument("--scale", type=float, help="rad per unit of position")
    replay.add_argument("--offset", type=float, help="rad")
    replay.add_argument("--mechanism", type=Path, help="YAML file (default: the shipped linkage)")
    replay.add_argument("--table", type=Path, help="table to use (default: the shipped one)")
    replay.add_argument("--implement-mass", type=float, help="kg; what if it were so heavy?")
    replay.add_argument("--implement-inertia", type=float, help="kg m2; what if?")
    replay.add_argument(
        "--remap",
        nargs="+",
        default=[],
        metavar="NAME:=TOPIC",
        help="topic in the bags for joint_states, hitch_position, engine_speed, pto_speed or "
        "ground_speed",
    )
    replay.set_defaults(run=_replay)

    review = commands.add_parser("review", help="write a page to look into a log with")
    review.add_argument("log", type=Path, metavar="LOG", help="MCAP file")
    review.add_argument(
        "-o", "--output", type=Path, help="HTML file to write (default: LOG with .html)"
    )
    review.add_argument("--png", type=Path, help="picture to write too")
    review.add_argument("--csv", type=Path, help="table of all predictions to write too")
    review.set_defaults(run=_review)

    diff = commands.add_parser("diff", help="tell how two logs of the same drive differ")
    diff.add_argument("logs", nargs=2, type=Path, metavar="LOG", help="MCAP files, A and B")
    diff.add_argument(
        "-o", "--output", type=Path, default=Path("diff.html"), help="HTML file (%(default)s)"
    )
    diff.set_defaults(run=_diff)

    demo = commands.add_parser("demo", help="play a drive to the node and show what it predicts")
    demo.add_argument("--bag", type=Path, help="bag to play (default: the shipped drive)")
    demo.add_argument("--joint", help="joint to follow, whose swing is mapped onto the stroke")
    demo.add_argument("-o", "--output", type=Path, default=Path("demo"), help="folder to write to")
    demo.set_defaults(run=_demo)
    return parser


def _build(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from linkage_vibration.mechanics.model import LinkageModel
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file
    from linkage_vibration.table.table import save_table
    from linkage_vibration.table.tabulation import build_table

    source = options.mechanism or config_file(DEFAULT_MECHANISM)
    output = options.output or Path(source.name).with_suffix(".npz")
    model = LinkageModel(read_mechanism(source))
    with tqdm(desc=model.mechanism.name, unit=" angles") as bar:
        table = build_table(model, options.tolerance, options.frf_points, lambda: bar.update(1))
    save_table(table, output)
    low, high = (math.degrees(angle) for angle in table.alpha3_range)
    frfs = f", FRFs {table.frf_error:.1e}" if table.places else "; it holds no FRFs"
    print(
        f"{output}: table {table.table_id}, {len(table.alpha3)} angles from {low:g} to {high:g} "
        f"deg; worst relative error measured where it was not fitted: natural frequencies "
        f"{table.interpolation_error.max():.1e}, FRF peak {table.peak_error:.1e}{frfs}."
    )
    return 0


def _predict(options: argparse.Namespace) -> int:
    from linkage_vibration.mechanics.model import LinkageModel
    from linkage_vibration.prediction.predictor import Predictor, Status
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.support.resources import DEFAULT_MECHANISM, DEFAULT_TABLE, config_file
    from linkage_vibration.table.table import load_table
    from linkage_vibration.table.tabulation import build_table

    mechanism = read_mechanism(options.mechanism or config_file(DEFAULT_MECHANISM))
    if options.mechanism and not options.table:
        table = build_table(LinkageModel(mechanism))
    else:
        table = load_table(options.table or config_file(DEFAULT_TABLE), mechanism)
    predictor = Predictor(table)
    modes = "".join(f"{f'mode {k + 1} [Hz]':>13}" for k in range(table.n_modes))
    print(f"{'alpha3 [deg]':>12}{modes}{'peak [Hz]':>13}{'peak [m/N]':>13}")
    good = True
    for angle in options.angle_deg:
        prediction = predictor.predict(math.radians(angle))
        good = good and prediction.status.has_numbers
        print(
            f"{angle:12.3f}"
            + "".join(f"{frequency:13.4f}" for frequency in prediction.natural_frequencies)
            + f"{prediction.frf_peak_frequency:13.4f}{prediction.frf_peak_magnitude:13.4e}"
            + ("" if prediction.status is Status.OK else f"  {prediction.status.name}")
        )
    return 0 if good else 1


def _calibrate(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from linkage_vibration.studies.calibration import (
        calibrate,
        read_calibration,
        summary,
        write_mechanism,
    )

    calibration = read_calibration(options.calibration)
    with tqdm(total=max(1, options.starts), unit="start") as bar:

        def tried(cost: float) -> None:
            bar.set_postfix(cost=f"{cost:.4g}")
            bar.update(1)

        result = calibrate(calibration, max(1, options.starts), tried)
    print(summary(calibration, result))
    if options.output:
        write_mechanism(calibration, result.values.tolist(), options.output)
        print(f"\nWritten: {options.output}")
    return 0


def _plan(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from linkage_vibration.readers.mechanism import load_yaml, read_mechanism
    from linkage_vibration.studies.plan import (
        PlanError,
        Scene,
        measure,
        plan,
        summary,
        truths,
        write_planned,
    )
    from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file

    words = options.points
    if len(words) % 2:
        raise PlanError("--points takes a direction after each point, as in: E1 z V1 x.")
    places = tuple(zip(words[::2], words[1::2], strict=True))
    source = options.mechanism or config_file(DEFAULT_MECHANISM)
    mechanism = read_mechanism(source, spatial="y" in words[1::2])
    low, high = options.range_deg or [options.angle_deg, options.angle_deg]
    limit = options.microseconds_per_prediction
    scene = Scene(
        mechanism,
        tuple(options.band_hz or mechanism.response.band),
        places,
        options.tolerance,
        mechanism.stroke if low is None else (math.radians(low), math.radians(high)),
        None if limit is None else 1e-6 * limit,
    )
    with tqdm(desc=mechanism.name, unit=" solves", delay=2.0) as bar:
        chosen = plan(scene, lambda: bar.update(1))
        measured = measure(chosen, truths(chosen, lambda: bar.update(1)))
    print(summary(chosen, measured))
    if options.output:
        write_planned(chosen, load_yaml(source)[1], options.output)
        print(f"\nWritten: {options.output}")
        if chosen.table_tolerance is not None:
            points = " ".join(dict.fromkeys(words[::2]))
            print(
                f"Its table: linkage-vibration build {options.output} "
                f"--tolerance {chosen.table_tolerance:.3g}"
                + (f" --frf-points {points}" if points else "")
            )
    quick = limit is None or chosen.scene.one_angle or measured.costs.prediction <= 1e-6 * limit
    return 0 if quick and measured.errors.share(scene.allowed) <= 1.0 else 1


def _sweep(options: argparse.Namespace) -> int:
    from contextlib import ExitStack

    from tqdm import tqdm

    from linkage_vibration.studies.sweep import dask_executor, read_designs, sweep
    from linkage_vibration.support.process_pool import LocalPool

    designs = read_designs(options.designs)
    output = options.output or Path(options.designs.name).with_suffix(".nc")
    with ExitStack() as stack:
        if options.dask:
            executor = stack.enter_context(dask_executor(options.dask))
        else:
            executor = stack.enter_context(LocalPool(options.workers))
        bar = stack.enter_context(tqdm(total=designs.size, unit="design"))
        result = sweep(designs, output, executor, bar.update)
    print(
        f"{output}: {designs.size} designs at {len(designs.alpha3)} angles; {result.built} "
        f"worked out now, {result.kept} kept from before."
    )
    if result.messages:
        index, message = next(iter(result.messages.items()))
        print(
            f"{len(result.messages)} designs have no result; the first, {designs.name(index)}: "
            f"{message}",
            file=sys.stderr,
        )
    if result.given_up:
        print(f"{result.given_up} of them are tried again by the next run.", file=sys.stderr)
    return 1 if result.given_up else 0


def _reproduce(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from linkage_vibration.paper.reproduction import reproduce

    bars: dict[str, Any] = {}

    def progress(what: str, done: int, total: int) -> None:
        if what not in bars:
            bars[what] = tqdm(total=total, desc=what)
        bars[what].update(done - bars[what].n)
        if done == total:
            bars[what].close()

    reproduce(options.output, progress)
    print(f"Written: {options.output}")
    return 0


def _recover(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from linkage_vibration.bags.recovery import recover, summary

    log: Path = options.log
    output = options.output or log.with_name(f"{log.stem}_recovered.mcap")
    with tqdm(
        total=os.path.getsize(log) if os.path.exists(log) else 0,
        unit="B",
        unit_scale=True,
        delay=2.0,
    ) as bar:
        result = recover(log, output, bar.update)
    print(summary(result))
    return 0


def _replay(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from linkage_vibration.playback.remapping import remappings
    from linkage_vibration.playback.replay import replay, summary
    from linkage_vibration.playback.what_if import AS_IT_IS, WhatIf
    from linkage_vibration.prediction.settings import Parameters, read_parameters, with_values

    settings = read_parameters(options.params_file) if options.params_file else Parameters()
    given = {
        "joint_name": options.joint,
        "sign": options.sign,
        "scale": options.scale,
        "offset": options.offset,
        "mechanism_file": options.mechanism and str(options.mechanism),
        "table_file": options.table and str(options.table),
    }
    given = {name: value for name, value in given.items() if value is not None}
    settings = with_values(settings, given)
    what_if = WhatIf(options.implement_mass, options.implement_inertia)
    if what_if != AS_IT_IS or settings.table_path() is None:
        print("The table of this mechanism is built first.")
    with tqdm(unit=" messages", unit_scale=True, delay=1.0) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        remaps = remappings(options.remap)
        done = replay(options.bags, options.output, settings, remaps, what_if, progress)
    print(f"{options.output}: {summary(done)}")
    return 0


def _review(options: argparse.Namespace) -> int:
    from linkage_vibration.drawing.plots import plot_predictions
    from linkage_vibration.review.html import write_page
    from linkage_vibration.review.log import read_log, write_csv
    from linkage_vibration.review.review_page import review_page

    output = options.output or options.log.with_suffix(".html")
    log = read_log(options.log)
    write_page(review_page(log), output)
    if options.csv:
        write_csv(log, options.csv)
    if options.png:
        plot_predictions(options.log, options.png)
    written = [output, *filter(None, [options.csv, options.png])]
    print(f"Written: {', '.join(map(str, written))}")
    return 0


def _diff(options: argparse.Namespace) -> int:
    from linkage_vibration.review.difference import compare, summary, write_difference

    found = compare(*options.logs)
    print(summary(found))
    write_difference(found, options.output)
    print(f"\nWritten: {options.output}")
    return 0


def _demo(options: argparse.Namespace) -> int:
    from linkage_vibration.demo.demo import run_demo

    return run_demo(options.bag, options.joint, options.output)
