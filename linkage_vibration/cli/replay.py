# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predict for the angles that bags hold, and write a log as the node does."""

import argparse
from pathlib import Path

from linkage_vibration.support.exit_codes import INCOMPLETE, add_strict, exit_code


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "bags",
        nargs="+",
        type=Path,
        metavar="BAG",
        help=".mcap, .db3 or .bag file, the folder of a bag, or a log of a CAN bus",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="MCAP file to write")
    parser.add_argument("--params-file", type=Path, help="YAML file of the node's parameters")
    parser.add_argument(
        "--joint", help="joint that turns the crank (default: the parameter joint_name)"
    )
    parser.add_argument("--sign", type=int, help="crank angle = sign * scale * position + offset")
    parser.add_argument("--scale", type=float, help="rad per unit of position")
    parser.add_argument("--offset", type=float, help="rad")
    parser.add_argument("--mechanism", type=Path, help="YAML file (default: the shipped linkage)")
    parser.add_argument("--table", type=Path, help="table to use (default: the shipped one)")
    parser.add_argument(
        "--implement-mass", type=float, help="kg; predict as if the implement had this mass"
    )
    parser.add_argument(
        "--implement-inertia",
        type=float,
        help="kg m2; predict as if the implement had this moment of inertia",
    )
    parser.add_argument(
        "--remap",
        nargs="+",
        default=[],
        metavar="NAME:=TOPIC",
        help="topic in the bags for a topic of the node, such as joint_states, hitch_position, "
        "engine_speed, pto_speed or ground_speed",
    )
    add_strict(parser, "a prediction has no numbers or a message was left out")


def run(options: argparse.Namespace) -> int:
    """Replay the bags into one log and print a summary; return the exit code."""
    from tqdm import tqdm

    from linkage_vibration.playback.remapping import remappings
    from linkage_vibration.playback.replay import WhatIf, problems, replay, replay_summary
    from linkage_vibration.prediction.parameter_files import read_parameters
    from linkage_vibration.prediction.settings import Parameters, with_values
    from linkage_vibration.support.atomic_files import check_outputs, check_suffix
    from linkage_vibration.support.progress import table_bar

    check_outputs([options.output], [*options.bags, *filter(None, [options.params_file])])
    check_suffix(options.output, ".mcap")
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
    if what_if != WhatIf() or settings.table_path() is None:
        print("The table of this mechanism is built first.")
    messages = tqdm(disable=None, unit=" messages", unit_scale=True, delay=1.0, position=0)
    with messages as bar, table_bar("table") as building:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        remaps = remappings(options.remap)
        done = replay(options.bags, options.output, settings, remaps, what_if, show, building)
    print(f"{options.output}: {replay_summary(done)}")
    code = exit_code(problems(done), options.strict)
    return code if done.with_numbers else INCOMPLETE
