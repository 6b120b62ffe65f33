# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The status that the node publishes on ``/diagnostics``."""

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from linkage_vibration.errors import printable
from linkage_vibration.prediction.answers import LoadedModel
from linkage_vibration.prediction.health import Fault, Level, ReadingWatch, overall
from linkage_vibration.prediction.predictor import Prediction, uncertain_modes
from linkage_vibration.prediction.resonance import described
from linkage_vibration.prediction.severity import ResonanceState, present_sentence
from linkage_vibration.ros.arrivals import LONGEST_WAIT
from linkage_vibration.ros.live_pipeline import NO_CLOCK, SILENT, STOPPED_CLOCK, LivePipeline
from linkage_vibration.ros.log_control import Recording
from linkage_vibration.ros.statistics import RECENT, Second, Statistics

if TYPE_CHECKING:
    from linkage_vibration.listening.live import SensorMonitor

_LOST = 0.01  # share of the messages; a wireless network loses fewer


@dataclass(frozen=True, slots=True)
class Health:
    """What a status reports beside the statistics."""

    state: str  # of the lifecycle
    problem: str  # why the node could not reach another state; empty if it could
    second: Second
    served: LoadedModel | None = None  # these are None while the node is not configured
    predicting: LivePipeline | None = None
    recording: Recording | None = None
    same_name: int = 1  # nodes that have the name of this one, with itself


def _predictions(health: Health) -> tuple[Level, str]:
    """Return the level and the sentence about the most serious problem of the predictions."""
    predicting = health.predicting
    if health.problem:
        return Level.ERROR, health.problem
    if health.state != "active" or predicting is None:
        return Level.OK, f"The node is {health.state}."
    if predicting.clock_missing:
        return Level.STALE, NO_CLOCK
    if not predicting.age <= predicting.stale_after:  # the age is NaN before the first reading
        since = "" if math.isnan(predicting.age) else f" for {predicting.age:.1f} s"
        return Level.STALE, f"The node has not received {predicting.input_name}{since}."
    warning = _warning(health)
    if warning:
        return Level.WARN, warning
    return Level.OK, f"Predicting at {health.second.rate:.0f} Hz."


def _warning(health: Health) -> str:
    """Return a sentence about the most serious reason for a warning, or an empty one."""
    second = health.second
    if health.same_name > 1:
        return f"{health.same_name} nodes have this name; give each another name or namespace."
    if second.without_numbers > 0.0:
        share = 100.0 * second.without_numbers
        return f"{share:.0f} % of the crank angles have no prediction; see the node's warnings."
    if health.predicting is not None and health.predicting.unmatched:
        return " ".join(health.predicting.unmatched)
    if second.clock_jumps:
        return f"The clock has jumped in the last {RECENT} s."
    last = None if health.predicting is None else health.predicting.prediction
    return " ".join(_uncertain(last, health.served))


_RESONANCE_LEVELS = {ResonanceState.WARNING: Level.WARN, ResonanceState.UNKNOWN: Level.STALE}


def _resonance(predicting: LivePipeline) -> tuple[Level, str]:
    """Return the level and the sentence about the resonance, which is no fault of the node."""
    near = predicting.resonance
    if not predicting.age <= predicting.stale_after:
        return Level.STALE, "No resonance is assessed, as no reading arrives."
    if near is None:
        return Level.STALE, "No resonance is assessed, as no speed has arrived."
    if predicting.paused:
        return Level.STALE, STOPPED_CLOCK
    # An order near a mode makes a note, but no number that is known to be good.
    usual = Level.STALE if math.isnan(near.total_load_ratio) else Level.OK
    sentence = present_sentence(described(near), predicting.excitations)
    return _RESONANCE_LEVELS.get(near.state, usual), sentence


def _measured(predicting: LivePipeline, sensors: "SensorMonitor") -> tuple[Level, str]:
    """Return the level and the sentence about what sensors measure beside the predictions."""
    from linkage_vibration.listening.live import difference_sentence

    measured, excitations = predicting.measured, predicting.excitations
    if not measured:
        return Level.STALE, f"No sensor has sent samples that can be used for {SILENT:g} s."
    silent = [name for name in sensors.names if name not in measured]
    messages = [measured[name][1] for name in sorted(measured)]
    sentences = [difference_sentence(message, excitations) for message in messages]
    sentences += [f"{name}: It has sent no samples for {SILENT:g} s." for name in silent]
    sentences.append(sensors.modes.sentence())
    if any(sentences):
        return Level.WARN, " ".join(filter(None, sentences))
    orders = sum(int(np.isfinite(message.differences).sum()) for message in messages)
    modes = sensors.modes.compared
    if not orders + modes:
        sentence = "No order with a known speed is heard and no mode is identified, so nothing is "
        return Level.STALE, sentence + "compared with the predictions."
    sentence = "What the sensors measure agrees with the predictions"
    return Level.OK, f"{sentence} (orders compared: {orders}, modes: {modes})."


