# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A drive gives the same bytes live over DDS and offline."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.support.resources import config_file
from linkage_vibration_interfaces.msg import Advice

PREDICTION, RESONANCE, ADVICE = (
    f"/linkage_vibration/{name}" for name in ("prediction", "resonance", "advice")
)
SETTINGS = Parameters(
    sign=-1,
    scale=0.98,
    offset=4.7,
    angle_stddev=2e-3,
    stale_after=0.5,
    warning_load_ratio=0.005,
    note_load_ratio=0.001,
    ground_speed=7.0,  # so that the ground has a level
)


def messages(log: Path, *topics: str) -> list[tuple[str, int, bytes]]:
    """Return topic, log time and bytes of each message of some topics."""
    with log.open("rb") as file:
        found = make_reader(file, validate_crcs=True).iter_messages(topics)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in found]


def test_live_and_offline(
    start: Callable[..., Any], meet: Callable[..., Any], tmp_path: Path
) -> None:
    """DDS carries the bytes of the replay, and a replay of the node's log gives the same log."""
    drive = config_file("drives/hitch_duty_cycle.mcap")
    offline = tmp_path / "offline.mcap"
    replay([drive], offline, SETTINGS)
    names = ["sign", "scale", "offset", "angle_stddev", "stale_after"]
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
    sent = 0
    for topic, _, data in messages(drive, *publishers):
        kind = JointState if topic == "/joint_states" else Float64
        publishers[topic].publish(deserialize_message(data, kind))
        sent += kind is JointState
        peer.spin(lambda sent=sent: len(peer.raw) >= sent, "a prediction")
    # A subscriber that comes late receives the last advice.
    peer.node.create_subscription(Advice, ADVICE, late.append, latched)
    peer.spin(lambda: bool(late), "advice")
    assert node.stop() == 0

    expected = messages(offline, PREDICTION)
    # DDS fills its payload up to a multiple of four.
    padded = [data + b"\x00" * (-len(data) % 4) for *_, data in expected]
    assert [bytes(data) for data in peer.raw] == padded
    [log] = tmp_path.glob("linkage_vibration_*.mcap")
    again = tmp_path / "again.mcap"
    replay([log], again, SETTINGS)
    for topic in (PREDICTION, RESONANCE, ADVICE):
        recorded = messages(log, topic)
        assert len(recorded) >= len(messages(offline, topic)) > 0
        assert messages(again, topic) == recorded
    *_, (_, _, last) = recorded
    # Arrays are not compared, as they contain NaN.
    assert late[0].sentence == deserialize_message(last, Advice).sentence != ""
    assert late[0].header == deserialize_message(last, Advice).header
