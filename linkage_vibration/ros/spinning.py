# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Spins the node until a signal arrives, and returns its exit code."""

import faulthandler
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from threading import Thread
from warnings import catch_warnings, simplefilter

import rclpy
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.settings import NODE_NAME
from linkage_vibration.ros.command_line import (
    check_arguments,
    help_text,
    start_errors,
    unused_files,
)
from linkage_vibration.ros.lifecycle import LinkageVibrationNode

# Longest time for which a thread that answers a request holds Python's lock while a reading waits.
# Python's own value is 5 ms.
SWITCH_INTERVAL = 2e-4  # s
# If the middleware blocks the end for so long, the process says where, and ends with exit code 1.
END_LIMIT = 60.0  # s


def run(args: list[str] | None, stop_asked: Callable[[], bool]) -> int:
    """Run the node until a signal arrives, which ends it at once; return the exit code.

    ``stop_asked`` says whether a signal has arrived: rclpy, which handles none here, would end the
    context while a callback is about to publish.
    """
    sys.setswitchinterval(SWITCH_INTERVAL)
    arguments = sys.argv if args is None else args
    if {"-h", "--help"} & set(arguments[1:]):
        print(help_text(), end="")
        return 0
    try:
        check_arguments(arguments[1:])
        with start_errors(), catch_warnings():
            simplefilter("ignore", RuntimeWarning)  # of rcl, as it cleans up after an error
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
            node = LinkageVibrationNode(stop_asked)
        with closing(node):
            for problem in unused_files(arguments, node.get_fully_qualified_name()):
                node.get_logger().warning(problem)
            _spin(node, stop_asked)
    except LinkageVibrationError as error:
        get_logger(NODE_NAME).fatal(str(error))
        return 1
    except ExternalShutdownException:
        pass
    finally:
        rclpy.try_shutdown()
        faulthandler.cancel_dump_traceback_later()
    return 0


def _spin(node: LinkageVibrationNode, stop_asked: Callable[[], bool]) -> None:
    if node.autostart:
        node.start()
    else:
        node.get_logger().info(
            "Waiting for a lifecycle manager, because autostart is false; or run "
            f"`ros2 lifecycle set {node.get_fully_qualified_name()} configure`."
        )
    node.executor = executor = SingleThreadedExecutor()
    try:
        with _woken_by_signals(executor):
            while rclpy.ok() and not stop_asked():
                node.serve(executor)
            faulthandler.dump_traceback_later(END_LIMIT, exit=True, file=2)
            if rclpy.ok():
                node.answer_waiting(executor)
    finally:
        executor.shutdown()  # before the node's entities are destroyed
        node.executor = None  # no waiting request can be answered any more


@contextmanager
def _woken_by_signals(executor: Executor) -> Iterator[None]:
    """Let a signal end a turn of the executor, as Python calls its handlers between turns only."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)

    def wake() -> None:
        if os.read(reader, 1):
            executor.create_task(lambda: None)

    waking = Thread(target=wake, name="linkage_vibration_signals")
    waking.start()
    signal.set_wakeup_fd(writer)
    try:
        yield
    finally:
        signal.set_wakeup_fd(-1)
        os.close(writer)  # this ends the thread
        waking.join()
        os.close(reader)
