# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The way of a message through the node: reading, prediction, resonance, and all of it logged."""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.subscription import MessageInfo
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.bags.writing import Topic
from linkage_vibration.messages.encoding import encode_prediction, encode_resonance
from linkage_vibration.messages.topics import (
    HITCH_POSITION,
    JOINT_STATES,
    PREDICTION,
    RESONANCE,
    SPEEDS,
    log_topic,
)
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs import JointInput, PercentInput, Reading, ReadingError
from linkage_vibration.prediction.predictor import Predictor, Status, fault
from linkage_vibration.prediction.resonance import Resonance, ResonanceMonitor
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.ros.diagnostics import Statistics
from linkage_vibration.ros.endpoints import Publishers, subscribe
from linkage_vibration.ros.throttle import Throttle

MISSING_AFTER = 5.0  # s without the joint, before it is said to be missing
MAX_NAMES_TOLD = 20

_Heard = tuple[str, bytes, int, MessageInfo]  # topic, bytes, time of receipt (ns), origin


def own_topics(node: Node) -> list[Topic]:
    """Return all topics that `Predicting` hears or publishes on a node, as a log knows them."""
    types = {
        JOINT_STATES: JOINT_STATE,
        HITCH_POSITION: FLOAT64,
        "~/prediction": PREDICTION,
        "~/resonance": RESONANCE,
        **dict.fromkeys(SPEEDS, FLOAT64),
    }
    return [log_topic(node.resolve_topic_name(name), kind) for name, kind in types.items()]


