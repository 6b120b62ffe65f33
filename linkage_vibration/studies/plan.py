# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Chooses the smallest model that is accurate enough.

Models with few to many elements and modes a link are tried in the order of their work, and compared
with the finest one at angles over the range. The first that meets the tolerance is the answer.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import kinematics_of
from linkage_vibration.mechanics.model import LinkageModel, Place
from linkage_vibration.mechanics.modes import MECHANISM
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.studies.yaml_editing import edit_text
from linkage_vibration.support.atomic_files import write_text
from linkage_vibration.table.tabulation.accuracy import LOOSER
from linkage_vibration.table.tabulation.frf_errors import frf_norms, worst_shares

ELEMENTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)
MODES = (0, 1, 2, 3, 5, 8, 12, 20, 40)
_FINEST = 192, 80  # elements and modes a link of the model with which all others are compared
_ANGLES = 13  # over the range, at which they are compared
_ABOVE = 1.02  # of the band: modes up to here may enter it between the angles
_MOST = 0.98  # of the tolerance: a table of the model needs the rest

# Measured on linkages of four links and up to a hundred coordinates:
_ELEMENT_WORK = 14.0  # to build an element, in coordinates of one solve
_SOLVES = 30  # of a study of a range; a table needs about as many


class PlanError(LinkageVibrationError):
    """A scene is invalid, or no setting meets its tolerance."""


@dataclass(frozen=True)
class Scene:
    """The results that are needed, and their tolerance.

    That is the relative error of natural frequencies in the band; the highest peak and each FRF (L2
    norm over the band) may have a hundred times as much. Errors of the three are (3,).
    """

    mechanism: Mechanism
    band: tuple[float, float]  # Hz
    places: tuple[Place, ...]  # FRFs are needed between all of these; without places, none are
    tolerance: float
    angles: tuple[float, float]  # the range of alpha3, rad; for a single angle, twice the same

    @property
    def one_angle(self) -> bool:
        """Whether the range is a single angle."""
        return self.angles[0] == self.angles[1]

    @property
    def allowed(self) -> FloatArray:
        """The errors that meet the tolerance, (3,)."""
        return self.tolerance * np.array([1.0, LOOSER, LOOSER])

    def share(self, errors: FloatArray) -> float:
        """Return the largest of errors, (3,), each divided by the allowed one."""
        return float((errors / self.allowed).max())

    def with_settings(self, elements: int, modes: int, n_modes: int) -> Mechanism:
        """Return the mechanism for the scene with elements and modes a link, and `n_modes`."""
        mechanism = self.mechanism
        links = [link.meshed(elements, modes) for link in mechanism.links]
        stroke = mechanism.stroke if self.one_angle else self.angles
        response = replace(mechanism.response.with_band(self.band), modes=n_modes)
        return replace(mechanism, links=tuple(links), stroke=stroke, response=response)


@dataclass(frozen=True, eq=False)
class Plan:
    """The cheapest settings that meet a scene's tolerance."""

    scene: Scene
    # With these elements and modes, the band and range of the scene, and as many natural
    # frequencies as enter the band within the range.
    mechanism: Mechanism
    elements: int  # of each link
    modes: int  # of each link
    errors: FloatArray  # (3,)
    reasons: tuple[tuple[str, str], ...]  # each choice and its reason, in words

    @property
    def table_tolerance(self) -> float:
        """What the model leaves of the tolerance, to build a table to."""
        return float((1.0 - self.scene.share(self.errors)) * self.scene.tolerance)


def plan(scene: Scene, solved: Callable[[], object] = lambda: None) -> Plan:
    """Choose the cheapest settings that meet a tolerance; `solved` is called after each solve."""
    _check(scene)
    trials = _Trials(scene, solved)
    elements, modes, errors = trials.cheapest()
    reasons = []
    for count, steps, name in ((elements, ELEMENTS, "elements"), (modes, MODES, "modes")):
        why = "the fewest"
        if count > steps[0]:
            fewer = steps[steps.index(count) - 1]
            other = (fewer, modes) if name == "elements" else (elements, fewer)
            why = f"with {fewer}: {scene.share(trials.errors(*other)):.2g} x the tolerance"
        reasons.append((f"{name} a link: {count}", why))
    mechanism = scene.with_settings(elements, modes, trials.n_modes)
    return Plan(scene, mechanism, elements, modes, errors, tuple(reasons))


def _check(scene: Scene) -> None:
    """Refuse an invalid scene by a PlanError."""
    low, high = scene.band
    if not 0.0 <= low < high < math.inf:
        hint = "give two frequencies that ascend from 0 or above"
        raise PlanError(f"The band from {low:g} to {high:g} Hz is invalid; {hint}.")
    if not 1e-9 <= scene.tolerance < 1.0:
        hint = "give a relative error from 1e-9 to 1"
        raise PlanError(f"The tolerance {scene.tolerance:g} is invalid; {hint}.")
    if not scene.angles[0] <= scene.angles[1]:
        raise PlanError("The range of angles does not ascend; give the smaller one first.")
    for link in scene.mechanism.links:
        if isinstance(link.body, Frfs):
            problem = "is given by FRFs, whose measurement sets the accuracy"
            raise PlanError(f"links.{link.name} {problem}; describe it as a beam or by matrices.")


