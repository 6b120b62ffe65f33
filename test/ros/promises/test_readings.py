# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the node promises about readings, topics and parameters, in each condition."""

import math
import os
import random
import re
import time
from array import array
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32MultiArray, Float64

from linkage_vibration.prediction.inputs.sources import MAX_BYTES
from linkage_vibration.prediction.predictor import Predictor, Status
from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file
from linkage_vibration_interfaces.msg import LoadState, Resonance, TableInfo, VibrationPrediction
from test.ros.promises.message_fields import numbers, state_is_known, unknown_speeds
from test.support.conditions import KILOHERTZ, OK, SPEED, SPEED_RATE, Promised, promise
from test.support.ros_process import JOINT, SENSOR, slowness, until
from test.support.served import shipped

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PAGE = (Path(__file__).parents[3] / "docs" / "node.md").read_text()
OTHER_INPUT = "the readings are then not used"
DEFAULTS = {
    "hitch_input": "joint_states",
    "joint_name": JOINT,
    "hitch_topic": "",
    "hitch_type": "",
    "hitch_field": "",
    "hitch_unit": "",
    "hitch_position": -1.0,
    "hitch_sign": 1,
    "hitch_scale": 1.0,
    "hitch_offset": 0.0,
    "calibration": [0.0, 3.14159, 100.0, 1.5708],
    "angle_stddev": 0.0,
    "prediction_rate": 0.0,
    "engine_speed": -1.0,
    "stale_after": 1.0,
    "warning_load_ratio": 0.33,
}


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """Return a predictor on the table that the node uses."""
    return shipped().predictor


@pytest.fixture(scope="module")
def node(begin: Callable[..., Promised]) -> Promised:
    """Return a node with the default parameters."""
    return begin("reading")


@pytest.fixture(autouse=True)
def defaults(node: Promised) -> Iterator[None]:
    """Give the node its default parameters after a test that has changed them."""
    yield
    values = node.ask("get_parameters", GetParameters, names=list(DEFAULTS)).values
    defaults = [Parameter(name, value=value) for name, value in DEFAULTS.items()]
    pairs = zip(defaults, values, strict=True)
    other = [p.to_parameter_msg() for p, value in pairs if p.get_parameter_value() != value]
    if other:
        set_together(node, other)


def set_parameter(node: Promised, name: str, value: Any) -> Any:
    """Set a parameter as `ros2 param set` does, and return the result."""
    message = Parameter(name, value=value).to_parameter_msg()
    return node.ask("set_parameters", SetParameters, parameters=[message]).results[0]


def set_together(node: Promised, parameters: list[ParameterMessage]) -> None:
    """Set parameters together, which have to be accepted."""
    asked = {"parameters": parameters}
    result = node.ask("set_parameters_atomically", SetParametersAtomically, **asked).result
    assert result.successful, result.reason


def set_all(node: Promised, **values: Any) -> None:
    """Set parameters one after the other, which all have to be accepted."""
    for name, value in values.items():
        result = set_parameter(node, name, value)
        assert result.successful, result.reason


def foreign(node: Promised, kind: Any, topic: str) -> Any:
    """Return a publisher beside the joint states, which the node has found."""
    publisher = node.peer.node.create_publisher(kind, topic, SENSOR)
    node.peer.spin(publisher.get_subscription_count, f"the subscription to {topic}")
    return publisher


def answered(node: Promised, publish: Callable[[], object], fits: Callable[[Any], bool]) -> Any:
    """Publish until a prediction fits, and return it."""
    received = node.listen("prediction", VibrationPrediction)

    def step() -> None:
        publish()
        node.peer.pause(0.1)

    until(lambda: any(map(fits, received)), "a prediction", step)
    return next(filter(fits, received))


@promise("node.md#topics")
def test_exact_numbers(node: Promised, predictor: Predictor) -> None:
    """Each reading has the prediction of the table, bit for bit; the joint may be at any place."""
    rng = random.Random(2)
    for _ in range(10):
        angle = rng.uniform(math.pi / 2, math.pi)
        joints = {JOINT: angle, "wheel": 1.0, "steering": 9.0, "pto": math.nan}
        names = rng.sample(sorted(joints), len(joints))
        message = node.peer.ask(names, [joints[name] for name in names])
        assert numbers(message) == numbers(predictor.predict(angle))
        assert message.table_id == predictor.table.table_id


