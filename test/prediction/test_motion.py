# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Estimated velocities, and bounds of their errors, against known motions."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs.units import HitchCurve, HitchScale
from linkage_vibration.prediction.motion import (
    _EXPLAINED,
    RateFilter,
    _residuals,
    crank_filter,
    crank_resolution,
    speed_filter,
    wrapped_turn,
)
from test.support.motions import MOTIONS, SENSORS, Sensor, read

SECOND = 10**9  # ns
GAP = SECOND // 2  # ns


def test_residual_by_four_means() -> None:
    """It is the cubic term through the means; each step explains its part of it.

    The reference is the last row of the inverse of a Vandermonde matrix.
    """
    times, values = np.array([0.0, 0.2, 0.3, 0.7]), np.array([1.0, 4.0, 2.0, 5.0])
    shares = np.array([1.0, 0.5, 0.7, 0.3])
    weights = np.linalg.inv(np.vander(times, increasing=True))[3]
    norm, total = np.linalg.norm(weights * shares), abs(weights @ values)
    for steps in np.vstack([0.3 * np.eye(4), [0.1, 0.2, 0.05, 0.4]]):
        rows = np.column_stack([times, values, steps, shares]).tolist()
        error, noise = _residuals([(a, v, h, n) for a, v, h, n in rows])
        allowed = _EXPLAINED * np.abs(weights) @ steps
        assert (error, noise) == pytest.approx((total / norm, (total - allowed) / norm))
        assert noise > 0.0


LONG = "noise of 0.1 deg, 1 kHz", "noise of 0.5 deg, 1 kHz"  # They take long; 0.02 deg remains.


@pytest.mark.parametrize(
    "name", [pytest.param(s, marks=pytest.mark.nightly) if s in LONG else s for s in SENSORS]
)
def test_no_direction_is_wrong(name: str) -> None:
    """No direction is reported for a hitch at rest or opposite to the true one; bounds hold.

    A hitch that accelerates faster than assumed is noticed a moment later.
    """
    sensor = SENSORS[name]
    for motion, angles in MOTIONS.items():
        for seed in range(2):
            stamps, values, _, true = read(angles, sensor, seed)
            resolutions = [sensor.step if sensor.stated else 0.0] * len(values)
            velocity, error = crank_filter().add_many(stamps, values, resolutions)
            known = np.isfinite(velocity)
            directed = np.abs(velocity) > error
            assert not (directed & (velocity * true <= 0.0)).any(), motion
            within = (np.abs(velocity - true) <= error)[known]
            assert within.mean() > 0.95, motion
            assert known.mean() > 0.85


@pytest.mark.parametrize(
    ("name", "share"),
    [("percent, 10 Hz", 0.9), ("exact, 50 Hz", 0.98), ("noise of 0.1 deg, 1 kHz", 0.9)],
)
def test_directions_of_lifts_are_known(name: str, share: float) -> None:
    """The direction of a hitch that is lifted is known nearly always."""
    sensor = SENSORS[name]
    for motion in ("lift in 2.5 s", "lift in 4 s", "slow lift in 6 s"):
        stamps, values, _, true = read(MOTIONS[motion], sensor, 1)
        resolutions = [sensor.step if sensor.stated else 0.0] * len(values)
        velocity, error = crank_filter().add_many(stamps, values, resolutions)
        assert (np.abs(velocity) > error)[np.abs(true) > 0.1].mean() > share


