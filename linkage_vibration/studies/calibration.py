# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Fits parameters of a mechanism to natural frequencies that were measured or published.

``config/calibrations/paper.yaml`` shows every key of a calibration. The fit finds the most probable
numbers (maximum a posteriori): it minimises the squares of the logarithms of the frequency ratios,
over their deviations, and of the changes of all numbers that the description states as uncertain,
over theirs. A parameter without a stated deviation has a uniform prior between its bounds.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import OptimizeResult, least_squares, minimize
from scipy.special import chdtri

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, IntArray
from linkage_vibration.mechanics.description import (
    Mechanism,
    MechanismError,
    UncertainNumber,
    coarser,
)
from linkage_vibration.mechanics.keys import CheckedMapping
from linkage_vibration.mechanics.kinematics import Kinematics, kinematics_of
from linkage_vibration.mechanics.lateral_keys import inertia_rooms
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import number_at, split_paths, with_numbers
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.readers.targets import Target, read_target
from linkage_vibration.studies.calibrated_uncertainty import (
    posterior_section,
    prior_section,
    replace_section,
)
from linkage_vibration.studies.yaml_editing import edit_text
from linkage_vibration.support.atomic_files import write_text

COARSE_ELEMENTS, COARSE_MODES = 10, 4  # within the fit; they change frequencies by about 1e-5
STROKE_ANGLES = 13  # angles at which an extreme is sought, before a parabola refines it
UNDETERMINED = 0.5  # standard deviation of a logarithm above which a direction is undetermined
SHARE = 0.3  # component of a direction above which a parameter belongs to it
_LIKELY = 0.95  # share of sums of squared residuals that do not contradict the deviations
_STEP = 1e-4  # of the logarithms, in differences
_STEP_OTHER = 1e-3  # of the other uncertain numbers, in units of their standard deviations
_FARTHEST = 5.0  # standard deviations by which these may change
_DOUBTFUL = 3.0  # deviations beyond which a number or a target contradicts what was stated
_ENOUGH = 1e-7  # relative change of the cost at which a search ends
_ROUNDED = 1e-4  # relative room below the sum of two inertias, which rounding does not take
_EQUAL = 1e-6, 1e-9  # of a cost, and costs; only the end of a search may distinguish such costs


class CalibrationError(LinkageVibrationError):
    """A calibration cannot be read or carried out."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number in the description that may change, or several places that share one number."""

    path: str  # its paths, as `split_paths` takes them
    low: float  # bounds, SI
    high: float

    @property
    def paths(self) -> tuple[str, ...]:
        """The path of each place that holds the number."""
        return split_paths(self.path)


@dataclass(frozen=True, slots=True)
class CalibrationTask:
    """The parameters to fit, and the targets to fit them to."""

    mapping: dict[str, Any]  # the mechanism's description, as read
    text: str  # of the file that the description was read from
    parameters: tuple[Parameter, ...]
    targets: tuple[Target, ...]
    # Those of the last geometry: computing them takes longest, and most fits keep the geometry.

    @property
    def names(self) -> tuple[str, ...]:
        """The path of each parameter."""
        return tuple(parameter.path for parameter in self.parameters)


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationResult:
    """The result of a fit: the parameters, then all other uncertain numbers."""

    names: tuple[str, ...]  # (n,), their paths
    values: FloatArray  # (n,), SI, as in the description
    relative: BoolArray  # (n,): whether the deviation is that of the logarithm, as for parameters
    covariance: FloatArray  # (n, n), of logarithms where relative
    stated: FloatArray  # (n,): the standard deviations before the fit; NaN if none was stated
    moved: FloatArray  # (n,): changes by the fit, in these deviations
    frequencies: FloatArray  # (n_targets,), Hz, from the full model of the calibrated mechanism
    scatter: float  # of the residuals, over what the deviations explain; from 1
    undetermined: tuple[tuple[str, ...], ...]  # can change together without an effect on targets
    on_bound: tuple[str, ...]  # numbers that the fit pushed to a bound
    doubts: tuple[str, ...] = ()  # what is wrong with the fitted mechanism