@promise("node.md#topics")
def test_stamp_and_frame(node: Promised) -> None:
    """A prediction has the stamp and the frame of its reading."""
    message = node.peer.ask(frame_id="tractor")
    assert message.header.frame_id == "tractor"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (
        node.peer.second,
        node.peer.stamp,
    )


@promise("node.md#topics")
def test_without_the_joint(node: Promised) -> None:
    """A joint state without the joint is ignored."""
    silent = node.peer.publish(["other"], [2.0])
    node.peer.ask()
    assert silent not in [p.header.stamp.nanosec for p in node.peer.predictions]


@promise("node.md#topics")
def test_other_sizes(node: Promised) -> None:
    """A joint state whose arrays differ in length, or with the joint twice, is ignored."""
    silent = [
        node.peer.publish([JOINT, "b"], [2.0]),
        node.peer.publish([JOINT], []),
        node.peer.publish([JOINT, JOINT], [2.0, 2.1]),
    ]
    node.peer.ask()
    assert not {p.header.stamp.nanosec for p in node.peer.predictions} & set(silent)


@promise("node.md#topics")
def test_warning_in_five_seconds(node: Promised) -> None:
    """The warning about arrays of other lengths comes at most once in 5 s."""
    words = "2 names but 1 elements in position"
    begun, before = time.monotonic(), node.node.printed.count(words)
    while node.node.printed.count(words) == before:
        node.peer.publish([JOINT, "b"], [2.0])
        node.peer.pause(0.05)
        assert time.monotonic() < begun + 15.0, "there is no warning"
    first, begun = node.node.printed.count(words), time.monotonic()
    while time.monotonic() < begun + 2.0:
        node.peer.publish([JOINT, "b"], [2.0])
        node.peer.pause(0.05)
    assert node.node.printed.count(words) == first


@promise("node.md#topics")
def test_stamps(node: Promised) -> None:
    """Readings that are repeated, late, or from the past or the future, are answered."""
    stamps = [(2_000_000_000, 0), (5, 7), (5, 7), (2**31 - 1, 999_999_999), (-5, 0)]
    for i, (sec, nanosec) in enumerate(stamps):
        angle = 1.7000017 + 0.1 * i  # which no reading of the load has
        message = JointState(name=[JOINT], position=array("d", [angle]))
        message.header.stamp = Time(sec=sec, nanosec=nanosec)
        own = lambda p, a=angle: p.crank_angle == a  # noqa: E731
        prediction = answered(node, lambda m=message: node.peer.publisher.publish(m), own)
        stamp = prediction.header.stamp
        assert (stamp.sec, stamp.nanosec, prediction.status) == (sec, nanosec, Status.OK)


@promise("node.md#topics")
def test_out_of_range(node: Promised) -> None:
    """Outside of the table the status is OUT_OF_RANGE and every number is NaN."""
    for angle in (0.0, math.nextafter(math.pi, 4.0), -1e308):
        message = node.peer.ask([JOINT], [angle])
        assert message.status == message.STATUS_OUT_OF_RANGE
        assert np.isnan([*message.natural_frequencies, *message.damping_ratios]).all()
        assert math.isnan(message.frf_peak_frequency)


@promise("node.md#topics")
def test_invalid_angle(node: Promised) -> None:
    """A crank angle that is NaN or infinite has the status INVALID_ANGLE, and no numbers."""
    for angle in (math.nan, math.inf):
        message = node.peer.ask([JOINT], [angle])
        assert message.status == message.STATUS_INVALID_ANGLE
        assert np.isnan([*message.natural_frequencies, *message.damping_ratios]).all()


@promise("node.md#topics")
def test_inputs(node: Promised) -> None:
    """Inputs are subscribed to as best effort by a second node, whose name ends with _readings."""
    for topic in ("/joint_states", "/engine_speed", "/pto_speed", "/ground_speed"):
        infos = node.peer.node.get_subscriptions_info_by_topic(topic)
        [own] = [each for each in infos if each.node_name.startswith(node.name)]
        assert own.node_name == f"{node.name}_readings"
        assert own.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT


