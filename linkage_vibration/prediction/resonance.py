# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Resonances: which excitation shakes most or is nearest to a mode, and whether it warns."""

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from linkage_vibration.prediction.batch import Predictions
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.levels import Levels, LevelTable, Single, no_levels
from linkage_vibration.prediction.motion import UNKNOWN, Rate, speed_filter
from linkage_vibration.prediction.predictor import Prediction, Predictor

FloatArray = NDArray[np.float64]
Integers = NDArray[np.int64]

_LATEST = 2**63 - 1  # ns
_LEAST_MARGIN = 1e-300
_LOOKED_AT = 65  # angles of the range
_CONSTANT = Rate(0.0, 0.0)
_TURN = 2.0 * math.pi

_unknown = partial(np.full, 1, math.nan, np.float32)  # one excitation, of which nothing is known
Rates = tuple[FloatArray, FloatArray]  # rates and bounds of their errors, (n,) each
_Pair = tuple[int, float, float]  # mode, frequency of the excitation (Hz), relative margin


class ResonanceState(enum.IntEnum):
    """How near the nearest excitation is; the constants of the message."""

    CLEAR = 0
    WARNING = 1
    STALE = 2
    NOTE = 3


_RANKS = {ResonanceState.CLEAR: 0, ResonanceState.NOTE: 1, ResonanceState.WARNING: 2}
_RANK_ARRAY = np.array([0, 2, -1, 1])  # the same by the number of the state


