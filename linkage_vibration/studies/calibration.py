# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Fits parameters of a mechanism to natural frequencies that were measured or published.

A calibration is a YAML file with three keys: ``mechanism`` (a path beside the file), ``parameters``
(the path of each number in the mechanism's description, with its bounds) and ``targets`` (natural
frequencies of modes, at an angle or as an extreme over the stroke).
``config/calibrations/paper.yaml`` shows every key.

The fit minimises the squares of the logarithms of the frequency ratios. Its variables are the
logarithms of the parameters. It begins at several points within the bounds.

The errors of the fitted logarithms have two causes. The targets scatter by their deviations; if the
residuals contradict these (sum of squares above its 95 % quantile), by as much as the residuals
show. And an error of a number that is uncertain and not fitted makes others of the fitted ones.
Where the targets say little, the bounds limit the errors, as those of a uniform distribution.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtri

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, IntArray
from linkage_vibration.mechanics.description import Mechanism, MechanismError, coarser
from linkage_vibration.mechanics.keys import Keys
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import number_at, split_paths, with_numbers
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.studies.calibrated_uncertainty import (
    other_claims,
    replace_section,
    with_fitted,
)
from linkage_vibration.studies.yaml_editing import edit_text
from linkage_vibration.support.atomic_files import write_text

COARSE_ELEMENTS, COARSE_MODES = 10, 4  # within the fit; they change frequencies by about 1e-5
STROKE_ANGLES = 13  # angles at which an extreme is sought, before a parabola refines it
UNDETERMINED = 0.5  # standard deviation of a logarithm above which a direction is undetermined
SHARE = 0.3  # component of a direction above which a parameter belongs to it
_LIKELY = 0.95  # share of sums of squared residuals that do not contradict the deviations
_STEP = 1e-4  # of the logarithms, in the central differences of the covariance
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
class Target:
    """A natural frequency that the mechanism is to have."""

    mode: int  # from 1, ascending
    at: float | str  # alpha3 in rad; or "lowest" or "highest" over the stroke
    frequency: float  # Hz
    deviation: float  # standard deviation, relative

    def __str__(self) -> str:
        """Return the mode and where it is taken."""
        where = self.at if isinstance(self.at, str) else f"at {math.degrees(self.at):g} deg"
        return f"mode {self.mode} {where}"


@dataclass(frozen=True, slots=True)
class CalibrationTask:
    """The parameters to fit, and the targets to fit them to."""

    mapping: dict[str, Any]  # the mechanism's description, as read
    text: str  # of the file that the description was read from
    parameters: tuple[Parameter, ...]
    targets: tuple[Target, ...]
    # Of the last geometry; they take longest, and most fits do not change the geometry.
    kinematics: dict[object, Kinematics] = field(default_factory=dict, compare=False)

    @property
    def names(self) -> tuple[str, ...]:
        """The path of each parameter."""
        return tuple(parameter.path for parameter in self.parameters)


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationResult:
    """The result of a fit."""

    values: FloatArray  # (n_parameters,), SI, as in the description
    frequencies: FloatArray  # (n_targets,), Hz, from the full model of the calibrated mechanism
    # (n, n), of the errors of the parameters' logarithms, then of those of the other uncertain
    # numbers, each in units of its own standard deviation.
    covariance: FloatArray
    others: tuple[str, ...]  # the paths of the other uncertain numbers
    scatter: float  # of the residuals, over what deviations and uncertain numbers explain; from 1
    undetermined: tuple[tuple[str, ...], ...]  # can change together without an effect on targets
    on_bound: tuple[str, ...]  # parameters that the fit pushed to a bound


