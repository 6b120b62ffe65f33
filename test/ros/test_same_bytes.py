# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A drive gives the same bytes live over DDS and offline."""

import math
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from scipy.signal import lfilter
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration_interfaces.msg import (
    Advice,
    LoadState,
    MeasuredVibration,
    Resonance,
    VibrationPrediction,
)
from test.support.messages import raw_messages
from test.support.ros_process import until

PREDICTION, RESONANCE, LOAD_STATE, ADVICE = (
    f"/linkage_vibration/{name}" for name in ("prediction", "resonance", "load_state", "advice")
)
SETTINGS = Parameters(
    hitch_sign=-1,
    hitch_scale=0.98,
    hitch_offset=4.7,
    angle_stddev=2e-3,
    stale_after=30.0,  # a busy machine may need a second for the readings between two speeds
    warning_load_ratio=0.005,
    note_load_ratio=0.001,
    ground_speed=7.0,  # so that the ground has a level
)


PLAYED = 1000  # messages of the drive, of 8 s


def test_live_and_offline(
    start: Callable[..., Any], meet: Callable[..., Any], tmp_path: Path
) -> None:
    """DDS carries the bytes of the replay, and a replay of the node's log gives the same log."""
    drive = config_file("drives/hitch_duty_cycle.mcap")
    offline = tmp_path / "offline.mcap"
    replay([drive], offline, SETTINGS)
    names = ["hitch_sign", "hitch_scale", "hitch_offset", "angle_stddev", "stale_after"]
    names += ["warning_load_ratio", "note_load_ratio", "ground_speed"]
    given = {name: getattr(SETTINGS, name) for name in names}
    given |= {"record": True, "log_directory": tmp_path}
    node = start(**given)
    peer = meet("linkage_vibration")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    late: list[Any] = []
    publishers = {
        topic: peer.node.create_publisher(Float64, topic, 10)
        for topic in ("/engine_speed", "/pto_speed")
    }
    publishers["/joint_states"] = peer.publisher
    for publisher in publishers.values():
        peer.spin(lambda publisher=publisher: publisher.get_subscription_count() > 0)
    sent, played = 0, raw_messages(drive, *publishers)[:PLAYED]
    for topic, _, data in played:
        kind = JointState if topic == "/joint_states" else Float64
        publishers[topic].publish(deserialize_message(data, kind))
        sent += kind is JointState
        peer.spin(lambda sent=sent: len(peer.raw) >= sent, "a prediction")
    # A subscriber that comes late receives the last advice.
    peer.node.create_subscription(Advice, ADVICE, late.append, latched)
    peer.spin(lambda: bool(late), "advice")
    assert node.stop() == 0

    expected = [each for each in raw_messages(offline, PREDICTION) if each[1] <= played[-1][1]]
    # DDS fills its payload up to a multiple of four.
    padded = [data + b"\x00" * (-len(data) % 4) for *_, data in expected]
    assert [bytes(data) for data in peer.raw] == padded
    [log] = tmp_path.glob("linkage_vibration_*.mcap")
    again = tmp_path / "again.mcap"
    replay([log], again, SETTINGS)
    kinds = {PREDICTION: VibrationPrediction, RESONANCE: Resonance, LOAD_STATE: LoadState}
    for topic, kind in {**kinds, ADVICE: Advice}.items():
        recorded = raw_messages(log, topic)
        assert recorded
        pairs = zip(raw_messages(again, topic), recorded, strict=True)
        differ = [pair for pair in pairs if pair[0] != pair[1]]
        assert not differ, [(at, deserialize_message(data, kind)) for _, at, data in differ[0]]
    *_, (_, _, last) = recorded
    # Arrays are not compared, as they contain NaN.
    assert late[0].sentence == deserialize_message(last, Advice).sentence != ""
    assert late[0].header == deserialize_message(last, Advice).header


