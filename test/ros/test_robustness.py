# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What comes on a machine: bursts, stamps out of order, clocks that jump, peers that die."""

import math
import subprocess
import sys
import time
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from builtin_interfaces.msg import Time
from mcap.reader import make_reader
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from linkage_vibration.bags.reading import read_messages
from linkage_vibration.prediction.inputs import PercentInput
from linkage_vibration.prediction.predictor import Predictor, Status
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from linkage_vibration_interfaces.msg import Resonance, TableInfo

JOINT = "hitch_rockshaft_joint"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SENSOR = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """Return a predictor on the table that the node uses."""
    return Predictor(load_table(config_file("tables/three_point_linkage.npz")))


@pytest.fixture(scope="module")
def node(start: Callable[..., Any]) -> Any:
    """Return a node that knows its angle to a hundredth of a radian."""
    return start(name="robust", angle_stddev=0.01)


@pytest.fixture(scope="module")
def peer(node: Any, meet: Callable[[str], Any]) -> Any:
    """Return a peer that the node has found."""
    return meet("robust")


def stamped(peer: Any, sec: int, nanosec: int, angle: float) -> None:
    """Publish a joint state with a stamp of one's own."""
    message = JointState(name=[JOINT], position=array("d", [angle]))
    message.header.stamp = Time(sec=sec, nanosec=nanosec)
    peer.publisher.publish(message)


def set_parameter(peer: Any, node: str, name: str, value: Any) -> Any:
    """Set a parameter as `ros2 param set` does, and return the result."""
    client = peer.node.create_client(SetParameters, f"{node}/set_parameters")
    assert client.wait_for_service(20.0)
    parameter = Parameter(name, value=value).to_parameter_msg()
    future = client.call_async(SetParameters.Request(parameters=[parameter]))
    assert peer.spin(future.done, 10.0)
    peer.node.destroy_client(client)
    return future.result().results[0]


def test_uncertainty_is_carried(peer: Any, predictor: Predictor) -> None:
    """The angle's standard deviation comes out as the frequencies', and can be set meanwhile."""
    message = peer.answer(peer.publish([JOINT], [2.5]))
    assert (
        message.frequency_stddev.tolist() == predictor.predict(2.5, 0.01).frequency_stddev.tolist()
    )
    assert set_parameter(peer, "robust", "angle_stddev", 0.02).successful
    message = peer.answer(peer.publish([JOINT], [2.5]))
    assert (
        message.frequency_stddev.tolist() == predictor.predict(2.5, 0.02).frequency_stddev.tolist()
    )
    refused = set_parameter(peer, "robust", "angle_stddev", -1.0)
    assert not refused.successful
    assert peer.answer(peer.publish([JOINT], [2.5])).frequency_stddev == message.frequency_stddev


def test_stamps_in_any_order(peer: Any, predictor: Predictor) -> None:
    """Late, twice, from the future or before time began: each is answered with its own stamp."""
    stamps = [(2_000_000_000, 0), (5, 7), (5, 7), (2**31 - 1, 999_999_999), (0, 0), (-5, 0)]
    peer.predictions.clear()
    for i, stamp in enumerate(stamps):
        stamped(peer, *stamp, 1.7 + 0.1 * i)
        assert peer.spin(lambda i=i: len(peer.predictions) > i)
    found = [(p.header.stamp.sec, p.header.stamp.nanosec) for p in peer.predictions]
    assert found == stamps
    for i, message in enumerate(peer.predictions):
        assert message.crank_angle == 1.7 + 0.1 * i
        assert message.status == Status.OK


def test_burst_at_5_khz(peer: Any, node: Any) -> None:
    """A burst that fits the queue is answered whole; a longer one is answered in part, in order."""
    peer.predictions.clear()
    begin = time.monotonic()
    for i in range(90):
        stamped(peer, 9, i, 2.0)
        while time.monotonic() < begin + i / 5000.0:
            pass
    assert peer.spin(lambda: len(peer.predictions) == 90)
    peer.predictions.clear()
    for i in range(5000):
        stamped(peer, 10, i, 2.0)

    def answered() -> bool:  # what follows such a burst may be lost as well
        stamp = peer.publish([JOINT], [2.0])
        return peer.spin(
            lambda: any(p.header.stamp.nanosec == stamp for p in peer.predictions), 1.0
        )

    assert peer.spin(answered, 20.0)
    stamps = [p.header.stamp.nanosec for p in peer.predictions if p.header.stamp.sec == 10]
    assert stamps == sorted(stamps)
    assert node.process.poll() is None


