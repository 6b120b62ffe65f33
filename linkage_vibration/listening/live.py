# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares what sensors measure with what a table predicts there, once a second of their stamps."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Any

import numpy as np

from linkage_vibration.listening.amplitudes import measure_orders, predicted_levels, unit_responses
from linkage_vibration.listening.live_modes import NOTED, OFF, LiveModes
from linkage_vibration.listening.orders import SECONDS, Orders, levels, track_orders
from linkage_vibration.listening.sensor_response import SensorResponse
from linkage_vibration.listening.signals import SignalError, measured_signal
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.answers import LoadedModel
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.periods import second
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.sensors import LARGEST, Sensor

_SECOND = 10**9  # ns
_WINDOW = round(SECONDS * _SECOND)
_BEFORE = 0.05  # s before a window that its even samples may need
_LEAD = round(_BEFORE * _SECOND)
_KEPT = 2 * _WINDOW
_MOST = 100_000  # samples of a sensor that are kept; so many in 8 s are 12.5 kHz
_BY_ORDER = {  # fields of messages, and those of `MeasuredOrder`
    "order_levels": "measured",
    "order_stddevs": "measured_stddev",
    "predicted_levels": "predicted",
    "predicted_factors": "predicted_factor",
    "differences": "difference",
}


@dataclass(slots=True)
class _History:
    """The latest numbers by their times, ns."""

    pairs: deque[tuple[int, Any]] = field(default_factory=lambda: deque(maxlen=_MOST))

    def add(self, time: int, value: float | tuple[float, ...]) -> None:
        if self.pairs and time < self.pairs[-1][0] - _SECOND:  # the clock was set back
            self.pairs.clear()
        self.pairs.append((time, value))
        while self.pairs[0][0] < time - _KEPT:
            self.pairs.popleft()

    def since(self, start: int) -> tuple[FloatArray, FloatArray]:
        """Return ascending times since a start, s, (n,), and the values, (n,) or (n, k)."""
        pairs = sorted(self.pairs, key=itemgetter(0))
        times = np.array([time for time, _ in pairs], np.int64)
        return (times - start) / _SECOND, np.array([value for _, value in pairs], float)


@dataclass(slots=True)
class _Channel:
    sensor: Sensor
    transfer: SensorResponse = field(init=False)
    samples: _History = field(default_factory=_History)
    began: int = 0  # stamp of the first sample, ns


