# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Chooses the cheapest model that meets a tolerance: what a scene does not ask for is left out.

Settings stand on ladders: elements a link, modes a link, terms of an FRF. Each step tried is held
against a finer one at a few angles of the scene, which takes some tens of small solves; the finest
mesh's own error follows from how quickly its last halvings converge. A table is built to what the
model leaves of the tolerance. `measure` then holds the choice against an unreduced, finer model, at
other angles.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from numpy.typing import NDArray

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import Beam, Frfs, Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import LinkageModel, Place, Solution
from linkage_vibration.mechanics.response import N_FAR, PoleResidue, far_poles, in_reach
from linkage_vibration.support.atomic_files import write_text
from linkage_vibration.table.table import Table, TableError
from linkage_vibration.table.tabulation import build_table
from linkage_vibration.table.tabulation.accuracy import FRF_FLOOR, LOOSER
from linkage_vibration.table.tabulation.verification import frf_lines, worst_frf_error

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

Pair = tuple[int, int]
"""Elements and modes a link."""

Residual = Literal["none", "static", "far poles", "every mode"]
"""What an FRF holds of the modes above the band."""

FRF_LINES = 2001
"""Frequencies at which the cost of FRFs is told: 0 to 200 Hz by 0.1 Hz."""

ELEMENTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
MODES = (0, 1, 2, 3, 5, 8, 12, 20, 40, 80)

_FIRST = 3  # of the angles, at which the models that others are held against are chosen
_MANY_MODES = 20  # while meshes are compared: what both leave out cancels
# Of the range: where settings are chosen, and where the choice is measured.
_CHOOSING = (0.5, 0.0, 1.0, 0.15, 0.85, 0.05, 0.95, 0.25, 0.75, 0.38, 0.62)
_MEASURING = (0.003, 0.13, 0.31, 0.56, 0.8, 0.997)
_CHOSEN, _MEASURED = 61, 41  # angles at which FRFs and tables are held against their own model
_RESOLVED = 0.05  # of the tolerance: what the mesh that others are held against may be off
_SETTLED = 0.02  # of the tolerance: three steps of modes that agree so well tell the limit
_TABLE_ROOM = 0.02  # of the tolerance: the least that is left to a table's interpolation
_TRIES, _TIGHTER = 6, 3.0  # tolerances of a table, and how they go down where one is missed
_ABOVE = 1.02  # of the band: modes up to here may come into it between the angles looked at

# Measured on linkages of four links and up to a hundred coordinates:
_ELEMENT_WORK = 14.0  # to build a link's element, in coordinates of one solve
_SOLVES = 30  # a table's; and who looks at a range exactly hardly wants fewer
_FAR_WORK = 16  # to fit far poles, in poles of an FRF
_REFERENCE = 6  # times as fine a mesh, to measure against ...
_REFERENCE_MOST = 96  # ... up to here, beyond which it is twice as fine


class PlanError(LinkageVibrationError):
    """A scene is not sound, or no setting meets its tolerance."""


@dataclass(frozen=True)
class Scene:
    """What is asked for.

    Attributes
    ----------
    mechanism : Mechanism
        Its elements, modes, band and number of modes are what a plan replaces.
    band : tuple of float
        Hz.
    places : tuple of (point, direction)
        FRFs are wanted between all of these; none are where it is empty.
    tolerance : float
        Relative, of every natural frequency in the band; a hundred times that of the highest peak's
        magnitude (of the mechanism's own drive point) and of each FRF (L2 norm over the band).
    angles : tuple of float
        The range of alpha3, rad; twice the same for one angle.
    seconds_per_prediction : float, optional
        How quickly natural frequencies, damping ratios and the peak have to come.
    """

    mechanism: Mechanism
    band: tuple[float, float]
    places: tuple[Place, ...]
    tolerance: float
    angles: tuple[float, float]
    seconds_per_prediction: float | None = None

    @property
    def one_angle(self) -> bool:
        """Whether the range is a single angle."""
        return self.angles[0] == self.angles[1]

    @property
    def spatial(self) -> bool:
        """Whether something out of the plane of motion is asked for."""
        return any(direction == "y" for _, direction in self.places)

    @property
    def allowed(self) -> "Errors":
        """The errors that meet the tolerance."""
        return Errors(self.tolerance, LOOSER * self.tolerance, LOOSER * self.tolerance)


