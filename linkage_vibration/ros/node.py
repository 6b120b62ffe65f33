# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's process, which ends cleanly by SIGINT, SIGTERM and SIGHUP."""

import os
import signal
import sys
from collections.abc import Callable
from types import FrameType

from linkage_vibration.support.missing_library import missing_library
from linkage_vibration.support.version import OldLibraryError, check_versions

STOP_SIGNALS = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP, and return the exit code."""
    # A sourced ROS 2 sets this; the wheels, which are in the Python environment, do not.
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    # The matrices are small; BLAS threads would only keep cores from the readings.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # The import of ROS 2 and SciPy takes a second or more, in which nothing has to be completed.
    _handle_signals(lambda number, frame: os._exit(0))
    try:
        check_versions()
        from linkage_vibration.ros.spinning import run

        return run(args, _note_signals())
    except (OldLibraryError, ImportError) as error:
        problem = missing_library(error) if isinstance(error, ImportError) else error
        print(f"linkage_vibration_node: {problem}", file=sys.stderr)
        return 1
    finally:
        # Python restores its own handlers as it ends; a late signal would then kill the process.
        for number in STOP_SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def _handle_signals(handler: Callable[[int, FrameType | None], None]) -> None:
    """Handle the signals that end the process."""
    for number in STOP_SIGNALS:
        # A node that nohup started keeps running after its terminal has closed.
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)


def _note_signals() -> Callable[[], bool]:
    """Only note that a signal has arrived; return a function that says whether one has.

    KeyboardInterrupt could interrupt a write to the log, and a second signal kill a process that is
    ending. Masks do not help, as libraries start threads while they are imported.
    """
    arrived = False

    def note(_: int, __: FrameType | None) -> None:
        nonlocal arrived
        arrived = True

    _handle_signals(note)
    return lambda: arrived


if __name__ == "__main__":
    sys.exit(main())
