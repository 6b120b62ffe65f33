# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Replays bags through the prediction, and writes a log as the node would have."""

import math
import struct
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np
import yaml
from numpy.typing import NDArray

import linkage_vibration
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.excitation import ResonanceMonitor, Source
from linkage_vibration.inputs import JointInput, PercentInput, Reading, ReadingError
from linkage_vibration.logs.batches import Predictions, encode_predictions, predict_many
from linkage_vibration.logs.chunks import ChunkLog, Messages
from linkage_vibration.logs.definitions import message_definition, type_hash
from linkage_vibration.logs.recorder import PROVENANCE_METADATA, package_versions
from linkage_vibration.logs.recording import QUEUE_DEPTH, Attachment, Topic, offered_qos_profiles
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages import encode_resonance
from linkage_vibration.prediction import Predictor, Status
from linkage_vibration.readers.bags import JOINT_STATE
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.joint_states import JointStateReader
from linkage_vibration.readers.mechanism import load_yaml, read_mechanism
from linkage_vibration.readers.streams import Bags, BagTopic, Block, open_bags
from linkage_vibration.resources import (
    DEFAULT_EXCITATIONS,
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    config_file,
)
from linkage_vibration.serving import Implement, with_implement
from linkage_vibration.table import Table, load_table, table_bytes
from linkage_vibration.tabulation import build_table

FloatArray = NDArray[np.float64]
Integers = NDArray[np.int64]

FLOAT64 = "std_msgs/msg/Float64"
PREDICTION = "linkage_vibration_interfaces/msg/VibrationPrediction"
RESONANCE = "linkage_vibration_interfaces/msg/Resonance"
PREDICTION_TOPIC = "/linkage_vibration/prediction"
RESONANCE_TOPIC = "/linkage_vibration/resonance"
REPLAY_METADATA = "linkage_vibration.replay"
JOINT_STATES, PERCENT = "joint_states", "hitch_position"
SPEEDS = {"engine_speed": Source.ENGINE, "pto_speed": Source.PTO, "ground_speed": Source.GROUND}
"""The node's names of its topics, which bags may have others for."""

_NODE_NAMES = ("/**", "linkage_vibration", "/linkage_vibration")
_PLACES = 4  # of a row of a block: an input, then its prediction, then the resonance
_MAX_NAMES_TOLD = 20


class ReplayError(LinkageVibrationError):
    """A replay cannot be done as asked."""


@dataclass(frozen=True, slots=True)
class Settings:
    """What the node would have been told; its parameters of these names tell the meanings."""

    input: str = "joint_state"
    joint_name: str = "hitch_rockshaft_joint"
    sign: int = 1
    scale: float = 1.0
    offset: float = 0.0
    percent_points: tuple[float, ...] = (0.0, 100.0)
    percent_angles: tuple[float, ...] = (3.14159, 1.5708)
    angle_stddev: float = 0.0
    excitation_file: str = ""
    engine_speed: float = -1.0
    pto_speed: float = -1.0
    ground_speed: float = -1.0
    warning_margin: float = 0.1
    hysteresis: float = 0.02
    stale_after: float = 1.0
    mechanism_file: str = ""
    table_file: str = ""

    def with_values(self, values: Mapping[str, Any], where: str) -> "Settings":
        """Return settings with some values changed; names that are none of theirs are passed over.

        Raises
        ------
        ReplayError
            If a value has another type than it must, or is not valid.
        """
        known = {setting.name: setting.default for setting in fields(self)}
        changed = replace(
            self,
            **{
                name: _typed(value, known[name], f"{where}: {name}")
                for name, value in values.items()
                if name in known
            },
        )
        for name, valid, words in (
            ("input", changed.input in ("joint_state", "percent"), "joint_state or percent"),
            ("sign", changed.sign in (1, -1), "1 or -1"),
            ("scale", 0.0 < changed.scale < math.inf, "a finite number greater than 0"),
            ("offset", math.isfinite(changed.offset), "a finite number"),
            ("angle_stddev", 0.0 <= changed.angle_stddev < math.inf, "a finite number from 0 up"),
            ("warning_margin", changed.warning_margin > 0.0, "a number greater than 0"),
            ("hysteresis", changed.hysteresis >= 0.0, "a number from 0 up"),
            ("stale_after", changed.stale_after > 0.0, "a number greater than 0"),
        ):
            if not valid:
                raise ReplayError(f"{where}: {name} must be {words}, not {getattr(changed, name)}.")
        return changed