@dataclass(frozen=True, slots=True, eq=False)
class _Unknowns:
    """All numbers that a fit changes, and what is known of them before.

    The variables are the logarithms of the parameters, and the changes of the other uncertain
    numbers in units of their standard deviations.
    """

    parameters: tuple[Parameter, ...]
    others: tuple[UncertainNumber, ...]
    claims: tuple[tuple[int, UncertainNumber], ...]  # the variable of each number with a deviation
    whitening: FloatArray  # inverse of the Cholesky factor of the correlations of these numbers

    @property
    def names(self) -> tuple[str, ...]:
        """The paths of the numbers."""
        return (*(p.path for p in self.parameters), *(number.path for number in self.others))

    @property
    def bounds(self) -> FloatArray:
        """The bounds of the variables, (2, n)."""
        logs = [(math.log(each.low), math.log(each.high)) for each in self.parameters]
        return np.array([*logs, *[(-_FARTHEST, _FARTHEST)] * len(self.others)]).T

    @property
    def flat(self) -> IntArray:
        """The variables without a stated deviation."""
        return np.setdiff1d(np.arange(len(self.parameters)), [at for at, _ in self.claims])

    def values(self, x: FloatArray) -> FloatArray:
        """Return the numbers, (n,), SI."""
        fitted, steps = np.split(x, [len(self.parameters)])
        others = [number.moved(step) for number, step in zip(self.others, steps, strict=True)]
        return np.concatenate([np.exp(fitted), others])

    def changes(self, x: FloatArray) -> FloatArray:
        """Return the change of each number that has a deviation, in units of it."""
        values = self.values(x)
        return np.array([_change(number, values[at]) for at, number in self.claims])

    def numbers(self, x: FloatArray) -> list[tuple[str, float]]:
        """List the path of every place that holds one of the numbers, with its value."""
        pairs = zip(self.names, self.values(x).tolist(), strict=True)
        return [(path, value) for name, value in pairs for path in split_paths(name)]


def read_calibration(path: Path) -> CalibrationTask:
    """Read a calibration and its description; a CalibrationError names the file, key and fix."""
    try:
        keys = CheckedMapping("", load_yaml(path)[0])
        mapping, text = load_yaml(path.parent / keys.text("mechanism"))
        bounds = keys["parameters"]
        parameters = [Parameter(name, *bounds.interval(name, positive=True)) for name in bounds]
        for place in itertools.chain(*(parameter.paths for parameter in parameters)):
            value = number_at(mapping, place)
            if value <= 0:
                what = f"{value!r} is not above zero, so it has no logarithm; drop it."
                raise MechanismError(f"parameters.{place}", what)
        targets = tuple(read_target(entry) for entry in keys.items("targets"))
        keys.refuse_unknown()
    except MechanismError as error:
        where = "" if error.path == str(path) else f"{path}: "
        raise CalibrationError(f"{where}{error}") from None
    if not parameters:
        raise CalibrationError(f"{path}: parameters: is empty; name at least one.")
    return CalibrationTask(mapping, text, tuple(parameters), targets)


def calibrate(
    calibration: CalibrationTask,
    starts: int = 8,
    finished: Callable[[float], object] = lambda cost: None,
) -> CalibrationResult:
    """Fit the uncertain numbers to the targets, from the description and random parameters.

    The points are the same each time; of equal fits the first is taken. `finished` gets the lowest
    cost so far, half the sum of squares, after each start.
    """
    unknowns = _unknowns(calibration)
    n = len(calibration.parameters)
    low, high = unknowns.bounds
    described = [number_at(calibration.mapping, p.paths[0]) for p in calibration.parameters]
    random = np.random.default_rng(0)
    best, problem = None, ""
    for start in range(starts):
        logs = np.log(described) if start == 0 else random.uniform(low[:n], high[:n])
        guess = np.clip(np.append(logs, np.zeros(len(unknowns.others))), low, high)
        try:
            fit = _fit(calibration, unknowns, guess)
        except LinkageVibrationError as error:
            problem = str(error)
        else:
            better = best is None or fit.cost < (1.0 - _EQUAL[0]) * best.cost - _EQUAL[1]
            best = fit if better else best
        finished(math.inf if best is None else float(best.cost))
    if best is None:
        hint = "narrow the bounds, or correct the description"
        raise CalibrationError(f"No start could be solved; {hint}. The last problem: {problem}")
    return _result(calibration, unknowns, best)


