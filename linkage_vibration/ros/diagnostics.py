# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How the node fares, in the words and numbers of ``/diagnostics``."""

import math
import time
from collections import Counter, deque
from dataclasses import dataclass, field

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from linkage_vibration.excitation import Resonance, ResonanceState

LATENCIES = 1_000  # the last ones, of which percentiles are told
CLOCK_STEP = 0.5  # s between the wall's and the steady clock in a second: somebody has set it


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
        For each topic, events of an offered or requested QoS that cannot be met.
    latencies : deque of float
        From a message's arrival in the node to its prediction being handed to DDS, s.
    last_reading : float
        When the last reading came, by the steady clock, s; NaN before the first.
    """

    received: int = 0
    predicted: int = 0
    without_numbers: int = 0
    stamps_back: int = 0
    clock_jumps: int = 0
    qos_mismatches: Counter[str] = field(default_factory=Counter)
    latencies: "deque[float]" = field(default_factory=lambda: deque(maxlen=LATENCIES))
    last_reading: float = math.nan
    _last_stamp: tuple[int, int] = (-(2**31), 0)
    _before: tuple[float, int, int, int] | None = None  # time and counts a second ago
    _wall: float | None = None

    def take_stamp(self, sec: int, nanosec: int) -> None:
        """Take the stamp of a reading."""
        stamp = sec, nanosec
        if stamp < self._last_stamp:
            self.stamps_back += 1
        self._last_stamp = stamp

    def watch_wall_clock(self) -> None:
        """Count a step of the wall's clock since the last call; to be called each second."""
        ahead = time.time() - time.monotonic()
        if self._wall is not None and abs(ahead - self._wall) > CLOCK_STEP:
            self.clock_jumps += 1
        self._wall = ahead

    def since_last_time(self, now: float) -> tuple[float, float]:
        """Return rate (Hz) and share without numbers of the predictions since the last call."""
        counts = self.received, self.predicted, self.without_numbers
        before = self._before or (now - 1.0, *counts)
        self._before = (now, *counts)
        apart = max(now - before[0], 1e-9)
        predicted = self.predicted - before[2]
        refused = self.without_numbers - before[3]
        return (self.received - before[1]) / apart, refused / predicted if predicted else 0.0


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
    rate : float
        Messages of the input a second.
    without_numbers : float
        Share of the last second's predictions.
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
    rate: float
    without_numbers: float
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
    log = health.log
    if log is not None and log.error:
        return DiagnosticStatus.ERROR, log.error
    if not health.age <= health.stale_after:  # NaN is no age
        told = "never" if math.isnan(health.age) else f"not for {health.age:.1f} s"
        mismatch = sum(statistics.qos_mismatches.values())
        mend = " A publisher's QoS does not match." if mismatch else ""
        return DiagnosticStatus.STALE, f"There was {told} a reading of {health.reading}.{mend}"
    if health.without_numbers > 0.0:
        share = 100.0 * health.without_numbers
        return (
            DiagnosticStatus.WARN,
            f"{share:.0f} % of the crank angles have no prediction; see the node's warnings.",
        )
    if log is not None and log.dropped:
        return DiagnosticStatus.WARN, f"{log.dropped} messages are not in the log."
    near = health.resonance
    if near is not None and near.state is ResonanceState.WARNING:
        return (
            DiagnosticStatus.WARN,
            f"{near.excitation} ({near.excitation_frequency:.1f} Hz) is within "
            f"{100.0 * abs(near.relative_margin):.1f} % of mode {near.mode + 1} "
            f"({near.natural_frequency:.1f} Hz).",
        )
    return DiagnosticStatus.OK, f"Predicting at {health.rate:.0f} Hz."


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
        "input rate [Hz]": f"{health.rate:.1f}",
        "without numbers [%]": f"{100.0 * health.without_numbers:.1f}",
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
