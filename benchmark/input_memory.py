# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures the memory of the node while joint states of 2 MB arrive faster than they are read.

`python -m benchmark.input_memory` needs ROS 2.
"""

import os
import tempfile
import time
from array import array
from pathlib import Path

import rclpy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from benchmark.report import machine, publish, table
from linkage_vibration.demo.domain import reserve_domain
from test.support.ros_process import JOINT, SENSOR, own_context, start_node, until

SECONDS, RATE = 25.0, 80.0
JOINTS = 83_333
# Measured once with this module, while inputs kept 1000 messages of any size.
BEFORE = ["1000 messages of any size", "332", "1353"]


def resident(pid: int) -> str:
    """Return how many MiB of a process are in use in memory."""
    pages = Path(f"/proc/{pid}/statm").read_text().split()[1]
    return f"{int(pages) * os.sysconf('SC_PAGE_SIZE') / 2**20:.0f}"


def main() -> None:
    """Publish joint states, each with other names, and write the memory before and after."""
    domain = reserve_domain()
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    with tempfile.TemporaryDirectory() as folder, own_context(domain) as context:
        running = start_node(Path(folder) / "node.txt", environment)
        running.wait_for("Predicting for")
        node = rclpy.create_node("joints", context=context)
        publisher = node.create_publisher(JointState, "joint_states", SENSOR)
        until(publisher.get_subscription_count, "the subscription")
        names = [JOINT, *(f"joint_{i:07}" for i in range(JOINTS - 1))]
        state = serialize_message(JointState(name=names, position=array("d", [2.0] * JOINTS)))
        before, began, sent = resident(running.process.pid), time.monotonic(), 0
        while (elapsed := time.monotonic() - began) < SECONDS:
            publisher.publish(state.replace(b"joint_00000", b"joint_%05d" % (sent % 99_999)))
            sent += 1
            time.sleep(max(sent / RATE - elapsed, 0.0))
        after = resident(running.process.pid)
        running.stop()
    columns = ["an input keeps", "MiB before", f"MiB after {SECONDS:g} s"]
    parts = [
        f"{sent} joint states of {len(state)} bytes, each with other names, were published in "
        f"{SECONDS:g} s.",
        table(columns, [BEFORE, ["200 messages, above 1 MB none", before, after]]),
    ]
    publish("input_memory", "Memory of the inputs", parts, machine())


if __name__ == "__main__":
    main()
