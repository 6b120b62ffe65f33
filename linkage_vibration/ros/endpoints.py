# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the parts of the node share: endpoints with its QoS, rests, and warnings, not repeated."""

import time
from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

from rclpy.duration import Infinite
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo

from linkage_vibration.bags.writing import QUEUE_DEPTH
from linkage_vibration.errors import printable
from linkage_vibration.messages.topics import OUTPUT_TOPICS, NodeTopic

MessageInfo = Mapping[str, Any]  # where a message comes from; rclpy 7 has no name for it

RESTING = 9.0  # times the processor time of the work, so that services take a tenth of a core
LONGEST_REST = 0.1  # s
WARN_PERIOD = 5.0  # s, between two warnings about the same subject
QOS_VALUES = {
    "depth": range(1, QUEUE_DEPTH + 1),
    "durability": ("volatile", "transient_local"),
    "reliability": ("reliable", "best_effort"),
}
"""What parameters below ``qos_overrides`` can say about the topics of inputs and outputs."""
OUTPUTS = tuple(topic for topic in OUTPUT_TOPICS if topic.name.startswith("~"))
"""The topics that exist while the node is configured."""
OVERRIDES = QoSOverridingOptions([QoSPolicyKind[name.upper()] for name in QOS_VALUES])


def advertise(node: Node, output: NodeTopic) -> Any:
    """Return a reliable publisher; `unmatched`, and no event, says whose QoS does not match it."""
    return node.create_publisher(
        message_class(output.type),
        output.name,
        qos(reliable=True, latched=output.latched, depth=1 if output.latched else QUEUE_DEPTH),
        event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
        qos_overriding_options=OVERRIDES,
    )


def unmatched(own: Any, others: Iterable[TopicEndpointInfo], kind: str) -> list[str]:
    """Return a sentence about each "publisher" or "subscriber" whose QoS does not match our own."""
    sentences = []
    for other in others:
        pair = own.qos_profile, other.qos_profile
        order = 1 if kind == "subscriber" else -1
        compatibility, reason = qos_check_compatible(*pair[::order])
        if compatibility == QoSCompatibility.ERROR:
            sentences.append(
                f"The {kind} {other.node_name} of {own.topic_name} has a QoS that does not match "
                f"this node's, so nothing passes ({reason.replace('ERROR: ', '').rstrip(';')}); "
                "change its QoS, or qos_overrides of this node."
            )
    return sentences


def message_class(type_name: str) -> Any:
    """Return the class of a message such as ``std_msgs/msg/String``, or of a part of a service.

    It raises an ImportError or an AttributeError if its package is not installed, or lacks it.
    """
    package, kind, name = type_name.split("/")
    module = import_module(f"{package}.{kind}")
    service, _, part = name.rpartition("_")  # such as SetBool_Event
    return getattr(getattr(module, service), part) if service else getattr(module, name)


def qos(*, reliable: bool, latched: bool, depth: int) -> QoSProfile:
    """Return a new profile, because the overrides of rclpy change shared profiles in place."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        deadline=Infinite,  # as the graph says it for the endpoints of others
        liveliness_lease_duration=Infinite,
    )


def rest(worked: float) -> None:
    """Leave the processor and Python's lock to the readings after work of so many seconds."""
    time.sleep(min(RESTING * worked, LONGEST_REST))


class Throttle:
    """Logs at most one warning in WARN_PERIOD about each subject; rclpy takes longer for that."""

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
        if not problem:
            self._lasting.discard(subject)
        elif subject not in self._lasting and time.monotonic() >= self._next.get(subject, 0.0):
            self._lasting.add(subject)
            self.warn(subject, problem)
