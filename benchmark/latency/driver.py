# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Sends joint states at a rate to a node in a process of its own, and times the answers."""

import os
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import rclpy
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from linkage_vibration_interfaces.msg import VibrationPrediction

JOINT = "hitch_rockshaft_joint"
QUIET = 1.0  # s, after the last message, for answers that are late
FOUND = 20.0  # s, until which a node has to be found
SETTLED = 3.0  # s of answers, in which DDS goes over from UDP to shared memory and loses some
PACE = 0.02  # s, between joint states that nobody counts


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What a node did with joint states of one rate.

    Attributes
    ----------
    latencies : ndarray, (n,)
        s, from just before a joint state is published until its answer is taken.
    lost : int
        Joint states without an answer.
    cpu : float
        Share of a core that the node's process took.
    """

    latencies: NDArray[np.float64]
    lost: int
    cpu: float


class Driver:
    """Publishes joint states and times answers, by their stamps.

    Attributes
    ----------
    node : Node
        The driver's own, which is spun during runs.
    """

    def __init__(self) -> None:
        rclpy.init()
        self.node = rclpy.create_node("latency_driver")
        sensor = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._publisher = self.node.create_publisher(JointState, "joint_states", sensor)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._taken: dict[int, float] = {}

    def run(
        self,
        topic: str,
        process: int,
        rate: float,
        count: int,
        begun: Callable[[], object] = lambda: None,
    ) -> Run:
        """Send ``count`` joint states at ``rate`` Hz to a node that answers on a topic.

        ``begun`` is called as they begin.
        """
        subscription = self.node.create_subscription(
            VibrationPrediction, topic, self._on_answer, 1000, raw=True
        )
        try:
            self._find()
            self._taken.clear()
            sent: list[float] = []
            before, began = cpu_time(process), time.monotonic()
            sender = threading.Thread(target=self._send, args=(rate, count, sent))
            sender.start()
            begun()
            while sender.is_alive():
                self._executor.spin_once(0.05)
            spent, lasted = cpu_time(process) - before, time.monotonic() - began
            end = time.monotonic() + QUIET
            while len(self._taken) < count and time.monotonic() < end:
                self._executor.spin_once(0.05)
            latencies = [taken - sent[i] for i, taken in self._taken.items()]
            return Run(np.array(latencies), count - len(latencies), spent / lasted)
        finally:
            self.node.destroy_subscription(subscription)

    def close(self) -> None:
        """Leave."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _find(self) -> None:
        """Wait until joint states are answered."""
        self._taken.clear()
        end = time.monotonic() + FOUND
        settled = 0.0
        while not self._taken or time.monotonic() < settled:
            if time.monotonic() > end:
                raise RuntimeError("the node does not answer")
            self.publish(0)
            pause = time.monotonic() + PACE  # a flood would still be under way as the run begins
            while time.monotonic() < pause:
                self._executor.spin_once(PACE)
            if self._taken and not settled:
                settled = time.monotonic() + SETTLED
        quiet = time.monotonic() + 0.5
        while time.monotonic() < quiet:
            self._executor.spin_once(0.05)

    def _send(self, rate: float, count: int, sent: list[float]) -> None:
        begin = time.monotonic()
        for i in range(count):
            wait = begin + i / rate - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            sent.append(time.monotonic())
            self.publish(i)

    def publish(self, number: int) -> None:
        """Send a joint state that has a number."""
        message = JointState()
        message.header.stamp.nanosec = number
        message.name = [JOINT]
        message.position = array("d", [1.6 + 1.5e-4 * (number % 10_000)])
        self._publisher.publish(message)

    def _on_answer(self, data: Any) -> None:
        now = time.monotonic()
        self._taken.setdefault(struct.unpack_from("<I", data, 8)[0], now)


def cpu_time(process: int) -> float:
    """Return the processor time that a process's threads have taken, s."""
    threads = Path(f"/proc/{process}/task").glob("*/schedstat")
    return 1e-9 * sum(int(thread.read_text().split()[0]) for thread in threads)


@contextmanager
def running(command: Sequence[str]) -> Iterator[int]:
    """Run a node in a process of its own, in a folder that is thrown away."""
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            [sys.executable, *command],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            yield process.pid
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(20.0)
