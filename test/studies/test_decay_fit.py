# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Poles of several decays are those of least squares, and noise makes none."""

import math

import numpy as np
import pytest

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.studies.decay_fit import fit_decays, gains, refined, variance, without_faint

RATE = 50.0  # Hz
POLES = np.array([-0.6 + 7.0j, -0.8 + 9.0j, -2.0 + 60.0j])  # rad/s


def decays(noise: float, count: int = 4, offset: float = 3.0) -> list[FloatArray]:
    """Return decays of different lengths and amplitudes, with noise and a constant."""
    random = np.random.default_rng(7)
    waves = []
    for i in range(count):
        terms = np.exp(np.multiply.outer(np.arange(150 + 10 * i) / RATE, POLES))
        weights = random.normal(size=(3, 2)) + 1j * random.normal(size=(3, 2))
        signals = (terms @ weights).real + offset
        waves.append(signals + random.normal(0.0, noise, signals.shape))
    return waves


def test_poles_of_a_simulation() -> None:
    """Overlapping modes with 9 % of damping are found, whatever the constants are."""
    for offset in (0.0, 1000.0):
        poles = np.sort_complex(1j * fit_decays(decays(1e-4, offset=offset), RATE).poles)
        assert poles == pytest.approx(np.sort_complex(1j * POLES), rel=1e-3)


def test_nyquist_is_no_limit_of_a_fold() -> None:
    """A pole at 260 rad/s appears at 2 pi 50 - 260, with the same decay rate."""
    times = np.arange(200)[:, np.newaxis] / RATE
    signals = (np.exp((-2.0 + 260.0j) * times) * [1.0, 1.0j]).real
    noise = np.random.default_rng(1).normal(0.0, 1e-4, signals.shape)
    poles = fit_decays([signals + noise], RATE).poles
    strongest = poles[np.argmin(np.abs(poles.real + 2.0))]
    assert strongest == pytest.approx(-2.0 + 1j * (100.0 * math.pi - 260.0), rel=1e-3)


def test_gradients_are_those_of_differences() -> None:
    """The gradient of half the sum of squares, by central differences of each parameter."""
    signals, poles = decays(0.1), POLES * 1.02
    step = 1e-5
    # With one step of almost no length `refined` returns the fit at the poles themselves.
    fit = refined(signals, refined(signals, poles, RATE).poles, RATE)
    assert np.abs(fit.gradients.sum(axis=0)).max() < 1e-2
    for i, direction in enumerate([*np.eye(3), *(1j * np.eye(3))]):
        squares = [_squares(signals, fit.poles + sign * step * direction) for sign in (1, 0, -1)]
        curvature = (squares[0] - 2.0 * squares[1] + squares[2]) / (2.0 * step**2)
        assert fit.curvatures.sum(axis=0)[i, i] == pytest.approx(curvature, rel=0.1)


def _squares(signals: list[FloatArray], poles: np.ndarray) -> float:
    """Return the least sum of squares of given poles, by `lstsq` alone."""
    total = 0.0
    for each in signals:
        terms = np.exp(np.multiply.outer(np.arange(len(each)) / RATE, poles))
        columns = np.hstack([terms.real, terms.imag, np.ones((len(each), 1))])
        total += float(np.linalg.lstsq(columns, each, rcond=None)[1].sum())
    return total


def test_residuals_are_the_noise() -> None:
    """Their variance is that of the noise, within three of its standard deviations."""
    signals = decays(0.1)
    fit = fit_decays(signals, RATE)
    size = sum(each.size for each in signals)
    assert variance(signals, fit) == pytest.approx(0.01, rel=3.0 * math.sqrt(2.0 / size) + 0.03)


@pytest.mark.parametrize(("share", "kept"), [(0.8, False), (1.25, True)])
def test_faint_poles_are_left_out(share: float, kept: bool) -> None:
    """A pole is kept if it lowers the squares by more than a chi2 variable does by chance.

    Of four decays with two channels, 18 numbers fit a pole: the quantile of 1 % is 34.81 in tables.
    """
    signals = decays(0.05)
    fit = refined(signals, np.append(POLES, -1.0 + 30.0j), RATE)
    gain = gains(signals, fit, RATE).sum(axis=0)
    extra = int(np.abs(fit.poles - (-1.0 + 30.0j)).argmin())
    assert np.all(np.delete(gain, extra) > 1000.0)
    # By definition of the unit: so many variances of the residuals.
    less = _squares(signals, np.delete(fit.poles, extra)) - _squares(signals, fit.poles)
    assert gain[extra] == pytest.approx(less / variance(signals, fit), rel=1e-6)
    wave = np.exp((-1.0 + 30.0j) * np.arange(150) / RATE).real[:, np.newaxis] * [1.0, 0.0]
    size = math.sqrt(share * 34.81 / (wave**2).sum()) * 0.05 * 2.2
    louder = [*signals[1:], signals[0] + 10.0 * size * wave * kept]
    actual = without_faint(
        louder, refined(louder, np.append(POLES, -1.0 + 30.0j), RATE), RATE, 0.01
    )
    assert (len(actual.poles) == 4) == kept


def test_growing_and_overdamped_poles_are_left_out() -> None:
    """A pole that grows, and one with more than half of the critical damping, are no mode."""
    signals = decays(0.05)
    fit = refined(signals, POLES, RATE)
    times = np.arange(200)[:, np.newaxis] / RATE
    for pole, count in ((0.2 + 30.0j, 0), (-20.0 + 20.0j, 0), (-8.0 + 20.0j, 1)):
        noise = np.random.default_rng(2).normal(0.0, 0.01, (200, 2))
        waves = [(np.exp(pole * times) * [1.0, 0.5j]).real + noise]
        assert (
            len(without_faint(waves, refined(waves, np.array([pole]), RATE), RATE, 1e-6).poles)
            == count
        )
    assert len(fit.poles) == 3


def test_rounding_moves_no_pole() -> None:
    """In a window too short for slow poles, changes in their twelfth digit change no fit.

    Within 75 ms, decays of five modes below 5 Hz differ by less than rounding does.
    """
    slow = np.array([-0.3 + 6.0j, -0.6 + 9.0j, -0.5 + 13.0j, -0.9 + 15.0j, -1.0 + 26.0j])
    poles = np.concatenate([[-13.0 + 890.0j, -12.0 + 870.0j, -7.0 + 610.0j], slow])
    random, terms = np.random.default_rng(0), np.exp(np.multiply.outer(np.arange(30) / 400, poles))
    waves = [(terms @ (random.normal(size=(8, 3, 2)) @ [1.0, 1.0j])).real for _ in range(5)]
    signals = [each + random.normal(0.0, 0.1, each.shape) for each in waves]
    fits = [refined(signals, poles * (1.0 + i * 1e-12), 400.0, free=1) for i in range(4)]
    assert [fit.poles[0] for fit in fits] == pytest.approx([fits[0].poles[0]] * 4, rel=1e-8)