def read_calibration(path: Path) -> CalibrationTask:
    """Read a calibration and the description that it starts from.

    A CalibrationError names the file, the key and the fix.
    """
    try:
        keys = Keys("", load_yaml(path)[0])
        mapping, text = load_yaml(path.parent / keys.text("mechanism"))
        bounds = keys["parameters"]
        parameters = [Parameter(name, *bounds.interval(name, positive=True)) for name in bounds]
        for place in itertools.chain(*(parameter.paths for parameter in parameters)):
            value = number_at(mapping, place)
            if value <= 0:
                what = f"{value!r} is not above zero, so it has no logarithm; drop it."
                raise MechanismError(f"parameters.{place}", what)
        targets = tuple(_target(entry) for entry in keys.items("targets"))
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
    """Fit the parameters to the targets, from the description and random points within the bounds.

    The random points are the same each time. Of equally good fits, that from the first point is
    taken. `finished` is called after each start with the lowest
    cost so far: half the sum of squares of log frequency ratios, each divided by its deviation.
    """
    low, high = np.log([(p.low, p.high) for p in calibration.parameters]).T
    described = [number_at(calibration.mapping, p.paths[0]) for p in calibration.parameters]
    random = np.random.default_rng(0)
    best, problem = None, ""
    for start in range(starts):
        guess = np.clip(np.log(described), low, high) if start == 0 else random.uniform(low, high)
        try:
            wider = (low - 1e-12, high + 1e-12)
            options = {"bounds": wider, "x_scale": "jac", "max_nfev": 60}
            fit = least_squares(lambda x: _residuals(calibration, x), guess, **options)
        except LinkageVibrationError as error:
            problem = str(error)
        else:
            better = best is None or fit.cost < (1.0 - _EQUAL[0]) * best.cost - _EQUAL[1]
            best = fit if better else best
        finished(math.inf if best is None else float(best.cost))
    if best is None:
        raise CalibrationError(
            "The mechanism could be solved from no starting point; narrow the bounds or correct "
            f"the description. The last problem: {problem}"
        )
    logs = np.clip(best.x, low, high)
    return _result(calibration, logs, (logs - low < 1e-6) | (high - logs < 1e-6))


def fit_report(calibration: CalibrationTask, result: CalibrationResult) -> str:
    """Return tables of the targets and of the parameters, and what the targets leave open."""
    lines = [f"{'target':24}{'wanted [Hz]':>12}{'found [Hz]':>12}{'difference':>12}"]
    for target, frequency in zip(calibration.targets, result.frequencies, strict=True):
        share = frequency / target.frequency - 1.0
        lines.append(f"{target!s:24}{target.frequency:12.4g}{frequency:12.4g}{share:12.1%}")
    lines += ["", f"{'parameter':44}{'value':>12}{'deviation':>12}"]
    deviations = np.sqrt(np.diag(result.covariance))
    unknown = {*itertools.chain(*result.undetermined), *result.on_bound}
    rows = zip(calibration.names, result.values, deviations, strict=False)
    for name, value, deviation in rows:
        certainty = f"{deviation:.1%}" if name not in unknown else "unknown"
        certainty = "on a bound" if name in result.on_bound else certainty
        lines.append(f"{name:44}{value:12.5g}{certainty:>12}")
    if result.scatter > 1.0:
        lines.append(
            f"\nThe differences are {result.scatter:.2g} times as large as the deviations of the "
            "targets explain, so the deviations of the parameters are larger, too."
        )
    for together in result.undetermined:
        lines.append(f"\nThe targets do not determine, or do not separate: {', '.join(together)}.")
    return "\n".join(lines)


def _apply(calibration: CalibrationTask, values: Sequence[float]) -> dict[str, Any]:
    """Return the description with other values of the parameters, SI, without uncertainty."""
    exact = {key: value for key, value in calibration.mapping.items() if key != "uncertainty"}
    return with_numbers(exact, _numbers(calibration, values))


