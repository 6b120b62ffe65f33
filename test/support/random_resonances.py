# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of random assessments, and what they say, by loops over the messages alone.

Nothing here calls the verdict of the package, which is compared with it. A message holds until the
next one; if that is more than 3 s later, or earlier, it holds for the median of all other steps.
The last message holds for this median as well. If all are further apart, it is the median of these
steps, but at most 3 s. Messages of one stamp share the time for which it holds. A gap ends a
warning, and so does a clock that goes back by a second or more.
"""

import itertools
import math
import statistics
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.writing import Attachment, Topic, offered_qos_profiles
from linkage_vibration.messages.definitions import message_definition, type_hash
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import ASSESSED, PREDICTION
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.support.resources import PAPER_MECHANISM, PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table, table_bytes

START = 1_767_225_600 * 10**9  # ns
UNKNOWN, CLEAR, NOTE, WARNING = range(4)  # as in LoadState.msg
SEVEREST_LAST = UNKNOWN, CLEAR, NOTE, WARNING
# Bits of sources, as in LoadState.msg.
CRANK_ANGLE, ENGINE, PTO, GROUND, GROUND_LEVEL = 1, 2, 4, 8, 16
FAULTS = "none", "lost", "outside", "zero", "repeated"
SHARES, CALM_SHARES = (0.6, 0.1, 0.1, 0.05, 0.15), (0.9, 0.02, 0.02, 0.02, 0.04)
LONGEST = 3_000_000_000  # ns, a step that is no gap
BACK = 1_000_000_000  # ns, a step back of a clock that jumps; messages come late by less
NAMES = "engine 1", "engine 3", "engine 6", "rotor 1"
EXCITATIONS = b"""
engine: {speed: engine, orders: [1, 3, 6]}
rotor: {speed: pto, ratio: 0.45, orders: [1]}
"""
TOPICS = {
    "/linkage_vibration/prediction": "linkage_vibration_interfaces/msg/VibrationPrediction",
    "/linkage_vibration/resonance": "linkage_vibration_interfaces/msg/Resonance",
    "/linkage_vibration/levels": "linkage_vibration_interfaces/msg/Levels",
    "/linkage_vibration/load_state": "linkage_vibration_interfaces/msg/LoadState",
}


@dataclass(frozen=True)
class Message:
    """What a verdict uses of one message."""

    stamp: int  # ns
    angle: float  # rad
    state: int
    states: tuple[int, ...]
    ratios: tuple[float, ...]  # float32; NaN if not known
    total: float
    excitation: str  # the most severe one
    unknown: int  # bits of the sources that are not known
    limit: float  # load ratio, float32, above which there is a warning


@dataclass(frozen=True)
class Row:
    """What one excitation did."""

    name: str
    largest: float  # NaN if it was never known
    warning: float  # s
    note: float  # s
    warnings: int


def random_drive(seed: int) -> list[Message]:
    """Return messages with gaps, jumps of the clock, rates of 0.01 to 50 Hz, notes and warnings.

    Some stamps are zero, repeated, or earlier than the one before, for one message or for more.
    Sources are lost for a while, angles are outside the table, and limits change.
    """
    rng = np.random.default_rng(seed)
    messages: list[Message] = []
    now, known = START, rng.random(len(NAMES)) < 0.75  # whose amplitude is known
    calm = rng.random() < 0.4  # nothing is above a limit, so that only what is not known matters
    sparse = rng.random() < 0.1
    zero = rng.random() < 0.02  # all stamps are
    angle = 2.35  # rad; it changes by less than a sensor's noise
    for _ in range(int(rng.integers(1, 6))):
        rate = rng.choice([0.3, 0.2, 0.01] if sparse else [0.3, 1.0, 10.0, 10.0, 50.0, 50.0])
        step = round(1e9 / rate)
        limit = float(np.float32(rng.choice([0.33, 0.33, 0.2, 0.5])))
        for _ in range(int(rng.integers(1, 4))):
            states = rng.choice([CLEAR, NOTE, WARNING, UNKNOWN], len(NAMES), p=[0.4, 0.3, 0.2, 0.1])
            fault = rng.choice(FAULTS, p=CALM_SHARES if calm else SHARES)
            lost = int(rng.choice([ENGINE, PTO, GROUND])) if fault == "lost" else 0
            for i in range(int(rng.integers(1, 20))):
                late = int(rng.integers(2, 6)) * step if rng.random() < 0.02 else 0
                at = 0 if zero or fault == "zero" else now - late
                if calm:
                    states = np.full(len(NAMES), CLEAR)
                message = _message(rng, at, states, known, limit)
                if calm:
                    message = _calmed(message)
                angle = min(max(angle + 0.03 * (message.angle - 2.35), 1.6), 3.1)
                message = replace(message, unknown=message.unknown | lost, angle=angle)
                messages.append(_outside(message) if fault == "outside" else message)
                if fault != "repeated" or i % 4 == 3:
                    now += step + int(rng.integers(-step // 20, step // 20 + 1))
        change = rng.random()
        if change < (0.1 if calm else 0.4):
            now += int(rng.integers(LONGEST + 1, 4000 * 10**9))  # a gap
        elif change < 0.6:
            now -= int(rng.integers(2 * step, 2 * step + 30 * 10**9))  # the clock jumps back
        elif change < 0.7:
            now -= 3 * step  # by no more than a few messages
    return messages


def _calmed(message: Message) -> Message:
    """Return a message of which nothing is above its limit."""
    ratios = tuple(0.1 * min(ratio, message.limit) for ratio in message.ratios)
    total = float(np.float32(np.sqrt(np.nansum(np.square(ratios)))))
    total = math.nan if math.isnan(message.total) else total
    states = tuple(min(state, CLEAR) for state in message.states)
    return replace(message, state=CLEAR, states=states, ratios=ratios, total=total, unknown=0)


def _outside(message: Message) -> Message:
    """Return a message of a crank angle that is outside the table, of which nothing is known."""
    none, n = math.nan, len(NAMES)
    unknown = message.unknown | CRANK_ANGLE
    angle = message.angle + math.pi
    return Message(
        message.stamp, angle, UNKNOWN, (UNKNOWN,) * n, (none,) * n, none, "", unknown, message.limit
    )


def _message(
    rng: np.random.Generator, now: int, states: NDArray[Any], known: NDArray[Any], limit: float
) -> Message:
    """Return a message whose excitations have these states."""
    drawn = np.float32(rng.lognormal(-1.5, 1.0, len(states)))
    moving = states != UNKNOWN
    ratios = np.where(known & moving, drawn, np.float32(np.nan)).astype(np.float32)
    total = float(np.float32(np.sqrt(np.nansum(ratios**2)))) if (known & moving).any() else math.nan
    of_total = int(rng.integers(CLEAR, WARNING + 1)) if total == total else UNKNOWN
    state = max([*states.tolist(), of_total], key=SEVEREST_LAST.index)
    order = [
        (SEVEREST_LAST.index(int(each)), -1.0 if math.isnan(ratio) else float(ratio))
        for each, ratio in zip(states, ratios, strict=True)
    ]
    worst = order.index(max(order))
    return Message(
        now,
        float(rng.uniform(1.6, 3.1)),
        state,
        tuple(map(int, states)),
        tuple(map(float, ratios)),
        total,
        "" if state == UNKNOWN else NAMES[worst],
        int(rng.choice([ENGINE, PTO, GROUND_LEVEL])) if rng.random() < 0.15 else 0,
        limit,
    )


@cache
def _model() -> tuple[Predictor, str, list[Topic], list[Attachment]]:
    """Return what all logs share: the predictor, the name of its table, topics and attachments."""
    table = load_table(config_file(PAPER_TABLE))
    qos = offered_qos_profiles()
    topics = [Topic(n, k, message_definition(k), type_hash(k), qos) for n, k in TOPICS.items()]
    files = {
        "mechanism.yaml": config_file(PAPER_MECHANISM).read_bytes(),
        f"{table.table_id}.npz": table_bytes(table),
        "excitations.yaml": EXCITATIONS,
        "parameters.yaml": b"linkage_vibration:\n  ros__parameters: {}\n",
    }
    attachments = [Attachment(name, "application/yaml", data) for name, data in files.items()]
    return Predictor(table), table.table_id, topics, attachments


def write_drive(path: Path, messages: list[Message]) -> Path:
    """Write the log of a node that published these messages."""
    predictor, table_id, topics, attachments = _model()
    with LogWriter(path, topics, attachments) as log:
        for message in messages:
            header = (*divmod(message.stamp, 10**9), "")
            prediction = predictor.predict(message.angle)
            data = encode_message(PREDICTION, prediction, *header)
            log.write("/linkage_vibration/prediction", data, message.stamp, message.stamp)
            assessed = _assessed(message, table_id)
            for topic, kind in zip(list(TOPICS)[1:], ASSESSED, strict=True):
                data = encode_message(kind, assessed, *header)
                log.write(topic, data, message.stamp, message.stamp)
    return path


def _assessed(message: Message, table_id: str) -> Any:
    """Return all fields of the messages; those that no verdict uses are not known."""
    values: dict[str, Any] = {}
    for field in (field for kind in ASSESSED for field in message_fields(kind)):
        if field.is_sequence:
            values[field.name] = np.full(len(NAMES), np.nan, np.float32)
        else:
            values[field.name] = "" if field.type == "string" else 0
            if field.type.startswith("float"):
                values[field.name] = math.nan
    values |= {
        "state": message.state,
        "excitation": message.excitation,
        "excitation_index": NAMES.index(message.excitation) if message.excitation else -1,
        "excitation_frequency": 13.0,
        "natural_frequency": 10.0,
        "table_id": table_id,
        "states": np.array(message.states, np.uint8),
        "unknown_sources": message.unknown,
        "load_ratio_limit": np.float32(message.limit),
        "load_ratios": np.array(message.ratios, np.float32),
        "total_load_ratio": np.float32(message.total),
    }
    return SimpleNamespace(**values)


def holding_times(messages: list[Message]) -> list[float]:
    """Return for how long each message holds, s."""
    groups = [list(same) for _, same in itertools.groupby(messages, lambda each: each.stamp)]
    ends = [later[0].stamp for later in groups[1:]]
    usual, held = usual_step(messages), list[float]()
    for same, end in itertools.zip_longest(groups, ends, fillvalue=None):
        assert same is not None
        step = -1 if end is None else end - same[0].stamp
        held += [1e-9 * (step if 0 < step <= LONGEST else usual) / len(same)] * len(same)
    return held


def usual_step(messages: list[Message]) -> float:
    """Return the median step between two stamps that is no gap, ns; at most the longest one."""
    steps = [later.stamp - each.stamp for each, later in itertools.pairwise(messages)]
    forward = [step for step in steps if step > 0]
    usual = [step for step in forward if step <= LONGEST]
    if any(0 <= step <= LONGEST for step in steps):
        return statistics.median(usual) if usual else 0.0
    return min(statistics.median(forward), LONGEST) if forward else 0.0


def warnings_of(messages: list[Message]) -> list[tuple[float, float, float]]:
    """Return start, s, duration, s, and largest total of each warning of the whole."""
    actual: list[list[float]] = []
    held, inside, last = holding_times(messages), False, START
    for message, time in zip(messages, held, strict=True):
        broken = not -BACK < message.stamp - last <= LONGEST
        last = message.stamp
        if message.state != WARNING:
            inside = False
            continue
        if broken or not inside:
            actual.append([1e-9 * (message.stamp - messages[0].stamp), 0.0, 0.0])
        inside = True
        actual[-1][1] += time
        if message.total > actual[-1][2]:
            actual[-1][2] = message.total
    return [(a, b, c) for a, b, c in actual]


def durations_of(messages: list[Message]) -> tuple[float, float, float]:
    """Return for how long the load was above the limit, was not, and was not known, s."""
    above = below = unknown = 0.0
    held = holding_times(messages)
    for message, time in zip(messages, held, strict=True):
        if message.total > message.limit:
            above += time
        elif (
            message.total <= message.limit
            and message.unknown == 0
            and UNKNOWN not in message.states
            and not any(
                state != CLEAR and math.isnan(ratio)
                for state, ratio in zip(message.states, message.ratios, strict=True)
            )
        ):
            below += time
        else:
            unknown += time
    for before, after in itertools.pairwise(messages):
        if after.stamp - before.stamp > LONGEST:
            unknown += 1e-9 * (after.stamp - before.stamp - usual_step(messages))
    return above, below, unknown


def rows_of(messages: list[Message]) -> list[Row]:
    """Return what each excitation did: the largest load ratio first, then the longest note."""
    rows, held = [], holding_times(messages)
    for i, name in enumerate(NAMES):
        largest, warning, note, count = math.nan, 0.0, 0.0, 0
        inside, last = False, START
        for message, time in zip(messages, held, strict=True):
            ratio, state = message.ratios[i], message.states[i]
            if ratio == ratio and not ratio <= largest:
                largest = ratio
            if state == NOTE:
                note += time
            if state == WARNING:
                warning += time
                count += not inside or not -BACK < message.stamp - last <= LONGEST
            inside, last = state == WARNING, message.stamp
        rows.append(Row(name, largest, warning, note, count))
    known = [row for row in rows if row.largest == row.largest]
    others = [row for row in rows if row.largest != row.largest]
    known.sort(key=lambda row: -row.largest)
    others.sort(key=lambda row: -round(row.note, 9))
    return known + others


def worst_of(messages: list[Message]) -> Message | None:
    """Return the first message with the largest total; None if no total is known."""
    worst = None
    for message in messages:
        if message.total == message.total and (worst is None or message.total > worst.total):
            worst = message
    return worst