@dataclass(frozen=True, slots=True)
class WhatIf:
    """Other numbers of the only rigid body, the implement; None leaves one as it is.

    Attributes
    ----------
    mass, inertia : float, optional
        kg, and kg m2 about the centre of gravity.
    """

    mass: float | None = None
    inertia: float | None = None


AS_IT_IS = WhatIf()


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


def remappings(words: Sequence[str]) -> dict[str, str]:
    """Return what ``NAME:=TOPIC`` words mean.

    Raises
    ------
    ReplayError
        If a word is none.

    Examples
    --------
    >>> remappings(["joint_states:=/arm/joint_states"])
    {'joint_states': '/arm/joint_states'}
    """
    for word in words:
        if ":=" not in word.strip(":="):
            raise ReplayError(f"--remap {word}: write NAME:=TOPIC.")
    return {name: topic for name, topic in (word.split(":=", 1) for word in words)}


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


def read_settings(path: Path) -> Settings:
    """Read a file of the node's parameters, as ``--params-file`` takes it.

    Raises
    ------
    ReplayError
        If it cannot be read, has no parameters for the node, or has one that is not valid.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        told = " ".join(str(error).split())
        raise ReplayError(f"{path} cannot be read as YAML: {told}.") from None
    nodes = content if isinstance(content, dict) else {}
    found = [nodes[name] for name in _NODE_NAMES if name in nodes]
    settings = Settings()
    for node in found:
        values = node.get("ros__parameters") if isinstance(node, dict) else None
        if isinstance(values, dict):
            settings = settings.with_values(values, str(path))
    if not found:
        raise ReplayError(
            f"{path} has no parameters for the node; give them below "
            f"`{_NODE_NAMES[1]}:` or `/**:` and there `ros__parameters:`."
        )
    return settings


def replay(
    inputs: Sequence[Path],
    output: Path,
    settings: Settings,
    remaps: Mapping[str, str] = MappingProxyType({}),
    what_if: WhatIf = AS_IT_IS,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Replayed:
    """Predict for each reading of the hitch in bags, and write a log.

    The log has what came in as it came, a prediction for each reading and, where a speed is known,
    a resonance, at the log times of the readings. The bytes of predictions are those that the node
    publishes.

    Parameters
    ----------
    inputs : sequence of Path
        Bags that are read as one.
    output : Path
        The MCAP to write; replaced when it exists.
    settings : Settings
        As the node's parameters.
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
    if any(path.exists() and output.exists() and path.samefile(output) for path in inputs):
        raise ReplayError(f"{output} is one of the bags to replay; give another --output.")
    with open_bags(inputs) as bags:
        topics = _choose_topics(bags, settings, remaps)
        mechanism_text, table = _model(settings, what_if)
        log_topics = [_topic(topic.name, topic.type) for topic in topics.values()]
        log_topics.append(_topic(PREDICTION_TOPIC, PREDICTION))
        predictor, monitor = Predictor(table), _monitor(settings, topics)
        if monitor is not None:
            log_topics.append(_topic(RESONANCE_TOPIC, RESONANCE))
        attachments = [
            Attachment("mechanism.yaml", "application/yaml", mechanism_text.encode()),
            Attachment(f"{table.table_id}.npz", "application/x-npz", table_bytes(table)),
            Attachment("parameters.yaml", "application/yaml", _parameters(settings).encode()),
        ]
        if monitor is not None:
            excitations = _excitation_path(settings).read_bytes()
            attachments.append(Attachment("excitations.yaml", "application/yaml", excitations))
        metadata = {
            PROVENANCE_METADATA: package_versions(),
            REPLAY_METADATA: {"inputs": " ".join(path.name for path in inputs)},
        }
        run = _Replay(settings, topics, predictor, monitor)
        total, done = sum(topic.count for topic in topics.values()), 0
        try:
            with tempfile.TemporaryDirectory(dir=output.absolute().parent) as folder:
                unfinished = Path(folder) / output.name
                with ChunkLog(unfinished, log_topics, attachments, metadata) as log:
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
        settings: Settings,
        topics: Mapping[str, BagTopic],
        predictor: Predictor,
        monitor: ResonanceMonitor | None,
    ) -> None:
        self._names = [topic.name for topic in topics.values()]
        self._sources = [SPEEDS.get(name) for name in topics]
        self._predictor = predictor
        self._monitor = monitor
        self._reader = JointStateReader()
        self._joint, self._percent = _inputs(settings)
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
        """Assess predictions and speeds one by one, as each depends on what came before."""
        assert self._monitor is not None
        found: list[Messages] = []
        speeds: dict[int, tuple[Source, float]] = {}
        for topic, source in enumerate(self._sources):
            if source is not None:
                of_topic = np.flatnonzero(block.topics == topic)
                for rows, data, values in self._floats(block, of_topic):
                    times = block.log_times[rows], block.publish_times[rows]
                    found.append(Messages(self._names[topic], data, _PLACES * rows, *times))
                    speeds.update(
                        (row, (source, v)) for row, v in zip(rows.tolist(), values, strict=True)
                    )
        asked = {
            row: (group, i)
            for group, some in enumerate(readings)
            for i, row in enumerate(some.rows.tolist())
        }
        by_size: dict[int, list[tuple[int, bytes]]] = {}
        for row in sorted(speeds.keys() | asked.keys()):
            time = int(block.log_times[row])
            if row in speeds:
                self._monitor.set_speed(*speeds[row], time)
                continue
            if not self._monitor.speeds_told:
                continue
            group, i = asked[row]
            some = readings[group]
            prediction, velocity = predicted[group].row(i), float(some.velocity[i])
            resonance = self._monitor.assess(prediction, velocity, time)
            stamp = int(some.sec[i]), int(some.nanosec[i])
            encoded = encode_resonance(resonance, *stamp, some.frame_id)
            by_size.setdefault(len(encoded), []).append((row, encoded))
        for size, entries in by_size.items():
            rows = np.array([row for row, _ in entries])
            joined = np.frombuffer(b"".join(encoded for _, encoded in entries), np.uint8)
            data, log_times = joined.reshape(-1, size), block.log_times[rows]
            place = _PLACES * rows + 2
            found.append(Messages(RESONANCE_TOPIC, data, place, log_times, log_times))
            self.done.resonances += len(entries)
        return found


