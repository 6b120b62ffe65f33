# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A plain rclpy node that returns the first value of a joint state, in the same message as ours.

It is the simplest possible node, so the node of this package is compared with it. With the word
``speeds`` it also receives the three speeds, which it does not use.
"""

import os
import sys
from collections.abc import Callable
from contextlib import suppress

os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)

import rclpy
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from linkage_vibration_interfaces.msg import VibrationPrediction

EXECUTORS: dict[str, Callable[[], Executor]] = {
    "single-threaded": SingleThreadedExecutor,
    "events": EventsExecutor,
}
DEPTH = 100


class Echo(Node):
    """Echoes the first value of each joint state."""

    def __init__(self, *, speeds: bool) -> None:
        super().__init__("echo")
        self._publisher = self.create_publisher(VibrationPrediction, "~/prediction", DEPTH)
        sensor = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(JointState, "joint_states", self._on_joint_state, sensor)
        for topic in ("engine_speed", "pto_speed", "ground_speed") if speeds else ():
            self.create_subscription(Float64, topic, lambda message: None, sensor)

    def _on_joint_state(self, message: JointState) -> None:
        prediction = VibrationPrediction()
        prediction.header = message.header
        value = message.position[0]
        prediction.crank_angle = value
        prediction.natural_frequencies = [value, value, value]
        prediction.frequency_stddevs = [0.0, 0.0, 0.0]
        prediction.damping_ratios = [0.0, 0.0, 0.0]
        prediction.table_id = "0123456789abcdef"
        self._publisher.publish(prediction)


def main() -> None:
    """Echo until a signal arrives, with the executor that the command line names."""
    rclpy.init()
    node = Echo(speeds="speeds" in sys.argv)
    executor = EXECUTORS[sys.argv[1]]()
    executor.add_node(node)
    with suppress(ExternalShutdownException, KeyboardInterrupt):
        while rclpy.ok():  # spin() of the events executor does not react to signals
            executor.spin_once(0.2) if sys.argv[1] == "events" else executor.spin()


if __name__ == "__main__":
    main()