def test_one_step_is_no_motion() -> None:
    """A sensor that alternates between two steps while the hitch stands still is no motion."""
    step = 0.004 * math.pi / 2.0
    crank = crank_filter()
    actual = [crank.add(i * SECOND // 10, 2.0 + step * (i % 7 == 0), step)() for i in range(200)]
    assert all(abs(each.value) <= each.error for each in actual[20:])


def test_gaps_and_jumps_of_the_clock() -> None:
    """After a gap, a jump back or a jump ahead, the rate is not known until there are two means."""
    for jump in (GAP + 1, -5 * SECOND, 10**17):
        crank, time = crank_filter(), 10**18
        for i in range(40):
            rate = crank.add(time, 2.0 + 0.02 * i)()
            time += SECOND // 25
        assert rate.value == pytest.approx(0.5)
        time += jump
        assert math.isnan(crank.add(time, 2.8)().error)
        for i in range(1, 10):
            rate = crank.add(time + i * SECOND // 25, 2.8 - 0.02 * i)()
        assert rate.value == pytest.approx(-0.5)
        assert rate.error < 0.5


def test_readings_that_give_no_rate() -> None:
    """Stamps that stay the same, and values that are not finite, give no rate."""
    crank = crank_filter()
    assert all(math.isnan(crank.add(0, 2.0 + 0.1 * i)().value) for i in range(50))
    for value in (math.nan, math.inf, -math.inf):
        assert math.isnan(crank.add(0, value)().value)


def test_an_exact_ramp_of_a_speed() -> None:
    """A speed that rises by the same amount each time is not taken for steps of its sensor."""
    engine = speed_filter(Source.ENGINE)
    actual = [engine.add(i * SECOND // 10, 1000.0 + 10.0 * i)() for i in range(20)][-1]
    assert actual.value == pytest.approx(100.0)
    assert actual.error < 50.0


def test_resolution_of_percent() -> None:
    """The steps of the bus follow from the standard deviations, and are not known without steps."""
    hitch = HitchScale("percent", calibration=HitchCurve((0.0, 3.0, 100.0, 1.5)), angle_stddev=0.01)
    assert crank_resolution(hitch.reading(40.0).stddev, 0.01) == pytest.approx(0.004 * 1.5)
    assert crank_resolution(0.01, 0.01) == 0.0


def test_a_rate_that_is_needed_later() -> None:
    """It is that at its reading, whatever has been read since, and whether others were needed."""
    stamps, values, _, _ = read(next(iter(MOTIONS.values())), Sensor(200, noise=1e-3), 5)
    at_once, later = crank_filter(), crank_filter()
    readings = [*zip(stamps, values, strict=True)]
    expected = np.array([at_once.add(*reading)() for reading in readings])
    estimates = [later.add(*reading) for reading in readings]
    np.testing.assert_array_equal([estimate() for estimate in estimates[::7]], expected[::7])
    assert np.isfinite(expected[:, 0]).sum() > len(readings) / 2


@pytest.mark.parametrize(
    ("new_filter", "bend", "step"),
    [
        (crank_filter, 1.0, 0.01),
        (lambda: speed_filter(Source.ENGINE), 250.0, 1.0),
        (lambda: speed_filter(Source.PTO), 250.0, 1.0),
        (lambda: speed_filter(Source.GROUND), 2.0, 0.1),
    ],
    ids=["crank", "engine", "pto", "ground"],
)
def test_error_of_a_quantity_at_rest(
    new_filter: Callable[[], RateFilter], bend: float, step: float
) -> None:
    """The bound is the least of the bounds of the pairs of readings, found on paper.

    A pair that is k readings apart errs by half a step at each end over the time k h between them,
    and by the bend times the time k h / 2 since their middle.
    """
    rest, h = new_filter(), 0.1
    actual = [rest.add(i * SECOND // 10, 5.0)() for i in range(30)][-1]
    expected = min(step / (k * h) + bend * k * h / 2.0 for k in range(1, 9))
    assert (actual.value, actual.error) == (0.0, pytest.approx(expected))
    for coarse in (2.0 * step, 100.0 * step):  # the latter needs the farthest of eight readings
        stated = new_filter()
        actual = [stated.add(i * SECOND // 10, 5.0, coarse)() for i in range(30)][-1]
        expected = min(coarse / (k * h) + bend * k * h / 2.0 for k in range(1, 9))
        assert actual.error == pytest.approx(expected)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_not_known_changes_nothing(value: float) -> None:
    """After it, the rates are those of the other readings alone."""
    whole, without = crank_filter(), crank_filter()
    for i in range(60):
        if i % 10 == 5:
            assert math.isnan(whole.add(i * SECOND // 25, value)().value)
            continue
        reading = i * SECOND // 25, 2.0 + 0.01 * i
        np.testing.assert_array_equal(whole.add(*reading)(), without.add(*reading)())
    assert math.isfinite(without.add(60 * SECOND // 25, 2.6)().value)


def test_a_move_in_a_gap_is_no_rate() -> None:
    """What moved while nothing was read does not count for the rates after it."""
    crank = crank_filter()
    for i in range(30):
        crank.add(i * SECOND // 25, 2.0 + 0.001 * i)
    begin = 29 * SECOND // 25 + GAP + 1
    actual = [crank.add(begin + i * SECOND // 25, 2.5 - 0.02 * i)() for i in range(6)]
    assert [each.value for each in actual[2:]] == pytest.approx([-0.5] * 4)


def test_sensor_that_wraps() -> None:
    """A hitch about half a turn has the same rates by a sensor that wraps as by one that does not.

    A jump beyond half a turn is none of a wrap, if a sensor reports an angle beyond half a turn.
    """
    stamps = [10**18 + i * SECOND // 50 for i in range(300)]
    true = [math.pi + 0.3 * math.sin(0.04 * i) for i in range(300)]
    wrapped = [math.remainder(angle, 2.0 * math.pi) for angle in true]
    whole, broken = crank_filter().add_many(stamps, true), crank_filter().add_many(stamps, wrapped)
    np.testing.assert_allclose(broken, whole, rtol=0.0, atol=1e-9)
    assert np.isfinite(whole[0]).mean() > 0.8
    assert wrapped_turn(-math.pi, math.pi) == 2.0 * math.pi
    assert wrapped_turn(math.pi, -math.pi) == -2.0 * math.pi
    assert wrapped_turn(0.0, 3.1) == wrapped_turn(-0.1, math.nan) == wrapped_turn(-3.0, 3.3) == 0.0
