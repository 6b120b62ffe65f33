# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How does a node slow the PTO down where the linkage is loaded too much?

It publishes the PTO speed (rad/s) to ask for: what the operator wants; a part of it while the load
is not known; and, while the PTO causes a warning, the nearest smaller speed that ends it.
"""

import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64

from linkage_vibration_interfaces.msg import LoadState


class SlowPto(Node):
    """Turns load states into PTO speeds."""

    def __init__(self) -> None:
        super().__init__("slow_pto")
        self.declare_parameter("wanted", 56.5)  # rad/s, 540 rpm
        self.declare_parameter("share_if_unknown", 0.8)
        self.asked = self.create_publisher(Float64, "pto_speed_command", 10)
        self.create_subscription(LoadState, "/linkage_vibration/load_state", self.on_load, 10)

    def on_load(self, load: LoadState) -> None:
        """Ask for a speed; one comparison tells whether anything is known."""
        speed = float(self.get_parameter("wanted").value)
        if load.state < LoadState.STATE_CLEAR:
            speed *= float(self.get_parameter("share_if_unknown").value)
        elif load.state >= LoadState.STATE_WARNING and load.speed_source == LoadState.SPEED_PTO:
            speed = min(speed, load.quiet_speed)  # a speed that is NaN changes nothing
        self.asked.publish(Float64(data=speed))


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(SlowPto())
