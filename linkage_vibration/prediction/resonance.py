# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Resonances: which excitation shakes most or is nearest to a mode, and whether it warns."""

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from linkage_vibration.messages.columns import MessageColumns, joined
from linkage_vibration.prediction.batch import predict_many
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.levels import LevelTable, unknown_levels
from linkage_vibration.prediction.motion import Rate, speed_filter
from linkage_vibration.prediction.predictor import Prediction, Predictor, one_row

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
Integers = NDArray[np.int64]

_LATEST = 2**63 - 1  # ns
_NO_PERIOD = -(2**63)
_LEAST_MARGIN = 1e-300
_LOOKED_AT = 65  # angles of the range
_CONSTANT = Rate(0.0, 0.0)
_TURN = 2.0 * math.pi
_CHUNK = 512  # predictions that are assessed together, so that their numbers stay in the cache


class ResonanceState(enum.IntEnum):
    """How near the nearest excitation is; the constants of the message."""

    CLEAR = 0
    WARNING = 1
    STALE = 2
    NOTE = 3


_RANKS = np.array([0, 2, -1, 1])  # of the states by their numbers; the highest is reported


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

    value: float  # NaN if it is not known
    time: int | None  # ns; None where it is fixed
    rate: Rate = _CONSTANT  # per second


_UNKNOWN_SPEED = _Speed(math.nan, None)


@dataclass(frozen=True, slots=True)
class _Moving:
    """Quantities with their rates and the bounds of the errors of these, each (..., n)."""

    value: FloatArray
    rate: FloatArray
    error: FloatArray

    def at(self, rows: slice) -> "_Moving":
        """Return those with these indices."""
        return _Moving(self.value[..., rows], self.rate[..., rows], self.error[..., rows])


@dataclass(frozen=True, slots=True)
class WarningLimits:
    """When an excitation warns.

    Attributes
    ----------
    level : float
        Velocity of the response point, m/s rms; where it is known, nothing else counts.
    probability : float
        That the excitation lies within the half-power band of its nearest mode, 1; it counts where
        no level is known.
    margin : float
        Relative margin to that mode, 1; it counts where neither is known.
    hysteresis : float
        A warning by the margin ends when this exceeds ``margin`` by so much, 1; one by level or
        probability ends at the same share of its limit, margin / (margin + hysteresis).
    dwell : float
        Until the limit has been exceeded for so long, s, there is a note instead of a warning. It
        remains a note until the mode has had time to build up, 1 / (zeta omega), unless the speed
        changes so slowly that the excitation needs longer to pass the half-power band. Where the
        level counts, the distance from the mode adds to its width, as forced vibration builds up
        faster beside a mode.
    """

    level: float = 5e-3
    probability: float = 0.1
    margin: float = 0.1
    hysteresis: float = 0.02
    dwell: float = 0.0

    @property
    def release(self) -> float:
        """Share of a limit at which a warning ends."""
        return self.margin / (self.margin + self.hysteresis) if self.margin > 0.0 else 1.0


def half_power_probability(
    frequency: FloatArray,
    frequency_stddev: FloatArray,
    natural: FloatArray,
    natural_stddev: FloatArray,
    zeta: FloatArray,
) -> FloatArray:
    """Return the probability that excitations lie within the half-power bands of modes.

    The band of a natural frequency f is f (1 - zeta) to f (1 + zeta). Both frequencies are normal
    and independent. All arrays have the same shape.

    Parameters
    ----------
    frequency, frequency_stddev : ndarray
        Of the excitations, Hz.
    natural, natural_stddev, zeta : ndarray
        Natural frequencies, their standard deviations, Hz, and damping ratios, 1.
    """
    low, high = 1.0 - zeta, 1.0 + zeta
    variance = frequency_stddev * frequency_stddev
    below = np.sqrt(variance + (low * natural_stddev) ** 2)
    above = np.sqrt(variance + (high * natural_stddev) ** 2)
    upper = ndtr((high * natural - frequency) / above)
    return np.asarray(upper - ndtr((low * natural - frequency) / below))


