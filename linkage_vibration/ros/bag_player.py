# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Publishes the node's inputs from a bag, and receives the node's predictions."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions

from linkage_vibration.bags.message_types import FLOAT64
from linkage_vibration.bags.streams import Bags, open_bags
from linkage_vibration.bags.writing import QUEUE_DEPTH
from linkage_vibration.playback.remapping import choose_topics
from linkage_vibration.prediction.inputs.presets import HITCH, PRESETS
from linkage_vibration.prediction.settings import Parameters, with_values
from linkage_vibration.ros.command_line import start_errors
from linkage_vibration.ros.endpoints import message_class
from linkage_vibration_interfaces.msg import TableInfo, VibrationPrediction

SETTLING = 1.0  # s; a subscriber finds a publisher somewhat later than the publisher finds it
HINT_AFTER = 5.0  # s without what is waited for
LONG_WAIT = 2.0  # s between two messages


def play_bag(path: Path, remaps: Mapping[str, str], report: Callable[[str], None]) -> int:
    """Publish the crank angles and speeds of a bag at their recorded times; return how many.

    It begins when a subscriber of the crank angle is there. The stamps stay as recorded. ``remaps``
    has the bag's names of the node's topics; ``report`` is called with sentences for the user.
    """
    with open_bags([path]) as bags, _node("linkage_vibration_play") as node:
        settings = _settings(bags, remaps)
        topics = choose_topics(bags, settings, remaps)
        names = {name: settings.source(name).topic for name in topics}
        publishers = [
            node.create_publisher(message_class(topic.type), names[name], QUEUE_DEPTH)
            for name, topic in topics.items()
        ]
        report(f"Waiting for a subscriber of {publishers[0].topic_name}.")
        while not publishers[0].get_subscription_count():
            time.sleep(0.05)
        time.sleep(SETTLING)
        report(f"Playing {', '.join(names.values())} of {path}.")
        count, offset = 0, None
        for block in bags.blocks([topic.name for topic in topics.values()]):
            for row, log_time in enumerate(block.log_times.tolist()):
                now = time.monotonic()
                offset = now - 1e-9 * log_time if offset is None else offset
                wait = 1e-9 * log_time + offset - now
                if wait > LONG_WAIT:
                    report(f"The next message follows in {wait:.0f} s.")
                time.sleep(max(wait, 0.0))
                publishers[block.topics[row]].publish(block.message(row))
                count += 1
        for publisher in publishers:
            publisher.wait_for_all_acked()
    return count


def _settings(bags: Bags, remaps: Mapping[str, str]) -> Parameters:
    """Return parameters whose presets are those of the topics in bags."""
    topics = {(topic.name, topic.type) for topic in bags.topics if topic.count}
    types = {kind for _, kind in topics if kind != FLOAT64}
    chosen: dict[str, object] = {}
    for name, presets in PRESETS.items():
        fitting = [key for key, preset in presets.items() if preset.topic in remaps]
        fitting += [
            key
            for key, preset in presets.items()
            if preset.type in types or (f"/{preset.topic}", preset.type) in topics
        ]
        if fitting:
            chosen["input" if name == HITCH else f"{name}_input"] = fitting[0]
    return with_values(Parameters(), chosen)


def watch(node_name: str, show: Callable[[Any], None], report: Callable[[str], None]) -> None:
    """Receive the predictions of a node, named with its namespace, until an exception ends it.

    ``show`` is called with each prediction, and ``report`` with the names of the modes, and with a
    sentence if no prediction arrives at the beginning.
    """
    with _node("linkage_vibration_watch") as node:
        topic, due = f"{node_name}/prediction", time.monotonic() + HINT_AFTER
        arrived = False

        def on_prediction(prediction: VibrationPrediction) -> None:
            nonlocal arrived
            arrived = True
            show(prediction)

        def on_table(table: TableInfo) -> None:
            report(f"The modes are, from the lowest: {', '.join(table.mode_names)}.")

        last = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        with start_errors():
            node.create_subscription(VibrationPrediction, topic, on_prediction, QUEUE_DEPTH)
            node.create_subscription(TableInfo, f"{node_name}/table_info", on_table, last)
        executor = SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        while True:
            executor.spin_once(0.2)
            if not arrived and time.monotonic() > due:
                due = float("inf")
                report(
                    f"No prediction on {node.resolve_topic_name(topic)} yet. Check that the node "
                    "is active, that it receives readings (`linkage-vibration play` sends some), "
                    "and ROS_DOMAIN_ID."
                )


@contextmanager
def _node(name: str) -> Iterator[Node]:
    """Yield a node that leaves signals to Python."""
    context = Context()
    try:
        with start_errors():
            # The arguments of the process are not those of ROS 2, also if they have the same form.
            rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
            node = Node(name, context=context, use_global_arguments=False)
        try:
            yield node
        finally:
            node.destroy_node()
    finally:
        context.try_shutdown()