class Predicting:
    """Answers each reading of the crank angle with a prediction on ``~/prediction``.

    Once a speed was told, the resonance follows on ``~/resonance``.

    Parameters
    ----------
    node : Node
        To hear on.
    publishers : Publishers
        To publish on.
    settings : Parameters
        To begin with.
    predictor : Predictor
        On the table.
    monitor : ResonanceMonitor
        Of the excitations.
    record : callable
        Called with topic, bytes, time of receipt (ns) and `MessageInfo` or None of all that is
        heard, used or published.
    show : callable
        Called with each crank angle that has a prediction, rad.
    statistics : Statistics
        Counts on.
    throttle : Throttle
        Warns of what cannot be answered.

    Attributes
    ----------
    predictor : Predictor
        The same; may be replaced between two messages.
    resonance : Resonance or None
        The last one.
    """

    def __init__(
        self,
        node: Node,
        publishers: Publishers,
        settings: Parameters,
        predictor: Predictor,
        monitor: ResonanceMonitor,
        record: Callable[[str, bytes, int, MessageInfo | None], None],
        show: Callable[[float], None],
        statistics: Statistics,
        throttle: Throttle,
    ) -> None:
        self.predictor = predictor
        self.resonance: Resonance | None = None
        self._node, self._monitor, self._record, self._show = node, monitor, record, show
        self._statistics, self._throttle = statistics, throttle
        self._settings = settings
        self._input: JointInput | PercentInput
        self._subscriptions: list[Any] = []
        self._other_joints: set[str] = set()
        self._began = 0.0
        self._joint_topic = node.resolve_topic_name(JOINT_STATES)
        self._percent_topic = node.resolve_topic_name(HITCH_POSITION)
        self._speed_topics = {s: node.resolve_topic_name(n) for n, s in SPEEDS.items()}
        self._predictions, self._resonances = publishers.predictions, publishers.resonances
        self._prediction_topic = self._predictions.topic_name
        self._resonance_topic = self._resonances.topic_name
        self.apply(settings)

    @property
    def what(self) -> str:
        """What is read, in words."""
        if isinstance(self._input, JointInput):
            return f"joint {self._input.joint_name} on {self._joint_topic}"
        return f"hitch position on {self._percent_topic}"

    def apply(self, settings: Parameters) -> None:
        """Follow other parameters from now on."""
        monitor, other_input = self._monitor, settings.input != self._settings.input
        self._settings, self._input = settings, settings.crank_input()
        monitor.warning_margin = settings.warning_margin
        monitor.hysteresis = settings.hysteresis
        monitor.stale_after = settings.stale_after
        for source in Source:
            fixed = settings.fixed_speed(source)
            if fixed is not None:
                monitor.set_fixed(source, fixed)
            elif monitor.is_fixed(source):
                monitor.forget(source)
        if other_input and self._subscriptions:
            self.rest()
            self.listen()

    def listen(self) -> None:
        """Answer what comes from now on."""
        self._began = time.monotonic()
        self._statistics.last_reading = math.nan
        hitch = (
            (JointState, self._joint_topic, self._on_joint_state)
            if isinstance(self._input, JointInput)
            else (Float64, self._percent_topic, self._on_percent)
        )
        # Of what is there at once the single-threaded executor takes the first subscription's:
        # speeds, that the reading is held against the newest ones. The events executor takes all
        # in the order in which it came.
        self._subscriptions = [
            subscribe(self._node, Float64, topic, partial(self._on_speed, source, topic))
            for source, topic in self._speed_topics.items()
        ]
        self._subscriptions.append(subscribe(self._node, *hitch))

    def rest(self) -> None:
        """Answer nothing from now on."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []
        self._other_joints.clear()
        self.resonance = None

    def tell_missing(self, now: float) -> None:
        """Warn when the joint has not come for long, and name those that have."""
        last = self._statistics.last_reading
        quiet = now - (self._began if math.isnan(last) else last)
        if quiet > MISSING_AFTER and isinstance(self._input, JointInput) and self._subscriptions:
            names = ", ".join(sorted(self._other_joints)[:MAX_NAMES_TOLD]) or "none"
            self._throttle.warn(
                "missing",
                f"Joint {self._input.joint_name} has not been on {self._joint_topic} for more than "
                f"{MISSING_AFTER:g} s; joints seen there: {names}. Set joint_name to one of them, "
                "or remap the topic.",
            )

    def _on_joint_state(self, data: bytes, info: MessageInfo) -> None:
        began, received = time.monotonic(), self._node.get_clock().now().nanoseconds
        self._statistics.received += 1
        if not isinstance(self._input, JointInput):
            return  # heard before the input was changed
        try:
            message = deserialize_message(data, JointState)
            reading = self._input.reading(message)
        except ReadingError as error:
            self._throttle.warn("reading", str(error))
            return
        except RuntimeError as error:
            self._throttle.warn(
                "bytes", f"A joint state of {len(data)} bytes is not valid CDR: {error}"
            )
            return
        if reading is None:
            # Several nodes may share the topic; `tell_missing` tells when none has the joint.
            if len(self._other_joints) < MAX_NAMES_TOLD:
                self._other_joints.update(message.name[:MAX_NAMES_TOLD])
            return
        if self._other_joints:
            self._other_joints.clear()
        header, heard = message.header, (self._joint_topic, data, received, info)
        self._answer(reading, header.stamp.sec, header.stamp.nanosec, header.frame_id, heard, began)

    def _on_percent(self, data: bytes, info: MessageInfo) -> None:
        began, received = time.monotonic(), self._node.get_clock().now().nanoseconds
        self._statistics.received += 1
        if not isinstance(self._input, PercentInput):
            return
        percent = self._float(data)
        if percent is not None:
            sec, nanosec = divmod(received, 10**9)
            heard = self._percent_topic, data, received, info
            self._answer(self._input.reading(percent), sec, nanosec, "", heard, began)

    def _on_speed(self, source: Source, topic: str, data: bytes, info: MessageInfo) -> None:
        received = self._node.get_clock().now().nanoseconds
        value = self._float(data)
        if value is not None:
            if self._settings.fixed_speed(source) is None:
                self._monitor.set_speed(source, value, received)
            self._record(topic, data, received, info)

    def _float(self, data: bytes) -> float | None:
        try:
            return float(deserialize_message(data, Float64).data)
        except RuntimeError as error:
            self._throttle.warn(
                "bytes", f"A Float64 of {len(data)} bytes is not valid CDR: {error}"
            )
            return None

    def _answer(
        self, reading: Reading, sec: int, nanosec: int, frame: str, heard: _Heard, began: float
    ) -> None:
        """Predict and publish; then count and record, what came before what it led to."""
        counts, received = self._statistics, heard[2]
        prediction = self.predictor.predict(reading.crank_angle, reading.stddev)
        encoded = encode_prediction(prediction, sec, nanosec, frame)
        self._predictions.publish(encoded)
        counts.latencies.append(time.monotonic() - began)
        counts.predicted += 1
        counts.take_reading(began, sec, nanosec, received)
        self._record(*heard)
        self._record(self._prediction_topic, encoded, received, None)
        if self._monitor.any_speed_reported:
            self.resonance = self._monitor.assess(prediction, reading.velocity, received)
            encoded = encode_resonance(self.resonance, sec, nanosec, frame)
            self._resonances.publish(encoded)
            self._record(self._resonance_topic, encoded, received, None)
        if prediction.status.has_numbers:
            self._show(reading.crank_angle)
        else:
            counts.without_numbers += 1
        if prediction.status is not Status.OK:
            told = fault(prediction, self.predictor.table.alpha3_range)
            self._throttle.warn(prediction.status.name, f"{self.what}: {told}.")
