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


@pytest.mark.parametrize(
    ("level", "words", "names", "angle"),
    [
        (ERROR, f"0 names but 1 elements in position, so the one of {JOINT} is unknown", [], 2.0),
        (
            WARN,
            f" % of the readings of joint {JOINT} on /joint_states are no numbers",
            None,
            float("nan"),
        ),
    ],
)
def test_readings_without_names_or_numbers(
    tractor: Tractor, level: bytes, words: str, names: list[str] | None, angle: float
) -> None:
    """Positions without names, and a sensor whose every second reading is NaN, are named."""

    def publish(i: int) -> None:
        named = {} if names is None else {"names": names, "positions": [2.0]}
        tractor.say(angle if i % 2 else 2.0, **named)

    tractor.wait_for("input", level, words, publish, 50.0)


def test_joints_that_arrived_instead_are_forgotten(tractor: Tractor) -> None:
    """When nothing arrives any more, the joints before are not named, but what is silent is."""

    def publish(_: int) -> None:
        tractor.say(2.0, names=["boom"])

    tractor.wait_for("input", ERROR, f"has no joint {JOINT}; it has boom", publish, 50.0)
    words = "Nothing has arrived from the publishers of /joint_states (peer_"
    tractor.wait_for("input", STALE, words)
    assert "boom" not in tractor.received[-4].message


def test_a_pto_that_no_shaft_can_be(tractor: Tractor) -> None:
    """A PTO that changes between 0 and 540 rpm ten times a second is no shaft."""

    def publish(i: int) -> None:
        tractor.say(2.0 + 1e-4 * (i % 7))
        tractor.speeds["pto"].publish(Float64(data=540.0 * (i // 5 % 2)))

    words = "The PTO speed on /pto_speed changed to and fro by 540 rpm "
    tractor.wait_for("speeds", WARN, words, publish, 50.0)


@pytest.mark.parametrize("kind", ["subscriber", "publisher"])
def test_qos_that_does_not_match(tractor: Tractor, start: Callable[..., Any], kind: str) -> None:
    """A QoS that does not match is said for as long as its endpoint exists, and not after it."""
    name = f"qos_{kind}"
    override = "qos_overrides./strict_joints.subscription.reliability:=reliable"
    node = start("-p", override, name=name, hitch_topic="/strict_joints")
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
    assert node.stop() == 0


def test_publisher_of_another_type(tractor: Tractor, start: Callable[..., Any]) -> None:
    """A publisher of another type is the cause that is named, with both types."""
    node = start(name="typed", hitch_topic="/typed_joints")
    typed = Tractor(tractor.peer, tractor.folder, "typed")
    other = tractor.peer.node.create_publisher(Float64, "/typed_joints", SENSOR)
    words = "send std_msgs/msg/Float64, not sensor_msgs/msg/JointState; set hitch_type"
    typed.wait_for("input", STALE, words)
    tractor.peer.node.destroy_publisher(other)
    assert node.stop() == 0


def test_reverse_is_no_fault(tractor: Tractor) -> None:
    """A negative ground speed is a speed, so that loads are known.

    So slowly, the lugs are too coarse for the level of the ground, so only known loads are named.
    """

    def publish(i: int) -> None:
        tractor.say(2.0 + 1e-4 * (i % 7))
        tractor.speeds["ground"].publish(Float64(data=-2.0))

    tractor.wait_for("resonance", STALE, "All known loads are ", publish, 50.0)


def test_nothing_is_watched(tractor: Tractor, start: Callable[..., Any]) -> None:
    """Without a publisher no status is OK, and each says what is expected from where."""
    node = start(name="lonely", hitch_topic="/no_joints", engine_topic="/enigne_speed")
    lonely = Tractor(tractor.peer, tractor.folder, "lonely")
    lonely.wait_for("input", STALE, "/no_joints has no publisher; start it, or set hitch_topic")
    lonely.wait_for("speeds", STALE, "The engine speed on /enigne_speed, PTO speed on /pto_speed, ")
    lonely.wait_for("resonance", STALE, "as no reading arrives")
    node.wait_for("No reading for more than 5 s: /no_joints has no publisher")
    joints = tractor.peer.node.create_publisher(JointState, "/no_joints", SENSOR)
    lonely.wait_for("input", STALE, "Nothing has arrived from the publishers of /no_joints (p")
    lonely.wait_for(
        "resonance", STALE, "as no speed has arrived", lambda i: lonely.say(2.0, publisher=joints)
    )
    lonely.wait_for(
        "speeds",
        WARN,
        "The engine speed on /enigne_speed, ground speed on /ground_speed did not arrive in the ",
        lambda i: lonely.speeds["pto"].publish(Float64(data=540.0)),
    )
    assert node.stop() == 0


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
