# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Both sides of each reason not to believe a mode."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from linkage_vibration.listening import mode_checks
from linkage_vibration.listening.mode_checks import (
    damping_doubt,
    line_doubt,
    low_damping_doubt,
    order_doubt,
    tone_doubt,
    wheelbase_lines,
    window_doubt,
)
from linkage_vibration.listening.output_only import Candidate, finish
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.excitation import Source, excitations_from_mapping
from linkage_vibration.prediction.ground import Terrain
from test.support.in_plane import plane_mechanism, plane_table

RATE = 20.0  # Hz


@pytest.mark.parametrize(
    ("rpm", "percent", "doubted"),
    [(317.0, 3, True), (317.0, 1, False), (313.0, 100, True), (316.0, 100, False)],
)
def test_order(rpm: float, percent: int, doubted: bool) -> None:
    """At 5 Hz an order of the PTO hides a mode up to 315 rpm; it may be there 2 % of a stretch."""
    excitations = excitations_from_mapping({"shaft": {"speed": "pto", "orders": [1]}})
    speed = np.full(1000, 600.0)
    speed[: 10 * percent] = 300.0 if percent < 100 else rpm
    doubt = order_doubt(np.full(1000, 5.0), {Source.PTO: speed}, excitations)
    assert doubt.startswith("shaft 1 was within 5 %") == doubted


SHAFT = {"shaft": {"speed": "pto", "orders": [1]}}
TERRAIN = {"field": {"speed": "ground", "terrain": {"class": "B"}, "raised": True}}


@pytest.mark.parametrize(
    ("mapping", "speeds", "doubt"),
    [
        (SHAFT, {}, "the pto speed, which shaft 1 follows, is not known in 100 % of a stretch"),
        (SHAFT, {Source.PTO: [math.nan] * 100}, "the pto speed, which shaft 1 follows, is not"),
        (SHAFT, {Source.PTO: [600.0] * 97 + [math.nan] * 3}, "the pto speed, which shaft 1"),
        (SHAFT, {Source.PTO: [600.0] * 99 + [math.nan]}, ""),
        (TERRAIN, {Source.PTO: [600.0] * 100}, "the ground speed, which field (class B) follows"),
        (TERRAIN, {Source.GROUND: [3.0] * 97 + [math.nan] * 3}, "the ground speed, which field"),
        (TERRAIN, {Source.GROUND: [3.0] * 99 + [math.nan]}, ""),
    ],
)
def test_unknown_speed(
    mapping: dict[str, object], speeds: dict[Source, list[float]], doubt: str
) -> None:
    """A speed that is not known for more than 2 % of a stretch may hide any mode."""
    excitations = excitations_from_mapping(mapping)
    arrays = {source: np.array(values) for source, values in speeds.items()}
    text = order_doubt(np.full(100, 5.0), arrays, excitations)
    assert text.startswith(doubt)
    assert bool(text) == bool(doubt)


@pytest.mark.parametrize(("ratio", "doubted"), [(0.039, False), (0.041, True), (math.nan, True)])
def test_damping(ratio: float, doubted: bool) -> None:
    """The deviation of a mode that is damped by more than 4 %, or unknown, is not known."""
    assert bool(damping_doubt(ratio)) == doubted


def test_lines_of_the_wheelbase() -> None:
    """At 20 km/h and 165 deg, maxima are at 5.69, 9.6 and 12.1 Hz; a changing speed blurs them.

    One mount, or no base, makes none; without FRFs at a mount, lines are not known. The numbers
    come from a prototype that computed the spectrum on its own.
    """
    table, mechanism = plane_table(), plane_mechanism()
    arguments = table, mechanism, Terrain(64e-6), ("E1", "z"), math.radians(165.0)
    lines = finish(wheelbase_lines(*arguments, [20.0 / 3.6]))
    for hertz in (5.69, 9.6, 12.1):
        assert np.abs(lines / hertz - 1.0).min() < 0.03
    modes = table.evaluate(np.radians([165.0]))[0, : table.n_modes]
    assert np.abs(np.log(np.divide.outer(lines, modes))).min() > 0.05
    assert mechanism.base is not None
    single = replace(mechanism.base, mounts=mechanism.base.mounts[:1])
    for base in (single, None):
        fewer = replace(mechanism, base=base)
        assert len(finish(wheelbase_lines(table, fewer, *arguments[2:], [20.0 / 3.6]))) == 0
    places = tuple((name.replace("rear_axle", "E3"), axis) for name, axis in table.places)
    lacking = replace(table, places=places), *arguments[1:]
    assert np.isnan(finish(wheelbase_lines(*lacking, [20.0 / 3.6]))).all()


def test_lines_are_maxima_of_the_acceleration(monkeypatch: pytest.MonkeyPatch) -> None:
    """A velocity's spectrum without a maximum, as it falls with f^2, has one as acceleration."""
    table, mechanism = plane_table(), plane_mechanism()
    modes = np.log(table.evaluate(np.radians([165.0]))[0, : table.n_modes])
    widest = int(np.diff(modes).argmax())
    away = np.linspace(-3.0, 3.0, 6001)
    hertz = np.exp(modes[widest : widest + 2].mean() + away)
    psd = hertz**-2.0 * (1.0 + np.exp(-((away / 0.5) ** 2)))
    assert (np.diff(psd) < 0.0).all()
    monkeypatch.setattr(mode_checks, "ground_spectrum", lambda *_: (hertz, psd))
    arguments = table, mechanism, Terrain(64e-6), ("E1", "z"), math.radians(165.0)
    assert finish(wheelbase_lines(*arguments, [3.0])).tolist() == [pytest.approx(hertz[3000])]


