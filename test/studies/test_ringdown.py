# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes of simulated blows are those of the simulation, within the deviations that are given."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.studies.ringdown import (
    RingdownError,
    common_modes,
    find_decays,
    fit_decay,
    measure_modes,
)

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


def shaken(height: float, begins: Sequence[int], tau: float = 100.0, n: int = 1500) -> FloatArray:
    """Return a channel of noise of size 1 that blows raise to a height, which decays, (n, 1)."""
    level = np.ones(n)
    for begin in begins:
        level[begin:] = np.maximum(level[begin:], height * np.exp(-np.arange(n - begin) / tau))
    return (level * (-1.0) ** np.arange(n))[:, np.newaxis]


@pytest.mark.parametrize(("height", "found"), [(4.9, False), (5.1, True)])
def test_a_blow_is_five_times_the_level(height: float, found: bool) -> None:
    """Its decay begins after the largest value, and ends where it falls below twice the level."""
    decays = find_decays(shaken(height, [500]), RATE)
    last = 500 + math.floor(100.0 * math.log(height / 2.0))
    assert decays == ([slice(502, last + 1)] if found else [])


def test_how_far_blows_are_apart() -> None:
    """Blows that are half a second apart or less are one; a later one is three times the level."""
    rest = shaken(20.0, [500], tau=20.0)
    for apart, count in ((50, 1), (52, 2)):
        both = np.maximum(np.abs(rest), np.abs(shaken(61.0, [500 + apart], tau=20.0)))
        assert len(find_decays(both, RATE)) == count
    # The last half second counts, but for the 0.05 s in which the blow itself may rise.
    level = 100.0 * math.exp(-50.0 / 100.0)
    for times, count in ((2.9, 1), (3.1, 2)):
        both = np.maximum(
            np.abs(shaken(100.0, [500])), np.abs(shaken(times * level, [605], tau=50.0))
        )
        assert len(find_decays(both, RATE)) == count


@pytest.mark.parametrize(("tau", "length"), [(39.5, None), (41.5, 40), (1e4, 400)])
def test_lengths_of_decays(tau: float, length: int | None) -> None:
    """A decay has 40 samples or more, of which those of 4 s are used."""
    # From the third sample to the last one above 2, which is tau ln(e) after the first one.
    signals = shaken(2.0 * math.e, [500], tau=tau)
    signals[1100:] = 1.0
    decays = find_decays(signals, RATE)
    found = [part.stop - part.start for part in decays]
    assert found == ([] if length is None else [length])


def decay(hertz: float, ratio: float, size: float, rate: float = RATE, n: int = 400) -> FloatArray:
    """Return three channels with one oscillation in noise of size 1, (n, 3)."""
    omega, random = 2.0 * math.pi * hertz, np.random.default_rng(4)
    pole = omega * (-ratio + 1j * math.sqrt(abs(1.0 - ratio**2)))
    wave = size * np.exp(pole * np.arange(n) / rate)
    return np.outer(wave, [1.0, 0.5j, -0.3]).real + random.normal(size=(n, 3))


@pytest.mark.parametrize(
    ("hertz", "ratio", "kept"),
    [
        (7.0, 0.03, True),
        (3.0, 0.45, True),
        (3.0, 0.55, False),  # hardly an oscillation
        (39.0, 0.01, True),
        (41.0, 0.01, False),  # above 0.8 of half the rate
        (7.0, -0.005, False),  # it grows
    ],
)
def test_oscillations_that_are_kept(hertz: float, ratio: float, kept: bool) -> None:
    """The pole of a strong oscillation is that of the simulation, if it can be trusted."""
    poles = fit_decay(decay(hertz, ratio, 1e4 if ratio > 0.0 else 100.0), RATE)
    near = poles[np.abs(np.abs(poles) / (2.0 * math.pi * hertz) - 1.0) < 0.05]
    assert len(near) == kept
    assert -near.real / np.abs(near) == pytest.approx([ratio] * len(near), rel=0.01)


@pytest.mark.parametrize(("share", "kept"), [(0.4, False), (2.5, True)])
def test_weak_oscillations_are_left_out(share: float, kept: bool) -> None:
    """They are kept with 100 times the energy that noise gives to one in each channel.

    A wave with the size a that decays has the energy (a / 2)^2 sum(exp(-2 zeta omega t)).
    """
    hertz, ratio = 7.0, 0.01
    terms = (np.exp(-4.0 * math.pi * hertz * ratio * np.arange(400) / RATE)).sum()
    size = math.sqrt(share * 100.0 * 3.0 * 4.0 / terms / (1.0 + 0.5**2 + 0.3**2))
    poles = fit_decay(decay(hertz, ratio, size), RATE)
    assert np.any(np.abs(np.abs(poles) / (2.0 * math.pi * hertz) - 1.0) < 0.05) == kept


