# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The path of a message through the node: reading, prediction, resonance, log."""

import math
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from rclpy.node import Node

from linkage_vibration.bags.scalar_reader import MAX_NAMES, CdrError, ReadingError
from linkage_vibration.bags.writing import Topic
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.encoding import encode_message, stamp_and_frame
from linkage_vibration.messages.topics import (
    ADVICE,
    ASSESSED,
    LOAD_STATE,
    MEASURED,
    OUTPUT_TOPICS,
    PREDICTION,
    log_topic,
)
from linkage_vibration.prediction.advice import Adviser
from linkage_vibration.prediction.agreement import StandingClock, crank_agreement
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.health import (
    Fault,
    Level,
    ReadingExpectation,
    ReadingWatch,
    SpeedWatch,
    missing_speeds,
    turns_without_engine,
)
from linkage_vibration.prediction.inputs.presets import HITCH
from linkage_vibration.prediction.inputs.sources import (
    MAX_BYTES,
    CrankInput,
    SpeedInput,
    Stamped,
    too_large,
)
from linkage_vibration.prediction.inputs.units import ANGLES, Reading
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.motion import UNKNOWN, Rate, crank_filter, crank_resolution
from linkage_vibration.prediction.periods import Periods, Stamps, WindowStep, second
from linkage_vibration.prediction.predictor import Prediction, Predictor, Status, fault
from linkage_vibration.prediction.resonance import Header, ResonanceMonitor
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.prediction.severity import ResonanceState, Unknown
from linkage_vibration.ros.arrivals import LONGEST_WAIT, Arrival, arrival, in_time, waiting
from linkage_vibration.ros.endpoints import MessageInfo, Throttle, message_class, unmatched
from linkage_vibration.ros.listener import Listener
from linkage_vibration.ros.live_inputs import LiveTopic
from linkage_vibration.ros.statistics import SequenceGaps, Statistics

if TYPE_CHECKING:
    from linkage_vibration.listening.live import SensorMonitor

MISSING_AFTER = 5.0  # s without the joint, before a warning says that it is missing
_BEHIND = 0.5  # s in the queue, after which it is not known when a speed was last sent
SILENT = 5.0  # s, after which a sensor without samples is silent
NAMES_FOR = 3.0  # s, after which the name of a joint or signal is not used if it is not seen again
NO_CLOCK = (
    "Nothing is predicted, as use_sim_time is true, but no time arrives on /clock; publish it, or "
    "set the parameter to false."
)
STOPPED_CLOCK = "The time on /clock stands still."

_Value = TypeVar("_Value")
_Message = tuple[str, bytes, int, MessageInfo]  # topic, bytes, time of receipt (ns), origin
_Answers = list[tuple[str, bytes]]  # topics and bytes


def input_topics(topics: dict[str, LiveTopic]) -> list[Topic]:
    """Return the topics of the inputs as a log describes them."""
    return [log_topic(topic.name, topic.type) for topic in topics.values()]


def output_topics(node: Node) -> list[Topic]:
    """Return the topics of the answers as a log describes them."""
    return [
        log_topic(node.resolve_topic_name(topic.name), topic.type, latched=topic.latched)
        for topic in OUTPUT_TOPICS
        if topic.logged
    ]


