# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How the node fares, in the words and numbers of ``/diagnostics``."""

import math
from collections import Counter, deque
from dataclasses import dataclass, field

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from linkage_vibration.prediction.resonance import Resonance, ResonanceState

LATENCIES = 1_000  # the last ones, of which percentiles are told
CLOCK_STEP = 0.5  # s between the wall's and the steady clock in a second: somebody has set it


@dataclass(frozen=True, slots=True)
class Second:
    """What happened since the last status.

    Attributes
    ----------
    rate : float
        Predictions a second, Hz.
    without_numbers : float
        Share of them.
    clock_jumps, qos_mismatches : int
        As in `Statistics`.
    """

    rate: float
    without_numbers: float
    clock_jumps: int
    qos_mismatches: int


@dataclass
class Statistics:
    """What a node counts; memory is bounded however long it runs.

    Attributes
    ----------
    received, predicted, without_numbers : int
        Messages that came, predictions that went, and those of them that had no numbers.
    stamps_back : int
        Readings whose stamp was earlier than that of the one before.
    clock_jumps : int
        How often the clock was set, or a bag began anew.
    qos_mismatches : Counter of str
        For each topic, how many subscribers asked for a QoS that is not offered.
    latencies : deque of float
        From a message's arrival in the node to its prediction being handed to DDS, s.
    last_reading : float
        When the last reading came, by the steady clock, s; NaN before the first.
    stamp_age : float
        How long before its arrival the last reading was stamped, s; below 0 from the future.
    """

    received: int = 0
    predicted: int = 0
    without_numbers: int = 0
    stamps_back: int = 0
    clock_jumps: int = 0
    qos_mismatches: Counter[str] = field(default_factory=Counter)
    latencies: "deque[float]" = field(default_factory=lambda: deque(maxlen=LATENCIES))
    last_reading: float = math.nan
    stamp_age: float = math.nan
    _last_stamp: int = -(2**63)  # ns
    _before: tuple[float, int, int, int, int] | None = None  # time and counts a second ago
    _wall: float | None = None

    def take_reading(self, now: float, sec: int, nanosec: int, received: int) -> None:
        """Take the times of a reading.

        Parameters
        ----------
        now : float
            By the steady clock, s.
        sec, nanosec : int
            Its stamp.
        received : int
            When it came by the clock that stamps are told by, ns.
        """
        stamp = 1_000_000_000 * sec + nanosec
        if stamp < self._last_stamp:
            self.stamps_back += 1
        self._last_stamp = stamp
        self.stamp_age = 1e-9 * (received - stamp)
        self.last_reading = now

    def watch_wall_clock(self, wall: float, steady: float) -> None:
        """Count a step of the wall's clock since the last call; both times in s."""
        ahead = wall - steady
        if self._wall is not None and abs(ahead - self._wall) > CLOCK_STEP:
            self.clock_jumps += 1
        self._wall = ahead

    def since_last_time(self, now: float) -> Second:
        """Return what happened since the last call, which was a while ago (s)."""
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
class Log:
    """State of the recorder; see `Recorder`."""

    recording: bool
    path: str
    written: int
    dropped: int
    error: str


@dataclass(frozen=True, slots=True)
class Health:
    """What one status tells.

    Attributes
    ----------
    state : str
        Of the lifecycle.
    problem : str
        Why the node could not be configured; empty otherwise.
    reading : str
        Names what is read, such as "joint hitch on /joint_states".
    age, stale_after : float
        Of the last reading, and from which that is too old, s.
    second : Second
        What happened since the status before.
    resonance : Resonance or None
        The last one.
    log : Log or None
        None while there is no recorder.
    table_id, interpolation_error : str, float
        Of the table.
    """

    state: str
    problem: str
    reading: str
    age: float
    stale_after: float
    second: Second
    resonance: Resonance | None
    log: Log | None
    table_id: str
    interpolation_error: float


def judge(health: Health, statistics: Statistics) -> tuple[bytes, str]:
    """Return the level of a status and a sentence; of several troubles the gravest."""
    if health.problem:
        return DiagnosticStatus.ERROR, health.problem
    if health.state != "active":
        return DiagnosticStatus.OK, f"The node is {health.state}."
    log, second, near = health.log, health.second, health.resonance
    if log is not None and log.error:
        return DiagnosticStatus.ERROR, log.error
    if not health.age <= health.stale_after:  # NaN is no age
        told = "never" if math.isnan(health.age) else f"not for {health.age:.1f} s"
        return DiagnosticStatus.STALE, f"There was {told} a reading of {health.reading}."
    if second.without_numbers > 0.0:
        share = 100.0 * second.without_numbers
        return (
            DiagnosticStatus.WARN,
            f"{share:.0f} % of the crank angles have no prediction; see the node's warnings.",
        )
    if log is not None and log.dropped:
        return DiagnosticStatus.WARN, f"{log.dropped} messages are not in the log."
    if second.qos_mismatches:
        topics = ", ".join(sorted(statistics.qos_mismatches))
        return DiagnosticStatus.WARN, f"A subscriber's QoS does not match that of {topics}."
    if second.clock_jumps:
        return DiagnosticStatus.WARN, "The clock has jumped."
    if near is not None and near.state is ResonanceState.WARNING:
        return (
            DiagnosticStatus.WARN,
            f"{near.excitation} ({near.excitation_frequency:.1f} Hz) is within "
            f"{100.0 * abs(near.relative_margin):.1f} % of mode {near.mode + 1} "
            f"({near.natural_frequency:.1f} Hz).",
        )
    return DiagnosticStatus.OK, f"Predicting at {second.rate:.0f} Hz."


def status(name: str, hardware_id: str, health: Health, statistics: Statistics) -> DiagnosticStatus:
    """Return the status with every number."""
    level, message = judge(health, statistics)
    median, high = (
        1e3 * np.percentile(statistics.latencies, [50.0, 99.0])
        if statistics.latencies
        else (math.nan, math.nan)
    )
    values = {
        "state": health.state,
        "input age [s]": f"{health.age:.3f}",
        "input rate [Hz]": f"{health.second.rate:.1f}",
        "stamp age [s]": f"{statistics.stamp_age:.3f}",
        "without numbers [%]": f"{100.0 * health.second.without_numbers:.1f}",
        "latency p50 [ms]": f"{median:.3f}",
        "latency p99 [ms]": f"{high:.3f}",
        "messages received": str(statistics.received),
        "predictions": str(statistics.predicted),
        "stamps that went back": str(statistics.stamps_back),
        "clock jumps": str(statistics.clock_jumps),
        "QoS mismatches": ", ".join(
            f"{topic} {count}" for topic, count in sorted(statistics.qos_mismatches.items())
        )
        or "0",
        "table id": health.table_id,
        "table error": f"{health.interpolation_error:.1e}",
    }
    if health.resonance is not None:
        values["resonance"] = health.resonance.state.name.lower()
        values["margin [%]"] = f"{100.0 * health.resonance.relative_margin:.1f}"
    if health.log is not None:
        values["recording"] = str(health.log.recording).lower()
        values["log"] = health.log.path
        values["log messages written"] = str(health.log.written)
        values["log messages dropped"] = str(health.log.dropped)
        values["log error"] = health.log.error
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )


def diagnostics(stamp: object, told: DiagnosticStatus) -> DiagnosticArray:
    """Return the message of one status."""
    message = DiagnosticArray(status=[told])
    message.header.stamp = stamp
    return message
