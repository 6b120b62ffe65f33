# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Orders are found in a signal whose speed changes, with the noise beside them."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from linkage_vibration.listening.orders import Orders, levels, track_orders
from linkage_vibration.listening.signals import Signal
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.excitation import Source, excitations_from_mapping
from test.listening.test_signals import sensor

RATE, SECONDS = 200.0, 400.0
TIMES = np.arange(0.0, SECONDS, 1.0 / RATE)
ENGINE = 1800.0 + 200.0 * np.sin(0.1 * TIMES)  # rpm: 25 to 33 Hz


def tracked(values: FloatArray, orders: str = "1", pto: float = 540.0) -> Orders:
    """Return the orders of an engine, and order 1 of a PTO, in a signal along x."""
    mapping = {
        "engine": {"speed": "engine", "orders": [float(each) for each in orders.split()]},
        "pto": {"speed": "pto", "orders": [1.0]},
    }
    speeds = {Source.ENGINE: (TIMES, ENGINE), Source.PTO: (TIMES, pto + 0.0 * TIMES)}
    axes = values if values.ndim > 1 else np.outer(values, [1.0, 0.0, 0.0])
    signal = Signal(sensor(), TIMES, axes, RATE, ())
    return track_orders(signal, excitations_from_mapping(mapping), speeds)


def wave(order: float, amplitude: float) -> FloatArray:
    """Return a vibration of an order of the engine, whose angle is the integral of its speed."""
    turned = 30.0 * TIMES - 200.0 / 60.0 / 0.1 * (np.cos(0.1 * TIMES) - 1.0)  # turns
    return np.asarray(amplitude * np.cos(2.0 * math.pi * order * turned + 0.7))


def test_amplitudes_while_the_speed_changes() -> None:
    """The amplitude of each order is found to 1 % while the speed changes by 1 Hz in a window."""
    actual = tracked(wave(1.0, 2.0) + wave(0.5, 0.3), "1 0.5")
    assert actual.squares.shape == (100, 3)
    np.testing.assert_allclose(np.sqrt(actual.squares[:, :2]), [[2.0, 0.3]] * 100, rtol=0.01)
    np.testing.assert_allclose(actual.frequencies[:, 0], actual.speeds[:, 0] / 60.0)
    assert (actual.squares[:, 2] < 1e-5).all()


def test_a_run_up_equals_a_resampled_spectrum() -> None:
    """From 900 to 2100 rpm in 60 s, both have the same amplitudes as a spectrum over the angle.

    That spectrum is made of the signal at even angles of the shaft, by splines, under the window of
    the fit, and compared in each window of 4 s.
    """
    times = np.arange(0.0, 60.0, 1.0 / RATE)
    rpm = 900.0 + 20.0 * times
    turns = (900.0 * times + 10.0 * times**2) / 60.0
    size, noise = (rpm / 2000.0) ** 2, np.random.default_rng(5).normal(0.0, 0.02, len(times))
    values = size * np.cos(2.0 * math.pi * turns) + 0.3 * np.cos(math.pi * turns + 1.0) + noise
    mapping = {"engine": {"speed": "engine", "orders": [1.0, 0.5]}}
    signal = Signal(sensor(), times, np.outer(values, [1.0, 0.0, 0.0]), RATE, ())
    speeds = {Source.ENGINE: (times, rpm)}
    actual = np.sqrt(track_orders(signal, excitations_from_mapping(mapping), speeds).squares)
    n = round(4.0 * RATE)
    window = np.hanning(n) ** 2
    for k in range(len(actual)):
        part = slice(k * n, (k + 1) * n)
        even = np.linspace(turns[part][0], turns[part][-1], n)
        resampled = CubicSpline(turns[part], values[part])(even)
        for order, amplitude in zip((1.0, 0.5), actual[k], strict=True):
            line = (window * resampled) @ np.exp(-2j * math.pi * order * even)
            assert amplitude == pytest.approx(2.0 * abs(line) / window.sum(), rel=0.03)
    np.testing.assert_allclose(actual[:, 0], size.reshape(-1, n).mean(axis=1), rtol=0.02)


def test_noise_beside_an_order() -> None:
    """In white noise of deviation s, n samples leave E|A|^2 = 7.78 s^2 / n, beside the order, too.

    With the square w of a window of Hann as the weight, A = 2 sum w x e / sum w, so E|A|^2 = 4 s^2
    sum w^2 / (sum w)^2, and sum w = 3 n / 8, sum w^2 = 35 n / 128.
    """
    random = np.random.default_rng(3)
    axes = random.normal(0.0, 1.0, (len(TIMES), 3))
    actual = tracked(axes)
    expected = 3 * 7.78 / (4.0 * RATE)  # along three axes
    assert actual.noise.mean() == pytest.approx(expected, rel=0.05)
    assert actual.squares.mean() == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize(("bins", "share"), [(-4, 17.0 / 54.0), (4, 17.0 / 54.0), (8, 0.0)])
def test_a_tone_beside_an_order_is_noise(bins: int, share: float) -> None:
    """It is so at 3 to 5 bins of 0.25 Hz on both sides, of which six the mean is taken.

    The square of a Hann window passes 1, 2/3 and 1/6 of a tone at 0, 1 and 2 bins, no others.
    """
    actual = tracked(3.0 * np.cos(2.0 * math.pi * (9.0 + 0.25 * bins) * TIMES))
    np.testing.assert_allclose(actual.noise[:, 1], 9.0 * share, atol=0.01)


@pytest.mark.parametrize(("apart", "known"), [(0.6, True), (0.4, False)])
def test_orders_that_meet_are_not_known(apart: float, known: bool) -> None:
    """Two lines less than 0.5 Hz apart cannot be distinguished in 4 s."""
    values = np.cos(2.0 * math.pi * 30.0 * TIMES)
    mapping = {"pto": {"speed": "pto", "orders": [1.0, 1.0 + apart / 30.0]}}
    signal = Signal(sensor(), TIMES, np.column_stack([values] * 3), RATE, ())
    speeds = {Source.PTO: (TIMES, 1800.0 + 0.0 * TIMES)}
    actual = track_orders(signal, excitations_from_mapping(mapping), speeds)
    assert np.isfinite(actual.squares).all() == known
    assert np.isfinite(actual.squares).any() == known


def test_where_there_is_no_order() -> None:
    """Nothing is known without a speed, at a standstill, and near half of the rate."""
    actual = tracked(wave(1.0, 1.0), "1 4", pto=0.0)
    assert np.isfinite(actual.squares).all(axis=0).tolist() == [True, False, False]
    assert not np.isfinite(actual.squares[:, 1:]).any()


@pytest.mark.parametrize(("hertz", "counted"), [(0.5, 0.0), (1.25, 1.0), (89.0, 1.0), (91.0, 0.0)])
def test_levels_are_of_a_band(hertz: float, counted: float) -> None:
    """A velocity of 5 mm/s along z is in the levels from 1 Hz to 0.45 of the rate, 90 Hz."""
    omega = 2.0 * math.pi * hertz
    values = np.outer(omega * 5.0e-3 * np.sin(omega * TIMES), [0.0, 0.0, 1.0])
    level = levels(Signal(sensor(), TIMES, values, RATE, ()))
    np.testing.assert_allclose(level * math.sqrt(2.0), 5.0e-3 * counted, rtol=0.03, atol=5e-5)
