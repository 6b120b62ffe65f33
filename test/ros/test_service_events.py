# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Service introspection: events of requests and responses, as a live parameter and in a log."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from std_msgs.msg import String
from std_srvs.srv import Trigger

from linkage_vibration.messages.definitions import message_definition, type_hash
from linkage_vibration_interfaces.srv import PredictVibration
from test.support.ros_process import until

REQUEST_RECEIVED, RESPONSE_SENT = 1, 2
EVENTS = "/evented/predict/_service_event"
TRIGGERED = "/evented/start_recording/_service_event"


def logged_events(path: Path) -> Iterator[tuple[str, Any]]:
    """Yield topic and event of each service event in a log, decoded by the definitions in it."""
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages([EVENTS, TRIGGERED]):
            assert schema is not None
            assert schema.name.endswith("_Event")
            name = schema.name.replace("/srv/", "/msg/")  # rosbags knows messages only
            store = get_typestore(Stores.EMPTY)
            store.register(get_types_from_msg(schema.data.decode(), name))
            yield channel.topic, store.deserialize_cdr(message.data, name)


def test_definitions_of_events() -> None:
    """An event contains its request and its response; its hash is that of the installed type."""
    text = message_definition("linkage_vibration_interfaces/srv/PredictVibration_Event")
    assert text.startswith("service_msgs/ServiceEventInfo info\nPredictVibration_Request[<=1] ")
    for part in ("PredictVibration_Request", "PredictVibration_Response", "VibrationPrediction"):
        assert text.count(f"\nMSG: linkage_vibration_interfaces/{part}\n") == 1
    assert type_hash("linkage_vibration_interfaces/srv/PredictVibration_Event").startswith("RIHS01")


def test_events_are_published_and_logged(
    start: Callable[..., Any], meet: Callable[[str], Any], tmp_path: Path
) -> None:
    """An independent reader finds requests and responses in the node's log."""
    node = start(
        name="evented",
        record=True,
        log_directory=tmp_path,
        extra_topics=f"~/predict/_service_event {TRIGGERED} /latched",
    )
    peer = meet("evented")
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    peer.node.create_publisher(String, "/latched", qos).publish(String(data="once"))
    client = peer.node.create_client(SetParameters, "evented/set_parameters")
    trigger = peer.node.create_client(Trigger, "evented/start_recording")

    def set_events(value: str) -> Any:
        parameter = Parameter("service_events", value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        return peer.request(client, request).results[0]

    assert "none or metadata or contents" in set_events("all").reason
    assert set_events("contents").successful
    peer.spin(lambda: EVENTS in dict(peer.node.get_topic_names_and_types()))

    events: list[Any] = []
    peer.node.create_subscription(PredictVibration.Event, EVENTS, events.append, 100)

    def ask() -> None:
        assert peer.call([1.75]).success
        peer.request(trigger, Trigger.Request())
        peer.pause(0.3)

    until(lambda: len(events) >= 2, "events", ask)
    extra = {EVENTS: 2, TRIGGERED: 1, "/latched": 1}  # the node subscribes once a second
    peer.spin(lambda: all(peer.node.count_subscribers(t) == n for t, n in extra.items()))
    seen = len(events)
    until(lambda: len(events) >= seen + 4, "more events", ask)
    assert set_events("none").successful
    assert node.stop() == 0
    kinds, angles, triggered, latched = set(), set(), 0, 0
    for path in tmp_path.iterdir():
        with path.open("rb") as file:
            latched += len(list(make_reader(file).iter_messages("/latched")))
        for topic, event in logged_events(path):
            kinds.add(event.info.event_type)
            if topic == EVENTS:
                angles |= {angle for request in event.request for angle in request.crank_angles}
            else:
                triggered += 1
    assert kinds == {REQUEST_RECEIVED, RESPONSE_SENT}
    assert angles == {1.75}
    assert triggered > 0
    assert latched == 1  # although the node subscribes later than the message was published
