# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Resonances: which excitation loads the linkage most or is nearest to a mode, and its state."""

import math
from collections.abc import Iterable, Sequence
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Integers
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, IntArray, normal_share
from linkage_vibration.messages.columns import MessageColumns, joined
from linkage_vibration.prediction.agreement import Agreement
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.ground import MAX_OFF_GROUND
from linkage_vibration.prediction.levels import LevelTable, unknown_levels
from linkage_vibration.prediction.motion import Estimate, Rate, speed_filter, unknown_rate
from linkage_vibration.prediction.periods import Windows, WindowStep
from linkage_vibration.prediction.predictor import Prediction
from linkage_vibration.prediction.severity import (
    CLEAR,
    DEFAULT_LIMITS,
    NOTE,
    SPEED_BITS,
    UNKNOWN,
    WARNING,
    WINDOW_RANKS,
    ResonanceState,
    Unknown,
    WarningLimits,
    WarningTimer,
    is_kept,
    states,
)

_LATEST = 2**63 - 1  # ns
_NO_PERIOD = -(2**63)
_CHUNK = 512  # predictions that are assessed together, so that their numbers stay in the cache

_SPEEDS = np.linspace(0.3, 1.7, 71)  # of the present speed, among which a quiet one is sought
_PRESENT = int(np.abs(_SPEEDS - 1.0).argmin())
_N_ANGLES = 91  # of the table, among which a quiet one is sought
_QUIET_FOR = 1.0  # s, for which the answer is used again
_FACTORS_FOR = 1.0  # s, for which the factors of levels are used again in the same state
_SPEED_BITS = np.array([SPEED_BITS[source] for source in Source])
_SI = np.array([source.si for source in Source])
_NO_SPEED = math.nan, unknown_rate
_GROUND = Source.GROUND.index


class Header(NamedTuple):
    """What a message takes from its reading, and what that does to its window."""

    sec: int
    nanosec: int
    frame_id: str
    due_at: int  # ns
    timed_by_receipt: bool
    step: WindowStep


_Speed: TypeAlias = tuple[float, Estimate]  # rpm or m/s, NaN if not known, and its rate
_Reading: TypeAlias = tuple[Prediction, Rate, int, list[_Speed], Header]
"""Prediction, velocity, time, ns, speeds, and header of a reading."""


class ReportedSpeed(NamedTuple):
    """A speed that is reported among predictions, as by `ResonanceMonitor.set_speed`."""

    before: int  # predictions that precede it
    source: Source
    value: float
    time: int


def half_power_probability(
    frequency: FloatArray,
    frequency_stddev: FloatArray,
    natural: FloatArray,
    natural_stddev: FloatArray,
    zeta: FloatArray,
) -> FloatArray:
    """Return the probability that excitations lie within the half-power bands of modes.

    The band of f is f (1 - zeta) to f (1 + zeta). Both frequencies, Hz, are normal and independent.
    All arrays have the same shape.
    """
    ends = np.array([1.0 - zeta, 1.0 + zeta])
    stddev = np.sqrt(frequency_stddev * frequency_stddev + (ends * natural_stddev) ** 2)
    below, above = normal_share((ends * natural - frequency) / stddev)
    return np.asarray(above - below)


def rows_of(predictions: Sequence[Prediction]) -> MessageColumns:
    """Return what resonances are assessed by, as columns of n predictions of one table."""
    names = "natural_frequencies", "damping_ratios", "frequency_slopes", "frequency_stddevs"
    columns = {name: np.array([getattr(each, name) for each in predictions]) for name in names}
    angles = np.array([each.crank_angle for each in predictions])
    return MessageColumns(crank_angle=angles, table_id=predictions[0].table_id, **columns)


def window_headers(headers: Sequence[Header]) -> MessageColumns:
    """Return what messages take from their readings, (n,) each."""
    kinds = {"frame_id": object, "timed_by_receipt": np.uint8}
    columns = zip(Header._fields, zip(*headers, strict=True), strict=True)
    return MessageColumns(**{name: np.array(each, kinds.get(name)) for name, each in columns})


