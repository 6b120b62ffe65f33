# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Resonances: which excitation is nearest to a natural frequency, and whether they approach."""

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.predictor import Prediction

FloatArray = NDArray[np.float64]
Integers = NDArray[np.int64]

# The least time between two values of which a rate is computed; a burst is delivered faster.
_SHORTEST = 5e-3  # s
_LATEST = 2**63 - 1  # ns


class ResonanceState(enum.IntEnum):
    """How near the nearest excitation is; the constants of the message."""

    CLEAR = 0
    WARNING = 1
    STALE = 2


@dataclass(frozen=True, slots=True)
class Resonance:
    """The excitation that is nearest to a natural frequency.

    Attributes
    ----------
    state : ResonanceState
        If it is STALE, every number below is NaN and the mode is 0.
    excitation : str
        Its name; empty when stale.
    mode : int
        Index of the natural frequency, from 0.
    excitation_frequency, natural_frequency : float
        Hz.
    margin, relative_margin : float
        Excitation minus natural frequency, Hz, and the same over the natural frequency, 1.
    approach : int
        1 if they approach each other, -1 if they separate, otherwise 0.
    time_to_crossing : float
        Time until they are equal at the present rates, s; infinite if they do not meet.
    table_id : str
        Identifies the table of the prediction.
    """

    state: ResonanceState
    excitation: str
    excitation_frequency: float
    mode: int
    natural_frequency: float
    margin: float
    relative_margin: float
    approach: int
    time_to_crossing: float
    table_id: str


@dataclass(frozen=True, slots=True, eq=False)
class Resonances:
    """Resonances by columns of shape (n,), whose names and units are those of `Resonance`.

    Attributes
    ----------
    excitation : ndarray
        Index of the excitation in the monitor; -1 if stale.
    state, excitation_frequency, mode, natural_frequency, margin : ndarray
    relative_margin, approach, time_to_crossing : ndarray
    """

    state: NDArray[np.uint8]
    excitation: Integers
    excitation_frequency: FloatArray
    mode: Integers
    natural_frequency: FloatArray
    margin: FloatArray
    relative_margin: FloatArray
    approach: NDArray[np.int8]
    time_to_crossing: FloatArray

    def rows(self, which: Integers | slice) -> "Resonances":
        """Return the resonances with these indices."""
        return Resonances(*(getattr(self, column.name)[which] for column in fields(self)))


@dataclass(frozen=True, slots=True)
class ReportedSpeed:
    """A speed that is reported among predictions.

    Attributes
    ----------
    before : int
        How many predictions precede it.
    source, value, time : Source, float and int
        As those of `ResonanceMonitor.set_speed`.
    """

    before: int
    source: Source
    value: float
    time: int


@dataclass(frozen=True, slots=True)
class _Speed:
    """The last reported value of a speed."""

    value: float
    time: int | None  # ns; None where it is fixed
    rate: float = 0.0  # per second
    earlier: tuple[float, int] = (0.0, 0)  # value and time (ns) from which the next rate counts


