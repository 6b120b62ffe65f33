# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measured orders beside predicted ones, and the amplitudes of excitations that follow."""

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass

import numpy as np

from linkage_vibration.listening.orders import Orders
from linkage_vibration.listening.sensor_response import SensorResponse
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.loads import given_kinds

FEWEST = 5  # windows of a drive in which an order is detected
# An order is detected if what noise leaves of its mean square exceeds so many standard deviations,
# and if its mean square exceeds noise so many times: a mode that noise shakes is a line, too.
_DETECTED, _ABOVE = 2.0, 4.0
AGREES = 2.0  # standard deviations within which measured and predicted agree
_SURE = 1.0  # the largest relative standard deviation in a file of excitations
_LEAST = 1e-300


@dataclass(frozen=True, slots=True)
class MeasuredOrder:
    """An order over a drive; numbers that are not known are NaN."""

    excitation: Excitation
    windows: int  # in which it stands alone
    measured: float  # rms, m/s^2 or N; the largest possible if not detected
    measured_stddev: float
    predicted: float  # likewise
    predicted_factor: float  # exp of the standard deviation of its logarithm
    amplitude: float  # of the excitation at its reference speed, SI
    relative_stddev: float  # of the amplitude
    is_detected: bool  # it stands out of the noise

    @property
    def difference(self) -> float:
        """Logarithm of measured over predicted, over its standard deviation; NaN if not known.

        Of an order that is not detected, it is the largest possible if that is negative.
        """
        if not self.predicted > 0.0 or not (
            self.is_detected or 0.0 < self.measured < self.predicted
        ):
            return math.nan
        noise = self.measured_stddev / self.measured if self.is_detected else 0.0
        stddev = math.hypot(math.log(self.predicted_factor), noise)
        return math.log(self.measured / self.predicted) / stddev if stddev else math.nan

    @property
    def contradicts(self) -> bool:
        """Whether measured and predicted differ by more than their deviations allow."""
        return abs(self.difference) > AGREES

    @property
    def is_compared(self) -> bool:
        """Whether it is known if it agrees; noise that is below the prediction may hide less."""
        return self.contradicts or (self.is_detected and not math.isnan(self.difference))


def unit_responses(transfer: SensorResponse, orders: Orders, angles: FloatArray) -> FloatArray:
    """Return amplitudes at a sensor per unit, (m, 1 + n_members, n_loaded); angles (m,) in rad."""
    if not transfer.loaded:
        return np.empty((len(angles), 1, 0))
    first, last = transfer.alpha3_range
    omega = 2.0 * math.pi * orders.frequencies[:, transfer.loaded]
    rows = [
        transfer.gains(angle, w)
        if first <= angle <= last
        else np.full((1 + transfer.n_members, len(w)), math.nan)
        for angle, w in zip(angles.tolist(), omega, strict=True)
    ]
    return np.array(rows).reshape(len(rows), 1 + transfer.n_members, len(transfer.loaded))


def predicted_levels(
    transfer: SensorResponse,
    excitations: Sequence[Excitation],
    orders: Orders,
    units: FloatArray,
    known: Container[Source],
) -> tuple[FloatArray, FloatArray]:
    """Return the predicted rms of all orders whose loads and speeds are known, m/s or N, (m,).

    It is NaN in windows in which one of these speeds is not known, and everywhere without any or
    if one acts across the plane. The mean square of each, (m, n_excitations), is 0 without a load.
    """
    squares, any_known = np.zeros(orders.squares.shape), False
    across = any(each.load and each.load.across for each in excitations)
    for column, i in enumerate(transfer.loaded):
        load, speed = excitations[i].load, orders.speeds[:, i]
        if load is None or excitations[i].source not in known:
            continue
        amplitude, any_known = units[:, 0, column] * load.amplitude, True
        with np.errstate(invalid="ignore", divide="ignore"):  # of a shaft at rest
            amplitude = amplitude * (speed / load.speed) ** load.exponent
            if transfer.sensor.accelerates:
                amplitude = amplitude / (2.0 * math.pi * orders.frequencies[:, i])
        squares[:, i] = np.where(speed == 0.0, 0.0, amplitude**2 / 2.0)
    unknown = math.nan if across or not any_known else 0.0
    return np.sqrt(squares.sum(axis=1)) + unknown, squares