def _by_source(reported: Iterable[Sequence[_Speed]]) -> tuple[FloatArray, NDArray[np.object_]]:
    """Return speeds, (n_sources, n), and what estimates their rates, (n, n_sources)."""
    numbers = np.array([*reported], object).reshape(-1, len(Source), 2)
    return np.ascontiguousarray(numbers[..., 0].T, float), numbers[..., 1]


def _reversed(estimate: Estimate) -> Rate:
    rate, error = estimate()
    return Rate(-rate, error)


def _published(columns: MessageColumns) -> tuple[Integers, Integers, int]:
    """Return the rows that are published, with which reading each is, and how many are done."""
    # A window has a message of its most severe reading and, if the state has changed since, of
    # its last. The readings of windows that have ended are done.
    closing = np.flatnonzero(columns.step >= WindowStep.CLOSES)
    n = int(closing[-1]) + 1 if len(closing) else 0
    begins = columns.step[:n] == WindowStep.ALONE
    begins[closing[:-1] + 1] = True
    window = np.cumsum(begins)
    last = np.flatnonzero(np.append(window[1:] != window[:-1], [True] * (n > 0)))
    state = columns.state[:n]
    # Of readings that are equal, the latest counts.
    worst = np.lexsort((columns.severity[:n], WINDOW_RANKS.take(state), window))[last]
    rows = np.sort(np.append(worst, last[state[last] != state[worst]]))
    # What waited before a gap is late, and is no all-clear any more.
    late = columns.step[last[np.searchsorted(last, rows)]] == WindowStep.WAITS
    rows = rows[~(late & (state[rows] == CLEAR))]
    return rows, closing[np.searchsorted(closing, rows)], n


def described(of: MessageColumns) -> MessageColumns:
    """Return assessments with what follows from their fields, one of them or n.

    These are the margin, Hz, also relative, the direction of approach (1, -1, or 0 if unknown), the
    time to the crossing, s, and the load ratio of the most severe excitation with its factor.
    """
    margin, closing = of.excitation_frequency - of.natural_frequency, of.approach_rate
    index = np.asarray(of.excitation_index)

    def of_worst(levels: FloatArray) -> FloatArray:
        chosen = np.take_along_axis(levels, np.maximum(index, 0)[..., np.newaxis], -1)[..., 0]
        return np.where(index < 0, math.nan, chosen)

    with np.errstate(all="ignore"):  # a crank at rest; rates may be any 64 bits
        nears, parts = closing > of.approach_rate_error, closing < -of.approach_rate_error
        never = parts | ((closing == 0.0) & (of.approach_rate_error == 0.0))
        crossing = np.where(nears, np.abs(margin) / closing, np.where(never, math.inf, math.nan))
        relative = margin / of.natural_frequency
    derived = {
        "margin": margin,
        "relative_margin": relative,
        "approach": np.asarray(nears).astype(np.int8) - parts,
        "time_to_crossing": crossing,
        "load_ratio": of_worst(of.load_ratios),
        "load_ratio_factor": of_worst(of.load_ratio_factors),
    }
    return MessageColumns(**vars(of) | derived)