@dataclass(frozen=True, slots=True, eq=False)
class Resonance:
    """What the excitations do: the most severe one, and the levels of all.

    An excitation is as severe as its level of vibration over the limit; where its level is not
    known, as the probability that it lies in the half-power band of its nearest mode over that
    limit; where this is not known either, as the limit of the margin over the margin.

    Attributes
    ----------
    state : ResonanceState
        If it is STALE, every number below is NaN and the mode is 0.
    excitation : str
        Name of the most severe one of those in this state; empty when stale.
    mode : int
        Index of the natural frequency that is nearest to it, from 0.
    excitation_frequency, natural_frequency : float
        Hz.
    margin, relative_margin : float
        Excitation minus natural frequency, Hz, and the same over the natural frequency, 1.
    approach : int
        1 if they approach each other, -1 if they separate, 0 if neither or not known.
    time_to_crossing : float
        Time until they are equal at the present rates, s; infinite if they do not meet, NaN if it
        is not known which of both.
    table_id : str
        Identifies the table of the prediction.
    probability : float
        That the excitation lies within the half-power band of the mode, 1; NaN if the mechanism
        does not state its uncertainty.
    velocity, velocity_stddev : float
        Of the response point by this excitation, m/s rms; NaN if they are not known.
    states : ndarray of uint8, (n_excitations,)
        The state of each excitation.
    velocities, velocity_stddevs, accelerations, amplifications : ndarray, (n_excitations,)
    total_velocity, total_velocity_stddev, total_acceleration : float
        As in `Levels`.
    approach_rate, approach_rate_error : float
        How fast the distance shrinks, and a bound of its error, Hz/s; NaN if they are not known.
    crank_velocity, crank_velocity_error : float
        As reported or estimated, and a bound of its error, rad/s; NaN if they are not known.
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
    probability: float = math.nan
    velocity: float = math.nan
    velocity_stddev: float = math.nan
    states: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(1, np.uint8))
    velocities: Single = field(default_factory=_unknown)
    velocity_stddevs: Single = field(default_factory=_unknown)
    accelerations: Single = field(default_factory=_unknown)
    amplifications: Single = field(default_factory=_unknown)
    total_velocity: float = math.nan
    total_velocity_stddev: float = math.nan
    total_acceleration: float = math.nan
    approach_rate: float = math.nan
    approach_rate_error: float = math.nan
    crank_velocity: float = math.nan
    crank_velocity_error: float = math.nan


@dataclass(frozen=True, slots=True, eq=False)
class Resonances:
    """Resonances by columns of shape (n, ...), whose names and units are those of `Resonance`.

    Attributes
    ----------
    excitation : ndarray
        Index of the excitation in the monitor; -1 if stale.
    state, excitation_frequency, mode, natural_frequency, margin : ndarray
    relative_margin, approach, time_to_crossing, probability, velocity : ndarray
    velocity_stddev, states : ndarray
    velocities, velocity_stddevs, accelerations, amplifications : ndarray
    total_velocity, total_velocity_stddev, total_acceleration : ndarray
    approach_rate, approach_rate_error, crank_velocity, crank_velocity_error : ndarray
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
    probability: FloatArray
    velocity: FloatArray
    velocity_stddev: FloatArray
    states: NDArray[np.uint8]
    velocities: Single
    velocity_stddevs: Single
    accelerations: Single
    amplifications: Single
    total_velocity: Single
    total_velocity_stddev: Single
    total_acceleration: Single
    approach_rate: FloatArray
    approach_rate_error: FloatArray
    crank_velocity: FloatArray
    crank_velocity_error: FloatArray

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
    rate: Rate = _CONSTANT  # per second


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
    and independent.

    Parameters
    ----------
    frequency, frequency_stddev : ndarray, (n,)
        Of the excitations, Hz.
    natural, natural_stddev, zeta : ndarray, (n,)
        Natural frequencies, their standard deviations, Hz, and damping ratios, 1.
    """
    with np.errstate(all="ignore"):
        low, high = 1.0 - zeta, 1.0 + zeta
        own = frequency_stddev * frequency_stddev
        below = np.sqrt(own + (low * natural_stddev) ** 2)
        above = np.sqrt(own + (high * natural_stddev) ** 2)
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
    found = [predictor.predict(at) for at in np.linspace(*table.alpha3_range, _LOOKED_AT).tolist()]
    naturals, stddevs, zetas = (
        np.array([getattr(one, name) for one in found])
        for name in ("natural_frequencies", "frequency_stddev", "damping_ratios")
    )
    largest = half_power_probability(naturals, 0.0 * naturals, naturals, stddevs, zetas)
    reached = (largest >= limit).any(axis=0) | ~(stddevs > 0.0).any(axis=0)
    names = [table.mode_label(int(mode)) for mode in np.flatnonzero(~reached)]
    if not names:
        return ""
    return (
        f"{', '.join(names)}: the natural frequency is so uncertain for its damping that the "
        f"probability of a resonance never reaches warning_probability, {limit:g}, so no "
        "excitation without an amplitude warns there. Lower it, or give amplitudes."
    )


def _nearest(one: Excitation, speed: _Speed | None, naturals: list[float]) -> _Pair | None:
    """Return the nearest mode, the frequency of the excitation, Hz, and their relative margin."""
    if speed is None or speed.value == 0.0:
        return None
    frequency, nearest, mode = one.ratio * speed.value, math.inf, 0
    for i, natural in enumerate(naturals):
        apart = abs(frequency / natural - 1.0)
        if apart < nearest:
            nearest, mode = apart, i
    return (mode, frequency, nearest) if nearest < math.inf else None


def _nearest_of_many(frequency: FloatArray, naturals: FloatArray) -> tuple[Integers, FloatArray]:
    """Return the nearest modes, and the relative margins to them; infinite if there is none."""
    nearest, mode = np.full(len(frequency), math.inf), np.zeros(len(frequency), np.int64)
    for i, natural in enumerate(naturals.T):
        apart = np.abs(frequency / natural - 1.0)
        nearer = apart < nearest
        np.copyto(nearest, apart, where=nearer)
        np.copyto(mode, i, where=nearer)
    return mode, nearest


def _columns(
    predictions: Predictions,
    levels: Levels,
    states: NDArray[np.uint8],
    best: Integers,
    chosen: FloatArray,
    mode: Integers,
    turning: Rates,
) -> Resonances:
    """Return resonances with the chosen frequencies, rates, their errors and probabilities."""
    frequency, rate, error, probability = chosen
    rows, stale = np.arange(len(best)), best < 0
    natural = np.where(stale, math.nan, predictions.natural_frequencies[rows, mode])
    margin = frequency - natural
    closing = np.where(margin > 0.0, -rate, rate)
    approach = (closing > error).astype(np.int8) - (closing < -error)
    crossing = np.where((closing == 0.0) & (error == 0.0), math.inf, math.nan)
    crossing[approach < 0] = math.inf
    np.copyto(crossing, np.abs(margin) / closing, where=approach > 0)
    crossing[stale] = math.nan
    own = states[rows, best]
    return Resonances(
        state=np.where(stale, ResonanceState.STALE, own).astype(np.uint8),
        excitation=best,
        excitation_frequency=frequency,
        mode=mode,
        natural_frequency=natural,
        margin=margin,
        relative_margin=margin / natural,
        approach=approach,
        time_to_crossing=crossing,
        probability=probability,
        velocity=np.where(stale, math.nan, levels.velocities[rows, best]),
        velocity_stddev=np.where(stale, math.nan, levels.velocity_stddevs[rows, best]),
        states=states,
        **{column.name: getattr(levels, column.name) for column in fields(levels)},
        approach_rate=closing,
        approach_rate_error=error,
        crank_velocity=turning[0],
        crank_velocity_error=turning[1],
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
    """

    def __init__(
        self,
        excitations: Sequence[Excitation],
        limits: WarningLimits = WarningLimits(),
        stale_after: float = 1.0,
        levels: LevelTable | None = None,
    ) -> None:
        self.excitations = tuple(excitations)
        self.limits = limits
        self.stale_after = stale_after
        self.levels = levels
        self._speeds: dict[Source, _Speed] = {}
        self._filters = {source: speed_filter(source) for source in Source}
        # Of each excitation: whether it exceeds its limit, and since when, ns.
        self._exceeds = [False] * len(self.excitations)
        self._since = [0] * len(self.excitations)
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
        if not 0.0 <= value < math.inf:
            self._speeds.pop(source, None)
            return
        self._speeds[source] = _Speed(value, time, rate)

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

    def assess(
        self, prediction: Prediction, velocity: float, time: int, velocity_error: float = 0.0
    ) -> Resonance:
        """Return the most severe excitation, and the levels of all.

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
        velocity, velocity_error = turning = Rate(float(velocity), float(velocity_error))
        fresh = self._fresh(time) if prediction.status.has_numbers else {}
        levels = self._levels(prediction, fresh)
        naturals = prediction.natural_frequencies.tolist()
        pairs = [_nearest(one, fresh.get(one.source), naturals) for one in self.excitations]
        probabilities = self._probabilities(prediction, pairs)
        states = [ResonanceState.STALE] * len(pairs)
        best, best_key, best_rate = -1, (-1, -math.inf), UNKNOWN
        for k, (one, pair) in enumerate(zip(self.excitations, pairs, strict=True)):
            if pair is None:
                self._exceeds[k] = False
                continue
            mode, frequency, apart = pair
            slope, changing = float(prediction.frequency_slopes[mode]), fresh[one.source].rate
            rate = Rate(
                one.ratio * changing.value - slope * velocity,
                one.ratio * changing.error + abs(slope) * velocity_error,
            )
            level = float(levels.velocities[k])
            severity = self._severity(level, probabilities[k], apart)
            self._follow(k, severity, time)
            width = float(prediction.damping_ratios[mode]) * naturals[mode]
            apart = frequency - naturals[mode] if level == level else 0.0
            states[k] = self._state(k, width * width + apart * apart, rate, time)
            key = _RANKS[states[k]], severity
            if key > best_key:
                best, best_key, best_rate = k, key, rate
        return self._resonance(
            prediction, levels, states, best, best_rate, turning, pairs, probabilities
        )

    def _levels(self, prediction: Prediction, fresh: dict[Source, _Speed]) -> Levels:
        """Return the levels of all excitations; NaN without a level table."""
        if self.levels is None:
            return no_levels(len(self.excitations))
        speeds = [fresh[s].value if s in fresh else math.nan for s in Source]
        relative = prediction.frequency_stddev / prediction.natural_frequencies
        stddev = np.array([relative, prediction.damping_ratio_stddev])
        return self.levels.at(prediction.crank_angle, tuple(speeds), stddev)

    def _probabilities(self, prediction: Prediction, pairs: Sequence[_Pair | None]) -> list[float]:
        """Return the probability of each pair of excitation and mode; NaN if it is not known."""
        found = [math.nan] * len(pairs)
        if self.levels is None or not self.levels.states_uncertainty:
            return found
        known = [k for k, pair in enumerate(pairs) if pair is not None]
        modes = [pair[0] for pair in pairs if pair is not None]
        frequencies = np.array([pair[1] for pair in pairs if pair is not None])
        values = half_power_probability(
            frequencies,
            frequencies * np.array([self.excitations[k].relative_stddev for k in known]),
            prediction.natural_frequencies[modes],
            prediction.frequency_stddev[modes],
            prediction.damping_ratios[modes],
        )
        for k, value in zip(known, values.tolist(), strict=True):
            found[k] = value
        return found

    def _severity(self, level: float, probability: float, apart: float) -> float:
        """Return by how much an excitation exceeds its limit, by the best that is known."""
        if level == level:  # it is not NaN
            return level / self.limits.level
        if probability == probability:
            return probability / self.limits.probability
        return self.limits.margin / max(apart, _LEAST_MARGIN)

    def _follow(self, k: int, severity: float, time: int) -> None:
        """Let an excitation exceed its limit, or not; between both limits it stays as it was."""
        exceeds = severity > 1.0 or (self._exceeds[k] and severity > self.limits.release)
        if exceeds and not self._exceeds[k]:
            self._since[k] = time
        self._exceeds[k] = exceeds

    def _state(self, k: int, reach: float, rate: Rate, time: int) -> ResonanceState:
        """Return the state of an excitation.

        Vibration builds up in the time 1 / (2 pi r), where the square of r (Hz) is `reach`: the
        half-power half-width and, if the level counts, the distance from the mode. The excitation
        passes 2 r at a rate (Hz/s), of which the least possible magnitude counts.
        """
        if not (self._exceeds[k] and self.excitations[k].warns):
            return ResonanceState.CLEAR
        held = 1e-9 * abs(time - self._since[k])
        turned = _TURN * held
        slowest = max(0.0, abs(rate.value) - rate.error)  # 0 if it is not known
        built_up = turned * turned * reach >= 1.0 or 2.0 * _TURN * reach >= slowest
        if built_up and held >= self.limits.dwell:
            return ResonanceState.WARNING
        return ResonanceState.NOTE

    def _resonance(
        self,
        prediction: Prediction,
        levels: Levels,
        states: list[ResonanceState],
        best: int,
        rate: Rate,
        turning: Rate,
        pairs: Sequence[_Pair | None],
        probabilities: list[float],
    ) -> Resonance:
        """Return what the excitation `best` does, or a stale resonance."""
        state, nan = ResonanceState.STALE, math.nan
        numbers: Any = "", nan, 0, nan, nan, nan, 0, nan, prediction.table_id, nan, nan, nan
        approach_rate, error = nan, nan
        pair = pairs[best] if best >= 0 else None
        if pair is not None:
            mode, frequency, _ = pair
            state, natural = states[best], float(prediction.natural_frequencies[mode])
            margin = frequency - natural
            approach_rate, error = -rate.value if margin > 0.0 else rate.value, rate.error
            approach = (approach_rate > error) - (approach_rate < -error)
            parts = approach < 0 or (approach_rate == 0.0 and error == 0.0)
            crossing = math.inf if parts else nan
            if approach > 0:
                crossing = abs(margin) / approach_rate
            numbers = (
                self.excitations[best].name,
                frequency,
                mode,
                natural,
                margin,
                margin / natural,
            )
            numbers += approach, crossing, prediction.table_id, probabilities[best]
            numbers += float(levels.velocities[best]), float(levels.velocity_stddevs[best])
        columns: Any = [getattr(levels, column.name) for column in fields(levels)]
        numbers += np.array(states, np.uint8), *columns, approach_rate, error, *turning
        return Resonance(state, *numbers)

    def assess_many(
        self,
        predictions: Predictions,
        velocity: FloatArray,
        time: Integers,
        speeds: Sequence[ReportedSpeed],
        velocity_error: FloatArray | None = None,
    ) -> Resonances:
        """Return what calls of `set_speed` and `assess` give, to the last bit.

        Parameters
        ----------
        predictions : Predictions
            n of them.
        velocity : ndarray, (n,)
            Of the crank, rad/s; NaN where it is unknown.
        time : ndarray, (n,)
            When the predictions were made, ns.
        speeds : sequence of ReportedSpeed
            In the order in which they were reported.
        velocity_error : ndarray, (n,), optional
            Bounds of the errors of the velocities, rad/s; 0 by default.
        """
        value, rates = self._speeds_at(time, speeds)
        turning = velocity, np.zeros(len(time)) if velocity_error is None else velocity_error
        levels = self._many_levels(predictions, value)
        n, m = len(time), len(self.excitations)
        states = np.full((n, m), ResonanceState.STALE, np.uint8)
        best, rank, severest = np.full(n, -1), np.full(n, -1), np.full(n, -math.inf)
        chosen, chosen_mode = np.full((4, n), math.nan), np.zeros(n, np.int64)
        with np.errstate(all="ignore"):  # as Python computes
            for k, one in enumerate(self.excitations):
                frequency = one.ratio * value[one.source]
                mode, apart = _nearest_of_many(frequency, predictions.natural_frequencies)
                known = apart < math.inf
                own = np.arange(n), mode
                probability = self._many_probabilities(predictions, own, frequency, one)
                severity = self._many_severities(levels.velocities[:, k], probability, apart)
                exceeds, since = self._follow_many(k, known, severity, time)
                slope, (rate, error) = predictions.frequency_slopes[own], rates[one.source]
                change = one.ratio * rate - slope * turning[0]
                error = one.ratio * error + np.abs(slope) * turning[1]
                natural = predictions.natural_frequencies[own]
                width = predictions.damping_ratios[own] * natural
                off = np.where(np.isnan(levels.velocities[:, k]), 0.0, frequency - natural)
                reach = width * width + off * off
                held = 1e-9 * np.abs(time - since)
                turned = _TURN * held
                built_up = turned * turned * reach >= 1.0
                built_up |= 2.0 * _TURN * reach >= np.fmax(0.0, np.abs(change) - error)
                warned = np.where(
                    built_up & (held >= self.limits.dwell),
                    ResonanceState.WARNING,
                    ResonanceState.NOTE,
                )
                state = np.where(exceeds & one.warns, warned, ResonanceState.CLEAR)
                states[known, k] = state[known]
                own_rank = _RANK_ARRAY[state]
                worse = known & ((own_rank > rank) | ((own_rank == rank) & (severity > severest)))
                for new, out in ((k, best), (own_rank, rank), (severity, severest)):
                    np.copyto(out, new, where=worse)
                np.copyto(chosen, (frequency, change, error, probability), where=worse)
                np.copyto(chosen_mode, mode, where=worse)
            return _columns(predictions, levels, states, best, chosen, chosen_mode, turning)

    def _many_levels(self, predictions: Predictions, value: dict[Source, FloatArray]) -> Levels:
        """Return the levels of all excitations for many predictions."""
        if self.levels is None:
            return no_levels(len(self.excitations), len(predictions.status))
        with np.errstate(all="ignore"):
            relative = predictions.frequency_stddev / predictions.natural_frequencies
        stddev = np.stack([relative, predictions.damping_ratio_stddev], axis=1)
        speeds = np.array([value[source] for source in Source])
        return self.levels.many(predictions.crank_angle, speeds, stddev)

    def _many_probabilities(
        self,
        predictions: Predictions,
        own: tuple[Integers, Integers],
        frequency: FloatArray,
        excitation: Excitation,
    ) -> FloatArray:
        """Return the probabilities of one excitation with its nearest modes."""
        if self.levels is None or not self.levels.states_uncertainty:
            return np.full(len(frequency), math.nan)
        return half_power_probability(
            frequency,
            frequency * excitation.relative_stddev,
            predictions.natural_frequencies[own],
            predictions.frequency_stddev[own],
            predictions.damping_ratios[own],
        )

    def _many_severities(
        self, level: Single, probability: FloatArray, apart: FloatArray
    ) -> FloatArray:
        """Return by how much an excitation exceeds its limit."""
        limits, level = self.limits, level.astype(float)
        margins = limits.margin / np.maximum(apart, _LEAST_MARGIN)
        others = np.where(np.isnan(probability), margins, probability / limits.probability)
        return np.where(np.isnan(level), others, level / limits.level)

    def _follow_many(
        self, k: int, known: NDArray[np.bool_], severity: FloatArray, time: Integers
    ) -> tuple[NDArray[np.bool_], Integers]:
        """Return where an excitation exceeds its limit, and since when, ns."""
        begins = known & (severity > 1.0)
        ends = ~(known & (severity > self.limits.release))
        places = np.arange(len(time))
        last = np.maximum.accumulate(np.where(begins | ends, places, -1))
        exceeds = np.where(last < 0, self._exceeds[k], begins[last])
        before = np.append(self._exceeds[k], exceeds[:-1])[: len(time)]
        start = np.maximum.accumulate(np.where(exceeds & ~before, places, -1))
        since = np.where(start < 0, self._since[k], time[start])
        if len(time):
            self._exceeds[k], self._since[k] = bool(exceeds[-1]), int(since[-1])
        return exceeds, since

    def _speeds_at(
        self, time: Integers, speeds: Sequence[ReportedSpeed]
    ) -> tuple[dict[Source, FloatArray], dict[Source, Rates]]:
        """Use reported speeds; return the speeds at each time (NaN if unknown) and their rates."""
        histories = {source: [(0, self._speeds.get(source))] for source in Source}
        for one in speeds:
            self.set_speed(one.source, one.value, one.time)
            histories[one.source].append((one.before, self._speeds.get(one.source)))
        limit = math.floor(min(1e9 * self.stale_after, _LATEST))
        values, rates = {}, dict[Source, Rates]()
        for source, history in histories.items():
            known = [speed or _Speed(math.nan, None) for _, speed in history]
            begins = [before for before, _ in history]
            valid = np.repeat(np.arange(len(known)), np.diff([*begins, len(time)]))
            value = np.array([speed.value or math.nan for speed in known])[valid]
            fixed = np.array([speed.time is None for speed in known])[valid]
            age = time - np.array([speed.time or 0 for speed in known])[valid]
            value[~(fixed | ((-limit <= age) & (age <= limit)))] = math.nan
            rate, error = np.array([speed.rate for speed in known])[valid].T
            values[source], rates[source] = value, (rate, error)
        return values, rates

    def _fresh(self, time: int) -> dict[Source, _Speed]:
        """Return the speeds that are not stale, before or after a jump of the clock."""
        limit = 1e9 * self.stale_after
        return {
            source: speed
            for source, speed in self._speeds.items()
            if speed.time is None or -limit <= time - speed.time <= limit
        }
