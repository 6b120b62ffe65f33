# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The path of a message through the node: reading, prediction, resonance, log."""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from std_msgs.msg import Float64

from linkage_vibration.bags.joint_states import CdrError
from linkage_vibration.bags.writing import Topic
from linkage_vibration.messages.encoding import encode_prediction, encode_resonance
from linkage_vibration.messages.topics import INPUT_TOPICS, OUTPUT_TOPICS, SPEEDS, log_topic
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs import INPUTS
from linkage_vibration.prediction.inputs.crank_input import (
    CrankInput,
    Reading,
    ReadingError,
    read_float,
)
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.motion import Rate, crank_filter, crank_resolution
from linkage_vibration.prediction.predictor import Prediction, Predictor, Status, fault
from linkage_vibration.prediction.resonance import Resonance, ResonanceMonitor
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.ros.diagnostics import Statistics
from linkage_vibration.ros.endpoints import MessageInfo, Throttle, message_class
from linkage_vibration.ros.listener import Listener

MISSING_AFTER = 5.0  # s without the joint, before a warning says that it is missing
MAX_NAMES = 20  # of other joints, in that warning

_Message = tuple[str, bytes, int, MessageInfo]  # topic, bytes, time of receipt (ns), origin


def own_topics(node: Node) -> list[Topic]:
    """Return all topics that `Predicting` receives or publishes, as a log describes them."""
    return [
        log_topic(node.resolve_topic_name(topic.name), topic.type)
        for topic in (*INPUT_TOPICS, *OUTPUT_TOPICS)
        if topic.logged
    ]


