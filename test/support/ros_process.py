# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Node processes, and a peer that exchanges messages with them over DDS.

Every wait ends with an event. Its limit only ends a test that has failed, so it is generous: a
machine with busy cores is many times slower than an idle one.
"""

import os
import re
import signal
import struct
import subprocess
import sys
import time
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rclpy
import yaml
from builtin_interfaces.msg import Time
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from linkage_vibration_interfaces.action import SetImplement
from linkage_vibration_interfaces.msg import VibrationPrediction
from linkage_vibration_interfaces.srv import PredictVibration

LIMIT = 120.0  # s, of every wait
JOINT = "hitch_rockshaft_joint"
SENSOR = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


def until(
    condition: Callable[[], object], event: str, wait: Callable[[], object] | None = None
) -> None:
    """Wait until a condition holds; `event` says what is awaited, for the message of a failure.

    Between two looks at the condition, `wait` is called, or sleeps for a moment by default.
    """
    end = time.monotonic() + LIMIT
    while not condition():
        assert time.monotonic() < end, f"waited {LIMIT:g} s in vain for {event}"
        if wait is None:
            time.sleep(0.02)
        else:
            wait()


def slowness() -> float:
    """Return how many times slower than an idle machine this one is, at least 1.

    The load is a mean over a minute, so the share of a core that 50 ms of work get counts, too.
    """
    began, used = time.monotonic(), time.thread_time()
    while time.thread_time() < used + 0.05:
        pass
    return max(os.getloadavg()[0] / (os.cpu_count() or 1), (time.monotonic() - began) / 0.05, 1.0)


def documented(page: str, word: str) -> dict[str, Any]:
    """Return the parameters of the first YAML block of a page that contains a word."""
    text = (Path(__file__).parents[2] / "docs" / page).read_text()
    blocks = re.findall(r"^```yaml\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    block = yaml.safe_load(next(block for block in blocks if word in block))
    parameters: dict[str, Any] = block["linkage_vibration"]["ros__parameters"]
    return parameters


def has_loaded(pid: int, library: str) -> bool:
    """Return whether a process has loaded a file with this name in its path."""
    return library in Path(f"/proc/{pid}/maps").read_text()


@dataclass
class RunningNode:
    """A node in a process of its own, and the file that holds what it prints."""

    process: "subprocess.Popen[bytes]"
    output: Path

    @property
    def printed(self) -> str:
        """Everything that the node has printed so far."""
        return self.output.read_text()

    def wait_for(self, words: str) -> None:
        """Return when the node has printed these words."""
        until(lambda: words in self.printed or self.process.poll() is not None, words)
        assert words in self.printed, self.printed

    def wait_for_signal_handlers(self) -> None:
        """Return when the node handles signals; before that, Python itself is starting."""
        status = Path(f"/proc/{self.process.pid}/status")

        def handled() -> int:
            [mask] = [line for line in status.read_text().splitlines() if "SigCgt" in line]
            return int(mask.split()[1], 16) >> (signal.SIGTERM - 1) & 1

        until(handled, "the signal handlers")

    def has_waiting_signals(self) -> bool:
        """Return whether a signal was sent that the process has not handled yet."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return any(int(line.split()[1], 16) for line in status.splitlines() if "Pnd" in line)

    def has_loaded(self, library: str) -> bool:
        """Return whether the process has loaded a library of a Python package, or has ended."""
        return self.process.poll() is not None or has_loaded(self.process.pid, library)

    def stop(self, by: signal.Signals = signal.SIGINT) -> int:
        """Send the node a signal, wait for its end, and return its exit code.

        A node that does not end says with SIGABRT where its threads are.
        """
        if self.process.poll() is None:
            self.process.send_signal(by)
        try:
            return self.process.wait(LIMIT)
        except subprocess.TimeoutExpired:
            self.process.send_signal(signal.SIGABRT)
            self.process.wait(LIMIT)
            raise AssertionError(f"The node did not end by {by.name}: {self.printed}") from None