def poles_of(*hertz: float, ratio: float = 0.02) -> ComplexArray:
    """Return poles with a damping ratio."""
    omega = 2.0 * math.pi * np.array(hertz)
    return np.asarray(omega * (-ratio + 1j * math.sqrt(1.0 - ratio**2)))


@pytest.mark.parametrize(("count", "factor"), [(3, 1.32), (4, 1.20), (5, 1.14)])
def test_deviation_of_a_mean(count: int, factor: float) -> None:
    """It is s / sqrt(n) times the factor of table G.2 of the GUM for 68.27 % and n - 1."""
    values = np.linspace(6.9, 7.1, count)
    ratios = np.linspace(0.03, 0.02, count)
    decays = [poles_of(f, ratio=r) for f, r in zip(values, ratios, strict=True)]
    [mode] = common_modes(decays)
    assert (mode.frequency, mode.ratio) == (pytest.approx(7.0), pytest.approx(0.025))
    for found, sample in ((mode.frequency_stddev, values), (mode.ratio_stddev, ratios)):
        spread = math.sqrt(((sample - sample.mean()) ** 2).sum() / (count - 1))
        assert found == pytest.approx(factor * spread / math.sqrt(count), rel=4e-3)
    assert mode.decays == count


def test_modes_of_most_decays() -> None:
    """More than half of the decays have to show a mode; two of them do not tell a deviation."""
    assert len(common_modes([poles_of(7.0)] * 2 + [poles_of(19.0)] * 2)) == 0
    [mode] = common_modes([poles_of(7.0)] * 2 + [poles_of(19.0)])
    assert (mode.frequency, mode.decays) == (pytest.approx(7.0), 2)
    assert math.isnan(mode.frequency_stddev)
    first, second = common_modes([poles_of(7.0, 19.0), poles_of(19.0, 7.0), poles_of(7.0)])
    assert (first.frequency, second.frequency) == (pytest.approx(7.0), pytest.approx(19.0))
    assert (first.decays, second.decays) == (3, 2)


@pytest.mark.parametrize(("apart", "count"), [(0.049, 1), (0.051, 0)])
def test_frequencies_of_one_mode(apart: float, count: int) -> None:
    """They differ by 5 % at most."""
    found = common_modes([poles_of(7.0), poles_of(7.0 * math.exp(apart))])
    assert len(found) == count


def test_limits_of_recordings() -> None:
    """40 samples at 20 Hz without a pause of half a second are enough to look for a blow."""

    def error(times: FloatArray) -> str:
        signals = np.random.default_rng(0).normal(size=(len(times), 2))
        with pytest.raises(RingdownError) as raised:
            measure_modes(times, signals)
        return str(raised.value)

    assert "samples at 39 different times" in error(np.arange(39.0) / 100.0)
    assert "No blow stands out" in error(np.arange(40.0) / 100.0)
    twice = np.repeat(np.arange(39.0) / 100.0, 2)
    assert "samples at 39 different times" in error(twice)
    assert "samples a second" in error(np.arange(200.0) / 19.9)
    assert "No blow stands out" in error(np.arange(200.0) / 20.1)
    for pause, words in ((0.49, "No blow stands out"), (0.51, "pauses for 0.51 s after 0.99 s")):
        times = np.concatenate([np.arange(100.0) / 100.0, 0.99 + pause + np.arange(100.0) / 100.0])
        assert words in error(times)


@pytest.mark.parametrize(
    ("count", "factor", "clipped"),
    [(20, 6.0, False), (21, 6.0, True), (21, 4.1, True), (21, 3.9, False)],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_limits_of_overload(count: int, factor: float, clipped: bool, sign: float) -> None:
    """A channel is clipped with 21 samples at a value of four median deviations on one side."""
    away = np.concatenate([np.full(count, factor), np.linspace(-2.0, 2.0, 401)])
    # The medians of the channel and of its deviations, without the large values, are 0 and 1.
    away = away - np.median(away)
    away[:count] = factor * np.median(np.abs(away))
    times = np.arange(len(away)) / RATE
    error = ""
    try:
        measure_modes(times, np.column_stack([np.sin(times), sign * away]))
    except RingdownError as raised:
        error = str(raised)
    assert (f"Channel 2 has its largest value {count} times" in error) == clipped
