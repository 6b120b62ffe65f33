# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The question that a plan answers, and the answers of a model or a table with their errors."""

import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel, Place
from linkage_vibration.mechanics.modes import MECHANISM
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation.accuracy import LOOSER
from linkage_vibration.table.tabulation.frf_errors import frf_lines, worst_frf_error

_SOLVES, _LOOKUPS = 25, 1000  # how many are timed; a lookup takes microseconds


class PlanError(LinkageVibrationError):
    """A scene is invalid, or no setting meets its tolerance."""


@dataclass(frozen=True)
class Scene:
    """The results that are needed, and their tolerance.

    A plan replaces the mechanism's elements, modes, band, number of natural frequencies and stroke.
    The tolerance is the relative error allowed for every natural frequency in the band. A hundred
    times as much is allowed for the highest peak's magnitude (at the mechanism's own drive point)
    and for each FRF (L2 norm over the band). The errors of these three are arrays, (3,).
    """

    mechanism: Mechanism
    band: tuple[float, float]  # Hz
    places: tuple[Place, ...]  # FRFs are needed between all of these; without places, none are
    tolerance: float
    angles: tuple[float, float]  # the range of alpha3, rad; for a single angle, twice the same
    seconds_per_prediction: float = math.inf  # for frequencies, damping ratios and the peak

    @property
    def one_angle(self) -> bool:
        """Whether the range is a single angle."""
        return self.angles[0] == self.angles[1]

    @property
    def peak_band(self) -> tuple[float, float]:
        """The band in which the highest peak is sought, Hz."""
        return self.mechanism.response.with_band(self.band).peak_band

    @property
    def points(self) -> list[str]:
        """The points of the places, each once."""
        return list(dict.fromkeys(point for point, _ in self.places))

    @property
    def allowed(self) -> FloatArray:
        """The errors that meet the tolerance, (3,)."""
        return self.tolerance * np.array([1.0, LOOSER, LOOSER])

    def share(self, errors: FloatArray) -> float:
        """Return the largest of errors, (3,), each divided by the allowed one."""
        return float((errors / self.allowed).max())

    def angles_at(self, fractions: ArrayLike) -> list[float]:
        """Return angles at fractions of the range, or the single angle."""
        low, high = self.angles
        if self.one_angle:
            return [low]
        return [float(angle) for angle in low + (high - low) * np.asarray(fractions)]

    def with_settings(self, elements: int, modes: int, n_modes: int) -> Mechanism:
        """Return the mechanism with other settings, and with the band and range of the scene.

        These are the elements of each beam, the fixed-interface modes of each link, and the number
        of natural frequencies that a prediction reports.
        """
        mechanism = self.mechanism
        links = [link.meshed(elements, modes) for link in mechanism.links]
        stroke = mechanism.stroke if self.one_angle else self.angles
        response = replace(mechanism.response.with_band(self.band), modes=n_modes)
        return replace(mechanism, links=tuple(links), stroke=stroke, response=response)


def check_scene(scene: Scene) -> None:
    """Refuse an invalid scene by a PlanError."""
    low, high = scene.band
    if not 0.0 <= low < high < math.inf:
        hint = "give two frequencies that ascend from 0 or above"
        raise PlanError(f"The band from {low:g} to {high:g} Hz is invalid; {hint}.")
    if not 1e-9 <= scene.tolerance < 1.0:
        hint = "give a relative error from 1e-9 to 1"
        raise PlanError(f"The tolerance {scene.tolerance:g} is invalid; {hint}.")
    if not 0.0 < scene.seconds_per_prediction <= math.inf:
        limit = f"{1e6 * scene.seconds_per_prediction:g} microseconds for a prediction"
        raise PlanError(f"The time limit of {limit} is invalid; give a positive number.")
    if not scene.angles[0] <= scene.angles[1]:
        raise PlanError("The range of angles does not ascend; give the smaller one first.")
    for link in scene.mechanism.links:
        if isinstance(link.body, Frfs):
            problem = "is given by FRFs, whose measurement sets the accuracy"
            raise PlanError(f"links.{link.name} {problem}; describe it as a beam or by matrices.")


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
            problem = f"An FRF of {self.scene.mechanism.name} is infinite in the band"
            hint = "give its links damping, begin the band above 0 Hz, or ask for no points"
            raise PlanError(f"{problem}; {hint}.")
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
    result_at(scene, source, scene.angles[0])  # the first lookup also prepares the table
    is_table, seconds = isinstance(source, Table), []
    angles = itertools.cycle(
        scene.angles_at(np.linspace(0.0, 1.0, _LOOKUPS)) if is_table else scene.angles_at([0.5])
    )
    for _ in range(_LOOKUPS if is_table else _SOLVES):
        start = time.perf_counter()
        if isinstance(source, Table):
            source.interpolate(next(angles))
        else:
            solution = source.solve(next(angles))
            _ = solution.damped, solution.peak(scene.peak_band)  # computed when they are asked for
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))