def never_warned(predictor: Predictor, limit: float) -> str:
    """Return a sentence that names modes for which the probability cannot reach a limit, or "".

    An excitation that equals the natural frequency gives the largest probability; it is small if
    the half-power band is much narrower than the standard deviation of the natural frequency.

    Parameters
    ----------
    predictor : Predictor
    limit : float
        As `WarningLimits.probability`.
    """
    table = predictor.table
    angles = np.linspace(*table.alpha3_range, _LOOKED_AT)
    predictions = predict_many(predictor, angles, np.zeros(_LOOKED_AT))
    naturals, stddevs = predictions.natural_frequencies, predictions.frequency_stddev
    with np.errstate(all="ignore"):
        largest = half_power_probability(
            naturals, 0.0 * naturals, naturals, stddevs, predictions.damping_ratios
        )
    reached = (largest >= limit).any(axis=0) | ~(stddevs > 0.0).any(axis=0)
    names = [table.mode_label(int(mode)) for mode in np.flatnonzero(~reached)]
    if not names:
        return ""
    return (
        f"{', '.join(names)}: the natural frequency is so uncertain for its damping that the "
        f"probability of a resonance never reaches warning_probability, {limit:g}, so no "
        "excitation without an amplitude warns there. Lower it, or give amplitudes."
    )


