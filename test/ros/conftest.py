# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Real node processes, and a peer that talks to them over real DDS."""

import os
import signal
import subprocess
import sys
import time
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

# A domain of this run's own, so that runs side by side do not hear each other.
DOMAIN = 1 + os.getpid() % 100
DISCOVERY_TIMEOUT = 20.0  # s


@pytest.fixture(scope="session")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return (and set) the environment in which nodes and peers find each other.

    Nodes run with BLAS threads, as on a machine where nobody has thought of them: a signal to the
    process may go to any thread.
    """
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
    os.environ.setdefault("ROS_LOG_DIR", str(tmp_path_factory.mktemp("ros_log")))
    return {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}


@dataclass
class RunningNode:
    """A node in a process of its own, and what it says."""

    process: "subprocess.Popen[bytes]"
    output: Path

    @property
    def said(self) -> str:
        """What the node has printed so far."""
        return self.output.read_text()

    def wait_for(self, words: str) -> None:
        """Return once the node has said something."""
        until(lambda: words in self.said or self.process.poll() is not None, words)
        assert words in self.said, self.said

    def wait_for_handlers(self) -> None:
        """Return once the node heeds signals; before, it is Python itself that starts."""
        status = Path(f"/proc/{self.process.pid}/status")

        def caught() -> int:
            [mask] = [line for line in status.read_text().splitlines() if "SigCgt" in line]
            return int(mask.split()[1], 16)

        until(lambda: bool(caught() >> (signal.SIGTERM - 1) & 1), "handlers of signals")

    def stop(self, by: signal.Signals = signal.SIGINT) -> int:
        """End the node by a signal and return its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(by)
        return self.process.wait(15.0)


def until(condition: Callable[[], bool], what: str, timeout: float = DISCOVERY_TIMEOUT) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain for {what}"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def start(
    environment: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[..., RunningNode]]:
    """Return what starts a node with parameters; each is ended after the module's tests."""
    nodes: list[RunningNode] = []

    def begin(
        *arguments: str,
        name: str = "linkage_vibration",
        program: Sequence[str] = ("-m", "linkage_vibration.ros.node"),
        **parameters: Any,
    ) -> RunningNode:
        output = tmp_path_factory.mktemp("node") / "said.txt"
        command = [sys.executable, *program, "--ros-args", "-r", f"__node:={name}", *arguments]
        for key, value in parameters.items():
            command += ["-p", f"{key}:={str(value).lower() if value in (True, False) else value}"]
        with output.open("wb") as file:
            process = subprocess.Popen(
                command, env=environment, stdout=file, stderr=subprocess.STDOUT
            )
        nodes.append(RunningNode(process, output))
        return nodes[-1]

    yield begin
    for node in nodes:
        if node.process.poll() is None:
            node.process.kill()
            node.process.wait()


@dataclass
class Peer:
    """Another participant: publishes joint states, hears predictions, calls the service."""

    node: Any
    executor: Any
    publisher: Any
    client: Any
    predictions: list[Any] = field(default_factory=list)
    raw: list[bytes] = field(default_factory=list)
    stamp: int = 0

    def publish(
        self,
        names: Sequence[str],
        positions: Sequence[float],
        *,
        velocity: Sequence[float] = (),
        frame_id: str = "",
    ) -> int:
        """Publish a joint state with a new stamp, and return the stamp's nanoseconds."""
        from sensor_msgs.msg import JointState

        self.stamp += 1
        message = JointState()
        message.header.stamp.sec = 1_700_000_000
        message.header.stamp.nanosec = self.stamp
        message.header.frame_id = frame_id
        message.name = list(names)
        message.position = array("d", positions)
        message.velocity = array("d", velocity)
        self.publisher.publish(message)
        return self.stamp

    def spin(self, done: Callable[[], bool], timeout: float = 5.0) -> bool:
        """Handle what arrives until something is done, or time is up; return whether it is."""
        deadline = time.monotonic() + timeout
        while not done() and (left := deadline - time.monotonic()) > 0.0:
            self.executor.spin_once(min(left, 0.05))
        return done()

    def answer(self, stamp: int, timeout: float = 5.0) -> Any:
        """Return the prediction with a stamp."""

        def found() -> list[Any]:
            return [p for p in self.predictions if p.header.stamp.nanosec == stamp]

        assert self.spin(lambda: bool(found()), timeout), f"no prediction with stamp {stamp}"
        [prediction] = found()
        return prediction

    def call(self, angles: Sequence[float]) -> Any:
        """Call the node's service and return its response."""
        from linkage_vibration_interfaces.srv import PredictVibration

        request = PredictVibration.Request(crank_angles=array("d", angles))
        future = self.client.call_async(request)
        assert self.spin(future.done, 10.0), "the service did not answer"
        return future.result()


@pytest.fixture(scope="module")
def meet(environment: dict[str, str]) -> Iterator[Callable[[str], Peer]]:
    """Return what makes a peer of the node of a name, once both have found each other."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from rclpy.signals import SignalHandlerOptions
    from sensor_msgs.msg import JointState

    from linkage_vibration_interfaces.msg import VibrationPrediction
    from linkage_vibration_interfaces.srv import PredictVibration

    context = Context()
    rclpy.init(context=context, domain_id=DOMAIN, signal_handler_options=SignalHandlerOptions.NO)
    peers: list[Peer] = []

    def find(name: str = "linkage_vibration") -> Peer:
        node = rclpy.create_node(f"peer_{len(peers)}", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        sensor = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
        peer = Peer(
            node,
            executor,
            node.create_publisher(JointState, "joint_states", sensor),
            node.create_client(PredictVibration, f"{name}/predict"),
        )
        topic = f"{name}/prediction"
        node.create_subscription(VibrationPrediction, topic, peer.predictions.append, 1000)
        node.create_subscription(VibrationPrediction, topic, peer.raw.append, 1000, raw=True)
        peers.append(peer)

        def answered() -> bool:
            """Whether a joint state comes back, which takes discovery on both sides."""
            stamp = peer.publish(["hitch_rockshaft_joint"], [2.0])
            peer.spin(lambda: any(p.header.stamp.nanosec == stamp for p in peer.predictions), 0.5)
            return any(p.header.stamp.nanosec == stamp for p in peer.predictions)

        assert peer.client.wait_for_service(DISCOVERY_TIMEOUT), "the node was not found"
        until(answered, "a first prediction")
        peer.spin(lambda: False, 0.2)
        peer.predictions.clear()
        peer.raw.clear()
        return peer

    yield find
    for peer in peers:
        peer.executor.shutdown()
        peer.node.destroy_node()
    context.try_shutdown()
