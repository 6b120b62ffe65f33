# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What is doubtful about a measured signal is named, and what is not stays unnamed."""

import math
from typing import Any

import numpy as np
import pytest

from linkage_vibration.listening.orders import levels, spectrogram
from linkage_vibration.listening.signals import Signal, SignalError, known_at, measured_signal
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.readers.sensors import Sensor

RATE, N = 200.0, 4000


def sensor(**changes: Any) -> Sensor:
    """Return an accelerometer on the implement."""
    values: dict[str, Any] = {
        "name": "imu",
        "at": "E1",
        "accelerates": True,
        "scale": 1.0,
        "axes": np.eye(3),
        "limit": math.inf,
        "file": None,
        "topic": "/imu",
        "type": "sensor_msgs/msg/Imu",
        "fields": (),
        "columns": (),
        "starts_at": 0.0,
        "filtered": True,
    }
    return Sensor(**{**values, **changes})


def readings(gravity: FloatArray | None = None, amplitude: float = 1.0) -> FloatArray:
    """Return a vibration of 10 Hz along all axes, and noise, beside gravity along z."""
    wave = amplitude * np.sin(2.0 * math.pi * 10.0 * np.arange(N) / RATE)
    noise = np.random.default_rng(0).normal(0.0, 1e-3, (N, 3))
    return wave[:, np.newaxis] + noise + (np.array([0, 0, 9.81]) if gravity is None else gravity)


def doubts(values: FloatArray, times: FloatArray | None = None, **changes: Any) -> str:
    """Return all doubts about readings, (n, 3), of modes up to 20 Hz."""
    at = np.arange(len(values)) / RATE if times is None else times
    return " ".join(measured_signal(sensor(**changes), at, values, 20.0).doubts)


def test_a_sound_signal_has_no_doubts() -> None:
    """Gravity is along z, the steps are even, and nothing is near half of the rate."""
    assert doubts(readings(), filtered=False) == ""


def test_axes_and_unit_are_those_of_the_tractor() -> None:
    """A sensor upside down, in g, shows 9.80665 m/s2 upwards."""
    axes = np.diag([1.0, -1.0, -1.0])
    gravity = np.array([0.0, 0.0, -1.0])
    signal = measured_signal(
        sensor(scale=9.80665, axes=axes), np.arange(N) / RATE, readings(gravity, 0.0), 20.0
    )
    np.testing.assert_allclose(signal.values.mean(axis=0), [0.0, 0.0, 9.80665], atol=1e-3)
    assert signal.rate == pytest.approx(RATE)
    assert not signal.doubts


@pytest.mark.parametrize(("limit", "named"), [(11.0, False), (10.8, True)])
def test_known_range(limit: float, named: bool) -> None:
    """The largest reading is 10.81 m/s2; a range that it nearly reaches cuts off peaks."""
    assert ("reach the range" in doubts(readings(), limit=limit)) == named


@pytest.mark.parametrize(("repeats", "named"), [(2, False), (3, True)])
def test_unknown_range(repeats: int, named: bool) -> None:
    """Three equal largest readings in a row are an overload, and two may be chance."""
    values = readings()
    values[100 : 100 + repeats, 2] = 40.0
    assert ("overloaded" in doubts(values)) == named


@pytest.mark.parametrize("hertz", [0.5, 1.0, 2.0, 3.3, 7.1])
def test_a_crest_that_is_flat_by_rounding_is_not_overloaded(hertz: float) -> None:
    """With a resolution of 0.05 m/s2, the crest of a slow sine repeats; a limit makes a corner."""
    wave, values = 9.0 * np.sin(2.0 * math.pi * hertz * np.arange(N) / RATE), np.zeros((N, 3))
    values[:, 2] = 0.05 * np.round((wave + 9.81) / 0.05)
    assert "overloaded" not in doubts(values)
    values[:, 2] = 0.05 * np.round((np.minimum(3.0 * wave, 9.0) + 9.81) / 0.05)
    assert "overloaded" in doubts(values)


def test_a_constant_channel_is_not_overloaded() -> None:
    """An axis that shows nothing at all is still, not at its range."""
    values = readings()
    values[:, 1] = 0.25
    assert "overloaded" not in doubts(values)


