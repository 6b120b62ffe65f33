# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The state of the load over DDS: each transition on both sides, and what acts on it."""

import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_msgs.msg import Float64

from linkage_vibration.bags.can_logs import DEFINITION
from linkage_vibration.support.resources import config_file, share_directory
from linkage_vibration_interfaces.msg import LoadState, VibrationPrediction
from test.support.can_bus import identifier
from test.support.interface_packages import built_package, environment_with
from test.support.ros_process import (
    JOINT,
    SENSOR,
    Peer,
    RunningNode,
    own_context,
    peer_of,
    start_node,
    until,
)

EXCITATIONS = """
rotor: {speed: pto, orders: [1], force: [800.0], at: E1.z, at_speed: 540.0}
engine: {speed: engine, orders: [1]}
"""
DWELL = 0.6  # s
UNKNOWN, CLEAR, NOTE, WARNING = 0, 1, 2, 3
CRANK, ENGINE, PTO = 1, 2, 4  # bits of unknown_sources


class Tractor:
    """Publishes readings at 50 Hz and speeds at 10 Hz, and receives load states."""

    def __init__(self, peer: Peer, name: str) -> None:
        self.peer, self.name, self.angle = peer, name, math.radians(120.0)
        self.speeds: dict[str, float | None] = {"engine": 3000.0, "pto": 540.0}
        self.reads, self.received, self._turn = True, list[Any](), 0
        create = peer.node.create_publisher
        self._publishers = {k: create(Float64, f"{k}_speed", SENSOR) for k in self.speeds}
        kind, topic = LoadState, f"{name}/load_state"
        peer.node.create_subscription(kind, topic, self.received.append, 100)

    def step(self) -> None:
        """Publish for 20 ms."""
        if self.reads:
            stamp = time.time_ns()
            self.peer.second, self.peer.stamp = stamp // 10**9, stamp % 10**9 - 1
            self.peer.publish([JOINT], [self.angle], velocity=[0.0])
        if self._turn % 5 == 0:
            for name, speed in self.speeds.items():
                if speed is not None:
                    self._publishers[name].publish(Float64(data=speed))
        self._turn += 1
        self.peer.pause(0.02)

    def wait(self, state: int, unknown: int = 0) -> Any:
        """Return the first load state from now on that has a state and unknown sources."""
        self.received.clear()

        def fits() -> list[Any]:
            return [s for s in self.received if (s.state, s.unknown_sources) == (state, unknown)]

        until(fits, f"state {state} with unknown sources {unknown}", self.step)
        return fits()[0]

    def stays(self, state: int, seconds: float = 2.0 * DWELL) -> None:
        """Check that a state lasts."""
        self.received.clear()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.step()
        assert {message.state for message in self.received} == {state}

    def set(self, **values: float) -> None:
        """Set live parameters of the node."""
        client = self.peer.node.create_client(SetParameters, f"{self.name}/set_parameters")
        parameters = [Parameter(n, value=v).to_parameter_msg() for n, v in values.items()]
        answer = self.peer.request(client, SetParameters.Request(parameters=parameters))
        assert all(result.successful for result in answer.results), answer.results


@pytest.fixture(scope="module")
def tractor(
    start: Callable[..., RunningNode],
    meet: Callable[[str], Peer],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Tractor]:
    """Return a tractor beside a node that watches a rotor on the PTO, and the engine."""
    file = tmp_path_factory.mktemp("loads") / "excitations.yaml"
    file.write_text(EXCITATIONS)
    node = start(name="loaded", excitation_file=str(file), warning_dwell=DWELL, near_margin=0.0)
    yield Tractor(meet("loaded"), "loaded")
    assert node.stop() == 0