class ResonanceMonitor:
    """Compares excitation frequencies with predicted natural frequencies.

    It has no clock, so the same calls give the same answers, live or offline.

    Parameters
    ----------
    excitations : sequence of Excitation
    warning_margin : float
        Relative margin below which the state is WARNING, 1.
    hysteresis : float
        The warning ends when the margin exceeds `warning_margin` by this much, 1. The warning
        applies to the nearest pair, so it does not flicker if two pairs alternate.
    stale_after : float
        Older speeds are not used, s.
    """

    def __init__(
        self,
        excitations: Sequence[Excitation],
        warning_margin: float = 0.1,
        hysteresis: float = 0.02,
        stale_after: float = 1.0,
    ) -> None:
        self.excitations = tuple(excitations)
        self.warning_margin = warning_margin
        self.hysteresis = hysteresis
        self.stale_after = stale_after
        self._speeds: dict[Source, _Speed] = {}
        self._warning = False
        self.any_speed_reported = False  # without a speed there is nothing to assess

    def set_speed(self, source: Source, value: float, time: int) -> None:
        """Use a reported speed; its rate follows from the last two values.

        Parameters
        ----------
        source : Source
        value : float
            rpm or m/s; if it is negative, infinite or NaN, the speed becomes unknown.
        time : int
            When it was reported, ns. Values within 5 ms count as one for the rate, which restarts
            when the clock jumps back, or after `stale_after`.
        """
        self.any_speed_reported = True
        if not 0.0 <= value < math.inf:
            self._speeds.pop(source, None)
            return
        last = self._speeds.get(source)
        rate, earlier = 0.0, (value, time)
        if last is not None and last.time is not None:
            before, since = last.earlier
            apart = 1e-9 * (time - since)
            if 0.0 <= apart < _SHORTEST:
                rate, earlier = last.rate, last.earlier
            elif _SHORTEST <= apart < self.stale_after:
                rate = (value - before) / apart
        self._speeds[source] = _Speed(value, time, rate, earlier)

    def set_fixed(self, source: Source, value: float | None) -> None:
        """Fix a speed (rpm or m/s); with None, a fixed speed becomes unknown.

        Parameters
        ----------
        source : Source
        value : float, optional
        """
        last = self._speeds.get(source)
        if value is not None:
            self.any_speed_reported = True
            self._speeds[source] = _Speed(value, None)
        elif last is not None and last.time is None:
            del self._speeds[source]

    def assess(self, prediction: Prediction, velocity: float, time: int) -> Resonance:
        """Return the excitation that is nearest to a natural frequency.

        Parameters
        ----------
        prediction : Prediction
        velocity : float
            Of the crank, rad/s; if it is NaN, the crank is assumed to stand still.
        time : int
            When the prediction was made, by the clock of the speeds, ns.
        """
        fresh = self._fresh(time) if prediction.status.has_numbers else {}
        naturals = prediction.natural_frequencies.tolist()
        nearest, best, mode = math.inf, None, 0
        for excitation in self.excitations:
            speed = fresh.get(excitation.source)
            if speed is None or speed.value == 0.0:
                continue
            frequency = excitation.ratio * speed.value
            for i, natural in enumerate(naturals):
                apart = abs(frequency / natural - 1.0)
                if apart < nearest:
                    nearest, best, mode = apart, excitation, i
        if best is None:
            self._warning = False
            nan, stale = math.nan, ResonanceState.STALE
            return Resonance(stale, "", nan, 0, nan, nan, nan, 0, nan, prediction.table_id)
        limit = self.warning_margin + (self.hysteresis if self._warning else 0.0)
        self._warning = nearest < limit
        speed = fresh[best.source]
        frequency, natural = best.ratio * speed.value, naturals[mode]
        margin = frequency - natural
        known = velocity == velocity  # it is not NaN
        turning = float(prediction.frequency_slopes[mode]) * velocity if known else 0.0
        rate = best.ratio * speed.rate - turning
        closing = float(-rate if margin > 0.0 else rate)  # Hz/s, rate at which the distance shrinks
        return Resonance(
            state=ResonanceState.WARNING if self._warning else ResonanceState.CLEAR,
            excitation=best.name,
            excitation_frequency=frequency,
            mode=mode,
            natural_frequency=natural,
            margin=margin,
            relative_margin=margin / natural,
            approach=(closing > 0.0) - (closing < 0.0),
            time_to_crossing=abs(margin) / closing if closing > 0.0 else math.inf,
            table_id=prediction.table_id,
        )

    def assess_many(
        self,
        natural_frequencies: FloatArray,
        frequency_slopes: FloatArray,
        velocity: FloatArray,
        time: Integers,
        speeds: Sequence[ReportedSpeed],
    ) -> Resonances:
        """Return what calls of `set_speed` and `assess` give, to the last bit.

        Parameters
        ----------
        natural_frequencies, frequency_slopes : ndarray, (n, n_modes)
            Of the predictions, Hz and Hz/rad; NaN where a prediction has no numbers.
        velocity : ndarray, (n,)
            Of the crank, rad/s; NaN where it is unknown.
        time : ndarray, (n,)
            When the predictions were made, ns.
        speeds : sequence of ReportedSpeed
            In the order in which they were reported.
        """
        n = len(time)
        value, rate = self._speeds_at(time, speeds)
        naturals = np.ascontiguousarray(natural_frequencies.T)
        nearest = np.full(n, math.inf)
        best, mode = np.full(n, -1), np.zeros(n, np.int64)
        with np.errstate(all="ignore"):  # as Python computes
            for k, excitation in enumerate(self.excitations):
                frequency = excitation.ratio * value[excitation.source]
                for i, natural in enumerate(naturals):
                    apart = np.abs(frequency / natural - 1.0)
                    nearer = apart < nearest
                    np.copyto(nearest, apart, where=nearer)
                    np.copyto(best, k, where=nearer)
                    np.copyto(mode, i, where=nearer)
            stale = best < 0
            warning = self._warnings(nearest, stale)
            frequency, following = np.full(n, math.nan), np.full(n, math.nan)
            for k, excitation in enumerate(self.excitations):
                for column, out in ((value, frequency), (rate, following)):
                    np.multiply(excitation.ratio, column[excitation.source], out, where=best == k)
            rows = np.arange(n)
            natural = np.where(stale, math.nan, natural_frequencies[rows, mode])
            margin = frequency - natural
            turning = frequency_slopes[rows, mode] * velocity
            change = following - np.where(np.isnan(velocity), 0.0, turning)
            closing = np.where(margin > 0.0, -change, change)
            crossing = np.where(closing > 0.0, np.abs(margin) / closing, math.inf)
            crossing[stale] = math.nan
            return Resonances(
                state=np.where(stale, ResonanceState.STALE, warning).astype(np.uint8),
                excitation=best,
                excitation_frequency=frequency,
                mode=mode,
                natural_frequency=natural,
                margin=margin,
                relative_margin=margin / natural,
                approach=(closing > 0.0).astype(np.int8) - (closing < 0.0),
                time_to_crossing=crossing,
            )

    def _speeds_at(
        self, time: Integers, speeds: Sequence[ReportedSpeed]
    ) -> tuple[dict[Source, FloatArray], dict[Source, FloatArray]]:
        """Use reported speeds; return the speeds at each time (NaN if unknown) and their rates."""
        histories = {source: [(0, self._speeds.get(source))] for source in Source}
        for one in speeds:
            self.set_speed(one.source, one.value, one.time)
            histories[one.source].append((one.before, self._speeds.get(one.source)))
        limit = math.floor(min(1e9 * self.stale_after, _LATEST))
        values, rates = {}, {}
        for source, history in histories.items():
            known = [_Speed(math.nan, None) if speed is None else speed for _, speed in history]
            begins = [before for before, _ in history]
            valid = np.repeat(np.arange(len(known)), np.diff([*begins, len(time)]))
            value = np.array([speed.value or math.nan for speed in known])[valid]
            fixed = np.array([speed.time is None for speed in known])[valid]
            age = time - np.array([speed.time or 0 for speed in known])[valid]
            value[~(fixed | ((-limit <= age) & (age <= limit)))] = math.nan
            values[source], rates[source] = value, np.array([s.rate for s in known])[valid]
        return values, rates

    def _warnings(self, nearest: FloatArray, stale: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return where the state is WARNING; between both limits it stays as it was before."""
        begins = nearest < self.warning_margin
        ends = stale | ~(nearest < self.warning_margin + self.hysteresis)
        last = np.maximum.accumulate(np.where(begins | ends, np.arange(len(nearest)), -1))
        warning = np.where(last < 0, self._warning, begins[last])
        if len(warning):
            self._warning = bool(warning[-1])
        return warning

    def _fresh(self, time: int) -> dict[Source, _Speed]:
        """Return the speeds that are not stale, before or after a jump of the clock."""
        limit = 1e9 * self.stale_after
        return {
            source: speed
            for source, speed in self._speeds.items()
            if speed.time is None or -limit <= time - speed.time <= limit
        }