@pytest.mark.parametrize(("gap", "named"), [(0.005, False), (2.0, True)])
def test_gaps(gap: float, named: bool) -> None:
    """Two seconds without samples are a gap, of which no window contains a part."""
    times = np.arange(N) / RATE
    times[1000:] += gap
    signal = measured_signal(sensor(), times, readings(), 20.0)
    assert any("gaps of up to" in text for text in signal.doubts) == named
    at, values = signal.windows(1.0)
    assert values.shape == (20, 200, 3)
    assert not np.any((at[:, 0] < times[999]) & (at[:, -1] > times[1000] + 1e-9) & named)


def test_what_a_log_knows_between_its_messages() -> None:
    """Values between messages are interpolated, but not before, after, and in a gap of 2 s."""
    since = np.append(np.arange(0.0, 1.0, 0.05), np.arange(3.0, 4.0, 0.05))
    actual = known_at(np.array([-0.1, 0.5, 0.525, 2.0, 3.0, 3.5, 4.1]), since, 2.0 * since)
    np.testing.assert_allclose(actual, [np.nan, 1.0, 1.05, np.nan, 6.0, 7.0, np.nan])


@pytest.mark.parametrize(("share", "named"), [(0.08, False), (0.12, True)])
def test_uneven_stamps(share: float, named: bool) -> None:
    """Stamps that vary by 12 % of a step are named with what they may cost, those by 8 % are not.

    A sine of 90 Hz, sampled at such times, has exp(-(2 pi 90 Hz sigma)^2 / 2) of its amplitude.
    """
    late = np.random.default_rng(1).normal(0.0, share / RATE, N)
    sentences = doubts(readings(), np.arange(N) / RATE + late)
    assert ("Its stamps vary" in sentences) == named
    loss = 1.0 - math.exp(-((2.0 * math.pi * 90.0 * share / RATE) ** 2) / 2.0)
    assert (f"90 Hz appears up to {100.0 * loss:.0f} % too weak" in sentences) == named


def tone_level(signal: Signal, hertz: float, seconds: float) -> float:
    """Return the amplitude of a sine along z in windows, whose phases may differ."""
    times, values = signal.windows(seconds)
    turns = np.exp(-2j * math.pi * hertz * times)
    return float(np.abs(2.0 * (values[:, :, 2] * turns).mean(axis=1)).mean())


def test_spectra_are_those_of_a_tone() -> None:
    """One of 1 m/s2 at 20 Hz has a mean square of 1/2, and 1 / (2 pi 20) m/s over the root of 2."""
    times = np.arange(0.0, 8.0, 0.005)
    values = np.outer(np.sin(2.0 * np.pi * 20.0 * times), [0.0, 0.6, 0.8])
    signal = Signal(sensor(), times, values, 200.0, ())
    _, frequencies, power = spectrogram(signal)
    np.testing.assert_allclose(power.sum(axis=1) * frequencies[1], 0.5, rtol=1e-3)
    expected = 1.0 / (2.0 * math.pi * 20.0 * math.sqrt(2.0))
    np.testing.assert_allclose(levels(signal), expected, rtol=0.01)


