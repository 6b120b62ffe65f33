# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Adds the standard deviations of modes by uncertain numbers of the mechanism to a table.

They are found at the points of the table, to first order, and interpolated between them. Where the
first order is not enough, they are NaN.
"""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import linear_sum_assignment

from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, IntArray
from linkage_vibration.mechanics.sensitivity import NEAR, ModeChanges, Sensitivity
from linkage_vibration.table.table import Table, TableError
from linkage_vibration.table.tabulation.sampling import Sampler

N_ANGLES = 257
"""Even angles over the range at which a table has the standard deviations."""

_FEWEST = 16  # Deviations are interpolated over at most this part of the range.
_ABOVE = 1.7  # Modes up to so many times the highest tracked frequency may mix with it.
_SAME = 1e-3  # Frequencies of the table and the model differ by a smaller share.
_CLOSE = 2.0  # Modes so many standard deviations apart do not change places.
_LEVEL = 1e-9  # A curve is level where its chords turn by less than this share of the most.
_EXCESS = 0.15  # Higher orders may add this share of a variance.
# The standard deviation of a toggle's angle may be this share of the distance from the toggle. A
# frequency may vanish with the distance, and a damping ratio then grows with its inverse. Higher
# orders add 5/4 and 4 times the square of the share to their standard deviations: 2 % and 8 %.
_TOGGLE = 0.14


def with_parameter_stddev(table: Table, sampler: Sampler) -> Table:
    """Return a table with the standard deviations by uncertain numbers of its mechanism.

    It refuses links that are known by FRFs alone, whose change with the numbers is unknown.
    """
    model = sampler.model
    uncertainty = model.mechanism.uncertainty
    if uncertainty is None or not uncertainty.numbers:
        return table
    if model.measured_frequencies is not None:
        raise TableError(
            f"{model.mechanism.name}: uncertainty needs links with matrices, and some of its links "
            "are known by FRFs alone; remove this section."
        )
    sensitivity = Sensitivity(model)
    at = _points(table)
    points = [
        _point(table, angle, values, sensitivity, sampler)
        for angle, values in zip(at.tolist(), table.evaluate(at), strict=True)
    ]
    angles = np.linspace(*table.alpha3_range, N_ANGLES)
    n, fewest = table.n_modes, min(len(each.frequencies) for each, _ in points)
    rows = [(each, order[:fewest]) for each, order in points]
    stddev = makima(at, angles, np.array([each.stddev[:, order[:n]] for each, order in rows]))
    excess = makima(at, angles, np.array([each.excess[:, order[:n]] for each, order in rows]))
    doubtful = np.abs(excess) > _EXCESS
    doubtful[:, 1] |= doubtful[:, 0]  # a damping ratio depends on the frequency
    doubtful |= _crowded(table, at, angles, rows)[:, np.newaxis]
    toggle = makima(at, angles, np.array([each.toggle_stddev for each, _ in rows]))
    if table.toggles is not None:
        apart = np.minimum(angles - table.toggles[0], table.toggles[1] - angles)
        doubtful |= (toggle > _TOGGLE * apart)[:, np.newaxis, np.newaxis]
    stddev = np.where(doubtful, math.nan, stddev)
    return replace(table, parameter_stddev=np.ascontiguousarray(stddev.swapaxes(0, 1)))


def _points(table: Table) -> FloatArray:
    """Return the angles of the table's points, and further ones where these are far apart."""
    longest = float(np.ptp(table.alpha3)) / _FEWEST
    counts = np.maximum(np.ceil(np.diff(table.alpha3) / longest), 1).astype(np.int64)
    pairs = zip(pairwise(table.alpha3.tolist()), counts.tolist(), strict=True)
    parts = [np.linspace(*ends, count, endpoint=False) for ends, count in pairs]
    return np.concatenate([*parts, table.alpha3[-1:]])


def _point(
    table: Table, alpha3: float, values: FloatArray, sensitivity: Sensitivity, sampler: Sampler
) -> tuple[ModeChanges, IntArray]:
    """Return the changes at an angle, and their order: tracked modes, then others."""
    tabulated = values[: 2 * table.n_modes].reshape(2, -1)
    oscillates = np.isfinite(tabulated[0])
    highest = _ABOVE * float(tabulated[0][oscillates].max(initial=0.0))
    changes = sensitivity.at(sampler.solution(alpha3), highest)
    there = np.array([changes.frequencies, changes.ratios])
    off = np.abs(np.log(tabulated[0][:, np.newaxis] / there[0])) + np.abs(
        tabulated[1][:, np.newaxis] - there[1]
    )
    off = np.where(np.isfinite(off), off, 10.0)  # a mode that does not oscillate takes what is left
    order = linear_sum_assignment(off)[1]
    allowed = max(_SAME, 2.0 * float(table.interpolation_error.max()))
    if (off[np.arange(len(order)), order][oscillates] > allowed).any():
        name, at = sampler.model.mechanism.name, f"{math.degrees(alpha3):.3f} deg"
        raise TableError(f"The table differs from {name} at {at}; build it again.")
    others = np.setdiff1d(np.arange(len(changes.frequencies)), order)
    return changes, np.concatenate([order, others])


def makima(points: FloatArray, angles: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate values at points, (n_points, ...), at angles by the modified Akima method.

    SciPy itself has this method only since 1.13, as `Akima1DInterpolator(method="makima")`.
    """
    chords = np.diff(values, axis=0) / np.diff(points).reshape(-1, *[1] * (values.ndim - 1))
    for _ in range(2):  # continue them linearly beyond both ends
        before, after = 2.0 * chords[:1] - chords[1:2], 2.0 * chords[-1:] - chords[-2:-1]
        chords = np.concatenate([before, chords, after])
    turns = np.abs(np.diff(chords, axis=0)) + 0.5 * np.abs(chords[1:] + chords[:-1])
    both = turns[:-2] + turns[2:]
    slopes = 0.5 * (chords[3:] + chords[:-3])
    kept = both > _LEVEL * both.max(initial=0.0)
    left, right = chords[1:-2][kept], chords[2:-1][kept]
    slopes[kept] = left + turns[:-2][kept] / both[kept] * (right - left)
    return np.asarray(CubicHermiteSpline(points, values, slopes, extrapolate=False)(angles))


def _crowded(
    table: Table, points: FloatArray, angles: FloatArray, rows: list[tuple[ModeChanges, IntArray]]
) -> BoolArray:
    """Return where the tracked modes may change places with others, (n_angles, n_modes)."""
    n = table.n_modes
    place = np.array(
        [[np.log(each.frequencies)[order], each.ratios[order]] for each, order in rows]
    )
    place = makima(points, angles, place)
    tabulated = table.evaluate(angles)
    place[:, 0, :n], place[:, 1, :n] = np.log(tabulated[:, :n]), tabulated[:, n : 2 * n]
    approach = np.array([each.approach[np.ix_(order, order)] for each, order in rows])
    approach = makima(points, angles, approach)[:, :n]
    gaps = np.hypot(*(place[:, i, :n, np.newaxis] - place[:, i, np.newaxis] for i in (0, 1)))
    gaps[:, np.arange(n), np.arange(n)] = math.inf
    return np.asarray(((gaps < _CLOSE * approach) & (gaps < NEAR)).any(axis=2))
