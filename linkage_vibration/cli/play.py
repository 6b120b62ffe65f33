# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Publish joint states and speeds of a bag, and show the answers of a running node in one line."""

import argparse
import sys
from pathlib import Path

from linkage_vibration.cli.arguments import add_remap


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = ".mcap, .db3 or .bag file, folder of a bag, or log of a CAN bus (default: the drive)"
    parser.add_argument("bag", nargs="?", type=Path, metavar="BAG", help=text)
    add_remap(parser)
    text = "publish nothing, and show the predictions until Ctrl-C"
    parser.add_argument("--watch", action="store_true", help=text)
    text = "name of the node with its namespace (default: %(default)s)"
    parser.add_argument("--node", default="/linkage_vibration", metavar="NAME", help=text)


def run(options: argparse.Namespace) -> int:
    """Play the bag once, or watch until Ctrl-C; return the exit code."""
    from contextlib import closing, suppress

    from linkage_vibration.drawing.live_line import LiveLine
    from linkage_vibration.playback.remapping import remappings
    from linkage_vibration.ros.bag_player import play_bag, watch
    from linkage_vibration.support.resources import config_file

    with closing(LiveLine(sys.stdout)) as live:
        if options.watch:
            with suppress(KeyboardInterrupt):
                watch(options.node, live)
            return 0
        bag = options.bag or config_file("drives/hitch_duty_cycle.mcap")
        count = play_bag(bag, None, remappings(options.remap), live, options.node)
    print(f"{count} messages were published.")
    return 0
