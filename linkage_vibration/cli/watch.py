# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Show the predictions of a running node in one live line, until Ctrl-C."""

import argparse
import sys

from linkage_vibration.cli.arguments import warn


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = "name of the node with its namespace (default: %(default)s)"
    parser.add_argument("--node", default="/linkage_vibration", metavar="NAME", help=text)


def run(options: argparse.Namespace) -> int:
    """Show the predictions until Ctrl-C."""
    from contextlib import closing, suppress

    from linkage_vibration.drawing.live_line import LiveLine
    from linkage_vibration.ros.bag_player import watch

    with closing(LiveLine(sys.stdout)) as live, suppress(KeyboardInterrupt):
        watch(options.node, live.show, live.take, warn)
    return 0