@pytest.mark.parametrize(
    ("frequency", "predicted", "doubted"),
    [(5.7, 6.5, True), (5.74, 5.75, False), (6.1, 6.5, False)],
)
def test_line(frequency: float, predicted: float, doubted: bool) -> None:
    """A frequency that is nearer to a line at 5.7 Hz than to its mode is doubtful, up to 5 %."""
    doubt = line_doubt(frequency, predicted, np.array([3.25, 5.7]))
    assert doubt.startswith("the wheelbase makes a line at 5.70 Hz") == doubted
    assert not line_doubt(frequency, predicted, np.array([]))
    assert "no FRFs at the wheels" in line_doubt(frequency, predicted, np.array([math.nan]))


@pytest.mark.parametrize(("shown", "doubt"), [(1, "1 of 3 windows show it"), (2, "")])
def test_windows(shown: int, doubt: str) -> None:
    """A mode that one of three windows shows is doubtful; one that two of them show is not."""
    random = np.random.default_rng(1)
    windows = []
    for i in range(3):
        omega, n = 2.0 * math.pi * (2.0 if i < shown else 5.0), 4000
        pole = np.exp((-0.02 + 1j) * omega / RATE)
        state, signal = 0.0 + 0.0j, np.empty(n)
        for k, noise in enumerate(random.standard_normal(n).tolist()):
            state = pole * state + noise
            signal[k] = state.imag
        noise2 = 0.05 * signal.std() * random.standard_normal((n, 2))
        windows.append(np.outer(signal, [1.0, 0.5]) + noise2)
    mode = Candidate(2.0, 0.02, np.array([1.0, 0.5], dtype=complex), 0.01, 0.001)
    assert finish(window_doubt(windows, RATE, 1, mode)) == doubt


@pytest.mark.parametrize(
    ("ratio", "stddev", "doubted"),
    [
        (1e-4, 1e-5, True),
        (0.0099, 0.0, True),
        (0.0101, 0.0, False),
        (0.005, 0.003, True),
        (0.005, 0.0031, False),
        (0.03, 0.001, False),
    ],
)
def test_low_damping(ratio: float, stddev: float, doubted: bool) -> None:
    """Below 1 % of predicted 2 % a ratio is doubted, unless 1.64 standard deviations reach 1 %."""
    doubt = low_damping_doubt(ratio, stddev, 0.02)
    assert (doubt.startswith("it may be a tone") and doubt.endswith("predicted 2 %")) == doubted
    assert bool(doubt) == doubted


BAND = (3.5, 7.0)  # Hz, around a mode at 5 Hz


def random_vibration(ratio: float, seed: int) -> list[FloatArray]:
    """Return three windows of 20 s of a mode at 5 Hz that white noise excites, (n, 1)."""
    random, windows = np.random.default_rng(seed), []
    radius = math.exp(-2.0 * math.pi * 5.0 * ratio / RATE)
    turn = 2.0 * math.pi * 5.0 * math.sqrt(1.0 - ratio**2) / RATE
    for _ in range(3):
        noise = random.standard_normal(1000 + round(20.0 * RATE))
        motion = lfilter([1.0], [1.0, -2.0 * radius * math.cos(turn), radius**2], noise)[1000:]
        windows.append(motion[:, np.newaxis] / motion.std())
    return windows


def with_tone(windows: list[FloatArray], power: float) -> list[FloatArray]:
    """Return windows with a tone at 5.5 Hz of a power over that of the vibration."""
    times = np.arange(len(windows[0])) / RATE
    tone = math.sqrt(2.0 * power) * np.sin(2.0 * math.pi * 5.5 * times)[:, np.newaxis]
    return [each + tone for each in windows]


def tones(ratio: float, power: float, orders: list[list[float]] | None = None) -> int:
    """Return how many of a hundred drives are doubted."""
    known = orders or [[]] * 3
    drives = (with_tone(random_vibration(ratio, seed), power) for seed in range(100))
    return sum(bool(finish(tone_doubt(each, RATE, BAND, known))) for each in drives)


@pytest.mark.parametrize("ratio", [0.01, 0.02, 0.04])
def test_tone(ratio: float) -> None:
    """A tone of ten times the power is doubted, and random vibration and a weak tone are not."""
    assert tones(ratio, 0.0) <= 3
    assert tones(ratio, 0.1) <= 5
    assert tones(ratio, 10.0) >= 95


def test_tone_that_is_described() -> None:
    """An order within 5 % of it explains a tone; if it does so in no window, the tone is named."""
    assert tones(0.02, 10.0, [[5.3, 20.0]] * 3) == 0
    windows = with_tone(random_vibration(0.02, 0), 10.0)
    doubt = finish(tone_doubt(windows, RATE, BAND, [[5.1], [6.0], []]))
    assert doubt.startswith("a tone at 5.50 Hz")


def test_window_without_a_signal() -> None:
    """Zeros, and a window that is too short, show no tone."""
    assert finish(tone_doubt([np.zeros((400, 1))], RATE, BAND, [[]])) == ""
    short = with_tone(random_vibration(0.02, 0), 100.0)[0][:60]
    assert finish(tone_doubt([short], RATE, BAND, [[]])) == ""
