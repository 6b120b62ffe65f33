# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Weightings and exposures follow the tables of the standards."""

import math

import numpy as np
import pytest

from linkage_vibration.listening.exposure import exposure, kinds_of_work, weighting
from linkage_vibration.listening.signals import measured_signal
from test.listening.test_signals import sensor

# Table 3 of ISO 2631-1:1997 in thousandths, as transcribed by several public programs. Above 8 Hz,
# transcriptions of Wd differ in the third digit; 10, 50, 63 and 80 Hz are left out.
THIRDS = [0.5, 0.63, 0.8, 1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0, 12.5, 16.0, 20.0]
THIRDS += [25.0, 31.5, 40.0]
WK = (
    418,
    459,
    477,
    482,
    484,
    494,
    531,
    631,
    804,
    967,
    1039,
    1054,
    1036,
    902,
    768,
    636,
    513,
    405,
    314,
)
WD = (
    853,
    944,
    992,
    1011,
    1008,
    968,
    890,
    776,
    642,
    512,
    409,
    323,
    253,
    161,
    125,
    100,
    80,
    63.2,
    49.4,
)
EXACT = 10.0 ** (np.round(10.0 * np.log10(THIRDS)) / 10.0)  # Hz, which the names round


@pytest.mark.parametrize(("vertical", "table"), [(True, WK), (False, WD)])
def test_weightings_are_those_of_the_table(vertical: bool, table: tuple[float, ...]) -> None:
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
    tone = math.sqrt(2.0) * np.sin(2.0 * math.pi * EXACT[14] * times)
    values = np.column_stack([tone, 0.0 * tone, tone + 9.81])
    signal = measured_signal(sensor(at="seat"), times, values, 20.0)
    kinds = np.where(times < 150.0, 0, 2)
    found = exposure(signal, kinds)
    np.testing.assert_allclose(found.weighted, [1.4 * 0.125, 0.0, 0.768], rtol=0.01, atol=1e-3)
    assert found.a8 == pytest.approx(0.768 * math.sqrt(10.0 / 480.0), rel=0.01)
    assert found.hours_until(0.5) == pytest.approx(8.0 * (0.5 / 0.768) ** 2, rel=0.02)
    assert found.shares == {
        "standing": pytest.approx((0.25, 1.0, 0.0), abs=0.01),
        "work": pytest.approx((0.75, 1.0, 0.0), abs=0.01),
    }


def test_kinds_of_work() -> None:
    """Below 0.3 m/s it stands; with the hitch in the upper quarter of its range it is transport."""
    speed = np.array([0.0, 0.29, -2.0, 2.0, 2.0, math.nan])
    height = np.array([0.0, 1.0, 0.74, 0.74, 0.76, 0.9])
    assert kinds_of_work(speed, height).tolist() == [0, 0, 2, 2, 1, 2]