def write_mechanism(calibration: CalibrationTask, result: CalibrationResult, path: Path) -> None:
    """Write the description with the fitted parameters; its comments and order stay.

    The section ``uncertainty`` is new, and comes last. A `CalibrationError` is raised if an alias
    in the file makes one number of two parameters.
    """
    pairs = _numbers(calibration, result.values.tolist())
    numbers = [(at.split("."), [f"{value:.6g}"]) for at, value in pairs]
    text = edit_text(calibration.text, numbers, CalibrationError)
    claims = other_claims(calibration.mapping, calibration.names)
    claims = with_fitted(claims, calibration.names, result.others, result.covariance)
    write_text(path, replace_section(text, claims, CalibrationError), CalibrationError)


def _natural_frequencies(model: LinkageModel, targets: Sequence[Target]) -> FloatArray:
    """Return the natural frequency that each target asks for, (n_targets,), Hz."""
    stroke = np.linspace(*model.mechanism.stroke, STROKE_ANGLES).tolist()
    asked = [stroke if isinstance(target.at, str) else [target.at] for target in targets]
    angles = dict.fromkeys(itertools.chain(*asked))
    solved = {alpha3: model.solve(alpha3).natural_frequencies for alpha3 in angles}
    highest = max(target.mode for target in targets)
    fewest = min(map(len, solved.values()))
    if highest > fewest:
        raise CalibrationError(
            f"targets: mode {highest} is not among the {fewest} modes of the model that is fitted; "
            "give a lower mode."
        )
    frequencies = []
    for target, at in zip(targets, asked, strict=True):
        curve = np.array([solved[alpha3][target.mode - 1] for alpha3 in at])
        frequencies.append(_extreme(curve, target.at == "lowest"))
    return np.array(frequencies)


def _numbers(calibration: CalibrationTask, values: Sequence[float]) -> list[tuple[str, float]]:
    """List the path of every place that holds a parameter, with its value."""
    pairs = zip(calibration.parameters, values, strict=True)
    return [(path, float(value)) for parameter, value in pairs for path in parameter.paths]


def _target(keys: Keys) -> Target:
    at: float | str
    if "at_deg" in keys:
        at = math.radians(keys.number("at_deg"))
    else:
        at = keys.choice("over_the_stroke", ["lowest", "highest"])
    frequency = keys.number("hz", positive=True)
    deviation = keys.number("deviation", positive=True, default=0.01)
    return Target(keys.integer("mode"), at, frequency, deviation)


def _residuals(calibration: CalibrationTask, logs: FloatArray) -> FloatArray:
    """Return the misfits, (n_targets,), with logarithms of the parameters."""
    mechanism = mechanism_from_mapping(_apply(calibration, np.exp(logs).tolist()))
    return _misfits(calibration, mechanism)


def _misfits(calibration: CalibrationTask, mechanism: Mechanism) -> FloatArray:
    """Return ln(frequency / wanted) / deviation, (n_targets,), of a coarse mesh."""
    mechanism = coarser(mechanism, COARSE_ELEMENTS, COARSE_MODES)
    closed = calibration.kinematics
    geometry = mechanism.ground, tuple((body.name, body.points) for body in mechanism.bodies)
    if geometry not in closed:
        closed.clear()
        closed[geometry] = Kinematics(mechanism)
    model = LinkageModel(mechanism, kinematics=closed[geometry])
    frequencies = _natural_frequencies(model, calibration.targets)
    wanted, deviations = np.array([(t.frequency, t.deviation) for t in calibration.targets]).T
    return np.asarray(np.log(frequencies / wanted) / deviations)


