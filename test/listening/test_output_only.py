# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Oscillators with known frequencies and damping ratios, driven by noise."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from linkage_vibration.listening.output_only import Candidate, finish, identify, mac, stable_poles
from linkage_vibration.mechanics.arrays import FloatArray

RATE, SECONDS = 20.0, 240.0  # Hz, s
OMEGA, RATIOS = 2.0 * math.pi * np.array([1.6, 3.1]), np.array([0.03, 0.02])
SHAPES = np.array([[1.0, 0.7], [0.6, -1.0]])  # a column for each mode


def responses(seed: int, delay: int = 0) -> FloatArray:
    """Return accelerations of two modes, (n, 2), whose noise acts again so many samples later."""
    random = np.random.default_rng(seed)
    n, fine = round(RATE * SECONDS), 8
    noise = random.standard_normal((n * fine, 1)) * SHAPES[:1]
    if delay:
        noise[delay * fine :] += 0.9 * noise[: -delay * fine]
    signals = np.zeros((n, 2))
    for k, (omega, ratio) in enumerate(zip(OMEGA.tolist(), RATIOS.tolist(), strict=True)):
        step = expm(np.array([[0.0, 1.0], [-(omega**2), -2.0 * ratio * omega]]) / RATE / fine)
        state, q = np.zeros(2), np.empty(n * fine)
        for i, force in enumerate(noise[:, k].tolist()):
            state = step @ state + [0.0, force]
            q[i] = state[0]
        signals += np.outer(q[::fine], SHAPES[:, k])
    return signals + 0.02 * signals.std() * random.standard_normal(signals.shape)


def modes(signals: FloatArray, first_lag: int = 1) -> list[Candidate]:
    """Return the candidates between 1 and 5 Hz of three windows."""
    return finish(identify(np.split(signals, 3), RATE, (1.0, 5.0), first_lag))


def test_known_oscillators() -> None:
    """Values lie within three deviations, which are at most five times the least possible.

    That is sqrt(ratio / (2 pi f T)), relative, of a frequency in a time T.
    """
    actual = modes(responses(1))
    for omega, ratio, shape in zip(OMEGA, RATIOS, SHAPES.T, strict=True):
        near = [each for each in actual if abs(each.frequency * math.tau / omega - 1.0) < 0.03]
        best = min(near, key=lambda each: each.frequency_stddev)
        assert abs(best.frequency - omega / math.tau) < 3.0 * best.frequency_stddev
        least = best.frequency * math.sqrt(ratio / (omega * SECONDS))
        assert least < best.frequency_stddev < 5.0 * least
        assert abs(best.ratio - ratio) < 3.0 * best.ratio_stddev
        assert mac(best.shape, shape[:, np.newaxis])[0] > 0.98


@pytest.mark.parametrize(
    ("frequency", "ratio", "stable"),
    [
        *((1.019, 1.0, 1), (0.981, 1.0, 1), (1.021, 1.0, 0), (0.979, 1.0, 0)),
        *((1.0, 1.29, 1), (1.0, 0.71, 1), (1.0, 1.31, 0), (1.0, 0.69, 0)),
    ],
)
def test_stable_poles(frequency: float, ratio: float, stable: int) -> None:
    """From one order to the next they change by less than 2 %, and their damping ratio by 30 %."""
    diagram = [
        (
            np.array([10.0 * frequency**i * np.exp(1j * math.acos(-0.05 * ratio**i))]),
            np.ones((2, 1), complex),
        )
        for i in range(3)
    ]
    assert len(stable_poles(diagram, (1.0, 2.0))) == stable


def test_modes_outside_the_band() -> None:
    """A mode outside the band is not reported."""
    actual = finish(identify(np.split(responses(1), 3), RATE, (2.5, 5.0)))
    assert actual
    assert min(each.frequency for each in actual) > 2.5


@pytest.mark.parametrize("signals", [np.zeros((400, 2)), np.ones((30, 2))])
def test_nothing_is_found(signals: FloatArray) -> None:
    """A channel that shows nothing, and one that is too short, show no mode."""
    assert finish(identify([signals], RATE, (1.0, 5.0))) == []
