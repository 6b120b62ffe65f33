# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds intervals in a log: gaps, and passes between jumps of the clock."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

_GAP = 10.0  # usual steps; a longer step is a gap
_LEAST_GAP = 0.1  # s; a shorter step is not a gap


def gap_starts(times: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the samples after which samples are missing, (n_gaps,); times (n,) are in s."""
    steps = np.diff(times)
    return np.flatnonzero(steps > max(_LEAST_GAP, _GAP * _usual(steps)))


def pass_starts(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return samples before which stamps, (n,), ns, jump back; a single late one is no jump."""
    steps = np.diff(stamps)
    limit = max(1e9 * _LEAST_GAP, _GAP * _usual(np.abs(steps)))
    after = np.flatnonzero(steps < -limit) + 1
    following = np.minimum(after + 1, len(stamps) - 1)
    return np.asarray(after[stamps[following] < stamps[after - 1]])


def _usual(steps: NDArray[Any]) -> float:
    """Return the median of the steps between different stamps, which several samples may share."""
    moves = steps[steps > 0]
    return float(np.median(moves)) if len(moves) else 0.0


def in_passes(stamps: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the order of the stamps within each pass, (n,), and the starts of all later passes."""
    starts = pass_starts(stamps)
    number = np.zeros(len(stamps), np.int64)
    number[starts] = 1
    return np.lexsort((stamps, np.cumsum(number))), starts


def one_after_the_other(
    stamps: NDArray[np.int64], starts: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return times, s, (n,), at which passes follow each other; starts are as in `pass_starts`."""
    steps = np.diff(stamps, prepend=stamps[:1])
    if len(starts):
        steps[starts] = int(np.median(steps))
    return np.asarray(np.cumsum(steps) / 1e9)
