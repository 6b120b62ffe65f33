# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The columns of resonances against the rules of docs/excitation.md in plain Python."""

import math
from typing import Any

import numpy as np
import pytest

from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor, predict_many
from linkage_vibration.prediction.resonance import ReportedSpeed, ResonanceMonitor, described
from linkage_vibration.prediction.severity import Unknown, WarningLimits, present_sentence
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import DEFAULT_MECHANISM, DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table
from test.support.in_plane import plane_mechanism, plane_table

SECOND, N = 10**9, 800
UNKNOWN, CLEAR, NOTE, WARNING = range(4)
WARNING_RATIO, NOTE_RATIO, NEAR, DWELL = 0.008, 0.002, 0.1, 0.5
ORDERS = excitations_from_mapping(
    {
        "engine": {"speed": "engine", "orders": [1, 3], "frequency_stddev": 0.01},
        "shaft": {
            "speed": "pto",
            "orders": [1, 2],
            "force": [60.0, 60.0],
            "at": "E1.z",
            "at_speed": 540.0,
            "exponent": 2,
            "no_warning": [2],
        },
        "lugs": {"speed": "ground", "rolling_radius": 0.8, "orders": [20]},
    }
)


def below(value: float, mean: float, stddev: float) -> float:
    """Return the probability that a normal number is below a value."""
    return 0.5 * math.erfc((mean - value) / (stddev * math.sqrt(2.0)))


class Rules:
    """The rules for one excitation after the other; load ratios are those of the messages."""

    def __init__(self, with_levels: bool) -> None:
        self.with_levels = with_levels
        n = len(ORDERS) + 1
        self.warns, self.since = [False] * n, [math.inf] * n
        self.seen = [-math.inf] * n

    def _follow(self, k: int, exceeds: bool, known: bool, time: float) -> bool:
        """Return whether a limit warns: it changes once it has said otherwise for long enough."""
        if time - self.seen[k] > 3.0:
            self.warns[k], self.since[k], self.seen[k] = False, math.inf, time
        if not known:
            return self.warns[k]
        self.seen[k] = time
        if exceeds == self.warns[k]:
            self.since[k] = math.inf
        else:
            self.since[k] = min(self.since[k], time)
            if time - self.since[k] >= DWELL:
                self.warns[k], self.since[k] = exceeds, math.inf
        return self.warns[k]

    def reported(
        self, row: dict[str, Any], speeds: dict[Source, float], time: int, loads: list[float]
    ) -> Any:
        """Return the states, that of all, and the most severe excitation with its numbers.

        The loads are the load ratios, then the total. The last is None if all are stale.
        """
        states, ranked, seconds = [], [], time / SECOND
        for k, each in enumerate(ORDERS):
            exceeds = loads[k] > WARNING_RATIO and each.warns
            warns = self._follow(k, exceeds, not math.isnan(loads[k]), seconds)
            modes = [i for i, natural in enumerate(row["f"]) if not math.isnan(natural)]
            frequency = each.ratio * speeds.get(each.source, math.nan)
            if each.source not in speeds or not modes:
                states.append(WARNING if warns else UNKNOWN)
                kept = 2, False, -math.inf, -k, (-1, frequency, *[math.nan] * 3)
                ranked += [kept] * warns
                continue
            mode = min(modes, key=lambda i: abs(frequency - row["f"][i]) / row["f"][i])
            natural = row["f"][mode]
            probability = self._probability(each, frequency, row, mode)
            apart = abs(frequency - natural) / natural
            known = not math.isnan(loads[k])
            calm = NOTE if (loads[k] > NOTE_RATIO if known else apart < NEAR) else CLEAR
            states.append(WARNING if warns else calm)
            rate = -row["slope"][mode] * row["velocity"]
            rank = {CLEAR: 0, NOTE: 1, WARNING: 2}[states[-1]]
            order = (rank, known, loads[k] if known else -apart, -k)
            ranked.append((*order, (mode, frequency, natural, probability, rate)))
        whole = len(speeds) == len(Source) and not all(math.isnan(f) for f in row["f"])
        high = loads[-1] > WARNING_RATIO
        known = high or (whole and not math.isnan(loads[-1]))
        total = WARNING if self._follow(-1, high, known, seconds) else CLEAR
        total = NOTE if total == CLEAR and loads[-1] > NOTE_RATIO else total
        if not ranked:
            return states, WARNING if total == WARNING else UNKNOWN, None
        best = max(ranked)
        ranks = {0: CLEAR, 1: NOTE, 2: WARNING}
        overall = ranks[max(best[0], {CLEAR: 0, NOTE: 1, WARNING: 2}[total])]
        if overall == CLEAR and not whole:
            overall = UNKNOWN
        return states, overall, best[3:]

    def _probability(self, first: Any, f: float, row: dict[str, Any], mode: int) -> float:
        if not self.with_levels:
            return math.nan
        stddev, zeta, natural = row["s"][mode], row["zeta"][mode], row["f"][mode]
        low, high = (
            below(edge * natural, f, math.hypot(edge * stddev, first.relative_stddev * f))
            for edge in (1.0 - zeta, 1.0 + zeta)
        )
        return high - low


