# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a mechanism fitted to natural frequencies that were measured or published.

A calibration is a YAML file: ``mechanism`` (a path beside it), ``parameters`` (the path of each in
the mechanism's description, with its bounds) and ``targets`` (natural frequencies of modes, at an
angle or as an extreme over the stroke). ``config/calibrations/paper.yaml`` shows every key.

The fit is least squares of the logarithms of the frequencies in the logarithms of the parameters,
from several starts within the bounds.
"""

import copy
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.optimize import least_squares

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import Beam, Mechanism, MechanismError
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import Keys, mechanism_from_mapping
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.support.atomic_files import write_text

FloatArray = NDArray[np.float64]

COARSE_ELEMENTS, COARSE_MODES = 10, 4  # within the fit; frequencies move by some 1e-5
STROKE_ANGLES = 13  # at which extremes over the stroke are sought, then refined by a parabola
UNDETERMINED = 0.5  # standard deviation of a logarithm above which the data do not tell a direction
CORRELATED = 0.9  # from which a summary names two parameters
SHARE = 0.3  # of a direction, from which a parameter is named as part of it


class CalibrationError(LinkageVibrationError):
    """A calibration cannot be read or carried out."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number in the description that may be changed, or several that are the same one."""

    path: str  # as `split_paths` takes it
    low: float
    high: float

    @property
    def paths(self) -> tuple[str, ...]:
        """Every place that the number stands at."""
        return split_paths(self.path)


@dataclass(frozen=True, slots=True)
class Target:
    """A natural frequency that the mechanism shall have."""

    mode: int  # from 1, ascending
    at: float | str  # alpha3 in rad, or "lowest" or "highest" over the stroke
    frequency: float  # Hz
    deviation: float  # standard deviation, relative

    def __str__(self) -> str:
        """Return what is asked for, in words."""
        where = self.at if isinstance(self.at, str) else f"at {math.degrees(self.at):g} deg"
        return f"mode {self.mode} {where}"


@dataclass(frozen=True, slots=True)
class Calibration:
    """What to fit to what.

    Attributes
    ----------
    mapping : dict
        The mechanism's description, as read.
    text : str
        The file that it comes from.
    parameters : tuple of Parameter, (n_parameters,)
    targets : tuple of Target, (n_targets,)
    """

    mapping: dict[str, Any]
    text: str
    parameters: tuple[Parameter, ...]
    targets: tuple[Target, ...]


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationResult:
    """What a fit found.

    Attributes
    ----------
    values : ndarray, (n_parameters,)
        SI, as in the description.
    frequencies : ndarray, (n_targets,)
        Of the calibrated mechanism, by its full model, Hz.
    covariance : ndarray, (n_parameters, n_parameters)
        Of the parameters' logarithms, from the targets' deviations; infinite on the diagonal for
        parameters that the data do not determine, zero for those on a bound.
    undetermined : tuple of tuple of str
        Each a set of parameters that can change together without the targets telling.
    on_bound : tuple of str
        Parameters that the fit pushed to a bound.
    """

    values: FloatArray
    frequencies: FloatArray
    covariance: FloatArray
    undetermined: tuple[tuple[str, ...], ...]
    on_bound: tuple[str, ...]


def read_calibration(path: Path) -> Calibration:
    """Read a calibration and the description that it starts from.

    Raises
    ------
    CalibrationError, MechanismError
        Naming the file, the key and the mend.
    """
    try:
        keys = Keys("", load_yaml(path)[0])
        source = path.parent / keys.text("mechanism")
        mapping, text = load_yaml(source)
        parameters = []
        for name in keys["parameters"]:
            low, high = keys["parameters"].interval(name, positive=True)
            parameters.append(Parameter(name, low, high))
            for place in parameters[-1].paths:
                _get(mapping, place)
        targets = tuple(_target(entry) for entry in keys.items("targets"))
        keys.refuse_unknown()
    except MechanismError as error:
        raise CalibrationError(f"{path}: {error}") from None
    if not parameters:
        raise CalibrationError(f"{path}: parameters: is empty; name one at least.")
    return Calibration(mapping, text, tuple(parameters), targets)


def calibrate(
    calibration: Calibration,
    starts: int = 8,
    tried: Callable[[float], object] = lambda cost: None,
) -> CalibrationResult:
    """Fit the parameters to the targets.

    Parameters
    ----------
    calibration : Calibration
        What to fit to what.
    starts : int
        Starting points; the first is the description's own, the others are drawn within the
        bounds with a fixed seed.
    tried : callable
        Called after each start with the lowest cost so far: half the sum of squares of the
        logarithms of the frequency ratios, each over its deviation.

    Raises
    ------
    CalibrationError
        If the mechanism can be solved from none of the starts.
    """
    low, high = np.log([(p.low, p.high) for p in calibration.parameters]).T
    own = np.log([_get(calibration.mapping, p.paths[0]) for p in calibration.parameters])
    random = np.random.default_rng(0)
    best, problem = None, ""
    closed: dict[object, Kinematics] = {}
    for start in range(starts):
        guess = np.clip(own, low, high) if start == 0 else random.uniform(low, high)
        try:
            fit = least_squares(
                lambda logs: _residuals(calibration, logs, closed),
                guess,
                bounds=(low - 1e-12, high + 1e-12),
                x_scale="jac",
                max_nfev=60,
            )
        except LinkageVibrationError as error:
            problem = str(error)
        else:
            best = fit if best is None or fit.cost < best.cost else best
        tried(math.inf if best is None else float(best.cost))
    if best is None:
        raise CalibrationError(f"From no start could the mechanism be solved; the last: {problem}")
    logs = np.clip(best.x, low, high)
    return _result(calibration, logs, (logs - low < 1e-6) | (high - logs < 1e-6))


