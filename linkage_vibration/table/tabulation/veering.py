# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Distinguishes modes that cross from modes that veer, between which a gap remains."""

from itertools import combinations, pairwise

import numpy as np
from scipy.optimize import brentq

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.table.interpolation import interpolation_matrix
from linkage_vibration.table.tabulation.sampling import Sampler
from linkage_vibration.table.tabulation.tracking import Tracked

_COINCIDENT = 1e-12  # Modes whose logarithms differ by less coincide, and do not cross.
_MIXED = 0.9  # The MAC is lower where a shape has mixed with another.
_NARROW = 100.0  # Modes that mix and are closer than so many tolerances veer.

GRID = 401
"""Places over a piece at which its polynomials are evaluated: eight to each of its 48 points."""


def mix_closely(tracked: Tracked, tolerance: float) -> bool:
    """Return whether the shapes of modes with neighbouring frequencies mix, so that they veer."""
    mixed = np.flatnonzero((tracked.mac <= _MIXED).any(axis=1))
    beside = np.sort(tracked.log_frequencies[[*mixed, *(mixed + 1)]], axis=1)
    return bool((np.diff(beside, axis=1) < _NARROW * tolerance).any())


def crossing_gaps(sampler: Sampler, fitted: list[float], tracked: Tracked) -> dict[float, float]:
    """Solve the model where tracked modes cross, and return how far apart they are there.

    Modes that veer within a step shorter than those of the table seem to cross. The result, by the
    stroke variable, is half the relative gap: the error of the frequencies, which meet halfway.
    """
    rows = tracked.at(fitted)
    points, logarithms = tracked.variables[rows], tracked.log_frequencies[rows]

    def curve(at: FloatArray, values: FloatArray) -> FloatArray:
        return np.asarray(interpolation_matrix(points, at) @ values)

    def gap(at: float, values: FloatArray) -> float:
        return float(curve(np.array([at]), values)[0])

    grid = np.linspace(points[0], points[-1], GRID)
    curves, gaps = curve(grid, logarithms), {}
    for first, second in combinations(range(curves.shape[1]), 2):
        apart = curves[:, first] - curves[:, second]
        difference = logarithms[:, first] - logarithms[:, second]
        clear = np.flatnonzero(np.abs(apart) > _COINCIDENT)
        for i, j in pairwise(clear):
            if apart[i] * apart[j] > 0.0:
                continue
            x = float(brentq(gap, grid[i], grid[j], args=(difference,), xtol=1e-15))
            level = curve(np.array([x]), logarithms)[0, first]
            # The two modes are the nearest ones, and the second is half the gap away.
            off = np.abs(np.log(sampler.at(x).frequencies) - level)
            gaps[x] = float(np.sort(off)[1])
    return gaps
