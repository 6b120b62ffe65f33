# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares modes measured at several heights with a mechanism's, as targets of a calibration.

Every measured mode has a cost: 1 if it is not paired with a mode of the model, and otherwise the
distance, 0 to 1, by frequency and damping ratio. Of the pairings that keep the order of the modes
of each half, that with the lowest sum is taken. A pair is doubtful if the best one without it costs
hardly more.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.mechanics.mode_names import kinetic_energy, name_modes
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.targets import INCLINOMETER, ModelMode, targets_text
from linkage_vibration.studies.ringdown import MeasuredMode

_UNKNOWN = 0.01  # relative deviation of a frequency that one or two decays show
FARTHEST = 1.5  # ratio of the frequencies of a pair: beyond it they are not paired
_SIGMAS = 3.0  # standard deviations at which a distance is 1
_MODEL = math.log(FARTHEST) / _SIGMAS  # standard deviation of log(frequency) of a model
_MODEL_DAMPING = math.log(10.0) / _SIGMAS  # the same of log(damping ratio), which is hardly known
# A pair whose absence costs less is doubtful: an error of the model of 8 % would undo it.
_DOUBT = 0.2
# The same if one of both modes is lateral, for 16 %: chains and tyres across are hardly known.
_DOUBT_ACROSS = 0.4
_EQUAL = 1e-9  # difference of costs that rounding may cause
_FREQUENCY = 0.08  # standard deviation of log(frequency) of a model
_DECAY = math.log(10.0) / 3.0  # the same of log(decay rate), which is hardly known
_POSSIBLE = 2.0  # such deviations between a mode of the model and a measured one, unfolded


class MeasurementError(LinkageVibrationError):
    """Measured modes do not belong to the mechanism."""


@dataclass(frozen=True, slots=True)
class ComparedMode:
    """A measured mode, and the mode of the mechanism to which it belongs."""

    alpha3: float  # rad
    measured: MeasuredMode
    mode: ModelMode | None  # None if it belongs to no mode of the mechanism
    predicted: float  # Hz; NaN if it belongs to none
    deviation: float  # relative standard deviation of the measured frequency
    # If the pair is doubtful: the mode to which it belongs nearly as well, None if to no mode.
    rival: tuple[ModelMode | None, ...] = ()


def compare(
    model: LinkageModel, alpha3: float, measured: Sequence[MeasuredMode]
) -> list[ComparedMode]:
    """Return the measured modes (ascending) at an angle (rad) beside those of a mechanism."""
    every, (predicted, ratios, turned) = _modes(model, alpha3, _steps(model, alpha3))
    spreads = np.array([mode.frequency_stddev / mode.frequency for mode in measured])
    spreads[np.isnan(spreads)] = _UNKNOWN
    deviations = np.hypot(spreads[:, np.newaxis], np.nan_to_num(turned, posinf=0.0))
    lateral = np.array([mode.half == "lateral" for mode in every])
    modes = pair_modes(measured, predicted, ratios, deviations, lateral)
    compared = []
    for i, (mode, (j, *rival)) in enumerate(zip(measured, modes, strict=True)):
        found: tuple[ModelMode | None, float, float] = None, math.nan, math.nan
        if j is not None:
            found = every[j], float(predicted[j]), float(deviations[i, j])
        rivals = tuple(None if k is None else every[k] for k in rival)
        compared.append(ComparedMode(alpha3, mode, *found, rivals))
    return compared


def _modes(
    model: LinkageModel, alpha3: float, steps: Sequence[float] = ()
) -> tuple[list[ModelMode], FloatArray]:
    """Return all modes, ascending, and their Hz, damping ratios and changes by steps, (3, n)."""
    modes, numbers = list[ModelMode](), list[FloatArray]()
    for half in model.halves:
        solution, response = half.solve(alpha3), half.mechanism.response
        beside = [half.solve(alpha3 + step).natural_frequencies for step in steps]
        count = min(map(len, [solution.natural_frequencies, *beside]))
        predicted = solution.natural_frequencies[:count]
        with np.errstate(divide="ignore", invalid="ignore"):  # modes at 0 Hz
            turned = [np.abs(np.log(each[:count] / predicted)) for each in beside]
        worst = np.max([np.zeros(count), *turned], axis=0)
        numbers.append(np.array([predicted, solution.damping_ratios[:count], worst]))
        names = response.mode_names
        if half.mechanism.lateral:
            few = np.arange(min(count, response.modes))
            names = name_modes(kinetic_energy(solution, few), names)
        padded = [*names, *[""] * count][:count]
        modes += [ModelMode(half.half, i, name) for i, name in enumerate(padded)]
    every = np.hstack(numbers)
    order = np.argsort(every[0], kind="stable")
    return [modes[i] for i in order.tolist()], every[:, order]


