# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Weightings and exposures follow the tables of the standards."""

import math

import numpy as np
import pytest

from linkage_vibration.listening.exposure import exposure, kinds_of_work, weighting
from linkage_vibration.listening.signals import measured_signal
from test.listening.test_signals import sensor

# Table 3 of ISO 2631-1:1997 in thousandths, as transcribed by several public programs. Its 212 of
# Wd at 10 Hz is 5 % off its own Annex A, whose formula is 202: sqrt(1 + 25) for the transition,
# times sqrt(6.35 / (3969 + 82.5 + 6.35)) for the low pass at 2 Hz with Q = 0.63.
THIRDS = [0.5, 0.63, 0.8, 1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0, 10.0, 12.5, 16.0]
THIRDS += [20.0, 25.0, 31.5, 40.0, 50.0, 63.0, 80.0]
WK = [418, 459, 477, 482, 484, 494, 531, 631, 804, 967, 1039, 1054, 1036, 988, 902, 768, 636, 513]
WK += [405, 314, 246, 186, 132]
WD = [853.0, 944, 992, 1011, 1008, 968, 890, 776, 642, 512, 409, 323, 253, 202, 161, 125, 100]
WD += [80, 63.2, 49.4, 38.8, 29.5, 21.1]
EXACT = 10.0 ** (np.round(10.0 * np.log10(THIRDS)) / 10.0)  # Hz, which the names round


@pytest.mark.parametrize(("vertical", "table"), [(True, WK), (False, WD)])
def test_weightings_are_those_of_the_table(vertical: bool, table: list[float]) -> None:
    """Both weightings agree with the table to 1.5 %, a tenth of what ISO 8041 tolerates."""
    gain = np.abs(weighting(EXACT, vertical=vertical))
    np.testing.assert_allclose(1000.0 * gain, table, rtol=0.015)


def test_weightings_at_the_reference_frequency() -> None:
    """At 100 rad/s, ISO 8041 states 0.7718 for Wk and 0.1261 for Wd."""
    at = np.array([100.0 / (2.0 * math.pi)])
    assert abs(weighting(at, vertical=True)[0]) == pytest.approx(0.7718, abs=2e-4)
    assert abs(weighting(at, vertical=False)[0]) == pytest.approx(0.1261, abs=2e-4)


def test_a_tone_on_the_seat() -> None:
    """Ten minutes of 1 m/s2 rms at 16 Hz (exactly 15.85 Hz) are 0.768 along z, 1.4 x 0.125 along x.

    A(8) is that times the root of 10 min over 8 h, and reaches 0.5 m/s2 after 8 h (0.5 / 0.768)^2.
    """
    times = np.arange(0.0, 600.0, 0.01)
    tone = math.sqrt(2.0) * np.sin(2.0 * math.pi * EXACT[15] * times)
    values = np.column_stack([tone, 0.0 * tone, tone + 9.81])
    signal = measured_signal(sensor(at="seat"), times, values, 20.0)
    felt = exposure(signal, np.where(times < 150.0, 0, 2))
    np.testing.assert_allclose(felt.weighted, [1.4 * 0.125, 0.0, 0.768], rtol=0.01, atol=1e-3)
    assert felt.a8 == pytest.approx(0.768 * math.sqrt(10.0 / 480.0), rel=0.01)
    assert felt.hours_until(0.5) == pytest.approx(8.0 * (0.5 / 0.768) ** 2, rel=0.02)
    assert felt.shares == {
        "standing": pytest.approx((0.25, 1.0, 0.0), abs=0.01),
        "work": pytest.approx((0.75, 1.0, 0.0), abs=0.01),
    }


def test_gaps_are_not_measured_time() -> None:
    """Two times 100 s of 1 m/s2 rms with 400 s between count as 200 s, in which nothing is weaker.

    One second of the first is work, and one of the second is of an unknown kind.
    """
    times = np.concatenate([np.arange(0.0, 100.0, 0.005), np.arange(500.0, 600.0, 0.005)])
    tone = math.sqrt(2.0) * np.sin(2.0 * math.pi * EXACT[15] * times)
    values = np.column_stack([0.0 * tone, 0.0 * tone, tone + np.where(times < 200.0, 9.8, 4.0)])
    signal = measured_signal(sensor(at="seat"), times, values, 20.0)
    kinds = np.select([times < 1.0, times >= 599.0], [2, 3], 0)
    felt = exposure(signal, kinds)
    assert felt.seconds == pytest.approx(200.0)
    np.testing.assert_allclose(felt.weighted, [0.0, 0.0, 0.768], rtol=0.01, atol=1e-3)
    assert felt.a8 == pytest.approx(0.768 * math.sqrt(200.0 / 28800.0), rel=0.01)
    assert {name: share for name, (share, _, _) in felt.shares.items()} == {
        "standing": pytest.approx(0.99),
        "work": pytest.approx(0.005),
        "not known": pytest.approx(0.005),
    }


def test_kinds_of_work() -> None:
    """Below 0.3 m/s it stands; in the upper quarter of the stroke it is transport, if it moves."""
    speed = np.array([0.0, 0.29, -2.0, 2.0, 2.0, math.nan, 2.0, 0.0])
    height = np.array([0.0, 1.0, 0.74, 0.74, 0.76, 0.9, math.nan, math.nan])
    assert kinds_of_work(speed, height).tolist() == [0, 0, 2, 2, 1, 3, 3, 0]
