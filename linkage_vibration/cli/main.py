# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The ``linkage-vibration`` command and the list of its subcommands."""

import io
import os
import re
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from itertools import chain
from typing import TYPE_CHECKING, Any

from linkage_vibration.support.exit_codes import FAILED, ended_by_signals

if TYPE_CHECKING:
    import argparse

# Each is a module of this room. Its docstring is the help text, `add_arguments` declares what it
# takes, and `run` does the work and returns the exit code. The modules import nothing slow at their
# top, so the parser is built quickly.
ROUTES = {
    "my hitch": ("pose", "plot", "predict", "advise", "measure", "calibrate", "listen"),
    "my tractor's stack": ("play", "replay", "review", "recover", "demo"),
    "my notebook and other programs": ("build", "export"),
}
SUBCOMMANDS = tuple(chain.from_iterable(ROUTES.values()))
_FORMER = {
    **{"check": "review --limits", "diff": "review --against", "summary": "review --json"},
    **{"inclinometer": "calibrate --readings", "plan": "build --plan", "watch": "play --watch"},
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command (default: with the arguments of the process); return its exit code."""
    # The matrices are small, so BLAS threads cost more time in waiting for each other than they
    # save. NumPy reads this variable when it is first imported, which is after this line.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        with ended_by_signals():
            try:
                return _run(arguments)
            finally:
                if sys.stdout is not None:
                    sys.stdout.flush()
    except BrokenPipeError:  # The reader of a pipe, such as `head`, has ended.
        _discard_output()
        return 128 + signal.SIGPIPE
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except MemoryError:
        return _fail("There is not enough memory; end other programs, or give smaller files.")
    except OSError as error:
        if not error.filename:
            _discard_output()
        # tempfile raises it where no folder for temporary files has room.
        missing = isinstance(error, FileNotFoundError)
        place = error.filename or f"The {'temporary folder' if missing else 'standard output'}"
        return _fail(f"{place} cannot be used ({error.strerror or error}); check its disk.")


def _run(arguments: Sequence[str] | None) -> int:
    from pathlib import Path

    from linkage_vibration.errors import LinkageVibrationError
    from linkage_vibration.support.atomic_files import check_paths
    from linkage_vibration.support.missing_library import missing_library
    from linkage_vibration.support.version import check_versions

    words = sys.argv[1:] if arguments is None else arguments
    parser = argument_parser()
    if words and words[0] in _FORMER:
        parser.exit(2, f"linkage-vibration: '{words[0]}' is now '{_FORMER[words[0]]}'.\n")
    options = parser.parse_args(words)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")  # for names of files in another encoding
    try:
        check_versions()
        given = [v if isinstance(v, list) else [v] for v in vars(options).values()]
        check_paths([path for paths in given for path in paths if isinstance(path, Path)])
        return int(options.run(options))
    except LinkageVibrationError as error:
        return _fail(str(error))
    except ImportError as error:
        return _fail(missing_library(error))


def _fail(text: str) -> int:
    with suppress(OSError):
        print(f"linkage-vibration: {text}", file=sys.stderr)
    return FAILED


def _discard_output() -> None:
    """Send what Python still holds of the output to nowhere, as it would try to print it again."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def argument_parser() -> "argparse.ArgumentParser":
    """Return the parser of the command, which has one subparser for each subcommand."""
    import argparse

    from linkage_vibration.support.version import VERSION

    class Parser(argparse.ArgumentParser):
        def _print_message(self, message: str, file: Any = None) -> None:
            (file or sys.stderr).write(message)  # argparse would hide that the disk is full

    described = "Predict how a linkage vibrates in each of its configurations."
    parser = Parser(prog="linkage-vibration", formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action="version", version=VERSION)
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for route, names in ROUTES.items():
        described += f"\n\n{route}:"
        for name in names:
            module = import_module(f"linkage_vibration.cli.{name}")
            text = (module.__doc__ or "").strip()
            subparser = subparsers.add_parser(name, description=text)
            described += f"\n  {name:12}{text.partition(chr(10))[0]}"
            # No option begins like a number, so "-90:-80:5" and "-120:low.csv" are no options.
            # Python itself treats only complete numbers so.
            subparser._negative_number_matcher = re.compile(r"-\.?\d")
            module.add_arguments(subparser)
            subparser.set_defaults(run=module.run)
    parser.description = described
    return parser