class LivePipeline:
    """Answers readings with predictions and, once a speed is known, resonances and advice."""

    def __init__(
        self,
        node: Node,
        listener: Listener,
        publishers: Mapping[str, Any],  # by the types of their messages
        settings: Parameters,
        topics: dict[str, LiveTopic],
        predictor: Predictor,
        monitor: ResonanceMonitor,
        sensors: "SensorMonitor | None",
        record: Callable[..., None],  # gets each used message, its time, ns, and its answers
        statistics: Statistics,
        throttle: Throttle,
    ) -> None:
        self.predictor, self.excitations = predictor, monitor.rules.excitations
        self.prediction: Prediction | None = None
        self.resonance: MessageColumns | None = None
        self.readings, self.age = ReadingWatch(), math.nan
        self.reading_faults: list[Fault] = []
        self.speed_faults: list[Fault] = []
        self.unmatched = list[str]()  # sentences about subscribers whose QoS does not match
        self.clock_missing = False  # whether a simulated clock has not begun
        self.sensors = sensors
        self.measured: dict[str, tuple[float, MessageColumns]] = {}  # by sensor, with its time, s
        self._node, self._clock, self._listener = node, node.get_clock(), listener
        self._monitor, self._adviser, self._periods = monitor, Adviser(monitor), Periods()
        self._stamps, self._standing = Stamps(), StandingClock()
        self._counted = 0  # load states until the last judgement
        self._record, self._statistics, self._throttle = record, statistics, throttle
        self._sent = self._taken = 0  # messages of the hitch until the last judgement
        self._own_publishers = [*publishers.values()]
        self._outputs = {kind: (each.publish, each.topic_name) for kind, each in publishers.items()}
        self._topics: dict[str, LiveTopic] = {}
        self._crank: CrankInput
        self._subscribed = False
        self._other_names: set[str] = set()  # since the last judgement
        self._names: dict[str, float] = {}  # of joints or signals, with their times, s
        self._instant, self.paused = 0, False  # of a simulated clock, ns, and whether it stands
        self._too_large = 0
        self._began = self._judged = 0.0
        self._latest = 0  # ns, the last time of receipt
        self._answering = 0.0  # s, for the last message
        self._queues: dict[str, Any] = {}  # subscriptions by their topics
        self._gaps: defaultdict[str, SequenceGaps] = defaultdict(SequenceGaps)
        self.apply(settings, topics)

    @property
    def input_name(self) -> str:
        """The input, as messages name it."""
        return self._crank.describe(self._crank_topic)

    def apply(self, settings: Parameters, topics: dict[str, LiveTopic]) -> None:
        """Use other parameters, with the topics of their inputs, while the listener is paused."""
        monitor, before = self._monitor, {(t.name, t.type) for t in self._topics.values()}
        self._topics, self._angle_stddev = topics, settings.angle_stddev
        self._fixed = {source: settings.fixed_speed(source) for source in Source}
        self.stale_after = settings.stale_after
        self._crank_topic, crank = next((t.name, t.crank) for t in topics.values() if t.crank)
        assert crank is not None
        self._crank = crank
        self._motion = crank_filter()  # another calibration is not a motion
        self._names.clear()  # the joint may be another one
        self.readings.last, self._awaited = math.nan, time.monotonic()
        monitor.use(settings.warning_limits())
        monitor.stale_after, monitor.windows.rate = settings.stale_after, settings.resonance_rate
        self._periods.rate = settings.prediction_rate
        for source, fixed in self._fixed.items():
            monitor.set_fixed(source, fixed)
        if self.sensors is not None:
            self.sensors.stale_after = settings.stale_after
            self.sensors.fixed = {s: v for s, v in self._fixed.items() if v is not None}
        if before != {(t.name, t.type) for t in topics.values()} and self._subscribed:
            self.unsubscribe()
            self.subscribe()

    def replace(self, predictor: Predictor, mechanism: Mechanism, levels: LevelTable) -> None:
        """Use another table while the listener is paused."""
        self.predictor = predictor
        self._monitor.use(levels=levels)
        if self.sensors is not None:
            self.sensors.use(predictor, mechanism)

    def restart_count(self) -> None:
        """Count load states from 1 while the listener is paused."""
        self._monitor.restart()

    def subscribe(self) -> None:
        """Answer messages as soon as the listener starts."""
        self.restart_count()
        self._began = self._judged = time.monotonic()
        self._subscribed = True
        self._agreement = crank_agreement(self.predictor.table.alpha3_range)
        first, last = self.predictor.table.alpha3_range
        self.readings = ReadingWatch(last - first > math.pi, self.readings.stamps_back)
        self._speeds = {
            source: SpeedWatch(source, topic.name)
            for topic in self._topics.values()
            for source, _ in topic.speeds
        }
        self._arrived = -math.inf  # s, when a message of the hitch last arrived
        for topic in self._topics.values():
            on_message = partial(self._on_message, topic.name, topic.type)
            kind = message_class(topic.type)
            self._queues[topic.name] = self._listener.subscribe(kind, topic.name, on_message)

    def unsubscribe(self) -> None:
        """Answer no more messages, once the listener has stopped."""
        self._queues.clear()
        self._listener.unsubscribe()
        self._subscribed = False
        self._other_names.clear()
        self._names.clear()
        self._gaps.clear()
        self.resonance = None

    def judge(self, now: float) -> None:
        """Set the faults of the inputs since the last call; ``now`` is by the steady clock, s."""
        before, self._instant = self._instant, self._now()
        self.paused = self._clock.ros_time_is_active and self._instant == before
        self.clock_missing = self._subscribed and self._instant <= 0
        self._throttle.report("clock", NO_CLOCK if self.clock_missing else "")
        if self.clock_missing:
            self._began = self._judged = now  # without a clock, nothing else is missing
            self.reading_faults = self.speed_faults = [Fault(Level.STALE, NO_CLOCK)]
        else:
            self.reading_faults = self._judge_readings(now) if self._subscribed else []
            self.speed_faults = self._judge_speeds(now) if self._subscribed else []
        self.measured = {n: m for n, m in self.measured.items() if now - m[0] <= SILENT}
        self.age = max(now - self.readings.last, 0.0)  # another thread has taken it
        # While a clock stands, readings whose stamps move are assessed, and others are not.
        waits = self.paused and self._monitor.count == self._counted
        self._counted = self._monitor.count
        idle = waits or self.clock_missing or not self.age <= self.stale_after
        nothing = idle or not self._monitor.any_speed_reported
        if nothing and self._subscribed and self.excitations:
            self._publish_unknown(Unknown.CRANK_ANGLE if idle else Unknown(0))
        subscribers, own = self._node.get_subscriptions_info_by_topic, self._own_publishers
        found = (unmatched(p, subscribers(p.topic_name), "subscriber") for p in own)
        self.unmatched = sorted({sentence for sentences in found for sentence in sentences})
        self._throttle.report("QoS", " ".join(self.unmatched))

    def _publish_unknown(self, crank: Unknown) -> None:
        """Publish that the load is not known while none is assessed; no log has this message."""
        publish, _ = self._outputs[LOAD_STATE]
        last, now = self.resonance, self._now()
        levels = Unknown.GROUND_LEVEL | Unknown.ORDER_LEVEL
        before = 0 if last is None else int(last.unknown_sources) & levels
        message = MessageColumns(
            count=0 if last is None else last.count,
            state=ResonanceState.UNKNOWN,
            unknown_sources=before | self._monitor.unknown_speeds(now) | crank,
            speed_source=0,
            timed_by_receipt=last is not None and last.timed_by_receipt,
            excitation_index=-1,
            total_load_ratio=math.nan,
            load_ratio_limit=self._monitor.rules.limits.warning,
            known_share=0.0,
            quiet_speed=math.nan,
            quiet_angle=math.nan,
        )
        publish(encode_message(LOAD_STATE, message, *divmod(now, 10**9), ""))

    def _judge_readings(self, now: float) -> list[Fault]:
        """Return what was wrong with the readings; if the joint is missing, also warn."""
        scale, missing = self._crank.scale, not now - self.readings.last <= self.stale_after
        taken = self._share_taken(now)
        mismatches = self._listener.unmatched()
        remedy = self._explain_missing(now, mismatches) if missing else ""
        first, last = self.predictor.table.alpha3_range
        expected = ReadingExpectation(
            name=self.input_name,
            remedy=remedy,
            others=bool(self._names),
            first=first,
            last=last,
            offset=scale.offset * ANGLES.get(scale.unit, math.nan),
            stale_after=self.stale_after,
            since=max(self._awaited, self._began),
            publishers=partial(self._publishers, self._crank_topic),
            taken=taken,
        )
        elapsed, self._judged = now - self._judged, now
        faults = self.readings.judge(now, elapsed, expected)
        if now - self.readings.last <= self.stale_after:
            self._names.clear()
        sentences = [s for each in mismatches.values() for s in each if s not in remedy]
        faults += [Fault(Level.WARN, sentence) for sentence in sentences]
        last = max(self._began, self._awaited, self.readings.last)
        if remedy and now - last > MISSING_AFTER:
            silence = f"No reading for more than {MISSING_AFTER:g} s: "
            self._throttle.warn("missing", silence + remedy)
        return faults

    def _share_taken(self, now: float) -> float:
        """Return the share of new messages of the hitch that are used; update other names."""
        counts, names = self._statistics, self._other_names
        self._other_names = set()
        self._names = {n: at for n, at in self._names.items() if now - at <= NAMES_FOR}
        self._names |= dict.fromkeys(names, now)
        before = self._sent, self._taken
        self._sent = counts.received + counts.lost[self._crank_topic]
        self._taken = counts.received - counts.dropped[self._crank_topic]
        sent, taken = self._sent - before[0], self._taken - before[1]
        if sent:
            self._arrived = now
        return min(max(taken, 1) / max(sent, 1), 1.0)

    def _explain_missing(self, now: float, mismatches: Mapping[str, list[str]]) -> str:
        """Return why no reading may have come, and the remedy."""
        topic, reader, names = self._crank_topic, self._crank.reader, sorted(self._names)
        if self.paused:
            return STOPPED_CLOCK
        if names:
            before = "" if math.isnan(self.readings.last) else "It came before; check its sender. "
            return before + reader.explain_missing(topic, names)
        endpoints = self._node.get_publishers_info_by_topic(topic)
        nodes = ", ".join(sorted(each.node_name for each in endpoints))
        if not nodes:
            return f"{topic} has no publisher; start it, or set hitch_topic to one that has."
        # Only what has come since the last reading says why there is none.
        goes_on = not self._arrived - self.readings.last <= self.stale_after
        arrives = goes_on and now - self._arrived <= NAMES_FOR
        if arrives and (explained := reader.explain_missing(topic, [])):
            return explained
        kinds, kind = {each.topic_type for each in endpoints}, self._topics[topic].type
        if kind not in kinds:
            listing = ", ".join(sorted(kinds))
            fix = "set hitch_type and hitch_field, or hitch_topic to another topic"
            return f"The publishers of {topic} ({nodes}) send {listing}, not {kind}; {fix}."
        if mismatches.get(topic):
            return " ".join(mismatches[topic])
        silent = now - max(self._arrived, self._began)
        if silent <= self.stale_after:
            return f"Nothing has arrived yet from the publishers of {topic} ({nodes})."
        return (
            f"Nothing has arrived from the publishers of {topic} ({nodes}) for {silent:.0f} s, "
            "although one has the right type and QoS; check it and the network."
        )

    def _judge_speeds(self, now: float) -> list[Fault]:
        """Return what was wrong with the speeds that are not fixed."""
        faults: list[Fault] = []
        missing, measured = list[str](), dict[Source, SpeedWatch]()
        any_known = any(fixed is not None for fixed in self._fixed.values())
        needed = {excitation.source for excitation in self.excitations}
        delay = "messages wait for the node" if self._statistics.wait > _BEHIND else ""
        delay = "the time on /clock stands still" if self.paused else delay
        for topic in self._topics.values():
            for source, speed in topic.speeds:
                if self._fixed[source] is None:
                    measured[source] = watch = self._speeds[source]
                    publishers = partial(self._publishers, topic.name)
                    faults += watch.judge(now, self.stale_after, publishers, delay)
                    any_known = any_known or watch.arrived
                    if not watch.arrived and (speed.settings.chosen or source in needed):
                        missing.append(watch.name)
        if {Source.PTO, Source.ENGINE} <= measured.keys():
            shafts = measured[Source.PTO], measured[Source.ENGINE]
            faults += turns_without_engine(*shafts, now)
        age = now - self._began
        waits = age <= self.stale_after or not any_known
        return faults + missing_speeds(missing, age, Level.STALE if waits else Level.WARN)

    def _publishers(self, topic: str) -> list[str]:
        """Return the names of the nodes that publish a topic, one for each publisher."""
        return [each.node_name for each in self._node.get_publishers_info_by_topic(topic)]

    def _on_message(self, name: str, kind: str, data: bytes, info: MessageInfo) -> None:
        """Use a message; if it has waited for too long, all that wait, without outdated ones."""
        topic = self._topics.get(name)
        if topic is None or topic.type != kind:
            return  # it arrived before the inputs were changed
        message = arrival(topic, data, info)
        messages = [message] if self._is_accepted(message) else []
        if message.wait > LONGEST_WAIT:
            for each, subscription in self._queues.items():
                messages += filter(self._is_accepted, waiting(self._topics[each], subscription))
            messages.sort(key=lambda each: each.received)
        # What is left out is not recorded either, so that a replay has the same answers.
        for message in in_time(messages, self._answering, self._statistics.dropped):
            began = time.monotonic()
            self._use(message)
            self._answering = time.monotonic() - began

    def _is_accepted(self, message: Arrival) -> bool:
        """Count a message, and return whether it is small enough."""
        topic, counts = message.topic, self._statistics
        counts.wait = max(counts.wait, message.wait)
        number = message.info["publication_sequence_number"]
        if number is not None:
            publishers = partial(self._node.count_publishers, topic.name)
            counts.lost[topic.name] += self._gaps[topic.name].before(number, publishers)
        counts.arrived[topic.name] += 1
        counts.received += topic.crank is not None
        if len(message.data) <= MAX_BYTES:
            return True
        self._too_large += 1
        problem = f"{topic.name}: {too_large(len(message.data))}"
        if topic.crank is not None:
            self.readings.refuse(problem)
        self._throttle.warn("size", f"{problem} It is number {self._too_large} of such messages.")
        return False

    def _use(self, arrived: Arrival) -> None:
        """Answer a message and record it, if it has a number for an input."""
        topic, data, info, received, wait = arrived
        began, now, name = time.monotonic(), self._now(), topic.name
        if self._clock.ros_time_is_active:
            received = now
        else:  # several threads of the middleware may receive
            received, wait = max(received, min(self._latest, now)), 0.0
        if received <= 0:
            return  # before a simulated clock runs; the log has no time for it
        self._latest = received
        message, answers = (name, data, received, info), _Answers()
        used = False
        for source, speed in topic.speeds:
            value_and_time = self._read(speed.read_one, message)
            if value_and_time is not None:
                used = True
                value, at = value_and_time
                self._speeds[source].take(began, value, speed.reader.sender, 1e-9 * (received - at))
                self._take_speed(source, value, at, speed, name)
        for i, sensor in topic.sensors:
            sample = self._read(sensor.read_one, message)
            if sample is not None and self.sensors is not None:
                used = True
                stamp, frame, values = sample
                measured = self.sensors.take(i, stamp, values)
                if measured is not None:
                    self.measured[measured.sensor] = began, measured
                    self._publish(MEASURED, measured, *divmod(second(stamp), 10**9), frame, answers)
        if topic.crank is not None:
            reading = self._read(topic.crank.read_one, message, self.readings.refuse)
            if reading is not None:
                self._other_names.clear()
                self._answer(reading, message, began, wait, answers)
                return  # with its answers, the message is recorded
            # Several nodes may share the topic; `judge` warns if none sends the joint.
            if len(self._other_names) < MAX_NAMES:
                with suppress(CdrError):
                    self._other_names.update(topic.crank.reader.other_names(data))
        if used:
            self._record(*message, *answers)

    def _read(
        self,
        read: Callable[[bytes, int], _Value | None],
        message: _Message,
        refuse: Callable[[str], None] = lambda fault: None,
    ) -> _Value | None:
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

    def _now(self) -> int:
        """Return the time of the node's clock, ns, without rclpy in a third of the time."""
        return self._clock.now().nanoseconds if self._clock.ros_time_is_active else time.time_ns()

    def _publish(
        self, kind: str, message: object, sec: int, nanosec: int, frame: str, answers: _Answers
    ) -> None:
        """Publish one of our messages, and add its topic and its bytes to the answers."""
        publish, topic = self._outputs[kind]
        encoded = encode_message(kind, message, sec, nanosec, frame)
        publish(encoded)
        answers.append((topic, encoded))

    def _take_speed(
        self, source: Source, value: float, at: int, speed: SpeedInput, topic: str
    ) -> None:
        problem, fixed = "", self._fixed[source]
        if fixed is not None:
            name = f"{source.value}_speed"
            problem = f"{speed.describe(topic)} is not used, as {name} is fixed at {fixed:g}."
        elif math.isnan(value):
            words = f"{speed.describe(topic)} has no {source.value} speed now, so it is unknown."
            problem = f"{words} {speed.reader.note}".rstrip()
        if fixed is None:
            self._monitor.set_speed(source, value, at)
            if self.sensors is not None:
                self.sensors.set_speed(source, value, at)
        self._throttle.report(source.value, problem)

    def _answer(
        self, stamped: Stamped, source: _Message, began: float, wait: float, answers: _Answers
    ) -> None:
        """Predict and publish; then count, and record the message with its answers."""
        reading, sec, nanosec, frame, at = stamped
        header = sec, nanosec, frame
        counts, received = self._statistics, source[2]
        prediction = self.predictor.predict(reading.crank_angle, reading.stddev)
        self.prediction = prediction
        stamp, needed = 10**9 * sec + nanosec, self._monitor.any_speed_reported
        if self.sensors is not None:
            self.sensors.set_angle(reading.crank_angle, stamp)
        due_at, by_receipt = self._stamps.time(stamp, at)
        if self._periods.is_due(due_at):
            self._publish(PREDICTION, prediction, *header, answers)
            counts.latencies.append(time.monotonic() - began)
        step = self._monitor.windows.step(due_at) if needed else WindowStep.LEFT_OUT
        needed = step is not WindowStep.LEFT_OUT
        velocity = self._velocity(reading, stamp, needed)
        lost = self._agreement.loses(due_at, reading.crank_angle)
        lost |= self._standing.stands(at, stamp)
        if needed:
            # No load is known at an angle that is doubted.
            known = self.predictor.predict(math.nan, math.nan) if lost else prediction
            of_reading = Header(*header, due_at, by_receipt, step)
            windows = self._monitor.take(known, velocity, at, of_reading)
            if windows is not None:
                self._publish_windows(windows, answers)
        self._record(*source, *answers)
        self.readings.take(
            began,
            stamp,
            received - round(1e9 * wait),
            reading.crank_angle,
            reading.velocity,
            known=prediction.status is not Status.OUT_OF_RANGE,
            sender=self._crank.reader.sender,
        )
        if prediction.status.has_numbers:
            counts.with_numbers += 1
        else:
            counts.without_numbers += 1
        self._report_status(prediction)

    def _publish_windows(self, windows: MessageColumns, answers: _Answers) -> None:
        """Publish the messages of windows that have ended, with the stamps of their readings."""
        messages = [windows.message(row) for row in range(len(windows))]
        for kind in ASSESSED:
            for message in messages:
                self._publish(kind, message, *stamp_and_frame(message), answers)
        for message in messages:
            if self._adviser.is_due(float(message.total_load_ratio), int(message.due_at)):
                advice = self._adviser.answer(message)
                self._publish(ADVICE, advice, *stamp_and_frame(message), answers)
        messages[-1].state = ResonanceState(messages[-1].state)
        self.resonance = messages[-1]  # whole, as the thread of the diagnostics reads it

    def _report_status(self, prediction: Prediction) -> None:
        """Warn of a reading that has no prediction, or one that is sensitive to its error."""
        invalid = prediction.status is Status.INVALID_ANGLE
        problem = ""
        if prediction.status is not Status.OK:
            why = fault(prediction, self.predictor.table.alpha3_range)
            problem = f"{self.input_name}: {why}" + "." * (not why.endswith("?"))
        if invalid:
            problem = f"{problem} {self._crank.reader.note}".rstrip()
        elif problem:
            self._throttle.warn(prediction.status.name, problem)
        self._throttle.report(HITCH, problem if invalid else "")

    def _velocity(self, reading: Reading, stamp: int, needed: bool) -> Rate:
        """Return the velocity of the crank, if needed: as reported, or else as estimated."""
        if reading.velocity == reading.velocity:  # it is not NaN
            return Rate(reading.velocity, 0.0)
        resolution = crank_resolution(reading.stddev, self._angle_stddev)
        estimate = self._motion.add(stamp, reading.crank_angle, resolution)
        return estimate() if needed else UNKNOWN
