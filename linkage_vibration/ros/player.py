# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Plays a recorded drive to a running node over DDS, and collects its predictions."""

import time
from array import array
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from numpy.typing import NDArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from linkage_vibration.bags.reading import JointStateRecord
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.settings import NODE_NAME
from linkage_vibration.ros.command_line import start_errors
from linkage_vibration_interfaces.msg import VibrationPrediction
from linkage_vibration_interfaces.srv import PredictVibration

# 10 s of predictions at 1 kHz, in case this process cannot read them for a while.
PREDICTIONS_DEPTH = 10_000
MATCH_TIMEOUT = 30.0  # s
ANSWER_TIMEOUT = 3.0  # s, after the last prediction
MAX_UNANSWERED = 500  # joint states; the node's queue holds twice as many

Speed = tuple[int, str, float]  # log time (ns), topic, and value (rpm or m/s)


class PlayerError(LinkageVibrationError):
    """The node does not answer."""


@dataclass(frozen=True, slots=True)
class Playback:
    """The result of playing a recording."""

    received: int  # predictions
    latencies: NDArray[np.float64]  # (n_matched,), s, from a joint state to its prediction
    lateness: NDArray[np.float64]  # (n_joint_states,), s, by which they were published late


def play(
    records: Iterable[JointStateRecord],
    speeds: Sequence[Speed],
    on_prediction: Callable[[VibrationPrediction], None],
    check: Callable[[], None],
) -> Playback:
    """Publish joint states and speeds at their recorded times, and wait until all are answered.

    The recorded stamps are kept. The node copies them into its predictions, so they show which
    prediction answers which joint state. ``check`` is called repeatedly, and may raise to stop. A
    `PlayerError` says that the node does not answer.
    """
    # rclpy would turn Ctrl-C into a silent end of spinning, so the caller handles it.
    context = Context()
    try:
        with start_errors():
            rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
            node = Node("linkage_vibration_player", context=context, use_global_arguments=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        try:
            player = _Player(node, executor, speeds, on_prediction, check)
            player.wait_for_node()
            return player.play(records)
        finally:
            executor.shutdown()
            node.destroy_node()
    finally:
        context.try_shutdown()


class _Player:
    """Publishes a recording, and matches predictions with joint states by their stamps."""

    def __init__(
        self,
        node: Node,
        executor: SingleThreadedExecutor,
        speeds: Sequence[Speed],
        on_prediction: Callable[[VibrationPrediction], None],
        check: Callable[[], None],
    ) -> None:
        self._executor, self._on_prediction, self._check = executor, on_prediction, check
        self._waiting = deque(speeds)
        self._sent_at: defaultdict[tuple[int, int], deque[float]] = defaultdict(deque)
        self._latencies: list[float] = []
        self._lateness: list[float] = []
        self._received, self._last_arrival = 0, 0.0
        qos = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        names = {name for _, name, _ in speeds}
        self._speeds = {name: node.create_publisher(Float64, name, qos) for name in names}
        self._publisher = node.create_publisher(JointState, "joint_states", qos)
        topic = f"{NODE_NAME}/prediction"
        node.create_subscription(VibrationPrediction, topic, self._arrived, PREDICTIONS_DEPTH)
        # It comes last, because DDS announces endpoints in the order of their creation. So when the
        # node answers it, the node also knows the publishers and the subscription.
        self._client: Any = node.create_client(PredictVibration, f"{NODE_NAME}/predict")

    def wait_for_node(self) -> None:
        """Return when the node receives what is published from now on."""
        deadline = time.monotonic() + MATCH_TIMEOUT
        while time.monotonic() < deadline:
            self._check()
            self._executor.spin_once(0.05)
            if self._client.service_is_ready() and self._publisher.get_subscription_count() > 0:
                # Answers are lost until the node has found the client, so it asks each second.
                answer = self._client.call_async(PredictVibration.Request())
                self._executor.spin_until_future_complete(answer, 1.0)
                if answer.done():
                    return
        raise PlayerError(
            f"Node /{NODE_NAME} did not answer within {MATCH_TIMEOUT:g} s; check that nothing "
            "blocks UDP on this machine, and check ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE."
        )

    def play(self, records: Iterable[JointStateRecord]) -> Playback:
        """Publish everything when it is due, and wait for the answers."""
        start, first = time.monotonic(), None
        for record in records:
            self._check()
            first = record.log_time if first is None else first
            due = start + 1e-9 * (record.log_time - first)
            # It spins at least once, so that predictions are read even if publishing is late.
            self._executor.spin_once(max(due - time.monotonic(), 0.0))
            while (wait := due - time.monotonic()) > 0.0:
                self._executor.spin_once(wait)
            self._wait_for_answers(MAX_UNANSWERED)  # so that a slow machine loses none
            while self._waiting and self._waiting[0][0] <= record.log_time:
                _, topic, value = self._waiting.popleft()
                self._speeds[topic].publish(Float64(data=value))
            self._publish(record, due)
        self._wait_for_answers(0)
        return Playback(self._received, np.array(self._latencies), np.array(self._lateness))

    def _wait_for_answers(self, unanswered: int) -> None:
        """Return when at most so many joint states are unanswered, or no answer arrives."""
        self._last_arrival = time.monotonic()
        while (
            len(self._lateness) - self._received > unanswered
            and time.monotonic() < self._last_arrival + ANSWER_TIMEOUT
        ):
            self._check()
            self._executor.spin_once(0.1)

    def _publish(self, record: JointStateRecord, due: float) -> None:
        message = JointState()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(record.stamp, 10**9)
        message.header.frame_id = record.frame_id
        message.name = list(record.name)
        # rclpy checks every element of a list, but not of an array.
        message.position = array("d", record.position)
        message.velocity = array("d", record.velocity)
        message.effort = array("d", record.effort)
        now = time.monotonic()
        self._sent_at[message.header.stamp.sec, message.header.stamp.nanosec].append(now)
        self._publisher.publish(message)
        self._lateness.append(now - due)

    def _arrived(self, prediction: VibrationPrediction) -> None:
        self._last_arrival = time.monotonic()
        self._received += 1
        stamp = prediction.header.stamp
        if waiting := self._sent_at.get((stamp.sec, stamp.nanosec)):
            self._latencies.append(self._last_arrival - waiting.popleft())
        self._on_prediction(prediction)
