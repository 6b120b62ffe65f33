# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Replays bags through the prediction, and writes a log as the node would have done."""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Block, Integers
from linkage_vibration.bags.log_writer import ChunkLog, Messages
from linkage_vibration.bags.recorder import FAULTS_METADATA, PROVENANCE_METADATA, package_versions
from linkage_vibration.bags.scalar_reader import SkippedMessages
from linkage_vibration.bags.streams import Bags, BagTopic, open_bags
from linkage_vibration.bags.writing import Topic
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.encoding import encode_columns, encode_message, stamp_and_frame
from linkage_vibration.messages.topics import (
    ADVICE,
    ASSESSED,
    MEASURED,
    OUTPUT_TOPICS,
    PREDICTION,
    log_topic,
)
from linkage_vibration.playback.readings import JudgedInputs, SpeedRow
from linkage_vibration.playback.remapping import (
    ReplayError,
    bag_paths,
    choose_topics,
    full_name,
    logged_topic,
    topic_schema,
)
from linkage_vibration.prediction.advice import Adviser
from linkage_vibration.prediction.agreement import StandingClock, crank_agreement
from linkage_vibration.prediction.answers import LoadedModel, ModelWithoutTable
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs.presets import HITCH
from linkage_vibration.prediction.inputs.sources import CrankInput
from linkage_vibration.prediction.level_cache import kept_table
from linkage_vibration.prediction.levels import kept_levels
from linkage_vibration.prediction.motion import crank_filter, crank_resolution
from linkage_vibration.prediction.periods import Periods, Stamps, WindowStep, second
from linkage_vibration.prediction.predictor import Predictor, Status, predict_many
from linkage_vibration.prediction.provenance import attachments, implement_facts
from linkage_vibration.prediction.resonance import Header, ReportedSpeed, ResonanceMonitor
from linkage_vibration.prediction.settings import DECLARED, NODE_NAME, Parameters, with_values
from linkage_vibration.readers.excitations import excitation_files
from linkage_vibration.readers.loaded_model import (
    Report,
    built_table,
    load_model,
    read_described,
    read_loads,
    with_other_body,
)
from linkage_vibration.readers.sensors import SensorReader, live_sensors, sensor_files
from linkage_vibration.support.atomic_files import check_outputs, replacement
from linkage_vibration.support.progress import shown_bar

if TYPE_CHECKING:
    from linkage_vibration.listening.live import SensorMonitor

REPLAY_METADATA = "linkage_vibration.replay"
_NAMES = {topic.type: full_name(topic.name) for topic in OUTPUT_TOPICS}
_ANSWERS = MEASURED, PREDICTION, *ASSESSED, ADVICE
"""The types of the answers to a reading, in their order in the log."""
_RANKS = {kind: rank for rank, kind in enumerate(["", *_ANSWERS])}  # "" is that of the reading


@dataclass(frozen=True, slots=True)
class WhatIf:
    """Other values for the only rigid body, the implement; None keeps the mechanism's value.

    Attributes
    ----------
    mass, inertia : float, optional
        kg, and kg m2 about the centre of gravity.
    """

    mass: float | None = None
    inertia: float | None = None


_AS_DESCRIBED = WhatIf()


@dataclass(slots=True)
class Replayed(SkippedMessages):
    """What a replay has done, and how many messages it left out.

    Attributes
    ----------
    topic : str
        The topic of the readings.
    statuses, resonances : list of int, (4,), and int
        How many predictions have each `Status`, and how many resonances were written.
    missing : set of str
        The speeds that no message contains.
    notice : str
        Which amplitudes of the default excitations are not used; empty if all are.
    input_faults : list of str
        A sentence for each fault of the inputs, as the diagnostics of the node have them.
    """

    topic: str = ""
    statuses: list[int] = field(default_factory=lambda: [0] * len(Status))
    resonances: int = 0
    missing: set[str] = field(default_factory=set)
    notice: str = ""
    input_faults: list[str] = field(default_factory=list)

    @property
    def predictions(self) -> int:
        """How many predictions were written."""
        return sum(self.statuses)

    @property
    def with_numbers(self) -> int:
        """How many of them have numbers."""
        return sum(self.statuses[status] for status in Status if status.has_numbers)