def measure_orders(
    excitations: Sequence[Excitation],
    orders: Orders,
    units: FloatArray,
    transfer: SensorResponse,
    fewest: int = FEWEST,
) -> list[MeasuredOrder]:
    """Return orders, by `unit_responses`; one is detected in at least the fewest windows."""
    n_members, rows = units.shape[1] - 1, []
    for i, excitation in enumerate(excitations):
        squares, noise = orders.squares[:, i], orders.noise[:, i]
        scale = np.full((len(squares), 1 + n_members), math.nan)
        if excitation.load is not None and i in transfer.loaded:
            relative = (orders.speeds[:, i] / excitation.load.speed) ** excitation.load.exponent
            scale = units[:, :, transfer.loaded.index(i)] * relative[:, np.newaxis]
        valid = np.isfinite(squares)
        if excitation.load is not None:
            valid &= np.isfinite(scale).all(axis=1) & (scale > 0.0).all(axis=1)
        if valid.any():
            windows = squares[valid], noise[valid], scale[valid]
            rows.append(_row(excitation, windows, transfer.amplitudes[i, :n_members], fewest))
    return rows


def _row(
    excitation: Excitation, windows: tuple[FloatArray, ...], factors: FloatArray, fewest: int
) -> MeasuredOrder:
    """Return an order by squares of amplitudes and noise, (m,), and amplitudes per unit, (m, k)."""
    squares, noise, scale = windows
    m, net = len(squares), squares - noise
    mean = float(net.mean())
    # A line of amplitude a in complex noise of variance s: var |A|^2 = 2 a^2 s + s^2.
    stddev = float(np.sqrt((2.0 * np.maximum(net, 0.0) * noise + noise**2).sum())) / m
    detected = m >= fewest and mean > _DETECTED * stddev
    detected = detected and float(squares.mean()) > _ABOVE * float(noise.mean())
    rms = math.sqrt((mean if detected else float(squares.mean())) / 2.0)
    amplitude = relative = predicted = factor = math.nan
    if excitation.load is not None:
        gains = np.sqrt((scale**2).mean(axis=0) / 2.0)
        predicted = excitation.load.amplitude * float(gains[0])
        spread = np.log(np.maximum(gains[1:] * factors, _LEAST))
        factor = math.exp(float(spread.std()) if len(spread) else excitation.load.relative_stddev)
        if detected:
            amplitude, relative = _amplitude(net, noise, scale)
    deviation = stddev / (4.0 * rms) if detected else math.nan
    level = excitation, m, rms, deviation, predicted, factor
    return MeasuredOrder(*level, amplitude, relative, detected)


def _amplitude(net: FloatArray, noise: FloatArray, scale: FloatArray) -> tuple[float, float]:
    """Return an amplitude, weighted by windows, and its relative scatter over them and members."""
    each = net[:, np.newaxis] / scale**2  # (m, k): squares of the amplitude
    members = np.log(scale[:, 1:]).std(axis=1) if scale.shape[1] > 1 else np.zeros(len(net))
    size = max(float(np.median(np.abs(each[:, 0]))), _LEAST)
    weak = noise / (scale[:, 0] ** 2 * size)  # of the square that noise makes
    weights = 1.0 / (2.0 * weak + weak**2 + (2.0 * members) ** 2 + 1e-4)
    weights /= weights.sum()
    square, *others = (weights @ each).tolist()
    if square <= 0.0:
        return math.nan, math.nan
    scatter = float(np.sqrt((weights**2 * (each[:, 0] - square) ** 2).sum())) / square
    model = float(np.log(np.maximum(others, _LEAST)).std()) if others else 0.0
    return math.sqrt(square), math.hypot(scatter, model) / 2.0


def amplitude_numbers(
    rows: Sequence[MeasuredOrder], content: dict[str, dict[str, object]]
) -> list[tuple[list[str], list[str]]]:
    """Return keys and words to change in a file of excitations, of orders that are well known."""
    sure = {row.excitation.name: row for row in rows if row.relative_stddev <= _SURE}
    numbers = []
    for name, entry in content.items():
        kind = next((kind.key for kind in given_kinds(entry)), "")
        orders = entry.get("orders")
        if not kind or not isinstance(orders, list):
            continue
        measured = [sure.get(f"{name} {order:g}") for order in orders]
        if not any(measured):
            continue
        old, spread = entry[kind], entry.get("amplitude_stddev", 0.0)
        assert isinstance(old, list)
        spreads = spread if isinstance(spread, list) else [spread] * len(old)
        values = [
            f"{row.amplitude:.4g}" if row else f"{was:.6g}"
            for row, was in zip(measured, old, strict=True)
        ]
        words = [
            f"{row.relative_stddev:.2g}" if row else f"{was:g}"
            for row, was in zip(measured, spreads, strict=True)
        ]
        numbers += [([name, kind], values), ([name, "amplitude_stddev"], words)]
    return numbers