def test_simulated_clock(
    start: Callable[..., Any], meet: Callable[..., Any], tmp_path: Path
) -> None:
    """A replay of the log has the answers of a node whose clock begins late, and jumps back twice.

    Nothing is used that arrives before the clock begins, such as the first speed.
    """
    start(name="plain")
    peer = meet("plain")
    node = start(name="simulated", use_sim_time=True, record=True, log_directory=tmp_path)
    answers, diagnostics = list[bytes](), list[Any]()
    subscribe = peer.node.create_subscription
    subscribe(VibrationPrediction, "/simulated/prediction", answers.append, 1000, raw=True)
    subscribe(DiagnosticArray, "/diagnostics", diagnostics.append, 10)
    engine = peer.node.create_publisher(Float64, "/engine_speed", 10)
    peer.spin(lambda: engine.get_subscription_count() == 2)

    def received() -> int:
        """Return how many readings the node has received, by its last diagnostics."""
        actual = [s for m in diagnostics for s in m.status if s.name == "/simulated: predictions"]
        return (
            int({v.key: v.value for v in actual[-1].values}["messages received"]) if actual else 0
        )

    def read(time: int, pause: float = 1.0) -> None:
        peer.tick(time)
        peer.second, peer.stamp = divmod(time - 1, 10**9)
        peer.publish(positions=[1.9 + 2e-10 * time])
        peer.pause(pause, lambda: len(answers) > before)

    def early() -> None:
        peer.publish()
        peer.pause(0.2)

    engine.publish(Float64(data=1800.0))
    until(lambda: received() > 5, "readings without a time", early)
    assert answers == []
    assert "no time arrives on /clock" in node.printed
    times = [20_000_000 * k for k in range(1, 51)]
    for loop, time in product(range(3), times):
        if loop or time > times[24]:
            engine.publish(Float64(data=1700.0 + 1e-7 * time))
        before = len(answers)
        until(lambda: len(answers) > before, "a prediction", partial(read, time))  # noqa: B023
    assert node.stop() == 0
    [log] = tmp_path.glob("linkage_vibration_*.mcap")
    again, counts = tmp_path / "again.mcap", list[int]()
    replay(log, again, Parameters())
    for topic in ("prediction", "resonance", "load_state"):
        recorded = [(time, data) for _, time, data in raw_messages(log, f"/simulated/{topic}")]
        replayed = raw_messages(again, f"/linkage_vibration/{topic}")
        assert [(time, data) for _, time, data in replayed] == recorded
        counts.append(len(recorded))
    # The speeds may change their places with the readings after them.
    assert counts[0] >= 150
    # One in 100 ms of the 2.5 s with a speed, and one of what waited before each jump.
    assert 20 <= counts[1] == counts[2] <= 30


def test_sensors_beside_predictions(
    start: Callable[..., Any], meet: Callable[..., Any], tmp_path: Path
) -> None:
    """Samples of an IMU are compared once a second, live and with the same bytes in a replay.

    The order of the engine that the samples contain has the amplitude that the message says.
    """
    file = tmp_path / "sensors.yaml"
    file.write_text("imu: {topic: /imu, unit: m/s2, at: E1, filtered: true}\n")
    given = {"sensor_file": file, "engine_speed": 1500.0}
    node = start(**given, name="hears", record=True, log_directory=tmp_path)
    peer, heard, status = meet("hears"), list[MeasuredVibration](), dict[str, Any]()
    imu = peer.node.create_publisher(Imu, "/imu", 100)
    peer.node.create_subscription(MeasuredVibration, "/hears/measured", heard.append, 10)
    peer.node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda message: status.update({s.name: s for s in message.status}),
        10,
    )
    peer.spin(lambda: imu.get_subscription_count() > 0, "the node's subscription")
    sample, seconds = Imu(), peer.second + 10
    for k in range(1300):
        at, rest = divmod(k * 5_000_000, 10**9)
        sample.header.stamp.sec, sample.header.stamp.nanosec = seconds + at, rest
        sample.linear_acceleration.z = 9.81 + 0.2 * math.cos(2.0 * math.pi * 25.0 * k / 200.0)
        imu.publish(sample)
        if k % 10 == 0:
            peer.second, peer.stamp, before = seconds + at, rest, len(peer.raw)
            peer.publish()
            peer.spin(lambda before=before: len(peer.raw) > before, "a prediction")
    peer.spin(lambda: len(heard) >= 2, "what the sensor measures")
    peer.spin(lambda: "hears: sensors" in {name.lstrip("/") for name in status}, "its status")
    assert node.stop() == 0
    names = [each.name for each in read_excitations(config_file("excitations.yaml"))]
    level = heard[0].order_levels[names.index("crankshaft 1")]
    assert level == pytest.approx(0.2 / math.sqrt(2.0), rel=1e-3)
    assert [each.header.stamp.sec - seconds for each in heard] == [5, 6]
    [log] = tmp_path.glob("linkage_vibration_*.mcap")
    again = tmp_path / "again.mcap"
    replay([log], again, Parameters(sensor_file=str(file), engine_speed=1500.0))
    recorded = [(time, data) for _, time, data in raw_messages(log, "/hears/measured")]
    name = "/linkage_vibration/measured"
    assert [(time, data) for _, time, data in raw_messages(again, name)] == recorded
    assert len(recorded) == 2