def _result(calibration: CalibrationTask, logs: FloatArray, bound: BoolArray) -> CalibrationResult:
    columns = []
    for step in _STEP * np.eye(len(logs)):
        before, after = (_residuals(calibration, end) for end in (logs - step, logs + step))
        columns.append((after - before) / (2.0 * _STEP))
    jacobian = np.array(columns).T
    free, names = np.flatnonzero(~bound), calibration.names
    groups = _undetermined(jacobian[:, free])
    undetermined = tuple(tuple(names[i] for i in free[group]) for group in groups)
    mapping = _apply(calibration, np.exp(logs).tolist())
    model = LinkageModel(mechanism_from_mapping(mapping))
    others, effects = _others(calibration, mapping)
    widths = np.log([p.high / p.low for p in calibration.parameters])
    residuals = _residuals(calibration, logs)
    covariance, scatter = _covariance(jacobian, residuals, effects, widths)
    on_bound = tuple(names[i] for i in np.flatnonzero(bound))
    frequencies = _natural_frequencies(model, calibration.targets)
    return CalibrationResult(
        np.exp(logs), frequencies, covariance, others, scatter, undetermined, on_bound
    )


def _others(
    calibration: CalibrationTask, fitted: dict[str, Any]
) -> tuple[tuple[str, ...], tuple[FloatArray, FloatArray]]:
    """Return the paths of the uncertain numbers that are not fitted, and their effects.

    These are the changes of the misfits of a fitted description by one standard deviation of each,
    (n_targets, n), and the correlations of the numbers, (n, n).
    """
    claims = other_claims(calibration.mapping, calibration.names)
    if not claims:
        return (), (np.zeros((len(calibration.targets), 0)), np.zeros((0, 0)))
    uncertainty = mechanism_from_mapping({**fitted, "uncertainty": claims}).uncertainty
    assert uncertainty is not None
    columns = []
    for number in uncertainty.numbers:
        low, high = (_misfits(calibration, side) for side in number.sides)
        columns.append((high - low) * number.deviation / (2.0 * number.step))
    paths = tuple(number.path for number in uncertainty.numbers)
    return paths, (np.array(columns).T, np.array(uncertainty.correlation))


def _undetermined(jacobian: FloatArray) -> list[IntArray]:
    """Return the sets of parameters, columns of a Jacobian, that the targets do not determine."""
    if not jacobian.shape[1]:
        return []
    values, directions = np.linalg.svd(jacobian, full_matrices=True)[1:]
    values = np.pad(values, (0, jacobian.shape[1] - len(values)))
    weak = directions[values <= 1.0 / UNDETERMINED]
    return [np.flatnonzero(np.abs(direction) > SHARE) for direction in weak]


def _covariance(
    jacobian: FloatArray,
    residuals: FloatArray,
    others: tuple[FloatArray, FloatArray],
    widths: FloatArray,
) -> tuple[FloatArray, float]:
    """Return `covariance` and `scatter` of a `CalibrationResult`.

    They follow from the Jacobian, (n_targets, n_parameters), and the residuals at the optimum, from
    what `_others` returns without paths, and from the logarithmic widths of the bounds.
    """
    changes, correlation = others
    explained = np.eye(len(residuals)) + changes @ correlation @ changes.T
    spare = len(residuals) - int(np.linalg.matrix_rank(jacobian))
    square = float(residuals @ np.linalg.solve(explained, residuals))
    likely = spare == 0 or square < chdtri(spare, 1.0 - _LIKELY)
    scatter = 1.0 if likely else math.sqrt(square / spare)
    inverse = np.linalg.inv(jacobian.T @ jacobian / scatter**2 + np.diag(12.0 / widths**2))
    # An error e of the others shifts the optimum by -into e.
    into = inverse @ jacobian.T @ changes / scatter**2
    mixed = -into @ correlation
    fitted = inverse + into @ correlation @ into.T
    return np.block([[fitted, mixed], [mixed.T, correlation]]), scatter


def _extreme(curve: FloatArray, lowest: bool) -> float:
    """Return the largest or the lowest value of a curve, by a parabola through three points."""
    top = int(curve.argmin() if lowest else curve.argmax())
    if top in (0, len(curve) - 1):
        return float(curve[top])
    before, here, after = curve[top - 1 : top + 2]
    bend = before - 2.0 * here + after
    return float(here - (after - before) ** 2 / (8.0 * bend)) if bend else float(here)
