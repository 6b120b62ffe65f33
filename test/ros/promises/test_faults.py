# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the node promises to say about faults of its inputs, in each condition.

Beside 1,000 readings a second, the faulty readings themselves come at this rate.
"""

import math
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from test.support.conditions import ERROR, OK, STALE, WARN, Promised, Tractor, promise
from test.support.ros_process import JOINT, SENSOR

STOPPED = "readings that stop are none"


@pytest.fixture(scope="module")
def logs(condition: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the node's logs."""
    return tmp_path_factory.mktemp("logs")


@pytest.fixture(scope="module")
def node(begin: Callable[..., Promised], logs: Path) -> Promised:
    """Return a node that watches its inputs."""
    return begin("watching", log_directory=logs)


Publish = Callable[[Tractor], object]
HOSTILE = "boom\n[ERROR] the brakes fail\x1b[2J"


def shows(node: Promised, part: str, level: bytes, words: str, publish: Publish) -> None:
    """Publish a fault, and wait until a status shows it."""
    publish(node.tractor)
    node.wait_for_status(part, level, words)


@promise("node.md#diagnostics")
def test_missing_joint(node: Promised) -> None:
    """A joint that does not arrive is an ERROR, with the joints that do."""
    words = f"has no joint {JOINT}; it has boom, bucket. Set joint_name"
    shows(node, "input", ERROR, words, lambda t: t.read(2.0, names=["boom", "bucket"]))
    words = r"boom\n[ERROR] the brakes fail\x1b[2J"
    shows(node, "input", ERROR, words, lambda t: t.read(2.0, names=[HOSTILE]))


@promise("node.md#diagnostics")
def test_arrays_of_different_sizes(node: Promised) -> None:
    """Arrays of different sizes, or a joint that occurs twice, are an ERROR."""
    words = "2 names but 1 elements in position"
    sizes = lambda t: t.read(2.0, names=[JOINT, "boom"], position=[2.0])  # noqa: E731
    shows(node, "input", ERROR, words, sizes)
    double = lambda t: t.read(2.0, names=[JOINT, JOINT])  # noqa: E731
    shows(node, "input", ERROR, "2 times; publish each name once", double)


@promise("node.md#diagnostics")
def test_no_numbers(node: Promised) -> None:
    """Readings that are no number are an ERROR."""
    shows(node, "input", ERROR, "is a number; check the sensor", lambda t: t.read(math.nan))


@promise("node.md#diagnostics")
def test_degrees(node: Promised) -> None:
    """Degrees instead of radians are an ERROR."""
    shows(node, "input", ERROR, "are in degrees (120)", lambda t: t.read(120.0))


@promise("node.md#diagnostics")
def test_wrong_sign(node: Promised) -> None:
    """A wrong sign, and readings that are all on one side of the table, are an ERROR."""
    words = "inside with the other sign; change the parameter hitch_sign"
    shows(node, "input", ERROR, words, lambda t: t.read(-2.0))
    shows(node, "input", ERROR, "are below", lambda t: t.read(0.4))


@promise("node.md#diagnostics")
def test_publishers_that_disagree(node: Promised) -> None:
    """Publishers that disagree are an ERROR, with their nodes."""
    second = node.peer.node.create_publisher(JointState, "joint_states", SENSOR)
    message = JointState(name=[JOINT], position=[2.1])
    timer = node.peer.node.create_timer(0.02, lambda: second.publish(message))
    words = f"The publishers of joint {JOINT} on /joint_states disagree ("
    node.tractor.read(2.0, stamp=None)
    status = node.wait_for_status("input", ERROR, words)
    assert node.peer.node.get_name() in status.message
    assert "load_topics" in status.message
    node.peer.node.destroy_timer(timer)
    node.peer.node.destroy_publisher(second)


@promise("node.md#diagnostics")
def test_stamps(node: Promised) -> None:
    """Stamps that are zero, old, or in the future are a WARN."""
    for stamp, words in ((None, "are zero"), (-30.0, "s old"), (5.0, "s in the future")):
        shows(node, "input", WARN, words, lambda t, stamp=stamp: t.read(2.0, stamp=stamp))


@promise("node.md#diagnostics")
def test_jumps(node: Promised) -> None:
    """Jumps that a crank cannot make are a WARN."""
    spikes = [2.6 if i % 10 == 5 else 2.0 for i in range(10)]
    # With a second publisher, though it is silent, the node takes the spikes for its values.
    node.peer.node.destroy_publisher(node.peer.publisher)
    words = "jump by up to 0.6 rad, which a crank cannot"
    shows(node, "input", WARN, words, lambda t: t.read(*spikes))
    node.peer.publisher = node.peer.node.create_publisher(JointState, "joint_states", SENSOR)


@promise("node.md#diagnostics")
def test_frozen_sensor(node: Promised) -> None:
    """A sensor that was noisy and stays the same is a WARN."""
    noise = np.random.default_rng(1).normal(0.0, 1e-3, 5000)
    node.tractor.speed(engine=1500.0)  # the engine shakes the sensor
    node.tractor.read(*(2.0 + noise).tolist())
    node.peer.pause(4.0)
    words = "never free of noise before; the sensor is frozen"
    shows(node, "input", WARN, words, lambda t: t.read(2.0))