def fit_report(calibration: CalibrationTask, result: CalibrationResult) -> str:
    """Return tables of the targets and of the parameters, and what the targets leave open."""
    bad = list[str]()
    lines = [f"{'target':24}{'wanted [Hz]':>12}{'found [Hz]':>12}{'difference':>12}"]
    for target, frequency in zip(calibration.targets, result.frequencies, strict=True):
        share = round(frequency / target.frequency - 1.0, 3) + 0.0  # no -0.0
        lines.append(f"{target!s:24}{target.frequency:12.4g}{frequency:12.4g}{share:12.1%}")
        away = math.log(frequency / target.frequency) / target.deviation
        if abs(away) > _DOUBTFUL:
            side = "high" if away > 0.0 else "low"
            bad.append(f"{target} is {abs(away):.2g} of its deviations too {side}")
    if bad:
        hint = "check which modes the targets belong to, and the mechanism"
        lines.append(f"\nThe fit is not good: {'; '.join(bad)}; {hint}.")
    names, n = result.names, len(calibration.parameters)
    deviations = np.sqrt(np.diag(result.covariance))
    unknown = {*itertools.chain(*result.undetermined)}
    for heading, rows in (("parameter", range(n)), ("other number", range(n, len(names)))):
        if rows:
            columns = f"{'value':>12}{'stated':>9}{'change/stated':>15}{'deviation':>12}"
            lines += ["", f"{heading:44}{columns}"]
        for i in rows:
            form = ".1%" if result.relative[i] else ".2g"
            stated, change = f"{result.stated[i]:{form}}", f"{round(result.moved[i], 1) + 0.0:+.1f}"
            if math.isnan(result.stated[i]):
                stated, change = "none", ""
            deviation = "unknown" if names[i] in unknown else f"{deviations[i]:{form}}"
            deviation = "on a bound" if names[i] in result.on_bound else deviation
            first, *more = split_paths(names[i])
            name = first + ", ..." * bool(more)
            lines.append(f"{name:44}{result.values[i]:12.4g}{stated:>9}{change:>15}{deviation:>12}")
    if far := [names[i] for i in np.flatnonzero(np.abs(result.moved) > _DOUBTFUL)]:
        hint = "check the number, its deviation, and which modes the targets belong to"
        change = f"by more than {_DOUBTFUL:g} stated deviations"
        lines.append(f"\nThe fit changes {', '.join(far)} {change}; {hint}.")
    if np.isnan(result.stated).any():
        lines.append(
            "\nThe mechanism states no deviation of some parameters (none). Before the fit, all "
            "values within their bounds count as equally likely, on a logarithmic scale."
        )
    if result.scatter > 1.0:
        lines.append(
            f"\nThe differences are {result.scatter:.2g} times as large as the deviations "
            "explain, so the targets count with deviations that are larger by this factor."
        )
    for together in result.undetermined:
        lines.append(f"\nThe targets do not determine, or do not separate: {', '.join(together)}.")
    lines += [f"\n{doubt}" for doubt in result.doubts]
    return "\n".join(lines)


def write_mechanism(calibration: CalibrationTask, result: CalibrationResult, path: Path) -> None:
    """Write the description with the fitted numbers, and last a new section ``uncertainty``."""
    edits = []
    for i, (name, value) in enumerate(zip(result.names, result.values.tolist(), strict=True)):
        word, places = f"{value:.6g}", split_paths(name)
        described = number_at(calibration.mapping, places[0])
        if i < len(calibration.parameters) or float(word) != described:
            edits += [(place.split("."), [word]) for place in places]
    text = edit_text(calibration.text, edits, CalibrationError)
    section = posterior_section(result.names, result.relative, result.covariance)
    write_text(path, replace_section(text, section, CalibrationError), CalibrationError)


def _natural_frequencies(model: LinkageModel, targets: Sequence[Target]) -> FloatArray:
    """Return the natural frequency that each target asks for, (n_targets,), Hz."""
    stroke = np.linspace(*model.mechanism.stroke, STROKE_ANGLES).tolist()
    asked = [stroke if isinstance(target.at, str) else [target.at] for target in targets]
    models: dict[str, LinkageModel] = {each.half: each for each in model.halves}
    solved: dict[tuple[str, float], FloatArray] = {}
    frequencies = []
    for target, at in zip(targets, asked, strict=True):
        if target.half not in models:
            raise CalibrationError(f"targets: {target}: the mechanism has no `lateral` half.")
        for alpha3 in at:
            if (target.half, alpha3) not in solved:
                solution = models[target.half].solve(alpha3)
                solved[target.half, alpha3] = solution.natural_frequencies
        rows = [solved[target.half, alpha3] for alpha3 in at]
        if target.mode > (fewest := min(map(len, rows))):
            problem = f"the fitted model has {fewest} modes, so none is mode {target.mode}"
            raise CalibrationError(f"targets: {problem}; give a lower mode.")
        curve = np.array([row[target.mode - 1] for row in rows])
        frequencies.append(_extreme(curve, target.at == "lowest"))
    return np.array(frequencies)


