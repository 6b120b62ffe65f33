# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's process, which ends well by whatever signal it is told to."""

import os
import signal
import sys
from collections.abc import Callable
from types import FrameType

STOP_SIGNALS = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP, and return the exit code."""
    # ROS 2 from wheels lies in the Python environment and leaves this unset; a sourced one sets it.
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    stop_asked = _heed_signals()
    # It takes a second to import ROS 2 and SciPy, in which signals are heeded already.
    from linkage_vibration.ros.spinning import run

    try:
        return run(args, stop_asked)
    finally:
        # As it ends, Python takes its handlers back; a late signal would kill.
        for number in STOP_SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def _heed_signals() -> Callable[[], bool]:
    """Let signals end nothing midway; return what tells whether one came.

    Nothing else may act on them: Python's KeyboardInterrupt could strike in the middle of a write
    to the log, and a second signal could kill a process that is ending well. Handlers rather than
    masks, as a signal to the process goes to any thread that does not block it, and libraries begin
    theirs as they are imported.
    """
    came = False

    def note(_: int, __: FrameType | None) -> None:
        nonlocal came
        came = True

    for number in STOP_SIGNALS:
        # Whoever started it (nohup) may want it to outlive its terminal.
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, note)
    return lambda: came


if __name__ == "__main__":
    sys.exit(main())