@promise("node.md#topics")
def test_outputs(node: Promised) -> None:
    """Outputs have the types and the QoS of the table of topics."""
    names = node.peer.node.get_topic_names_and_types()
    rows = re.findall(r"^\| `(~?/\w+)` \| `(\w+|\w+/msg/\w+)` \|", PAGE, re.MULTILINE)
    assert len(rows) == 8
    [latched_ones] = re.findall(r"10\); (.*) are transient local", PAGE)
    for name, kind in rows:
        topic, package = name.replace("~", f"/{node.name}"), "linkage_vibration_interfaces/msg/"
        assert (topic, [kind if "/" in kind else package + kind]) in names
        infos = node.peer.node.get_publishers_info_by_topic(topic)
        [own] = [each for each in infos if each.node_name == node.name]
        assert own.qos_profile.reliability is ReliabilityPolicy.RELIABLE
        latched = own.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
        assert latched == (f"`{name}`" in latched_ones)


@promise("node.md#topics")
def test_table_info(node: Promised, predictor: Predictor) -> None:
    """A late subscriber receives the description of the table, with its band and that of peaks."""
    received = node.listen("table_info", TableInfo, LATCHED)
    node.peer.spin(lambda: received, "the description of the table")
    [info] = received
    assert info.table_id == predictor.table.table_id
    assert (info.crank_angle_first, info.crank_angle_last) == predictor.table.alpha3_range
    assert (info.band_low, info.band_high) == (0.0, 200.0)
    assert (info.peak_band_low, info.peak_band_high) == (4.7, 200.0)
    assert (info.n_modes, info.mechanism_name) == (12, "three_point_linkage_on_tractor")
    assert list(info.mode_names) == list(predictor.table.mode_names)
    assert list(info.mode_body_shares) == predictor.table.mode_shares[:, 1].tolist()
    assert "E1.z" in info.places
    assert info.unknown_deviations == ""


@promise("node.md#topics")
def test_mechanism(node: Promised) -> None:
    """A late subscriber receives the mechanism as YAML."""
    received = node.listen("table_info", TableInfo, LATCHED)
    node.peer.spin(lambda: received, "the mechanism")
    assert received[0].mechanism == config_file(DEFAULT_MECHANISM).read_text()


@promise("node.md#topics")
def test_resonances(node: Promised) -> None:
    """Once a speed is known, resonances come with their readings, each with a load state."""
    node.tractor.healthy()
    node.tractor.speed(engine=1500.0)
    resonances = node.listen("resonance", Resonance)
    states = node.listen("load_state", LoadState)
    node.peer.spin(lambda: len(resonances) > 5 and len(states) > 5, "resonances")
    common = slice(1, 4)
    first = {stamp_of(each) for each in resonances}
    assert {stamp_of(each) for each in states[common]} <= first
    assert all("engine" not in unknown_speeds(each) for each in states[common])


@promise("node.md#what-a-controller-subscribes-to")
def test_values_that_go_to_and_fro(node: Promised) -> None:
    """A speed or an angle whose values go to and fro is not known."""
    node.tractor.healthy()
    node.tractor.speed(engine=1500.0)
    states = node.listen("load_state", LoadState)
    node.peer.spin(lambda: states and "engine" not in unknown_speeds(states[-1]), "a known speed")
    node.tractor.publish("engine_speed", SPEED, [{"data": 1500.0}, {"data": 1200.0}], SPEED_RATE)
    node.peer.spin(lambda: "engine" in unknown_speeds(states[-1]), "a doubted speed")
    assert states[-1].state == LoadState.STATE_UNKNOWN
    node.tractor.speed(engine=1500.0)
    node.peer.spin(lambda: "engine" not in unknown_speeds(states[-1]), "a known speed")
    node.tractor.read(2.0, 2.08)
    crank = LoadState.UNKNOWN_CRANK_ANGLE
    node.peer.spin(lambda: states[-1].unknown_sources & crank, "a doubted angle")
    assert states[-1].state == LoadState.STATE_UNKNOWN


def stamp_of(message: Any) -> tuple[int, int]:
    """Return the stamp of a message."""
    stamp = message.header.stamp
    return stamp.sec, stamp.nanosec


@promise("node.md#what-a-controller-subscribes-to")
def test_size_of_the_load_state(node: Promised) -> None:
    """A load state has as many bytes as the page says, beside its frame."""
    [size] = re.findall(r"in (\d+) bytes beside the `frame_id`", PAGE)
    node.tractor.healthy()
    node.tractor.speed(engine=1500.0)
    received: list[bytes] = []
    node.peer.node.create_subscription(
        LoadState, f"{node.name}/load_state", received.append, 10, raw=True
    )
    node.peer.spin(lambda: received, "a load state")
    empty = 4  # bytes of the encapsulation
    assert 0 <= len(received[0]) - empty - int(size) < 4  # RTPS pads to four


