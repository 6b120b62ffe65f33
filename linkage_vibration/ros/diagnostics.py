# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The status that the node publishes on ``/diagnostics``."""

import math
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from linkage_vibration.bags.recorder import Recorder
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.answers import Served
from linkage_vibration.prediction.health import Fault, Level, overall
from linkage_vibration.prediction.predictor import Prediction, uncertain_modes
from linkage_vibration.prediction.resonance import ResonanceState

LATENCIES = 1_000  # the percentiles are those of this many latest latencies
CLOCK_STEP = 0.5  # s; the wall clock was set if it differs by more from the steady clock


@dataclass(frozen=True, slots=True)
class Second:
    """Events since the last status."""

    rate: float  # Hz, predictions
    without_numbers: float  # share of the predictions, 0 to 1
    clock_jumps: int
    qos_mismatches: int


@dataclass
class Statistics:
    """What the node counts; the memory is bounded however long it runs."""

    received: int = 0  # messages
    predicted: int = 0  # predictions that were published, and of these:
    without_numbers: int = 0
    stamps_back: int = 0  # readings with an earlier stamp than the reading before
    clock_jumps: int = 0  # how often the clock was set, or a looping bag jumped back
    qos_mismatches: Counter[str] = field(default_factory=Counter)  # by topic
    latencies: "deque[float]" = field(default_factory=lambda: deque(maxlen=LATENCIES))  # s
    last_reading: float = math.nan  # steady clock at its arrival, s
    stamp_age: float = math.nan  # s, of the last reading at its arrival; negative in the future
    _last_stamp: int = -(2**63)  # ns
    _before: tuple[float, int, int, int, int] | None = None  # time and counts at the last status
    _wall: float | None = None

    def take_reading(self, now: float, sec: int, nanosec: int, received: int) -> None:
        """Take a stamp, and its arrival by the steady clock (s) and by that of the node (ns)."""
        stamp = 1_000_000_000 * sec + nanosec
        if stamp < self._last_stamp:
            self.stamps_back += 1
        self._last_stamp = stamp
        self.stamp_age = 1e-9 * (received - stamp)
        self.last_reading = now

    def watch_wall_clock(self, wall: float, steady: float) -> None:
        """Count a jump if the wall clock was set since the last call; both times are in s."""
        ahead = wall - steady
        if self._wall is not None and abs(ahead - self._wall) > CLOCK_STEP:
            self.clock_jumps += 1
        self._wall = ahead

    def since_last_time(self, now: float) -> Second:
        """Return what happened since the last call; ``now`` is by the steady clock, s."""
        mismatches = sum(self.qos_mismatches.values())
        counts = self.predicted, self.without_numbers, self.clock_jumps, mismatches
        then, *before = self._before or (now - 1.0, *counts)
        self._before = (now, *counts)
        predicted, refused, jumps, mismatched = (
            count - earlier for count, earlier in zip(counts, before, strict=True)
        )
        rate = predicted / max(now - then, 1e-9)
        return Second(rate, refused / predicted if predicted else 0.0, jumps, mismatched)


@dataclass(frozen=True, slots=True)
class Health:
    """What a status reports beside the statistics."""

    state: str  # of the lifecycle
    problem: str  # why the node could not reach another state; empty if it could
    reading: str  # name of the input, such as "joint hitch on /joint_states"
    age: float  # s, of the last reading
    stale_after: float  # s
    second: Second
    prediction: Prediction | None  # the last one
    resonance: MessageColumns | None  # the last one
    recorder: Recorder | None  # None while the node is not configured
    served: Served | None  # None while the node is not configured
    readings: Sequence[Fault] = ()
    speeds: Sequence[Fault] = ()
    log_problem: str = ""  # why no log could be started; empty if it could


def _judge(health: Health, statistics: Statistics) -> tuple[bytes, str]:
    """Return the level of a status, and a sentence about the most serious problem."""
    if health.problem:
        return DiagnosticStatus.ERROR, health.problem
    if health.state != "active":
        return DiagnosticStatus.OK, f"The node is {health.state}."
    if not health.age <= health.stale_after:  # the age is NaN before the first reading
        since = "" if math.isnan(health.age) else f" for {health.age:.1f} s"
        return DiagnosticStatus.STALE, f"The node has not received {health.reading}{since}."
    warning = _warning(health, statistics)
    if warning:
        return DiagnosticStatus.WARN, warning
    return DiagnosticStatus.OK, f"Predicting at {health.second.rate:.0f} Hz."


def _warning(health: Health, statistics: Statistics) -> str:
    """Return a sentence about the most serious reason for a warning, or an empty one."""
    second = health.second
    if second.without_numbers > 0.0:
        share = 100.0 * second.without_numbers
        return f"{share:.0f} % of the crank angles have no prediction; see the node's warnings."
    if second.qos_mismatches:
        topics = ", ".join(sorted(statistics.qos_mismatches))
        return f"A subscriber's QoS does not match that of {topics}."
    if second.clock_jumps:
        return "The clock has jumped."
    return " ".join(_uncertain(health))


def _resonance(health: Health) -> tuple[Level, str]:
    """Return the level and the sentence about the resonance, which is no fault of the node."""
    near = health.resonance
    if near is None or near.state is ResonanceState.STALE:
        return Level.OK, "No resonance is known, as no speed or no prediction is fresh."
    if near.state is ResonanceState.WARNING:
        return Level.WARN, _resonance_warning(near, health.served)
    note = near.state is ResonanceState.NOTE
    passing = f"{near.excitation} passes a mode." if note else "No excitation exceeds its limit."
    return Level.OK, passing


