# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The ``linkage-vibration`` command and the list of its subcommands."""

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.exit_codes import FAILED, ended_by_signals
from linkage_vibration.support.missing_library import missing_library
from linkage_vibration.support.version import VERSION, check_versions

# Each is a module of this room. Its docstring is the help text, `add_arguments` declares what it
# takes, and `run` does the work and returns the exit code. The modules import nothing slow at their
# top, so the parser is built quickly.
SUBCOMMANDS = (
    "build",
    "pose",
    "predict",
    "plot",
    "advise",
    "inclinometer",
    "measure",
    "calibrate",
    "plan",
    "export",
    "recover",
    "replay",
    "review",
    "diff",
    "summary",
    "demo",
    "play",
    "watch",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command (default: with the arguments of the process); return its exit code."""
    options = argument_parser().parse_args(arguments)
    # The matrices are small, so BLAS threads cost more time in waiting for each other than they
    # save. NumPy reads this variable when it is first imported, which is after this line.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        check_versions()
        with ended_by_signals():
            return int(options.run(options))
    except LinkageVibrationError as error:
        print(f"linkage-vibration: {error}", file=sys.stderr)
        return FAILED
    except ImportError as error:
        print(f"linkage-vibration: {missing_library(error)}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        return 130


def argument_parser() -> argparse.ArgumentParser:
    """Return the parser of the command, which has one subparser for each subcommand."""
    parser = argparse.ArgumentParser(
        prog="linkage-vibration",
        description="Predict how a linkage vibrates in each of its configurations.",
    )
    parser.add_argument("--version", action="version", version=VERSION)
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for name in SUBCOMMANDS:
        module = import_module(f"linkage_vibration.cli.{name}")
        text = (module.__doc__ or "").strip()
        subparser = subparsers.add_parser(name, help=text.partition("\n")[0], description=text)
        module.add_arguments(subparser)
        subparser.set_defaults(run=module.run)
    return parser
