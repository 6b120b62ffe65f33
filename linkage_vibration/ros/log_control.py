# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Logs what the node hears and says, from its start or when it is asked to."""

import time
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.subscription import MessageInfo
from std_srvs.srv import Trigger

from linkage_vibration.bags.recorder import Recorder
from linkage_vibration.bags.writing import LogError
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.topics import log_topic
from linkage_vibration.ros.endpoints import message_class, subscribe
from linkage_vibration.ros.throttle import Throttle


class Recording:
    """Offers ``~/start_recording`` and ``~/stop_recording``, and hears topics to be logged beside.

    Parameters
    ----------
    node : Node
        To offer them on.
    recorder : Recorder
        Not begun yet.
    own_topics : set of str
        What `write` is called for.
    extra_topics : set of str
        Others to be logged, as soon as their types are known.
    throttle : Throttle
        Warns of those that cannot be.

    Attributes
    ----------
    recorder : Recorder
        The same.
    """

    def __init__(
        self,
        node: Node,
        recorder: Recorder,
        own_topics: set[str],
        extra_topics: set[str],
        throttle: Throttle,
    ) -> None:
        self.recorder = recorder
        self._node, self._throttle = node, throttle
        self._extra_topics = extra_topics - own_topics
        self._heard: dict[str, Any] = {}
        self._active = self._error_told = False
        self._services = [
            node.create_service(Trigger, "~/start_recording", self._on_start),
            node.create_service(Trigger, "~/stop_recording", self._on_stop),
        ]

    def activate(self, *, begin: bool) -> None:
        """Allow recording, and begin it where that is asked for.

        Raises
        ------
        LogError
            If it cannot begin.
        """
        if begin:
            self._start()
        self._active = True

    def deactivate(self) -> None:
        """Complete the log, if any, and allow none."""
        self._active = False
        for subscription in self._heard.values():
            self._node.destroy_subscription(subscription)
        self._heard.clear()
        self.recorder.stop()

    def close(self) -> None:
        """Take the services back."""
        for service in self._services:
            self._node.destroy_service(service)

    def write(self, topic: str, data: bytes, received: int, info: MessageInfo | None) -> None:
        """Log a message that came, or one of ours (which has no info) as it is handed to DDS.

        Parameters
        ----------
        received : int
            When it came, or that came which it answers, ns.
        """
        # A simulated clock reads zero until it runs; such times would spoil the log.
        if self.recorder.active and received > 0:
            sent = info["source_timestamp"] if info is not None else time.time_ns()
            self.recorder.write(topic, data, received, sent or received)

    def watch(self) -> None:
        """Hear those topics whose type has become known, and tell of a failure; once a second."""
        if self._active and self._extra_topics - self._heard.keys():
            for topic, types in self._node.get_topic_names_and_types():
                if topic in self._extra_topics and topic not in self._heard:
                    self._hear(topic, types[0])
        error = self.recorder.error
        if error is not None and not self._error_told:
            self._error_told = True
            self._node.get_logger().error(f"{error} Predictions go on.")

    def tell_end(self) -> None:
        """Tell where the log is, and of a failure that was not told yet."""
        logger = self._node.get_logger()
        if self.recorder.error is not None and not self._error_told:
            logger.error(f"{self.recorder.error} Predictions went on.")
        if self.recorder.path is not None:
            logger.info(f"Log: {self.recorder.path}")

    def _hear(self, topic: str, type_name: str) -> None:
        try:
            kind = message_class(type_name)
            self.recorder.add_topic(log_topic(topic, type_name))
        except (LinkageVibrationError, ImportError, AttributeError) as error:
            self._throttle.warn(topic, f"{topic} cannot be logged: {error}")
            return
        self._heard[topic] = subscribe(self._node, kind, topic, partial(self._on_message, topic))

    def _on_message(self, topic: str, data: bytes, info: MessageInfo) -> None:
        self.write(topic, data, self._node.get_clock().now().nanoseconds, info)

    def _start(self) -> Path | None:
        self._error_told = False
        self.recorder.start()
        self._node.get_logger().info(f"Recording to {self.recorder.path}")
        return self.recorder.path

    def _on_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._active:
            response.message = "The node is inactive; activate it first."
            return response
        try:
            response.message = str(self._start())
        except LogError as error:
            response.message = str(error)
        else:
            response.success = True
        return response

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self.recorder.active:
            response.message = "Nothing is being recorded."
            return response
        self.recorder.stop()
        response.success, response.message = True, str(self.recorder.path)
        self._node.get_logger().info(f"Log: {self.recorder.path}")
        return response