def test_stamps_that_are_rounded_or_late_cost_nothing() -> None:
    """A sensor that samples evenly keeps 80 Hz, with stamps in ms, late, or of batches of eight."""
    true = 100.0 + np.arange(2080) / 208.0
    values = np.zeros((2080, 3))
    values[:, 2] = 9.81 + np.sin(2.0 * math.pi * 80.0 * true)
    late = np.random.default_rng(2).exponential(0.1 / 208.0, 2080)
    eight = true[np.arange(2080) // 8 * 8 + 7]
    for stamps in (true, np.round(true, 3), true + late, true + 1e-4 * (true - 100.0), eight):
        signal = measured_signal(sensor(), stamps, values, 20.0)
        assert signal.rate == pytest.approx(208.0, rel=2e-4)
        assert tone_level(signal, 80.0 / (208.0 / signal.rate), 4.0) == pytest.approx(1.0, rel=0.02)


def test_single_missing_samples_keep_the_others_in_place() -> None:
    """Every hundredth sample is lost; 20 Hz stays what it is, and no window is cut."""
    values, true = readings(amplitude=0.0), np.arange(N) / RATE
    values[:, 2] += np.sin(2.0 * math.pi * 20.0 * true)
    kept = np.arange(N) % 100 != 50
    signal = measured_signal(sensor(), true[kept], values[kept], 20.0)
    np.testing.assert_allclose(signal.times, true, atol=1e-9)
    assert tone_level(signal, 20.0, 4.0) == pytest.approx(1.0, rel=0.01)
    assert not signal.doubts


@pytest.mark.parametrize("within", [0.0, 1e-9, 2e-5, 1e-3])
@pytest.mark.parametrize("apart", [0.05, 0.2])
def test_bursts_are_refused(within: float, apart: float) -> None:
    """Samples that arrive together at uneven times say nothing about when they were taken."""
    arrived = np.cumsum(np.random.default_rng(1).uniform(0.3, 1.7, 500)) * apart
    stamps = np.add.outer(arrived, np.arange(10) * within).ravel()
    values = np.vstack([readings(), readings()[:1000]])
    words = r"(bursts|than a step); stamp each sample|imu: 4500 of 5000 .*; record each sample"
    with pytest.raises(SignalError, match=words):
        measured_signal(sensor(), stamps, values, 20.0)


@pytest.mark.parametrize(
    ("stretches", "samples", "lost", "words"),
    [
        (20, 200, 200, "19 gaps"),  # silent for 1 s after each second
        (20, 105, 200, "19 gaps"),  # 20 x 104 x 5 ms is more than 0.5 s for each gap
        (20, 94, 200, "come in bursts"),  # 20 x 93 x 5 ms is less
        (2, 40, 200, "gap"),  # one gap makes no bursts
        (3, 40, 200, "come in bursts"),
        (100, 10, 9, ""),  # half of the samples may be missing
        (100, 10, 11, "come in bursts"),
    ],
)
def test_long_stretches_are_no_bursts(stretches: int, samples: int, lost: int, words: str) -> None:
    """A sensor that falls silent again and again is used, with a doubt, if it mostly samples."""
    at = np.add.outer(np.arange(stretches) * (samples + lost), np.arange(samples)).ravel()
    try:
        text = doubts(readings()[: len(at)], at / RATE)
    except SignalError as error:
        text = str(error)
    assert words in text if words else not text


@pytest.mark.parametrize(("highest", "named"), [(99.0, False), (101.0, True)])
def test_rate(highest: float, named: bool) -> None:
    """200 samples a second show modes up to 100 Hz."""
    signal = measured_signal(sensor(), np.arange(N) / RATE, readings(), highest)
    assert any("shows nothing above 100 Hz" in text for text in signal.doubts) == named


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(
    ("hertz", "filtered", "named"), [(85.0, False, False), (97.0, False, True), (97.0, True, False)]
)
def test_folded_vibration(hertz: float, filtered: bool, named: bool, axis: int) -> None:
    """Vibration just below half of the rate may be folded, unless the sensor has a filter."""
    values = readings()
    values[:, axis] += np.sin(2.0 * math.pi * hertz * np.arange(N) / RATE)
    words = "just below 100 Hz, half of its rate, so higher frequencies may appear folded"
    assert (words in doubts(values, filtered=filtered)) == named


@pytest.mark.parametrize(
    ("gravity", "named"),
    [
        (9.81, ""),
        (1.0, "write `unit: g`"),
        (96.2, "write `unit: m/s2`"),
        (8.5, ""),
        (8.0, "check its unit"),
        (0.5, "shows no gravity"),
    ],
)
def test_gravity_has_a_size(gravity: float, named: str) -> None:
    """Gravity of 1 or of 96 m/s2 names the unit, and another size is named, too."""
    text = doubts(readings(np.array([0.0, 0.0, gravity])))
    assert (named in text) if named else not text


@pytest.mark.parametrize(("tilt", "named"), [(13.0, False), (17.0, True)])
def test_gravity_has_a_direction(tilt: float, named: bool) -> None:
    """A sensor that hangs 17 deg away from its mounting is named."""
    angle = math.radians(tilt)
    gravity = 9.81 * np.array([math.sin(angle), 0.0, math.cos(angle)])
    assert ("hang loose" in doubts(readings(gravity))) == named


def test_forces_have_no_gravity() -> None:
    """A draft pin is not asked for gravity, and keeps its scale."""
    force = sensor(accelerates=False, scale=1e3, axes=np.eye(1))
    signal = measured_signal(force, np.arange(N) / RATE, readings()[:, :1], 20.0)
    assert not signal.doubts
    assert signal.values.std() == pytest.approx(1e3 / math.sqrt(2.0), rel=1e-3)


@pytest.mark.parametrize("held", [2, 8])
def test_values_that_are_published_again(held: int) -> None:
    """A sensor of a lower rate whose values are repeated shows no higher frequency than it has."""
    signal = measured_signal(
        sensor(), np.arange(N) / RATE, readings()[::held].repeat(held, 0)[:N], 20.0
    )
    assert signal.rate == pytest.approx(RATE / held, rel=1e-3)
    assert f"Its values occur {held} times in a row" in " ".join(signal.doubts)
    slow = measured_signal(sensor(), np.arange(0, N, held) / RATE, readings()[::held], 20.0)
    np.testing.assert_allclose(signal.at(slow.times[9:-9]), slow.at(slow.times[9:-9]), atol=1e-9)


def test_values_of_a_rate_that_is_no_fraction() -> None:
    """A sensor of 60 Hz that is published at 200 Hz repeats its values three or four times."""
    which = (np.arange(N) * 60) // 200
    signal = measured_signal(sensor(), np.arange(N) / RATE, readings()[which], 20.0)
    assert signal.rate == pytest.approx(60.0, rel=1e-2)


@pytest.mark.parametrize(("irregular", "repeated"), [(0.05, True), (0.15, False)])
def test_most_values_are_repeated_equally_often(irregular: float, repeated: bool) -> None:
    """A tenth of the values may occur more or less often, as where samples are lost."""
    often = np.full(N // 8, 8)
    often[:: round(1.0 / irregular)] = 4
    values = readings()[: len(often)].repeat(often, axis=0)
    signal = measured_signal(sensor(), np.arange(len(values)) / RATE, values, 20.0)
    assert ("times in a row" in " ".join(signal.doubts)) == repeated


def test_values_that_change_at_random_are_not_repeated() -> None:
    """Four in ten samples are new: most values occur one to three times."""
    generator = np.random.default_rng(4)
    steps = np.where(generator.random((N, 1)) < 0.4, generator.normal(size=(N, 1)), 0.0)
    values = np.cumsum(steps, axis=0).repeat(3, axis=1)
    assert np.median(np.diff(np.flatnonzero(steps))) == 2.0
    assert measured_signal(sensor(), np.arange(N) / RATE, values, 20.0).rate == pytest.approx(RATE)


def test_coarse_steps_are_no_repeated_values() -> None:
    """A slow vibration in steps of its resolution repeats values, but not equally often."""
    time = np.arange(N) / RATE
    coarse = 0.2 * np.round(5.0 * np.sin(2.0 * math.pi * 1.3 * time))[:, np.newaxis].repeat(3, 1)
    assert (np.diff(coarse[:, 0]) == 0.0).mean() > 0.5
    assert measured_signal(sensor(), time, coarse, 20.0).rate == pytest.approx(RATE)


def test_a_few_samples_are_refused() -> None:
    """Less than 16 samples are no signal."""
    with pytest.raises(SignalError, match="imu has 15 samples"):
        measured_signal(sensor(), np.arange(15) / RATE, readings()[:15], 20.0)


@pytest.mark.parametrize(("step", "refused"), [(0.39, False), (0.41, True), (5.0, True)])
def test_samples_far_apart_are_refused(step: float, refused: bool) -> None:
    """Stamps in ms, or a slow sensor, leave no frequency between 1 Hz and 0.45 of the rate."""
    if not refused:
        assert measured_signal(sensor(), step * np.arange(N), readings(), 20.0).rate < 2.6
        return
    text = rf"imu has {1.0 / step:.2g} samples per second, .* times in s"
    with pytest.raises(SignalError, match=text):
        measured_signal(sensor(), step * np.arange(N), readings(), 20.0)
