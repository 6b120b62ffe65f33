# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Tracks modes from sample to sample by their shapes.

Modes that cross are distinguished from modes that veer, between which a gap remains.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import combinations, pairwise

import numpy as np
from scipy.optimize import brentq

from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, IntArray
from linkage_vibration.mechanics.modes import align, track
from linkage_vibration.table.interpolation import interpolation_matrix
from linkage_vibration.table.table import TableError
from linkage_vibration.table.tabulation.peaks import SILENT
from linkage_vibration.table.tabulation.sampling import Sample, Sampler

_VEERING = 0.03  # Once modes veer, shapes leave out coupling up to this share of the tolerance.

UNCLEAR = 0.5
"""MAC up to which a shape may continue two: its sum over all modes of a sample is 1."""
_COINCIDENT = 1e-12  # Modes whose logarithms differ by less coincide, and do not cross.
_MIXED = 0.9  # The MAC is lower where a shape has mixed with another.
_NARROW = 100.0  # Modes that mix and are closer than so many tolerances veer.

GRID = 401
"""Places over a piece at which its polynomials are evaluated: eight to each of its 48 points."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """The modes of each of n samples that continue the k modes of the first, and their values."""

    variables: FloatArray  # (n,): stroke variables of the samples, ascending
    orders: IntArray  # (n, k): indices of the modes of each sample
    shapes: FloatArray  # (n, n_interface, k): the aligned shapes
    mac: FloatArray  # (n - 1, k): MAC from each sample to the next
    log_frequencies: FloatArray  # (n, k): logarithms of natural frequencies in Hz
    ratios: FloatArray  # (n, k): damping ratios
    # (n, k + 2): maxima near each mode and at the ends of their band; NaN where there is none.
    peak_frequencies: FloatArray  # Hz
    peak_magnitudes: FloatArray  # m/N

    def at(self, variables: Sequence[float]) -> BoolArray:
        """Return which of the samples are at some stroke variables, (n,)."""
        wanted = set(variables)
        return np.array([x in wanted for x in self.variables.tolist()], dtype=np.bool_)

    def only(self, rows: BoolArray) -> "Tracked":
        """Return the modes at some of the samples, (n,), as tracked through all of them."""
        arrays = {each.name: getattr(self, each.name) for each in fields(self)}
        mac = arrays.pop("mac")[:0]
        return Tracked(mac=mac, **{name: array[rows] for name, array in arrays.items()})


class Tracker:
    """Tracks the modes of a sampler's samples.

    Modes that veer by less than the tolerance of frequencies may be treated as crossing.
    """

    def __init__(self, sampler: Sampler, tolerance: float) -> None:
        self.sampler = sampler
        self._tolerance = self._left_out = tolerance

    def heed_veering(self) -> None:
        """From now on rotate shapes only if their coupling is negligible, since some modes veer."""
        self._left_out = _VEERING * self._tolerance

    def follow(self, variables: Sequence[float]) -> Tracked:
        """Track the modes in reach of the band over samples in ascending order.

        It begins where modes are farthest apart, since their shapes do not mix there, and proceeds
        both ways. A mode that is in reach at one angle is tracked at all angles.
        """
        samples = [self.sampler.at(x) for x in variables]
        needed = [sample.reach for sample in samples]
        needed[0] = max(needed[0], self.sampler.response.modes)
        most = min(len(s.frequencies) for s in samples)
        count = min(max(needed), most)
        base = int(np.argmax([s.gaps[:count].min(initial=math.inf) for s in samples]))
        while True:
            orders, shapes, mac = self._run(samples, base, count)
            missed = max(
                len(set(range(few)).difference(order.tolist()))
                for few, order in zip(needed, orders, strict=True)
            )
            if missed == 0 or count == most:
                break
            count = min(count + missed, most)
        rank = np.argsort(orders[0], kind="stable")
        orders = [order[rank] for order in orders]
        both = list(zip(samples, orders, strict=True))
        peaks = [np.hstack([sample.peaks[:, order], sample.edges]) for sample, order in both]
        return Tracked(
            np.array(variables),
            np.array(orders),
            np.array([shape[:, rank] for shape in shapes]),
            mac[:, rank],
            np.log([sample.frequencies[order] for sample, order in both]),
            np.array([sample.ratios[order] for sample, order in both]),
            np.array([peak[0] for peak in peaks]),
            np.maximum([peak[1] for peak in peaks], SILENT),
        )

    def _run(
        self, samples: list[Sample], base: int, count: int
    ) -> tuple[list[IntArray], list[FloatArray], FloatArray]:
        """Track the lowest modes of one sample up and down from it."""
        n = len(samples)
        orders, mac = [np.arange(count)] * n, np.ones((n - 1, count))
        shapes = [samples[base].modes.shapes[:, :count]] * n
        for i in (*range(base + 1, n), *range(base - 1, -1, -1)):
            before = i - 1 if i > base else i + 1
            there, mass = samples[i].modes, self.sampler.mass
            order, signs, criterion = track(shapes[before], there, mass)
            modes = align(shapes[before], there, mass, order, signs, self._left_out)
            if modes is not there:
                order, signs, criterion = track(shapes[before], modes, mass)
            orders[i], mac[min(i, before)] = order, criterion
            shapes[i] = modes.select(order, signs).shapes
        return orders, shapes, mac


def unclear_steps(sampler: Sampler, tracked: Tracked) -> list[float]:
    """Return the middles of steps over which the shape of a mode may continue two."""
    middles = []
    for i in np.flatnonzero((tracked.mac <= UNCLEAR).any(axis=1)):
        here, there = tracked.variables[i : i + 2].tolist()
        if there - here < sampler.shortest:
            modes = 1 + np.flatnonzero(tracked.mac[i] <= UNCLEAR)
            raise TableError(
                f"Mode {' and mode '.join(map(str, modes))} cannot be tracked past alpha3 = "
                f"{math.degrees(sampler.angle(here)):.5f} deg: no shape on the other side "
                "resembles it; use fewer modes in response.modes, or end the stroke before."
            )
        middles.append((here + there) / 2.0)
    return middles


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