def _values(reading: Reading) -> tuple[Any, Any, Any]:
    return reading.crank_angle, reading.velocity, reading.stddev


def _choose_topics(
    bags: Bags, settings: Settings, remaps: Mapping[str, str]
) -> dict[str, BagTopic]:
    """Return the topics to read by the node's names of them, that of the hitch first."""
    unknown = set(remaps) - {JOINT_STATES, PERCENT, *SPEEDS}
    if unknown:
        raise ReplayError(
            f"--remap: {sorted(unknown)[0]} is none of {JOINT_STATES}, {PERCENT}, "
            f"{', '.join(SPEEDS)}."
        )
    hitch, kind = (PERCENT, FLOAT64) if settings.input == "percent" else (JOINT_STATES, JOINT_STATE)
    chosen = remaps.get(hitch)
    if chosen is None and kind == JOINT_STATE:
        named = sorted({topic.name for topic in bags.topics if topic.type == JOINT_STATE})
        if len(named) > 1:
            raise ReplayError(
                f"{_told(bags)} has joint states on {len(named)} topics; choose one, as in "
                f"`--remap {JOINT_STATES}:={named[0]}`: {', '.join(named)}."
            )
        chosen = named[0] if named else None
    topics = {hitch: _bag_topic(bags, chosen or f"/{hitch}", kind, hitch)}
    for name in SPEEDS:
        if getattr(settings, name) >= 0.0:
            continue
        wanted = remaps.get(name)
        # A log has the node's topics, whether anything was sent on them or not.
        if wanted or any(topic.name == f"/{name}" and topic.count for topic in bags.topics):
            topics[name] = _bag_topic(bags, wanted or f"/{name}", FLOAT64, name)
    return topics


def _bag_topic(bags: Bags, name: str, kind: str, meant: str) -> BagTopic:
    """Return a topic of the bags, which has to be of a type."""
    found = [topic for topic in bags.topics if topic.name == name]
    listing = ", ".join(f"{topic.name} ({topic.type})" for topic in bags.topics)
    remedy = f"name the right one with `--remap {meant}:=TOPIC`"
    if not found:
        raise ReplayError(
            f"{_told(bags)} has no topic {name} of {kind}; it has {listing or 'no topics at all'}"
            + (f"; {remedy}." if listing else ".")
        )
    if [topic.type for topic in found] != [kind]:
        types = " and ".join(topic.type for topic in found)
        raise ReplayError(f"Topic {name} of {_told(bags)} holds {types}, not {kind}; {remedy}.")
    if not found[0].count:
        raise ReplayError(f"Topic {name} of {_told(bags)} has no messages; {remedy}.")
    return found[0]


