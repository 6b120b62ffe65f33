# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a node works beside, in a process of its own, with a report of what was really done.

``python -m test.support.load topics`` publishes what the lines of its input say, and
``python -m test.support.load goals NODE`` keeps a table of a node being built. Both print one line
of JSON for each report, whose time is that of the monotonic clock, and end with their input.
"""

import json
import sys
import threading
import time
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from linkage_vibration_interfaces.action import SetImplement

REPORT = 0.05  # s, between two reports of what was published
# The table of this implement needs 78 points instead of the 27 of the shipped one, and half a
# minute instead of ten seconds. It is cancelled before it is complete, so the node keeps its table.
SLOW = SetImplement.Goal(mass=1100.0, inertia=250.0)
ENOUGH = 0.6  # finished share at which a goal is cancelled
SENSOR = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


def report(**facts: Any) -> None:
    """Print a report."""
    print(json.dumps({"time": time.monotonic(), **facts}), flush=True)


def message_type(name: str) -> Any:
    """Return the class of a type such as ``sensor_msgs/msg/JointState``."""
    package, _, kind = name.split("/")
    return getattr(import_module(f"{package}.msg"), kind)


def filled(message: Any, fields: dict[str, Any]) -> Any:
    """Return a message with these values; a mapping is one of a field's own fields."""
    for name, value in fields.items():
        if isinstance(value, dict):
            filled(getattr(message, name), value)
        else:
            setattr(message, name, array("d", value) if name == "position" else value)
    return message


@dataclass
class Stream:
    """Messages of one topic, which are published in turn at a rate, Hz; none are at 0.

    The stamp of each less the time of its publication is `stamp`, s; None if its fields say it. The
    rate was set at `begun` (monotonic), and since then `count` messages were published.
    """

    publisher: Any
    kind: str
    messages: list[Any] = field(default_factory=list)
    rate: float = 0.0
    stamp: float | None = None
    begun: float = 0.0
    count: int = 0

    def publish_due(self, now: float) -> float:
        """Publish what is due now, also what is late, and return when the next message is due."""
        if not self.rate:
            return now + REPORT
        while (due := self.begun + self.count / self.rate) <= now:
            message = self.messages[self.count % len(self.messages)]
            if self.stamp is not None:
                stamped = divmod(time.time_ns() + round(1e9 * self.stamp), 10**9)
                message.header.stamp.sec, message.header.stamp.nanosec = stamped
            self.publisher.publish(message)
            self.count += 1
        return due


@dataclass
class Topics:
    """Publishes the streams, by their topics, that the last order asked for, by its number."""

    node: Any
    streams: dict[str, Stream] = field(default_factory=dict)
    number: int = 0

    def obey(self, order: dict[str, Any]) -> None:
        """Publish what an order says from now on; topics that it does not name are unchanged."""
        self.number = order.pop("number")
        for topic, asked in order.items():
            kind = asked["type"]
            if topic not in self.streams or self.streams[topic].kind != kind:
                publisher = self.node.create_publisher(message_type(kind), topic, SENSOR)
                self.streams[topic] = Stream(publisher, kind)
            stream = self.streams[topic]
            stream.messages = [filled(message_type(kind)(), each) for each in asked["cycle"]]
            stream.rate, stream.stamp = asked["rate"], asked["stamp"]
            stream.begun, stream.count = time.monotonic(), 0

    def run(self, ended: Callable[[], bool], orders: list[dict[str, Any]]) -> None:
        """Publish until the input has ended."""
        next_report, total = 0.0, dict[str, int]()
        while not ended():
            while orders:
                self.obey(orders.pop(0))
            now, due = time.monotonic(), time.monotonic() + REPORT
            for topic, stream in self.streams.items():
                before = stream.count
                due = min(due, stream.publish_due(now))
                total[topic] = total.get(topic, 0) + stream.count - before
            if now >= next_report:
                next_report = now + REPORT
                report(number=self.number, **{"published": total})
            time.sleep(max(due - time.monotonic(), 0.0))


def publish_topics(node: Any, ended: Callable[[], bool], orders: list[dict[str, Any]]) -> None:
    """Publish what the orders say until the input has ended."""
    Topics(node).run(ended, orders)


def send_goals(node: Any, name: str, ended: Callable[[], bool]) -> None:
    """Keep a table of a node being built until the input has ended; report goals and progress."""
    client: Any = ActionClient(node, SetImplement, f"{name}/set_implement")

    def wait(future: Any) -> Any:
        while not future.done() and not ended():
            rclpy.spin_once(node, timeout_sec=0.05)
        return future.result() if future.done() else None

    while not client.wait_for_server(0.5):
        if ended():
            return
    while not ended():
        progress = [0.0]

        def on_feedback(message: Any, progress: list[float] = progress) -> None:
            progress.append(message.feedback.progress)
            report(event="progress", progress=progress[-1])

        goal = wait(client.send_goal_async(SLOW, feedback_callback=on_feedback))
        if goal is None or not goal.accepted:
            continue
        report(event="accepted")
        result = goal.get_result_async()
        while not result.done() and progress[-1] < ENOUGH and not ended():
            rclpy.spin_once(node, timeout_sec=0.05)
        goal.cancel_goal_async()
        answer = wait(result)
        if answer is not None:
            report(event="ended", status=answer.status, message=answer.result.message)


def main() -> None:
    """Run a load until the input has ended."""
    orders: list[dict[str, Any]] = []

    def read() -> None:
        for line in sys.stdin:
            orders.append(json.loads(line))

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    ended = lambda: not reader.is_alive()  # noqa: E731
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    kind, *others = sys.argv[1:]
    node = rclpy.create_node(f"load_{kind}", start_parameter_services=False)
    try:
        if kind == "goals":
            send_goals(node, others[0], ended)
        else:
            publish_topics(node, ended, orders)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
