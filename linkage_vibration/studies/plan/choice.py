# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds the cheapest settings that meet the tolerance of a scene.

Elements a link, modes a link and terms of an FRF are tried from fixed lists. Each trial is compared
with a finer one at a few angles of the scene, which takes tens of small solves. The finest
mesh's own error follows from how quickly its last halvings converge. A table is built to what the
model leaves of the tolerance.
"""

import itertools
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import cache
from typing import Literal

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import N_FAR, in_reach
from linkage_vibration.studies.plan.results import (
    Costs,
    Residual,
    Result,
    measure_costs,
    result_at,
    table_errors,
    worst_errors,
)
from linkage_vibration.studies.plan.scene import Errors, PlanError, Scene, check_scene
from linkage_vibration.table.table import Table, TableError
from linkage_vibration.table.tabulation import build_table
from linkage_vibration.table.tabulation.accuracy import FRF_FLOOR, LOOSER

Pair = tuple[int, int]
"""Elements and modes a link."""

ELEMENTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
MODES = (0, 1, 2, 3, 5, 8, 12, 20, 40, 80)

_ANGLES = (0.5, 0.0, 1.0, 0.15, 0.85, 0.05, 0.95, 0.25, 0.75, 0.38, 0.62)  # of the range
_FIRST = 3  # of these angles, at which the reference is chosen
_CHECKED = 61  # angles at which FRFs and tables are compared with their own model
_MANY_MODES = 20  # while meshes are compared; both lack the same modes, so the error cancels
_RESOLVED = 0.05  # error of the reference mesh, in units of the tolerance
_SETTLED = 0.02  # of the tolerance: if three steps of modes differ less, no more are tried
_TABLE_ROOM = 0.02  # least part of the tolerance that is left to a table's interpolation
_UNSURE = 0.005  # of the tolerance: a plan is predicted no better, and its measurement decides
_TRIES, _TIGHTER = 6, 3.0  # tolerances tried for a table, and the factor between them
_ABOVE = 1.02  # of the band: modes up to here may enter it between the angles tried

# Measured on linkages of four links and up to a hundred coordinates:
_ELEMENT_WORK = 14.0  # to build an element, in coordinates of one solve
_SOLVES = 30  # a table needs about as many, and so does a study of a range by solves
_FAR_WORK = 16  # to fit far poles, in poles of an FRF


@dataclass(frozen=True)
class Plan:
    """The cheapest settings that are predicted to meet a scene's tolerance."""

    scene: Scene
    elements: int  # of each link
    modes: int  # of each link
    n_modes: int  # natural frequencies that enter the band within the range; at least one
    residual: Residual  # how FRFs represent the modes above the band
    table_tolerance: float | None  # for `build_table`; None if each prediction is solved
    points: int  # angles in the table; 0 without a table
    predicted: Errors
    cost: Costs  # predicted
    reasons: tuple[tuple[str, str], ...]  # each choice and its reason, in words

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism with these elements and modes, and the scene's band and range."""
        return self.scene.with_settings(self.elements, self.modes, self.n_modes)

    @property
    def method(self) -> Literal["table", "exact"]:
        """How a prediction is made."""
        return "exact" if self.table_tolerance is None else "table"


def plan(scene: Scene, solved: Callable[[], object] = lambda: None) -> Plan:
    """Choose the cheapest settings that meet a tolerance; `solved` is called after each solve.

    A `PlanError` is raised if the scene is invalid or no setting meets its tolerance, and a
    `KinematicsError` or a `ModelError` if the linkage cannot be solved there.
    """
    check_scene(scene)
    trials = _Trials(scene, solved)
    best = _reference(trials)
    pair = _cheapest(best, 1.0)
    solve = measure_costs(scene, trials.model(pair), "none", 0.0).prediction
    limit = scene.seconds_per_prediction
    if scene.one_angle:
        why = "one angle is solved once"
    elif limit is None:
        why = f"no time is asked for, and a table takes about {_SOLVES} solves to build"
    elif solve <= limit:
        why = f"a solve takes {1e3 * solve:.2g} ms of the {1e3 * limit:.2g} allowed"
    elif scene.spatial:
        why = "tables contain nothing along y"
    else:
        return _plan_of_table(best, solve, limit)
    return _plan_of_solves(best, pair, why)


