# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The path of a message through the node: reading, prediction, resonance, log."""

import math
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, TypeVar

import numpy as np
from rclpy.node import Node

from linkage_vibration.bags.numbers import CdrError, ReadingError
from linkage_vibration.bags.writing import Topic
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.topics import OUTPUT_TOPICS, PREDICTION, RESONANCE, log_topic
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.health import Expected, Fault, ReadingWatch, SpeedWatch
from linkage_vibration.prediction.inputs.presets import HITCH
from linkage_vibration.prediction.inputs.sources import CrankInput, Stamped
from linkage_vibration.prediction.inputs.units import ANGLES, Reading
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.motion import UNKNOWN, Rate, crank_filter, crank_resolution
from linkage_vibration.prediction.predictor import Prediction, Predictor, Status, fault
from linkage_vibration.prediction.resonance import ResonanceMonitor
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.ros.diagnostics import Statistics
from linkage_vibration.ros.endpoints import MessageInfo, Throttle, message_class
from linkage_vibration.ros.listener import Listener
from linkage_vibration.ros.live_inputs import LiveTopic

MISSING_AFTER = 5.0  # s without the joint, before a warning says that it is missing
MAX_NAMES = 20  # of other joints, in that warning

_Found = TypeVar("_Found")
_Message = tuple[str, bytes, int, MessageInfo]  # topic, bytes, time of receipt (ns), origin


def input_topics(topics: dict[str, LiveTopic]) -> list[Topic]:
    """Return the topics of the inputs as a log describes them."""
    return [log_topic(topic.name, topic.type) for topic in topics.values()]


def output_topics(node: Node) -> list[Topic]:
    """Return the topics of the answers as a log describes them."""
    logged = [topic for topic in OUTPUT_TOPICS if topic.logged]
    return [log_topic(node.resolve_topic_name(topic.name), topic.type) for topic in logged]