@pytest.mark.nightly(short="test_sensors_beside_predictions")
def test_modes_of_sensors(
    start: Callable[..., Any], meet: Callable[..., Any], tmp_path: Path
) -> None:
    """A mode that noise shakes for 100 s is identified, live and with the same bytes in a replay.

    It is 4 % below the prediction, has its shape and a damping ratio of 2 %.
    """
    mechanism = read_mechanism(Parameters().mechanism_path())
    solution, rate, seconds = LinkageModel(mechanism).solve(2.0), 50.0, 100
    predicted = float(solution.natural_frequencies[3])
    shape = solution.mode_shapes([("E1", "x"), ("E1", "z")])[:, 3]
    pole = np.exp(2.0 * math.pi * 0.96 * predicted / rate * (-0.02 + 1j))
    noise = np.random.default_rng(1).standard_normal(round(rate * seconds))
    moved = np.outer(lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], noise), shape)
    x, z = (moved / moved.std()).T.tolist()
    file = tmp_path / "sensors.yaml"
    file.write_text("imu: {topic: /imu, unit: m/s2, at: E1, filtered: true}\n")
    speeds = {"engine_speed": 1500.0, "pto_speed": 0.0, "ground_speed": 0.0}
    node = start(sensor_file=file, **speeds, name="modes", record=True, log_directory=tmp_path)
    peer, heard = meet("modes"), list[MeasuredVibration]()
    imu = peer.node.create_publisher(Imu, "/imu", 100)
    peer.node.create_subscription(MeasuredVibration, "/modes/measured", heard.append, 10)
    peer.spin(lambda: imu.get_subscription_count() > 0, "the node's subscription")
    sample, first = Imu(), peer.second + 10
    for k in range(len(x)):
        at, rest = divmod(k * round(1e9 / rate), 10**9)
        sample.header.stamp.sec, sample.header.stamp.nanosec = first + at, rest
        sample.linear_acceleration.x, sample.linear_acceleration.z = x[k], 9.81 + z[k]
        imu.publish(sample)
        if k % 10 == 0:
            peer.second, peer.stamp, before = first + at, rest, len(peer.raw)
            peer.publish()
            peer.spin(lambda before=before: len(peer.raw) > before, "a prediction")
    peer.spin(lambda: any(each.modes_age > 0.0 for each in heard), "modes")
    assert node.stop() == 0
    message = next(each for each in heard if each.modes_age > 0.0)
    assert message.modes_crank_angle == pytest.approx(2.0)
    stddev = message.mode_stddevs[3]
    assert abs(message.mode_frequencies[3] - 0.96 * predicted) < 3.0 * stddev < 0.2
    assert message.mode_predictions[3] == pytest.approx(predicted, rel=1e-4)
    [log] = tmp_path.glob("linkage_vibration_*.mcap")
    again = tmp_path / "again.mcap"
    replay([log], again, Parameters(sensor_file=str(file), **speeds))
    recorded = [(time, data) for _, time, data in raw_messages(log, "/modes/measured")]
    replayed = raw_messages(again, "/linkage_vibration/measured")
    assert [(time, data) for _, time, data in replayed] == recorded
    assert len(recorded) > 90


@pytest.mark.nightly(short="test_live_and_offline")
def test_rates_of_a_control_stack(
    start: Callable[..., Any], meet: Callable[..., Any], tmp_path: Path
) -> None:
    """Of 200 readings in 1 s, 10 have a prediction and a load state, live and in a replay.

    Each load state comes with the first reading of a period. None is lost in a replay of a log that
    begins within a window, nor is there one more.
    """
    rates = {"prediction_rate": 10.0, "resonance_rate": 10.0, "engine_speed": 1800.0}
    slow = {**rates, "prediction_rate": 0.0}  # for the peer, whose stamps are in one period
    node = start(**slow, name="control", log_directory=tmp_path)
    peer, states = meet("control"), list[bytes]()
    change = peer.node.create_client(SetParameters, "control/set_parameters")
    value = Parameter("prediction_rate", value=10.0).to_parameter_msg()
    assert peer.request(change, SetParameters.Request(parameters=[value])).results[0].successful
    record = peer.node.create_client(Trigger, "control/start_recording")
    assert peer.request(record, Trigger.Request()).success
    topics = [f"/control/{name}" for name in ("prediction", "load_state", "resonance")]
    peer.node.create_subscription(LoadState, topics[1], states.append, 1000, raw=True)
    peer.second -= 60

    def earlier() -> None:
        peer.second += 1
        peer.publish()
        peer.pause(0.1)

    until(lambda: states and peer.raw, "a load state", earlier)
    peer.second += 60
    states.clear()
    peer.raw.clear()
    for k in range(200):
        peer.stamp = 5_000_000 * k - 1
        peer.publish(positions=[1.9 + 0.002 * k])
        if k % 20 == 0:
            peer.spin(lambda k=k: len(states) > k // 20, "a load state")
    assert (len(peer.raw), len(states)) == (10, 10)
    actual = [deserialize_message(each, LoadState) for each in states]
    parts = [20_000_000 * k for k in range(50)]
    for k, each in enumerate(actual):
        assert each.header.stamp.nanosec in parts[max(5 * k - 4, 0) : 5 * k + 1]
    assert node.stop() == 0
    [log] = tmp_path.glob("linkage_vibration_*.mcap")
    again = tmp_path / "again.mcap"
    replay([log], again, Parameters(**rates))
    for topic in topics:
        recorded = [(time, data) for _, time, data in raw_messages(log, topic)]
        name = topic.replace("control", "linkage_vibration")
        assert [(time, data) for _, time, data in raw_messages(again, name)] == recorded != []
    # DDS fills its payload up to a multiple of four.
    recorded = [data + b"\x00" * (-len(data) % 4) for *_, data in raw_messages(log, topics[1])]
    assert recorded[-10:] == states