class Predicting:
    """Answers each reading of the crank angle with a prediction on ``~/prediction``.

    Once a speed is known, the resonance follows on ``~/resonance``.

    Parameters
    ----------
    node, listener : Node, Listener
        The node that publishes, and the one that subscribes.
    predictions, resonances : Publisher
        The publishers of both topics.
    settings : Parameters
        The parameters at the start; `apply` changes them while the listener is paused.
    predictor : Predictor
        Looks up the table.
    monitor : ResonanceMonitor
        Compares the excitations with the natural frequencies.
    record : callable
        Called with the topic, the bytes, the time of receipt (ns) and the `MessageInfo` of every
        message that is used, and with the topics and bytes of its answers.
    show : callable
        Called with each crank angle that has a prediction, rad.
    statistics, throttle : Statistics, Throttle
        Count the messages, and warn of those that cannot be answered.

    Attributes
    ----------
    prediction, resonance : Prediction, Resonance or None
        The last ones.
    """

    def __init__(
        self,
        node: Node,
        listener: Listener,
        predictions: Any,
        resonances: Any,
        settings: Parameters,
        predictor: Predictor,
        monitor: ResonanceMonitor,
        record: Callable[..., None],
        show: Callable[[float], None],
        statistics: Statistics,
        throttle: Throttle,
    ) -> None:
        self.predictor = predictor
        self.prediction: Prediction | None = None
        self.resonance: Resonance | None = None
        self._clock, self._listener = node.get_clock(), listener
        self._monitor, self._record, self._show = monitor, record, show
        self._settings, self._statistics, self._throttle = settings, statistics, throttle
        self._input: CrankInput
        self._subscribed = False
        self._other_names: set[str] = set()
        self._began = 0.0
        self._input_topics = {i: node.resolve_topic_name(i.topic) for i in INPUTS.values()}
        self._speed_topics = {s: node.resolve_topic_name(n) for n, s in SPEEDS.items()}
        self._predictions, self._prediction_topic = predictions, predictions.topic_name
        self._resonances, self._resonance_topic = resonances, resonances.topic_name
        self.apply(settings)

    @property
    def input_name(self) -> str:
        """The input, as messages name it."""
        return self._input.describe(self._input_topics[type(self._input)])

    def apply(self, settings: Parameters) -> None:
        """Use other parameters from now on."""
        monitor, other_input = self._monitor, settings.input != self._settings.input
        self._settings, self._input = settings, settings.crank_input()
        self._motion = crank_filter()  # another calibration is not a motion
        monitor.limits = settings.warning_limits()
        monitor.stale_after = settings.stale_after
        for source in Source:
            monitor.set_fixed(source, settings.fixed_speed(source))
        if other_input and self._subscribed:
            self.unsubscribe()
            self.subscribe()

    def replace(self, predictor: Predictor, levels: LevelTable) -> None:
        """Use another table while the listener is paused.

        Parameters
        ----------
        predictor, levels : Predictor, LevelTable
            What looks it up.
        """
        self.predictor, self._monitor.levels = predictor, levels

    def subscribe(self) -> None:
        """Answer messages as soon as the listener starts."""
        self._began, self._subscribed = time.monotonic(), True
        self._statistics.last_reading = math.nan
        kind = type(self._input)
        message_type, topic = message_class(kind.type), self._input_topics[kind]
        for source, name in self._speed_topics.items():
            self._listener.subscribe(Float64, name, partial(self._on_speed, source, name))
        self._listener.subscribe(message_type, topic, partial(self._on_reading, kind))

    def unsubscribe(self) -> None:
        """Answer no more messages, once the listener has stopped."""
        self._listener.unsubscribe()
        self._subscribed = False
        self._other_names.clear()
        self.resonance = None

    def report_missing(self, now: float) -> None:
        """Warn if the joint is missing at a time (steady clock, s), and name the joints seen."""
        last = self._statistics.last_reading
        quiet = now - (self._began if math.isnan(last) else last)
        if quiet > MISSING_AFTER and self._subscribed:
            topic = self._input_topics[type(self._input)]
            explained = self._input.explain_missing(topic, sorted(self._other_names))
            if explained:
                silence = f"No reading for more than {MISSING_AFTER:g} s: "
                self._throttle.warn("missing", silence + explained)

    def _on_reading(self, kind: type[CrankInput], data: bytes, info: MessageInfo) -> None:
        began, received = time.monotonic(), self._now()
        self._statistics.received += 1
        if kind is not type(self._input):
            return  # it arrived before the input was changed
        topic = self._input_topics[kind]
        try:
            message = self._input.decode(data)
            reading = self._input.reading(message)
        except ReadingError as error:
            self._throttle.warn("reading", str(error))
            return
        except CdrError as error:
            problem = f"A message of {len(data)} bytes on {topic} is not valid CDR: {error}."
            self._throttle.warn("bytes", problem)
            return
        if reading is None:
            # Several nodes may share the topic; `report_missing` warns if none sends the joint.
            if len(self._other_names) < MAX_NAMES:
                self._other_names.update(self._input.other_names(message))
            return
        if self._other_names:
            self._other_names.clear()
        header = self._input.header(message, received)
        self._answer(reading, *header, (topic, data, received, info), began)

    def _now(self) -> int:
        """Return the time of the node's clock, ns, without rclpy in a third of the time."""
        return self._clock.now().nanoseconds if self._clock.ros_time_is_active else time.time_ns()

    def _on_speed(self, source: Source, topic: str, data: bytes, info: MessageInfo) -> None:
        received = self._now()
        try:
            value = read_float(data)
        except CdrError as error:
            problem = f"A message of {len(data)} bytes on {topic} is not valid CDR: {error}."
            self._throttle.warn("bytes", problem)
            return
        if self._settings.fixed_speed(source) is None:
            self._monitor.set_speed(source, value, received)
        self._record(topic, data, received, info)

    def _answer(
        self, reading: Reading, sec: int, nanosec: int, frame: str, source: _Message, began: float
    ) -> None:
        """Predict and publish; then count, and record the message with its answers."""
        counts, received = self._statistics, source[2]
        prediction = self.predictor.predict(reading.crank_angle, reading.stddev)
        self.prediction = prediction
        encoded = encode_prediction(prediction, sec, nanosec, frame)
        self._predictions.publish(encoded)
        counts.latencies.append(time.monotonic() - began)
        counts.predicted += 1
        counts.take_reading(began, sec, nanosec, received)
        answers = [(self._prediction_topic, encoded)]
        velocity, error = self._velocity(reading, 10**9 * sec + nanosec)
        if self._monitor.any_speed_reported:
            self.resonance = self._monitor.assess(prediction, velocity, received, error)
            encoded = encode_resonance(self.resonance, sec, nanosec, frame)
            self._resonances.publish(encoded)
            answers.append((self._resonance_topic, encoded))
        self._record(*source, *answers)
        if prediction.status.has_numbers:
            self._show(reading.crank_angle)
        else:
            counts.without_numbers += 1
        if prediction.status is not Status.OK:
            problem = fault(prediction, self.predictor.table.alpha3_range)
            self._throttle.warn(prediction.status.name, f"{self.input_name}: {problem}.")

    def _velocity(self, reading: Reading, stamp: int) -> Rate:
        """Return the velocity of the crank: as reported, or else as estimated."""
        if reading.velocity == reading.velocity:  # it is not NaN
            return Rate(reading.velocity, 0.0)
        resolution = crank_resolution(reading.stddev, self._settings.angle_stddev)
        return self._motion.add(stamp, reading.crank_angle, resolution)