def replay_summary(done: Replayed) -> str:
    """Return in words what a replay has done."""
    text = f"{done.predictions} predictions for {done.topic}"
    if done.resonances:
        text += f", {done.resonances} resonances"
    for status in Status:
        if status is not Status.OK and done.statuses[status]:
            text += f"; {done.statuses[status]} are {status.name}"
    if done.others:
        text += f"; {done.others} other messages on this topic"
    for what in sorted(done.missing):
        text += f"; no message contains {what}"
    for what, count in done.unavailable.items():
        text += f"; {count} messages have no value: {what.rstrip('.')}"
    if done.refused or done.unreadable:
        text += f"; {done.refused + done.unreadable} messages were left out: {done.fault}"
    return f"{text.rstrip('.')}. {done.notice}".rstrip()


def problems(done: Replayed) -> list[str]:
    """Return a sentence for each thing that a replay could not do."""
    sentences = list(done.input_faults)
    if missing := done.predictions - done.with_numbers:
        which = "No prediction has" if not done.with_numbers else f"{missing} predictions have no"
        hint = "check the joint, its sign, scale and offset, and the range of the table"
        sentences.append(f"{which} numbers, as the crank angle is out of range or invalid; {hint}.")
    if left_out := done.refused + done.unreadable:
        sentences.append(f"{left_out} messages were left out ({done.fault.rstrip('.')}).")
    return sentences


def replay(
    inputs: str | Path | Sequence[str | Path],
    output: str | Path,
    settings: Parameters | None = None,
    remaps: Mapping[str, str] = MappingProxyType({}),
    what_if: WhatIf = _AS_DESCRIBED,
) -> Replayed:
    """Predict for each reading of the hitch in bags, and write a log.

    A single log of the node is read as it was written, and other bags in the order of log times.
    The log contains the input messages unchanged, a prediction for each reading and, where a speed
    is known, resonances and advice at their rates, at the log times of the readings. The bytes of
    all are those that the node publishes. A bar on a terminal shows the progress.

    Parameters
    ----------
    inputs : str, Path, or sequence of them
        A bag, or several that are read as one.
    output : str or Path
        The MCAP to write; an existing file is replaced.
    settings : Parameters, optional
        The parameters of the node; those of its logs are not used.
    remaps : mapping of str to str
        The bags' names of the node's topics, such as ``{"joint_states": "/arm/joint_states"}``.
    what_if : WhatIf
        Another implement than the mechanism has; the table is then rebuilt.

    Raises
    ------
    ReplayError
        If no bag is given or one twice, if the bags lack a topic or the joint, if a topic is
        ambiguous, or if the log cannot be written. Then no log is left behind.
    OutputError
        If the output is one of the inputs, or its folder cannot be used.
    LinkageVibrationError
        If a parameter, a bag, the mechanism or its table cannot be used.
    """
    bags_given = [inputs] if isinstance(inputs, str | Path) else inputs
    paths, output = [Path(path) for path in bags_given], Path(output)
    if not paths:
        raise ReplayError("No bag was given; give at least one.")
    settings = settings or Parameters()
    settings = with_values(settings, {name: getattr(settings, name) for name in DECLARED})
    _refuse_repeated(paths)
    models = [settings.mechanism_path(), settings.excitation_path(), settings.table_path()]
    models += [settings.implement_path(), settings.sensor_path()]
    check_outputs([output], [*paths, *filter(None, models)])
    with open_bags(paths) as bags:
        topics = choose_topics(bags, settings, remaps)
        served = _loaded_model(settings, what_if)
        run = _Replay(bags, settings, topics, served)
        log_topics = [logged_topic(bags, topic) for topic in run.topics.values()]
        outputs, read = _outputs(run, settings)
        files = attachments(served, settings, f"/{NODE_NAME}", read)
        metadata = {
            PROVENANCE_METADATA: {**package_versions(), **implement_facts(served)},
            REPLAY_METADATA: {"inputs": " ".join(path.name for path in paths)},
        }
        total = sum(topic.count for topic in run.topics.values())
        shown = shown_bar(output, total, " messages")
        with replacement(output, ReplayError) as unfinished, shown as bar:
            with ChunkLog(unfinished, [*log_topics, *outputs], files, metadata) as log:
                for block in bags.blocks(list(run.topics), bags.is_own_log):
                    log.write(run.messages(block))
                    bar.update(len(block))
                faults = run.inputs.judge.faults()
                run.done.input_faults = [fault.sentence for fault in faults]
                numbered = {str(i): json.dumps(asdict(each)) for i, each in enumerate(faults, 1)}
                log.add_metadata(FAULTS_METADATA, numbered)
            _refuse_empty(run.done, bags, run.inputs.crank)
    return run.done


