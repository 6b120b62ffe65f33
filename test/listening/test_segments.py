# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Segments of a drive, and signals over the phase of a predicted frequency."""

import math

import numpy as np
import pytest

from linkage_vibration.listening.segments import find_segments, over_phase, phase_rate

RATE, SHORTEST = 100.0, 8.0  # Hz, s


@pytest.mark.parametrize(("seconds", "count"), [(7.5, 0), (8.5, 1)])
def test_shortest_segment(seconds: float, count: int) -> None:
    """A segment lasts at least 8 s: 7.5 s between two quick moves are too short, 8.5 s are not."""
    times = np.arange(0.0, 6.0 + seconds, 1.0 / RATE)
    angle = np.interp(times, [0.0, 3.0, 3.0 + seconds, 6.0 + seconds], [2.5, 2.0, 2.0, 2.5])
    assert len(find_segments(times, angle)) == count


@pytest.mark.parametrize(("degrees", "heights"), [(2.0, 1), (10.0, 2)])
def test_heights(degrees: float, heights: int) -> None:
    """Segments whose angles differ by 2 deg are one height, and by 10 deg two."""
    times = np.arange(0.0, 43.0, 1.0 / RATE)
    angle = 2.0 + math.radians(degrees) * np.interp(times, [20.0, 23.0], [0.0, 1.0])
    actual = find_segments(times, angle)
    assert len(actual) == heights
    assert all((each.stop - each.start) / RATE >= SHORTEST for group in actual for each in group)


def test_unknown_angle() -> None:
    """Without an angle, and in two samples, there is no segment."""
    assert find_segments(np.array([0.0, 0.01]), np.array([2.0, 2.0])) == []
    times = np.arange(0.0, 20.0, 1.0 / RATE)
    assert find_segments(times, np.full(len(times), np.nan)) == []


def test_over_phase() -> None:
    """A chirp that is 1.1 times the prediction becomes a sine of 1.1 times its mean."""
    times = np.arange(0.0, 40.0, 1.0 / RATE)
    predicted = 4.0 + 0.05 * times
    signal = np.sin(math.tau * 1.1 * np.cumsum(predicted) / RATE)[:, np.newaxis]
    mean = float(predicted.mean())
    window, rate = over_phase(signal, predicted, mean, RATE), phase_rate(mean, RATE)
    spectrum = np.abs(np.fft.rfft(window[:, 0] * np.hanning(len(window)), 2**16))
    peak = spectrum.argmax() * rate / 2**16
    assert peak == pytest.approx(1.1 * predicted.mean(), rel=2e-3)
    assert spectrum[[int(peak * 0.9 / rate * 2**16)]] < 0.01 * spectrum.max()


@pytest.mark.parametrize(("over_mean", "low", "high"), [(1.8, 0.9, 1.01), (3.6, 0.0, 0.03)])
def test_what_would_be_folded_is_filtered(over_mean: float, low: float, high: float) -> None:
    """Resampled at 6 times a frequency, a sine of 1.8 times it stays, and one of 3.6 times goes."""
    times = np.arange(0.0, 40.0, 1.0 / RATE)
    signal = math.sqrt(2.0) * np.sin(math.tau * 4.0 * over_mean * times)[:, np.newaxis]
    resampled = over_phase(signal, np.full(len(times), 4.0), 4.0, RATE)
    assert low <= resampled[50:-50].std() <= high
