# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""From the command line to the exit code."""

from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

import rclpy
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import RCLError

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.settings import NODE_NAME
from linkage_vibration.ros.lifecycle import LinkageVibrationNode

EVENTS_SINCE = (9, 1, 2)  # of rclpy; before, its events executor awaits no service
WATCH_PERIOD = 0.2  # s, between two looks whether a signal came


def run(args: list[str] | None, stop_asked: Callable[[], bool]) -> int:
    """Run the node until a signal comes, and return the exit code.

    Parameters
    ----------
    args : list of str, optional
        The command line.
    stop_asked : callable
        Whether a signal came. rclpy hears none: it would take the context away from a callback that
        is about to publish.
    """
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RCLError as error:
        get_logger(NODE_NAME).fatal(" ".join(str(error).split()))
        return 1
    try:
        _spin(stop_asked)
    except LinkageVibrationError as error:
        get_logger(NODE_NAME).fatal(str(error))
        return 1
    except ExternalShutdownException:
        pass
    finally:
        rclpy.try_shutdown()
    return 0


def _spin(stop_asked: Callable[[], bool]) -> None:
    node = LinkageVibrationNode(stop_asked)
    try:
        if node.autostart:
            node.start()
        executor = _executor()
        node.executor = executor
        try:
            while rclpy.ok() and not stop_asked():
                with suppress(InvalidHandle):  # of what was destroyed as something came for it
                    executor.spin_once(WATCH_PERIOD)
        finally:
            executor.shutdown()  # before what it looks after is destroyed
    finally:
        node.close()


def _executor() -> Executor:
    """Return the executor that answers soonest (`python -m benchmark.latency`).

    The single-threaded one looks at all the services whenever anything comes, and the
    multi-threaded one delays and loses messages under load.
    """
    try:
        found = tuple(int(part) for part in version("rclpy").split(".")[:3])
    except (PackageNotFoundError, ValueError):
        found = ()
    if found < EVENTS_SINCE:
        return SingleThreadedExecutor()
    from rclpy.experimental.events_executor import EventsExecutor

    return EventsExecutor()
