# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Blows on a hitch with dry friction at the rockshaft, integrated over time by this file."""

import math
from typing import Any

import numpy as np
import pytest

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.studies.ringdown import MeasuredMode, measure_modes
from linkage_vibration.support.resources import config_file

RATE, FINER, SECONDS, HIGHEST = 400, 10, 8, 200.0  # Hz, steps of a sample, s of a blow, Hz
IMPULSE, CONTACT, NOISE = 200.0, 4e-3, 0.05  # N s, s, m/s2
CRANK = 0.203  # m


@pytest.fixture(scope="module")
def tractor() -> LinkageModel:
    """Return the model of the linkage on its tractor."""
    return LinkageModel(read_mechanism(config_file("three_point_linkage_on_tractor.yaml")))


def measured(tractor: LinkageModel, friction: float, seed: int) -> list[MeasuredMode]:
    """Return the modes in accelerations of E1 after five blows at 135 deg, friction in N m.

    Modes below 200 Hz are integrated exactly for forces that are constant in a step. Up to the
    friction, the rockshaft sticks to a spring that is twenty times as stiff as all that holds it.
    """
    alpha3, random = math.radians(135.0), np.random.default_rng(seed)
    solution = tractor.solve(alpha3)
    w = solution.modes.omega[solution.modes.omega < 2.0 * math.pi * HIGHEST]
    z = solution.damping_ratios[: len(w)]
    places = [("E1", "x"), ("E1", "z"), ("V2", "x"), ("V2", "z"), ("P3", "x"), ("P3", "z")]
    rows = solution.participation(places)[:, : len(w)]
    turn = np.array([-math.sin(alpha3), math.cos(alpha3)]) @ (rows[2:4] - rows[4:]) / CRANK
    step, count = 1.0 / (RATE * FINER), SECONDS * RATE * FINER
    damped, decay = w * np.sqrt(1.0 - z**2), np.exp(-z * w * step)
    c, s = np.cos(damped * step), np.sin(damped * step)
    a, b = decay * (c + z * w / damped * s), decay * s / damped
    d = decay * (c - z * w / damped * s)
    spring, times = 20.0 / float(turn @ (turn / w**2)), np.arange(count) * step - 1.0
    during = (times >= 0.0) & (times < CONTACT)
    push = IMPULSE * math.pi / CONTACT / 2.0 * during * np.sin(math.pi / CONTACT * times)
    angles = random.uniform(0.0, math.pi, 5)
    into = np.column_stack([np.cos(angles), np.sin(angles)]) @ rows[:2]
    q, v, slip, blows = np.zeros_like(into), np.zeros_like(into), np.zeros(len(into)), list[Any]()
    for i, force in enumerate(push.tolist()):
        turned = q @ turn
        moment = (spring * (turned - slip)).clip(-friction, friction)
        slip = turned - moment / spring
        load = into * force - np.outer(moment, turn)
        if i % FINER == 0:
            blows.append((load - 2.0 * z * w * v - w * w * q) @ rows[:2].T)
        q, v = a * q + b * v + (1.0 - a) / w**2 * load, d * v - w * w * b * q + b * load
    signals = np.swapaxes(blows, 0, 1).reshape(-1, 2)
    signals = signals + random.normal(0.0, NOISE, signals.shape)
    return measure_modes(np.arange(len(signals)) / RATE, signals + np.array([0.0, 9.81]))


@pytest.mark.parametrize(
    ("seed", "deviations"), [(1, 5.0), pytest.param(2, 4.0, marks=pytest.mark.nightly)]
)
def test_friction_makes_no_targets(tractor: LinkageModel, seed: int, deviations: float) -> None:
    """250 N m split one mode into many and move the heave, and none is reported.

    The heave is more than 1 % and four or five deviations too high, in all of the decay. Without
    friction, both are reported.
    """
    exact = tractor.solve(math.radians(135.0)).natural_frequencies
    [one], heave = exact[(exact > 80.0) & (exact < 125.0)], exact[3]
    modes = measured(tractor, 250.0, seed)
    assert len([mode for mode in modes if 80.0 < mode.frequency < 125.0]) > 3
    assert [mode for mode in modes if not mode.doubt] == []
    assert any(mode.doubt.startswith("not linear") for mode in modes)
    [moved] = [mode for mode in modes if abs(mode.frequency / heave - 1.0) < 0.03]
    assert moved.frequency > heave + max(0.01 * heave, deviations * moved.frequency_stddev)
    assert moved.doubt.endswith("is not linear, which may move this one")
    linear = [mode for mode in measured(tractor, 0.0, seed) if not mode.doubt]
    assert not [mode for mode in linear if "linear" in mode.doubt]
    for at in (one, heave):
        assert min(abs(mode.frequency / at - 1.0) for mode in linear) < 1e-3
    assert len(linear) >= 4


@pytest.mark.nightly(short="test_friction_makes_no_targets")
@pytest.mark.parametrize("seed", [3, 4, 5, 6])
def test_a_linear_hitch_keeps_its_modes(tractor: LinkageModel, seed: int) -> None:
    """No mode of a linear hitch with noise is called not linear."""
    modes = measured(tractor, 0.0, seed)
    assert not [mode for mode in modes if "linear" in mode.doubt]
    hertz = np.array([mode.frequency for mode in modes if not mode.doubt])
    exact = tractor.solve(math.radians(135.0)).natural_frequencies
    for each in exact[[0, 3, 4]]:
        assert np.abs(hertz / each - 1.0).min() < 0.01
