# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes of simulated blows are those of the simulation, within the deviations that are given."""

import math

import numpy as np
import pytest

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.studies.ringdown import RingdownError, measure_modes

RATE = 100.0  # Hz
MODES = ((7.0, 0.03), (19.0, 0.02))  # Hz, damping ratio
GRAVITY = 9.81


def recording(
    random: np.random.Generator,
    modes: tuple[tuple[float, float], ...] = MODES,
    blows: int = 5,
    noise: float = 0.05,
    seconds: float = 4.0,
) -> tuple[FloatArray, FloatArray]:
    """Return times and three channels with a second of rest and then the blows."""
    times = np.arange(seconds * RATE) / RATE
    parts = [np.zeros((int(RATE), 3))]
    for _ in range(blows):
        signals = np.zeros((len(times), 3))
        for frequency, ratio in modes:
            omega = 2.0 * math.pi * frequency
            pole = omega * (-ratio + 1j * math.sqrt(1.0 - ratio**2))
            weights = random.normal(size=3) + 0.1j * random.normal(size=3)
            signals += (np.exp(pole * times)[:, np.newaxis] * weights).real
        parts.append(signals)
    signals = np.vstack(parts)
    signals = signals + random.normal(0.0, noise, signals.shape) + [0.0, 0.0, GRAVITY]
    return np.arange(len(signals)) / RATE, signals


def test_close_modes() -> None:
    """Two modes that are 15 % apart are separated, at uneven times as well."""
    modes = ((2.5, 0.05), (2.9, 0.05), (7.2, 0.02))
    random = np.random.default_rng(0)
    times, signals = recording(random, modes, noise=0.01)
    found = measure_modes(times, signals)
    assert [mode.frequency for mode in found] == pytest.approx([2.5, 2.9, 7.2], rel=2e-3)
    assert [mode.ratio for mode in found] == pytest.approx([0.05, 0.05, 0.02], rel=0.05)
    late = random.random(len(times)) < 0.02  # of the messages are lost
    again = measure_modes(times[~late], signals[~late])
    assert [mode.frequency for mode in again] == pytest.approx([2.5, 2.9, 7.2], rel=5e-3)


def test_a_channel_that_does_not_move_changes_nothing() -> None:
    """Rounding of a constant is not divided by itself; a small motion on a constant is measured."""
    times, signals = recording(np.random.default_rng(3))
    found = measure_modes(times, signals)
    constant = np.full((len(times), 2), [GRAVITY, 0.0])
    assert measure_modes(times, np.hstack([signals, constant])) == found
    small = measure_modes(times, GRAVITY + 1e-6 * signals)
    assert [mode.frequency for mode in small] == pytest.approx([7.0, 19.0], rel=0.01)


def test_deviations_hold() -> None:
    """The intervals of 95 % contain the truth in 85 to 100 % of 30 recordings of five blows."""
    inside = []
    for seed in range(30):
        found = measure_modes(*recording(np.random.default_rng(seed)))
        assert len(found) == len(MODES)
        for mode, (frequency, ratio) in zip(found, MODES, strict=True):
            inside.append(abs(mode.frequency - frequency) < 1.96 * mode.frequency_stddev)
            inside.append(abs(mode.ratio - ratio) < 1.96 * mode.ratio_stddev)
            assert mode.frequency_stddev < 0.01 * frequency
    assert np.mean(inside) >= 0.85


def test_one_blow_has_no_deviation() -> None:
    """One decay gives the modes, but not how sure they are."""
    for mode in measure_modes(*recording(np.random.default_rng(1), blows=1)):
        assert math.isnan(mode.frequency_stddev)
        assert mode.decays == 1


def test_without_blows() -> None:
    """Noise alone, or a recording that is too short, is refused with the remedy."""
    with pytest.raises(RingdownError, match=r"No blow stands out .* hit harder"):
        measure_modes(*recording(np.random.default_rng(2), blows=0, seconds=8.0))
    with pytest.raises(RingdownError, match="samples at 5 different times; give 40 or more"):
        measure_modes(np.arange(5.0), np.zeros((5, 1)))


def test_recordings_that_would_mislead() -> None:
    """Milliseconds, a pause, and an overloaded sensor are refused with the remedy."""
    times, signals = recording(np.random.default_rng(3))
    with pytest.raises(RingdownError, match=r"0\.1 samples a second, .* give the times in seconds"):
        measure_modes(1000.0 * times, signals)
    with pytest.raises(RingdownError, match=r"pauses for 9\.\d+ s after 11.*without pauses"):
        measure_modes(np.where(times < 11.5, times, times + 9.0), signals)
    with pytest.raises(RingdownError, match=r"Channel 2 has its largest value .* larger range"):
        measure_modes(times, np.clip(signals, [-99.0, -0.5, -99.0], 99.0))