def summary(calibration: Calibration, result: CalibrationResult) -> str:
    """Tell a fit in words: targets met and missed, parameters, and what the data cannot tell."""
    lines = [f"{'target':24}{'wanted [Hz]':>12}{'found [Hz]':>12}{'difference':>12}"]
    for target, found in zip(calibration.targets, result.frequencies, strict=True):
        share = found / target.frequency - 1.0
        lines.append(f"{target!s:24}{target.frequency:12.4g}{found:12.4g}{share:12.1%}")
    lines += ["", f"{'parameter':44}{'value':>12}{'deviation':>12}"]
    deviations = np.sqrt(np.diag(result.covariance))
    for parameter, value, deviation in zip(
        calibration.parameters, result.values, deviations, strict=True
    ):
        if parameter.path in result.on_bound:
            told = "on a bound"
        else:
            told = f"{deviation:.1%}" if math.isfinite(deviation) else "not told"
        lines.append(f"{parameter.path:44}{value:12.5g}{told:>12}")
    for i, j in zip(*np.triu_indices(len(result.values), 1), strict=True):
        scale = deviations[i] * deviations[j]
        if 0.0 < scale < math.inf and abs(result.covariance[i, j]) > CORRELATED * scale:
            names = calibration.parameters[i].path, calibration.parameters[j].path
            share = result.covariance[i, j] / scale
            lines.append(f"correlation {share:+.2f} of {names[0]} and {names[1]}")
    for together in result.undetermined:
        lines.append(f"\nThe targets cannot tell, or cannot tell apart: {', '.join(together)}.")
    return "\n".join(lines)


def apply(calibration: Calibration, values: Sequence[float]) -> dict[str, Any]:
    """Return the description with other values of the parameters."""
    return with_numbers(calibration.mapping, _places(calibration, values))


def write_mechanism(calibration: Calibration, values: Sequence[float], path: Path) -> None:
    """Write the calibrated description; its comments and its order stay.

    Raises
    ------
    CalibrationError
        If the file cannot be written.
    """
    root = yaml.compose(calibration.text, yaml.SafeLoader)
    changes = []
    for path_of, value in _places(calibration, values):
        node: Any = root
        for key in path_of.split("."):
            if isinstance(node, yaml.SequenceNode):
                node = node.value[int(key)]
            else:
                node = next(v for k, v in node.value if k.value == key)
        # The mark begins at an anchor, where there is one; the number ends the node.
        end = node.end_mark.index
        changes.append((end - len(node.value), end, f"{value:.6g}"))
    changes = list(dict.fromkeys(changes))  # an alias leads to where its anchor stands
    if len({start for start, _, _ in changes}) < len(changes):
        raise CalibrationError(
            "Two parameters are one number, by an alias in the file; name one of them only."
        )
    text = calibration.text
    for start, end, number in sorted(changes, reverse=True):
        plain = number if "e" not in number or "." in number else number.replace("e", ".0e")
        text = text[:start] + plain + text[end:]
    write_text(path, text, CalibrationError)


def split_paths(path: str) -> tuple[str, ...]:
    """Return the paths of a parameter: several, joined by commas, are one number.

    A path is keys joined by dots, with positions in lists from 0.
    """
    return tuple(part.strip() for part in path.split(","))


def number_at(mapping: Any, path: str) -> float:
    """Return the number that stands at a path in a description.

    Raises
    ------
    MechanismError
        If there is none.
    """
    below = mapping
    for key in path.split("."):
        try:
            below = below[int(key) if isinstance(below, list) else key]
        except (KeyError, IndexError, ValueError, TypeError):
            raise MechanismError(
                f"parameters.{path}", f"the mechanism has no key {key!r} there; check the path."
            ) from None
    if isinstance(below, bool) or not isinstance(below, int | float):
        raise MechanismError(f"parameters.{path}", f"{below!r} is not a number.")
    return below


def with_numbers(mapping: dict[str, Any], numbers: Iterable[tuple[str, float]]) -> dict[str, Any]:
    """Return a copy of a description with other numbers at paths that it has."""
    changed = copy.deepcopy(mapping)
    for path, value in numbers:
        *keys, last = path.split(".")
        below: Any = changed
        for key in keys:
            below = below[int(key) if isinstance(below, list) else key]
        below[int(last) if isinstance(below, list) else last] = value
    return changed


