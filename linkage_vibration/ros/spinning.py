# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""From the command line to the exit code."""

from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions, install_signal_handlers
from rclpy.subscription import RCLError

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.ros.lifecycle import NODE_NAME, LinkageVibrationNode


def run(args: list[str] | None, stop_asked: Callable[[], bool]) -> int:
    """Run the node until a signal comes, and return the exit code.

    Parameters
    ----------
    args : list of str, optional
        The command line.
    stop_asked : callable
        Whether a signal came that rclpy did not hear.
    """
    try:
        # A context that goes in the middle of a transition would be complained of.
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
    except RCLError:
        # What a signal interrupts may find its context gone.
        if rclpy.ok():
            raise
    finally:
        rclpy.try_shutdown()
    return 0


def _spin(stop_asked: Callable[[], bool]) -> None:
    node = LinkageVibrationNode(stop_asked)
    try:
        if node.autostart:
            node.start()
        install_signal_handlers(SignalHandlerOptions.ALL)
        # Single-threaded: the multi-threaded executor delays and loses messages under load, and the
        # events executor (about two thirds of the latency, in rclpy 9.1) never calls back with the
        # time of sending, which the log keeps.
        if not stop_asked():
            rclpy.spin(node)
    finally:
        node.close()
