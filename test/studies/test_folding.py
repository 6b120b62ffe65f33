# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measured modes that may be folded are named."""

import math

import numpy as np
import pytest

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.studies.measurement import doubt_folds, possible_folds
from linkage_vibration.studies.ringdown import MeasuredMode

RATE = 400.0  # Hz
MODEL = np.array([4.0, 97.0, 281.2, 700.0])  # Hz
RATIOS = np.array([0.02, 0.012, 0.03, 0.5])


def mode(hertz: float, decay: float) -> MeasuredMode:
    """Return a mode with a decay rate in 1/s."""
    return MeasuredMode(hertz, decay / (2.0 * math.pi * hertz), 0.1, 0.001, 5)


DECAY = 0.03 * 2.0 * math.pi * 281.2  # 1/s


@pytest.mark.parametrize(
    ("hertz", "decay", "folds"),
    [
        (400.0 - 281.2, DECAY, [2]),
        (400.0 - 281.2 * math.exp(0.15), DECAY, [2]),  # the model is wrong by 8 % at one deviation
        (400.0 - 281.2 * math.exp(0.17), DECAY, []),
        (400.0 - 281.2, DECAY * 10.0 ** (1.9 / 3.0), [2]),  # and the decay by a third of a decade
        (400.0 - 281.2, DECAY * 10.0 ** (2.1 / 3.0), []),
        (400.0 - 281.2, DECAY * 10.0 ** (-2.1 / 3.0), []),
        (100.0, 0.5 * 2.0 * math.pi * 700.0, [3]),  # 2 * 400 - 700
        (97.0, 7.3, []),
        (4.0, 0.5, []),
    ],
)
def test_folds_of_modes(hertz: float, decay: float, folds: list[int]) -> None:
    """A mode at 281.2 Hz appears at 118.8 Hz, and one at 700 Hz at 100 Hz, as fast as it decays."""
    assert possible_folds(mode(hertz, decay), MODEL, RATIOS, RATE) == folds


def test_modes_below_half_the_rate_do_not_fold() -> None:
    """At 600 Hz none is above 300 Hz but the last, which appears at 100 Hz."""
    assert possible_folds(mode(281.2, DECAY), MODEL, RATIOS, 600.0) == []
    assert possible_folds(mode(100.0, 2200.0), MODEL, RATIOS, 600.0) == [3]


def test_doubts_name_the_mode(model: LinkageModel) -> None:
    """The doubt has the mode's number and frequency, and the rate; an earlier doubt stays."""
    solution = model.solve(2.0)
    hertz = solution.natural_frequencies
    high = int(np.argmax(hertz > 0.5 * RATE))
    decay = 2.0 * math.pi * hertz[high] * solution.damping_ratios[high]
    folded = mode(RATE - float(hertz[high]), float(decay))
    first, second = doubt_folds([mode(float(hertz[0]), 0.4), folded], model, 2.0, RATE)
    assert not first.doubt
    words = f"it may be mode {high + 1} ({hertz[high]:.4g} Hz)"
    assert second.doubt.startswith(words)
    assert second.doubt.endswith("of the model, folded at 400 samples a second")
