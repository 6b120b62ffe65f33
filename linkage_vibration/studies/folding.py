# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Says which measured modes may be modes above half the sampling rate, folded below it.

Without an anti-aliasing filter, a mode at f appears at abs(f - k rate), with the same decay rate.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.studies.ringdown import MeasuredMode

_FREQUENCY = 0.08  # standard deviation of log(frequency) of a model
_DECAY = math.log(10.0) / 3.0  # the same of log(decay rate), which is hardly known
_POSSIBLE = 2.0  # such deviations between a mode of the model and a measured one, unfolded


def doubt_folds(
    measured: Sequence[MeasuredMode], model: LinkageModel, alpha3: float, rate: float
) -> list[MeasuredMode]:
    """Return measured modes, with a doubt where a mode of the model may be folded; rate in Hz."""
    solution = model.solve(alpha3)
    count = len(solution.natural_frequencies)
    frequencies, ratios = solution.natural_frequencies, solution.damping_ratios[:count]
    doubted = []
    for mode in measured:
        folds = possible_folds(mode, frequencies, ratios, rate)
        names = " or ".join(f"mode {i + 1} ({frequencies[i]:.4g} Hz)" for i in folds)
        doubt = f"it may be {names} of the model, folded at {rate:.4g} samples a second"
        doubted.append(replace(mode, doubt=mode.doubt or doubt) if folds else mode)
    return doubted


def possible_folds(
    mode: MeasuredMode, frequencies: FloatArray, ratios: FloatArray, rate: float
) -> list[int]:
    """Return which modes of a model (from 0; Hz and damping ratios) may appear as a mode."""
    high = np.flatnonzero((frequencies > 0.5 * rate) & (ratios > 0.0) & (ratios < 1.0))
    turns = np.round(frequencies[high] / rate)
    beside = np.array(
        [(turns + k) * rate + s * mode.frequency for k in (-1, 0, 1) for s in (-1, 1)]
    )
    away = np.log(np.where(beside > 0.5 * rate, beside, math.inf) / frequencies[high])
    decays = np.log(mode.ratio * mode.frequency / (ratios * frequencies)[high])
    distance = np.hypot(np.abs(away).min(axis=0, initial=math.inf) / _FREQUENCY, decays / _DECAY)
    return [int(i) for i in high[distance < _POSSIBLE]]