@promise("node.md#what-a-controller-subscribes-to")
def test_resonance_rate(node: Promised) -> None:
    """Resonances come at most ten times a second, by their stamps, but for changes of the state."""
    node.tractor.read(*(2.0 + 1e-4 * i for i in range(7)), rate=1000.0)
    node.tractor.speed(engine=1500.0)
    received = node.listen("resonance", Resonance)
    states = node.listen("load_state", LoadState)
    node.peer.spin(lambda: len(received) > 20, "resonances")
    stamps = [sec + 1e-9 * nanosec for sec, nanosec in map(stamp_of, received)]
    changes = sum(a.state != b.state for a, b in pairwise(states))
    assert len(received) - changes <= 10.0 * (stamps[-1] - stamps[0]) + 2


@promise("node.md#what-a-controller-subscribes-to", kilohertz="the readings stop")
def test_load_state_without_readings(node: Promised) -> None:
    """While no reading arrives, a load state comes each second, which is unknown."""
    node.tractor.healthy()
    node.tractor.speed(engine=1500.0)
    received = node.listen("load_state", LoadState)
    node.peer.spin(lambda: len(received) > 3, "load states")
    node.tractor.silence("joint_states")
    node.peer.pause(2.5)
    received.clear()
    node.peer.pause(3.0)
    assert 1 <= len(received) <= 5
    assert not any(state_is_known(each) for each in received)


