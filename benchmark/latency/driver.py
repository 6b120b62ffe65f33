# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Sends joint states at a rate to a node in another process, and times the predictions.

A node may also receive the speeds of the engine, the PTO and the ground.
"""

import math
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
from std_msgs.msg import Float64

from linkage_vibration_interfaces.msg import VibrationPrediction

JOINT = "hitch_rockshaft_joint"
QUIET = 1.0  # s, after the last message, in which late predictions arrive
FOUND = 120.0  # s, within which a node must answer
SETTLED = 3.0  # s, in which DDS changes from UDP to shared memory and loses messages
PACE = 0.02  # s, between joint states that are not counted
SPEED_RATE = 20.0  # Hz, of each speed, or that of the joint states if it is lower
# Each speed and how much it varies: rpm, rpm and m/s.
SPEEDS = {"engine_speed": (1750.0, 350.0), "pto_speed": (520.0, 60.0), "ground_speed": (3.0, 2.0)}


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """The predictions of a node for joint states at one rate.

    Attributes
    ----------
    latencies : ndarray, (n,), s
        From just before a joint state is published until its prediction is taken.
    lost : int
        Joint states without a prediction.
    cpu : float
        Processor time that the node's process used, s.
    lasted : float
        Length of the run, s.
    """

    latencies: NDArray[np.float64]
    lost: int
    cpu: float
    lasted: float


class Driver:
    """Publishes joint states to named nodes, and times the predictions by their stamps.

    Attributes
    ----------
    node : Node
        The driver's node, which is spun during runs.
    """

    def __init__(self) -> None:
        rclpy.init()
        self.node = rclpy.create_node("latency_driver")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._publishers: dict[str, Any] = {}
        self._taken: dict[int, float] = {}
        self._speeds: dict[str, dict[str, Any]] = {}

    def meet(self, name: str, *, speeds: bool = False) -> None:
        """Wait until a node that was started with the arguments of `named` answers.

        With ``speeds``, it receives speeds in this and in all following runs.
        """
        if speeds:
            sensor = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._speeds[name] = {
                topic: self.node.create_publisher(Float64, f"/{name}/{topic}", sensor)
                for topic in SPEEDS
            }
        self.node.create_subscription(
            VibrationPrediction, f"/{name}/prediction", self._on_answer, 1000, raw=True
        )
        self._taken.clear()
        end, settled = time.monotonic() + FOUND, 0.0
        while not self._taken or time.monotonic() < settled:
            if time.monotonic() > end:
                raise RuntimeError(f"The node {name} did not answer within {FOUND:g} s.")
            self.publish(name, 0)
            self.publish_speeds(name, 0.0)
            self._spin(PACE)  # more messages would still be queued when a run begins
            if self._taken and not settled:
                settled = time.monotonic() + SETTLED
        self._spin(0.5)

    def run(
        self,
        name: str,
        process: int,
        rate: float,
        count: int,
        begun: Callable[[], object] = lambda: None,
    ) -> Run:
        """Send ``count`` joint states at ``rate`` Hz to a node; call ``begun`` after the start."""
        self._taken.clear()
        sent: dict[int, float] = {}
        before, began = cpu_time(process), time.monotonic()
        sender = threading.Thread(target=self._send, args=(name, rate, count, sent))
        sender.start()
        begun()
        while sender.is_alive():
            self._executor.spin_once(0.05)
        spent, lasted = cpu_time(process) - before, time.monotonic() - began
        end = time.monotonic() + QUIET
        while not sent.keys() <= self._taken.keys() and time.monotonic() < end:
            self._executor.spin_once(0.05)
        # An answer of an earlier run may arrive as late as in this one.
        latencies = [taken - sent[t] for t, taken in self._taken.items() if t in sent]
        return Run(np.array(latencies), count - len(latencies), spent, lasted)

    def publish(self, name: str, number: int) -> int:
        """Send a node the joint state of a number, and return its stamp, ns since the epoch."""
        if name not in self._publishers:
            sensor = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._publishers[name] = self.node.create_publisher(
                JointState, f"/{name}/joint_states", sensor
            )
        message = JointState()
        stamp = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.name = [JOINT]
        message.position = array("d", [1.6 + 1.5e-4 * (number % 10_000)])
        self._publishers[name].publish(message)
        return stamp

    def publish_speeds(self, name: str, seconds: float) -> None:
        """Send a node the speeds of a moment of the run, if it receives any."""
        for topic, publisher in self._speeds.get(name, {}).items():
            middle, width = SPEEDS[topic]
            publisher.publish(Float64(data=middle + width * math.sin(0.5 * seconds)))

    def close(self) -> None:
        """Shut down the driver's node."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _send(self, name: str, rate: float, count: int, sent: dict[int, float]) -> None:
        begin, speeds_every = time.monotonic(), max(1, round(rate / SPEED_RATE))
        for i in range(count):
            wait = begin + i / rate - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            if i % speeds_every == 0:
                self.publish_speeds(name, i / rate)
            now = time.monotonic()
            sent[self.publish(name, i)] = now

    def _spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._executor.spin_once(left)

    def _on_answer(self, data: Any) -> None:
        now = time.monotonic()
        seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
        self._taken.setdefault(10**9 * seconds + nanoseconds, now)


def named(name: str, *others: str) -> list[str]:
    """Return the arguments that give a node a name and its own topics of inputs."""
    words = ["--ros-args", "-r", f"__node:={name}"]
    for topic in ("joint_states", *SPEEDS):
        words += ["-r", f"{topic}:=/{name}/{topic}"]
    return [*words, *others]


def cpu_time(process: int) -> float:
    """Return the processor time that the threads of a process have used, s."""
    threads = Path(f"/proc/{process}/task").glob("*/schedstat")
    return 1e-9 * sum(int(thread.read_text().split()[0]) for thread in threads)


@contextmanager
def running(command: Sequence[str], by: signal.Signals = signal.SIGINT) -> Iterator[int]:
    """Run a node in another process, in a temporary folder, until a signal; yield its id."""
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
            process.send_signal(by)
            process.wait(20.0)
