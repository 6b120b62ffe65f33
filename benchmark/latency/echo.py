# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A plain rclpy node that answers a joint state with its first value, in the same message as ours.

It is what anyone would write first, and so what the node of this package is held against.
"""

import os
import sys
from contextlib import suppress

os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)

import rclpy
from rclpy.executors import (
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    SingleThreadedExecutor,
)
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from linkage_vibration_interfaces.msg import VibrationPrediction

EXECUTORS = {
    "single-threaded": SingleThreadedExecutor,
    "multi-threaded": MultiThreadedExecutor,
    "events": EventsExecutor,
}
DEPTH = 100


class Echo(Node):
    """Echoes the first value of each joint state."""

    def __init__(self) -> None:
        super().__init__("echo")
        self._publisher = self.create_publisher(VibrationPrediction, "~/prediction", DEPTH)
        sensor = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(JointState, "joint_states", self._on_joint_state, sensor)

    def _on_joint_state(self, message: JointState) -> None:
        prediction = VibrationPrediction()
        prediction.header = message.header
        value = message.position[0]
        prediction.crank_angle = value
        prediction.natural_frequencies = [value, value, value]
        prediction.frequency_stddev = [0.0, 0.0, 0.0]
        prediction.damping_ratios = [0.0, 0.0, 0.0]
        prediction.table_id = "0123456789abcdef"
        self._publisher.publish(prediction)


def main() -> None:
    """Echo until a signal comes, by the executor named on the command line."""
    rclpy.init()
    node = Echo()
    executor: Executor = EXECUTORS[sys.argv[1]]()
    executor.add_node(node)
    with suppress(ExternalShutdownException, KeyboardInterrupt):
        while rclpy.ok():  # the events executor hears no signal while it spins without an end
            executor.spin_once(0.2) if sys.argv[1] == "events" else executor.spin()


if __name__ == "__main__":
    main()
