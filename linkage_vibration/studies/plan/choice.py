# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds the cheapest settings that meet the tolerance of a scene, and measures them.

Elements and modes a link are tried from fixed lists. Each trial is compared with a finer one at a
few angles of the scene, which takes tens of small solves. The finest mesh's own error follows from
how quickly its last halvings converge. A table is built to what the model leaves of the tolerance.
The plan is then measured against an unreduced, finer model.
"""

import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.studies.plan.question import (
    PlanError,
    Result,
    Scene,
    check_scene,
    prediction_seconds,
    result_at,
    table_errors,
    worst_errors,
)
from linkage_vibration.studies.yaml_editing import edit_text
from linkage_vibration.support.atomic_files import write_text
from linkage_vibration.table.table import Table, TableError
from linkage_vibration.table.tabulation import build_table
from linkage_vibration.table.tabulation.accuracy import FRF_FLOOR, LOOSER

Pair = tuple[int, int]
"""Elements and modes a link."""

ELEMENTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
MODES = (0, 1, 2, 3, 5, 8, 12, 20, 40, 80)

_ANGLES = (0.5, 0.0, 1.0, 0.15, 0.85, 0.05, 0.95, 0.25, 0.75, 0.38, 0.62)  # of the range
_FIRST = 3  # of these angles, at which the reference is chosen
_CHECKED = 61  # angles at which tables are compared with their own model
_MANY_MODES = 20  # while meshes are compared; both lack the same modes, so the error cancels
_RESOLVED = 0.05  # error of the reference mesh, in units of the tolerance
_SETTLED = 0.02  # of the tolerance: if three steps of modes differ less, no more are tried
_TABLE_ROOM = 0.02  # least part of the tolerance that is left to a table's interpolation
_UNSURE = 0.005  # of the tolerance: a plan is predicted no better, and its measurement decides
_TRIES, _TIGHTER = 6, 3.0  # tolerances tried for a table, and the factor between them
_ABOVE = 1.02  # of the band: modes up to here may enter it between the angles tried

_MEASURED_AT = (0.003, 0.13, 0.31, 0.56, 0.8, 0.997)  # other angles, where a plan is measured
_PLANS, _AIMED = 4, 0.9  # plans that are measured, and the part of the tolerance that is aimed at
_COMPARED = 41  # angles at which a measured table is compared with its own model
_FINER = 6  # elements of the reference, in elements of the plan ...
_FINEST = 96  # ... up to this number a link; beyond it, twice the plan's

# Measured on linkages of four links and up to a hundred coordinates:
_ELEMENT_WORK = 14.0  # to build an element, in coordinates of one solve
_SOLVES = 30  # a table needs about as many, and so does a study of a range by solves


@dataclass(frozen=True, eq=False)
class Plan:
    """The cheapest settings that are predicted to meet a scene's tolerance."""

    scene: Scene
    elements: int  # of each link
    modes: int  # of each link
    n_modes: int  # natural frequencies that enter the band within the range; at least one
    table_tolerance: float | None  # for `build_table`; None if each prediction is solved
    predicted: FloatArray  # (3,), the errors
    reasons: tuple[tuple[str, str], ...]  # each choice and its reason, in words

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism with these elements and modes, and the scene's band and range."""
        return self.scene.with_settings(self.elements, self.modes, self.n_modes)


def plan(scene: Scene, solved: Callable[[], object] = lambda: None) -> Plan:
    """Choose the cheapest settings that meet a tolerance; `solved` is called after each solve.

    A `PlanError` is raised if the scene is invalid or no setting meets its tolerance, and a
    `KinematicsError` or a `ModelError` if the linkage cannot be solved there.
    """
    check_scene(scene)
    trials = _Trials(scene, solved)
    pair = _cheapest(trials, 1.0)
    solve = prediction_seconds(scene, trials.model(pair))
    limit = scene.seconds_per_prediction
    if scene.one_angle:
        why = "one angle is solved once"
    elif limit == math.inf:
        why = f"no time is asked for, and a table takes about {_SOLVES} solves to build"
    elif solve <= limit:
        why = f"a solve takes {1e3 * solve:.2g} ms of the {1e3 * limit:.2g} allowed"
    else:
        why = f"a solve takes {1e3 * solve:.2g} ms, more than the {1e3 * limit:.2g} allowed"
        return _plan_of_table(trials, why)
    reasons = (*_reasons(trials, pair), ("solved at each angle", why))
    return Plan(scene, *pair, trials.n_modes, None, trials.errors(pair), reasons)


