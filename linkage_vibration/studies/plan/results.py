# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The results of a model or a table at one angle, their errors from a reference, and their cost."""

import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.modes import MECHANISM
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.studies.plan.scene import PlanError, Scene
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation.frf_errors import frf_lines, worst_frf_error

FRF_LINES = 2001  # frequencies over the band at which FRFs are timed
_LOOKUPS = 1000  # that are timed; one takes microseconds


@dataclass(frozen=True, eq=False)
class Result:
    """What a model or a table gives at one angle."""

    scene: Scene
    alpha3: float  # rad
    # Hz, ascending, without rigid-body modes; those of a table are NaN for overdamped modes.
    frequencies: FloatArray
    peak: float  # m/N
    frf: PoleResidue | None  # None without places

    @cached_property
    def _weighted_frf(self) -> tuple[FloatArray, FloatArray, ComplexArray]:
        """Lines in Hz, (n,), the weights of an L2 norm, (n, 1, 1), and the weighted FRFs there."""
        assert self.frf is not None
        lines, weights = frf_lines(self.frf, self.scene.band)
        frf = self.frf.frf(lines)
        if not np.isfinite(frf).all():
            raise PlanError(
                f"An FRF of {self.scene.mechanism.name} is infinite in the band, because a mode is "
                "undamped or free to move; give its links damping, begin the band above 0 Hz, or "
                "ask for no points."
            )
        return lines, weights, np.asarray(weights * frf)

    def errors(self, exact: "Result") -> FloatArray:
        """Return the relative errors from an exact result, (3,), as `Scene` orders them."""
        low, high = self.scene.band
        within = exact.frequencies[exact.frequencies <= high]
        oscillating = self.frequencies[np.isfinite(self.frequencies)]
        if len(self.frequencies) < len(within):
            return np.full(3, math.inf)
        if len(oscillating) < len(self.frequencies):  # the others are overdamped
            nearest = np.abs(np.subtract.outer(oscillating, exact.frequencies)).argmin(axis=1)
            low_enough = oscillating <= high
            oscillating, within = oscillating[low_enough], exact.frequencies[nearest][low_enough]
        apart = np.abs(oscillating[: len(within)] / within - 1.0)[within >= low]
        peak = abs(self.peak / exact.peak - 1.0) if 0.0 < exact.peak < math.inf else 0.0
        frf = 0.0
        if self.frf is not None:
            lines, weights, wanted = exact._weighted_frf
            frf = worst_frf_error(weights * self.frf.frf(lines), wanted)
        return np.array([apart.max(initial=0.0), peak, frf])


def result_at(scene: Scene, source: LinkageModel | Table, alpha3: float) -> Result:
    """Return what a scene asks for at an angle (rad), from a model or interpolated by a table."""
    places = scene.places
    if isinstance(source, Table):
        values, _, peak, _ = source.interpolate(alpha3)
        frf = source.frf(alpha3, places, places) if places else None
        return Result(scene, alpha3, np.sort(values[: source.n_modes]), peak, frf)
    solution = source.solve(alpha3)
    frequencies = solution.natural_frequencies
    frequencies = frequencies[frequencies >= MECHANISM / (2.0 * math.pi)]
    frf = solution.frf(places, places) if places else None
    return Result(scene, alpha3, frequencies, solution.peak(scene.peak_band).magnitude, frf)


def worst_errors(results: Sequence[Result], exact: Sequence[Result]) -> FloatArray:
    """Return the largest errors over all angles, (3,), as `Scene` orders them."""
    return np.asarray(np.max(list(map(Result.errors, results, exact)), axis=0))


def table_errors(table: Table, exact: Sequence[Result]) -> FloatArray:
    """Return the errors of a table against results of its model, (3,), as `Scene` orders them.

    The table's own estimate counts, too.
    """
    errors = worst_errors([result_at(e.scene, table, e.alpha3) for e in exact], exact)
    frf_error = table.frf_error if exact[0].scene.places else 0.0
    return np.maximum(errors, [table.interpolation_error.max(), table.peak_error, frf_error])


def prediction_seconds(scene: Scene, source: LinkageModel | Table) -> float:
    """Return the median time of natural frequencies, damping ratios and the peak at an angle."""
    if isinstance(source, Table):
        angles = itertools.cycle(np.linspace(*scene.angles, _LOOKUPS).tolist())
        source.interpolate(scene.angles[0])  # the first lookup also prepares the table
        return _median(lambda: source.interpolate(next(angles)), _LOOKUPS)
    middle = scene.angles_at([0.5])[0]
    return _median(lambda: _predict(scene, source, middle))


def frf_seconds(scene: Scene, source: LinkageModel | Table) -> float:
    """Return the median time of all FRFs at one angle, at `FRF_LINES` frequencies."""
    places, alpha3 = scene.places, scene.angles_at([0.5])[0]
    if not places:
        return 0.0
    lines = np.linspace(*scene.band, FRF_LINES)
    if isinstance(source, Table):
        return _median(lambda: source.frf(alpha3, places, places).frf(lines))
    solution = source.solve(alpha3)
    return _median(lambda: solution.frf(places, places).frf(lines))


def _predict(scene: Scene, model: LinkageModel, alpha3: float) -> None:
    solution = model.solve(alpha3)
    _ = solution.damped, solution.peak(scene.peak_band)  # both are computed when they are asked for


def _median(run: Callable[[], object], times: int = 25) -> float:
    """Return the median time of a call, s."""
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))
