# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures the processor time that the node takes for an IMU at 200 Hz beside its predictions.

`python -m benchmark.sensors` needs ROS 2.
"""

import math
import os
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import rclpy
from rclpy.context import Context
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64

from benchmark.listening.simulation import Scene, simulate
from benchmark.report import machine, publish, table
from linkage_vibration.demo.domain import reserve_domain
from linkage_vibration.listening.live import SensorMonitor
from linkage_vibration.prediction.excitation import Source, excitations_from_mapping
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.loaded_model import load_model
from linkage_vibration.readers.sensors import live_sensors
from test.support.ros_process import JOINT, SENSOR, own_context, start_node, until

RATE, SECONDS, PAIRS = 200, 20.0, 5
SENSORS = "imu: {topic: /imu, unit: m/s2, at: E1, filtered: true}\n"


def processor_time(pid: int) -> float:
    """Return the processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def share(context: Context, folder: Path, environment: dict[str, str], **given: Path) -> float:
    """Return the share of a core that a node with some parameters takes, %."""
    running = start_node(folder / "node.txt", environment, **dict[str, Any](given))
    running.wait_for("Predicting for")
    node = rclpy.create_node("drive", context=context)
    imu = node.create_publisher(Imu, "imu", SENSOR)
    joints = node.create_publisher(JointState, "joint_states", SENSOR)
    engine = node.create_publisher(Float64, "engine_speed", SENSOR)
    until(joints.get_subscription_count, "the subscription")
    began, warm, before = time.monotonic(), 6.0, math.nan
    for k in range(int((warm + SECONDS) * RATE)):
        if k == warm * RATE:
            before = processor_time(running.process.pid)
        sample, now = Imu(), time.time_ns()
        sample.header.stamp.sec, sample.header.stamp.nanosec = divmod(now, 10**9)
        sample.linear_acceleration.z = 9.81 + 0.2 * math.cos(2.0 * math.pi * 25.0 * k / RATE)
        imu.publish(sample)
        if k % 10 == 0:
            joints.publish(JointState(header=sample.header, name=[JOINT], position=[2.3]))
            engine.publish(Float64(data=1500.0))
        time.sleep(max(began + k / RATE - time.monotonic(), 0.0))
    taken = processor_time(running.process.pid) - before
    running.stop()
    node.destroy_node()
    return 100.0 * taken / SECONDS


def without_rclpy(seconds: float = 200.0) -> str:
    """Return what a monitor takes for the samples of a simulated drive, and its longest part."""
    served, drive = load_model(Parameters()), simulate(3, Scene(road=256e-6, seconds=seconds))
    sensor = Path(tempfile.mkdtemp()) / "sensors.yaml"
    sensor.write_text(SENSORS.replace("E1", "E2"))
    speeds = {Source(name): float(values.mean()) for name, values in drive.speeds.items()}
    shafts = excitations_from_mapping({"pto": {"speed": "pto", "orders": [1, 0.45]}})
    parts = live_sensors(sensor), served.predictor, served.mechanism, shafts, speeds
    monitor, taken, longest = SensorMonitor(*parts, 1.0), 0.0, list[float]()
    for k in range(len(drive.times)):
        stamp = 1_700_000_010 * 10**9 + k * 10**9 // RATE
        if k % 10 == 0:
            monitor.set_angle(float(drive.crank_angle[k]), stamp)
        sample = float(drive.signals[k, 0]), 0.0, float(drive.signals[k, 1])
        before = time.process_time()
        monitor.take(0, stamp, sample)
        longest.append(time.process_time() - before)
        taken += longest[-1]
    most, often = 1e3 * max(longest), sum(each > 2e-3 for each in longest)
    return (
        "Without rclpy, comparing orders once a second and identifying modes every half minute "
        f"take {100.0 * taken / seconds:.2f} % of a core in a simulated drive of {seconds:g} s "
        f"(processor time). One sample takes at most {most:.1f} ms, and {often} of {len(longest)} "
        "more than 2 ms."
    )


def main() -> None:
    """Measure nodes with and without the sensor in turn, and write the difference."""
    domain = reserve_domain()
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    with tempfile.TemporaryDirectory() as folder, own_context(domain) as context:
        file = Path(folder) / "sensors.yaml"
        file.write_text(SENSORS)
        pairs = [
            [
                share(context, Path(folder), environment, **given)
                for given in (dict[str, Path](), {"sensor_file": file})
            ]
            for _ in range(PAIRS)
        ]
    without, beside = zip(*pairs, strict=True)
    more = [b - a for a, b in pairs]
    rows = [
        [name, f"{median(values):.1f}", f"{min(values):.1f} to {max(values):.1f}"]
        for name, values in (("without", without), ("with", beside), ("difference", more))
    ]
    parts = [
        f"Joint states and the engine speed come at 20 Hz, samples of an IMU at {RATE} Hz, for "
        f"{SECONDS:g} s; nodes with and without `sensor_file` in turn, {PAIRS} times.",
        table(["sensor", "% of a core, median", "range"], rows),
        without_rclpy(),
    ]
    publish("sensors", "An IMU in the node", parts, machine())


if __name__ == "__main__":
    main()
