# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Records the node's messages, from its activation or from a request."""

import os
import time
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_srvs.srv import Trigger

from linkage_vibration.bags.recorder import Recorder
from linkage_vibration.bags.writing import LogError
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.topics import log_topic
from linkage_vibration.prediction.settings import ParameterError, Parameters
from linkage_vibration.ros.endpoints import MessageInfo, Throttle, message_class, subscribe


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
    """Offers ``~/start_recording`` and ``~/stop_recording``, and subscribes to extra topics.

    The recorder is not started yet. The extra topics are recorded beside those for which `write` is
    called, once their types are known; the throttle warns of those that cannot be recorded. The
    attribute `problem` says why the last request could not start a log; it is empty if it could.
    """

    def __init__(
        self, node: Node, recorder: Recorder, extra_topics: set[str], throttle: Throttle
    ) -> None:
        self.recorder, self._extra_topics = recorder, extra_topics
        self._node, self._throttle = node, throttle
        self._subscriptions: dict[str, Any] = {}
        self._active = self._error_reported = False
        self.problem = ""
        self._services = [
            node.create_service(Trigger, "~/start_recording", self._on_start),
            node.create_service(Trigger, "~/stop_recording", self._on_stop),
        ]

    def activate(self, *, begin: bool) -> None:
        """Allow recording, and start it if ``begin`` is true; raise a `LogError` if it fails."""
        if begin:
            self._start()
        self._active = True

    def deactivate(self) -> None:
        """Complete the log, if there is one, and allow no other."""
        self._active = False
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()
        self.recorder.stop()

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

    def watch(self) -> None:
        """Subscribe to topics whose type is known by now, and report a failure; once a second."""
        if self._active and self._extra_topics - self._subscriptions.keys():
            for topic, types in self._node.get_topic_names_and_types():
                if topic in self._extra_topics and topic not in self._subscriptions:
                    self._subscribe(topic, types[0])
        self._report_error()

    def report_end(self) -> None:
        """Log where the recorded file is, and a failure that was not reported yet."""
        self._report_error()
        if self.recorder.path is not None:
            self._node.get_logger().info(f"Log: {self.recorder.path}")

    def _report_error(self) -> None:
        if self.recorder.error is not None and not self._error_reported:
            self._error_reported = True
            self._node.get_logger().error(f"{self.recorder.error} The node predicts without a log.")

    def _subscribe(self, topic: str, type_name: str) -> None:
        latched = self._is_latched(topic)
        try:
            kind = message_class(type_name)
            self.recorder.add_topic(log_topic(topic, type_name, latched=latched))
        except (LinkageVibrationError, ImportError, AttributeError) as error:
            self._throttle.warn(topic, f"{topic} cannot be recorded: {error}")
            return
        on_message = partial(self._on_message, topic)
        self._subscriptions[topic] = subscribe(self._node, kind, topic, on_message, latched=latched)

    def _is_latched(self, topic: str) -> bool:
        """Return whether all publishers of a topic send later subscribers what they sent before."""
        latched = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
        offered = [p.qos_profile for p in self._node.get_publishers_info_by_topic(topic)]
        return bool(offered) and all((q.reliability, q.durability) == latched for q in offered)

    def _on_message(self, topic: str, data: bytes, info: MessageInfo) -> None:
        self.write(topic, data, self._node.get_clock().now().nanoseconds, info)

    def _start(self) -> None:
        self._error_reported = False
        self.recorder.start()
        self._node.get_logger().info(f"Recording to {self.recorder.path}")

    def _on_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._active:
            response.message = "The node is inactive; activate it first."
            return response
        try:
            self._start()
        except LogError as error:
            self.problem = response.message = str(error)
            return response
        self.problem = ""
        response.success, response.message = True, str(self.recorder.path)
        return response

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self.recorder.active:
            response.message = "Nothing is being recorded; call start_recording first."
            return response
        self.recorder.stop()
        response.success, response.message = True, str(self.recorder.path)
        self._node.get_logger().info(f"Log: {self.recorder.path}")
        return response