def test_publisher_that_dies_and_returns(peer: Any, environment: dict[str, str]) -> None:
    """Killed publishers leave nothing behind, and the next one is heard."""
    script = (
        "import time, rclpy\n"
        "from array import array\n"
        "from sensor_msgs.msg import JointState\n"
        "rclpy.init()\n"
        "node = rclpy.create_node('short_lived')\n"
        "publisher = node.create_publisher(JointState, 'joint_states', 10)\n"
        "while True:\n"
        f"    publisher.publish(JointState(name=['{JOINT}'], position=array('d', [2.25])))\n"
        "    time.sleep(0.01)\n"
    )
    for _ in range(2):
        process = subprocess.Popen([sys.executable, "-c", script], env=environment)
        try:
            peer.predictions.clear()
            heard = lambda: any(p.crank_angle == 2.25 for p in peer.predictions)  # noqa: E731
            assert peer.spin(heard, 20.0)
        finally:
            process.kill()
            process.wait()
    assert peer.answer(peer.publish([JOINT], [2.0])).status == Status.OK


def test_model_is_told_to_who_comes_late(peer: Any, predictor: Predictor) -> None:
    """Table and mechanism are on latched topics."""
    heard: list[Any] = []
    peer.node.create_subscription(TableInfo, "robust/table_info", heard.append, LATCHED)
    peer.node.create_subscription(String, "robust/mechanism", heard.append, LATCHED)
    assert peer.spin(lambda: len(heard) == 2, 10.0)
    info = next(m for m in heard if isinstance(m, TableInfo))
    text = next(m for m in heard if isinstance(m, String))
    assert info.table_id == predictor.table.table_id
    assert (info.n_modes, info.mechanism_name) == (3, "three_point_linkage")
    assert (info.crank_angle_first, info.crank_angle_last) == predictor.table.alpha3_range
    assert "E1.z" in info.places
    assert text.data == config_file("three_point_linkage.yaml").read_text()


def test_resonance_follows_the_engine(peer: Any, predictor: Predictor) -> None:
    """Heard on its topic, or fixed by a parameter, a speed is held against each prediction."""
    heard: list[Any] = []
    peer.node.create_subscription(Resonance, "robust/resonance", heard.append, 100)
    engine = peer.node.create_publisher(Float64, "engine_speed", SENSOR)
    mode = float(predictor.predict(2.0).natural_frequencies[1])

    def resonance(rpm: float | None) -> Any:
        if rpm is not None:
            engine.publish(Float64(data=rpm))
            peer.spin(lambda: False, 0.1)
        heard.clear()
        stamp = peer.publish([JOINT], [2.0], velocity=[0.01])
        peer.answer(stamp)
        assert peer.spin(lambda: any(r.header.stamp.nanosec == stamp for r in heard))
        return next(r for r in heard if r.header.stamp.nanosec == stamp)

    end = time.monotonic() + 20.0
    while not heard and time.monotonic() < end:  # until the node has found the publisher
        engine.publish(Float64(data=20.0 * mode))
        peer.publish([JOINT], [2.0])
        peer.spin(lambda: False, 0.1)
    found = resonance(20.0 * mode)  # the third order
    assert (found.state, found.excitation, found.mode) == (Resonance.STATE_WARNING, "engine 3", 1)
    assert found.relative_margin == pytest.approx(0.0, abs=1e-9)
    assert found.natural_frequency == mode
    assert resonance(20.0 * mode * 1.3).state == Resonance.STATE_CLEAR
    peer.spin(lambda: False, 1.2)
    stale = resonance(None)
    assert stale.state == Resonance.STATE_STALE
    assert math.isnan(stale.margin)
    assert set_parameter(peer, "robust", "engine_speed", 20.0 * mode * 1.05).successful
    assert resonance(500.0).relative_margin == pytest.approx(0.05, rel=1e-6)
    assert set_parameter(peer, "robust", "engine_speed", -1.0).successful


def test_hitch_position_in_percent(
    start: Callable[..., Any], meet: Callable[[str], Any], predictor: Predictor
) -> None:
    """By a calibration percent become angles; what the bus calls an error becomes a status."""
    points, angles = "[0.0, 40.0, 100.0]", "[3.1, 2.6, 1.6]"
    process = start(name="percent", input="percent", percent_points=points, percent_angles=angles)
    process.wait_for("Predicting for hitch position on /hitch_position")
    hitch = PercentInput((0.0, 40.0, 100.0), (3.1, 2.6, 1.6))
    other = meet("robust")
    heard: list[Any] = []
    from linkage_vibration_interfaces.msg import VibrationPrediction

    other.node.create_subscription(VibrationPrediction, "percent/prediction", heard.append, 100)
    publisher = other.node.create_publisher(Float64, "hitch_position", SENSOR)

    def answer(percent: float) -> Any:
        end = time.monotonic() + 20.0
        heard.clear()
        while not heard and time.monotonic() < end:
            publisher.publish(Float64(data=percent))
            other.spin(lambda: bool(heard), 0.5)
        return heard[-1]

    for percent in (0.0, 33.2, 100.0):
        reading = hitch.reading(percent)
        expected = predictor.predict(reading.crank_angle, reading.stddev)
        other.spin(lambda: False, 0.3)
        message = answer(percent)
        assert message.crank_angle == reading.crank_angle
        assert message.natural_frequencies.tolist() == expected.natural_frequencies.tolist()
        assert message.frequency_stddev.tolist() == expected.frequency_stddev.tolist()
        assert abs(message.header.stamp.sec - time.time()) < 30.0
    other.spin(lambda: False, 0.3)
    assert answer(102.0).status == Status.INVALID_ANGLE
    assert process.stop() == 0