def installed_command() -> Path:
    """Return the command that pip or colcon has installed for the node."""
    folders = [Path(sys.executable).parent]
    prefixes = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    folders += [Path(prefix) / "lib" / "linkage_vibration" for prefix in prefixes]
    found = [folder / "linkage_vibration_node" for folder in folders]
    commands = [path for path in found if path.is_file()]
    assert commands, f"linkage_vibration_node is not installed in {folders}"
    return commands[0]


def start_node(
    output: Path,
    environment: dict[str, str],
    *arguments: str,
    name: str = "linkage_vibration",
    program: Sequence[str] = (),
    **parameters: Any,
) -> RunningNode:
    """Start a node of a name in a process of its own, with further ROS arguments and parameters.

    It prints into a file. Python may run another program than the installed command.
    """
    command = [sys.executable, *program] if program else [str(installed_command())]
    command += ["--ros-args", "-r", f"__node:={name}", *arguments]
    for key, value in parameters.items():
        command += ["-p", f"{key}:={str(value).lower() if value in (True, False) else value}"]
    with output.open("wb") as file:
        process = subprocess.Popen(
            command,
            env={**environment, "PYTHONFAULTHANDLER": "1"},
            stdout=file,
            stderr=subprocess.STDOUT,
            preexec_fn=_restore_hangups,
        )
    return RunningNode(process, output)


