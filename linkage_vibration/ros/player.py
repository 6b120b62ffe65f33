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
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from linkage_vibration.bags.reading import JointStateRecord
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration_interfaces.msg import VibrationPrediction
from linkage_vibration_interfaces.srv import PredictVibration

PREDICTING_NODE = "linkage_vibration"
# 10 s of predictions at 1 kHz, in case this process cannot read them for a while.
PREDICTIONS_DEPTH = 10_000
MATCH_TIMEOUT = 30.0  # s
ANSWER_TIMEOUT = 3.0  # s, after the last prediction
MAX_UNANSWERED = 500  # joint states; the node's queue holds twice as many


class PlayerError(LinkageVibrationError):
    """The node does not answer."""


@dataclass(frozen=True, slots=True)
class SpeedRecord:
    """A recorded speed of the tractor.

    Attributes
    ----------
    topic : str
        Name of the topic, such as ``/engine_speed``.
    log_time : int
        Time in the recording, ns.
    value : float
        The speed, rpm or m/s.
    """

    topic: str
    log_time: int
    value: float


@dataclass(frozen=True, slots=True)
class Playback:
    """The result of playing a recording.

    Attributes
    ----------
    sent : int
        Joint states published.
    received : int
        Predictions received.
    latencies : ndarray, (n_matched,), s
        Times from publishing a joint state to receiving the prediction with its stamp, both in
        this process and by the monotonic clock.
    lateness : ndarray, (sent,), s
        Times from when a joint state was due to when it was published.
    """

    sent: int
    received: int
    latencies: NDArray[np.float64]
    lateness: NDArray[np.float64]


def play(
    records: Iterable[JointStateRecord],
    speeds: Sequence[SpeedRecord],
    on_prediction: Callable[[VibrationPrediction], None],
    check: Callable[[], None],
) -> Playback:
    """Publish joint states and speeds at their recorded times, and wait until all are answered.

    The recorded stamps are kept. The node copies them into its predictions, so they show which
    prediction answers which joint state.

    Parameters
    ----------
    records : iterable of JointStateRecord
        The joint states in the order of their log times.
    speeds : sequence of SpeedRecord
        The speeds in the same order.
    on_prediction : callable
        Called with every prediction that arrives.
    check : callable
        Called repeatedly; raises an exception to stop.

    Raises
    ------
    PlayerError
        If the node does not answer its service within 30 s.
    """
    # rclpy would turn Ctrl-C into a silent end of spinning, so the caller handles it.
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = Node("linkage_vibration_player", context=context, use_global_arguments=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        try:
            return _play(node, executor, records, speeds, on_prediction, check)
        finally:
            executor.shutdown()
            node.destroy_node()
    finally:
        context.try_shutdown()


def _play(
    node: Node,
    executor: SingleThreadedExecutor,
    records: Iterable[JointStateRecord],
    speeds: Sequence[SpeedRecord],
    on_prediction: Callable[[VibrationPrediction], None],
    check: Callable[[], None],
) -> Playback:
    sent_at: defaultdict[tuple[int, int], deque[float]] = defaultdict(deque)
    latencies: list[float] = []
    received = 0
    last_arrival = 0.0

    def arrived(prediction: VibrationPrediction) -> None:
        nonlocal received, last_arrival
        last_arrival = time.monotonic()
        received += 1
        stamp = prediction.header.stamp
        if waiting := sent_at.get((stamp.sec, stamp.nanosec)):
            latencies.append(last_arrival - waiting.popleft())
        on_prediction(prediction)

    sensor = QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.BEST_EFFORT
    )
    speed_publishers = {
        topic: node.create_publisher(Float64, topic, sensor)
        for topic in {speed.topic for speed in speeds}
    }
    publisher = node.create_publisher(JointState, "joint_states", sensor)
    node.create_subscription(
        VibrationPrediction,
        f"{PREDICTING_NODE}/prediction",
        arrived,
        QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=PREDICTIONS_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE,
        ),
    )
    _wait_for_match(node, executor, publisher.get_subscription_count, check)

    lateness: list[float] = []
    waiting_speeds = deque(speeds)
    start = time.monotonic()
    first_log_time: int | None = None
    for record in records:
        check()
        first_log_time = record.log_time if first_log_time is None else first_log_time
        due = start + (record.log_time - first_log_time) / 1e9
        # It spins at least once, so that predictions are read even if publishing is late.
        executor.spin_once(max(due - time.monotonic(), 0.0))
        while (wait := due - time.monotonic()) > 0.0:
            executor.spin_once(wait)
        behind = time.monotonic() + ANSWER_TIMEOUT  # so that a slow machine loses nothing
        while len(lateness) - received > MAX_UNANSWERED and time.monotonic() < behind:
            executor.spin_once(0.1)
        while waiting_speeds and waiting_speeds[0].log_time <= record.log_time:
            speed = waiting_speeds.popleft()
            speed_publishers[speed.topic].publish(Float64(data=speed.value))
        message = _message(record)
        now = time.monotonic()
        sent_at[message.header.stamp.sec, message.header.stamp.nanosec].append(now)
        publisher.publish(message)
        lateness.append(now - due)
    last_arrival = time.monotonic()
    while received < len(lateness) and time.monotonic() < last_arrival + ANSWER_TIMEOUT:
        check()
        executor.spin_once(0.1)
    return Playback(len(lateness), received, np.array(latencies), np.array(lateness))


def _wait_for_match(
    node: Node,
    executor: SingleThreadedExecutor,
    subscription_count: Callable[[], int],
    check: Callable[[], None],
) -> None:
    """Return when the node receives what is published from now on.

    That this side has found the node does not mean that the node has found this side. DDS
    announces endpoints in the order of their creation. So when a client gets an answer, the node
    knows the publisher and the subscription, which were created before the client.
    """
    client: Any = node.create_client(PredictVibration, f"{PREDICTING_NODE}/predict")
    deadline = time.monotonic() + MATCH_TIMEOUT
    while time.monotonic() < deadline:
        check()
        executor.spin_once(0.05)
        if client.service_is_ready() and subscription_count() > 0:
            # Answers are lost until the node has found the client, so it asks again each second.
            answer = client.call_async(PredictVibration.Request())
            executor.spin_until_future_complete(answer, 1.0)
            if answer.done():
                return
    raise PlayerError(
        f"Node /{PREDICTING_NODE} did not answer within {MATCH_TIMEOUT:g} s; check that nothing "
        "blocks UDP on this machine, and check ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE."
    )


def _message(record: JointStateRecord) -> JointState:
    message = JointState()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(record.stamp, 10**9)
    message.header.frame_id = record.frame_id
    message.name = list(record.name)
    # rclpy checks every element of a list, but not of an array.
    message.position = array("d", record.position)
    message.velocity = array("d", record.velocity)
    message.effort = array("d", record.effort)
    return message
