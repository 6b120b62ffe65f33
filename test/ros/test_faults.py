# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of inputs and log over DDS: each has a status, a level and a sentence of its own."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from linkage_vibration_interfaces.msg import VibrationPrediction
from test.support.ros_process import JOINT, SENSOR, until

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)


@dataclass
class Tractor:
    """Publishes what a tractor publishes, and collects the diagnostics of a node.

    Attributes
    ----------
    peer : Peer
    folder : Path
        The folder of the node's logs.
    name : str
        The name of the node.
    received : list of DiagnosticStatus
        The statuses of the node.
    """

    peer: Any
    folder: Path
    name: str = "faulty"
    received: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Make the publishers and the subscription."""
        node = self.peer.node
        self.joints = self.peer.publisher
        self.speeds = {
            name: node.create_publisher(Float64, f"{name}_speed", SENSOR)
            for name in ("engine", "pto", "ground")
        }
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _on_diagnostics(self, message: Any) -> None:
        self.received += [s for s in message.status if s.name.startswith(f"/{self.name}: ")]

    def say(
        self,
        angle: float,
        *,
        stamp: float = 0.0,
        names: Sequence[str] = (JOINT,),
        positions: Sequence[float] | None = None,
        publisher: Any = None,
    ) -> None:
        """Publish a joint state; ``stamp`` is relative to now (s), NaN for a stamp of zero."""
        message = JointState(name=list(names))
        message.position = [angle] * len(names) if positions is None else list(positions)
        if stamp == stamp:  # it is not NaN
            stamped = divmod(time.time_ns() + round(1e9 * stamp), 10**9)
            message.header.stamp.sec, message.header.stamp.nanosec = stamped
        (publisher or self.joints).publish(message)

    def wait_for(
        self,
        part: str,
        level: bytes,
        words: str,
        publish: Callable[[int], object] = lambda i: None,
        rate: float = 50.0,
    ) -> None:
        """Publish at a rate (Hz) until a status has a level and words."""
        self.received.clear()
        count = 0

        def found() -> bool:
            own = [s for s in self.received if s.name == f"/{self.name}: {part}"]
            return any(s.level == level and words in s.message for s in own)

        def step() -> None:
            nonlocal count
            publish(count)
            count += 1
            self.peer.pause(1.0 / rate)

        until(found, f"{part}: {words}", step)


@pytest.fixture(scope="module")
def tractor(
    start: Callable[..., Any], meet: Callable[[str], Any], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Tractor]:
    """Return a tractor with a node that watches it."""
    folder = tmp_path_factory.mktemp("logs")
    node = start(name="faulty", log_directory=folder)
    yield Tractor(meet("faulty"), folder)
    assert node.stop() == 0


@pytest.fixture(scope="module")
def strict(start: Callable[..., Any]) -> Iterator[Any]:
    """Return a node that asks for reliable readings."""
    override = "qos_overrides./strict_joints.subscription.reliability:=reliable"
    node = start("-p", override, name="strict", hitch_topic="/strict_joints")
    yield node
    assert node.stop() == 0


@pytest.mark.parametrize("kind", ["subscriber", "publisher"])
def test_qos_that_does_not_match(tractor: Tractor, strict: Any, kind: str) -> None:
    """A QoS that does not match is said for as long as its endpoint exists, and not after it."""
    name = "strict"
    watched, peer = Tractor(tractor.peer, tractor.folder, name), tractor.peer.node
    joints = peer.create_publisher(JointState, "/strict_joints", 100)
    if kind == "publisher":
        other = peer.create_publisher(JointState, "/strict_joints", SENSOR)
        part, end = "input", peer.destroy_publisher
        words = (
            "of /strict_joints has a QoS that does not match this node's, so nothing passes (Best"
        )
    else:
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        topic = f"/{name}/prediction"
        other = peer.create_subscription(VibrationPrediction, topic, lambda _: None, latched)
        part, end = "predictions", peer.destroy_subscription
        words = f"of {topic} has a QoS that does not match this node's, so nothing passes (Volatile"

    def publish(i: int) -> None:
        for source, speed in (("engine", 1500.0), ("pto", 540.0), ("ground", 2.0)):
            tractor.speeds[source].publish(Float64(data=speed))
        watched.say(2.0 + 1e-4 * (i % 7), publisher=joints)

    def own() -> list[Any]:
        return [s for s in watched.received if s.name == f"/{name}: {part}"]

    def step() -> None:
        publish(0)
        tractor.peer.pause(0.02)

    watched.wait_for(part, WARN, words, publish)
    watched.received.clear()
    until(lambda: len(own()) == 3, "three more statuses", step)
    assert all(status.level == WARN and words in status.message for status in own())
    if kind == "subscriber":
        assert words in strict.printed
    end(other)
    watched.wait_for(part, OK, "", publish)
    watched.received.clear()
    until(own, "one more status", step)
    assert all(words not in status.message for status in own())
    if kind == "publisher":
        peer.destroy_publisher(joints)
        joints = peer.create_publisher(JointState, "/strict_joints", SENSOR)
        watched.wait_for("input", STALE, words, publish)
    peer.destroy_publisher(joints)


def test_clock_that_goes_forward(tractor: Tractor, start: Callable[..., Any]) -> None:
    """A simulated clock that begins late, or goes on by 9 s, has not jumped; one by 492 s has.

    Before it begins, three statuses say that no time arrives, and the log says it once.
    """
    node = start(name="simulated", use_sim_time=True, hitch_topic="/simulated_joints")
    simulated = Tractor(tractor.peer, tractor.folder, "simulated")
    joints = tractor.peer.node.create_publisher(JointState, "/simulated_joints", SENSOR)

    def publish_at(second: int) -> Callable[[int], None]:
        def publish(i: int) -> None:
            tractor.peer.tick(10**9 * second + 10**6 * i)
            simulated.say(2.0, publisher=joints)

        return publish

    missing = "use_sim_time is true, but no time arrives on /clock"
    for part in ("predictions", "input", "speeds"):
        simulated.wait_for(part, STALE, missing, lambda i: simulated.say(2.0, publisher=joints))
    for second in (100, 109):
        simulated.wait_for("predictions", OK, "Predicting", publish_at(second))
    simulated.wait_for("predictions", WARN, "The clock has jumped", publish_at(601))
    [values] = [s.values for s in simulated.received[-5:] if s.values]
    assert ("clock jumps", "1") in [(each.key, each.value) for each in values]
    assert node.stop() == 0
    assert node.printed.count(missing) == 1