def _unknowns(calibration: CalibrationTask) -> _Unknowns:
    """Return what a fit changes; a `MechanismError` is raised if the description is invalid."""
    mapping, names = calibration.mapping, list(calibration.names)
    mechanism_from_mapping(mapping)
    prior = prior_section(mapping, names)
    places = [parameter.paths for parameter in calibration.parameters]
    shared = [(path, number_at(mapping, paths[0])) for paths in places for path in paths]
    described = with_numbers(_exact(mapping) | ({"uncertainty": prior} if prior else {}), shared)
    uncertainty = mechanism_from_mapping(described).uncertainty
    if uncertainty is None:
        return _Unknowns(calibration.parameters, (), (), np.zeros((0, 0)))
    others = tuple(number for number in uncertainty.numbers if number.path not in names)
    names += [number.path for number in others]
    claims = tuple((names.index(number.path), number) for number in uncertainty.numbers)
    correlation = np.array(uncertainty.correlation).reshape(2 * [len(claims)])
    whitening = np.linalg.inv(np.linalg.cholesky(correlation))
    return _Unknowns(calibration.parameters, others, claims, whitening)


def _exact(mapping: dict[str, Any]) -> dict[str, Any]:
    """Return a description without uncertainty."""
    return {key: value for key, value in mapping.items() if key != "uncertainty"}


def _change(number: UncertainNumber, value: float) -> float:
    """Return the change of a number to a value, in units of its standard deviation."""
    change = value - number.value
    if number.relative:
        change = number.value * math.log(value / number.value)
    return change / number.deviation


def _fit(
    calibration: CalibrationTask, unknowns: _Unknowns, guess: FloatArray, scatter: float = 1.0
) -> OptimizeResult:
    """Return the most probable variables, with deviations of the targets times `scatter`."""
    exact = _exact(calibration.mapping)
    steps = np.full(len(guess), _STEP_OTHER)
    steps[: len(unknowns.parameters)] = _STEP

    def described(x: FloatArray) -> Mechanism:
        return mechanism_from_mapping(with_numbers(exact, unknowns.numbers(x)), drawn=True)

    def residuals(x: FloatArray, near: Kinematics | None = None) -> FloatArray:
        misfits = _misfits(calibration, described(x), near) / scatter
        return np.concatenate([misfits, unknowns.whitening @ unknowns.changes(x)])

    def jacobian(x: FloatArray) -> FloatArray:
        here, near = residuals(x), kinematics_of(described(x))
        columns = [(residuals(x + step, near) - here) / step.sum() for step in np.diag(steps)]
        return np.array(columns).T

    low, high = unknowns.bounds
    bounds = low - 1e-12, high + 1e-12
    return least_squares(
        residuals, guess, jacobian, bounds, ftol=_ENOUGH, x_scale="jac", max_nfev=60
    )


def _misfits(
    calibration: CalibrationTask, mechanism: Mechanism, near: Kinematics | None
) -> FloatArray:
    """Return ln(frequency / wanted) / deviation, (n_targets,); `near` is of a similar mechanism."""
    mechanism = coarser(mechanism, COARSE_ELEMENTS, COARSE_MODES)
    kinematics = kinematics_of(mechanism) if near is None else near.nearby(mechanism)
    model = LinkageModel(mechanism, kinematics=kinematics)
    frequencies = _natural_frequencies(model, calibration.targets)
    wanted, deviations = np.array([(t.frequency, t.deviation) for t in calibration.targets]).T
    return np.asarray(np.log(frequencies / wanted) / deviations)