@dataclass(frozen=True, slots=True)
class Errors:
    """Relative errors, the worst in the scene.

    Attributes
    ----------
    frequency : float
        Of the natural frequencies in the band.
    peak : float
        Of the highest peak's magnitude.
    frf : float
        Of the FRFs between the places, L2 norm over the band; 0 where none are asked for.
    """

    frequency: float
    peak: float
    frf: float

    def share(self, allowed: "Errors") -> float:
        """Return the largest of them, in units of what is allowed."""
        return float((np.array(astuple(self)) / astuple(allowed)).max())


@dataclass(frozen=True, slots=True)
class Costs:
    """Seconds.

    Attributes
    ----------
    setup : float
        From the mechanism to the first prediction: kinematics, components, and the table.
    prediction : float
        Natural frequencies, damping ratios and the peak at one angle.
    frfs : float
        The FRFs between all places at one angle more, at `FRF_LINES` frequencies; 0 without places.
    """

    setup: float
    prediction: float
    frfs: float


@dataclass(frozen=True)
class Plan:
    """The cheapest settings that are predicted to meet a scene's tolerance.

    Attributes
    ----------
    scene : Scene
        What they serve.
    elements, modes : int
        A link.
    n_modes : int
        Natural frequencies that come into the band within the range, one at least.
    residual : str
        What FRFs hold of the modes above the band.
    table_tolerance : float or None
        What `build_table` is to be told; None where each prediction is solved.
    points : int
        Angles in the table; 0 without one.
    predicted : Errors
    cost : Costs
        Predicted.
    reasons : tuple of (choice, why)
        In words.
    """

    scene: Scene
    elements: int
    modes: int
    n_modes: int
    residual: Residual
    table_tolerance: float | None
    points: int
    predicted: Errors
    cost: Costs
    reasons: tuple[tuple[str, str], ...]

    @property
    def spatial(self) -> bool:
        """Whether the links move out of the plane too."""
        return self.scene.spatial

    @property
    def method(self) -> Literal["table", "exact"]:
        """How a prediction is made."""
        return "exact" if self.table_tolerance is None else "table"


@dataclass(frozen=True, slots=True)
class Measured:
    """What a plan turned out to be.

    Attributes
    ----------
    errors : Errors
        Of the model against an unreduced, finer one; a table's against its model are added.
    costs : Costs
        Medians.
    points : int
        Angles in the table; 0 without one.
    """

    errors: Errors
    costs: Costs
    points: int


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What a model that others are held against tells at one angle.

    Attributes
    ----------
    alpha3 : float
        rad.
    frequencies : ndarray, (n,)
        Hz, ascending up to the band's top.
    below : int
        How many of them lie below the band.
    peak : float
        m/N.
    lines : ndarray, (n_lines,)
        Hz, at which FRFs are compared.
    weights : ndarray, (n_lines, 1, 1)
        Whose squares integrate over the band.
    frf : complex ndarray, (n_lines, n_places, n_places)
        m/N, times the weights.
    """

    alpha3: float
    frequencies: FloatArray
    below: int
    peak: float
    lines: FloatArray
    weights: FloatArray
    frf: ComplexArray


@dataclass(frozen=True, slots=True, eq=False)
class _Told:
    """What a candidate tells at one angle."""

    alpha3: float
    frequencies: FloatArray  # Hz, ascending; those of mechanisms left out
    peak: float
    frf: PoleResidue | None  # None where there are no places


def plan(scene: Scene, solved: Callable[[], object] = lambda: None) -> Plan:
    """Choose the cheapest settings that meet a scene's tolerance.

    Parameters
    ----------
    scene : Scene
        What is asked for.
    solved : callable
        Called after each solve, for a progress bar.

    Raises
    ------
    PlanError
        If the scene is not sound, or no setting meets its tolerance.
    KinematicsError, ModelError
        If the linkage cannot be solved there.
    """
    _check(scene)
    return _Planner(scene, solved).choose()


def planned_mechanism(plan: Plan) -> Mechanism:
    """Return the mechanism with a plan's settings.

    These are elements (of beams) and modes a link, the response's band and number of modes, and
    the stroke where the scene has a range.
    """
    return _with_settings(plan.scene, plan.elements, plan.modes, plan.n_modes)


def planned_frf(plan: Plan, solution: Solution) -> PoleResidue:
    """Return the FRFs between the scene's places with no more terms than the plan asks for."""
    return _frf(plan.scene, solution, plan.residual)


