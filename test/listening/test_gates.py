# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Both sides of each reason not to believe a mode."""

import math
from dataclasses import replace

import numpy as np
import pytest

from linkage_vibration.listening.gates import (
    damping_doubt,
    line_doubt,
    order_doubt,
    tone_doubt,
    wheelbase_lines,
    window_doubt,
)
from linkage_vibration.listening.output_only import Candidate, finish
from linkage_vibration.prediction.excitation import Source, excitations_from_mapping
from linkage_vibration.prediction.ground import Terrain
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table

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
    name = "three_point_linkage_on_tractor"
    table = load_table(config_file(f"tables/{name}.npz"))
    mechanism = read_mechanism(config_file(f"{name}.yaml"))
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
def test_tone(ratio: float, stddev: float, doubted: bool) -> None:
    """Below 1 % of predicted 2 % a ratio is doubted, unless 1.64 standard deviations reach 1 %."""
    doubt = tone_doubt(ratio, stddev, 0.02)
    assert doubt.endswith("predicted 2 %, may be a tone's") == doubted
    assert bool(doubt) == doubted
