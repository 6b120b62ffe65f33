# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Play a recorded drive to the node and show what it predicts."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--bag", type=Path, help="bag to play (default: the shipped drive)")
    text = "joint to follow; its range of motion is mapped onto the stroke"
    parser.add_argument("--joint", help=text)
    text = "folder to write to (default: %(default)s)"
    parser.add_argument("-o", "--output", type=Path, default=Path("demo"), help=text)


def run(options: argparse.Namespace) -> int:
    """Run the demonstration; return its exit code."""
    from linkage_vibration.demo.demo import run_demo

    return run_demo(options.bag, options.joint, options.output)
