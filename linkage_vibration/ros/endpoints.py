# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the parts of the node share: endpoints with its QoS, and warnings that are not repeated."""

import time
from collections.abc import Callable, Mapping
from functools import wraps
from importlib import import_module
from typing import Any, cast

from rclpy.event_handler import (
    PublisherEventCallbacks,
    QoSOfferedIncompatibleQoSInfo,
    SubscriptionEventCallbacks,
)
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

from linkage_vibration.bags.writing import QUEUE_DEPTH
from linkage_vibration.errors import printable
from linkage_vibration.messages.topics import OUTPUT_TOPICS, NodeTopic
from linkage_vibration.ros.statistics import Statistics

MessageInfo = Mapping[str, Any]  # where a message comes from; rclpy 7 has no name for it

WARN_PERIOD = 5.0  # s, between two warnings about the same subject
QOS_VALUES = {
    "depth": range(1, QUEUE_DEPTH + 1),
    "durability": ("volatile", "transient_local"),
    "reliability": ("reliable", "best_effort"),
}
"""What parameters below ``qos_overrides`` can say about the topics of inputs and outputs."""
OUTPUTS = tuple(topic for topic in OUTPUT_TOPICS if topic.name.startswith("~"))
"""The topics that exist while the node is configured."""


def advertise(node: Node, output: NodeTopic, statistics: Statistics, throttle: "Throttle") -> Any:
    """Return a reliable publisher that counts and reports subscribers whose QoS does not match.

    Subscriptions have no QoS events, because the events executor of rclpy, which does not spin this
    node, ends the process if an event comes as one of them is destroyed.
    """
    topic = node.resolve_topic_name(output.name)

    def on_mismatch(event: QoSOfferedIncompatibleQoSInfo) -> None:
        statistics.qos_mismatches[topic] += event.total_count_change
        throttle.warn(
            f"subscriber of {topic}",
            f"A subscriber of {topic} asks for a QoS that this node does not offer "
            f"({qos_policy_name_from_kind(event.last_policy_kind)}), so it receives nothing. "
            "Subscribe volatile, and reliable or best effort.",
        )

    return node.create_publisher(
        message_class(output.type),
        output.name,
        _qos(reliable=True, latched=output.latched, depth=1 if output.latched else QUEUE_DEPTH),
        event_callbacks=PublisherEventCallbacks(incompatible_qos=on_mismatch),
        qos_overriding_options=_overrides(),
    )


def _overrides() -> QoSOverridingOptions:
    return QoSOverridingOptions([QoSPolicyKind[name.upper()] for name in QOS_VALUES])


def subscribe(
    node: Node,
    kind: Any,
    topic: str,
    on_message: Callable[..., None],
    *,
    latched: bool = False,
    input_depth: int = 0,
) -> Any:
    """Return a subscription, which matches publishers of every QoS and waits for no lost message.

    ``on_message`` gets the bytes and the `MessageInfo`. A latched one receives what was sent
    before. That of an input keeps so many messages, and parameters can override its QoS.
    """

    @wraps(on_message)
    def call(*args: Any) -> None:
        # The events executor (rclpy 9.1) passes both in one tuple.
        on_message(*(args if len(args) == 2 else args[0]))

    return node.create_subscription(
        kind,
        topic,
        cast(Any, call),  # the type hints of rclpy do not know that `raw` passes bytes
        _qos(reliable=latched, latched=latched, depth=input_depth or QUEUE_DEPTH),
        raw=True,
        event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),  # see `advertise`
        qos_overriding_options=_overrides() if input_depth else None,
    )


def message_class(type_name: str) -> Any:
    """Return the class of a message such as ``std_msgs/msg/String``, or of a part of a service.

    It raises an ImportError or an AttributeError if its package is not installed, or lacks it.
    """
    package, kind, name = type_name.split("/")
    module = import_module(f"{package}.{kind}")
    service, _, part = name.rpartition("_")  # such as SetBool_Event
    return getattr(getattr(module, service), part) if service else getattr(module, name)


def _qos(*, reliable: bool, latched: bool, depth: int) -> QoSProfile:
    """Return a new profile, because the overrides of rclpy change shared profiles in place."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class Throttle:
    """Logs warnings, at most one in WARN_PERIOD about each subject.

    The throttle of rclpy takes longer to suppress a message than a whole prediction takes.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._next: dict[str, float] = {}
        self._lasting: set[str] = set()

    def warn(self, subject: str, text: str) -> None:
        """Log a warning, unless there was one about the same subject just before."""
        now = time.monotonic()
        if now >= self._next.get(subject, 0.0):
            self._next[subject] = now + WARN_PERIOD
            self._logger.warning(printable(text))

    def report(self, subject: str, problem: str) -> None:
        """Log a problem once, until it has ended, which an empty sentence says."""
        if problem and subject not in self._lasting:
            self._lasting.add(subject)
            self._logger.warning(printable(problem))
        elif not problem:
            self._lasting.discard(subject)