class ResonanceRules:
    """What excitations, limits and levels say about readings; it remembers nothing of them."""

    def __init__(
        self, excitations: Sequence[Excitation], limits: WarningLimits, levels: LevelTable | None
    ) -> None:
        self.excitations, self.limits, self.levels = tuple(excitations), limits, levels
        ratios = [(excitation.ratio, excitation.relative_stddev) for excitation in excitations]
        self._ratios, self._stddevs = np.array(ratios).T[..., np.newaxis]
        self.sources = np.array([excitation.source.index for excitation in excitations])
        """Index of the speed of each excitation, (n_excitations,)."""
        self._warns = np.array([[excitation.warns] for excitation in excitations])
        self._loaded = np.array([[bool(excitation.load)] for excitation in excitations])
        # (n_sources, n_excitations): which orders with an amplitude follow a speed
        follows = self.sources == np.arange(len(Source))[:, np.newaxis]
        self._orders = (follows & self._loaded.T).astype(int)
        self._orders = self._orders[self._orders.any(axis=1)]
        self._rolling = np.array([[bool(excitation.terrain)] for excitation in excitations])
        self._names = np.array([*(excitation.name for excitation in excitations), ""])  # -1: none
        self._places = np.array([*(levels.force_places if levels else ()), ""])
        self._used = follows.any(axis=1)
        # (n_modes, n_excitations): which modes an excitation cannot excite, if there are any
        excites = levels.excites if levels else np.True_
        self._unexcited = None if excites.all() else ~excites.T

    def unknown_speeds(self, speeds: FloatArray) -> Integers:
        """Return the bits, (n,), of the used speeds that are NaN, of (n_sources, n)."""
        return np.asarray(_SPEED_BITS @ (np.isnan(speeds) & self._used[:, np.newaxis]))

    def assess(
        self,
        predictions: MessageColumns,
        crank: FloatArray,
        time: Integers,
        speeds: FloatArray,
        timer: WarningTimer,
    ) -> MessageColumns:
        """Return the resonances of n predictions, with velocities and errors, (2, n)."""
        if self.levels is None:
            levels = unknown_levels(len(self.excitations), len(time))
        else:
            levels = self.levels.at(predictions.crank_angle, speeds)
        pairs = frequency, _, apart = self._pairs(predictions, speeds)
        totals = levels.total_load_ratio[np.newaxis]
        ratio = np.concatenate([levels.load_ratios.T, totals], dtype=float)
        # The level of the ground is not known while a tyre is off it, but that is no reason to be
        # calm. Orders may lift a tyre, too.
        off = levels.off_ground_share > MAX_OFF_GROUND
        if off.any():
            ratio[:-1][self._rolling & off & (speeds[_GROUND] > 0.0)] = math.inf
            ratio[-1, off] = math.inf
        # A load that the table could give is not calm because it is beyond the table's frequencies.
        beyond = self._loaded & ~np.isnan(frequency) & np.isnan(levels.velocities.T)
        beyond &= self.levels is not None and self.levels.has_load_ratios
        known, exceeds = ~np.isnan(ratio), ratio > self.limits.warning
        exceeds[:-1] &= self._warns
        unknown = self._unknown_sources(predictions, speeds, known[:-1], beyond)
        # Without a source, the total is a part of it: it may exceed the limit, too.
        known[-1] &= (unknown == 0) | exceeds[-1]
        warns = timer.follow(exceeds, known, time, self.limits.dwell)
        # The ground is near no mode, so only a load ratio says something about it.
        near = apart < np.where(beyond, self.limits.near, math.inf)
        assessable = np.where(self._rolling, known[:-1], near) | warns[:-1]
        state, severity = states(ratio[:-1], apart, assessable, warns[:-1], self.limits)
        highest = np.maximum.reduce(state)
        worst = np.where(state == highest, severity, -1.0).argmax(axis=0)
        columns = self._columns(predictions, speeds, pairs, levels, worst, highest == UNKNOWN)
        of_total = np.where(warns[-1], WARNING, np.where(ratio[-1] > self.limits.note, NOTE, CLEAR))
        whole = np.where((highest > UNKNOWN) | warns[-1], np.maximum(highest, of_total), UNKNOWN)
        columns.state = np.where((whole == CLEAR) & (unknown != 0), UNKNOWN, whole)
        columns.states = state.T
        columns.unknown_sources = unknown
        shares = np.isfinite(levels.load_ratios).mean(axis=1)
        columns.known_share = shares.astype(np.float32)
        # By what the readings of a window are ordered.
        columns.severity = np.fmax(
            1.0 + ratio[-1], np.take_along_axis(severity, worst[np.newaxis], 0)[0]
        )
        columns.load_ratio_limit = np.full(len(time), self.limits.warning)
        columns.crank_velocity, columns.crank_velocity_error = crank
        columns.crank_angle, columns.speeds = predictions.crank_angle, speeds.T
        return columns

    def _unknown_sources(
        self, predictions: MessageColumns, speeds: FloatArray, known: BoolArray, beyond: BoolArray
    ) -> NDArray[np.uint8]:
        """Return the bits of what is not known, (n,); flags are (n_excitations, n)."""
        nowhere = np.isnan(predictions.natural_frequencies).all(axis=1)
        # A tractor that stands is not shaken by the ground, whatever is known of that.
        unlevel = (self._rolling > known).any(axis=0) & (speeds[_GROUND] > 0.0)
        bits = self.unknown_speeds(speeds) + Unknown.CRANK_ANGLE * nowhere
        if beyond.any():
            silent = self._orders @ beyond == self._orders.sum(axis=1, keepdims=True)
            bits += Unknown.ORDER_LEVEL * (silent.any(axis=0) & ~nowhere)
        return np.asarray(bits + Unknown.GROUND_LEVEL * (unlevel & ~nowhere), np.uint8)

    def _pairs(
        self, predictions: MessageColumns, speeds: FloatArray
    ) -> tuple[FloatArray, Integers, FloatArray]:
        """Return frequencies, Hz, nearest modes and relative distances, (n_excitations, n) each."""
        frequency = self._ratios * speeds.take(self.sources, axis=0)
        # A mode without a natural frequency is infinitely far away.
        naturals = predictions.natural_frequencies.T[:, np.newaxis]
        apart = np.fmin(np.abs(frequency / naturals - 1.0), math.inf)
        if self._unexcited is not None:
            apart[self._unexcited] = math.inf
        return frequency, apart.argmin(axis=0), np.minimum.reduce(apart)

    def _columns(
        self,
        predictions: MessageColumns,
        speeds: FloatArray,
        pairs: tuple[FloatArray, Integers, FloatArray],
        levels: MessageColumns,
        worst: Integers,
        stale: BoolArray,
    ) -> MessageColumns:
        """Return the columns that are about the most severe excitation, and all levels."""
        rows, source = np.arange(len(worst)), self.sources.take(worst)
        speed, frequency = speeds[source, rows], pairs[0][worst, rows]
        speed[stale] = frequency[stale] = math.nan
        mode = np.where(np.isnan(frequency), -1, pairs[1][worst, rows])  # The ground has none.
        names = "natural_frequencies", "frequency_slopes", "damping_ratios", "frequency_stddevs"
        natural, slope, zeta, stddev = np.where(
            mode < 0, math.nan, [getattr(predictions, name)[rows, mode] for name in names]
        )
        probability = np.full(len(rows), math.nan)
        if self.levels is not None and self.levels.states_uncertainty:
            stddevs = frequency * self._stddevs.take(worst), stddev
            of_all = half_power_probability(frequency, stddevs[0], natural, stddevs[1], zeta)
            probability[~stale] = of_all[~stale]
        load_ratio = np.where(stale, math.nan, levels.load_ratios[rows, worst])
        return MessageColumns(
            excitation=self._names.take(np.where(stale, len(self._names) - 1, worst)),
            excitation_frequency=frequency,
            excitation_speed=speed * _SI.take(source),
            excitation_index=np.where(stale, -1, worst),
            speed_source=np.where(stale, 0, source + 1),
            mode=np.where(np.isnan(natural), -1, mode),
            natural_frequency=natural,
            table_id=predictions.table_id,
            probability=probability,
            load_place=self._place_names(levels.load_places[rows, worst], load_ratio),
            total_load_place=self._place_names(levels.total_load_places, levels.total_load_ratio),
            frequency_slope=slope,
            timed_by_receipt=np.zeros(len(rows), np.uint8),
            **vars(levels),
        )

    def set_rates(self, columns: MessageColumns) -> None:
        """Set how fast excitations approach modes, from the rates of speeds and crank."""
        worst, slope = columns.excitation_index, columns.frequency_slope
        sources = self.sources.take(worst).tolist()
        rates = [every[source]() for every, source in zip(columns.rates, sources, strict=True)]
        rate, error = self._ratios[:, 0].take(worst) * np.array(rates).reshape(-1, 2).T
        rate -= slope * columns.crank_velocity
        nears = columns.excitation_frequency > columns.natural_frequency
        error += np.abs(slope) * columns.crank_velocity_error
        both = np.array([np.where(nears, -rate, rate), error])
        both[np.isnan(both)] = math.nan  # of one sign, so that equal rates are equal bytes
        columns.approach_rate, columns.approach_rate_error = both
        del columns.frequency_slope, columns.rates

    def _place_names(self, places: Integers, ratio: FloatArray) -> NDArray[np.str_]:
        """Return the names of pins and cylinders, (n,); empty where the load ratio is not known."""
        return self._places.take(np.where(np.isnan(ratio), len(self._places) - 1, places))

    def sought(self, angle: float, speeds: FloatArray, source: int) -> FloatArray:
        """Return the nearest speed of a source, and the nearest angle, without a warning."""
        if self.levels is None:
            return np.full(2, math.nan)
        tried = np.linspace(*self.levels.alpha3_range, _N_ANGLES)
        at = np.concatenate([np.full(len(_SPEEDS), angle), tried])
        every = np.repeat(speeds[:, np.newaxis], len(at), axis=1)
        every[source, : len(_SPEEDS)] *= _SPEEDS
        quiet = self._are_quiet(at, every, np.full(len(at), _PRESENT))
        ends = np.split(quiet, [len(_SPEEDS)])
        pairs = (every[source, : len(_SPEEDS)], speeds[source]), (tried, angle)
        chosen = []
        for (values, present), rows in zip(pairs, ends, strict=True):
            # Of two values that are equally far, rounding would choose; the lower one is taken.
            apart = np.abs(values - present) * np.where(values > present, 1.0 + 1e-9, 1.0)
            nearest = int(np.where(rows, apart, math.inf).argmin())
            chosen.append(values[nearest] if rows[nearest] else math.nan)
        return np.array(chosen)

    def ends(
        self, sought: FloatArray, angles: FloatArray, speeds: FloatArray, source: int
    ) -> BoolArray:
        """Return whether a speed and an angle that were sought end warnings of n readings, too."""
        n = len(angles)
        if self.levels is None:
            return np.ones(n, np.bool_)
        every, at = np.tile(speeds, 3), np.tile(angles, 3)
        every[source, n : 2 * n], at[2 * n :] = sought
        quiet = self._are_quiet(at, every, np.tile(np.arange(n), 3)).reshape(3, n)[1:]
        return np.asarray((quiet | np.isnan(sought)[:, np.newaxis]).all(axis=0))

    def _are_quiet(self, angles: FloatArray, speeds: FloatArray, present: IntArray) -> BoolArray:
        """Return where no limit is exceeded, (n,); `present` are the indices of what is now."""
        assert self.levels is not None
        found, limit = self.levels.at(angles, speeds), self.limits.warning
        unsafe = (found.load_ratios > limit)[:, self._warns[:, 0]].any(axis=1)
        unsafe |= found.off_ground_share > MAX_OFF_GROUND
        # Where a load that is known now would not be known, nothing is known to be quiet.
        unknown = np.isnan(found.load_ratios)
        unsafe |= (unknown & ~unknown[present]).any(axis=1)
        return np.asarray((found.total_load_ratio <= limit) & ~unsafe)