def _log(health: Health) -> tuple[Level, str]:
    """Return the level and the sentence about the log."""
    log = health.recorder
    if log is not None and log.error is not None:
        return Level.ERROR, str(log.error)
    if health.log_problem:
        return Level.ERROR, health.log_problem
    if log is not None and log.dropped:
        return Level.WARN, f"{log.dropped} messages are missing in the log."
    recording = log is not None and log.recording
    return Level.OK, f"Recording to {log.path}." if log and recording else "No log is recorded."


def statuses(name: str, health: Health, statistics: Statistics) -> list[DiagnosticStatus]:
    """Return the statuses of predictions, inputs, resonance and log of a node with this name."""
    inactive = Level.OK, f"The node is {health.state}."
    parts: Mapping[str, tuple[Level, str]] = {
        "input": overall(health.readings, "The readings have no known fault."),
        "speeds": overall(health.speeds, "The speeds have no known fault."),
        "resonance": _resonance(health),
        "log": _log(health),
    }
    predictions = status(f"{name}: predictions", health, statistics)
    return [predictions] + [
        DiagnosticStatus(
            level=bytes([level]),
            name=f"{name}: {part}",
            message=sentence,
            hardware_id=predictions.hardware_id,
        )
        for part, verdict in parts.items()
        for level, sentence in [verdict if health.state == "active" else inactive]
    ]


def _resonance_warning(near: MessageColumns, served: Served | None) -> str:
    """Return a sentence about an excitation that warns, with its deviation or probability."""
    mode = f"mode {near.mode + 1}" if served is None else served.table.mode_label(near.mode)
    text = (
        f"{near.excitation} ({near.excitation_frequency:.1f} Hz) is within "
        f"{100.0 * abs(near.relative_margin):.1f} % of {mode} ({near.natural_frequency:.1f} Hz)"
    )
    if near.velocity == near.velocity:  # it is not NaN
        spread = near.velocity_stddev
        deviation = "not known" if math.isnan(spread) else f"{1e3 * spread:.2g} mm/s"
        return (
            f"{text}, and shakes the response point with {1e3 * near.velocity:.3g} mm/s rms "
            f"(standard deviation {deviation}) if its amplitude is as described."
        )
    if near.probability == near.probability:
        return f"{text}, in its half-power band with a probability of {near.probability:.2g}."
    return f"{text}."


def _uncertain(health: Health) -> list[str]:
    """Return a sentence about each uncertain mode of the last prediction.

    Where numbers of the mechanism are uncertain, every mode is, as the predictions say.
    """
    if health.prediction is None or (health.served and health.served.table.uncertain):
        return []
    last = health.prediction
    frequencies = last.natural_frequencies, last.frequency_stddev
    labels = [] if health.served is None else [health.served.table.mode_label]
    return uncertain_modes(*frequencies, last.damping_ratios, last.damping_ratio_stddev, *labels)


def _percentile(latencies: Sequence[float], share: float) -> float:
    """Return a percentile of ascending latencies, ms; NaN without any."""
    if not latencies:
        return math.nan
    rest, below = math.modf(share * (len(latencies) - 1))
    low, high = latencies[int(below)], latencies[math.ceil(below + rest)]
    return 1e3 * (low + rest * (high - low))


def status(name: str, health: Health, statistics: Statistics) -> DiagnosticStatus:
    """Return the status of the predictions with all its values."""
    level, message = _judge(health, statistics)
    table = None if health.served is None else health.served.table
    latencies, log = sorted(statistics.latencies), health.recorder
    mismatches = sorted(statistics.qos_mismatches.items())
    values = {
        "state": health.state,
        "input age [s]": f"{health.age:.3f}",
        "input rate [Hz]": f"{health.second.rate:.1f}",
        "stamp age [s]": f"{statistics.stamp_age:.3f}",
        "without numbers [%]": f"{100.0 * health.second.without_numbers:.1f}",
        "latency p50 [ms]": f"{_percentile(latencies, 0.5):.3f}",
        "latency p99 [ms]": f"{_percentile(latencies, 0.99):.3f}",
        "messages received": str(statistics.received),
        "predictions": str(statistics.predicted),
        "stamps that went back": str(statistics.stamps_back),
        "clock jumps": str(statistics.clock_jumps),
        "QoS mismatches": ", ".join(f"{topic} {count}" for topic, count in mismatches) or "0",
        "table id": "" if table is None else table.table_id,
        "table error": f"{math.nan if table is None else table.interpolation_error.max():.1e}",
    }
    if health.resonance is not None:
        values["resonance"] = health.resonance.state.name.lower()
        values["margin [%]"] = f"{100.0 * health.resonance.relative_margin:.1f}"
        values["probability"] = f"{health.resonance.probability:.2g}"
        values["total velocity [mm/s]"] = f"{1e3 * float(health.resonance.total_velocity):.3g}"
    if log is not None:
        values["recording"] = str(log.recording).lower()
        values["log"] = str(log.path or "")
        values["log messages written"] = str(log.written)
        values["log messages dropped"] = str(log.dropped)
        values["log error"] = str(log.error or "")
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id="" if health.served is None else health.served.mechanism.name,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