def test_every_transition(tractor: Tractor) -> None:
    """Each state is entered and left where the manual says so, with limits on both sides of a load.

    The limits follow the load ratio that the first message states, as no force is measured here.
    """
    tractor.speeds["pto"] = None
    assert tractor.wait(UNKNOWN, PTO).known_share == pytest.approx(
        0.0
    )  # the engine has no amplitude
    tractor.speeds["pto"] = 540.0
    tractor.set(warning_load_ratio=100.0, note_load_ratio=99.0)
    clear = tractor.wait(CLEAR)
    load = float(clear.total_load_ratio)
    assert (clear.known_share, clear.speed_source, clear.excitation_index) == (0.5, 2, 0)
    tractor.set(note_load_ratio=1.01 * load)
    tractor.stays(CLEAR)
    tractor.set(note_load_ratio=0.99 * load, warning_load_ratio=1.01 * load)
    tractor.wait(NOTE)
    tractor.stays(NOTE)
    tractor.set(warning_load_ratio=0.99 * load)
    began = time.monotonic()
    warning = tractor.wait(WARNING)
    assert time.monotonic() - began > 0.8 * DWELL
    assert warning.speed_source == 2
    tractor.set(warning_load_ratio=1.01 * load)
    began = time.monotonic()
    tractor.wait(NOTE)
    assert time.monotonic() - began > 0.8 * DWELL
    tractor.set(warning_load_ratio=0.99 * load)
    tractor.wait(WARNING)
    tractor.speeds["pto"] = None  # the load that is known is lost
    lost = tractor.wait(UNKNOWN, PTO)
    assert math.isnan(lost.total_load_ratio)
    tractor.stays(UNKNOWN)
    tractor.speeds["pto"] = 540.0
    tractor.wait(WARNING)
    tractor.angle = math.nan
    tractor.wait(UNKNOWN, CRANK)
    tractor.angle = math.radians(120.0)
    tractor.wait(WARNING)
    tractor.set(warning_load_ratio=100.0, note_load_ratio=99.0)
    tractor.wait(CLEAR)
    tractor.speeds["engine"] = None  # which has no load of its own
    tractor.wait(UNKNOWN, ENGINE)
    tractor.set(engine_speed=0.0)  # declares that there is none
    tractor.wait(CLEAR)
    tractor.set(engine_speed=-1.0)
    tractor.wait(UNKNOWN, ENGINE)
    tractor.speeds["engine"] = 3000.0
    tractor.wait(CLEAR)


def test_a_silent_crank_is_unknown(tractor: Tractor) -> None:
    """Without readings a message comes each second, is unknown and does not count."""
    tractor.wait(CLEAR)
    count = tractor.received[-1].count
    tractor.reads = False
    first = tractor.wait(UNKNOWN, CRANK)
    assert first.count >= count
    second = tractor.wait(UNKNOWN, CRANK)
    assert second.count == first.count
    assert abs(second.header.stamp.sec - time.time()) < 5.0
    tractor.reads = True
    assert tractor.wait(CLEAR).count > second.count


def test_the_load_is_unknown_before_the_first_reading(
    start: Callable[..., RunningNode], domain: int, tmp_path: Path
) -> None:
    """From the activation on a message comes each second, with the speeds that are not known."""
    file = tmp_path / "excitations.yaml"
    file.write_text(EXCITATIONS)
    node = start(name="early", excitation_file=str(file))
    with peer_of("early", domain, 99, reads=False) as peer:
        tractor = Tractor(peer, "early")
        tractor.reads, tractor.speeds = False, {"engine": None, "pto": None}
        first = tractor.wait(UNKNOWN, CRANK | ENGINE | PTO)
        assert (first.count, first.known_share, first.excitation_index) == (0, 0.0, -1)
        tractor.reads = True  # without any speed, nothing is assessed
        assert tractor.wait(UNKNOWN, ENGINE | PTO).count == 0
        tractor.reads, tractor.speeds = False, {"engine": 3000.0, "pto": 540.0}
        assert tractor.wait(UNKNOWN, CRANK).count == 0
        tractor.reads = True
        assert tractor.wait(CLEAR).count > 0
    assert node.stop() == 0


