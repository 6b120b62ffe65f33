# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Replays bags through the prediction, and writes a log as the node would have."""

import struct
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.chunks import ChunkLog, Messages
from linkage_vibration.bags.joint_states import JointStateReader
from linkage_vibration.bags.message_types import FLOAT64
from linkage_vibration.bags.recorder import PROVENANCE_METADATA, package_versions
from linkage_vibration.bags.streams import Bags, BagTopic, Block, open_bags
from linkage_vibration.messages.encoding import encode_predictions, encode_resonances
from linkage_vibration.messages.provenance import attachments
from linkage_vibration.messages.topics import (
    PREDICTION,
    PREDICTION_TOPIC,
    RESONANCE,
    RESONANCE_TOPIC,
    SPEEDS,
    log_topic,
)
from linkage_vibration.playback.remapping import ReplayError, choose_topics, told
from linkage_vibration.playback.what_if import AS_DESCRIBED, WhatIf, served_model
from linkage_vibration.prediction.batch import Predictions, predict_many
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs import JointInput, PercentInput, Reading, ReadingError
from linkage_vibration.prediction.predictor import Predictor, Status
from linkage_vibration.prediction.resonance import ReportedSpeed, ResonanceMonitor
from linkage_vibration.prediction.settings import NODE_NAME, Parameters
from linkage_vibration.readers.excitations import read_excitations

FloatArray = NDArray[np.float64]
Integers = NDArray[np.int64]

REPLAY_METADATA = "linkage_vibration.replay"
_PLACES = 4  # of a row of a block: an input, then its prediction, then the resonance
_MAX_NAMES_TOLD = 20


@dataclass(slots=True)
class Replayed:
    """What a replay has done.

    Attributes
    ----------
    topic : str
        Where the readings came from.
    statuses : list of int, (4,)
        How many predictions have each `Status`.
    resonances : int
        How many resonances were written.
    others : int
        Joint states about other joints alone, which are left out, as the next two are.
    unreadable : int
        Messages that are no valid CDR.
    refused : int
        Joint states that give the joint no trustworthy position.
    fault : str
        Why the first of these was left out.
    joints : set of str
        Joints that were seen while the right one was not, some of them.
    """

    topic: str
    statuses: list[int] = field(default_factory=lambda: [0] * len(Status))
    resonances: int = 0
    others: int = 0
    unreadable: int = 0
    refused: int = 0
    fault: str = ""
    joints: set[str] = field(default_factory=set)

    @property
    def predictions(self) -> int:
        """How many predictions were written."""
        return sum(self.statuses)


@dataclass(frozen=True, slots=True, eq=False)
class _Readings:
    """Readings of messages that are alike, by columns."""

    rows: Integers
    data: NDArray[np.uint8]
    crank_angle: FloatArray
    velocity: FloatArray
    stddev: FloatArray
    sec: NDArray[np.int32]
    nanosec: NDArray[np.uint32]
    frame_id: str


def summary(done: Replayed) -> str:
    """Return in words what a replay has done."""
    told = f"{done.predictions} predictions for {done.topic}"
    if done.resonances:
        told += f", {done.resonances} resonances"
    for status in Status:
        if status is not Status.OK and done.statuses[status]:
            told += f"; {done.statuses[status]} are {status.name}"
    if done.others:
        told += f"; {done.others} joint states are about other joints"
    if done.refused or done.unreadable:
        told += f"; {done.refused + done.unreadable} messages were left out: {done.fault}"
    return told.rstrip(".") + "."


