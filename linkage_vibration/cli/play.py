# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Publish the crank angles and speeds of a bag for a running node."""

import argparse
from pathlib import Path

from linkage_vibration.cli.arguments import add_remap


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = ".mcap, .db3 or .bag file, folder of a bag, or log of a CAN bus (default: the drive)"
    parser.add_argument("bag", nargs="?", type=Path, metavar="BAG", help=text)
    add_remap(parser)


def run(options: argparse.Namespace) -> int:
    """Play the bag once; return the exit code."""
    from linkage_vibration.playback.remapping import remappings
    from linkage_vibration.ros.bag_player import play_bag
    from linkage_vibration.support.resources import config_file

    bag = options.bag or config_file("drives/hitch_duty_cycle.mcap")
    count = play_bag(bag, None, remappings(options.remap), lambda text: print(text, flush=True))
    print(f"{count} messages were published.")
    return 0