def test_calibrated_while_it_works(
    start: Callable[..., Any], meet: Callable[[str], Any], tmp_path: Path
) -> None:
    """Another joint rule or input holds from the next message on, in a log of its own."""
    process = start(name="calibrated", record=True, log_directory=tmp_path)
    peer = meet("calibrated")
    hitch = peer.node.create_publisher(Float64, "hitch_position", SENSOR)
    for offset in (0.25, 1):
        assert set_parameter(peer, "calibrated", "offset", offset).successful
        assert peer.answer(peer.publish([JOINT], [1.7])).crank_angle == 1.7 + offset
    assert set_parameter(peer, "calibrated", "percent_angles", [3.0, 2.0]).successful
    for _ in range(80):  # some are under way when they are heard no more
        peer.publish([JOINT], [1.7])
    assert set_parameter(peer, "calibrated", "input", "percent").successful
    peer.spin(lambda: False, 0.2)
    peer.predictions.clear()

    def answered() -> bool:
        hitch.publish(Float64(data=50.0))
        return peer.spin(lambda: bool(peer.predictions), 0.2)

    assert peer.spin(answered, 20.0)
    assert peer.predictions[-1].crank_angle == 2.5
    refused = set_parameter(peer, "calibrated", "percent_angles", [3.0, 2.0, 2.5])
    assert "percent_points, percent_angles" in refused.reason
    assert process.stop() == 0
    offsets = set()
    for path in tmp_path.iterdir():
        with path.open("rb") as file:
            attached = {a.name: a.data for a in make_reader(file).iter_attachments()}
        settings = yaml.safe_load(attached["parameters.yaml"])["/calibrated"]["ros__parameters"]
        heard = [message.position[0] for _, message in read_messages(path, "/joint_states")]
        told = [m.crank_angle for _, m in read_messages(path, "/calibrated/prediction")]
        if settings["input"] == "joint_state" and heard:
            assert told == [position + settings["offset"] for position in heard]
            offsets.add(settings["offset"])
    assert offsets == {0.0, 0.25, 1.0}


def test_bag_that_loops(
    start: Callable[..., Any], meet: Callable[[str], Any], tmp_path: Path
) -> None:
    """When simulated time jumps back predictions go on, and the log keeps the order of arrival."""
    process = start(name="looped", use_sim_time=True, record=True, log_directory=tmp_path)
    peer = meet("looped")
    clock = peer.node.create_publisher(Clock, "/clock", QoSProfile(depth=1))
    assert peer.spin(lambda: clock.get_subscription_count() > 0, 20.0)
    for _ in range(10):  # the node may find the clock a moment later
        clock.publish(Clock(clock=Time(sec=99)))
        peer.spin(lambda: False, 0.1)
    for loop in range(3):
        for second in (100, 101, 102):
            clock.publish(Clock(clock=Time(sec=second)))
            peer.spin(lambda: False, 0.15)
            stamp = peer.publish([JOINT], [1.7 + 0.1 * loop])
            assert peer.answer(stamp).status == Status.OK
    assert process.stop() == 0
    [path] = tmp_path.iterdir()
    times = [time // 10**9 for time, _ in read_messages(path, "/looped/prediction")]
    assert sorted(times)[-9:] == [100] * 3 + [101] * 3 + [102] * 3


def test_recording_on_demand(
    start: Callable[..., Any], meet: Callable[[str], Any], tmp_path: Path
) -> None:
    """Services begin and end a log, also of extra topics, and say why where they cannot."""
    process = start(name="on_demand", log_directory=tmp_path, extra_topics="/note chatter")
    peer = meet("on_demand")
    note = peer.node.create_publisher(String, "/note", 10)
    start_client = peer.node.create_client(Trigger, "on_demand/start_recording")
    stop_client = peer.node.create_client(Trigger, "on_demand/stop_recording")

    def call(client: Any) -> Any:
        assert client.wait_for_service(20.0)
        future = client.call_async(Trigger.Request())
        assert peer.spin(future.done, 10.0)
        return future.result()

    assert peer.spin(lambda: note.get_subscription_count() > 0, 20.0)
    refused = call(stop_client)
    assert (refused.success, refused.message) == (False, "Nothing is being recorded.")
    logs = []
    for i in range(2):
        begun = call(start_client)
        assert begun.success
        assert "recorded already" in call(start_client).message
        for k in range(5):
            note.publish(String(data=f"{i} {k}"))
            peer.answer(peer.publish([JOINT], [2.0]))
        peer.spin(lambda: False, 0.2)
        ended = call(stop_client)
        assert ended.success
        assert ended.message == begun.message
        logs.append(Path(ended.message))
    assert logs[0] != logs[1]
    for i, path in enumerate(logs):
        notes = [message.data for _, message in read_messages(path, "/note")]
        assert notes == [f"{i} {k}" for k in range(5)]
        assert len(list(read_messages(path, "/on_demand/prediction"))) == 5
    assert process.stop() == 0
