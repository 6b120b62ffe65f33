# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Publishes the node's inputs from a bag, and receives the node's predictions."""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions

from linkage_vibration.bags.streams import Bags, open_bags
from linkage_vibration.bags.writing import QUEUE_DEPTH
from linkage_vibration.drawing.live_line import LiveLine
from linkage_vibration.playback.remapping import choose_topics
from linkage_vibration.prediction.inputs.presets import PLAIN_TYPES, PRESETS
from linkage_vibration.prediction.settings import NODE_NAME, Parameters, with_values
from linkage_vibration.ros.command_line import start_errors
from linkage_vibration.ros.endpoints import message_class
from linkage_vibration.support.resources import command
from linkage_vibration_interfaces.msg import LoadState, TableInfo, VibrationPrediction

SETTLING = 1.0  # s; a subscriber finds a publisher somewhat later than the publisher finds it
HINT_AFTER = 5.0  # s without what is waited for
LONG_WAIT = 2.0  # s between two messages
ANSWERS_DEPTH = 10_000  # 10 s at 1 kHz, in case this process cannot read them for a while


def play_bag(
    path: Path,
    settings: Parameters | None,
    remaps: Mapping[str, str],
    live: LiveLine,
    node_name: str = f"/{NODE_NAME}",
    check: Callable[[], None] = lambda: None,  # may raise an error to stop
) -> int:
    """Publish the inputs of a bag to a subscriber at their recorded times; return how many."""

    def wait(due: float) -> None:
        check()
        # It spins at least once, so that predictions are read even if publishing is late.
        executor.spin_once(max(due - time.monotonic(), 0.0))
        while (left := due - time.monotonic()) > 0.0:
            executor.spin_once(left)

    with open_bags([path]) as bags, temporary_node("linkage_vibration_play") as (node, executor):
        settings = settings or _settings(bags, remaps)
        topics = choose_topics(bags, settings, remaps)
        publishers = [
            node.create_publisher(message_class(t.type), settings.source(name).topic, QUEUE_DEPTH)
            for name, t in topics.items()
        ]
        _follow(node, node_name, live)
        hint = "check ROS_DOMAIN_ID if the node is active"
        live.say(f"Waiting for a subscriber of {publishers[0].topic_name}; {hint}.")
        while not publishers[0].get_subscription_count():
            wait(time.monotonic() + 0.05)
        wait(time.monotonic() + SETTLING)
        names = ", ".join(settings.source(name).topic for name in topics)
        live.say(f"Playing {names} of {path}.")
        count, offset = 0, math.nan
        for block in bags.blocks([topic.name for topic in topics.values()]):
            for row, recorded in enumerate((1e-9 * block.log_times).tolist()):
                if not count:
                    offset = time.monotonic() - recorded
                pause = recorded + offset - time.monotonic()
                if pause > LONG_WAIT:
                    live.say(f"The next message follows in {pause:.0f} s.")
                wait(recorded + offset)
                publishers[block.topics[row]].publish(block.message(row))
                count += 1
        for publisher in publishers:
            publisher.wait_for_all_acked()
        wait(time.monotonic() + SETTLING)
        return count


def _settings(bags: Bags, remaps: Mapping[str, str]) -> Parameters:
    """Return parameters whose presets are those of the topics in bags."""
    topics = {(topic.name, topic.type) for topic in bags.topics if topic.count}
    types = {kind for _, kind in topics if kind not in PLAIN_TYPES}
    chosen: dict[str, object] = {}
    for name, presets in PRESETS.items():
        for key, preset in sorted(presets.items(), key=lambda each: each[1].topic not in remaps):
            in_bag = preset.type in types or (f"/{preset.topic}", preset.type) in topics
            if in_bag or preset.topic in remaps:
                chosen.setdefault(f"{name}_input", key)
    return with_values(Parameters(), chosen)


def watch(node_name: str, live: LiveLine) -> None:
    """Show the answers of a node, named with its namespace, until an exception ends it."""
    with temporary_node("linkage_vibration_watch") as (node, executor):
        _follow(node, node_name, live)
        hint_at = time.monotonic() + HINT_AFTER
        while True:
            executor.spin_once(0.2)
            if time.monotonic() > hint_at and not live.received:
                hint_at = math.inf
                live.say(
                    f"No prediction of {node_name} yet. Check that the node is active, that it "
                    f"receives readings (`{command('play')}` sends some), and ROS_DOMAIN_ID."
                )


def _follow(node: Node, node_name: str, live: LiveLine) -> None:
    """Subscribe to what a live line shows of another node: predictions, load and mode names."""

    def on_table(table: TableInfo) -> None:
        live.say(f"The modes are, from the lowest: {', '.join(table.mode_names)}.")

    last = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with start_errors():
        for kind, topic, take, quality in (
            (VibrationPrediction, "prediction", live.show, ANSWERS_DEPTH),
            (LoadState, "load_state", live.take, ANSWERS_DEPTH),
            (TableInfo, "table_info", on_table, last),
        ):
            node.create_subscription(kind, f"{node_name}/{topic}", take, quality)


@contextmanager
def temporary_node(name: str) -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    """Yield a node that leaves signals to Python, and its executor."""
    context = Context()
    try:
        with start_errors():
            # The arguments of the process are not those of ROS 2, also if they have the same form.
            rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
            node = Node(name, context=context, use_global_arguments=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        try:
            yield node, executor
        finally:
            executor.shutdown()
            node.destroy_node()
    finally:
        context.try_shutdown()