class _Trials:
    """Models of a scene by their elements and modes a link, beside the finest one."""

    def __init__(self, scene: Scene, solved: Callable[[], object]) -> None:
        self.scene, self.solved = scene, solved
        self.kinematics = kinematics_of(scene.with_settings(1, 0, 1))
        angles = np.linspace(*scene.angles, 1 if scene.one_angle else _ANGLES).tolist()
        finest, top = self.model(*_FINEST), _ABOVE * scene.band[1]
        self.exact = {alpha3: self._answer(finest, alpha3) for alpha3 in angles}
        within = [int((each.frequencies < top).sum()) for each in self.exact.values()]
        self.n_modes = max(1, *within)

    def model(self, elements: int, modes: int) -> LinkageModel:
        """Return a model with these elements and modes a link."""
        mechanism = self.scene.with_settings(elements, modes, 1)
        return LinkageModel(mechanism, kinematics=self.kinematics)

    def cheapest(self) -> tuple[int, int, FloatArray]:
        """Return elements and modes of the least work that meet the tolerance, and their errors."""
        solves = 1 if self.scene.one_angle else _SOLVES
        pairs = product(ELEMENTS, MODES)
        for elements, modes in sorted(pairs, key=lambda p: p[0] * _ELEMENT_WORK + p[1] * solves):
            errors = self.errors(elements, modes, _MOST)
            if self.scene.share(errors) <= _MOST:
                return elements, modes, errors
        tolerance = f"a tolerance of {self.scene.tolerance:g} up to {self.scene.band[1]:g} Hz"
        problem = f"No {ELEMENTS[-1]} elements and {MODES[-1]} modes a link meet {tolerance}"
        raise PlanError(f"{problem}; give a larger tolerance, or a lower band.")

    def errors(self, elements: int, modes: int, enough: float = math.inf) -> FloatArray:
        """Return the largest errors of a model, (3,); no more are sought above a share `enough`.

        The finest model has errors, too, which fall at least with the square of both numbers.
        """
        closer = 1.0 - max(elements / _FINEST[0], modes / _FINEST[1]) ** 2
        model, worst = self.model(elements, modes), np.zeros(3)
        for alpha3, exact in self.exact.items():
            errors = _errors(self.scene, self._answer(model, alpha3), exact) / closer
            worst = np.maximum(worst, errors)
            if self.scene.share(worst) > enough:
                break
        return worst

    def _answer(self, model: LinkageModel, alpha3: float) -> "_Answer":
        solution, places = model.solve(alpha3), self.scene.places
        frequencies = solution.natural_frequencies
        frequencies = frequencies[frequencies >= MECHANISM / (2.0 * math.pi)]
        peak = solution.peak(model.mechanism.response.peak_band).magnitude
        frf = solution.frf(places, places) if places else None
        self.solved()
        return _Answer(frequencies, peak, frf)


@dataclass(frozen=True, slots=True, eq=False)
class _Answer:
    """What a model says about a scene at one angle."""

    frequencies: FloatArray  # Hz, ascending, without rigid-body modes
    peak: float  # m/N
    frf: PoleResidue | None  # None without places


def _errors(scene: Scene, answer: _Answer, exact: _Answer) -> FloatArray:
    """Return the relative errors of an answer, (3,), as `Scene` orders them."""
    low, high = scene.band
    within = exact.frequencies[exact.frequencies <= high]
    if len(answer.frequencies) < len(within):
        return np.full(3, math.inf)
    apart = np.abs(answer.frequencies[: len(within)] / within - 1.0)[within >= low]
    peak = abs(answer.peak / exact.peak - 1.0) if 0.0 < exact.peak < math.inf else 0.0
    frf = 0.0
    if answer.frf is not None and exact.frf is not None:
        with np.errstate(invalid="ignore"):  # inf / inf, of infinite FRFs
            off, size = frf_norms(answer.frf, exact.frf, scene.band)
        if not np.isfinite(size).all():
            problem = f"An FRF of {scene.mechanism.name} is infinite in the band"
            hint = "give its links damping, begin the band above 0 Hz, or ask for no points"
            raise PlanError(f"{problem}; {hint}.")
        frf = worst_shares(off, size)[0]
    return np.array([apart.max(initial=0.0), peak, frf])


def plan_report(plan: Plan) -> str:
    """Return what was chosen and why, with its errors beside those that are allowed."""
    scene = plan.scene
    low, high = (math.degrees(angle) for angle in scene.angles)
    where = f"{low:g} deg" if scene.one_angle else f"{low:g} to {high:g} deg"
    lines = [
        f"{scene.mechanism.name}: {scene.band[0]:g} to {scene.band[1]:g} Hz, {where}, "
        f"tolerance {scene.tolerance:g}",
        "",
        *(f"{choice:34}{reason}" for choice, reason in plan.reasons),
        "",
        f"{'':34}{'measured':>12}{'allowed':>12}",
    ]
    names = ["error of natural frequencies", "error of the highest peak"]
    names += ["error of the worst FRF"] * bool(scene.places)
    for name, error, allowed in zip(names, plan.errors, scene.allowed, strict=False):
        lines.append(f"{name:34}{error:12.1e}{allowed:12.1e}")
    return "\n".join(lines)


def write_planned(plan: Plan, text: str, path: Path) -> None:
    """Write the text of a mechanism's file with a plan's settings; its comments and order stay."""
    mechanism = plan.mechanism
    numbers: dict[tuple[str, ...], Sequence[float]] = {
        ("response", "band_hz"): mechanism.response.band,
        ("response", "modes"): [mechanism.response.modes],
    }
    if plan.scene.mechanism.response.peak_part is not None:
        numbers["response", "peak_band_hz"] = mechanism.response.peak_band
    for link in mechanism.links:
        numbers["links", link.name, "modes"] = [link.modes]
        if link.body.elements is not None:
            numbers["links", link.name, "elements"] = [link.body.elements]
    if not plan.scene.one_angle:
        numbers["input", "range_deg"] = [math.degrees(angle) for angle in mechanism.stroke]
    words = [(keys, list(map(repr, values))) for keys, values in numbers.items()]
    write_text(path, edit_text(text, words, PlanError), PlanError)
