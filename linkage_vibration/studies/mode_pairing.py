# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs measured modes with modes of a model by frequency, damping ratio and order.

Every measured mode has a cost between 0 and 1: 1 if it is not paired, and otherwise the distance
to its mode of the model. The pairing with the lowest sum is found by dynamic programming, among
those that keep the order of the modes. As a pair never costs more than 1, and a measured mode that
fits well costs almost nothing, a mode that belongs to none cannot push another off its place.

A pair is doubtful if the best pairing without it costs hardly more.
"""

import math
from collections.abc import Sequence

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.studies.ringdown import MeasuredMode

FARTHEST = 1.5  # ratio of the frequencies of a pair: beyond it they are not paired
_SIGMAS = 3.0  # standard deviations at which a distance is 1
_MODEL = math.log(FARTHEST) / _SIGMAS  # standard deviation of log(frequency) of a model
_MODEL_DAMPING = math.log(10.0) / _SIGMAS  # the same of log(damping ratio), which is hardly known
# A pair whose absence costs less is doubtful: an error of the model of 8 % would undo it.
_DOUBT = 0.2
_EQUAL = 1e-9  # difference of costs that rounding may cause


def pair_modes(
    measured: Sequence[MeasuredMode],
    frequencies: FloatArray,
    damping_ratios: FloatArray,
    deviations: FloatArray,
) -> list[tuple[int | None, ...]]:
    """Return the mode of the model (from 0) of each measured mode, None if it has none.

    If a pair is doubtful, the mode follows to which the measured mode belongs otherwise.
    Frequencies are in Hz, ascending, and the deviations relative ones of each possible pair,
    (n_measured, n_modes). Of equally good pairings the one with most pairs is taken, and of these
    the one whose first pairs have the lowest modes.
    """
    costs = _costs(measured, frequencies, damping_ratios, deviations)
    lowest, pairs = _pairing(costs)
    modes: list[tuple[int | None, ...]] = [(j,) for j in pairs]
    for i, j in enumerate(pairs):
        if j is not None:
            others = costs.copy()
            others[i, j] = math.inf
            cost, rivals = _pairing(others)
            modes[i] += (rivals[i],) * (cost - lowest < _DOUBT)
    return modes


def _pairing(costs: FloatArray) -> tuple[float, tuple[int | None, ...]]:
    """Return cost and modes of the best pairing."""
    # best[j]: cost and modes of the best pairing of the later measured modes with modes from j.
    best: list[tuple[float, tuple[int | None, ...]]] = [(0.0, ())] * (costs.shape[1] + 1)
    for row in reversed(costs.tolist()):
        best = [_best(row, first, best) for first in range(len(best))]
    return best[0]


def _best(
    row: list[float], first: int, later: list[tuple[float, tuple[int | None, ...]]]
) -> tuple[float, tuple[int | None, ...]]:
    """Return cost and modes of the best pairing of one measured mode and the later ones."""
    choices = [
        (row[j] + later[j + 1][0], (j, *later[j + 1][1]))
        for j in range(first, len(row))
        if row[j] <= 1.0
    ]
    choices.append((1.0 + later[first][0], (None, *later[first][1])))
    lowest = min(cost for cost, _ in choices)
    equal = [choice for choice in choices if choice[0] <= lowest + _EQUAL]
    return max(equal, key=lambda choice: len(choice[1]) - choice[1].count(None))  # the first such


def _costs(
    measured: Sequence[MeasuredMode],
    frequencies: FloatArray,
    damping_ratios: FloatArray,
    deviations: FloatArray,
) -> FloatArray:
    """Return the cost of each pair, (n_measured, n_modes): 0 to 1, inf if it is not permitted."""
    hz, ratios, spreads = np.array(
        [(mode.frequency, mode.ratio, mode.ratio_stddev / mode.ratio) for mode in measured]
    ).reshape(-1, 3, 1).transpose(1, 0, 2)  # fmt: skip
    away = np.abs(np.log(hz / np.maximum(frequencies, 1e-3)))
    permitted = away <= math.log(FARTHEST) + _EQUAL
    with np.errstate(divide="ignore", invalid="ignore"):
        damping = np.abs(np.log(ratios / damping_ratios))
    damping = np.where(np.isfinite(damping), damping, 0.0)  # a model without damping
    damping /= _SIGMAS * np.hypot(_MODEL_DAMPING, np.nan_to_num(spreads))
    distance = np.hypot(away / (_SIGMAS * np.hypot(_MODEL, deviations)), damping)
    return np.where(permitted, np.minimum(distance, 1.0), math.inf)