def _traffic(second: Second) -> list[Fault]:
    """Return faults for messages that were lost, and that waited before they were answered."""
    sentences = [
        f"{lost} of {arrived + lost} messages of {topic} were lost in the last {RECENT} s; check "
        "the network, and the load of the machine."
        for topic, lost in sorted(second.lost.items())
        if lost > _LOST * ((arrived := second.arrived[topic]) + lost)
    ]
    if second.wait > LONGEST_WAIT:
        left_out = f", and {second.dropped} were left out for newer ones" if second.dropped else ""
        sentences.append(
            f"In the last {RECENT} s, messages waited up to {second.wait:.2g} s for the node"
            f"{left_out}; the machine is too slow or too busy."
        )
    return [Fault(Level.WARN, sentence) for sentence in sentences]


def _log(recording: Recording) -> tuple[Level, str]:
    """Return the level and the sentence about the log."""
    log = recording.recorder
    works = log.active and log.recording
    if log.error and not works:
        return Level.ERROR, str(log.error)
    if works and log.dropped:
        sentence = f"{log.dropped} messages are missing in the log. {log.error or ''}"
        return Level.WARN, sentence.rstrip()
    return Level.OK, f"Recording to {log.path}." if works else "No log is recorded."


def statuses(name: str, health: Health, statistics: Statistics) -> list[DiagnosticStatus]:
    """Return the statuses of predictions, inputs, resonance and log of a node with this name."""
    inactive = Level.OK, f"The node is {health.state}."
    parts = dict.fromkeys(("predictions", "input", "speeds", "resonance", "log"), inactive)
    parts["predictions"] = _predictions(health)
    predicting, recording = health.predicting, health.recording
    if health.state == "active" and predicting is not None and recording is not None:
        faults = [*_traffic(health.second), *predicting.reading_faults]
        parts["input"] = overall(faults, f"No fault is known of {predicting.input_name}.")
        parts["speeds"] = overall(predicting.speed_faults, "The speeds have no known fault.")
        parts["resonance"] = _resonance(predicting)
        parts["log"] = _log(recording)
        if predicting.sensors is not None:
            parts["sensors"] = _measured(predicting, predicting.sensors)
    described = [
        DiagnosticStatus(
            level=bytes([level]),
            name=f"{name}: {part}",
            message=printable(sentence),
            hardware_id="" if health.served is None else health.served.mechanism.name,
        )
        for part, (level, sentence) in parts.items()
    ]
    values = _values(health, statistics).items()
    described[0].values = [KeyValue(key=key, value=printable(value)) for key, value in values]
    return described


def _uncertain(last: Prediction | None, served: LoadedModel | None) -> list[str]:
    """Return a sentence about each uncertain mode, unless the mechanism's numbers make all so."""
    if last is None or served is None or served.table.uncertain:
        return []
    frequencies = last.natural_frequencies, last.frequency_stddevs
    ratios = last.damping_ratios, last.damping_ratio_stddevs
    return uncertain_modes(*frequencies, *ratios, served.table.mode_label)


def _by_topic(counts: Counter[str]) -> str:
    """Return the counts of topics in words."""
    return ", ".join(f"{topic} {count}" for topic, count in sorted(counts.items())) or "0"


def _values(health: Health, statistics: Statistics) -> dict[str, str]:
    """Return the values of the status of the predictions, by their names."""
    served, latencies = health.served, list(statistics.latencies) or [math.nan]
    median, late = 1e3 * np.percentile(latencies, (50.0, 99.0))
    predicting, readings = health.predicting, ReadingWatch()
    if predicting is not None:
        readings = predicting.readings
    values = {
        "state": health.state,
        "input age [s]": f"{math.nan if predicting is None else predicting.age:.3f}",
        "input rate [Hz]": f"{health.second.rate:.1f}",
        "stamp age [s]": f"{readings.stamp_age:.3f}",
        "without numbers [%]": f"{100.0 * health.second.without_numbers:.1f}",
        "latency p50 [ms]": f"{median:.3f}",
        "latency p99 [ms]": f"{late:.3f}",
        "messages received": str(statistics.received),
        "messages lost": _by_topic(statistics.lost),
        "messages left out": _by_topic(statistics.dropped),
        "longest wait [s]": f"{health.second.wait:.3f}",
        "predictions": str(statistics.predicted),
        "stamps that went back": str(readings.stamps_back),
        "clock jumps": str(statistics.clock_jumps),
        "QoS mismatches": str(0 if predicting is None else len(predicting.unmatched)),
        "table id": "" if served is None else served.table.table_id,
        "table error": f"{served.table.interpolation_error.max() if served else math.nan:.1e}",
    }
    # The thread of the readings replaces it.
    if predicting is not None and (resonance := predicting.resonance) is not None:
        near = described(resonance)
        values["resonance"] = near.state.name.lower()
        values["margin [%]"] = f"{100.0 * near.relative_margin:.1f}"
        values["probability"] = f"{near.probability:.2g}"
        values["load ratio"] = f"{float(near.total_load_ratio):.3g}"
        values["total velocity [mm/s]"] = f"{1e3 * float(near.total_velocity):.3g}"
    if health.recording is not None:
        log = health.recording.recorder
        values["recording"] = str(log.recording).lower()
        values["log"] = str(log.path or "")
        values["log messages written"] = str(log.written)
        values["log messages dropped"] = str(log.dropped)
        values["log files deleted"] = str(log.deleted)
        values["log error"] = str(log.error or "")
    return values
