# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""When a mode has time to build up: the thresholds of the rule for fast passes, on both sides.

On paper: vibration of a mode builds up in the time 1 / (2 pi r), where r (Hz) is the half-power
half-width, and an excitation whose distance from the mode changes at a rate (Hz/s) passes 2 r in
the time 2 r / rate. It has time to build up if 2 r / rate >= 1 / (2 pi r), so up to 4 pi r^2.
"""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from linkage_vibration.prediction.batch import predict_many
from linkage_vibration.prediction.excitation import Source, excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import (
    ReportedSpeed,
    ResonanceMonitor,
    ResonanceState,
    WarningLimits,
)
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table

NAME = "three_point_linkage_on_tractor"
ANGLE, MODE = 2.3, 3
NOTE, WARNING = ResonanceState.NOTE, ResonanceState.WARNING
ENGINE = {"speed": "engine", "orders": [1]}
FORCE = {**ENGINE, "force": [100.0], "at": "E1.z", "at_speed": 600.0}
LIMITS = WarningLimits(level=1e-9, probability=1e-9, margin=0.1)


def new_monitor(with_level: bool, limits: WarningLimits) -> ResonanceMonitor:
    """Return a monitor of one order of the engine, which has a level if it has an amplitude."""
    excitations = excitations_from_mapping({"engine": FORCE if with_level else ENGINE})
    mechanism = read_mechanism(config_file(f"{NAME}.yaml"))
    levels = LevelTable(PREDICTOR, mechanism, excitations) if with_level else None
    return ResonanceMonitor(excitations, limits, levels=levels)


def assess(
    frequency: float,
    crank_velocity: float,
    *,
    times: Sequence[float] = (0.0,),
    velocity_error: float = 0.0,
    with_level: bool = False,
    limits: WarningLimits = LIMITS,
) -> list[ResonanceState]:
    """Return the states at times, s, one by one, which are those of all times at once.

    The speed is fixed, so the distance from the mode (Hz) changes only as the crank turns.
    """
    one_by_one, at_once = (new_monitor(with_level, limits) for _ in range(2))
    for monitor in (one_by_one, at_once):
        monitor.set_fixed(Source.ENGINE, 60.0 * frequency)
    nanoseconds = [round(1e9 * time) for time in times]
    prediction, n = PREDICTOR.predict(ANGLE), len(times)
    states = [
        one_by_one.assess(prediction, crank_velocity, time, velocity_error).state
        for time in nanoseconds
    ]
    predictions = predict_many(PREDICTOR, np.full(n, ANGLE), np.zeros(n))
    many = at_once.assess_many(
        predictions,
        np.full(n, crank_velocity),
        np.array(nanoseconds),
        [],
        np.full(n, velocity_error),
    )
    assert many.state.tolist() == states
    return states


PREDICTOR = Predictor(load_table(config_file(f"tables/{NAME}.npz")))
PREDICTION = PREDICTOR.predict(ANGLE)
NATURAL = float(PREDICTION.natural_frequencies[MODE])  # Hz
SLOPE = float(PREDICTION.frequency_slopes[MODE])  # Hz/rad
WIDTH = float(PREDICTION.damping_ratios[MODE]) * NATURAL  # Hz, the half-power half-width


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_fastest_rate_of_a_warning(direction: float) -> None:
    """Up to 4 pi r^2 an excitation warns at once; a faster one is a note."""
    fastest = direction * 4.0 * math.pi * WIDTH**2 / SLOPE
    assert assess(NATURAL, 0.99 * fastest) == [WARNING]
    assert assess(NATURAL, 1.01 * fastest) == [NOTE]


def test_least_possible_rate_counts() -> None:
    """Of a rate that is not known exactly, the least magnitude within its error counts."""
    fastest = 4.0 * math.pi * WIDTH**2 / abs(SLOPE)
    for velocity in (3.0 * fastest, -3.0 * fastest):
        assert assess(NATURAL, velocity, velocity_error=2.02 * fastest) == [WARNING]
        assert assess(NATURAL, velocity, velocity_error=1.98 * fastest) == [NOTE]
    assert assess(NATURAL, math.nan) == [WARNING]  # it may be zero


@pytest.mark.parametrize("off", [0.03, -0.03])
def test_distance_adds_to_the_width_of_a_level(off: float) -> None:
    """Beside a mode, forced vibration builds up faster: the square of r is width^2 + distance^2."""
    frequency = (1.0 + off) * NATURAL
    near = 4.0 * math.pi * WIDTH**2 / SLOPE
    far = 4.0 * math.pi * (WIDTH**2 + (off * NATURAL) ** 2) / SLOPE
    assert abs(far) > 1.1 * abs(near)
    assert assess(frequency, 0.99 * far, with_level=True) == [WARNING]
    assert assess(frequency, 1.01 * far, with_level=True) == [NOTE]
    # Without a level, the half-power band alone counts.
    assert assess(frequency, 0.99 * near) == [WARNING]
    assert assess(frequency, 1.01 * near) == [NOTE]


@pytest.mark.parametrize(("with_level", "off"), [(False, 0.0), (False, 0.03), (True, 0.03)])
def test_time_until_a_mode_has_built_up(with_level: bool, off: float) -> None:
    """A note becomes a warning after 1 / (2 pi r), however fast the pass is."""
    square = WIDTH**2 + ((off * NATURAL) ** 2 if with_level else 0.0)
    built_up = 1.0 / (2.0 * math.pi * math.sqrt(square))  # s
    fast = 9.0 * 4.0 * math.pi * square / SLOPE
    times = (0.0, 0.99 * built_up, 1.01 * built_up)
    found = assess((1.0 + off) * NATURAL, fast, times=times, with_level=with_level)
    assert found == [NOTE, NOTE, WARNING]


def test_dwell_counts_beside_the_rate() -> None:
    """A slow pass becomes a warning after the dwell time, and not before."""
    limits = WarningLimits(dwell=2.0)
    found = assess(NATURAL, 0.0, times=(0.0, 1.99, 2.0), limits=limits)
    assert found == [NOTE, NOTE, WARNING]


def test_end_of_a_warning_by_a_level() -> None:
    """It ends at margin / (margin + hysteresis) of its limit, 0.8 here, and begins above it."""
    watch = new_monitor(True, LIMITS)
    watch.set_fixed(Source.ENGINE, 60.0 * NATURAL)
    level = float(watch.assess(PREDICTION, 0.0, 0).velocity)
    watch = new_monitor(True, LIMITS)
    watch.set_fixed(Source.ENGINE, 60.0 * NATURAL)
    states = []
    for share in (0.99, 1.01, 0.99, 0.81, 0.79, 0.81, 0.99, 1.01):
        watch.limits = WarningLimits(level=level / share, margin=0.1, hysteresis=0.025)
        states.append(watch.assess(PREDICTION, 0.0, 0).state)
    clear = ResonanceState.CLEAR
    assert states == [clear, WARNING, WARNING, WARNING, clear, clear, clear, WARNING]
    assert WarningLimits(margin=0.0).release == 1.0


def test_the_most_severe_of_the_highest_state_is_reported() -> None:
    """A warning comes before a note, that before an order that never warns, whatever is nearest.

    Among those in the same state, the one with the least margin is the most severe.
    """
    fast = 9.0 * 4.0 * math.pi * WIDTH**2 / SLOPE
    orders = {"near": 1.001, "nearer": 0.9995, "silent": 1.0, "far": 1.2}

    def reported(*names: str, crank_velocity: float) -> str:
        mapping = {
            name: {"speed": "engine", "orders": [orders[name]]}
            | ({"no_warning": [orders[name]]} if name == "silent" else {})
            for name in names
        }
        watch = ResonanceMonitor(excitations_from_mapping(mapping), LIMITS)
        watch.set_fixed(Source.ENGINE, 60.0 * NATURAL)
        return str(watch.assess(PREDICTION, crank_velocity, 0).excitation).split()[0]

    for velocity in (0.0, fast):  # all that may warn are warnings, or all are notes
        assert reported("near", "nearer", "silent", "far", crank_velocity=velocity) == "nearer"
        assert reported("silent", "near", "far", crank_velocity=velocity) == "near"
        assert reported("far", "silent", crank_velocity=velocity) == "silent"
    watch = ResonanceMonitor(
        excitations_from_mapping(
            {
                "passing": {"speed": "pto", "orders": [1]},
                "staying": {"speed": "engine", "orders": [1]},
            }
        ),
        LIMITS,
    )
    for i in range(40):  # 0.1 s apart; the PTO's order passes the mode fast
        speed = NATURAL + 50.0 * WIDTH**2 * (i - 39) / 10.0
        watch.set_speed(Source.PTO, 60.0 * speed, i * 10**8)
    watch.set_fixed(Source.ENGINE, 60.0 * 1.01 * NATURAL)
    found = watch.assess(PREDICTION, 0.0, 39 * 10**8)
    assert found.states.tolist() == [NOTE, WARNING]
    assert found.excitation == "staying 1"


def test_a_speed_is_fresh_up_to_its_limit() -> None:
    """It counts at an age of exactly one second, before or after, and no longer."""
    for age, fresh in ((10**9, True), (-(10**9), True), (10**9 + 1, False), (-(10**9) - 1, False)):
        watch = new_monitor(False, LIMITS)
        watch.set_speed(Source.ENGINE, 60.0 * NATURAL, 10**12)
        found = watch.assess(PREDICTION, 0.0, 10**12 + age)
        assert (found.state != ResonanceState.STALE) == fresh


def test_long_series_are_assessed_as_short_ones() -> None:
    """Speeds that are reported among 1200 predictions count from where they were reported."""
    n = 1200
    angles = np.linspace(1.7, 2.9, n)
    times = np.arange(n) * 10**7
    speeds = [
        ReportedSpeed(i, Source.ENGINE, 60.0 * (6.0 + math.sin(0.01 * i)), int(times[i]))
        for i in range(0, n, 7)
    ]
    whole = new_monitor(True, WarningLimits(level=3e-3)).assess_many(
        predict_many(PREDICTOR, angles, np.zeros(n)), np.full(n, 0.12), times, speeds, np.zeros(n)
    )
    watch, reports = new_monitor(True, WarningLimits(level=3e-3)), {s.before: s for s in speeds}
    for i, angle in enumerate(angles.tolist()):
        if (report := reports.get(i)) is not None:
            watch.set_speed(report.source, report.value, report.time)
        one = watch.assess(PREDICTOR.predict(angle), 0.12, int(times[i]))
        for name in ("state", "excitation_frequency", "approach_rate", "velocity"):
            np.testing.assert_array_equal(getattr(whole, name)[i], getattr(one, name))
    assert len(set(whole.state.tolist())) > 1


def test_slow_speeds_excite() -> None:
    """A tractor that creeps at 0.5 m/s excites; one that rests does not, and names nothing."""
    mapping = {
        name: {"speed": "ground", "orders": [order], "rolling_radius": 0.8}
        for name, order in (("lugs", 20), ("cleats", 30))
    }
    watch = ResonanceMonitor(excitations_from_mapping(mapping), LIMITS)
    for speed, frequency in ((0.5, 30 * 0.5 / (2.0 * math.pi * 0.8)), (0.0, math.nan)):
        watch.set_speed(Source.GROUND, speed, 0)
        found = watch.assess(PREDICTION, 0.0, 0)
        assert (found.state == ResonanceState.STALE) == (speed == 0.0)
        assert found.excitation == ("cleats 30" if speed else "")
        assert found.excitation_frequency == pytest.approx(frequency, nan_ok=True)
