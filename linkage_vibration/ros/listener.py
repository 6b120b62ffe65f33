# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Receives the inputs on a thread of its own, so that no service or timer delays a reading."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import wraps
from typing import Any, cast

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from linkage_vibration.prediction.inputs.presets import INPUT_DEPTH
from linkage_vibration.prediction.settings import ParameterError
from linkage_vibration.ros.endpoints import OVERRIDES, qos, unmatched

WAKE_PERIOD = 1.0  # s; without a limit, the events executor blocks the other threads


class Listener:
    """Subscriptions on a node of their own, without services, and a thread of its own.

    An executor of rclpy looks at all services for each message, or takes both in the order of
    arrival, which would delay readings. The node is named as its owner, with ``_readings`` added.
    """

    def __init__(self, owner: Node) -> None:
        self._node = Node(
            f"{owner.get_name()}_readings",
            namespace=owner.get_namespace(),
            context=owner.context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[
                Parameter("start_type_description_service", value=False),
                *owner.get_parameters_by_prefix("qos_overrides").values(),
            ],
        )
        self._executor: Executor = EventsExecutor(context=owner.context)
        self._executor.add_node(self._node)
        self._pool = ThreadPoolExecutor(1, "linkage_vibration_readings")
        self._spinning: Future[None] | None = None
        self._stopping = False

    @property
    def active(self) -> bool:
        """Whether messages are received."""
        return self._spinning is not None

    def subscribe(self, kind: Any, topic: str, on_message: Callable[..., None]) -> Any:
        """Return a best-effort subscription; its callback gets bytes and the `MessageInfo`."""

        @wraps(on_message)
        def call(*args: Any) -> None:
            # The events executor (rclpy 9.1) passes both in one tuple.
            on_message(*(args if len(args) == 2 else args[0]))

        try:
            return self._node.create_subscription(
                kind,
                topic,
                cast(Any, call),  # the type hints of rclpy do not know that `raw` passes bytes
                qos(reliable=False, latched=False, depth=INPUT_DEPTH),
                raw=True,
                # The events executor ends the process if an event comes as its subscription is
                # destroyed.
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
                qos_overriding_options=OVERRIDES,
            )
        except RuntimeError:  # of rcl; DDS has one type for each topic in a process
            raise ParameterError(
                f"Topic {topic} cannot be read as {kind.__module__.partition('.')[0]}/msg/"
                f"{kind.__name__}, because this process uses it with another type; choose another "
                "topic, or its type."
            ) from None

    def unmatched(self) -> dict[str, list[str]]:
        """Return by topic a sentence about each publisher whose QoS does not match."""
        publishers, own = self._node.get_publishers_info_by_topic, self._node.subscriptions
        return {s.topic_name: unmatched(s, publishers(s.topic_name), "publisher") for s in own}

    def unsubscribe(self) -> None:
        """Destroy all subscriptions, so that their topics can be read as other types."""
        for subscription in list(self._node.subscriptions):
            self._node.destroy_subscription(subscription)
        self._spin_once(0.0)  # the executor keeps them, and so the topics, until it looks again

    def start(self) -> None:
        """Receive messages from now on."""
        self._stopping = False
        self._spinning = self._pool.submit(self._spin)

    def stop(self) -> None:
        """Receive no more messages; a callback ends first, and what it raised is raised here."""
        if self._spinning is not None:
            self._stopping, ended, self._spinning = True, self._spinning, None
            self._executor.create_task(lambda: None)  # so that it does not wait for a message
            ended.result()

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Let messages wait in their queues, while what their callbacks use is changed."""
        active = self.active
        self.stop()
        try:
            yield
        finally:
            if active:
                self.start()

    def check(self) -> None:
        """Raise what a callback has raised."""
        if self._spinning is not None and self._spinning.done():
            self.stop()

    def close(self) -> None:
        """Stop, and destroy the node."""
        self.stop()
        self._pool.shutdown()
        self._executor.shutdown()
        self._node.destroy_node()

    def _spin(self) -> None:
        while not self._stopping and self._spin_once(WAKE_PERIOD):
            pass

    def _spin_once(self, seconds: float) -> bool:
        """Receive messages for a while; return whether there may be others."""
        with suppress(ExternalShutdownException):
            with suppress(InvalidHandle):  # a message of a subscription that was destroyed
                self._executor.spin_once(seconds)
            return True
        return False