def natural_frequencies(
    mechanism: Mechanism,
    targets: Sequence[Target],
    *,
    coarse: bool = False,
    closed: dict[object, Kinematics] | None = None,
) -> FloatArray:
    """Return the natural frequency that each target asks for, (n_targets,), Hz.

    Parameters
    ----------
    mechanism : Mechanism
    targets : sequence of Target
    coarse : bool
        Mesh the links just as finely as a fit needs.
    closed : dict, optional
        Keeps the kinematics, which take longest, while no point of the linkage changes.

    Raises
    ------
    CalibrationError
        If a target asks for a mode that the model does not have.
    """
    if coarse:
        mechanism = _coarse(mechanism)
    points = tuple((body.name, body.points) for body in mechanism.bodies)
    closed = {} if closed is None else closed
    if (mechanism.ground, points) not in closed:
        closed.clear()
        closed[mechanism.ground, points] = Kinematics(mechanism)
    model = LinkageModel(mechanism, kinematics=closed[mechanism.ground, points])
    known: dict[float, FloatArray] = {}

    def at(alpha3: float) -> FloatArray:
        if alpha3 not in known:
            known[alpha3] = model.solve(alpha3).natural_frequencies
            highest = max(target.mode for target in targets)
            if highest > len(known[alpha3]):
                raise CalibrationError(
                    f"A target asks for mode {highest}, and the model within a fit has "
                    f"{len(known[alpha3])}; measure a lower one."
                )
        return known[alpha3]

    found = []
    for target in targets:
        k = target.mode - 1
        if isinstance(target.at, str):
            alphas = np.linspace(*mechanism.stroke, STROKE_ANGLES)
            curve = np.array([at(float(alpha3))[k] for alpha3 in alphas])
            found.append(_extreme(alphas, curve, 1.0 if target.at == "highest" else -1.0))
        else:
            found.append(float(at(target.at)[k]))
    return np.array(found)


def _places(calibration: Calibration, values: Sequence[float]) -> list[tuple[str, float]]:
    """List every path that a parameter stands at, with its value."""
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


def _get(mapping: Any, path: str) -> float:
    value = number_at(mapping, path)
    if value <= 0:
        raise MechanismError(f"parameters.{path}", f"{value!r} is not a number above zero.")
    return float(value)


def _coarse(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism with just as fine a mesh as a fit needs."""
    return replace(
        mechanism,
        links=tuple(
            replace(
                link,
                body=replace(link.body, elements=min(link.body.elements, COARSE_ELEMENTS)),
                modes=min(link.modes, COARSE_MODES),
            )
            if isinstance(link.body, Beam)
            else link
            for link in mechanism.links
        ),
    )


def _residuals(
    calibration: Calibration, logs: FloatArray, closed: dict[object, Kinematics] | None = None
) -> FloatArray:
    mechanism = mechanism_from_mapping(apply(calibration, np.exp(logs).tolist()))
    found = natural_frequencies(mechanism, calibration.targets, coarse=True, closed=closed)
    wanted = np.array([target.frequency for target in calibration.targets])
    deviations = np.array([target.deviation for target in calibration.targets])
    return np.asarray(np.log(found / wanted) / deviations)


def _result(
    calibration: Calibration, logs: FloatArray, bound: NDArray[np.bool_]
) -> CalibrationResult:
    step = 1e-4
    columns = []
    for i in range(len(logs)):
        ends = [logs + sign * step * np.eye(len(logs))[i] for sign in (-1.0, 1.0)]
        before, after = (_residuals(calibration, end) for end in ends)
        columns.append((after - before) / (2.0 * step))
    jacobian = np.array(columns).T
    names = [parameter.path for parameter in calibration.parameters]
    free = np.flatnonzero(~bound)
    covariance = np.zeros((len(logs), len(logs)))
    undetermined = []
    if len(free):
        values, directions = np.linalg.svd(jacobian[:, free], full_matrices=True)[1:]
        values = np.pad(values, (0, len(free) - len(values)))
        told = values > 1.0 / UNDETERMINED
        inverse = np.where(told, 1.0 / np.where(told, values, 1.0), 0.0)
        covariance[np.ix_(free, free)] = (directions.T * inverse**2) @ directions
        for direction in directions[~told]:
            members = free[np.abs(direction) > SHARE]
            undetermined.append(tuple(names[i] for i in members))
            covariance[members, members] = np.inf
    mechanism = mechanism_from_mapping(apply(calibration, np.exp(logs).tolist()))
    return CalibrationResult(
        values=np.exp(logs),
        frequencies=natural_frequencies(mechanism, calibration.targets),
        covariance=covariance,
        undetermined=tuple(undetermined),
        on_bound=tuple(names[i] for i in np.flatnonzero(bound)),
    )


def _extreme(alphas: FloatArray, curve: FloatArray, sign: float) -> float:
    """Largest (sign 1) or smallest (-1) value of a curve, by a parabola about the extreme point."""
    top = int((sign * curve).argmax())
    if top in (0, len(curve) - 1):
        return float(curve[top])
    before, here, after = curve[top - 1 : top + 2]
    bend = before - 2.0 * here + after
    return float(here - (after - before) ** 2 / (8.0 * bend)) if bend else float(here)
