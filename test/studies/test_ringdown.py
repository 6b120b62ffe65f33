# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes of simulated blows are those of the simulation, within the deviations that are given."""

import math
import re
from collections.abc import Sequence

import numpy as np
import pytest

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.studies import ringdown
from linkage_vibration.studies.decay_fit import DecayFit
from linkage_vibration.studies.ringdown import (
    RingdownError,
    find_decays,
    measure_modes,
    modes_of_decays,
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
    measured = measure_modes(times, signals)
    assert [mode.frequency for mode in measured] == pytest.approx([2.5, 2.9, 7.2], rel=2e-3)
    assert [mode.ratio for mode in measured] == pytest.approx([0.05, 0.05, 0.02], rel=0.05)
    late = random.random(len(times)) < 0.02  # of the messages are lost
    again = measure_modes(times[~late], signals[~late])
    assert [mode.frequency for mode in again] == pytest.approx([2.5, 2.9, 7.2], rel=5e-3)


def test_a_channel_that_does_not_move_changes_nothing() -> None:
    """Rounding of a constant is not divided by itself; a small motion on a constant is measured."""
    times, signals = recording(np.random.default_rng(3))
    measured = measure_modes(times, signals)
    constant = np.full((len(times), 2), [GRAVITY, 0.0])
    assert measure_modes(times, np.hstack([signals, constant])) == measured
    small = measure_modes(times, GRAVITY + 1e-6 * signals)
    assert [mode.frequency for mode in small] == pytest.approx([7.0, 19.0], rel=0.01)


def test_deviations_hold() -> None:
    """The intervals of 95 % contain the truth in 90 to 100 % of 20 recordings of five blows."""
    inside = []
    for seed in range(20):
        measured = measure_modes(*recording(np.random.default_rng(seed)))
        assert len(measured) == len(MODES)
        for mode, (frequency, ratio) in zip(measured, MODES, strict=True):
            inside.append(abs(mode.frequency - frequency) < 1.96 * mode.frequency_stddev)
            inside.append(abs(mode.ratio - ratio) < 1.96 * mode.ratio_stddev)
            assert mode.frequency_stddev < 0.01 * frequency
    assert np.mean(inside) >= 0.9


def test_deviations_hold_near_one_hertz() -> None:
    """A tractor on its tyres: modes with 7 % near 1 Hz, one of which is hardly excited."""
    inside = []
    for seed in range(10):
        modes = ((1.1, 0.07), (1.7, 0.07), (5.3, 0.02))
        measured = measure_modes(*recording(np.random.default_rng(seed), modes, seconds=6.0))
        for mode in (each for each in measured if not each.doubt):
            frequency, ratio = min(modes, key=lambda each: abs(each[0] - mode.frequency))
            inside.append(abs(mode.frequency - frequency) < 1.96 * mode.frequency_stddev)
            inside.append(abs(mode.ratio - ratio) < 1.96 * mode.ratio_stddev)
    assert len(inside) >= 50
    assert np.mean(inside) >= 0.9


def test_deviations_follow_from_those_of_poles() -> None:
    """They are those of a pole with 60 % of damping times slopes by central differences."""

    def values(real: float, imaginary: float) -> FloatArray:
        size = math.hypot(real, imaginary)
        return np.array([size / (2.0 * math.pi), -real / size])

    curvatures, step = np.array([[[2.0, 0.5], [0.5, 1.0]]]), 1e-5
    fit = DecayFit(np.array([-3.0 + 4.0j]), 36.0, curvatures, np.zeros((1, 2)))
    one_decay = [np.zeros((41, 1))]  # with 36 degrees of freedom, so that the variance is 1
    along, across = (
        (values(-3.0 + x, 4.0 + y) - values(-3.0 - x, 4.0 - y)) / (2.0 * step)
        for x, y in ((step, 0.0), (0.0, step))
    )
    slopes = np.column_stack([along, across])
    expected = np.sqrt(np.diag(slopes @ np.linalg.inv(curvatures[0]) @ slopes.T))
    assert ringdown._stddevs(one_decay, fit)[:, 0] == pytest.approx(expected, rel=1e-6)


def test_one_blow_has_no_deviation() -> None:
    """One decay gives the modes, but not how sure they are."""
    for mode in measure_modes(*recording(np.random.default_rng(1), blows=1)):
        assert math.isnan(mode.frequency_stddev)
        assert mode.decays == 1


def test_without_blows() -> None:
    """Noise alone, or a recording that is too short, is refused with the remedy."""
    with pytest.raises(RingdownError, match=r"No blow stands out .* hit harder"):
        measure_modes(*recording(np.random.default_rng(2), blows=0, seconds=8.0))
    with pytest.raises(RingdownError, match="has 5 samples; give 40 or more"):
        measure_modes(np.arange(5.0), np.zeros((5, 1)))


def test_recordings_that_would_mislead() -> None:
    """Milliseconds, a pause, and an overloaded sensor are refused with the remedy."""
    times, signals = recording(np.random.default_rng(3))
    with pytest.raises(RingdownError, match=r"0\.1 samples a second, .* give times in seconds"):
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


@pytest.mark.parametrize(("height", "is_blow"), [(4.9, False), (5.1, True)])
def test_a_blow_is_five_times_the_level(height: float, is_blow: bool) -> None:
    """Its decay begins 0.04 s after the largest value, and ends below twice the level."""
    decays = find_decays(shaken(height, [500]), RATE)
    last = 500 + math.floor(100.0 * math.log(height / 2.0))
    assert decays == ([slice(504, last + 1)] if is_blow else [])


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


@pytest.mark.parametrize(("tau", "length"), [(41.5, None), (43.5, 40), (1e4, 400)])
def test_lengths_of_decays(tau: float, length: int | None) -> None:
    """A decay has 40 samples or more, of which those of 4 s are used."""
    # From the fifth sample to the last one above 2, which is tau ln(e) after the first one.
    signals = shaken(2.0 * math.e, [500], tau=tau)
    signals[1100:] = 1.0
    decays = find_decays(signals, RATE)
    actual = [part.stop - part.start for part in decays]
    assert actual == ([] if length is None else [length])


def decays_of(
    shares: Sequence[float], hertz: float = 19.0, seed: int = 0, noise: float = 1.0
) -> list[FloatArray]:
    """Return decays of a mode at 7 Hz, and of another one with a share of its size in each."""
    random = np.random.default_rng(seed)
    times = np.arange(300)[:, np.newaxis] / RATE
    waves = []
    for share in shares:
        phases = random.uniform(0.0, 2.0 * math.pi, (2, 2))
        first = 50.0 * np.exp(-1.5 * times) * np.cos(2.0 * math.pi * 7.0 * times + phases[0])
        other = 50.0 * np.exp(-2.0 * times) * np.cos(2.0 * math.pi * hertz * times + phases[1])
        waves.append(first + share * other + random.normal(0.0, noise, (300, 2)))
    return waves


@pytest.mark.parametrize(
    ("blows", "share", "doubt"),
    [(2, 1.0, "2 of 5 blows show it"), (2, 50.0, "2 of 5 blows show it"), (3, 1.0, "")],
)
def test_more_than_half_of_the_blows_show_a_mode(blows: int, share: float, doubt: str) -> None:
    """A mode of less blows, such as clatter, is not sure; the others are not changed by it."""
    modes = modes_of_decays(decays_of([share] * blows + [0.0] * (5 - blows)), RATE)
    assert [mode.frequency for mode in modes] == pytest.approx([7.0, 19.0], rel=5e-3)
    assert [mode.doubt for mode in modes] == ["", doubt]
    assert [mode.decays for mode in modes] == [5, blows]


@pytest.mark.parametrize(("share", "count"), [(0.01, 1), (0.03, 2)])
def test_a_mode_has_to_exceed_noise(share: float, count: int) -> None:
    """An amplitude of half the noise is not reported; one of 1.5 times in 300 samples is."""
    sure = [
        mode for mode in modes_of_decays(decays_of([share] * 5, seed=2), RATE) if not mode.doubt
    ]
    assert [mode.frequency for mode in sure] == pytest.approx([7.0, 19.0][:count], rel=5e-3)


@pytest.mark.parametrize(("turned", "apart"), [(0.6, False), (0.9, True)])
def test_close_modes_that_move_the_channels_differently(turned: float, apart: bool) -> None:
    """Pitch and yaw of a tractor, 0.06 Hz apart, are two linear modes if a sensor tells them apart.

    Modes that move the channels alike may be one whose decay is not exponential.
    """
    random, times = np.random.default_rng(0), np.arange(800)[:, np.newaxis] / RATE
    both = (1.45, 0.064, 0.0), (1.51, 0.05, turned)
    waves = [random.normal(0.0, 1.0, (800, 2)) for _ in range(5)]
    for wave in waves:
        for hertz, ratio, turn in both:
            phase = 2.0 * math.pi * hertz * times
            turning = np.cos(phase + random.uniform(0.0, 6.0)) * [math.cos(turn), math.sin(turn)]
            wave += 100.0 * np.exp(-ratio * phase) * turning
    modes = modes_of_decays(waves, RATE)
    assert [not mode.doubt for mode in modes] == [apart, apart]
    exact = [hertz * math.hypot(1.0, ratio) for hertz, ratio, _ in both]
    assert [mode.frequency for mode in modes] == pytest.approx(exact, abs=2e-3)


@pytest.mark.parametrize(("share", "doubted"), [(0.85, True), (0.95, False)])
def test_a_pair_beside_which_modes_are_folded(share: float, doubted: bool) -> None:
    """Two close modes that look alike put a mode far below in doubt, but not near half the rate.

    There, one of them may be folded. All decays are exponential.
    """
    random, times = np.random.default_rng(3), np.arange(400)[:, np.newaxis] / RATE
    top = share * RATE / 2.0
    waves = [random.normal(0.0, 1.0, (400, 2)) for _ in range(5)]
    for wave in waves:
        for hertz, ratio, size in (
            (7.0, 0.03, 400.0),
            (top, 0.01, 80.0),
            (1.003 * top, 0.012, 80.0),
        ):
            phase = 2.0 * math.pi * hertz * times
            turning = np.cos(phase + random.uniform(0.0, 6.0)) * [1.0, 0.5]
            wave += size * np.exp(-ratio * phase) * turning
    modes = modes_of_decays(waves, RATE)
    [low] = [mode for mode in modes if mode.frequency < 10.0]
    assert bool(low.doubt) == doubted
    assert any("not linear" in mode.doubt for mode in modes if mode.frequency > 10.0)


def bending(change: float, sizes: Sequence[float], seed: int = 0) -> list[FloatArray]:
    """Return decays of an oscillator at 10 Hz, whose spring is not linear, in noise of size 1.

    Its frequency is 10 Hz (1 + change a^2) at the amplitude a, which decays from a size to zero. By
    averaging, as for Duffing's equation, the phase is the integral of that.
    """
    random, times = np.random.default_rng(seed), np.arange(300)[:, np.newaxis] / RATE
    rate, waves = 1.0, []
    for size in sizes:
        phase = times + change * size**2 * (1.0 - np.exp(-2.0 * rate * times)) / (2.0 * rate)
        wave = np.exp(-rate * times) * np.cos(2.0 * math.pi * 10.0 * phase + random.uniform(0, 6))
        waves.append(200.0 * size * wave * [1.0, 0.4] + random.normal(0.0, 1.0, (300, 2)))
    return waves


@pytest.mark.parametrize(("decay", "sure"), [(0.0, False), (0.3, True)])
def test_a_steady_tone_is_no_mode(decay: float, sure: bool) -> None:
    """A tone is doubtful if it is found; one that decays by 0.3 per second is a mode."""
    times, doubts = np.arange(300)[:, np.newaxis] / RATE, []
    for seed in range(4):
        waves = decays_of([0.0] * 5, seed=seed)
        for i, wave in enumerate(waves):
            wave += 10.0 * np.exp(-decay * times) * np.cos(2.0 * math.pi * 19.0 * times + i)
        heave, *tone = modes_of_decays(waves, RATE)
        assert not heave.doubt
        doubts += [mode.doubt for mode in tone]
    doubt = "its damping ratio may be 0, as that of a steady tone"
    assert set(doubts) == {"" if sure else doubt}


@pytest.mark.parametrize("change", [-0.04, 0.04])
def test_frequency_that_changes_with_the_decay(change: float) -> None:
    """Of a soft and of a stiff spring, both frequencies are those of amplitudes that occur."""
    for seed in range(3):
        modes = modes_of_decays(bending(change, [1.0] * 5, seed), RATE)
        assert not [mode for mode in modes if not mode.doubt]
        [text] = [mode.doubt for mode in modes if mode.doubt.startswith("not linear")]
        numbers = [float(word) for word in re.findall(r"from ([\d.]+) to ([\d.]+) Hz", text)[0]]
        assert text.endswith("as the decay goes on")
        low, high = sorted([10.0, 10.0 * (1.0 + change)])
        assert low < min(numbers) < max(numbers) < high
        assert (numbers[0] > numbers[1]) == (change > 0.0) == ("falls" in text)


def test_frequency_that_changes_with_the_strength() -> None:
    """Blows of which each decays linearly, but strong ones lower than weak ones, are no target."""
    times = np.arange(300)[:, np.newaxis] / RATE
    random = np.random.default_rng(1)
    for ratio, changes in ((0.97, True), (1.0, False)):
        waves = []
        for size, hertz in ((1.0, 10.0), (1.0, 10.0), (4.0, 10.0 * ratio), (4.0, 10.0 * ratio)):
            wave = np.exp(-2.0 * times) * np.cos(2.0 * math.pi * hertz * times)
            waves.append(50.0 * size * wave * [1.0, 0.4] + random.normal(0.0, 1.0, (300, 2)))
        modes = modes_of_decays(waves, RATE)
        assert any("not linear" in mode.doubt for mode in modes) == changes
        assert any(not mode.doubt for mode in modes) != changes


def test_noise_alone_has_no_mode() -> None:
    """White noise of any size gives none, neither sure nor doubtful."""
    random = np.random.default_rng(5)
    assert modes_of_decays([random.normal(size=(300, 2)) for _ in range(5)], RATE) == []


def test_limits_of_recordings() -> None:
    """40 samples at 20 Hz without a pause of half a second are enough to look for a blow.

    After each burst of 11 samples, 9 may be missing, but not 13.
    """

    def error(times: FloatArray) -> str:
        signals = np.random.default_rng(0).normal(size=(len(times), 2))
        with pytest.raises(RingdownError) as raised:
            measure_modes(times, signals)
        return str(raised.value)

    assert "has 39 samples" in error(np.arange(39.0) / 100.0)
    assert "No blow stands out" in error(np.arange(40.0) / 100.0)
    assert "samples a second" in error(np.arange(200.0) / 19.9)
    assert "No blow stands out" in error(np.arange(200.0) / 20.1)
    for pause, words in ((0.49, "No blow stands out"), (0.51, "pauses for 0.51 s after 0.99 s")):
        times = np.concatenate([np.arange(100.0) / 100.0, 0.99 + pause + np.arange(100.0) / 100.0])
        assert words in error(times)
    for lost, words in ((9, "No blow stands out"), (13, "come in bursts; stamp each sample")):
        times = np.add.outer(np.arange(50) * (11 + lost), np.arange(11)).ravel() / 100.0
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


@pytest.mark.parametrize(("below", "clipped"), [(5, True), (6, False)])
def test_limits_of_rails_that_move(below: int, clipped: bool) -> None:
    """41 values within 3 % of the largest are those of a rail with five values in the next 3 %.

    Eight times six are more. Each value occurs once.
    """
    values = [np.linspace(5.83, 6.0, 41), np.linspace(5.65, 5.81, below)]
    away = np.concatenate([*values, np.linspace(-2.5, 2.0, 501)])
    away -= np.median(away)
    try:
        ringdown._refuse_overload(away[:, np.newaxis])
    except RingdownError as error:
        assert clipped
        assert "Channel 1 has its largest value 41 times" in str(error)
    else:
        assert not clipped


@pytest.mark.parametrize(("hertz", "tone"), [(7.0, 0.0), (1.5, 0.0), (7.0, 0.1)])
def test_rails_from_which_an_app_takes_gravity(hertz: float, tone: float) -> None:
    """A clipped sensor is found where 2 % of a moving mean are taken off; another one is not."""
    times, signals = recording(np.random.default_rng(0), ((hertz, 0.06),), seconds=10.0)
    signals += tone * np.sin(2.0 * math.pi * 13.0 * times)[:, np.newaxis] - [0.0, 0.0, GRAVITY]
    ringdown._refuse_overload(signals)
    limited = np.clip(signals, -0.5, 0.5)
    means = np.array([np.convolve(each, np.full(100, 0.01), "same") for each in limited.T]).T
    with pytest.raises(RingdownError, match="as an overloaded sensor; hit softer"):
        ringdown._refuse_overload(limited - 0.02 * means)
