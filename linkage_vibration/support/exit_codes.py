# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reports what is wrong with the result of a command, and ends commands cleanly on signals."""

import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from argparse import ArgumentParser

from linkage_vibration.errors import printable

FAILED, INCOMPLETE = 1, 3  # argparse uses 2
_SIGNALS = (signal.SIGTERM, signal.SIGHUP)


def add_strict(parser: "ArgumentParser", problems: str) -> None:
    """Declare the option ``--strict``, with which these problems of the command are failures."""
    text = f"end with exit code {INCOMPLETE} if {problems}"
    parser.add_argument("--strict", action="store_true", help=text)


def exit_code(problems: Sequence[str], strict: bool) -> int:
    """Print problems, a sentence each, to the standard error; return the exit code."""
    for problem in problems:
        print(f"linkage-vibration: {printable(problem)}", file=sys.stderr)
    return INCOMPLETE if problems and strict else 0


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Let SIGTERM and SIGHUP raise SystemExit, so that temporary files are removed."""

    def end(number: int, frame: FrameType | None) -> None:
        for other in _SIGNALS:
            signal.signal(other, signal.SIG_IGN)  # The second one must not stop the removal.
        raise SystemExit(128 + number)

    earlier = {}
    if threading.current_thread() is threading.main_thread():
        # A signal that is ignored, as SIGHUP by nohup, remains ignored.
        earlier = {s: h for s in _SIGNALS if (h := signal.getsignal(s)) == signal.SIG_DFL}
    for number in earlier:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in earlier.items():
            signal.signal(number, handler)
