# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds intervals in a log: runs of equal values, and gaps between predictions."""

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

_GAP = 10.0  # median steps; a longer step is a gap
_LEAST_GAP = 0.1  # s; a shorter step is not a gap


def runs(flags: NDArray[np.bool_], *columns: NDArray[Any]) -> list[tuple[int, int]]:
    """Return the start and the end (exclusive) of each run of true flags.

    Parameters
    ----------
    flags : ndarray of bool, (n,)
        The samples that belong to a run.
    *columns : ndarray, (n,)
        A run ends where the value of a column changes.
    """
    changed = np.ones(len(flags) + 1, dtype=bool)
    changed[1:-1] = np.any([c[1:] != c[:-1] for c in (flags, *columns)], axis=0)
    edges = np.flatnonzero(changed).tolist()
    return [(i, j) for i, j in itertools.pairwise(edges) if flags[i]]


def gap_starts(times: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the samples after which samples are missing, (n_gaps,); times (n,) are in s."""
    steps = np.diff(times)
    if not len(steps):
        return np.empty(0, dtype=np.int64)
    return np.flatnonzero(steps > max(_LEAST_GAP, _GAP * float(np.median(steps))))