def truths(plan: Plan, solved: Callable[[], object] = lambda: None) -> list[Truth]:
    """Solve an unreduced, finer model at angles that the plan was not chosen at.

    Its mesh is six times as fine, so that its own error is a 36th of the plan's at most; where that
    is above 96 elements a link, four times or twice. It is solved with dense matrices: a quarter of
    a second an angle with 48 elements a link on four links, two with 96, some ten with 192.

    Parameters
    ----------
    plan : Plan
        What is to be measured.
    solved : callable
        Called after each angle, for a progress bar.
    """
    elements = max(2 * plan.elements, min(_REFERENCE * plan.elements, _REFERENCE_MOST))
    mechanism = _with_settings(plan.scene, elements, 0, plan.n_modes)
    model = LinkageModel(mechanism, spatial=plan.spatial, reduced=False)
    found = []
    for alpha3 in _angles(plan.scene, _MEASURING):
        found.append(_truth(plan.scene, _tell(plan.scene, model, alpha3)))
        solved()
    return found


def measure(plan: Plan, against: Sequence[Truth]) -> Measured:
    """Carry a plan out, and measure its errors and its cost.

    Parameters
    ----------
    plan : Plan
        What to carry out.
    against : sequence of Truth
        As `truths` finds them.

    Raises
    ------
    TableError
        If the table cannot be built.
    """
    scene = plan.scene
    setups, table = [], None
    for _ in range(3):
        start = time.perf_counter()
        model = LinkageModel(planned_mechanism(plan), spatial=plan.spatial)
        if plan.table_tolerance is not None:
            table = build_table(model, plan.table_tolerance, _points(scene))
            table.interpolate(scene.angles[0])  # makes what the table makes at first use
        setups.append(time.perf_counter() - start)
    models = [_errors(truth, _tell(scene, model, truth.alpha3)) for truth in against]
    told = [_tell(scene, model, alpha3) for alpha3 in _spread(scene, _MEASURED)]
    goals = [_truth(scene, t) for t in told]
    if table is not None:
        own = _table_errors(scene, table, goals)
        prediction, frfs = _lookup_costs(scene, table)
    else:
        short = [_condensed(scene, t, plan.residual) for t in told]
        own = np.max(list(map(_errors, goals, short)), axis=0)
        solution = model.solve(scene.angles[0])
        prediction = _median(lambda: _tell_modes(scene, model, scene.angles[0]))
        frfs = _frf_seconds(scene, lambda: planned_frf(plan, solution))
    return Measured(
        Errors(*(np.max(models, axis=0) + own).tolist()),
        Costs(float(np.median(setups)), prediction, frfs),
        0 if table is None else len(table.alpha3),
    )


def summary(plan: Plan, measured: Measured) -> str:
    """Tell in words what was chosen, why, and what was predicted and measured."""
    scene = plan.scene
    low, high = (math.degrees(angle) for angle in scene.angles)
    where = f"{low:g} deg" if scene.one_angle else f"{low:g} to {high:g} deg"
    lines = [
        f"{scene.mechanism.name}: {scene.band[0]:g} to {scene.band[1]:g} Hz, {where}, "
        f"tolerance {scene.tolerance:g}",
        "",
        *(f"{choice:34}{why}" for choice, why in plan.reasons),
        "",
        f"{'relative error':26}{'predicted':>12}{'measured':>12}{'allowed':>12}",
    ]
    rows = zip(
        ("natural frequencies", "highest peak", "worst FRF"),
        astuple(plan.predicted),
        astuple(measured.errors),
        astuple(scene.allowed),
        strict=True,
    )
    for name, *values in list(rows)[: 3 if scene.places else 2]:
        lines.append(f"{name:26}" + "".join(f"{value:12.1e}" for value in values))
    lines += ["", f"{'time [ms]':26}{'predicted':>12}{'measured':>12}{'allowed':>12}"]
    limit = scene.seconds_per_prediction
    for name, *seconds in (
        ("set-up", plan.cost.setup, measured.costs.setup),
        ("a prediction", plan.cost.prediction, measured.costs.prediction),
        (f"FRFs, {FRF_LINES} lines", plan.cost.frfs, measured.costs.frfs),
    )[: 3 if scene.places else 2]:
        told = "".join(f"{1e3 * value:12.4g}" for value in seconds)
        asked = f"{1e3 * limit:12.4g}" if limit is not None and name == "a prediction" else ""
        lines.append(f"{name:26}{told}{asked}")
    if plan.method == "table":
        lines.append(f"{'points of the table':26}{plan.points:12}{measured.points:12}")
    return "\n".join(lines)


