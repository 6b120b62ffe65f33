# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the node for an hour at 1 kHz, with a recording: ``python -m benchmark.soak [MINUTES]``.

Every joint state should be answered, every prediction should be in the log, and memory should not
grow.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from array import array
from dataclasses import dataclass
from pathlib import Path

from benchmark.latency.driver import QUIET, SPEEDS, cpu_time
from benchmark.report import RESULTS, machine, publish, table

os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from tqdm import tqdm

from linkage_vibration.drawing.palette import COLOURS
from linkage_vibration_interfaces.msg import VibrationPrediction
from test.support.messages import read_messages

RATE, SPEED_EVERY = 1000, 50  # Hz, and joint states for each value of each speed
JOINT = "hitch_rockshaft_joint"
STALL = 0.05  # s
PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, slots=True)
class Sent:
    """The outcome of the joint states that were sent.

    Attributes
    ----------
    answered : bytearray
        1 for each joint state that was answered.
    memory : list of tuple
        Times (s) and the node's resident memory (bytes).
    stalls : list of float
        Delays of the sender, s. Other processes on the machine delay the node as well.
    cpu : float
        Share of a core that the node used, %.
    """

    answered: bytearray
    memory: list[tuple[float, float]]
    stalls: list[float]
    cpu: float


def main() -> None:
    """Send joint states, count the predictions, and publish the result."""
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "linkage_vibration.ros.node", "--ros-args"]
        command += ["-p", "record:=true", "-p", "split_duration:=600.0"]
        node = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)
        try:
            sent = send(node.pid, round(60.0 * minutes * RATE))
        finally:
            node.send_signal(signal.SIGINT)
            code = node.wait(30.0)
        logs = sorted(Path(folder).glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns)
        count = len(sent.answered)
        logged = bytearray(count + 1)
        size = sum(path.stat().st_size for path in logs)
        for path in tqdm(logs, unit="log"):
            for _, message in read_messages(path, "/linkage_vibration/prediction"):
                stamp = message.header.stamp
                logged[stamp.sec * RATE + stamp.nanosec] = 1
    draw(sent.memory, RESULTS / "soak.png")
    settled = [m for t, m in sent.memory if t > sent.memory[-1][0] / 6.0]
    rows = [
        ["joint states sent, 1 kHz", f"{count}"],
        ["predictions received", f"{sum(sent.answered)}"],
        ["runs of missing predictions", f"{stretches(sent.answered)}"],
        ["predictions in the log", f"{sum(logged[:count])}"],
        [
            f"delays of the sender above {STALL:g} s: number, longest [s]",
            f"{len(sent.stalls)}, {max(sent.stalls, default=0.0):.2f}",
        ],
        ["logs, total size [MB]", f"{len(logs)}, {size / 1e6:.0f}"],
        [
            "memory after a sixth of the time, and its maximum after that [MB]",
            f"{settled[0] / 1e6:.1f}, {max(settled) / 1e6:.1f}",
        ],
        ["processor [% of a core]", f"{sent.cpu:.0f}"],
        ["exit code", f"{code}"],
    ]
    text = (
        "This page shows whether the node loses messages or gains memory over a long time. One "
        f"node with its default linkage ran for {minutes:g} minutes with joint states at 1 kHz, "
        "and the speeds of engine, PTO and ground at 20 Hz, and recorded a new log every 10 "
        "minutes."
    )
    publish(
        "soak",
        "The node over a long time",
        [text, table(["", ""], rows), "![](soak.png)"],
        machine(),
    )


def send(process: int, count: int) -> Sent:
    """Send joint states to a node, and receive its predictions."""
    rclpy.init()
    driver = rclpy.create_node("soak")
    answered = bytearray(count + 1)

    def on_answer(message: VibrationPrediction) -> None:
        answered[message.header.stamp.sec * RATE + message.header.stamp.nanosec] = 1

    driver.create_subscription(VibrationPrediction, "linkage_vibration/prediction", on_answer, 5000)
    sensor = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = driver.create_publisher(JointState, "joint_states", sensor)
    speeds = {topic: driver.create_publisher(Float64, topic, sensor) for topic in SPEEDS}
    executor = SingleThreadedExecutor()
    executor.add_node(driver)
    message = JointState(name=[JOINT])

    def joint_state(number: int) -> JointState:
        # The stamp is the number. Number ``count`` marks those that wait for the node.
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(number, RATE)
        message.position = array("d", [2.3 + 0.7 * float(np.sin(1e-3 * number))])
        message.velocity = array("d", [0.7 * float(np.cos(1e-3 * number))])
        return message

    while not answered[count]:
        publisher.publish(joint_state(count))
        executor.spin_once(0.2)
    quiet = time.monotonic() + QUIET
    while time.monotonic() < quiet:
        executor.spin_once(0.1)
    memory: list[tuple[float, float]] = []
    stalls: list[float] = []
    begin, before = time.monotonic(), cpu_time(process)
    for number in tqdm(range(count), unit="joint state", mininterval=5.0):
        due = begin + number / RATE
        while (wait := due - time.monotonic()) > 0.0:
            executor.spin_once(wait)
        if -wait > STALL:
            # After a delay, a controller continues at its rate and does not catch up.
            begin -= wait
            stalls.append(-wait)
        publisher.publish(joint_state(number))
        if number % SPEED_EVERY == 0:
            for topic, speed in speeds.items():
                middle, width = SPEEDS[topic]
                speed.publish(Float64(data=middle + width * float(np.sin(1e-4 * number))))
            executor.spin_once(0.0)
        if number % (5 * RATE) == 0:
            pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
            memory.append((number / RATE, float(pages * PAGE)))
    spent = cpu_time(process) - before
    lasted = time.monotonic() - begin
    end = time.monotonic() + 5.0 * QUIET
    while not all(answered) and time.monotonic() < end:
        executor.spin_once(0.1)
    executor.shutdown()
    driver.destroy_node()
    rclpy.try_shutdown()
    return Sent(answered[:count], memory, stalls, 100.0 * spent / lasted)


def stretches(answered: bytearray) -> int:
    """Return the number of runs of missing predictions."""
    return len([part for part in bytes(answered).split(b"\1") if part])


def draw(memory: list[tuple[float, float]], picture: Path) -> None:
    """Draw the node's memory over time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 2.8), layout="constrained")
    ax = figure.subplots()
    times, sizes = np.array(memory).T
    ax.plot(times / 60.0, sizes / 1e6, color=COLOURS[0])
    ax.set(xlabel="time [min]", ylabel="resident memory [MB]", ylim=(0.0, 1.2e-6 * sizes.max()))
    ax.grid(color="#dddddd", linewidth=0.6)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main()