class ResonanceMonitor:
    """Assesses readings by its `ResonanceRules`, and remembers what these need, without a clock."""

    def __init__(
        self,
        excitations: Sequence[Excitation],
        limits: WarningLimits = DEFAULT_LIMITS,
        stale_after: float = 1.0,
        levels: LevelTable | None = None,
        rate: float = 0.0,
    ) -> None:
        self.rules = ResonanceRules(excitations, limits, levels)
        self.stale_after = stale_after
        self.windows = Windows(rate)
        self._filters = {source: speed_filter(source) for source in Source}
        self._agreements = {source: Agreement(source.value) for source in Source}
        # The last speeds, when they were reported, ns, and whether they are fixed
        self._speeds = dict.fromkeys(Source, (_NO_SPEED, 0, False))
        self._timer = WarningTimer(len(excitations) + 1)  # the last is that of the total
        self.use()
        self.restart()
        self.any_speed_reported = False  # without a speed there is nothing to assess

    def restart(self) -> None:
        """Count messages from 1, and forget the readings whose window has not ended."""
        self.count = 0  # of messages
        self.windows = Windows(self.windows.rate)
        self._waiting = list[_Reading]()
        self._open: MessageColumns | None = None  # what is assessed of a window that goes on

    def use(self, limits: WarningLimits | None = None, levels: LevelTable | None = None) -> None:
        """Use other limits or levels from now on; readings that wait are of the levels before."""
        if levels is not None:
            self._waiting, self._open = [], None
        of = self.rules
        self.rules = ResonanceRules(of.excitations, limits or of.limits, levels or of.levels)
        # By source: the time, ns; speed and angle then; and the quiet ones.
        self._quiet: dict[int, tuple[int, FloatArray, FloatArray]] = {}
        # When factors were last computed, ns, and the state then.
        self._factors_time, self._factors_state = _NO_PERIOD, UNKNOWN
        self._factors = np.empty((1, 0))

    def set_speed(self, source: Source, value: float, time: int) -> None:
        """Use a reported speed, rpm or m/s; its rate is estimated as `RateFilter` describes.

        It becomes unknown if it is not finite, that of a shaft is negative, or values go to and
        fro. A ground speed is negative in reverse; its magnitude counts. The time is in ns.
        """
        self.any_speed_reported = True
        value = float(value)
        rate = self._filters[source].add(time, value)
        lost = self._agreements[source].loses(time, value)
        if source is Source.GROUND and value < 0.0:
            value, rate = -value, partial(_reversed, rate)
        if lost or not 0.0 <= value < math.inf:
            value = math.nan
        self._speeds[source] = (value, rate), time, False

    def set_fixed(self, source: Source, value: float | None) -> None:
        """Fix a speed (rpm or m/s); with None, a fixed speed becomes unknown."""
        if value is not None:
            self.any_speed_reported = True
            self._speeds[source] = (value, partial(Rate, 0.0, 0.0)), 0, True
        elif self._speeds[source][2]:
            self._speeds[source] = _NO_SPEED, 0, False

    def unknown_speeds(self, time: int) -> int:
        """Return the bits of ``LoadState`` of the used speeds that are not known at a time, ns."""
        speeds, _ = _by_source([self._speeds_at(time)])
        return int(self.rules.unknown_speeds(speeds)[0])

    def _speeds_at(self, time: int) -> list[_Speed]:
        """Return the speeds that are known at a time, ns, by source."""
        limit = math.floor(min(1e9 * self.stale_after, _LATEST))
        return [
            numbers if fixed or abs(time - at) <= limit else _NO_SPEED
            for numbers, at, fixed in self._speeds.values()
        ]

    def assess(
        self, prediction: Prediction, velocity: float, time: int, velocity_error: float = 0.0
    ) -> MessageColumns:
        """Return one ``Resonance`` with its ``Levels`` and its ``LoadState``."""
        velocities, errors = np.array([[velocity], [velocity_error]])
        row = rows_of([prediction])
        resonance = self.assess_many(row, velocities, np.array([time]), (), errors).message(0)
        resonance.state = ResonanceState(resonance.state)
        return resonance

    def take(
        self, prediction: Prediction, velocity: Rate, time: int, header: Header
    ) -> MessageColumns | None:
        """Take a reading with its header; return the messages of windows that end, if any."""
        self._waiting.append((prediction, velocity, time, self._speeds_at(time), header))
        if header.step is WindowStep.WAITS:
            return None
        waiting, self._waiting = self._waiting, []
        predictions, velocities, times, speeds, headers = zip(*waiting, strict=True)
        crank, at = np.array(velocities).T, np.array(times)
        return self._answer(rows_of(predictions), crank, at, speeds, window_headers(headers))

    def assess_many(
        self,
        predictions: MessageColumns,
        velocity: FloatArray,
        time: Integers,
        speeds: Sequence[ReportedSpeed],
        velocity_error: FloatArray,
        headers: MessageColumns | None = None,
    ) -> MessageColumns:
        """Return the messages of the windows of n predictions, or of each without headers."""
        reported, after = [], 0
        for row, now in enumerate(time.tolist()):
            while after < len(speeds) and speeds[after].before <= row:
                self.set_speed(speeds[after].source, speeds[after].value, speeds[after].time)
                after += 1
            reported.append(self._speeds_at(now))
        for each in speeds[after:]:
            self.set_speed(each.source, each.value, each.time)
        if headers is None:
            headers = MessageColumns(step=np.full(len(time), WindowStep.CLOSES))
        crank = np.array([velocity, velocity_error])
        return self._answer(predictions, crank, time, reported, headers)

    def _answer(
        self,
        predictions: MessageColumns,
        crank: FloatArray,
        time: Integers,
        speeds: Sequence[Sequence[_Speed]],
        headers: MessageColumns,
    ) -> MessageColumns:
        """Return messages of the windows that end with n readings, and with which they end."""
        parts, before, (known, rates) = [], 0, _by_source(speeds)
        with np.errstate(all="ignore"):  # speeds and angles may be any 64 bits
            for start in range(0, max(len(time), 1), _CHUNK):
                few = slice(start, start + _CHUNK)
                numbers = crank[:, few], time[few], known[:, few]
                parts.append(self.rules.assess(predictions.rows(few), *numbers, self._timer))
            columns = joined(parts)
            vars(columns).update(vars(headers), time=time, rates=rates)
            if self._open is not None:
                before, columns = len(self._open), joined([self._open, columns])
            rows, ends, done = _published(columns)
            self._open = columns.rows(slice(done, None)) if done < len(columns) else None
            columns = columns.rows(rows)
            columns.ends_at = ends - before
            self._complete(columns)
        return columns

    def _complete(self, columns: MessageColumns) -> None:
        """Add what only messages that are published have: count, factors, what ends a warning."""
        n, levels = len(columns), self.rules.levels
        columns.count = (self.count + 1 + np.arange(n)).astype(np.uint32)
        self.count += n
        self.rules.set_rates(columns)
        columns.unknown_factors = levels.unknown_factors if levels else ""
        if levels is not None and levels.n_members and n:
            self._set_factors(levels, columns)
        sources = self.rules.sources.take(columns.excitation_index)
        columns.quiet_speed, columns.quiet_angle = self._quieter(columns, sources)
        columns.quiet_speed *= _SI.take(sources)

    def _set_factors(self, levels: LevelTable, columns: MessageColumns) -> None:
        """Set the factors of n messages, which are computed once a second and in a new state."""
        due, rows = [], []  # the rows that are evaluated, and how many of these precede each row
        moments = zip(columns.time.tolist(), columns.state.tolist(), strict=True)
        for row, (now, state) in enumerate(moments):
            held = 0 <= now - self._factors_time < 1e9 * _FACTORS_FOR
            if not held or state != self._factors_state:
                self._factors_time, self._factors_state = now, state
                due.append(row)
            rows.append(len(due))
        limit = self.rules.limits.warning
        self._factors = levels.set_factors(columns, due, rows, self._factors, limit)

    def _quieter(self, columns: MessageColumns, sources: Integers) -> FloatArray:
        """Return the nearest speeds and angles that end warnings, (2, n), or NaN."""
        quiet = np.full((2, len(columns)), math.nan)
        warned = columns.state == WARNING
        if warned.any():
            warned &= ~is_kept(columns)
        for source in np.unique(sources[warned]).tolist():
            rows = np.flatnonzero(warned & (sources == source))
            while len(rows):
                held = self._held(columns, rows, source)
                if held:
                    quiet[:, rows[:held]] = self._quiet[source][2][:, np.newaxis]
                    rows = rows[held:]
                    continue
                row, rows = rows[0], rows[1:]
                speeds, angle = columns.speeds[row], columns.crank_angle[row]
                quiet[:, row] = sought = self.rules.sought(angle, speeds, source)
                present = np.array([speeds[source], angle])
                self._quiet[source] = int(columns.time[row]), present, sought
        return quiet

    def _held(self, columns: MessageColumns, rows: Integers, source: int) -> int:
        """Return for how many of these rows, from the first one on, the last answer holds."""
        if source not in self._quiet:
            return 0
        then, before, sought = self._quiet[source]
        age = columns.time[rows] - then
        rows = rows[: _leading((age >= 0) & (age < 1e9 * _QUIET_FOR))]
        speeds, angles = columns.speeds[rows].T, columns.crank_angle[rows]
        present = np.stack([speeds[source], angles], axis=1)
        passed = ((sought - before) * (sought - present) < 0.0).any(axis=1)
        return _leading(self.rules.ends(sought, angles, speeds, source) & ~passed)


def _leading(values: BoolArray) -> int:
    """Return how many values precede the first that is false."""
    return int(np.append(values, False).argmin())