@contextmanager
def own_context(domain: int) -> Iterator[Context]:
    """Give an rclpy context on a ROS domain, in which rclpy leaves signals alone."""
    context = Context()
    rclpy.init(context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield context
    finally:
        context.try_shutdown()


def response(client: Any, request: Any, spin: Callable[[float], object]) -> Any:
    """Return the response of a service to a request; `spin` receives messages for some seconds.

    The request is sent again if there is none for a while: DDS loses a response if the service has
    not found the client yet.
    """
    futures: list[Any] = []

    def ask() -> None:
        futures.append(client.call_async(request))
        end = time.monotonic() + LIMIT / 6.0
        while not futures[-1].done() and time.monotonic() < end:
            spin(0.05)

    until(lambda: any(future.done() for future in futures), "a service's response", ask)
    return next(future.result() for future in futures if future.done())


@dataclass
class Peer:
    """Publishes joint states, receives predictions and calls ``~/predict``, as another participant.

    It has a publisher of a simulated clock, too. `predictions` and `raw` are all predictions so
    far; with `own`, only those for its own joint states. `second` is that of every stamp, which
    tells the peers apart, and `stamp` has the nanoseconds of the last one.
    """

    node: Any
    executor: Any
    publisher: Any
    clock: Any
    client: Any
    second: int
    predictions: list[Any] = field(default_factory=list)
    raw: list[bytes] = field(default_factory=list)
    stamp: int = 0
    own: bool = False

    def tick(self, time: int) -> None:
        """Set the simulated clock of the nodes that have one, ns."""
        self.clock.publish(Clock(clock=Time(sec=time // 10**9, nanosec=time % 10**9)))

    def publish(
        self,
        names: Sequence[str] = (JOINT,),
        positions: Sequence[float] = (2.0,),
        *,
        velocity: Sequence[float] = (),
        frame_id: str = "",
    ) -> int:
        """Publish a joint state with a new stamp, and return the stamp's nanoseconds."""
        self.stamp += 1
        message = JointState()
        message.header.stamp.sec = self.second
        message.header.stamp.nanosec = self.stamp
        message.header.frame_id = frame_id
        message.name = list(names)
        message.position = array("d", positions)
        message.velocity = array("d", velocity)
        self.publisher.publish(message)
        return self.stamp

    def ask(
        self, names: Sequence[str] = (JOINT,), positions: Sequence[float] = (2.0,), **fields: Any
    ) -> Any:
        """Publish a joint state, again if it is lost, and return the prediction that answers it.

        Best-effort messages can be lost, above all while DDS changes to shared memory.
        """
        first = self.stamp + 1

        def answers() -> list[Any]:
            stamps = [(p, p.header.stamp) for p in self.predictions]
            return [p for p, at in stamps if at.sec == self.second and at.nanosec >= first]

        def publish() -> None:
            self.publish(names, positions, **fields)
            self.pause(5.0, answers)

        until(answers, f"a prediction with stamp {first} or later", publish)
        return answers()[0]

    def on_prediction(self, data: bytes) -> None:
        """Keep a prediction."""
        [second] = struct.unpack_from("<i", data, 4)
        if self.own and second != self.second:
            return  # decoding 1,000 a second takes time
        self.raw.append(data)
        self.predictions.append(deserialize_message(data, VibrationPrediction))

    def pause(self, seconds: float, done: Callable[[], object] = lambda: False) -> None:
        """Receive messages for some seconds, or until something is done."""
        end = time.monotonic() + seconds
        while not done() and (left := end - time.monotonic()) > 0.0:
            self.executor.spin_once(min(left, 0.05))

    def spin(self, done: Callable[[], object], event: str = "an event") -> None:
        """Receive messages until something is done."""
        until(done, event, lambda: self.executor.spin_once(0.05))

    def request(self, client: Any, request: Any) -> Any:
        """Return the response of a service to a request, which may be sent again."""
        self.spin(client.service_is_ready, "a service")
        return response(client, request, self.executor.spin_once)

    def implement(self, node: str, **fields: Any) -> Any:
        """Send a node the goal to use another implement, and return the result."""
        client: Any = ActionClient(self.node, SetImplement, f"{node}/set_implement")
        self.spin(client.server_is_ready, "the action")
        sent = client.send_goal_async(SetImplement.Goal(**fields))
        self.spin(sent.done, "the answer to a goal")
        result = sent.result().get_result_async()
        self.spin(result.done, "the result of a goal")
        client.destroy()
        return result.result().result

    def call(self, angles: Sequence[float]) -> Any:
        """Call the node's prediction service and return its response."""
        request = PredictVibration.Request(crank_angles=array("d", angles))
        return self.request(self.client, request)


@contextmanager
def peer_of(
    name: str, domain: int, number: int = 0, *, own: bool = False, reads: bool = True
) -> Iterator[Peer]:
    """Give a peer of the node of a name, once messages pass in both directions.

    No other peer on this domain has its number. With `own`, it keeps only predictions for its own
    joint states. `reads` says whether the node reads its joint states, and is active.
    """

    def publish() -> None:
        peer.tick(1)  # a node with a simulated clock predicts as soon as it runs
        peer.publish()
        peer.pause(0.5)

    with own_context(domain) as context:
        node = rclpy.create_node(f"peer_{number}", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        publisher = node.create_publisher(JointState, "joint_states", SENSOR)
        client = node.create_client(PredictVibration, f"{name}/predict")
        clock = node.create_publisher(Clock, "/clock", 10)
        peer = Peer(node, executor, publisher, clock, client, 1_700_000_000 + number, own=own)
        node.create_subscription(
            VibrationPrediction, f"{name}/prediction", peer.on_prediction, 1000, raw=True
        )
        try:
            peer.spin(lambda: name in node.get_node_names(), f"the node {name}")
            if reads:
                peer.spin(client.service_is_ready, f"the services of {name}")
                until(lambda: peer.predictions, "a prediction", publish)
                # Predictions come in the order of the joint states, so that none follows that of
                # the last one, which a busy node may answer after an earlier try.
                peer.ask()
                peer.pause(5.0, lambda: peer.predictions[-1].header.stamp.nanosec == peer.stamp)
            peer.predictions.clear()
            peer.raw.clear()
            yield peer
        finally:
            executor.shutdown()
            node.destroy_node()


def _restore_hangups() -> None:
    """Let SIGHUP end a process, although tests that ``nohup`` runs ignore it."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
