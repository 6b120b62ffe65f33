# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Records the node's messages, from its activation or from a request."""

import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from rclpy.node import Node
from std_srvs.srv import Trigger

from linkage_vibration.bags.recorder import FullFolderError, Recorder
from linkage_vibration.bags.writing import LogError
from linkage_vibration.prediction.settings import ParameterError, Parameters
from linkage_vibration.ros.endpoints import MessageInfo


def log_folder(settings: Parameters) -> Path:
    """Return the folder of the logs, or raise a `ParameterError` if no file can be made in it."""
    folder = settings.log_path()
    if settings.log_directory and not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
        raise ParameterError(
            f"Parameter log_directory must be a folder to which the node may write, not "
            f"{folder}; create it, or name another one."
        )
    return folder


class Recording:
    """Offers to start and stop a log; ``begin`` calls a function while no message is answered."""

    def __init__(
        self, node: Node, recorder: Recorder, begin: Callable[[Callable[[], None]], None]
    ) -> None:
        self.recorder, self._node, self._begin = recorder, node, begin
        self._active = self._stopped = False
        self._services = [
            node.create_service(Trigger, "~/start_recording", self._on_start),
            node.create_service(Trigger, "~/stop_recording", self._on_stop),
        ]

    def activate(self, *, begin: bool) -> None:
        """Allow recording, and begin it if wanted; a folder or a disk that is full is no error."""
        self._stopped = False
        if begin:
            try:
                self._start(wait=True)
            except FullFolderError as error:
                self.recorder.news.append(error)
        self._active = True

    def deactivate(self) -> None:
        """Complete the log, if there is one, and allow no other."""
        self._active = False
        self._stop()

    def close(self) -> None:
        """Destroy the services."""
        for service in self._services:
            self._node.destroy_service(service)

    def write(
        self, topic: str, data: bytes, received: int, info: MessageInfo, *answers: tuple[str, bytes]
    ) -> None:
        """Record a message that was received at a time (ns), and with it the node's answers."""
        # A simulated clock is at zero until it runs; such times would make the log useless.
        if self.recorder.active and received > 0:
            now = time.time_ns()
            replies = [(name, answer, received, now) for name, answer in answers]
            sent = info["source_timestamp"] or received
            self.recorder.write([(topic, data, received, sent), *replies])

    def report_end(self) -> None:
        """Log where the recorded file is, and a failure that was not reported yet."""
        self.watch()
        if self.recorder.path is not None:
            self._node.get_logger().info(f"Log: {self.recorder.path}")

    def watch(self) -> None:
        """Log what the recorder reports, once a second; its fault ends when it has stopped."""
        while self.recorder.news:
            item = self.recorder.news.popleft()
            if isinstance(item, LogError):
                self._node.get_logger().error(f"{item} The predictions continue.")
            else:
                self._node.get_logger().info(item)
        if self._stopped and not self.recorder.recording:
            self.recorder.error = None

    def _start(self, *, wait: bool = False) -> None:
        self._stopped &= self.recorder.recording  # a disk that hangs keeps the log from its end
        self._begin(partial(self.recorder.start, wait=wait))
        if self.recorder.path is not None:
            self._node.get_logger().info(f"Recording to {self.recorder.path}")

    def _stop(self) -> LogError | None:
        """Complete the log, if there is one; return the error if that fails."""
        before = self.recorder.error
        self.recorder.stop()
        self._stopped, error = True, self.recorder.error
        self.watch()
        return None if error is before else error

    def _on_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._active:
            response.message = "The node is inactive; activate it first."
            return response
        try:
            self._start()
            response.success, response.message = True, str(self.recorder.path)
        except LogError as error:
            response.message = str(error)
        return response

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not (self.recorder.active or self.recorder.error):
            response.message = "Nothing is being recorded; call start_recording first."
            return response
        recorded, fault = self.recorder.active, self.recorder.error
        error, path = self._stop(), self.recorder.path
        if recorded and path is None:
            error = fault
        elif recorded and error is None and path is not None and not path.exists():
            error = LogError(f"{path} was removed while it was being recorded.")
        response.success, response.message = error is None, str(error or path or "")
        if response.success:
            self.report_end()
        return response