def _steps(model: LinkageModel, alpha3: float) -> list[float]:
    """Return steps of the deviation of an angle that remain within the stroke, rad."""
    first, last = model.mechanism.stroke
    steps = [step for step in (-INCLINOMETER, INCLINOMETER) if first <= alpha3 + step <= last]
    if not first <= alpha3 <= last or not steps:
        raise MeasurementError(
            f"{math.degrees(alpha3):g} deg is outside the stroke of {model.mechanism.name}, "
            f"{math.degrees(first):g} to {math.degrees(last):g} deg; give alpha3 in degrees."
        )
    return steps


def calibration_text(modes: Sequence[ComparedMode], mechanism: Path, output: Path) -> str:
    """Return the text of a calibration to measured modes that belong to one mode for sure.

    Recordings at one angle share its error, so of each mode there only the surest one is a target.
    """
    known = [each for each in modes if each.mode is not None and not each.rival]
    best = {(each.mode, each.alpha3): each for each in sorted(known, key=lambda x: -x.deviation)}
    targets = [
        (each.mode, each.alpha3, each.measured.frequency, each.deviation)
        for each in known
        if each.mode is not None and each is best[each.mode, each.alpha3]
    ]
    if not targets:
        problem = f"No measured frequency is within a factor of {FARTHEST:g} of one mode alone"
        hint = "check the angles, and the masses and springs of the mechanism"
        raise MeasurementError(f"{problem}; {hint}.")
    return targets_text(targets, mechanism, output, "recordings of blows")


def comparison_table(modes: Sequence[ComparedMode]) -> str:
    """Return a table of measured modes beside the mechanism's."""
    lines = [
        f"{'alpha3 [deg]':>12}{'measured [Hz]':>22}{'damping ratio':>20}{'blows':>7}"
        f"{'model [Hz]':>12}  mode"
    ]
    for each in modes:
        measured = each.measured
        label = str(each.mode or "belongs to no mode of the model")
        for rival in each.rival:
            label += f", or {rival or 'no mode'}: not a target"
        lines.append(
            f"{math.degrees(each.alpha3):12.2f}"
            f"{_with_deviation(measured.frequency, measured.frequency_stddev, 3):>22}"
            f"{_with_deviation(measured.ratio, measured.ratio_stddev, 4):>20}{measured.decays:7d}"
            f"{each.predicted:12.3f}  {label}"
        )
    return "\n".join(lines)


def _with_deviation(value: float, deviation: float, digits: int) -> str:
    text = "unknown" if math.isnan(deviation) else f"{deviation:.{digits}f}"
    return f"{value:.{digits}f} +- {text}"


def angle_and_path(word: str) -> tuple[float, Path]:
    """Return the angle (rad) and the file of a word such as ``112.5:low.mcap``."""
    angle, _, path = word.partition(":")
    try:
        alpha3 = math.radians(float(angle))
    except ValueError:
        alpha3 = math.nan
    if not path or not math.isfinite(alpha3):
        raise MeasurementError(f"{word}: write ANGLE:FILE, such as 112.5:low.csv.")
    return alpha3, Path(path)