def _told(bags: Bags) -> str:
    return ", ".join(map(str, bags.paths))


def _refuse_nothing(done: Replayed, bags: Bags, settings: Settings) -> None:
    """Refuse a log without predictions, and tell why there are none."""
    if done.predictions:
        return
    if done.joints:
        names = ", ".join(sorted(done.joints)[:_MAX_NAMES_TOLD])
        raise ReplayError(
            f"{_told(bags)} has no joint {settings.joint_name} on {done.topic}; it has {names}. "
            "Name one of them with --joint."
        )
    raise ReplayError(
        f"{_told(bags)} has no reading of the hitch on {done.topic} that can be used: "
        f"{done.fault or 'its messages name no joints'}"
    )


def _inputs(settings: Settings) -> tuple[JointInput | None, PercentInput | None]:
    if settings.input == "percent":
        points = settings.percent_points, settings.percent_angles
        return None, PercentInput(*points, settings.angle_stddev)
    rule = settings.sign, settings.scale, settings.offset, settings.angle_stddev
    return JointInput(settings.joint_name, *rule), None


def _monitor(settings: Settings, topics: Mapping[str, BagTopic]) -> ResonanceMonitor | None:
    """Return what watches for resonance; None where no speed is known."""
    fixed = {name: getattr(settings, name) for name in SPEEDS if getattr(settings, name) >= 0.0}
    if not fixed and not topics.keys() & SPEEDS.keys():
        return None
    path = _excitation_path(settings)
    limits = settings.warning_margin, settings.hysteresis, settings.stale_after
    monitor = ResonanceMonitor(read_excitations(path), *limits)
    for name, value in fixed.items():
        monitor.set_fixed(SPEEDS[name], value)
    return monitor


def _excitation_path(settings: Settings) -> Path:
    return _path(settings.excitation_file) or config_file(DEFAULT_EXCITATIONS)


def _model(settings: Settings, what_if: WhatIf) -> tuple[str, Table]:
    """Return the mechanism's YAML, and its table, read or built."""
    given = _path(settings.mechanism_file)
    path = given or config_file(DEFAULT_MECHANISM)
    mechanism, text = read_mechanism(path), load_yaml(path)[1]
    if what_if != AS_IT_IS:
        body = mechanism.rigid_bodies[0] if len(mechanism.rigid_bodies) == 1 else None
        if body is None:
            raise ReplayError(
                f"{path} has {len(mechanism.rigid_bodies)} rigid bodies; which implement another "
                "mass means is only known where there is one."
            )
        mass = body.mass if what_if.mass is None else what_if.mass
        inertia = body.inertia if what_if.inertia is None else what_if.inertia
        implement = Implement(body.name, mass, inertia, ())
        changed, text = with_implement(mechanism, text, implement)
        return text, build_table(LinkageModel(changed))
    table_path = _path(settings.table_file)
    if table_path is None and given is not None:
        return text, build_table(LinkageModel(mechanism))
    return text, load_table(table_path or config_file(DEFAULT_TABLE), mechanism)


def _path(text: str) -> Path | None:
    return Path(text).expanduser() if text else None


def _parameters(settings: Settings) -> str:
    """Return the settings as a file for the node's ``--params-file``."""
    values = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in asdict(settings).items()
    }
    return f"# linkage_vibration {linkage_vibration.__version__}, replay\n" + yaml.safe_dump(
        {_NODE_NAMES[2]: {"ros__parameters": values}}, sort_keys=False
    )


def _topic(name: str, kind: str) -> Topic:
    qos = offered_qos_profiles(reliable=True, depth=QUEUE_DEPTH)
    return Topic(name, kind, *_definition(kind), qos)


def _definition(kind: str) -> tuple[str, str]:
    """Return a type's definition and hash, without ROS 2 for what rosbags knows."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    if kind in store.fielddefs:
        return store.generate_msgdef(kind, ros_version=2)[0], store.hash_rihs01(kind)
    return message_definition(kind), type_hash(kind)


def _typed(value: Any, default: Any, where: str) -> Any:
    """Return a value in the type of a setting."""
    if isinstance(default, tuple):
        if isinstance(value, list | tuple):
            return tuple(_typed(number, 0.0, where) for number in value)
    elif type(default) is float and type(value) is int:
        return float(value)
    elif type(value) is type(default):
        return value
    kind = {str: "text", int: "a whole number", float: "a number", tuple: "a list of numbers"}
    raise ReplayError(f"{where} must be {kind[type(default)]}, not {value!r}.")