class SensorMonitor:
    """Compares samples of sensors with the table; speeds, rpm or m/s, go stale after a time, s."""

    def __init__(
        self,
        sensors: Sequence[Sensor],
        predictor: Predictor,
        mechanism: Mechanism,
        excitations: Sequence[Excitation],
        fixed: Mapping[Source, float],
        stale_after: float,
    ) -> None:
        self.fixed, self.stale_after = dict(fixed), stale_after
        self.modes = LiveModes(sensors, excitations)
        self._channels, self._excitations = list(map(_Channel, sensors)), tuple(excitations)
        self._speeds = {source: _History() for source in Source}
        self._angles = _History()
        self.use(predictor, mechanism)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the sensors."""
        return tuple(channel.sensor.name for channel in self._channels)

    def use(self, predictor: Predictor, mechanism: Mechanism) -> None:
        """Predict from another table from now on; samples are kept."""
        self._predictor, table = predictor, predictor.table
        self._highest = float(np.nanmax(table.evaluate(table.alpha3)[:, : table.n_modes]))
        self.modes.use(table, mechanism, self._highest)
        given = table, mechanism, self._excitations
        transfers = [SensorResponse(*given, channel.sensor) for channel in self._channels]
        for channel, transfer in zip(self._channels, transfers, strict=True):
            channel.transfer = transfer

    def set_speed(self, source: Source, value: float, time: int) -> None:
        """Take a speed, rpm or m/s, at a time, ns."""
        self._speeds[source].add(time, value if abs(value) < LARGEST else math.nan)

    def set_angle(self, alpha3: float, stamp: int) -> None:
        """Take a crank angle, rad, with its stamp, ns."""
        self._angles.add(stamp, alpha3 if abs(alpha3) < LARGEST else math.nan)

    def take(self, sensor: int, stamp: int, values: tuple[float, ...]) -> MessageColumns | None:
        """Take a sample; return ``MeasuredVibration`` if it is the first in a second, ns."""
        channel = self._channels[sensor]
        samples, message = channel.samples, None
        if samples.pairs:
            last, end = samples.pairs[-1][0], second(stamp)
            if not -_SECOND <= stamp - last <= _KEPT:
                channel.began = stamp
            elif end > second(last) and end - _WINDOW - _LEAD >= channel.began:
                message = self._compare(sensor, end)
        else:
            channel.began = stamp
        samples.add(stamp, values)
        self.modes.step(stamp)
        return message

    def _compare(self, sensor: int, end: int) -> MessageColumns:
        """Return what a sensor measured in the window before a time, ns, beside the prediction."""
        channel = self._channels[sensor]
        start, count = end - _WINDOW, len(self._excitations)
        times, readings = channel.samples.since(start)
        inside = (times >= -_BEFORE) & (times < SECONDS)
        angles, speeds = self._angles.since(start), self._known_speeds(start)
        message = MessageColumns(
            sensor=channel.sensor.name,
            crank_angle=float(_at(*angles, np.array([SECONDS / 2.0]), self.stale_after)[0]),
            doubts="",
            **dict.fromkeys(("rate", "level", "predicted_level"), math.nan),
            **{name: np.full(count, math.nan) for name in _BY_ORDER},
        )
        noted = _at(*angles, NOTED, self.stale_after)
        self.modes.add(end, noted, speeds, sensor, times, readings)
        self.modes.fill(message, end)
        try:
            signal = measured_signal(channel.sensor, times[inside], readings[inside], self._highest)
        except SignalError as error:
            message.doubts = str(error)
            return message
        doubts = list(signal.doubts)
        message.rate = signal.rate
        orders = track_orders(signal, self._excitations, speeds)
        if not speeds:
            doubts.append("No speed is known in its window; check the speeds, and its stamps.")
        if len(orders.times):
            message.level = float(levels(signal)[0])
            self._compare_orders(channel, message, orders, speeds)
        if math.isnan(message.level):
            doubts.append("Readings are missing in its window, so that no level is known.")
        message.doubts = " ".join(doubts)
        return message

    def _compare_orders(
        self,
        channel: _Channel,
        message: MessageColumns,
        orders: Orders,
        speeds: Mapping[Source, object],
    ) -> None:
        """Set what orders measure, and what is predicted of them where the crank angle is known."""
        excitations, transfer, units = self._excitations, channel.transfer, np.empty((1, 1, 0))
        angle = self._predictor.angle_in_table(message.crank_angle)
        if angle is not None:
            units = unit_responses(transfer, orders, np.array([angle]))
            levels, _ = predicted_levels(transfer, excitations, orders, units, speeds)
            message.predicted_level = float(levels[0])
        else:
            excitations = tuple(replace(excitation, load=None) for excitation in excitations)
        names = [excitation.name for excitation in excitations]
        for row in measure_orders(excitations, orders, units, transfer, fewest=1):
            for name, number in _BY_ORDER.items():
                getattr(message, name)[names.index(row.excitation.name)] = getattr(row, number)

    def _known_speeds(self, start: int) -> dict[Source, tuple[FloatArray, FloatArray]]:
        """Return times, s, and speeds, rpm or m/s, of those that are known in a whole window."""
        ends = np.array([-1.0, SECONDS])
        speeds = {source: (ends, np.full(2, value)) for source, value in self.fixed.items()}
        for source, history in self._speeds.items():
            times, values = history.since(start)
            times, values = times[times < SECONDS], values[times < SECONDS]
            if source in speeds or not len(times) or times[0] > -_BEFORE:
                continue
            times, values = np.append(times, SECONDS), np.append(values, values[-1])
            if np.diff(times)[times[1:] > -_BEFORE].max() <= self.stale_after:
                speeds[source] = times, values
        return speeds


def sensor_monitor(
    sensors: Sequence[Sensor],
    served: LoadedModel,
    excitations: Sequence[Excitation],
    settings: Parameters,
) -> SensorMonitor | None:
    """Return the monitor of sensors with the speeds that parameters fix; None without a sensor."""
    if not sensors:
        return None
    # The search for modes needs it; no reading should wait until it is imported.
    import scipy.signal  # noqa: F401

    speeds = {source: settings.fixed_speed(source) for source in Source}
    fixed = {source: speed for source, speed in speeds.items() if speed is not None}
    model = served.predictor, served.mechanism
    return SensorMonitor(sensors, *model, excitations, fixed, settings.stale_after)


def difference_sentence(message: MessageColumns, excitations: Sequence[Excitation]) -> str:
    """Return which order differs most from its prediction at a sensor, and what is doubtful."""
    differences, text = np.nan_to_num(np.abs(message.differences)), ""
    if len(differences) and differences.max() > OFF:
        most = int(differences.argmax())
        ratio = float(message.order_levels[most] / message.predicted_levels[most])
        bound = "" if math.isfinite(message.order_stddevs[most]) else "at most "
        text = (
            f"{message.sensor}: {excitations[most].name} is {bound}{ratio:.2g} times as strong as "
            f"predicted ({differences[most]:.1f} standard deviations). "
        )
    return f"{text}{message.sensor}: {message.doubts}" if message.doubts else text.rstrip()


def _at(times: FloatArray, values: FloatArray, at: FloatArray, stale_after: float) -> FloatArray:
    """Return angles at times, (n,); NaN where the readings beside them are too far apart."""
    if len(times) < 2:
        return np.full(len(at), math.nan)
    i = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    known = (at >= times[0]) & (at <= times[-1]) & (times[i] - times[i - 1] <= stale_after)
    return np.where(known, np.interp(at, times, values), math.nan)