def pair_modes(
    measured: Sequence[MeasuredMode],
    frequencies: FloatArray,
    damping_ratios: FloatArray,
    deviations: FloatArray,
    lateral: BoolArray,  # (n_modes,), which modes of the model are of the lateral half
) -> list[tuple[int | None, ...]]:
    """Return the mode of the model (from 0) of each measured mode, None if it has none.

    In a doubtful pair, the other possible mode follows. Frequencies, Hz, ascend; `lateral` modes
    are of that half; deviations, (n_measured, n_modes), are relative. Most pairs, lowest modes win.
    """
    hz, ratios, spreads = np.array(
        [(mode.frequency, mode.ratio, mode.ratio_stddev / mode.ratio) for mode in measured]
    ).reshape(-1, 3, 1).transpose(1, 0, 2)  # fmt: skip
    away = np.abs(np.log(hz / np.maximum(frequencies, 1e-3)))
    permitted = away <= math.log(FARTHEST) + _EQUAL
    with np.errstate(divide="ignore", invalid="ignore"):  # log(0), undamped
        damping = np.abs(np.log(ratios / damping_ratios))
    damping = np.where(np.isfinite(damping), damping, 0.0)  # a model without damping
    damping /= _SIGMAS * np.hypot(_MODEL_DAMPING, np.nan_to_num(spreads))
    distance = np.hypot(away / (_SIGMAS * np.hypot(_MODEL, deviations)), damping)
    # The cost of each pair, (n_measured, n_modes): 0 to 1, infinite if it is not permitted.
    costs = np.where(permitted, np.minimum(distance, 1.0), math.inf)
    halves = lateral.astype(int).tolist()
    lowest, pairs = _pairing(costs, halves)
    modes: list[tuple[int | None, ...]] = [(j,) for j in pairs]
    for i, j in enumerate(pairs):
        if j is not None:
            others = costs.copy()
            others[i, j] = math.inf
            cost, rivals = _pairing(others, halves)
            rival = rivals[i]
            across = rival is not None and (halves[rival] or halves[j])
            modes[i] += (rival,) * (cost - lowest < (_DOUBT_ACROSS if across else _DOUBT))
    return modes


def _pairing(costs: FloatArray, halves: list[int]) -> tuple[float, tuple[int | None, ...]]:
    """Return cost and modes of the best pairing that keeps the order of each half, 0 or 1."""
    rows = costs.tolist()

    @cache
    def best(i: int, first: tuple[int, int]) -> tuple[float, tuple[int | None, ...]]:
        """Return the same of measured modes from i, with modes of each half from the first on."""
        if i == len(rows):
            return 0.0, ()
        choices = list[tuple[float, tuple[int | None, ...]]]()
        for j, (cost, half) in enumerate(zip(rows[i], halves, strict=True)):
            if j >= first[half] and cost <= 1.0:
                after = (first[0], j + 1) if half else (j + 1, first[1])
                later, modes = best(i + 1, after)
                choices.append((cost + later, (j, *modes)))
        later, modes = best(i + 1, first)
        choices.append((1.0 + later, (None, *modes)))
        lowest = min(cost for cost, _ in choices)
        equal = [choice for choice in choices if choice[0] <= lowest + _EQUAL]
        return max(equal, key=lambda choice: len(choice[1]) - choice[1].count(None))  # the first

    return best(0, (0, 0))


def doubt_folds(
    measured: Sequence[MeasuredMode], model: LinkageModel, alpha3: float, rate: float
) -> list[MeasuredMode]:
    """Return measured modes, with a doubt where a mode of the model may be folded; rate in Hz.

    Without an anti-aliasing filter, a mode at f above half the sampling rate appears at
    abs(f - k rate), with the same decay rate.
    """
    every, (frequencies, ratios, _) = _modes(model, alpha3)
    doubted = []
    for mode in measured:
        folds = possible_folds(mode, frequencies, ratios, rate)
        names = " or ".join(f"{every[i]} ({frequencies[i]:.4g} Hz)" for i in folds)
        doubt = f"it may be {names} of the model, folded at {rate:.4g} samples a second"
        doubted.append(replace(mode, doubt=mode.doubt or doubt) if folds else mode)
    return doubted


def possible_folds(
    mode: MeasuredMode, frequencies: FloatArray, ratios: FloatArray, rate: float
) -> list[int]:
    """Return which modes of a model (from 0; Hz and damping ratios) may appear as a mode."""
    high = np.flatnonzero((frequencies > 0.5 * rate) & (ratios > 0.0) & (ratios < 1.0))
    turns = np.round(frequencies[high] / rate)
    beside = np.array(
        [(turns + k) * rate + s * mode.frequency for k in (-1, 0, 1) for s in (-1, 1)]
    )
    away = np.log(np.where(beside > 0.5 * rate, beside, math.inf) / frequencies[high])
    decays = np.log(mode.ratio * mode.frequency / (ratios * frequencies)[high])
    distance = np.hypot(np.abs(away).min(axis=0, initial=math.inf) / _FREQUENCY, decays / _DECAY)
    return [int(i) for i in high[distance < _POSSIBLE]]