def write_planned(plan: Plan, text: str, path: Path) -> None:
    """Write a mechanism's file with a plan's settings; its comments and its order stay.

    Parameters
    ----------
    plan : Plan
        What to write.
    text : str
        The file that the mechanism was read from.
    path : Path
        File to write.

    Raises
    ------
    PlanError
        If an alias in the file ties together what the plan sets apart, or it cannot be written.
    """
    mechanism = planned_mechanism(plan)
    low, high = mechanism.response.band
    values: dict[tuple[str, ...], list[float]] = {
        ("response", "band_hz"): [low, high],
        ("response", "modes"): [mechanism.response.modes],
    }
    for link in mechanism.links:
        values["links", link.name, "modes"] = [link.modes]
        if isinstance(link.body, Beam):
            values["links", link.name, "elements"] = [link.body.elements]
    if not plan.scene.one_angle:
        values["input", "range_deg"] = [math.degrees(angle) for angle in mechanism.stroke]
    write_text(path, _edited(text, values), PlanError)


class _Planner:
    """Tries settings, pairs of elements and modes a link, at a few angles of a scene, each once.

    Parameters
    ----------
    scene, solved
        As in `plan`.
    """

    def __init__(self, scene: Scene, solved: Callable[[], object]) -> None:
        self.scene = scene
        self._solved = solved
        start = time.perf_counter()
        self._kinematics = Kinematics(_with_settings(scene, 1, 0, 1))
        self._kinematics_seconds = time.perf_counter() - start
        self._angles = _angles(scene, _CHOOSING)
        self._allowed = np.array(astuple(scene.allowed))
        self._models: dict[Pair, tuple[LinkageModel, float]] = {}
        self._kept: dict[tuple[Pair, int], _Told] = {}

    def choose(self) -> Plan:
        """Return the plan."""
        scene, limit = self.scene, self.scene.seconds_per_prediction
        pair = self._cheapest(1.0)
        exact = self._prediction_seconds(pair)
        if scene.one_angle:
            why = "one angle is solved once"
        elif limit is None:
            why = f"no time is asked for, and a table takes some {_SOLVES} solves to build"
        elif exact <= limit:
            why = f"a solve takes {1e3 * exact:.2g} ms of the {1e3 * limit:.2g} allowed"
        elif scene.spatial:
            why = "tables hold nothing along y"
        else:
            return self._with_table(exact)
        residual, error, reasons = self._residual(pair)
        solution = self._model(pair)[0].solve(self._angles[0])
        return Plan(
            scene,
            *pair,
            self._n_modes,
            residual,
            None,
            0,
            Errors(*(self._errors(pair) + [0.0, 0.0, error]).tolist()),
            Costs(
                self._kinematics_seconds + self._model(pair)[1],
                exact,
                _frf_seconds(scene, lambda: _frf(scene, solution, residual)),
            ),
            (*self._reasons(pair), *reasons, ("solved at each angle", why)),
        )

    def _with_table(self, exact: float) -> Plan:
        """Return the plan that looks predictions up in a table."""
        scene, limit = self.scene, self.scene.seconds_per_prediction
        assert limit is not None
        pair = self._cheapest(1.0 - _TABLE_ROOM)
        errors = self._errors(pair)
        left = self._allowed - errors
        if scene.places and left[2] < FRF_FLOOR:
            raise PlanError(
                f"A table's FRFs are good to {FRF_FLOOR:g} at best; give a tolerance of "
                f"{2.0 * FRF_FLOOR / LOOSER:g} or more, no points, or no time per prediction."
            )
        table, tolerance, own, build = self._table(pair, left)
        prediction, frfs = _lookup_costs(scene, table)
        points = len(table.alpha3)
        quick = "" if prediction <= limit else "; nothing is quicker than a table"
        why = f"a solve takes {1e3 * exact:.2g} ms, more than the {1e3 * limit:.2g} allowed{quick}"
        reasons = (
            (f"table of {points} points", why),
            ("", f"built to {tolerance:.2g}, so that model and table meet it together"),
        )
        return Plan(
            scene,
            *pair,
            self._n_modes,
            "far poles",
            tolerance,
            points,
            Errors(*(errors + own).tolist()),
            Costs(self._kinematics_seconds + build, prediction, frfs),
            (*self._reasons(pair), *reasons),
        )

    def _table(self, pair: Pair, left: FloatArray) -> tuple[Table, float, FloatArray, float]:
        """Build a model's table whose errors against that model are no more than these.

        Returns
        -------
        table : Table
        tolerance : float
            What it was built to: what is left of the tolerance, and less where it proves worse
            between the points at which it measured itself.
        errors : ndarray, (3,)
            Of the table.
        seconds : float
            That the model and the table took.
        """
        scene = self.scene
        goals = [
            _truth(scene, _tell(scene, self._model(pair)[0], alpha3))
            for alpha3 in _spread(scene, _CHOSEN)
        ]
        rooms = [left[0], left[2] / LOOSER] if scene.places else [left[0]]
        tolerance, safe = float(max(rooms)), float(min(rooms))
        for _ in range(_TRIES):
            start = time.perf_counter()
            mechanism = _with_settings(scene, *pair, self._n_modes)
            model = LinkageModel(mechanism, kinematics=self._kinematics)
            try:
                table = build_table(model, tolerance, _points(scene), self._solved)
                if scene.places and not table.places:
                    raise TableError("it would hold no FRFs of such a linkage.")
            except TableError as error:
                raise PlanError(
                    f"A solve takes longer than is allowed, and there is no table: {error}"
                ) from None
            seconds = time.perf_counter() - start
            errors = _table_errors(scene, table, goals)
            if (errors <= left).all():
                return table, tolerance, errors, seconds
            tolerance = (
                max(safe, tolerance / _TIGHTER) if tolerance > safe else tolerance / _TIGHTER
            )
        raise PlanError(
            f"A solve takes longer than is allowed, and no table follows {scene.mechanism.name} to "
            f"a tolerance of {scene.tolerance:g} between its points; give a larger one."
        )

    def _cheapest(self, share: float) -> Pair:
        """Return the pair of the least work that meets a share of the tolerance."""
        # With fewer modes a mesh is never better, so that most need no trial of their own.
        meshes = {n for n in ELEMENTS if n <= self._finest and self._meets((n, self._most), share)}
        for pair in self._by_work():
            if pair[0] in meshes and self._meets(pair, share):
                return pair
        raise PlanError(
            f"No mesh up to {ELEMENTS[-1]} elements and no {MODES[-1]} modes a link meet a "
            f"tolerance of {self.scene.tolerance:g} up to {self.scene.band[1]:g} Hz; give a larger "
            "one, or a lower band."
        )

    def _by_work(self) -> list[Pair]:
        """Return the pairs up to the finest, the least work first."""
        links = len(self.scene.mechanism.links)
        interface = len(self._told((self._finest, 0), 0).frequencies)
        solves = 1 if self.scene.one_angle else _SOLVES

        def work(pair: Pair) -> float:
            elements, modes = pair
            return links * elements * _ELEMENT_WORK + solves * (interface + links * modes)

        meshes = [n for n in ELEMENTS if n <= self._finest]
        return sorted(((n, m) for n in meshes for m in MODES if m <= self._most), key=work)

    @cached_property
    def _finest(self) -> int:
        """The mesh that others are held against: near enough to the limit for the tolerance."""
        for elements in ELEMENTS:
            if elements % 4 == 0 and elements // 4 in ELEMENTS:
                if self._share(self._own_error(elements)) <= _RESOLVED:
                    return elements
        raise PlanError(
            f"No mesh up to {ELEMENTS[-1]} elements a link is fine enough for a tolerance of "
            f"{self.scene.tolerance:g} up to {self.scene.band[1]:g} Hz; give a larger one."
        )

    @cached_property
    def _mesh_error(self) -> FloatArray:
        return self._own_error(self._finest)

    def _own_error(self, elements: int) -> FloatArray:
        """Error of a mesh, from what two halvings before it changed (Richardson's extrapolation).

        Each halving divides it by 2^2 (extension, short elements) to 2^4 (bending).
        """
        goals = self._goals((elements, _MANY_MODES), _FIRST)
        quarter, half = (
            self._against(goals, (n, _MANY_MODES)) for n in (elements // 4, elements // 2)
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.nan_to_num((quarter - half) / half, nan=4.0)
        return np.asarray(half / (np.clip(ratio, 4.0, 16.0) - 1.0))

    @cached_property
    def _most(self) -> int:
        """The modes a link that others are held against."""
        for few, more, most in zip(MODES, MODES[1:], MODES[2:], strict=False):
            goals = self._goals((self._finest, most), _FIRST)
            errors = [self._against(goals, (self._finest, modes)) for modes in (few, more)]
            if self._share(np.max(errors, axis=0)) <= _SETTLED:
                return most
        return MODES[-1]

    @cached_property
    def _truths(self) -> list[Truth]:
        return self._goals((self._finest, self._most), len(self._angles))

    @cached_property
    def _n_modes(self) -> int:
        """Natural frequencies that come into the band within the range, one at least."""
        top = _ABOVE * self.scene.band[1]
        told = [self._told((self._finest, self._most), i) for i in range(len(self._angles))]
        return max(1, *(int((t.frequencies < top).sum()) for t in told))

    def _goals(self, pair: Pair, count: int) -> list[Truth]:
        """Return what a pair tells at the first angles, for others to be held against."""
        some = range(min(count, len(self._angles)))
        return [_truth(self.scene, self._told(pair, i)) for i in some]

    def _against(self, goals: Sequence[Truth], pair: Pair) -> FloatArray:
        errors = [_errors(goal, self._told(pair, i)) for i, goal in enumerate(goals)]
        return np.asarray(np.max(errors, axis=0))

    def _errors(self, pair: Pair) -> FloatArray:
        return self._against(self._truths, pair) + self._mesh_error

    def _share(self, errors: FloatArray) -> float:
        """Largest of the errors, in units of what is allowed."""
        return float((errors / self._allowed).max())

    def _meets(self, pair: Pair, share: float) -> bool:
        """Whether a pair meets a share of the tolerance, given up at the first angle if not."""
        return all(
            self._share(_errors(goal, self._told(pair, i)) + self._mesh_error) <= share
            for i, goal in enumerate(self._truths)
        )

    def _residual(self, pair: Pair) -> tuple[Residual, float, list[tuple[str, str]]]:
        """Return the fewest terms of the FRFs that meet the tolerance, their error, and why.

        They are held against all terms of the same model, at more angles than others: one FRF or
        another all but vanishes at some, and then depends on them the most.
        """
        scene = self.scene
        if not scene.places:
            return "none", 0.0, []
        model = self._model(pair)[0]
        told = [_tell(scene, model, alpha3) for alpha3 in _spread(scene, _CHOSEN)]
        goals = [_truth(scene, t) for t in told]
        every = [t.frf.stiffness for t in told if t.frf is not None]
        near = max(int(in_reach(stiffness, scene.band).sum()) for stiffness in every)
        total = len(every[0])
        own = float(self._errors(pair)[2])
        ladder: list[tuple[int, Residual, str]] = [
            (near, "none", "near modes alone"),
            (near + 1, "static", "near modes, static residual"),
            (near + N_FAR + _FAR_WORK, "far poles", "near modes, far poles"),
            (total, "every mode", "every mode"),
        ]
        why = f"{near} of {total} modes are near the band"
        for step in sorted(ladder):
            _, residual, choice = step
            some = [_condensed(scene, t, residual) for t in told]
            error = float(max(errors[2] for errors in map(_errors, goals, some)))
            if own + error <= scene.allowed.frf or residual == "every mode":
                break
            why = f"{choice}: {(own + error) / scene.allowed.frf:.2g} x the tolerance"
        return residual, error, [(f"FRFs: {choice}", why)]

    def _reasons(self, pair: Pair) -> list[tuple[str, str]]:
        elements, modes = pair
        y = [point for point, direction in self.scene.places if direction == "y"]
        reasons = [
            ("spatial", f"{y[0]} y is out of the plane")
            if y
            else ("planar", "nothing out of the plane is asked for")
        ]
        for count, ladder, name in ((elements, ELEMENTS, "elements"), (modes, MODES, "modes")):
            why = "the fewest"
            if count > ladder[0]:
                fewer = ladder[ladder.index(count) - 1]
                other = (fewer, modes) if name == "elements" else (elements, fewer)
                share = self._share(self._errors(other))
                why = f"with {fewer}: {share:.2g} x the tolerance"
            reasons.append((f"{name} a link: {count}", why))
        return reasons

    def _prediction_seconds(self, pair: Pair) -> float:
        model, middle = self._model(pair)[0], self._angles[0]
        return _median(lambda: _tell_modes(self.scene, model, middle))

    def _model(self, pair: Pair) -> tuple[LinkageModel, float]:
        """Return a model and the seconds that it took to make, when it was asked for first."""
        if pair not in self._models:
            mechanism = _with_settings(self.scene, *pair, 1)
            start = time.perf_counter()
            model = LinkageModel(mechanism, spatial=self.scene.spatial, kinematics=self._kinematics)
            self._models[pair] = model, time.perf_counter() - start
        return self._models[pair]

    def _told(self, pair: Pair, i: int) -> _Told:
        """Return what a model tells at an angle, solved when it is asked for first."""
        if (pair, i) not in self._kept:
            self._kept[pair, i] = _tell(self.scene, self._model(pair)[0], self._angles[i])
            self._solved()
        return self._kept[pair, i]


def _check(scene: Scene) -> None:
    """Refuse what is no sound scene."""
    low, high = scene.band
    if not 0.0 <= low < high < math.inf:
        raise PlanError(f"A band from {low:g} to {high:g} Hz is none; give two that ascend from 0.")
    if not 1e-9 <= scene.tolerance < 1.0:
        raise PlanError(f"A tolerance of {scene.tolerance:g} is none; give one from 1e-9 to 1.")
    if not scene.angles[0] <= scene.angles[1]:
        raise PlanError("A range of angles ascends; give the smaller one first.")
    for link in scene.mechanism.links:
        if isinstance(link.body, Frfs):
            raise PlanError(
                f"links.{link.name} is known by its FRFs alone, so that the measurement decides "
                "how good the model is; there is nothing to choose."
            )


def _with_settings(scene: Scene, elements: int, modes: int, n_modes: int) -> Mechanism:
    mechanism = scene.mechanism
    return replace(
        mechanism,
        links=tuple(
            replace(
                link,
                modes=modes,
                body=replace(link.body, elements=elements)
                if isinstance(link.body, Beam)
                else link.body,
            )
            for link in mechanism.links
        ),
        stroke=mechanism.stroke if scene.one_angle else scene.angles,
        response=replace(mechanism.response, band=scene.band, modes=n_modes),
    )


def _angles(scene: Scene, fractions: Sequence[float]) -> list[float]:
    low, high = scene.angles
    return [low] if scene.one_angle else [low + (high - low) * part for part in fractions]


def _spread(scene: Scene, count: int) -> list[float]:
    """Return angles over the range, its ends not among them."""
    inner = np.linspace(*scene.angles, 2 * count + 1)[1::2]
    return [scene.angles[0]] if scene.one_angle else [float(alpha3) for alpha3 in inner]


def _points(scene: Scene) -> list[str]:
    """Points whose FRFs a table is to hold."""
    return list(dict.fromkeys(point for point, _ in scene.places))


def _tell_modes(scene: Scene, model: LinkageModel, alpha3: float) -> tuple[Solution, float]:
    """Make a prediction by a solve: damping ratios and the peak with it."""
    solution = model.solve(alpha3)
    _ = solution.damped
    return solution, solution.peak(scene.band).magnitude


def _tell(scene: Scene, model: LinkageModel, alpha3: float) -> _Told:
    solution, peak = _tell_modes(scene, model, alpha3)
    frequencies = solution.natural_frequencies[~solution.modes.mechanism]
    frf = solution.frf(scene.places, scene.places) if scene.places else None
    return _Told(alpha3, frequencies, peak, frf)


def _look_up(scene: Scene, table: Table, alpha3: float) -> _Told:
    values, _, peak, _ = table.interpolate(alpha3)
    frf = table.frf(alpha3, scene.places, scene.places) if scene.places else None
    return _Told(alpha3, np.sort(values[: table.n_modes]), peak, frf)


def _table_errors(scene: Scene, table: Table, goals: Sequence[Truth]) -> FloatArray:
    """Hold a table against its own model: there, and where it has found its error the largest."""
    errors = [_errors(goal, _look_up(scene, table, goal.alpha3)) for goal in goals]
    told = np.array([table.interpolation_error.max(), table.peak_error, 0.0])
    return np.asarray(np.max([*errors, told], axis=0))


def _lookup_costs(scene: Scene, table: Table) -> tuple[float, float]:
    """Seconds of a prediction from a table, and of the FRFs."""
    low, high = scene.angles
    table.interpolate(low)
    angles = iter(np.linspace(low, high, 1000).tolist() * 2)
    prediction = _median(lambda: table.interpolate(next(angles)), 1000)
    places = scene.places
    return prediction, _frf_seconds(scene, lambda: table.frf(next(angles), places, places))


def _truth(scene: Scene, told: _Told) -> Truth:
    low, high = scene.band
    frequencies = told.frequencies[told.frequencies <= high]
    below = int((frequencies < low).sum())
    if told.frf is None:
        none = np.zeros((0, 1, 1))
        nothing = np.zeros((0, 0, 0), dtype=complex)
        return Truth(told.alpha3, frequencies, below, told.peak, none.ravel(), none, nothing)
    lines, weights = frf_lines(told.frf, scene.band)
    frf = told.frf.frf(lines)
    if not np.isfinite(frf).all():
        raise PlanError(
            f"{scene.mechanism.name} has FRFs without limit in the band, undamped or free to move; "
            "give its links damping, begin the band above 0 Hz, or ask for no points."
        )
    return Truth(told.alpha3, frequencies, below, told.peak, lines, weights, weights * frf)


def _errors(truth: Truth, told: _Told) -> FloatArray:
    """Hold what was told against the truth: the three of `Errors`."""
    n = len(truth.frequencies)
    if len(told.frequencies) < n:
        return np.full(3, math.inf)
    apart = np.abs(told.frequencies[:n] / truth.frequencies - 1.0)[truth.below :]
    peak = abs(told.peak / truth.peak - 1.0) if 0.0 < truth.peak < math.inf else 0.0
    frf = 0.0
    if told.frf is not None:
        frf = worst_frf_error(truth.weights * told.frf.frf(truth.lines), truth.frf)
    return np.array([apart.max(initial=0.0), peak, frf])


def _condensed(scene: Scene, told: _Told, residual: Residual) -> _Told:
    if told.frf is None:
        return told
    return replace(told, frf=_with_residual(told.frf, residual, scene.band))


def _with_residual(
    whole: PoleResidue, residual: Residual, band: tuple[float, float]
) -> PoleResidue:
    """Leave out of FRFs what they need not hold."""
    if residual == "every mode":
        return whole
    kept = in_reach(whole.stiffness, band)
    if residual == "far poles":
        return whole.condensed(kept, far_poles(whole.stiffness[~kept], whole.decay[~kept], band))
    static = whole.residual.copy()
    if residual == "static":
        static += (whole.residues[:, :, ~kept] / whole.stiffness[~kept]).sum(axis=-1)
    return PoleResidue(
        whole.stiffness[kept],
        whole.decay[kept],
        whole.residues[:, :, kept],
        whole.rates[:, :, kept],
        static,
    )


def _frf(scene: Scene, solution: Solution, residual: Residual) -> PoleResidue:
    return _with_residual(solution.frf(scene.places, scene.places), residual, scene.band)


def _frf_seconds(scene: Scene, told: Callable[[], PoleResidue]) -> float:
    """Return what FRFs cost beside a prediction."""
    lines = np.linspace(*scene.band, FRF_LINES)
    return _median(lambda: told().frf(lines)) if scene.places else 0.0


def _median(run: Callable[[], object], times: int = 25) -> float:
    """Return the seconds that something takes."""
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


def _edited(text: str, values: dict[tuple[str, ...], list[float]]) -> str:
    """Put numbers where they stand in a YAML file, or as a new key where they do not.

    Each value is a list: of one for a number, of several for a list of numbers.
    """
    root = yaml.compose(text, yaml.SafeLoader)
    changes: set[tuple[int, int, str]] = set()  # an alias leads to where its anchor stands
    for path, numbers in values.items():
        node: Any = root
        for key in path[:-1]:
            node = next(v for k, v in node.value if k.value == key)
        words = [_number(number) for number in numbers]
        old = next((v for k, v in node.value if k.value == path[-1]), None)
        if old is None:
            first = node.value[0][0].start_mark
            value = words[0] if len(words) == 1 else f"[{', '.join(words)}]"
            after = ", " if node.flow_style else "\n" + " " * first.column
            changes.add((first.index, first.index, f"{path[-1]}: {value}{after}"))
            continue
        scalars = old.value if isinstance(old, yaml.SequenceNode) else [old]
        for scalar, word in zip(scalars, words, strict=True):
            # The mark begins at an anchor, where there is one; the number ends the node.
            end = scalar.end_mark.index
            changes.add((end - len(scalar.value), end, word))
    replaced = [start for start, end, _ in changes if start < end]
    if len(set(replaced)) < len(replaced):
        raise PlanError("Two numbers that differ in the plan are one by an alias in the file.")
    for start, end, word in sorted(changes, reverse=True):
        text = text[:start] + word + text[end:]
    return text


def _number(value: float) -> str:
    word = repr(value)
    return word if "e" not in word or "." in word else word.replace("e", ".0e")