@promise("node.md#diagnostics")
def test_wrong_velocity(node: Promised) -> None:
    """A velocity that is always 0 while the positions move is a WARN."""
    # A second, which is judged, shall have no whole period.
    moving = [2.3 + 0.3 * math.sin(2.0 * math.pi * i / 1300) for i in range(1300)]
    rate = node.tractor.rate
    steps = moving[:: max(1, round(200.0 / rate))]
    shows(node, "input", WARN, "The velocity of joint", lambda t: t.read(*steps, velocity=[0.0]))


@promise("node.md#diagnostics", kilohertz="the rate falls below 1 kHz")
def test_falling_rate(node: Promised) -> None:
    """A rate below 0.6 of the usual one is a WARN."""
    node.tractor.read(*(2.0 + 1e-4 * i for i in range(7)), rate=80.0)
    node.peer.pause(8.0)
    low = lambda t: t.read(*(2.0 + 1e-4 * i for i in range(7)), rate=12.0)  # noqa: E731
    shows(node, "input", WARN, "Hz instead of", low)


@promise("node.md#diagnostics", kilohertz=STOPPED)
def test_no_message(node: Promised) -> None:
    """No message for stale_after is STALE, with the publishers of the topic."""
    node.tractor.healthy()
    node.wait_for_status("predictions", OK, "Predicting")
    node.tractor.silence("joint_states")
    node.wait_for_status("predictions", STALE, "has not received joint")
    # Before, it may say that messages without a joint still arrive.
    node.wait_for_status("input", STALE, node.peer.node.get_name())


@promise("node.md#diagnostics")
def test_without_prediction(node: Promised) -> None:
    """Readings without a prediction are a WARN with their share."""
    shows(node, "predictions", WARN, "% of the crank angles", lambda t: t.read(2.0, 0.4, 2.0, 0.4))


@promise("node.md#diagnostics")
def test_node_of_the_same_name(node: Promised) -> None:
    """Another node of the same name is a WARN."""
    twin = rclpy.create_node(node.name, context=node.peer.node.context)
    shows(node, "predictions", WARN, "2 nodes have this name", lambda t: t.healthy())
    twin.destroy_node()


@promise("node.md#diagnostics")
def test_speed_without_a_number(node: Promised) -> None:
    """A speed that is not a number, and a negative speed of a shaft, are a WARN."""
    node.tractor.healthy()
    words = "The PTO speed on /pto_speed is nan"
    shows(node, "speeds", WARN, words, lambda t: t.speed(pto=math.nan))
    shows(node, "speeds", WARN, "negative", lambda t: t.speed(pto=-540.0))


@promise("node.md#diagnostics")
def test_speed_in_another_unit(node: Promised) -> None:
    """An engine outside 400 to 5000 rpm for 3 s is a WARN."""
    node.tractor.healthy()
    words = "engine speed on /engine_speed has been 200 rpm, which is not plausible"
    shows(node, "speeds", WARN, words, lambda t: t.speed(engine=200.0))


@promise("node.md#diagnostics")
def test_speed_that_stopped(node: Promised) -> None:
    """A speed that stopped is a WARN."""
    node.tractor.healthy()
    # The ground does not shake a tractor that stands, so everything is known.
    node.tractor.speed(engine=1500.0, pto=0.0, ground=0.0)
    node.wait_for_status("resonance", OK, "")
    words = "The engine speed on /engine_speed stopped"
    shows(node, "speeds", WARN, words, lambda t: t.silence("engine_speed"))


@promise("node.md#diagnostics")
def test_load_above_its_limit(node: Promised) -> None:
    """A load above its limit is a WARN of the resonance, and no longer when the limit is above."""
    node.tractor.healthy()
    node.tractor.speed(engine=2000.0, pto=540.0, ground=0.0)
    for limit, level, words in (
        (1e-6, WARN, "of the static force in "),
        (1e6, OK, "loads are "),
        (0.33, OK, "loads are "),
    ):
        value = Parameter("warning_load_ratio", value=limit).to_parameter_msg()
        [result] = node.ask("set_parameters", SetParameters, parameters=[value]).results
        assert result.successful, result.reason
        if limit != 0.33:
            node.wait_for_status("resonance", level, words)


@promise("node.md#diagnostics")
def test_speeds_are_lost(node: Promised) -> None:
    """Without a fresh speed the resonance is STALE."""
    node.tractor.healthy()
    node.tractor.silence("engine_speed", "pto_speed", "ground_speed")
    node.wait_for_status("resonance", STALE, "")


@promise("node.md#diagnostics")
def test_log_that_cannot_be_started(node: Promised, logs: Path) -> None:
    """A log that cannot be started is an ERROR."""
    shutil.rmtree(logs)
    assert not node.ask("start_recording", Trigger).success
    node.wait_for_status("log", ERROR, str(logs))


@promise("node.md#topics")
def test_faults_have_ended(node: Promised) -> None:
    """After all these faults, healthy readings have no fault, and the process has no traceback."""
    node.tractor.healthy()
    node.tractor.speed(engine=1500.0, pto=540.0, ground=0.0)
    for part in ("input", "predictions", "speeds"):
        node.wait_for_status(part, OK, "")
    assert "Traceback" not in node.node.printed
