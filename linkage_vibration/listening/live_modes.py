# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Identifies modes while a drive goes on, in small parts, so that no reading waits for them."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from linkage_vibration.listening.drive_modes import DriveMode, search_signals
from linkage_vibration.listening.model_check import difference_text, explanations
from linkage_vibration.listening.orders import SECONDS
from linkage_vibration.listening.output_only import PausableTask
from linkage_vibration.listening.segments import ACROSS
from linkage_vibration.listening.signals import SignalError, measured_signal
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.paths import split_paths
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.readers.sensors import Sensor
from linkage_vibration.table.table import Table

OFF = 2.0  # standard deviations beyond which an order or a mode is named
_SETTLED = SECONDS - 2.0  # s: the second of a window whose readings have all arrived begins here
NOTED = _SETTLED + np.arange(10) / 10.0
"""s since the beginning of a window: when the angle and the speeds are noted."""

_SECOND = 10**9  # ns
_EVERY, _LONGEST = 30 * _SECOND, 120 * _SECOND  # ns, of searches
_PART = _SECOND // 50  # ns of the stamps, between two parts of a search
_LEAST = 60.0  # s, for which the crank hardly moves
_FASTEST = 1000  # Hz of a sensor
_BY_MODE = {  # ends of fields of messages, and fields of `DriveMode`
    "frequencies": "frequency",
    "stddevs": "frequency_stddev",
    "damping_ratios": "ratio",
    "damping_stddevs": "ratio_stddev",
    "predictions": "predicted",
    "differences": "difference",
}
_NAMED = 2  # numbers that may explain a difference


class LiveModes:
    """Seeks modes by all accelerations, every half minute of the stamps, at the present angle."""

    def __init__(self, sensors: Sequence[Sensor], excitations: Sequence[Excitation]) -> None:
        self._sensors, self._excitations = tuple(sensors), tuple(excitations)
        # Ends of windows, ns, with angles and speeds, and with times before the end and readings.
        self._notes: deque[tuple[int, FloatArray, Any]] = deque()
        self._parts: list[deque[tuple[int, FloatArray, Any]]] = [deque() for _ in sensors]
        self._searched = self._stepped = 0  # ns: the end of the last search, and its latest step

    def use(self, table: Table, mechanism: Mechanism, highest: float) -> None:
        """Seek modes of another table, up to a frequency, Hz, from now on."""
        self._table, self._mechanism, self._highest = table, mechanism, highest
        self._modes: tuple[DriveMode, ...] = ()
        self._search: PausableTask[tuple[DriveMode, ...]] | None = None

    def add(
        self,
        end: int,
        angles: FloatArray,
        speeds: Mapping[Source, tuple[FloatArray, FloatArray]],
        sensor: int,
        times: FloatArray,
        readings: FloatArray,
    ) -> None:
        """Take a sensor's window that ends at a time, ns, with angles at `NOTED`; search if due."""
        if self._notes and end < self._notes[-1][0]:  # the clock was set back
            self._modes, self._search = (), None
            for each in (self._notes, *self._parts):
                each.clear()
        if not self._notes or end > self._notes[-1][0]:
            rows = {source: np.interp(NOTED, *speed) for source, speed in speeds.items()}
            self._notes.append((end, angles, rows))
        inside = (times >= _SETTLED) & (times < _SETTLED + 1.0)
        described, parts = self._sensors[sensor], self._parts[sensor]
        if described.accelerates and inside.sum() <= _FASTEST:
            parts.append((end, times[inside] - SECONDS, readings[inside]))
        for kept in (self._notes, parts):
            while kept and kept[0][0] <= end - _LONGEST:
                kept.popleft()
        if end % _EVERY == 0 and end != self._searched and self._search is None:
            self._searched, self._modes = end, ()
            self._search = self._find(end)

    def step(self, stamp: int) -> None:
        """Go on with a search at the stamp of a sample, ns."""
        if self._search is not None and abs(stamp - self._stepped) >= _PART:
            self._stepped = stamp
            try:
                next(self._search)
            except StopIteration as finished:
                self._modes, self._search = finished.value, None

    def _find(self, end: int) -> PausableTask[tuple[DriveMode, ...]]:
        """Return the modes at the present crank angle, before a time, ns."""
        since = [(stamp - end) / _SECOND - SECONDS for stamp, _, _ in self._notes]
        times = np.add.outer(since, NOTED).ravel()
        angles = np.concatenate([angle for _, angle, _ in self._notes])
        near = np.abs(angles - angles[-1]) <= ACROSS / 2.0
        if near.sum() < _LEAST * len(NOTED):
            return ()
        unknown = np.full(len(NOTED), math.nan)
        rows = [row for _, _, row in self._notes]
        speeds = {
            source: (times, np.concatenate([row.get(source, unknown) for row in rows]))
            for source in Source
        }
        signals = []
        for sensor, parts in zip(self._sensors, self._parts, strict=True):
            if parts:
                yield
                shifted = [(t + (stamp - end) / _SECOND, values) for stamp, t, values in parts]
                t, readings = (np.concatenate(each) for each in zip(*shifted, strict=True))
                with suppress(SignalError):
                    signals.append(measured_signal(sensor, t, readings, self._highest))
        if not signals:
            return ()
        yield
        crank_angle = times, np.where(near, angles, math.nan)
        model = self._table, self._mechanism
        search = search_signals(
            *model, signals, crank_angle, speeds, self._excitations, damped=False
        )
        return (yield from search)

    def fill(self, message: MessageColumns, end: int) -> None:
        """Set the fields of the modes that were found last, in a message of a time, ns."""
        message.modes_crank_angle = message.modes_age = math.nan
        if self._modes:
            message.modes_crank_angle = self._modes[0].alpha3
            message.modes_age = (end - self._searched) / _SECOND
        sure = [mode for mode in self._modes if not mode.doubt]
        for name, number in _BY_MODE.items():
            column = np.full(self._table.n_modes, math.nan)
            column[[mode.mode for mode in sure]] = [getattr(mode, number) for mode in sure]
            setattr(message, f"mode_{name}", column)
        label = self._table.mode_label
        doubts = [f"{label(each.mode)}: {each.doubt}." for each in self._modes if each.doubt]
        message.mode_doubts = " ".join(doubts)

    @property
    def compared(self) -> int:
        """How many modes are compared with their predictions."""
        return sum(not mode.doubt and mode.consistent is not None for mode in self._modes)

    def sentence(self) -> str:
        """Return which mode differs most from its prediction, and what may explain it."""
        differing = [m for m in self._modes if not m.doubt and abs(m.difference) > OFF]
        if not differing:
            return ""
        worst = max(differing, key=lambda each: abs(each.difference))
        text = difference_text(worst, self._table.mode_names[worst.mode])
        likely = explanations(self._table, self._mechanism, [worst])[:_NAMED]
        names = " or ".join(split_paths(each.path)[0] for each in likely)
        return f"{text} Is it {names}?" if names else text