class Predicting:
    """Answers each reading of the crank angle with a prediction on ``~/prediction``.

    Once a speed is known, resonances follow on ``~/resonance``, at a limited rate.

    Parameters
    ----------
    node, listener : Node, Listener
        The node that publishes, and the one that subscribes.
    predictions, resonances : Publisher
        The publishers of both topics.
    settings : Parameters
        The parameters at the start; `apply` changes them while the listener is paused.
    topics : dict of str to LiveTopic
        The topics of the inputs by their names.
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
    prediction, resonance : Prediction, MessageColumns or None
        The last ones.
    """

    def __init__(
        self,
        node: Node,
        listener: Listener,
        predictions: Any,
        resonances: Any,
        settings: Parameters,
        topics: dict[str, LiveTopic],
        predictor: Predictor,
        monitor: ResonanceMonitor,
        record: Callable[..., None],
        show: Callable[[float], None],
        statistics: Statistics,
        throttle: Throttle,
    ) -> None:
        self.predictor = predictor
        self.prediction: Prediction | None = None
        self.resonance: MessageColumns | None = None
        self._node, self._clock, self._listener = node, node.get_clock(), listener
        self._monitor, self._record, self._show = monitor, record, show
        self._statistics, self._throttle = statistics, throttle
        self._topics: dict[str, LiveTopic] = {}
        self._crank: CrankInput
        self._subscribed = False
        self._other_names: set[str] = set()
        self._began = self._judged = 0.0
        self._predictions, self._prediction_topic = predictions, predictions.topic_name
        self._resonances, self._resonance_topic = resonances, resonances.topic_name
        self.apply(settings, topics)

    @property
    def input_name(self) -> str:
        """The input, as messages name it."""
        return self._crank.describe(self._crank_topic)

    def apply(self, settings: Parameters, topics: dict[str, LiveTopic]) -> None:
        """Use other parameters from now on.

        Parameters
        ----------
        settings : Parameters
        topics : dict of str to LiveTopic
            The topics of their inputs.
        """
        monitor, before = self._monitor, {(t.name, t.type) for t in self._topics.values()}
        self._settings, self._topics = settings, topics
        self._crank_topic, crank = next((t.name, t.crank) for t in topics.values() if t.crank)
        assert crank is not None
        self._crank = crank
        self._motion = crank_filter()  # another calibration is not a motion
        monitor.limits = settings.warning_limits()
        monitor.stale_after, monitor.rate = settings.stale_after, settings.resonance_rate
        for source in Source:
            monitor.set_fixed(source, settings.fixed_speed(source))
        if before != {(t.name, t.type) for t in topics.values()} and self._subscribed:
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
        self._began = self._judged = time.monotonic()
        self._subscribed = True
        first, last = self.predictor.table.alpha3_range
        self._readings = ReadingWatch(turns=last - first > math.pi)
        self._speeds = {source: SpeedWatch(source) for source in Source}
        self._statistics.last_reading = math.nan
        for topic in self._topics.values():
            on_message = partial(self._on_message, topic.name, topic.type)
            self._listener.subscribe(message_class(topic.type), topic.name, on_message)

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
            names = sorted(self._other_names)
            explained = self._crank.reader.explain_missing(self._crank_topic, names)
            if explained:
                silence = f"No reading for more than {MISSING_AFTER:g} s: "
                self._throttle.warn("missing", silence + explained)

    def reading_faults(self, now: float) -> list[Fault]:
        """Return what was wrong with the readings since the last call (steady clock, s)."""
        if not self._subscribed:
            return []
        topic, names, scale = self._crank_topic, sorted(self._other_names), self._crank.scale
        first, last = self.predictor.table.alpha3_range
        expected = Expected(
            name=self.input_name,
            remedy=self._crank.reader.explain_missing(topic, names) if names else "",
            first=first,
            last=last,
            offset=scale.offset * ANGLES.get(scale.unit, math.nan),
            stale_after=self._settings.stale_after,
            publishers=partial(self._publishers, topic),
            shaken=any(watch.turns(now) for watch in self._speeds.values()),
        )
        elapsed, self._judged = now - self._judged, now
        return self._readings.judge(now, elapsed, expected)

    def speed_faults(self, now: float) -> list[Fault]:
        """Return what was wrong with the speeds since the last call (steady clock, s)."""
        found: list[Fault] = []
        for topic in self._topics.values():
            publishers = partial(self._publishers, topic.name)
            for source, _ in topic.speeds:
                if self._subscribed and self._settings.fixed_speed(source) is None:
                    stale_after = self._settings.stale_after
                    found += self._speeds[source].judge(now, topic.name, stale_after, publishers)
        return found

    def _publishers(self, topic: str) -> list[str]:
        """Return the names of the nodes that publish a topic, one for each publisher."""
        return [one.node_name for one in self._node.get_publishers_info_by_topic(topic)]

    def _on_message(self, name: str, kind: str, data: bytes, info: MessageInfo) -> None:
        began, received = time.monotonic(), self._now()
        topic = self._topics.get(name)
        if topic is None or topic.type != kind:
            return  # it arrived before the inputs were changed
        message, used = (name, data, received, info), False
        for source, speed in topic.speeds:
            found = self._read(speed.read_one, message)
            if found is not None:
                used = True
                sequence = info["publication_sequence_number"] or 0
                self._speeds[source].take(began, found[0], sequence)
                self._take_speed(source, *found, speed.describe(name), speed.reader.note)
        if topic.crank is not None:
            self._statistics.received += 1
            reading = self._read(topic.crank.read_one, message, self._readings.refuse)
            if reading is not None:
                self._other_names.clear()
                self._answer(reading, message, began)
                return  # with its answers, the message is recorded
            # Several nodes may share the topic; `report_missing` warns if none sends the joint.
            if len(self._other_names) < MAX_NAMES:
                self._add_other_names(topic.crank, data)
        if used:
            self._record(*message)

    def _read(
        self,
        read: Callable[[bytes, int], _Found | None],
        message: _Message,
        refuse: Callable[[str], None] = lambda fault: None,
    ) -> _Found | None:
        """Return what an input reads from a message; None if there is nothing, after a warning."""
        topic, data, received, _ = message
        try:
            return read(data, received)
        except ReadingError as error:
            refuse(str(error))
            self._throttle.warn("reading", str(error))
        except CdrError as error:
            problem = f"A message of {len(data)} bytes on {topic} is not valid CDR: {error}."
            refuse(problem)
            self._throttle.warn("bytes", problem)
        return None

    def _add_other_names(self, crank: CrankInput, data: bytes) -> None:
        with suppress(CdrError):
            self._other_names.update(crank.reader.other_names(data))

    def _now(self) -> int:
        """Return the time of the node's clock, ns, without rclpy in a third of the time."""
        return self._clock.now().nanoseconds if self._clock.ros_time_is_active else time.time_ns()

    def _take_speed(self, source: Source, value: float, at: int, words: str, note: str) -> None:
        if self._settings.fixed_speed(source) is None:
            self._monitor.set_speed(source, value, at)
        problem = f"{words} has no {source.value} speed now, so it is unknown. {note}".rstrip()
        self._throttle.report(source.value, problem if math.isnan(value) else "")

    def _answer(self, stamped: Stamped, source: _Message, began: float) -> None:
        """Predict and publish; then count, and record the message with its answers."""
        reading, sec, nanosec, frame, at = stamped
        counts, received = self._statistics, source[2]
        prediction = self.predictor.predict(reading.crank_angle, reading.stddev)
        self.prediction = prediction
        encoded = encode_message(PREDICTION, prediction, sec, nanosec, frame)
        self._predictions.publish(encoded)
        counts.latencies.append(time.monotonic() - began)
        counts.predicted += 1
        counts.take_reading(began, sec, nanosec, received)
        answers = [(self._prediction_topic, encoded)]
        stamp, needed = 10**9 * sec + nanosec, self._monitor.any_speed_reported
        needed = needed and bool(self._monitor.due(np.array([stamp]))[0])
        velocity, error = self._velocity(reading, stamp, needed)
        if needed:
            self.resonance = self._monitor.assess(prediction, velocity, at, error)
            encoded = encode_message(RESONANCE, self.resonance, sec, nanosec, frame)
            self._resonances.publish(encoded)
            answers.append((self._resonance_topic, encoded))
        self._record(*source, *answers)
        self._readings.take(
            began,
            stamp,
            received,
            reading.crank_angle,
            reading.velocity,
            known=prediction.status is not Status.OUT_OF_RANGE,
            sequence=source[3]["publication_sequence_number"] or 0,
        )
        if prediction.status.has_numbers:
            self._show(reading.crank_angle)
        else:
            counts.without_numbers += 1
        invalid = prediction.status is Status.INVALID_ANGLE
        if prediction.status is not Status.OK:
            problem = f"{self.input_name}: {fault(prediction, self.predictor.table.alpha3_range)}."
            if invalid:
                self._throttle.report(HITCH, f"{problem} {self._crank.reader.note}".rstrip())
            else:
                self._throttle.warn(prediction.status.name, problem)
        if not invalid:
            self._throttle.report(HITCH, "")

    def _velocity(self, reading: Reading, stamp: int, needed: bool) -> Rate:
        """Return the velocity of the crank, if needed: as reported, or else as estimated."""
        if reading.velocity == reading.velocity:  # it is not NaN
            return Rate(reading.velocity, 0.0)
        resolution = crank_resolution(reading.stddev, self._settings.angle_stddev)
        if needed:
            return self._motion.add(stamp, reading.crank_angle, resolution)
        self._motion.note(stamp, reading.crank_angle, resolution)
        return UNKNOWN
