# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How the node's topics are published and heard."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from importlib import import_module
from typing import Any, cast

from rclpy.event_handler import (
    PublisherEventCallbacks,
    QoSOfferedIncompatibleQoSInfo,
    SubscriptionEventCallbacks,
)
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)

from linkage_vibration.bags.writing import QUEUE_DEPTH
from linkage_vibration.ros.diagnostics import Statistics
from linkage_vibration.ros.throttle import Throttle
from linkage_vibration_interfaces.msg import Resonance, VibrationPrediction


@dataclass(frozen=True, slots=True)
class Publishers:
    """What live predictions go out by; there as long as the node, whatever its state.

    In rclpy 9.1 a publisher or subscription that has QoS events must not be destroyed while the
    events executor is at work: an event that comes meanwhile ends the process. All others of the
    node are without.
    """

    predictions: Any
    resonances: Any


def publishers(node: Node, statistics: Statistics, throttle: Throttle) -> Publishers:
    """Return reliable publishers that tell of subscribers whose QoS they cannot serve."""

    def advertised(kind: Any, name: str) -> Any:
        topic = node.resolve_topic_name(name)

        def deaf(event: QoSOfferedIncompatibleQoSInfo) -> None:
            statistics.qos_mismatches[topic] += event.total_count_change
            throttle.warn(
                f"subscriber of {topic}",
                f"A subscriber of {topic} asks for a QoS that this "
                f"node does not offer ({qos_policy_name_from_kind(event.last_policy_kind)}); it "
                "receives nothing. Subscribe volatile, reliable or best effort.",
            )

        events = PublisherEventCallbacks(incompatible_qos=deaf)
        qos = _qos(ReliabilityPolicy.RELIABLE)
        return node.create_publisher(kind, name, qos, event_callbacks=events)

    return Publishers(
        advertised(VibrationPrediction, "~/prediction"), advertised(Resonance, "~/resonance")
    )


def publisher(node: Node, kind: Any, name: str, *, latched: bool = False) -> Any:
    """Return a reliable publisher of one message, which may be destroyed at any time.

    A latched one keeps the message for those who subscribe later.
    """
    qos = _qos(ReliabilityPolicy.RELIABLE)
    qos.depth = 1
    if latched:
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    events = PublisherEventCallbacks(use_default_callbacks=False)
    return node.create_publisher(kind, name, qos, event_callbacks=events)


def subscribe(node: Node, kind: Any, topic: str, heard: Callable[..., None]) -> Any:
    """Return a subscription that hands out a message's bytes and its `MessageInfo`.

    Best effort and volatile hears publishers of every QoS, and never waits for a lost message.
    """

    @wraps(heard)
    def call(*args: Any) -> None:
        # The events executor (rclpy 9.1) hands both over as one.
        heard(*(args if len(args) == 2 else args[0]))

    # rclpy's type hints do not know that `raw` hands out bytes.
    return node.create_subscription(
        kind,
        topic,
        cast(Any, call),
        _qos(ReliabilityPolicy.BEST_EFFORT),
        raw=True,
        event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),  # see Publishers
    )


def message_class(type_name: str) -> Any:
    """Return the Python class of a type such as ``std_msgs/msg/String``.

    Raises
    ------
    ImportError, AttributeError
        If its package is not installed, or has no such type.
    """
    package, _, name = type_name.partition("/msg/")
    return getattr(import_module(f"{package}.msg"), name)


def _qos(reliability: ReliabilityPolicy) -> QoSProfile:
    """Return a profile of its own: rclpy's overrides change the shared ones in place."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=QUEUE_DEPTH,
        reliability=reliability,
        durability=DurabilityPolicy.VOLATILE,
    )