def _outputs(run: "_Replay", settings: Parameters) -> tuple[list[Topic], dict[str, bytes]]:
    """Return the topics that a replay writes, and files that it has read for them, by names."""
    kinds, files = {PREDICTION}, dict[str, bytes]()
    if run.monitor is not None:
        kinds |= {*ASSESSED, ADVICE}
        files |= excitation_files(settings.excitation_path())
    if run.sensors.monitor is not None:
        kinds.add(MEASURED)
        files |= sensor_files(settings.sensor_path())
    topics = [
        log_topic(_NAMES[topic.type], topic.type, latched=topic.latched)
        for topic in OUTPUT_TOPICS
        if topic.type in kinds
    ]
    return topics, files


class _Replay:
    """Turns blocks of messages of ``topics`` into the messages of the log."""

    def __init__(
        self, bags: Bags, settings: Parameters, topics: Mapping[str, BagTopic], served: LoadedModel
    ) -> None:
        self.sensors = _Sensors(bags, settings, served)
        self.topics = {topic.name: topic for topic in (*topics.values(), *self.sensors.topics)}
        self._names = list(self.topics)
        of_table = self._names, served.predictor.table.alpha3_range
        self.inputs = JudgedInputs(bags, settings, topics, *of_table)
        notices: list[str] = []
        self.monitor = _monitor(settings, topics, served, notices.append)
        self._adviser: Adviser | None = None
        self._predictor, self._periods = served.predictor, Periods(settings.prediction_rate)
        self._stamps = Stamps()
        self._motion = crank_filter()
        self._agreement = crank_agreement(self._predictor.table.alpha3_range)
        self._standing = StandingClock()
        missing = {each.reader.what for each in self.inputs.speeds.values()} | self.sensors.missing
        self.done = Replayed(topic=topics[HITCH].name, missing=missing, notice=" ".join(notices))
        self.done.unreadable, self.done.fault = bags.bad_lines, bags.fault

    def messages(self, block: Block) -> list[Messages]:
        """Return the input messages of a block that are used, and what is predicted for them."""
        readings, speeds = self.inputs.read(block, self.done)
        used = [readings.in_block, np.array([speed[0] for speed in speeds], np.int64)]
        known = {source for _, source, *_ in speeds}
        self.done.missing -= {self.inputs.speeds[source].reader.what for source in known}
        messages = [*self.sensors.messages(block, self._names, readings, speeds, used, self.done)]
        if len(readings):
            predictions = predict_many(self._predictor, readings.crank_angle, readings.stddev)
            times = self._stamps.times(readings.stamp, readings.time)
            readings.due_at, readings.timed_by_receipt = times
            messages += self._predictions(block, readings, predictions)
            if self.monitor is not None:
                messages += self._resonances(self.monitor, block, readings, predictions, speeds)
        elif self.monitor is not None:
            for _, source, value, time in speeds:
                self.monitor.set_speed(source, value, time)
        return [*self._inputs(block, used), *messages]

    def _predictions(
        self, block: Block, readings: MessageColumns, predictions: MessageColumns
    ) -> Iterator[Messages]:
        """Yield the predictions that are published, and count their statuses."""
        published = np.flatnonzero(self._periods.due(readings.due_at))
        predictions = predictions.rows(published)
        counts = np.bincount(predictions.status, minlength=len(Status))
        self.done.statuses = (self.done.statuses + counts).tolist()
        yield from _encoded(PREDICTION, predictions, block, readings.rows(published))

    def _inputs(self, block: Block, used: Sequence[Integers]) -> Iterator[Messages]:
        """Yield the messages of a block that were used, those of one topic and size together."""
        rows = np.unique(np.concatenate(used)) if used else np.zeros(0, np.int64)
        for topic, name in enumerate(self._names):
            of_topic = rows[block.topics[rows] == topic]
            sizes = block.sizes[of_topic]
            for size in np.unique(sizes).tolist():
                same = of_topic[sizes == size]
                data = sliding_window_view(block.buffer, size)[block.starts[same]]
                times = block.log_times[same], block.publish_times[same]
                yield Messages(name, data, len(_RANKS) * same, *times)

    def _resonances(
        self,
        monitor: ResonanceMonitor,
        block: Block,
        readings: MessageColumns,
        predictions: MessageColumns,
        speeds: Sequence[SpeedRow],
    ) -> Iterator[Messages]:
        """Assess predictions, with the speeds that were received among them."""
        self._adviser = self._adviser or Adviser(monitor)
        before = np.searchsorted(readings.in_block, [speed[0] for speed in speeds])
        # There is nothing to assess before the first speed.
        first = 0 if monitor.any_speed_reported else min([len(readings), *before.tolist()])
        readings.step = np.zeros(len(readings), np.int64)
        readings.step[first:] = [*map(monitor.windows.step, readings.due_at[first:].tolist())]
        due = readings.step != WindowStep.LEFT_OUT
        velocity, error = self._velocities(readings, due)
        earlier = np.searchsorted(np.flatnonzero(due), before).tolist()
        assessed = readings.rows(due)
        assessed.frame_id = np.full(len(assessed), assessed.frame_id, object)
        resonances = monitor.assess_many(
            self._agreed(readings, predictions).rows(due),
            velocity,
            assessed.time,
            [ReportedSpeed(n, *speed[1:]) for n, speed in zip(earlier, speeds, strict=True)],
            error,
            MessageColumns(**{name: getattr(assessed, name) for name in Header._fields}),
        )
        resonances.in_block = assessed.in_block[resonances.ends_at]
        self.done.resonances += len(resonances)
        # Messages with the same reading keep their order, whatever texts they have.
        nth = np.arange(len(resonances)) - np.searchsorted(resonances.in_block, resonances.in_block)
        for n in np.unique(nth):
            messages = resonances.rows(nth == n)
            for kind in ASSESSED:
                yield from _encoded(kind, messages, block, messages)
        ratios_at = resonances.total_load_ratio.tolist(), resonances.due_at.tolist()
        for i, ratio_at in enumerate(zip(*ratios_at, strict=True)):
            if self._adviser.is_due(*ratio_at):
                message = resonances.message(i)
                advice, row = self._adviser.answer(message), int(message.in_block)
                yield _single(ADVICE, advice, block, row, *stamp_and_frame(message))

    def _agreed(self, readings: MessageColumns, predictions: MessageColumns) -> MessageColumns:
        """Return predictions without those of doubted angles, or while the clock stands."""
        times, angles = readings.due_at.tolist(), readings.crank_angle.tolist()
        moments = readings.time.tolist(), readings.stamp.tolist()
        lost = np.array([*map(self._agreement.loses, times, angles)], np.bool_)
        lost |= np.array([*map(self._standing.stands, *moments)], np.bool_)
        if not lost.any():
            return predictions
        known = np.where(lost, math.nan, readings.crank_angle)
        return predict_many(self._predictor, known, readings.stddev)

    def _velocities(
        self, readings: MessageColumns, due: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return velocities of readings that are due, reported or estimated, and their errors."""
        velocity, error = readings.velocity.copy(), np.zeros(len(readings))
        unknown = np.flatnonzero(np.isnan(velocity))
        if len(unknown):
            moving, known_part = readings.rows(unknown), self.inputs.crank.scale.angle_stddev
            velocity[unknown], error[unknown] = self._motion.add_many(
                moving.stamp.tolist(),
                moving.crank_angle.tolist(),
                [crank_resolution(stddev, known_part) for stddev in moving.stddev.tolist()],
                due[unknown].tolist(),
            )
        return velocity[due], error[due]


class _Sensors:
    """The sensors of the parameters, and what they measure; ``missing`` topics are absent."""

    def __init__(self, bags: Bags, settings: Parameters, served: LoadedModel) -> None:
        path = settings.sensor_path()
        every = live_sensors(path) if path else []
        present = {topic.name: topic for topic in bags.topics if topic.count}
        every_pair = [(sensor, present.get(full_name(sensor.topic))) for sensor in every]
        pairs = [(sensor, topic) for sensor, topic in every_pair if topic is not None]
        self.missing = {sensor.topic for sensor, topic in every_pair if topic is None}
        self.topics = [topic for _, topic in pairs]
        self._readers = [SensorReader(s, t.type, topic_schema(bags, t)) for s, t in pairs]
        self.monitor: SensorMonitor | None = None
        if pairs:
            from linkage_vibration.listening.live import sensor_monitor

            excitations = read_loads(settings, served)
            self.monitor = sensor_monitor([s for s, _ in pairs], served, excitations, settings)

    def messages(
        self,
        block: Block,
        names: Sequence[str],
        readings: MessageColumns,
        speeds: Sequence[SpeedRow],
        used: list[Integers],
        left_out: SkippedMessages,
    ) -> Iterator[Messages]:
        """Yield what sensors measure, after speeds and before angles, and add rows to used ones."""
        monitor = self.monitor
        if monitor is None:
            return
        events: list[tuple[int, int, Callable[[], MessageColumns | None], int, str]] = []
        for row, source, value, time in speeds:
            events.append((row, 0, partial(monitor.set_speed, source, value, time), 0, ""))
        for i, (reader, topic) in enumerate(zip(self._readers, self.topics, strict=True)):
            of_topic = np.flatnonzero(block.topics == names.index(topic.name))
            for rows, stamps, values, frame in reader.read(block, of_topic, left_out):
                used.append(rows)
                columns = rows.tolist(), stamps.tolist(), map(tuple, values.tolist())
                for row, stamp, sample in zip(*columns, strict=True):
                    take = partial(monitor.take, i, stamp, sample)
                    events.append((row, 1, take, second(stamp), frame))
        angles = (readings.in_block, readings.stamp, readings.crank_angle)
        for row, stamp, angle in zip(*(column.tolist() for column in angles), strict=True):
            events.append((row, 2, partial(monitor.set_angle, angle, stamp), 0, ""))
        for row, _, event, stamp, frame in sorted(events, key=lambda event: event[:2]):
            if (message := event()) is not None:
                yield _single(MEASURED, message, block, row, *divmod(stamp, 10**9), frame)


def _encoded(
    kind: str, answers: MessageColumns, block: Block, readings: MessageColumns
) -> Iterator[Messages]:
    """Yield the answers to readings as messages of the log."""
    header = readings.sec, readings.nanosec, readings.frame_id
    for which, data in encode_columns(kind, answers, *header):
        yield _messages(kind, data, block, readings.in_block[which])


def _single(
    kind: str, answer: MessageColumns, block: Block, row: int, sec: int, nanosec: int, frame: str
) -> Messages:
    """Return the answer to the message in a row of a block as a message of the log."""
    data = np.frombuffer(encode_message(kind, answer, sec, nanosec, frame), np.uint8)
    return _messages(kind, data[np.newaxis], block, np.array([row]))


def _messages(kind: str, data: NDArray[np.uint8], block: Block, rows: Integers) -> Messages:
    """Return the answers to the messages in some rows of a block as messages of the log."""
    times, ranks = block.log_times[rows], len(_RANKS) * rows + _RANKS[kind]
    return Messages(_NAMES[kind], data, ranks, times, times)


def _loaded_model(settings: Parameters, what_if: WhatIf) -> LoadedModel:
    """Return the mechanism and its table, which is built for another implement."""
    if what_if == _AS_DESCRIBED:
        return load_model(settings, keep=kept_table)
    described, path = read_described(settings), settings.mechanism_path()
    changed, text = with_other_body(described, path, mass=what_if.mass, inertia=what_if.inertia)
    table = kept_table(changed, partial(built_table, LinkageModel(changed)))
    return ModelWithoutTable(changed, text).with_predictor(Predictor(table))


def _refuse_repeated(paths: Sequence[Path]) -> None:
    """Refuse a file that is given twice, by itself or within the folder of a bag."""
    earlier: dict[tuple[int, int], Path] = {}
    for path in paths:
        for file in path.iterdir() if path.is_dir() else [path]:
            if file.exists():
                key = file.stat().st_dev, file.stat().st_ino
                if key in earlier:
                    raise ReplayError(f"{path} and {earlier[key]} are one bag; give each bag once.")
                earlier[key] = path


def _refuse_empty(done: Replayed, bags: Bags, read: CrankInput) -> None:
    """Refuse a log without predictions, and explain why there are none."""
    if done.predictions:
        return
    if done.names:
        missing = read.reader.explain_missing(done.topic, sorted(done.names))
        raise ReplayError(f"{bag_paths(bags)}: {missing}")
    problem = f"has no reading of the hitch on {done.topic} that can be used"
    reason = done.fault or "its messages name no joints"
    raise ReplayError(f"{bag_paths(bags)} {problem}: {reason}")


def _monitor(
    settings: Parameters, topics: Mapping[str, BagTopic], served: LoadedModel, report: Report
) -> ResonanceMonitor | None:
    """Return a monitor of resonance, None if no speed is known; `report` may get a sentence."""
    fixed = {source: settings.fixed_speed(source) for source in Source}
    if set(fixed.values()) == {None} and topics.keys() == {HITCH}:
        return None
    excitations = read_loads(settings, served, report)
    levels = kept_levels(served.predictor, served.mechanism, excitations)
    rules = settings.warning_limits(), settings.stale_after, levels, settings.resonance_rate
    monitor = ResonanceMonitor(excitations, *rules)
    for source, speed in fixed.items():
        monitor.set_fixed(source, speed)
    return monitor