def _result(
    calibration: CalibrationTask, unknowns: _Unknowns, fit: OptimizeResult
) -> CalibrationResult:
    flat, scatter = unknowns.flat, _scatter(fit, len(calibration.targets), unknowns.flat)
    if scatter > 1.0:
        fit = _fit(calibration, unknowns, fit.x, scatter)
    low, high = unknowns.bounds
    information = fit.jac.T @ fit.jac
    information[flat, flat] += 12.0 / (high - low)[flat] ** 2
    x, doubts = _possible(calibration, unknowns, np.clip(fit.x, low, high), information)
    names = unknowns.names
    bound = (x - low < 1e-6) | (high - x < 1e-6)
    free = flat[~bound[flat]]
    # What the other numbers cannot undo; they have priors, so they do not lack any direction.
    basis = np.linalg.qr(np.delete(fit.jac, flat, axis=1))[0]
    rest = fit.jac[:, free] - basis @ (basis.T @ fit.jac[:, free])
    undetermined = tuple(tuple(names[i] for i in free[group]) for group in _undetermined(rest))
    units, stated, moved = np.ones(len(x)), np.full(len(x), math.nan), np.full(len(x), math.nan)
    for (at, number), change in zip(unknowns.claims, unknowns.changes(x), strict=True):
        logarithmic = number.relative or at < len(unknowns.parameters)
        stated[at] = number.deviation / (abs(number.value) if logarithmic else 1.0)
        moved[at] = change
        units[at] = stated[at] if at >= len(unknowns.parameters) else 1.0
    relative = [True] * len(unknowns.parameters) + [each.relative for each in unknowns.others]
    covariance = np.linalg.inv(information) * np.outer(units, units)
    numbers = names, unknowns.values(x), np.array(relative), covariance, stated, moved
    mapping = with_numbers(_exact(calibration.mapping), unknowns.numbers(x))
    try:
        mechanism_from_mapping(mapping)
    except MechanismError as error:  # A fit is not lost because its numbers are impossible.
        doubts += (f"Other commands refuse the fitted mechanism. {error}",)
    model = LinkageModel(mechanism_from_mapping(mapping, drawn=True))
    frequencies = _natural_frequencies(model, calibration.targets)
    on_bound = tuple(names[i] for i in np.flatnonzero(bound))
    return CalibrationResult(*numbers, frequencies, scatter, undetermined, on_bound, doubts)


def _possible(
    calibration: CalibrationTask, unknowns: _Unknowns, best: FloatArray, information: FloatArray
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the most probable variables with inertias that bodies have, and what to say of it."""
    exact, (low, high) = _exact(calibration.mapping), unknowns.bounds

    def rooms(x: FloatArray) -> FloatArray:
        mechanism = mechanism_from_mapping(with_numbers(exact, unknowns.numbers(x)), drawn=True)
        pitch = {body.name: body.inertia for body in mechanism.rigid}
        across = mechanism.lateral.inertia if mechanism.lateral else ()
        return np.array([inertia_rooms(roll, pitch[name], yaw) for name, (roll, yaw) in across])

    if rooms(best).min(initial=math.inf) >= _ROUNDED:
        return best, ()
    # In units in which all changes are equally likely, the search takes few steps.
    units = np.linalg.inv(np.linalg.cholesky(information)).T
    limits = [
        lambda z: rooms(best + units @ z).ravel() - _ROUNDED,
        lambda z: np.concatenate([best + units @ z - low, high - best - units @ z]),
    ]
    found = minimize(
        lambda z: (z @ z / 2.0, z),
        np.zeros(len(best)),
        jac=True,
        method="SLSQP",
        constraints=[{"type": "ineq", "fun": limit} for limit in limits],
    )
    if not found.success:
        return best, ()
    away = float(np.linalg.norm(found.x))
    doubt = (
        "The best fit would have inertias of no body, as one exceeds the sum of the others, by "
        f"{away:.2g} deviations. These are the most probable ones of a body, a flat one."
    )
    if away > _DOUBTFUL:
        doubt += " Check the inertias in the mechanism, and which modes the targets belong to."
    return np.clip(best + units @ found.x, low, high), (doubt,)


def _scatter(fit: OptimizeResult, n_targets: int, flat: IntArray) -> float:
    """Return by how much the residuals exceed their deviations, 1 if these are not contradicted.

    Every prior is one more residual and one more variable, so only flat variables count.
    """
    spare = n_targets - int(np.linalg.matrix_rank(fit.jac[:, flat])) if len(flat) else n_targets
    square = 2.0 * float(fit.cost)
    likely = spare <= 0 or square < chdtri(spare, 1.0 - _LIKELY)
    return 1.0 if likely else math.sqrt(square / spare)


def _undetermined(jacobian: FloatArray) -> list[IntArray]:
    """Return the sets of parameters, columns of a Jacobian, that the targets do not determine."""
    if not jacobian.shape[1]:
        return []
    values, directions = np.linalg.svd(jacobian, full_matrices=True)[1:]
    values = np.pad(values, (0, jacobian.shape[1] - len(values)))
    weak = directions[values <= 1.0 / UNDETERMINED]
    return [np.flatnonzero(np.abs(direction) > SHARE) for direction in weak]


def _extreme(curve: FloatArray, lowest: bool) -> float:
    """Return the largest or the lowest value of a curve, by a parabola through three points."""
    top = int(curve.argmin() if lowest else curve.argmax())
    if top in (0, len(curve) - 1):
        return float(curve[top])
    before, here, after = curve[top - 1 : top + 2]
    bend = before - 2.0 * here + after
    return float(here - (after - before) ** 2 / (8.0 * bend)) if bend else float(here)