class ResonanceMonitor:
    """Compares excitation frequencies with predicted natural frequencies, and levels with limits.

    It has no clock, so the same calls give the same answers, live or offline.

    Parameters
    ----------
    excitations : sequence of Excitation
    limits : WarningLimits
    stale_after : float
        Older speeds are not used, s.
    levels : LevelTable, optional
        Levels of the excitations. Without it, levels and probabilities are not known.
    rate : float
        How often at most predictions are assessed, Hz; 0 for each.
    """

    def __init__(
        self,
        excitations: Sequence[Excitation],
        limits: WarningLimits = WarningLimits(),
        stale_after: float = 1.0,
        levels: LevelTable | None = None,
        rate: float = 0.0,
    ) -> None:
        self.excitations = tuple(excitations)
        self.limits = limits
        self.stale_after = stale_after
        self.levels = levels
        self.rate = rate
        self._period = _NO_PERIOD
        ratios = [(one.ratio, one.relative_stddev) for one in self.excitations]
        self._ratios, self._stddevs = np.array(ratios).T[..., np.newaxis]
        self._sources = np.array([list(Source).index(one.source) for one in self.excitations])
        self._warns = np.array([[one.warns] for one in self.excitations])
        self._names = np.array([*(one.name for one in self.excitations), ""])  # -1: none
        self._speeds = dict.fromkeys(Source, _UNKNOWN_SPEED)
        self._filters = {source: speed_filter(source) for source in Source}
        # Of each excitation: whether it exceeds its limit, and since when, ns.
        self._exceeds = np.zeros((len(self.excitations), 1), np.bool_)
        self._since = np.zeros((len(self.excitations), 1), np.int64)
        self.any_speed_reported = False  # without a speed there is nothing to assess

    def set_speed(self, source: Source, value: float, time: int) -> None:
        """Use a reported speed; its rate is estimated as `RateFilter` describes.

        Parameters
        ----------
        source : Source
        value : float
            rpm or m/s; if it is infinite or NaN, or if that of a shaft is negative, the speed
            becomes unknown. A ground speed is negative in reverse; its magnitude counts.
        time : int
            When it was reported, ns.
        """
        self.any_speed_reported, value = True, float(value)
        rate = self._filters[source].add(time, value)
        if source is Source.GROUND and value < 0.0:
            value, rate = -value, Rate(-rate.value, rate.error)
        fits = 0.0 <= value < math.inf
        self._speeds[source] = _Speed(value, time, rate) if fits else _UNKNOWN_SPEED

    def set_fixed(self, source: Source, value: float | None) -> None:
        """Fix a speed (rpm or m/s); with None, a fixed speed becomes unknown.

        Parameters
        ----------
        source : Source
        value : float, optional
        """
        if value is not None:
            self.any_speed_reported = True
            self._speeds[source] = _Speed(value, None)
        elif self._speeds[source].time is None:
            self._speeds[source] = _UNKNOWN_SPEED

    def due(self, stamps: Integers) -> BoolArray:
        """Return which readings are to be assessed, once a speed is reported: one in each period.

        It is the first after the periods of `rate`, counted from a stamp of 0, have changed, also
        where the clock jumps back. Readings with the same stamp are never assessed twice.

        Parameters
        ----------
        stamps : ndarray, (n,)
            Those of the next readings, ns, in the order in which the readings arrive.
        """
        if not self.rate:
            return np.ones(len(stamps), np.bool_)
        periods = np.concatenate([[self._period], stamps // round(1e9 / self.rate)])
        self._period = int(periods[-1])
        return np.asarray(periods[1:] != periods[:-1])

    def assess(
        self, prediction: Prediction, velocity: float, time: int, velocity_error: float = 0.0
    ) -> MessageColumns:
        """Return the most severe excitation, and the levels of all, as one ``Resonance``.

        Parameters
        ----------
        prediction : Prediction
        velocity : float
            Of the crank, rad/s; NaN if it is not known.
        time : int
            When the prediction was made, by the clock of the speeds, ns.
        velocity_error : float
            Bound of the error of the velocity, rad/s.
        """
        times, velocities = np.array([time]), np.array([velocity])
        errors = np.array([velocity_error], float)
        resonances = self.assess_many(one_row(prediction), velocities, times, (), errors)
        resonance = resonances.message(0)
        resonance.state = ResonanceState(resonance.state)
        return resonance

    def assess_many(
        self,
        predictions: MessageColumns,
        velocity: FloatArray,
        time: Integers,
        speeds: Sequence[ReportedSpeed],
        velocity_error: FloatArray,
    ) -> MessageColumns:
        """Return the ``Resonance`` of each prediction, while speeds are reported among them.

        An excitation is as severe as its level of vibration over the limit; where its level is not
        known, as the probability that it lies in the half-power band of its nearest mode over that
        limit; where this is not known either, as the limit of the margin over the margin.

        Parameters
        ----------
        predictions : MessageColumns
            n of them, with their ``frequency_slopes``.
        velocity, velocity_error : ndarray, (n,)
            Of the crank, and bounds of its errors, rad/s; NaN where it is unknown.
        time : ndarray, (n,)
            When the predictions were made, by the clock of the speeds, ns.
        speeds : sequence of ReportedSpeed
            In the order in which they were reported.
        """
        reported = self._speeds_at(time, speeds)
        crank = _Moving(predictions.crank_angle, velocity, velocity_error)
        n = len(time)
        with np.errstate(all="ignore"):
            if n <= _CHUNK:
                return self._assess(predictions, crank, time, reported)
            parts = []
            for start in range(0, n, _CHUNK):
                rows = slice(start, start + _CHUNK)
                chunks = predictions.rows(rows), crank.at(rows), time[rows], reported.at(rows)
                parts.append(self._assess(*chunks))
            return joined(parts)

    def _assess(
        self, predictions: MessageColumns, crank: _Moving, time: Integers, speeds: _Moving
    ) -> MessageColumns:
        """Return the resonances of n predictions; axes are excitations and predictions."""
        naturals, stddevs = predictions.natural_frequencies, predictions.frequency_stddev
        levels = self._levels(predictions, speeds.value)
        frequency = self._ratios * speeds.value[self._sources]
        # A mode without a natural frequency is infinitely far away.
        apart = np.fmin(np.abs(frequency / naturals.T[:, np.newaxis] - 1.0), math.inf)
        mode, nearest = apart.argmin(axis=0), apart.min(axis=0)
        places = np.arange(len(time))
        at = mode + places * naturals.shape[1]
        natural, zeta = naturals.take(at), predictions.damping_ratios.take(at)
        slope = predictions.frequency_slopes.take(at)
        rate = self._ratios * speeds.rate[self._sources] - slope * crank.rate
        error = self._ratios * speeds.error[self._sources] + np.abs(slope) * crank.error
        probability = np.full(frequency.shape, math.nan)
        if self.levels is not None and self.levels.states_uncertainty:
            spread = frequency * self._stddevs
            stddev = stddevs.take(at)
            probability = half_power_probability(frequency, spread, natural, stddev, zeta)
        level = levels.velocities.T.astype(float)
        severity = self._severities(level, probability, nearest)
        known = nearest < math.inf
        exceeds, held = self._follow(known, severity, time)
        width, off = zeta * natural, np.where(np.isnan(level), 0.0, frequency - natural)
        state = self._states(exceeds, held, width * width + off * off, np.abs(rate) - error)
        state[~known] = ResonanceState.STALE
        rank = _RANKS[state]
        highest = rank.max(axis=0)
        worst = np.where(rank == highest, severity, -math.inf).argmax(axis=0)
        stale = highest < 0
        at = worst * len(time) + places
        spread = levels.velocity_stddevs.T
        chosen = np.array([frequency, natural, rate, error, probability, level, spread])
        chosen = chosen.reshape(len(chosen), -1).take(at, axis=1)
        chosen[:, stale] = math.nan
        frequency, natural, rate, error, probability, level, spread = chosen
        margin = frequency - natural
        closing = np.where(margin > 0.0, -rate, rate)
        approach = (closing > error).astype(np.int8) - (closing < -error)
        parts = (approach < 0) | ((closing == 0.0) & (error == 0.0))
        crossing = np.where(parts, math.inf, math.nan)
        np.copyto(crossing, np.abs(margin) / closing, where=approach > 0)
        columns = MessageColumns(
            state=np.where(stale, ResonanceState.STALE, state.take(at)).astype(np.uint8),
            excitation=self._names[np.where(stale, -1, worst)],
            excitation_frequency=frequency,
            mode=np.where(stale, 0, mode.take(at)),
            natural_frequency=natural,
            margin=margin,
            relative_margin=margin / natural,
            approach=approach,
            time_to_crossing=crossing,
            table_id=predictions.table_id,
            probability=probability,
            velocity=level,
            velocity_stddev=spread,
            states=state.T,
            approach_rate=closing,
            approach_rate_error=error,
            crank_velocity=crank.rate,
            crank_velocity_error=crank.error,
        )
        vars(columns).update(vars(levels))
        return columns

    def _levels(self, predictions: MessageColumns, speeds: FloatArray) -> MessageColumns:
        """Return the levels of all excitations; NaN without a level table."""
        if self.levels is None:
            return unknown_levels(len(self.excitations), len(predictions.crank_angle))
        relative = predictions.frequency_stddev / predictions.natural_frequencies
        stddev = np.array([relative, predictions.damping_ratio_stddev])
        return self.levels.at(predictions.crank_angle, speeds, stddev)

    def _severities(
        self, level: FloatArray, probability: FloatArray, apart: FloatArray
    ) -> FloatArray:
        """Return by how much excitations exceed their limits, by the best that is known."""
        limits = self.limits
        margins = limits.margin / np.maximum(apart, _LEAST_MARGIN)
        others = np.where(np.isnan(probability), margins, probability / limits.probability)
        return np.where(np.isnan(level), others, level / limits.level)

    def _follow(
        self, known: BoolArray, severity: FloatArray, time: Integers
    ) -> tuple[BoolArray, FloatArray]:
        """Return which excitations exceed their limits, (m, n), and for how long, s.

        Between both limits it stays as it was. What was before the first time is the first column.
        """
        m, n = severity.shape
        begins = np.concatenate([self._exceeds, known & (severity > 1.0)], axis=1)
        stays = known & (severity > self.limits.release) & ~begins[:, 1:]
        places = np.arange(n + 1)
        decided = np.zeros((m, n + 1), np.int64)
        np.copyto(decided[:, 1:], places[1:], where=~stays)
        rows = (n + 1) * np.arange(m)[:, np.newaxis]
        exceeds = begins.take(np.maximum.accumulate(decided, axis=1) + rows)
        since = np.zeros((m, n + 1), np.int64)
        np.copyto(since[:, 1:], places[1:], where=exceeds[:, 1:] & ~exceeds[:, :-1])
        np.maximum.accumulate(since, axis=1, out=since)
        times = np.concatenate([[0], time])
        began = np.where(since == 0, self._since, times.take(since))
        self._exceeds, self._since = exceeds[:, -1:], began[:, -1:]
        return exceeds[:, 1:], 1e-9 * np.abs(time - began[:, 1:])

    def _states(
        self, exceeds: BoolArray, held: FloatArray, reach: FloatArray, slowest: FloatArray
    ) -> NDArray[np.uint8]:
        """Return the states of excitations.

        Vibration builds up in the time 1 / (2 pi r), where the square of r (Hz) is `reach`: the
        half-power half-width and, if the level counts, the distance from the mode. The excitation
        passes 2 r at a rate (Hz/s), of which the least possible magnitude counts, `slowest`; if it
        is not known, or below 0, that is 0.
        """
        turned = _TURN * held
        built_up = turned * turned * reach >= 1.0
        built_up |= 2.0 * _TURN * reach >= np.fmax(0.0, slowest)
        warns = built_up & (held >= self.limits.dwell)
        state = np.where(warns, np.uint8(ResonanceState.WARNING), np.uint8(ResonanceState.NOTE))
        state[~(exceeds & self._warns)] = ResonanceState.CLEAR
        return state

    def _speeds_at(self, time: Integers, speeds: Sequence[ReportedSpeed]) -> _Moving:
        """Use reported speeds; return the speeds at n times, (n_sources, n), NaN if unknown."""
        histories, begins = [list(self._speeds.values())], [0]
        for report in speeds:
            self.set_speed(report.source, report.value, report.time)
            histories.append(list(self._speeds.values()))
            begins.append(report.before)
        limit = math.floor(min(1e9 * self.stale_after, _LATEST))
        numbers = [[(x.value or math.nan, *x.rate) for x in each] for each in histories]
        reported = [
            [(0, _LATEST) if x.time is None else (x.time, limit) for x in each]
            for each in histories
        ]
        last = np.repeat(np.arange(len(begins)), np.diff([*begins, len(time)]))
        value, rate, error = np.array(numbers)[last].T
        since, longest = np.array(reported)[last].T
        age = time - since
        value[(age < -longest) | (age > longest)] = math.nan
        return _Moving(value, rate, error)
