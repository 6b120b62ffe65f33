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
from linkage_vibration.prediction.motion import UNKNOWN, Rate, speed_filter
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
_CLEAR, _WARNING, _STALE, _NOTE = np.arange(4, dtype=np.uint8)
_PLACES = {source: place for place, source in enumerate(Source)}


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


@dataclass(frozen=True, slots=True, eq=False)
class _Pairs:
    """Excitations and their nearest modes, (n_excitations, n) each."""

    frequency: FloatArray  # of the excitation, Hz; NaN if its speed is not known
    mode: Integers
    natural: FloatArray  # Hz
    width: FloatArray  # half-power half-width of the mode, Hz
    apart: FloatArray  # magnitude of the relative margin; infinite if there is no mode or speed
    rate: FloatArray  # of the margin, Hz/s
    error: FloatArray  # bound of its error
    probability: FloatArray  # that the excitation is in the half-power band; NaN if not known


@dataclass(frozen=True, slots=True, eq=False)
class _Speeds:
    """The last speeds of all sources: values, rates and bounds of their errors, (3, n_sources)."""

    numbers: FloatArray  # NaN if not known, or zero
    times: Integers  # (n_sources,), when they were reported, ns
    fixed: BoolArray  # (n_sources,)

    def copy(self) -> "_Speeds":
        """Return a copy, which later speeds do not change."""
        return _Speeds(self.numbers.copy(), self.times.copy(), self.fixed.copy())


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
    ends = np.array([1.0 - zeta, 1.0 + zeta])
    stddev = np.sqrt(frequency_stddev * frequency_stddev + (ends * natural_stddev) ** 2)
    below, above = ndtr((ends * natural - frequency) / stddev)
    return np.asarray(above - below)


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
        self._filters = {source: speed_filter(source) for source in Source}
        n = len(self._filters)
        self._speeds = _Speeds(np.full((3, n), math.nan), np.zeros(n, np.int64), np.zeros(n, bool))
        # Of each excitation: whether it exceeds its limit, and since when, ns.
        self._exceeds = np.zeros(len(self.excitations), np.bool_)
        self._since = np.zeros(len(self.excitations), np.int64)
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
        self._set(source, value if value < math.inf else math.nan, rate, time, False)

    def set_fixed(self, source: Source, value: float | None) -> None:
        """Fix a speed (rpm or m/s); with None, a fixed speed becomes unknown.

        Parameters
        ----------
        source : Source
        value : float, optional
        """
        if value is not None:
            self.any_speed_reported = True
            self._set(source, value, _CONSTANT, 0, True)
        elif self._speeds.fixed[_PLACES[source]]:
            self._set(source, math.nan, UNKNOWN, 0, False)

    def _set(self, source: Source, value: float, rate: Rate, time: int, fixed: bool) -> None:
        place, speeds = _PLACES[source], self._speeds
        speeds.numbers[:, place] = value if value > 0.0 else math.nan, *rate
        speeds.times[place], speeds.fixed[place] = time, fixed

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
        velocities, errors = np.array([[velocity], [velocity_error]])
        row = one_row(prediction)
        resonance = self.assess_many(row, velocities, np.array([time]), (), errors).message(0)
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
        reported, n = self._speeds_at(time, speeds), len(time)
        crank = np.array([velocity, velocity_error])
        with np.errstate(all="ignore"):
            if n <= _CHUNK:
                return self._assess(predictions, crank, time, reported)
            parts = []
            for start in range(0, n, _CHUNK):
                rows = slice(start, start + _CHUNK)
                numbers = crank[:, rows], time[rows], reported[..., rows]
                parts.append(self._assess(predictions.rows(rows), *numbers))
            return joined(parts)

    def _assess(
        self, predictions: MessageColumns, crank: FloatArray, time: Integers, speeds: FloatArray
    ) -> MessageColumns:
        """Return the resonances of n predictions.

        The crank's velocity and the bound of its error are (2, n), and speeds with their rates and
        the bounds of the errors of these (3, n_sources, n).
        """
        levels = self._levels(predictions, speeds[0])
        pairs = self._pairs(predictions, crank, speeds)
        level = levels.velocities.T.astype(float)
        with_level, known = level == level, pairs.apart < math.inf
        severity = self._severities(level, with_level, pairs)
        exceeds, held = self._follow(np.where(known, severity, -1.0), time)
        off = (pairs.frequency - pairs.natural) * with_level
        reach = pairs.width * pairs.width + off * off
        exceeds &= self._warns
        state = self._states(exceeds, held, reach, np.abs(pairs.rate) - pairs.error)
        state = np.where(known, state, _STALE)
        rank = _RANKS.take(state)
        highest = np.maximum.reduce(rank)
        worst = np.where(rank == highest, severity, -1.0).argmax(axis=0)
        columns = self._columns(predictions, pairs, levels, worst, highest < 0)
        columns.state = state.take(worst * len(time) + np.arange(len(time)))
        columns.states = state.T
        columns.crank_velocity, columns.crank_velocity_error = crank
        return columns

    def _pairs(self, predictions: MessageColumns, crank: FloatArray, speeds: FloatArray) -> _Pairs:
        """Return each excitation with its nearest mode."""
        naturals = predictions.natural_frequencies
        frequency, rate, error = self._ratios * speeds.take(self._sources, axis=1)
        # A mode without a natural frequency is infinitely far away.
        apart = np.fmin(np.abs(frequency / naturals.T[:, np.newaxis] - 1.0), math.inf)
        mode = apart.argmin(axis=0)
        at = mode + np.arange(len(naturals)) * naturals.shape[1]
        natural, zeta = naturals.take(at), predictions.damping_ratios.take(at)
        slope = predictions.frequency_slopes.take(at)
        if self.levels is not None and self.levels.states_uncertainty:
            stddevs = frequency * self._stddevs, predictions.frequency_stddev.take(at)
            probability = half_power_probability(frequency, stddevs[0], natural, stddevs[1], zeta)
        else:
            probability = np.full(frequency.shape, math.nan)
        return _Pairs(
            frequency=frequency,
            mode=mode,
            natural=natural,
            width=zeta * natural,
            apart=np.minimum.reduce(apart),
            rate=rate - slope * crank[0],
            error=error + np.abs(slope) * crank[1],
            probability=probability,
        )

    def _columns(
        self,
        predictions: MessageColumns,
        pairs: _Pairs,
        levels: MessageColumns,
        worst: Integers,
        stale: BoolArray,
    ) -> MessageColumns:
        """Return the columns that are about the most severe excitation, and all levels."""
        at = worst * len(worst) + np.arange(len(worst))
        velocities = levels.velocities.T, levels.velocity_stddevs.T
        chosen = np.array(
            [
                pairs.frequency,
                pairs.natural,
                pairs.rate,
                pairs.error,
                pairs.probability,
                *velocities,
            ]
        )
        chosen = chosen.reshape(len(chosen), -1).take(at, axis=1)
        chosen[:, stale] = math.nan
        frequency, natural, rate, error, probability, velocity, stddev = chosen
        margin = frequency - natural
        closing = np.where(margin > 0.0, -rate, rate)
        nears, parts = closing > error, closing < -error
        never = parts | ((closing == 0.0) & (error == 0.0))
        crossing = np.where(nears, np.abs(margin) / closing, np.where(never, math.inf, math.nan))
        return MessageColumns(
            excitation=self._names.take(np.where(stale, len(self._names) - 1, worst)),
            excitation_frequency=frequency,
            mode=np.where(stale, 0, pairs.mode.take(at)),
            natural_frequency=natural,
            margin=margin,
            relative_margin=margin / natural,
            approach=nears.astype(np.int8) - parts,
            time_to_crossing=crossing,
            table_id=predictions.table_id,
            probability=probability,
            velocity=velocity,
            velocity_stddev=stddev,
            approach_rate=closing,
            approach_rate_error=error,
            **vars(levels),
        )

    def _levels(self, predictions: MessageColumns, speeds: FloatArray) -> MessageColumns:
        """Return the levels of all excitations; NaN without a level table."""
        if self.levels is None:
            return unknown_levels(len(self.excitations), len(predictions.crank_angle))
        relative = predictions.frequency_stddev / predictions.natural_frequencies
        stddev = np.array([relative, predictions.damping_ratio_stddev])
        return self.levels.at(predictions.crank_angle, speeds, stddev)

    def _severities(self, level: FloatArray, with_level: BoolArray, pairs: _Pairs) -> FloatArray:
        """Return by how much excitations exceed their limits, by the best that is known."""
        limits, probability = self.limits, pairs.probability
        severity = limits.margin / np.maximum(pairs.apart, _LEAST_MARGIN)
        with_probability = probability == probability  # it is not NaN
        np.copyto(severity, probability / limits.probability, where=with_probability)
        np.copyto(severity, level / limits.level, where=with_level)
        return severity

    def _follow(self, severity: FloatArray, time: Integers) -> tuple[BoolArray, FloatArray]:
        """Return which excitations exceed their limits, and for how long, s, (n_excitations, n).

        Between both limits it stays as it was before.
        """
        exceeds = severity > 1.0
        between = exceeds ^ (severity > self.limits.release)
        before = self._exceeds
        for row in _rows_with_any(between):
            earlier = exceeds[:, row - 1] if row else before
            exceeds[:, row] |= between[:, row] & earlier
        since = np.repeat(self._since[:, np.newaxis], len(time), axis=1)
        begins = exceeds.copy()
        begins[:, 1:] &= ~exceeds[:, :-1]
        begins[:, :1] &= ~before[:, np.newaxis]
        for row in _rows_with_any(begins):
            since[begins[:, row], row:] = time[row]
        if len(time):
            self._exceeds, self._since = exceeds[:, -1].copy(), since[:, -1].copy()
        return exceeds, 1e-9 * np.abs(time - since)

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
        built_up |= ~(2.0 * _TURN * reach < slowest)
        built_up &= held >= self.limits.dwell
        return np.where(exceeds, np.where(built_up, _WARNING, _NOTE), _CLEAR)

    def _speeds_at(self, time: Integers, speeds: Sequence[ReportedSpeed]) -> FloatArray:
        """Use reported speeds; return the speeds at n times, (3, n_sources, n), NaN if unknown.

        Their rates and the bounds of the errors of these follow.
        """
        last = self._speeds
        numbers, times = last.numbers[..., np.newaxis], last.times[:, np.newaxis]
        fixed = last.fixed[:, np.newaxis]
        if speeds:
            history = [last.copy()]
            for report in speeds:
                self.set_speed(report.source, report.value, report.time)
                history.append(self._speeds.copy())
            begins = [0, *(report.before for report in speeds), len(time)]
            rows = np.repeat(np.arange(len(history)), np.diff(begins))
            numbers = np.stack([each.numbers for each in history], axis=-1)[..., rows]
            times = np.stack([each.times for each in history], axis=-1)[..., rows]
            fixed = np.stack([each.fixed for each in history], axis=-1)[..., rows]
        limit = math.floor(min(1e9 * self.stale_after, _LATEST))
        fresh = fixed | (np.abs(time - times) <= limit)
        return np.where(fresh, numbers, math.nan)


def _rows_with_any(true: BoolArray) -> list[int]:
    """Return the rows in which something is true, (n_excitations, n); mostly there are none."""
    if not np.count_nonzero(true):
        return []
    rows: list[int] = np.logical_or.reduce(true).nonzero()[0].tolist()
    return rows
