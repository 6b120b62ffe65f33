# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Follows modes from sample to sample by their shapes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.modes import align, track
from linkage_vibration.mechanics.response import in_reach
from linkage_vibration.table.table import TableError
from linkage_vibration.table.tabulation.peaks import SILENT
from linkage_vibration.table.tabulation.sampling import Sample, Sampler

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_VEERING = 0.03  # of the tolerance: what is left out of shapes once some veer by little more

UNCLEAR = 0.5
"""MAC up to which a shape may continue two: over all modes of a sample it adds up to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """Which modes of each of n samples continue the k of the first, and what is tabulated of them.

    Attributes
    ----------
    variables : ndarray, (n,)
        Stroke variables of the samples, ascending.
    orders : list of ndarray of int, (k,)
        The modes of each sample.
    signs : list of ndarray, (k,)
        That align their shapes with those of the first.
    shapes : list of ndarray, (n_interface, k)
        So aligned.
    mac : ndarray, (n - 1, k)
        From each sample to the next.
    log_frequencies, ratios : ndarray, (n, k)
        Of natural frequencies in Hz, and damping ratios.
    peak_frequencies, peak_magnitudes : ndarray, (n, k + 2)
        Maxima beside each mode and at the band's ends, Hz and m/N; NaN where there is none.
    """

    variables: FloatArray
    orders: list[IntArray]
    signs: list[FloatArray]
    shapes: list[FloatArray]
    mac: FloatArray
    log_frequencies: FloatArray
    ratios: FloatArray
    peak_frequencies: FloatArray
    peak_magnitudes: FloatArray

    def at(self, variables: Sequence[float]) -> NDArray[np.bool_]:
        """Which of the samples are at some stroke variables, (n,)."""
        some = set(variables)
        return np.array([x in some for x in self.variables.tolist()], dtype=np.bool_)

    def only(self, rows: NDArray[np.bool_]) -> "Tracked":
        """Return what is tracked at some of the samples, (n,), followed through all of them."""
        some = np.flatnonzero(rows)
        return Tracked(
            self.variables[some],
            [self.orders[i] for i in some],
            [self.signs[i] for i in some],
            [self.shapes[i] for i in some],
            self.mac[:0],
            self.log_frequencies[some],
            self.ratios[some],
            self.peak_frequencies[some],
            self.peak_magnitudes[some],
        )


class Tracker:
    """Tracks the modes of a sampler's samples.

    Parameters
    ----------
    sampler : Sampler
        Solves the model.
    tolerance : float
        Of natural frequencies; modes that come nearer than that may be taken to cross.
    """

    def __init__(self, sampler: Sampler, tolerance: float) -> None:
        self.sampler = sampler
        self._tolerance = self._left_out = tolerance

    def heed_veering(self) -> None:
        """From now on turn shapes only where next to nothing couples them: some do veer."""
        self._left_out = _VEERING * self._tolerance

    def follow(self, variables: Sequence[float]) -> Tracked:
        """Track the modes in reach of the band over samples in ascending order.

        It begins where modes lie farthest apart, since their shapes are their own there, and goes
        both ways. A mode in reach at one angle is tracked at all.
        """
        samples = [self.sampler.at(x) for x in variables]
        band, least = self.sampler.response.band, self.sampler.response.modes
        needed = [int(in_reach((2.0 * math.pi * s.frequencies) ** 2, band).sum()) for s in samples]
        needed[0] = max(needed[0], least)
        most = min(len(s.frequencies) for s in samples)
        count = min(max(needed), most)
        gaps = [np.diff(np.log(s.frequencies[: count + 1])).min(initial=math.inf) for s in samples]
        base = int(np.argmax(gaps))
        while True:
            orders, signs, shapes, mac = self._run(samples, base, count)
            missed = max(
                len(set(range(few)).difference(order.tolist()))
                for few, order in zip(needed, orders, strict=True)
            )
            if missed == 0 or count == most:
                break
            count = min(count + missed, most)
        turn, rank = signs[0].copy(), np.argsort(orders[0], kind="stable")
        orders = [order[rank] for order in orders]
        both = list(zip(samples, orders, strict=True))
        peaks = [np.hstack([sample.peaks[:, order], sample.edges]) for sample, order in both]
        return Tracked(
            np.array(variables),
            orders,
            [(sign * turn)[rank] for sign in signs],
            [(shape * turn)[:, rank] for shape in shapes],
            mac[:, rank],
            np.log([sample.frequencies[order] for sample, order in both]),
            np.array([sample.ratios[order] for sample, order in both]),
            np.array([peak[0] for peak in peaks]),
            np.maximum([peak[1] for peak in peaks], SILENT),
        )

    def _run(
        self, samples: list[Sample], base: int, count: int
    ) -> tuple[list[IntArray], list[FloatArray], list[FloatArray], FloatArray]:
        """Track the lowest modes of one sample up and down from it."""
        n, mass = len(samples), self.sampler.mass
        orders = [np.arange(count)] * n
        signs, mac = [np.ones(count)] * n, np.ones((n - 1, count))
        shapes = [samples[base].modes.shapes[:, :count]] * n
        for i in (*range(base + 1, n), *range(base - 1, -1, -1)):
            before = i - 1 if i > base else i + 1
            found = samples[i].modes
            order, sign, criterion = track(shapes[before], found, mass)
            modes = align(shapes[before], found, mass, order, sign, self._left_out)
            if modes is not found:
                order, sign, criterion = track(shapes[before], modes, mass)
            orders[i], signs[i], mac[min(i, before)] = order, sign, criterion
            shapes[i] = modes.select(order, sign).shapes
        return orders, signs, shapes, mac


def unclear_steps(sampler: Sampler, tracked: Tracked) -> list[float]:
    """Return the middles of steps over which a mode's shape may continue two.

    Raises
    ------
    TableError
        If such a step is too short to be halved.
    """
    middles = []
    for i in np.flatnonzero((tracked.mac <= UNCLEAR).any(axis=1)):
        here, there = tracked.variables[i : i + 2].tolist()
        if there - here < sampler.shortest:
            modes = 1 + np.flatnonzero(tracked.mac[i] <= UNCLEAR)
            raise TableError(
                f"Mode {' and mode '.join(map(str, modes))} cannot be followed past alpha3 = "
                f"{math.degrees(sampler.angle(here)):.5f} deg: the shape there resembles none on "
                "the other side; keep fewer modes in response.modes, or end the stroke before."
            )
        middles.append((here + there) / 2.0)
    return middles