class _Trials:
    """Models of a scene by their elements and modes a link; each is solved once at each angle."""

    def __init__(self, scene: Scene, solved: Callable[[], object]) -> None:
        self.scene = scene
        self.solved = solved
        start = time.perf_counter()
        self.kinematics = Kinematics(scene.with_settings(1, 0, 1))
        self.kinematics_seconds = time.perf_counter() - start
        self.angles = scene.angles_at(_ANGLES)
        self.timed_model, self.result = cache(self._timed_model), cache(self._result)

    def model(self, pair: Pair) -> LinkageModel:
        return self.timed_model(pair)[0]

    def _timed_model(self, pair: Pair) -> tuple[LinkageModel, float]:
        """Return a model and the time that its components took, s."""
        scene, start = self.scene, time.perf_counter()
        mechanism = scene.with_settings(*pair, 1)
        model = LinkageModel(mechanism, spatial=scene.spatial, kinematics=self.kinematics)
        return model, time.perf_counter() - start

    def _result(self, pair: Pair, alpha3: float) -> Result:
        result = result_at(self.scene, self.model(pair), alpha3)
        self.solved()
        return result

    def results(self, pair: Pair, count: int | None = None) -> list[Result]:
        return [self.result(pair, alpha3) for alpha3 in self.angles[:count]]

    def errors(self, pair: Pair, exact: list[Result]) -> FloatArray:
        return worst_errors([self.result(pair, result.alpha3) for result in exact], exact)

    def share(self, errors: FloatArray) -> float:
        """Return the largest of three errors, each divided by the allowed one."""
        return float((errors / astuple(self.scene.allowed)).max())


@dataclass(frozen=True, slots=True, eq=False)
class _Reference:
    """The finest model of some trials, which the others are compared with."""

    trials: _Trials
    elements: int
    modes: int
    mesh_error: FloatArray  # (3,), of its mesh
    results: list[Result]  # one for each angle

    @property
    def n_modes(self) -> int:
        """Natural frequencies that enter the band within the range; at least one."""
        top = _ABOVE * self.trials.scene.band[1]
        return max(1, *(int((result.frequencies < top).sum()) for result in self.results))

    def errors(self, pair: Pair) -> FloatArray:
        """Return the predicted errors of a pair, (3,)."""
        return self.trials.errors(pair, self.results) + self.mesh_error

    def meets(self, pair: Pair, share: float) -> bool:
        """Return whether a pair meets a share of the tolerance; stop at an angle where it fails."""
        return all(
            self.trials.share(self.trials.errors(pair, [result]) + self.mesh_error) <= share
            for result in self.results
        )


def _reference(trials: _Trials) -> _Reference:
    """Choose the finest mesh and the most modes that are needed for the tolerance."""
    for elements in ELEMENTS:
        if elements % 4 == 0 and elements // 4 in ELEMENTS:
            error = _mesh_error(trials, elements)
            if trials.share(error) <= _RESOLVED:
                modes = _most_modes(trials, elements)
                return _Reference(trials, elements, modes, error, trials.results((elements, modes)))
    raise PlanError(
        f"No mesh up to {ELEMENTS[-1]} elements a link is fine enough for a tolerance of "
        f"{trials.scene.tolerance:g} up to {trials.scene.band[1]:g} Hz; give a larger one."
    )