def replay(
    inputs: Sequence[str | Path],
    output: str | Path,
    settings: Parameters | None = None,
    remaps: Mapping[str, str] = MappingProxyType({}),
    what_if: WhatIf = AS_DESCRIBED,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Replayed:
    """Predict for each reading of the hitch in bags, and write a log.

    The log has what came in as it came, a prediction for each reading and, where a speed is known,
    a resonance, at the log times of the readings. The bytes of predictions are those that the node
    publishes.

    Parameters
    ----------
    inputs : sequence of str or Path
        Bags that are read as one.
    output : str or Path
        The MCAP to write; replaced when it exists.
    settings : Parameters, optional
        As the node's; those that concern its logs and pictures are not used.
    remaps : mapping of str to str
        The bags' names of the node's topics, as ``{"joint_states": "/arm/joint_states"}``.
    what_if : WhatIf
        Another implement than the mechanism has; the table is then built anew.
    progress : callable
        Called with the number of messages that are done, and of all.

    Raises
    ------
    LinkageVibrationError
        If a bag cannot be read, does not hold the joint, or leaves open which topic to use; if the
        mechanism or its table cannot be used; if the log cannot be written. Then there is no log.
    """
    bag_paths, output = [Path(path) for path in inputs], Path(output)
    settings = settings or Parameters()
    if any(path.exists() and output.exists() and path.samefile(output) for path in bag_paths):
        raise ReplayError(f"{output} is one of the bags to replay; give another --output.")
    with open_bags(bag_paths) as bags:
        topics = choose_topics(bags, settings, remaps)
        served = served_model(settings, what_if)
        log_topics = [log_topic(topic.name, topic.type) for topic in topics.values()]
        log_topics.append(log_topic(PREDICTION_TOPIC, PREDICTION))
        monitor = _monitor(settings, topics)
        excitations = None
        if monitor is not None:
            log_topics.append(log_topic(RESONANCE_TOPIC, RESONANCE))
            excitations = settings.excitation_path().read_bytes().decode()
        files = attachments(served, settings, f"/{NODE_NAME}", excitations)
        metadata = {
            PROVENANCE_METADATA: package_versions(),
            REPLAY_METADATA: {"inputs": " ".join(path.name for path in bag_paths)},
        }
        run = _Replay(settings, topics, served.predictor, monitor)
        total, done = sum(topic.count for topic in topics.values()), 0
        try:
            with tempfile.TemporaryDirectory(dir=output.absolute().parent) as folder:
                unfinished = Path(folder) / output.name
                with ChunkLog(unfinished, log_topics, files, metadata) as log:
                    for block in bags.blocks([topic.name for topic in topics.values()]):
                        log.write(run.messages(block))
                        done += len(block)
                        progress(done, total)
                _refuse_nothing(run.done, bags, settings)
                unfinished.replace(output)
        except OSError as error:
            raise ReplayError(
                f"{output} could not be written: {error.strerror or error}; give a folder that "
                "exists, can be written to, and has room."
            ) from None
    return run.done


class _Replay:
    """Turns blocks of what came in into messages of the log."""

    def __init__(
        self,
        settings: Parameters,
        topics: Mapping[str, BagTopic],
        predictor: Predictor,
        monitor: ResonanceMonitor | None,
    ) -> None:
        self._names = [topic.name for topic in topics.values()]
        self._sources = [SPEEDS.get(name) for name in topics]
        self._predictor = predictor
        self._monitor = monitor
        self._reader = JointStateReader()
        rule = settings.crank_input()
        self._joint = rule if isinstance(rule, JointInput) else None
        self._percent = rule if isinstance(rule, PercentInput) else None
        self.done = Replayed(self._names[0])

    def messages(self, block: Block) -> list[Messages]:
        """Return what a block's messages become, themselves included."""
        found: list[Messages] = []
        readings = list(self._readings(block, np.flatnonzero(block.topics == 0)))
        predicted: list[Predictions] = []
        for some in readings:
            log_times = block.log_times[some.rows]
            sent = block.publish_times[some.rows]
            predictions = predict_many(self._predictor, some.crank_angle, some.stddev)
            predicted.append(predictions)
            encoded = encode_predictions(predictions, some.sec, some.nanosec, some.frame_id)
            place = _PLACES * some.rows
            found.append(Messages(self._names[0], some.data, place, log_times, sent))
            found.append(Messages(PREDICTION_TOPIC, encoded, place + 1, log_times, log_times))
            counts = np.bincount(predictions.status, minlength=len(Status))
            for status, count in enumerate(counts.tolist()):
                self.done.statuses[status] += count
        if self._monitor is not None:
            found += self._resonances(block, readings, predicted)
        return found

    def _readings(self, block: Block, rows: Integers) -> Iterator[_Readings]:
        if self._percent is not None:
            yield from self._percent_readings(block, rows)
            return
        assert self._joint is not None
        for states in self._reader.read(block, rows):
            try:
                # Columns of numbers in the place of numbers: what is done to them is the same.
                reading = self._joint.reading(cast(Any, states))
            except ReadingError as error:
                self.done.refused += len(states.rows)
                self.done.fault = self.done.fault or str(error)
                continue
            if reading is None:
                self.done.others += len(states.rows)
                self.done.joints.update(states.name[:_MAX_NAMES_TOLD])
                continue
            angle, velocity, stddev = (
                np.broadcast_to(value, len(states.rows)) for value in _values(reading)
            )
            header = states.sec, states.nanosec, states.frame_id
            yield _Readings(states.rows, states.data, angle, velocity, stddev, *header)
        self.done.unreadable += self._reader.unreadable
        self.done.fault = self.done.fault or self._reader.fault
        self._reader.unreadable = 0

    def _percent_readings(self, block: Block, rows: Integers) -> Iterator[_Readings]:
        assert self._percent is not None
        for alike, data, values in self._floats(block, rows):
            columns = [_values(self._percent.reading(value)) for value in values]
            # The message has no header: its time is when it came.
            sec, nanosec = np.divmod(block.log_times[alike], 10**9)
            header = sec.astype(np.int32), nanosec.astype(np.uint32), ""
            angle, velocity, stddev = np.array(columns).T.copy()
            yield _Readings(alike, data, angle, velocity, stddev, *header)

    def _floats(
        self, block: Block, rows: Integers
    ) -> Iterator[tuple[Integers, NDArray[np.uint8], list[float]]]:
        """Yield rows of ``std_msgs/Float64``, their bytes and what they hold, by their sizes."""
        sizes = block.sizes[rows]
        for size in np.unique(sizes):
            alike: list[int] = []
            values: list[float] = []
            for row in rows[sizes == size].tolist():
                data = block.message(row)
                if size < 12 or data[0] != 0 or data[1] > 1:
                    self.done.unreadable += 1
                    self.done.fault = self.done.fault or f"{size} bytes that are no {FLOAT64}"
                    continue
                alike.append(row)
                values += struct.unpack_from("<d" if data[1] else ">d", data, 4)
            if alike:
                joined = b"".join(map(block.message, alike))
                yield np.array(alike), np.frombuffer(joined, np.uint8).reshape(-1, size), values

    def _resonances(
        self, block: Block, readings: Sequence[_Readings], predicted: Sequence[Predictions]
    ) -> list[Messages]:
        """Assess predictions, with the speeds that come among them."""
        assert self._monitor is not None
        found: list[Messages] = []
        speeds: list[tuple[int, Source, float]] = []
        for topic, source in enumerate(self._sources):
            if source is not None:
                of_topic = np.flatnonzero(block.topics == topic)
                for rows, data, values in self._floats(block, of_topic):
                    times = block.log_times[rows], block.publish_times[rows]
                    found.append(Messages(self._names[topic], data, _PLACES * rows, *times))
                    of_block = zip(rows.tolist(), values, strict=True)
                    speeds += [(row, source, value) for row, value in of_block]
        speeds.sort()  # by rows
        if not readings:
            for row, source, value in speeds:
                self._monitor.set_speed(source, value, int(block.log_times[row]))
            return found
        rows = np.concatenate([some.rows for some in readings])
        order = np.argsort(rows)
        before = np.searchsorted(rows[order], [row for row, _, _ in speeds]).tolist()
        # Until a speed is told there is nothing to assess.
        first = 0 if self._monitor.any_speed_reported else min([len(rows), *before])
        asked = order[first:]
        resonances = self._monitor.assess_many(
            np.concatenate([some.natural_frequencies for some in predicted])[asked],
            np.concatenate([some.frequency_slopes for some in predicted])[asked],
            np.concatenate([some.velocity for some in readings])[asked],
            block.log_times[rows[asked]],
            [
                ReportedSpeed(earlier - first, source, value, int(block.log_times[row]))
                for earlier, (row, source, value) in zip(before, speeds, strict=True)
            ],
        )
        answers = np.argsort(order) - first
        for some in readings:
            answer, answers = np.split(answers, [len(some.rows)])
            kept = np.flatnonzero(answer >= 0)
            for which, data in encode_resonances(
                resonances.rows(answer[kept]),
                self._monitor.excitations,
                predicted[0].table_id,
                some.sec[kept],
                some.nanosec[kept],
                some.frame_id,
            ):
                rows = some.rows[kept[which]]
                times = block.log_times[rows], block.log_times[rows]
                found.append(Messages(RESONANCE_TOPIC, data, _PLACES * rows + 2, *times))
                self.done.resonances += len(rows)
        return found


def _values(reading: Reading) -> tuple[Any, Any, Any]:
    return reading.crank_angle, reading.velocity, reading.stddev


def _refuse_nothing(done: Replayed, bags: Bags, settings: Parameters) -> None:
    """Refuse a log without predictions, and tell why there are none."""
    if done.predictions:
        return
    if done.joints:
        names = ", ".join(sorted(done.joints)[:_MAX_NAMES_TOLD])
        raise ReplayError(
            f"{told(bags)} has no joint {settings.joint_name} on {done.topic}; it has {names}. "
            "Name one of them with --joint."
        )
    raise ReplayError(
        f"{told(bags)} has no reading of the hitch on {done.topic} that can be used: "
        f"{done.fault or 'its messages name no joints'}"
    )


def _monitor(settings: Parameters, topics: Mapping[str, BagTopic]) -> ResonanceMonitor | None:
    """Return what watches for resonance; None where no speed is known."""
    fixed = {s: speed for s in Source if (speed := settings.fixed_speed(s)) is not None}
    if not fixed and not topics.keys() & SPEEDS.keys():
        return None
    limits = settings.warning_margin, settings.hysteresis, settings.stale_after
    monitor = ResonanceMonitor(read_excitations(settings.excitation_path()), *limits)
    for source, speed in fixed.items():
        monitor.set_fixed(source, speed)
    return monitor