def drive() -> tuple[list[float], list[int], dict[Source, list[float]]]:
    """Return angles, times (ns) and speeds of readings, with times at which one is not known."""
    angles = [2.35 + 0.9 * math.sin(0.013 * k) for k in range(N)]  # it leaves the table, too
    times = [10 * SECOND + k * SECOND // 100 for k in range(N)]
    engine = [1200.0 + 900.0 * math.sin(0.004 * k + 1.0) for k in range(N)]
    pto = [0.45 * speed if k > 300 else math.nan for k, speed in enumerate(engine)]
    ground = [3.0 + 2.5 * math.sin(0.011 * k) if k % 400 < 350 else 0.0 for k in range(N)]
    return angles, times, dict(zip(Source, (engine, pto, ground), strict=True))


@pytest.mark.parametrize("with_levels", [False, True])
def test_every_number_follows_the_rules(with_levels: bool) -> None:
    """State, order, margin, probability and time to crossing of 800 readings are those on paper.

    Each reading follows a speed of each source, whose rates are those of a hitch that moves alone:
    the speeds are fixed, so that only the crank changes the margin. With levels, orders in the
    plane are near no mode of the lateral half.
    """
    predictor = Predictor(load_table(config_file(DEFAULT_TABLE)))
    levels = LevelTable(predictor, read_mechanism(config_file(DEFAULT_MECHANISM)), ORDERS)
    limits = WarningLimits(WARNING_RATIO, NOTE_RATIO, DWELL, NEAR)
    monitor = ResonanceMonitor(ORDERS, limits, levels=levels if with_levels else None)
    angles, times, speeds = drive()
    rules, seen = Rules(with_levels), set()
    velocities = np.gradient(angles, 0.01)
    predictions = predict_many(predictor, np.array(angles), np.zeros(N))
    aside = predictor.table.lateral_modes & with_levels
    naturals = np.where(aside, math.nan, predictions.natural_frequencies)
    for k in range(N):
        now = {s: column[k] for s, column in speeds.items() if not math.isnan(column[k])}
        for source in Source:
            monitor.set_fixed(source, now.get(source))
        assessed = monitor.assess_many(
            predictions.rows(slice(k, k + 1)),
            velocities[k : k + 1],
            np.array([times[k]]),
            (),
            np.zeros(1),
        )
        actual = described(assessed).message(0)
        row = {
            "f": naturals[k].tolist(),
            "zeta": predictions.damping_ratios[k].tolist(),
            "slope": predictions.frequency_slopes[k].tolist(),
            "s": predictions.frequency_stddevs[k].tolist(),
            "velocity": float(velocities[k]),
        }
        loads = [*actual.load_ratios.tolist(), float(actual.total_load_ratio)]
        states, overall, best = rules.reported(row, now, times[k], loads)
        assert actual.states.tolist() == states, k
        assert actual.state == overall, k
        seen |= {*states, overall}
        lost = {s: bit for s, bit in zip(Source, (2, 4, 8), strict=True) if s not in now}
        nowhere = all(math.isnan(natural) for natural in row["f"])
        assert actual.unknown_sources == sum(lost.values()) + nowhere, k
        assert actual.known_share == np.float32(np.mean(np.isfinite(loads[:-1])))
        assert actual.count == k + 1
        if best is None:
            assert (actual.excitation, actual.mode) == ("", -1)
            assert math.isnan(actual.margin)
            continue
        place, (mode, frequency, natural, probability, rate) = -best[0], best[1]
        assert (actual.excitation, actual.mode) == (ORDERS[place].name, mode), k
        margin = frequency - natural
        closing = -rate if margin > 0.0 else rate
        crossing = abs(margin) / closing if closing > 0.0 else 0.0 * closing + math.inf
        expected = [frequency, natural, margin, margin / natural, closing, crossing]
        names = ["excitation_frequency", "natural_frequency", "margin", "relative_margin"]
        names += ["approach_rate", "time_to_crossing"]
        numbers = [getattr(actual, name) for name in names]
        assert numbers == pytest.approx(expected, rel=1e-9, abs=1e-12, nan_ok=True), k
        assert actual.probability == pytest.approx(probability, abs=1e-12, nan_ok=True), k
        assert actual.approach == (closing > 0.0) - (closing < 0.0)
    assert seen == {CLEAR, UNKNOWN, NOTE} | ({WARNING} if with_levels else set())


def test_blocks_are_readings_one_after_the_other() -> None:
    """Where a block ends, and where speeds are reported within it, changes no number."""
    predictor = Predictor(load_table(config_file(DEFAULT_TABLE)))
    angles, times, speeds = drive()
    predictions = predict_many(predictor, np.array(angles), np.zeros(N))
    velocities, now = np.gradient(angles, 0.01), np.array(times)
    columns = []
    for size in (1, 700, N):  # the largest is more than is assessed together
        monitor, parts = ResonanceMonitor(ORDERS), []
        for start in range(0, N, size):
            rows = slice(start, start + size)
            reports = [
                ReportedSpeed(k - start, source, column[k], times[k])
                for k in range(start, min(start + size, N))
                for source, column in speeds.items()
                if k % 5 == 0
            ]
            numbers = velocities[rows], now[rows], reports, np.zeros(len(now[rows]))
            parts.append(monitor.assess_many(predictions.rows(rows), *numbers))
        columns.append(
            {
                name: np.concatenate([getattr(p, name) for p in parts])
                for name in vars(parts[0])
                if name not in ("table_id", "ends_at", "unknown_factors")
            }
        )
    for other in columns[1:]:
        for name, column in columns[0].items():
            np.testing.assert_array_equal(other[name], column, name)


def test_an_order_beyond_the_table_is_not_calm() -> None:
    """The sentence names it; with all orders of its shaft, the state is not known either."""
    table = load_table(config_file(DEFAULT_TABLE))
    predictor = Predictor(table)
    levels = LevelTable(predictor, read_mechanism(config_file(DEFAULT_MECHANISM)), ORDERS)
    none, every = ("", "shaft 1 and shaft 2")
    for share, bits, state, names in (
        (0.999, 0, CLEAR, none),
        (1.001, 0, CLEAR, "shaft 2"),
        (1.999, 0, CLEAR, "shaft 2"),
        (2.001, Unknown.ORDER_LEVEL, UNKNOWN, every),
    ):
        monitor = ResonanceMonitor(ORDERS, WarningLimits(1e9, 1e9, DWELL, 1e-3), levels=levels)
        # At 1 the second order of the shaft is at the band's end, and at 2 the first.
        for source, value in zip(Source, (0.0, 30.0 * share * table.band[1], 0.0), strict=True):
            monitor.set_fixed(source, value)
        actual = described(monitor.assess(predictor.predict(2.3), 0.0, SECOND))
        assert (actual.state, actual.unknown_sources) == (state, bits)
        assert [s == UNKNOWN for s in actual.states[2:4]] == [share > 2.0, share > 1.0]
        text = present_sentence(actual, ORDERS)
        assert (f"and so not known: {names}." in text) is bool(names and not bits)
        assert ("known loads" in text) is bool(names and not bits)


def test_what_ends_a_warning_ends_it_in_each_message() -> None:
    """While a hitch moves, the stated speed or angle keeps the limit with the message's own other.

    It is sought once a second; without the check of each message, 36 of these do not keep it.
    """
    predictor = Predictor(load_table(config_file(DEFAULT_TABLE)))
    rotor = {"speed": "pto", "orders": [1], "force": [800.0], "at": "E1.z", "at_speed": 540.0}
    excitations = excitations_from_mapping({"rotor": rotor})
    levels = LevelTable(predictor, read_mechanism(config_file(DEFAULT_MECHANISM)), excitations)
    limit, rpm = 0.05, 400.0
    monitor = ResonanceMonitor(excitations, WarningLimits(limit, limit, 0.0, 0.0), levels=levels)
    monitor.set_fixed(Source.PTO, rpm)
    angles, still = np.radians(np.linspace(170.0, 100.0, 200)), np.zeros(200)
    predictions = predict_many(predictor, angles, still)
    times = np.arange(200) * SECOND // 100
    found = monitor.assess_many(predictions, still, times, (), still)
    stated = 0
    for at in np.flatnonzero(found.state == WARNING):
        speed = found.quiet_speed[at] * 30.0 / math.pi
        for angle, pto in ((angles[at], speed), (found.quiet_angle[at], rpm)):
            if not math.isnan(angle + pto):
                load = levels.at(np.array([angle]), np.array([[0.0], [pto], [0.0]]))
                assert load.total_load_ratio[0] <= limit
                stated += 1
    assert stated > 100


@pytest.fixture(scope="module")
def field() -> tuple[tuple[Excitation, ...], LevelTable]:
    """Return a field of class D and its levels in the plane."""
    keys = {"terrain": {"class": "D"}, "raised": True, "lugs": 20, "rolling_radius": 0.8}
    excitations = excitations_from_mapping({"field": {"speed": "ground", **keys}})
    return excitations, LevelTable(Predictor(plane_table()), plane_mechanism(), excitations)


def test_ground_without_levels_is_not_known(
    field: tuple[tuple[Excitation, ...], LevelTable],
) -> None:
    """Without a table that gives levels, a field is not calm, also for a tractor that stands."""
    predictor, (excitations, levels) = Predictor(plane_table()), field
    for given, state in ((None, UNKNOWN), (levels, CLEAR)):
        monitor = ResonanceMonitor(excitations, levels=given)
        monitor.set_fixed(Source.GROUND, 0.0)
        assert monitor.assess(predictor.predict(2.3), 0.0, SECOND).state == state


FAST, LUGS, CALM, OUTSIDE = (5.0, 138.0), (3.0, 138.0), (1.0, 105.0), (5.0, 250.0)  # m/s, deg


@pytest.mark.parametrize(
    ("then", "readings", "state", "why"),
    [
        (LUGS, 1, WARNING, "half of the frequency of the lugs"),
        (LUGS, 30, WARNING, "half of the frequency of the lugs"),
        (LUGS, 31, UNKNOWN, "half of the frequency of the lugs"),
        ((math.nan, 138.0), 30, WARNING, "ground speed is not known"),
        ((math.nan, 138.0), 31, UNKNOWN, "ground speed is not known"),
        (OUTSIDE, 30, WARNING, "outside the table"),
        (OUTSIDE, 31, UNKNOWN, "outside the table"),
        (CALM, 10, WARNING, "exerts 0.1"),  # it is known to be over, for less than a second
        (CALM, 11, NOTE, "All loads are 0.1"),
        (FAST, 31, WARNING, "exerts 0.4"),
    ],
)
def test_a_warning_is_kept_until_it_is_over_or_unknown_for_3_s(
    field: tuple[tuple[Excitation, ...], LevelTable],
    then: tuple[float, float],
    readings: int,
    state: int,
    why: str,
) -> None:
    """On a field of class D it is kept where the level becomes unknown, read one by one or at once.

    It begins with the reading before, so that it would last for 0.1 s without this rule.
    """
    (excitations, levels), drive = field, [FAST] * 11 + [then] * readings
    predictor = levels.predictor
    times, still = np.arange(len(drive)) * SECOND // 10, np.zeros(len(drive))
    one, block = (ResonanceMonitor(excitations, levels=levels) for _ in range(2))
    rows = predict_many(predictor, np.radians([angle for _, angle in drive]), still)
    speeds = [
        ReportedSpeed(k, Source.GROUND, v, t)
        for k, ((v, _), t) in enumerate(zip(drive, times.tolist(), strict=True))
    ]
    states = block.assess_many(rows, still, times, speeds, still).state.tolist()
    for (speed, angle), time in zip(drive, times.tolist(), strict=True):
        one.set_speed(Source.GROUND, speed, time)
        last = one.assess(predictor.predict(math.radians(angle)), 0.0, time)
        assert last.state == states.pop(0)
    assert last.state == state
    sentence = present_sentence(described(last), excitations)
    assert why in sentence
    kept = state == WARNING and then not in (CALM, FAST)
    assert sentence.startswith("The warning is kept for up to 3 s") is kept
    assert math.isnan(last.quiet_speed) or not kept