def test_the_pto_is_slowed(tractor: Tractor, environment: dict[str, str]) -> None:
    """The example asks for less while nothing is known, and for the quiet speed in a warning."""
    load = float(tractor.wait(CLEAR).total_load_ratio)
    asked: list[float] = []
    node = tractor.peer.node
    node.create_subscription(Float64, "pto_speed_command", lambda m: asked.append(m.data), 10)
    example = [sys.executable, str(share_directory() / "examples" / "slow_pto.py"), "--ros-args"]
    topic = "/linkage_vibration/load_state:=/loaded/load_state"
    process = subprocess.Popen([*example, "-r", topic, "-p", "wanted:=56.5"], env=environment)
    try:
        until(lambda: asked, "a speed", tractor.step)
        assert asked[-1] == 56.5
        tractor.speeds["pto"] = None
        until(lambda: asked[-1] == 0.8 * 56.5, "a smaller speed", tractor.step)
        tractor.speeds["pto"] = 540.0
        tractor.set(warning_load_ratio=0.9 * load, note_load_ratio=0.8 * load)
        quiet = tractor.wait(WARNING).quiet_speed
        expected = min(56.5, quiet) if quiet == quiet else 56.5
        until(lambda: asked[-1] == pytest.approx(expected), "the quiet speed", tractor.step)
        tractor.set(warning_load_ratio=100.0, note_load_ratio=99.0)
    finally:
        process.kill()
        process.wait()


@pytest.mark.nightly(short="test_every_transition")
def test_inputs_from_three_places(environment: dict[str, str], domain: int, tmp_path: Path) -> None:
    """With the shipped file, an angle in degrees, an engine and a PTO on the bus are known."""
    pytest.importorskip("can", reason="frames of a CAN bus need python-can (extra can)")
    definition = DEFINITION.partition("=====")[0]
    variables = environment_with(environment, built_package("can_msgs", {"Frame": definition}))
    script = tmp_path / "publish.py"
    script.write_text(PUBLISHER.format(group=identifier(65091, 0)))
    file = config_file("mixed_inputs.params.yaml")
    node = start_node(tmp_path / "node.txt", variables, "--params-file", str(file), name="mixed")
    tractor = subprocess.Popen([sys.executable, script], env=variables)
    try:
        node.wait_for("Predicting for field data on /hitch/angle_deg")
        states: list[Any] = []
        angles: list[float] = []
        with own_context(domain) as context:
            peer = rclpy.create_node("mixing", context=context)
            executor = SingleThreadedExecutor(context=context)
            executor.add_node(peer)
            peer.create_subscription(LoadState, "mixed/load_state", states.append, 10)
            peer.create_subscription(
                VibrationPrediction,
                "mixed/prediction",
                lambda m: angles.append(math.degrees(m.crank_angle)),
                10,
            )
            known = lambda: angles and any(s.unknown_sources == 0 for s in states)  # noqa: E731
            until(known, "all sources", lambda: executor.spin_once(0.1))
            executor.shutdown()
            peer.destroy_node()
        assert angles[-1] == pytest.approx(120.0, abs=1e-4)
        assert node.stop() == 0
    finally:
        tractor.kill()
        tractor.wait()
        node.process.kill()


PUBLISHER = """
import time
import rclpy
from can_msgs.msg import Frame
from rclpy.node import Node
from std_msgs.msg import Float32

rclpy.init()
node = Node("three_places")
angle = node.create_publisher(Float32, "hitch/angle_deg", 10)
engine = node.create_publisher(Float32, "engine/rpm", 10)
bus = node.create_publisher(Frame, "from_can_bus", 10)
frame = Frame(id={group}, is_extended=True, dlc=8)
frame.data[:2] = list(round(540 / 0.125).to_bytes(2, "little"))
for _ in range(2400):
    engine.publish(Float32(data=1800.0))
    bus.publish(frame)
    angle.publish(Float32(data=120.0))
    time.sleep(0.05)
"""