def _mesh_error(trials: _Trials, elements: int) -> FloatArray:
    """Return the errors of a mesh, (3,), from its last two halvings (Richardson's extrapolation).

    Each halving divides the error by 2^2 (extension, short elements) to 2^4 (bending).
    """
    exact = trials.results((elements, _MANY_MODES), _FIRST)
    quarter, half = (trials.errors((elements // n, _MANY_MODES), exact) for n in (4, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num((quarter - half) / half, nan=4.0)
    return np.asarray(half / (np.clip(ratio, 4.0, 16.0) - 1.0))


def _most_modes(trials: _Trials, elements: int) -> int:
    """Return the modes a link beyond which the results on a mesh hardly change."""
    for few, more, most in zip(MODES, MODES[1:], MODES[2:], strict=False):
        exact = trials.results((elements, most), _FIRST)
        errors = [trials.errors((elements, modes), exact) for modes in (few, more)]
        if trials.share(np.max(errors, axis=0)) <= _SETTLED:
            return most
    return MODES[-1]


def _cheapest(best: _Reference, share: float) -> Pair:
    """Return the pair of the least work that meets a share of the tolerance."""
    scene, meshes = best.trials.scene, [n for n in ELEMENTS if n <= best.elements]
    solves = 1 if scene.one_angle else _SOLVES
    # Fewer modes never improve a mesh, so a mesh that fails with the most modes needs no trial.
    meshes = [n for n in meshes if best.meets((n, best.modes), share)]
    pairs = itertools.product(meshes, [n for n in MODES if n <= best.modes])
    for pair in sorted(pairs, key=lambda pair: pair[0] * _ELEMENT_WORK + pair[1] * solves):
        if best.meets(pair, share):
            return pair
    raise PlanError(
        f"No mesh up to {ELEMENTS[-1]} elements and no {MODES[-1]} modes a link meet a tolerance "
        f"of {scene.tolerance:g} up to {scene.band[1]:g} Hz; give a larger one, or a lower band."
    )


def _plan_of_solves(best: _Reference, pair: Pair, why: str) -> Plan:
    scene, trials = best.trials.scene, best.trials
    residual, error, frf_reasons = _fewest_terms(best, pair)
    errors = Errors(*(best.errors(pair) + np.array([0.0, 0.0, error])).tolist())
    setup = trials.kinematics_seconds + trials.timed_model(pair)[1]
    costs = measure_costs(scene, trials.model(pair), residual, setup)
    reasons = (*_reasons(best, pair), *frf_reasons, ("solved at each angle", why))
    return Plan(scene, *pair, best.n_modes, residual, None, 0, errors, costs, reasons)


def _plan_of_table(best: _Reference, solve: float, limit: float) -> Plan:
    """Return the plan that looks predictions up in a table.

    ``solve`` is the time of a prediction by a solve and ``limit`` the time allowed for one, s.
    """
    scene = best.trials.scene
    pair = _cheapest(best, 1.0 - _TABLE_ROOM)
    left = np.array(astuple(scene.allowed)) - best.errors(pair)
    if scene.places and left[2] < FRF_FLOOR:
        raise PlanError(
            f"A table's FRFs are accurate to {FRF_FLOOR:g} at best; give a tolerance of "
            f"{2.0 * FRF_FLOOR / LOOSER:g} or more, no points, or no time per prediction."
        )
    table, tolerance, own, build = _fitting_table(best, pair, left)
    costs = measure_costs(scene, table, "far poles", best.trials.kinematics_seconds + build)
    points = len(table.alpha3)
    quick = "" if costs.prediction <= limit else "; nothing is quicker than a table"
    why = f"a solve takes {1e3 * solve:.2g} ms, more than the {1e3 * limit:.2g} allowed{quick}"
    built = f"built to {tolerance:.2g}, so that model and table meet it together"
    reasons = (*_reasons(best, pair), (f"table of {points} points", why), ("", built))
    errors = Errors(*(best.errors(pair) + own).tolist())
    return Plan(scene, *pair, best.n_modes, "far poles", tolerance, points, errors, costs, reasons)


def _fitting_table(
    best: _Reference, pair: Pair, left: FloatArray
) -> tuple[Table, float, FloatArray, float]:
    """Build a model's table whose errors against that model are no larger than those left.

    It returns the table, the tolerance it was built to, its errors (3,), and the time that the
    model and the table took. The tolerance is what is left, or less if the table proves worse
    between the points at which it measured itself.
    """
    scene = best.trials.scene
    model = best.trials.model(pair)
    exact = [result_at(scene, model, alpha3) for alpha3 in scene.spread(_CHECKED)]
    limit = left + _UNSURE * np.array(astuple(scene.allowed))
    rooms = [left[0], left[2] / LOOSER] if scene.places else [left[0]]
    tolerance, safe = float(max(rooms)), float(min(rooms))
    for _ in range(_TRIES):
        start = time.perf_counter()
        table = _table(best, pair, tolerance)
        seconds = time.perf_counter() - start
        errors = table_errors(table, exact)
        if (errors <= limit).all():
            return table, tolerance, errors, seconds
        tighter = tolerance / _TIGHTER
        tolerance = max(safe, tighter) if tolerance > safe else tighter
    raise PlanError(
        f"A solve takes longer than is allowed, and no table follows {scene.mechanism.name} to "
        f"a tolerance of {scene.tolerance:g} between its points; give a larger one."
    )


def _table(best: _Reference, pair: Pair, tolerance: float) -> Table:
    scene, trials = best.trials.scene, best.trials
    mechanism = scene.with_settings(*pair, best.n_modes)
    model = LinkageModel(mechanism, kinematics=trials.kinematics)
    try:
        table = build_table(model, tolerance, scene.points, lambda _: trials.solved())
    except TableError as error:
        raise PlanError(
            f"A solve takes longer than is allowed, and no table can be built: {error}"
        ) from None
    if scene.places and not table.places:
        raise PlanError(
            "A solve takes longer than is allowed, and no table of such a linkage holds FRFs; ask "
            "for no points, or for no time per prediction."
        )
    return table


def _fewest_terms(best: _Reference, pair: Pair) -> tuple[Residual, float, list[tuple[str, str]]]:
    """Return the fewest terms of the FRFs that meet the tolerance, their error, and the reasons.

    They are compared with all terms of the same model, at more angles than the other settings: an
    FRF may nearly vanish at an angle, and then depends most on the terms that are left out.
    """
    scene = best.trials.scene
    if not scene.places:
        return "none", 0.0, []
    model = best.trials.model(pair)
    results = [result_at(scene, model, alpha3) for alpha3 in scene.spread(_CHECKED)]
    every = [result.frf.stiffness for result in results if result.frf is not None]
    near = max(int(in_reach(stiffness, scene.band).sum()) for stiffness in every)
    total = len(every[0])
    reduction = float(best.errors(pair)[2])
    steps: list[tuple[int, Residual, str]] = [
        (near, "none", "near modes alone"),
        (near + 1, "static", "near modes, static residual"),
        (near + N_FAR + _FAR_WORK, "far poles", "near modes, far poles"),
        (total, "every mode", "every mode"),
    ]
    why = f"{near} of {total} modes are near the band"
    for _, residual, choice in sorted(steps):
        short = [result.shortened(residual) for result in results]
        error = float(worst_errors(short, results)[2])
        if reduction + error <= scene.allowed.frf or residual == "every mode":
            break
        why = f"{choice}: {(reduction + error) / scene.allowed.frf:.2g} x the tolerance"
    return residual, error, [(f"FRFs: {choice}", why)]


def _reasons(best: _Reference, pair: Pair) -> list[tuple[str, str]]:
    elements, modes = pair
    y = [point for point, direction in best.trials.scene.places if direction == "y"]
    reasons = [("planar", "nothing out of the plane is asked for")]
    if y:
        reasons = [("spatial", f"{y[0]} y is out of the plane")]
    for count, steps, name in ((elements, ELEMENTS, "elements"), (modes, MODES, "modes")):
        why = "the fewest"
        if count > steps[0]:
            fewer = steps[steps.index(count) - 1]
            other = (fewer, modes) if name == "elements" else (elements, fewer)
            why = f"with {fewer}: {best.trials.share(best.errors(other)):.2g} x the tolerance"
        reasons.append((f"{name} a link: {count}", why))
    return reasons
