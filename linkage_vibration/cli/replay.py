# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predict for the angles that bags hold, and write a log as the node does."""

import argparse
from pathlib import Path

from linkage_vibration.cli.arguments import add_inputs, read_settings
from linkage_vibration.errors import printable
from linkage_vibration.support.exit_codes import INCOMPLETE, add_strict, exit_code


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    text = ".mcap, .db3 or .bag file, the folder of a bag, or a log of a CAN bus"
    add("bags", nargs="+", type=Path, metavar="BAG", help=text)
    add("-o", "--output", type=Path, required=True, help="MCAP file to write")
    add_inputs(parser)
    add("--sign", type=int, help="crank angle = sign * scale * position + offset")
    add("--scale", type=float, help="rad per unit of position")
    add("--offset", type=float, help="rad")
    add("--table", type=Path, help="table to use (default: that of the mechanism)")
    text = "YAML file of sensors, whose signals are compared with the predictions"
    add("--sensors", type=Path, metavar="FILE", help=text)
    add("--implement-mass", type=float, help="kg; predict as if the implement had this mass")
    text = "kg m2; predict as if the implement had this moment of inertia"
    add("--implement-inertia", type=float, help=text)
    add_strict(parser, "a prediction has no numbers or a message was left out")


def run(options: argparse.Namespace) -> int:
    """Replay the bags into one log and print a summary; return the exit code."""
    from linkage_vibration.playback.remapping import remappings
    from linkage_vibration.playback.replay import WhatIf, problems, replay, replay_summary
    from linkage_vibration.support.atomic_files import check_output

    check_output(options.output, ".mcap", [*options.bags, *filter(None, [options.params_file])])
    given = {f"hitch_{name}": getattr(options, name) for name in ("sign", "scale", "offset")}
    given |= {"joint_name": options.joint, "table_file": options.table}
    given["sensor_file"] = options.sensors
    settings = read_settings(options, **given)
    what_if = WhatIf(options.implement_mass, options.implement_inertia)
    if what_if != WhatIf() or settings.table_path() is None:
        print("The table of this mechanism is built first.")
    done = replay(options.bags, options.output, settings, remappings(options.remap), what_if)
    print(f"{options.output}: {printable(replay_summary(done))}")
    code = exit_code(problems(done), options.strict)
    return code if done.with_numbers else INCOMPLETE