@promise("node.md#parameters")
def test_prediction_rate(node: Promised) -> None:
    """With prediction_rate, the first reading in each period of the stamps has a prediction."""
    set_all(node, prediction_rate=10.0)
    node.tractor.read(*(2.0 + 1e-4 * i for i in range(7)), rate=1000.0)
    received = node.listen("prediction", VibrationPrediction)
    node.peer.spin(lambda: len(received) > 10, "predictions")
    own = [stamp_of(each) for each in received if each.header.frame_id == ""]
    periods = [(10 * sec + nanosec // 10**8) for sec, nanosec in own]
    assert len(set(periods)) == len(periods)
    assert np.median(np.diff(periods)) == 1


@promise("start_the_node.md#what-your-tractor-publishes")
def test_sign_scale_and_offset(node: Promised, predictor: Predictor) -> None:
    """The value is sign * scale * number + offset."""
    set_all(node, hitch_sign=-1, hitch_scale=2.0, hitch_offset=3.5)
    message = node.peer.ask([JOINT], [0.6])
    assert numbers(message) == numbers(predictor.predict(-1 * 2.0 * 0.6 + 3.5))


@promise("start_the_node.md#what-your-tractor-publishes", kilohertz=OTHER_INPUT)
def test_percent(node: Promised, predictor: Predictor) -> None:
    """Positions in percent are looked up in the calibration; 102 % has no prediction."""
    set_all(node, calibration=[0.0, 3.0, 50.0, 2.5, 100.0, 2.0], hitch_input="percent")
    hitch = foreign(node, Float64, "hitch_position")
    publish = lambda percent: hitch.publish(Float64(data=percent))  # noqa: E731
    answered(node, lambda: publish(50.0), lambda p: p.crank_angle == 2.5)
    invalid = answered(node, lambda: publish(102.0), lambda p: math.isnan(p.crank_angle))
    assert invalid.status == Status.INVALID_ANGLE
    node.peer.node.destroy_publisher(hitch)


@promise("start_the_node.md#what-your-tractor-publishes", kilohertz=OTHER_INPUT)
def test_other_message(node: Promised) -> None:
    """A number in any message can be the hitch: an element of an array, in metres."""
    described = {
        "hitch_topic": "/hydraulics/lift_cylinder",
        "hitch_type": "std_msgs/msg/Float32MultiArray",
        "hitch_field": "data[0]",
        "hitch_unit": "m",
        "calibration": [0.0, 3.05, 0.11, 2.31, 0.21, 1.62],
    }
    messages = [
        Parameter(name, value=value).to_parameter_msg() for name, value in described.items()
    ]
    set_together(node, messages)
    cylinder = foreign(node, Float32MultiArray, "/hydraulics/lift_cylinder")
    message = Float32MultiArray(data=[0.0, 7.0])
    answered(node, lambda: cylinder.publish(message), lambda p: p.crank_angle == 3.05)
    node.peer.node.destroy_publisher(cylinder)


@promise("start_the_node.md#what-your-tractor-publishes", kilohertz=OTHER_INPUT)
def test_fixed_hitch(node: Promised) -> None:
    """With a fixed hitch position, each message of the first speed gives a prediction."""
    set_all(node, calibration=[0.0, 3.0, 50.0, 2.5, 100.0, 2.0], hitch_input="percent")
    set_all(node, hitch_position=50.0)
    engine = foreign(node, Float64, "engine_speed")
    answered(node, lambda: engine.publish(Float64(data=1500.0)), lambda p: p.crank_angle == 2.5)
    node.peer.node.destroy_publisher(engine)


@promise("start_the_node.md#what-your-tractor-publishes")
def test_speed_that_is_not_available(node: Promised) -> None:
    """A speed that is NaN is unknown and not 0; the node logs this once, until a value comes."""
    words = "has no ground speed now, so it is unknown"
    before = node.node.printed.count(words)
    node.tractor.healthy()
    node.tractor.speed(engine=1500.0, ground=math.nan)
    node.peer.spin(lambda: node.node.printed.count(words) > before, words)
    received = node.listen("load_state", LoadState)
    node.peer.spin(lambda: any("ground" in unknown_speeds(each) for each in received), "a state")
    assert node.node.printed.count(words) == before + 1
    node.tractor.speed(ground=2.0)
    node.peer.spin(lambda: "ground" not in unknown_speeds(received[-1]), "a known speed")
    node.tractor.speed(ground=math.nan)
    node.peer.spin(lambda: node.node.printed.count(words) == before + 2, f"{words}, once more")


@promise("node.md#parameters")
def test_name_that_is_a_number(node: Promised) -> None:
    """An integer is accepted for a text, such as the name of a joint."""
    set_all(node, joint_name=123)
    assert node.peer.ask(["123"], [2.25]).crank_angle == 2.25


@promise("node.md#parameters")
def test_live_parameter(node: Promised, predictor: Predictor) -> None:
    """A live parameter applies from the next reading on."""
    set_all(node, angle_stddev=0.02)
    stddevs = node.peer.ask([JOINT], [2.5]).frequency_stddevs.tolist()
    assert stddevs == predictor.predict(2.5, 0.02).frequency_stddevs.tolist()


@promise("node.md#parameters")
def test_invalid_value(node: Promised) -> None:
    """An invalid value is rejected with the valid ones, and nothing changes."""
    for name, value, words in (
        ("hitch_sign", 3, "sign must be 1 or -1, not 3"),
        ("angle_stddev", -1.0, "angle_stddev must be"),
        ("compression", "off", "must be none or lz4 or zstd"),
        ("calibration", [0.0, 180.0, 100.0, 90.0], "give angles in rad"),
    ):
        refused = set_parameter(node, name, value)
        assert (refused.successful, words in refused.reason) == (False, True), refused.reason
    [sign] = node.ask("get_parameters", GetParameters, names=["hitch_sign"]).values
    assert sign.integer_value == 1


@promise("node.md#parameters")
def test_unknown_parameter(node: Promised) -> None:
    """An unknown parameter is rejected with the most similar name."""
    refused = set_parameter(node, "recrod", True)
    assert refused.reason == "Parameter recrod is unknown; did you mean record?"


@promise("node.md#parameters")
def test_parameter_that_is_not_live(node: Promised) -> None:
    """A parameter that is not live is refused while the node is configured."""
    refused = set_parameter(node, "mechanism_file", "/none.yaml")
    assert not refused.successful
    assert "is read when the node is configured" in refused.reason


@promise("node.md#parameters")
def test_own_dump(node: Promised) -> None:
    """The node loads a dump of its own parameters while it is active."""
    names = node.ask("list_parameters", ListParameters).result.names
    values = node.ask("get_parameters", GetParameters, names=names).values
    pairs = zip(names, values, strict=True)
    dump = [ParameterMessage(name=name, value=value) for name, value in pairs]
    results = node.ask("set_parameters", SetParameters, parameters=dump).results
    assert [result.reason for result in results if not result.successful] == []
    assert {"joint_name", "use_sim_time", "warning_dwell"} <= set(names)


@promise("node.md#parameters")
def test_fixed_speed(node: Promised) -> None:
    """A fixed speed is used without a topic."""
    set_all(node, engine_speed=1234.0)
    node.tractor.healthy()
    received = node.listen("load_state", LoadState)
    node.peer.spin(lambda: received, "a load state")
    assert "engine" not in unknown_speeds(received[-1])
    node.tractor.speed(engine=1500.0)
    node.node.wait_for("is not used, as engine_speed is fixed at 1234.")


@promise("node.md#parameters")
def test_large_messages(node: Promised) -> None:
    """Messages above 1 MB are refused with a warning that counts them, and are not kept.

    Each has other names. While a node parsed them and kept 1000, those of 25 s took 1 GB.
    """
    count = -(-2 * MAX_BYTES // 24)
    names = [JOINT, *(f"joint_{i:07}" for i in range(count - 1))]
    large = serialize_message(JointState(name=names, position=array("d", [2.0] * count)))
    publisher = node.peer.node.create_publisher(JointState, "joint_states", SENSOR)
    until(publisher.get_subscription_count, "a subscription to the joint states")
    memory = Path(f"/proc/{node.node.process.pid}/statm")
    before = int(memory.read_text().split()[1])
    for sent in range(60):
        publisher.publish(large.replace(b"joint_00000", b"joint_%05d" % (7 * sent)))
        node.peer.executor.spin_once(0.02)
    node.node.wait_for(f"bytes was refused; an input may have {MAX_BYTES}")
    assert node.peer.ask().status == Status.OK
    assert (int(memory.read_text().split()[1]) - before) * os.sysconf("SC_PAGE_SIZE") < 60e6
    node.peer.node.destroy_publisher(publisher)


@promise("node.md#diagnostics")
def test_diagnostics_each_second(node: Promised) -> None:
    """Each second the node publishes five statuses."""
    node.next_status("predictions")
    node.statuses.clear()
    begun = time.monotonic()
    node.peer.spin(lambda: len(node.statuses) >= 25, "diagnostics")
    assert 4.0 <= time.monotonic() - begun <= 7.0
    names = {each.name.partition(": ")[2] for each in node.statuses}
    assert names == {"predictions", "input", "speeds", "resonance", "log"}


@promise("node.md#diagnostics")
def test_diagnostics_have_numbers(node: Promised) -> None:
    """The status of the predictions has age and rate of the input, losses, latency and table."""
    node.tractor.healthy()
    node.tractor.speed(engine=1500.0)
    node.peer.pause(1.5)
    values = node.values()
    rate = float(values["input rate [Hz]"])
    least = 900.0 if node.condition == KILOHERTZ else 40.0
    assert rate > least / slowness()  # a busy machine leaves readings out
    assert 0.0 < float(values["latency p50 [ms]"]) <= float(values["latency p99 [ms]"])
    assert 0.0 <= float(values["input age [s]"]) < 1.0
    assert values["table id"] == shipped().table.table_id
    assert {"messages lost", "messages left out", "longest wait [s]", "resonance"} <= values.keys()


@promise("node.md#diagnostics")
def test_every_reading_is_accounted_for(node: Promised) -> None:
    """Each reading that arrives is answered, or counted as left out."""
    node.tractor.healthy()
    first, begun = node.values(), time.monotonic()
    node.peer.pause(3.0)
    last = node.values()
    names = ("messages received", "predictions", "messages left out")
    # What is left out is counted by topic, such as "/joint_states 10".
    counted = [[int(v[n].split()[-1]) for n in names] for v in (first, last)]
    received, predicted, left_out = (b - a for a, b in zip(*counted, strict=True))
    assert received > (900.0 if node.condition == KILOHERTZ else 40.0) * 3.0
    assert abs(received - predicted - left_out) <= 2  # between the two that count
    assert time.monotonic() > begun


@promise("node.md#diagnostics")
def test_healthy(node: Promised) -> None:
    """Healthy readings and speeds have no fault."""
    node.tractor.healthy()
    node.tractor.speed(engine=1500.0, pto=540.0, ground=2.0)
    for part in ("input", "predictions", "speeds", "log"):
        node.wait_for_status(part, OK, "")