class _Trials:
    """Models of a scene by their elements and modes a link, and the finest, which is the reference.

    Each is solved once at each angle.
    """

    def __init__(self, scene: Scene, solved: Callable[[], object]) -> None:
        self.scene, self.solved = scene, solved
        self.kinematics = Kinematics(scene.with_settings(1, 0, 1))
        self.angles = scene.angles_at(_ANGLES)
        self.model, self._result = cache(self._solvable), cache(self._solve)
        elements, self._mesh_error = self._finest_mesh()
        self.finest = elements, self._most_modes(elements)
        self._exact = [self._result(self.finest, alpha3) for alpha3 in self.angles]

    @property
    def n_modes(self) -> int:
        """Natural frequencies that enter the band within the range; at least one."""
        top = _ABOVE * self.scene.band[1]
        return max(1, *(int((result.frequencies < top).sum()) for result in self._exact))

    def errors(self, pair: Pair) -> FloatArray:
        """Return the predicted errors of a pair, (3,)."""
        results = [self._result(pair, alpha3) for alpha3 in self.angles]
        return worst_errors(results, self._exact) + self._mesh_error

    def meets(self, pair: Pair, share: float) -> bool:
        """Return whether a pair meets a share of the tolerance; stop at an angle where it fails."""
        each = (self._result(pair, exact.alpha3).errors(exact) for exact in self._exact)
        return all(self.scene.share(errors + self._mesh_error) <= share for errors in each)

    def _solvable(self, pair: Pair) -> LinkageModel:
        mechanism = self.scene.with_settings(*pair, 1)
        return LinkageModel(mechanism, kinematics=self.kinematics)

    def _solve(self, pair: Pair, alpha3: float) -> Result:
        result = result_at(self.scene, self.model(pair), alpha3)
        self.solved()
        return result

    def _apart(self, pair: Pair, finer: Pair) -> FloatArray:
        """Return the differences of two pairs at the first angles, (3,)."""
        results = [[self._result(p, at) for at in self.angles[:_FIRST]] for p in (pair, finer)]
        return worst_errors(*results)

    def _finest_mesh(self) -> tuple[int, FloatArray]:
        """Return the elements of the mesh that the tolerance needs, and its errors, (3,)."""
        for elements in ELEMENTS:
            if elements % 4 == 0 and elements // 4 in ELEMENTS:
                error = self._mesh_errors(elements)
                if self.scene.share(error) <= _RESOLVED:
                    return elements, error
        problem = f"No mesh up to {ELEMENTS[-1]} elements a link is fine enough for"
        raise _too_strict(self.scene, problem)

    def _mesh_errors(self, elements: int) -> FloatArray:
        """Return the errors of a mesh, (3,), from its last two halvings (Richardson's method).

        Each halving divides the error by 2^2 (extension, short elements) to 2^4 (bending).
        """
        fine = elements, _MANY_MODES
        quarter, half = (self._apart((elements // n, _MANY_MODES), fine) for n in (4, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.nan_to_num((quarter - half) / half, nan=4.0)
        return np.asarray(half / (np.clip(ratio, 4.0, 16.0) - 1.0))

    def _most_modes(self, elements: int) -> int:
        """Return the modes a link beyond which the results on a mesh hardly change."""
        for few, more, most in zip(MODES, MODES[1:], MODES[2:], strict=False):
            errors = [self._apart((elements, n), (elements, most)) for n in (few, more)]
            if self.scene.share(np.max(errors, axis=0)) <= _SETTLED:
                return most
        return MODES[-1]


def _cheapest(trials: _Trials, share: float) -> Pair:
    """Return the pair of the least work that meets a share of the tolerance."""
    scene, (most_elements, most_modes) = trials.scene, trials.finest
    solves = 1 if scene.one_angle else _SOLVES
    # Fewer modes never improve a mesh, so a mesh that fails with the most modes needs no trial.
    meshes = [n for n in ELEMENTS if n <= most_elements and trials.meets((n, most_modes), share)]
    pairs = itertools.product(meshes, [n for n in MODES if n <= most_modes])
    for pair in sorted(pairs, key=lambda pair: pair[0] * _ELEMENT_WORK + pair[1] * solves):
        if trials.meets(pair, share):
            return pair
    problem = f"No mesh up to {ELEMENTS[-1]} elements and no {MODES[-1]} modes a link meet"
    raise _too_strict(scene, problem)


def _plan_of_table(trials: _Trials, why: str) -> Plan:
    """Return the plan that looks predictions up in a table, for a reason."""
    scene = trials.scene
    pair = _cheapest(trials, 1.0 - _TABLE_ROOM)
    left = scene.allowed - trials.errors(pair)
    if scene.places and left[2] < FRF_FLOOR:
        hint = f"give a tolerance of {2.0 * FRF_FLOOR / LOOSER:g} or more, no points, or no time"
        raise PlanError(f"A table's FRFs are accurate to {FRF_FLOOR:g} at best; {hint}.")
    table, tolerance, added = _fitting_table(trials, pair, left)
    built = f"built to {tolerance:.2g}, so that model and table meet it together"
    choice = f"table of {len(table.alpha3)} points"
    reasons = (*_reasons(trials, pair), (choice, why), ("", built))
    return Plan(scene, *pair, trials.n_modes, tolerance, trials.errors(pair) + added, reasons)


def _fitting_table(
    trials: _Trials, pair: Pair, left: FloatArray
) -> tuple[Table, float, FloatArray]:
    """Build a model's table whose errors against that model are no larger than those left.

    It returns the table, the tolerance it was built to, and its errors, (3,). The tolerance is what
    is left, or less if the table proves worse between the points at which it measured itself.
    """
    scene, model = trials.scene, trials.model(pair)
    angles = scene.angles_at(np.arange(0.5, _CHECKED) / _CHECKED)
    exact = [result_at(scene, model, alpha3) for alpha3 in angles]
    limit = left + _UNSURE * scene.allowed
    rooms = [left[0], left[2] / LOOSER] if scene.places else [left[0]]
    tolerance, safe = float(max(rooms)), float(min(rooms))
    for _ in range(_TRIES):
        table = _table(trials, pair, tolerance)
        errors = table_errors(table, exact)
        if (errors <= limit).all():
            return table, tolerance, errors
        tighter = tolerance / _TIGHTER
        tolerance = max(safe, tighter) if tolerance > safe else tighter
    raise _too_strict(scene, "A solve takes longer than is allowed, and no table meets")


def _too_strict(scene: Scene, problem: str) -> PlanError:
    """Return the error that nothing meets the tolerance of a scene."""
    tolerance = f"a tolerance of {scene.tolerance:g} up to {scene.band[1]:g} Hz"
    return PlanError(f"{problem} {tolerance}; give a larger tolerance, or a lower band.")


def _table(trials: _Trials, pair: Pair, tolerance: float) -> Table:
    scene = trials.scene
    mechanism = scene.with_settings(*pair, trials.n_modes)
    model = LinkageModel(mechanism, kinematics=trials.kinematics)
    try:
        table = build_table(model, tolerance, scene.points, lambda _: trials.solved())
    except TableError as error:
        problem = "A solve takes longer than is allowed, and no table can be built"
        raise PlanError(f"{problem}: {error}") from None
    if scene.places and not table.places:
        problem = "A solve takes longer than is allowed, and no table of such a linkage holds FRFs"
        raise PlanError(f"{problem}; ask for no points, or for no time per prediction.")
    return table


def _reasons(trials: _Trials, pair: Pair) -> list[tuple[str, str]]:
    elements, modes = pair
    reasons = []
    for count, steps, name in ((elements, ELEMENTS, "elements"), (modes, MODES, "modes")):
        why = "the fewest"
        if count > steps[0]:
            fewer = steps[steps.index(count) - 1]
            other = (fewer, modes) if name == "elements" else (elements, fewer)
            why = f"with {fewer}: {trials.scene.share(trials.errors(other)):.2g} x the tolerance"
        reasons.append((f"{name} a link: {count}", why))
    return reasons


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The measured errors of a plan, and its times in seconds."""

    errors: FloatArray  # (3,), of the model, plus those of the table against it
    setup: float  # from the mechanism to the first prediction: kinematics, components, table
    prediction: float  # median for natural frequencies, damping ratios and the peak at an angle
    points: int  # angles in the table; 0 without a table


def plan_and_measure(
    scene: Scene, solved: Callable[[], object] = lambda: None
) -> tuple[Plan, Measured]:
    """Choose the cheapest settings whose measured errors meet a scene's tolerance.

    While the measured errors of a plan are too large, another one is made for a smaller tolerance.
    """
    share, why = 1.0, ""
    for _ in range(_PLANS):
        chosen = plan(replace(scene, tolerance=share * scene.tolerance), solved)
        measured = measure(chosen, solve_reference(chosen, solved))
        worst = scene.share(measured.errors)
        if worst <= 1.0:
            reasons = (*chosen.reasons, ("planned to a part of it", why)) if why else chosen.reasons
            return replace(chosen, scene=scene, reasons=reasons), measured
        share *= _AIMED / worst
        why = f"{share:.2g} x the tolerance, as a plan measured {worst:.3g} x the tolerance"
    raise _too_strict(scene, f"The last of {_PLANS} plans measured {worst:.2g} times")


def solve_reference(plan: Plan, solved: Callable[[], object] = lambda: None) -> list[Result]:
    """Solve an unreduced, finer model at angles other than those at which the plan was chosen.

    Its mesh is six times as fine, so its own error is at most a 36th of the plan's; above 96
    elements a link it is four times or twice as fine. Its matrices are dense: an angle of four
    links takes 0.25 s with 48 elements a link, 2 s with 96, and about 10 s with 192.
    """
    scene = plan.scene
    elements = max(2 * plan.elements, min(_FINER * plan.elements, _FINEST))
    mechanism = scene.with_settings(elements, 0, plan.n_modes)
    model = LinkageModel(mechanism, reduced=False)
    results = []
    for alpha3 in scene.angles_at(_MEASURED_AT):
        results.append(result_at(scene, model, alpha3))
        solved()
    return results


def measure(plan: Plan, against: Sequence[Result]) -> Measured:
    """Carry a plan out, and measure its errors against a reference, and its times."""
    scene, start = plan.scene, time.perf_counter()
    model = LinkageModel(plan.mechanism)
    source: LinkageModel | Table = model
    if plan.table_tolerance is not None:
        source = build_table(model, plan.table_tolerance, scene.points)
        source.interpolate(scene.angles[0])  # the first lookup also prepares the table
    setup = time.perf_counter() - start
    errors = worst_errors([result_at(scene, model, exact.alpha3) for exact in against], against)
    points = 0
    if isinstance(source, Table):
        angles = scene.angles_at(np.arange(0.5, _COMPARED) / _COMPARED)
        errors += table_errors(source, [result_at(scene, model, alpha3) for alpha3 in angles])
        points = len(source.alpha3)
    return Measured(errors, setup, prediction_seconds(scene, source), points)


def plan_report(plan: Plan, measured: Measured) -> str:
    """Return what was chosen and why, and what was predicted, measured and allowed."""
    scene = plan.scene
    low, high = (math.degrees(angle) for angle in scene.angles)
    where = f"{low:g} deg" if scene.one_angle else f"{low:g} to {high:g} deg"
    lines = [
        f"{scene.mechanism.name}: {scene.band[0]:g} to {scene.band[1]:g} Hz, {where}, "
        f"tolerance {scene.tolerance:g}",
        "",
        *(f"{choice:34}{reason}" for choice, reason in plan.reasons),
        "",
        f"{'relative error':26}{'predicted':>12}{'measured':>12}{'allowed':>12}",
    ]
    errors = zip(plan.predicted, measured.errors, scene.allowed, strict=True)
    names = ("natural frequencies", "highest peak", "worst FRF")
    rows = 3 if scene.places else 2
    for name, values in list(zip(names, errors, strict=True))[:rows]:
        lines.append(f"{name:26}" + "".join(f"{value:12.1e}" for value in values))
    limit = scene.seconds_per_prediction
    allowed = f"{1e3 * limit:12.4g}" if math.isfinite(limit) else ""
    lines += [
        "",
        f"{'time [ms]':26}{'measured':>12}{'allowed':>12}",
        f"{'set-up':26}{1e3 * measured.setup:12.4g}",
        f"{'a prediction':26}{1e3 * measured.prediction:12.4g}{allowed}",
    ]
    if measured.points:
        lines.append(f"{'points of the table':26}{measured.points:12}")
    return "\n".join(lines)


def write_planned(plan: Plan, text: str, path: Path) -> None:
    """Write the text of a mechanism's file with a plan's settings; its comments and its order stay.

    A `PlanError` is raised if an alias in it makes one number of two that differ in the plan.
    """
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
