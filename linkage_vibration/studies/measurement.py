# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares modes measured at several heights with a mechanism's, as targets of a calibration."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.optimize import linear_sum_assignment

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.paths import number_at
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.studies.ringdown import MeasuredMode

_FARTHEST = math.log(1.5)  # from a measured frequency to the model's
_INCLINOMETER = math.radians(0.5)  # standard deviation of an angle
_UNKNOWN = 0.01  # relative deviation of a frequency that one or two decays show
_BOUNDS = 3.0  # from a number of the mechanism to its bounds in the calibration


class MeasurementError(LinkageVibrationError):
    """Measured modes do not belong to the mechanism."""


@dataclass(frozen=True, slots=True)
class Found:
    """A measured mode, and the mode of the mechanism that is nearest."""

    alpha3: float  # rad
    measured: MeasuredMode
    mode: int | None  # from 0; None if no mode of the mechanism is near
    predicted: float  # Hz; NaN if none is near
    deviation: float  # relative standard deviation of the measured frequency


def compare(model: LinkageModel, alpha3: float, measured: Sequence[MeasuredMode]) -> list[Found]:
    """Return the measured modes at an angle with those of a mechanism that are nearest.

    Parameters
    ----------
    model, alpha3
        The mechanism, and the angle, rad.
    measured : sequence of MeasuredMode
        Ascending.
    """
    steps = _steps(model, alpha3)
    predicted = model.solve(alpha3).natural_frequencies
    beside = [model.solve(alpha3 + step).natural_frequencies for step in steps]
    own = np.array([mode.frequency for mode in measured])
    count = min(len(predicted), *map(len, beside), int((predicted < 2.0 * own.max()).sum()))
    away = np.abs(np.log(own[:, np.newaxis] / np.maximum(predicted[:count], 1e-3)))
    pairs = dict(zip(*(each.tolist() for each in linear_sum_assignment(away)), strict=True))
    found = []
    for i, mode in enumerate(measured):
        j = pairs.get(i)
        if j is None or away[i, j] > _FARTHEST:
            found.append(Found(alpha3, mode, None, math.nan, math.nan))
            continue
        turned = max(abs(math.log(each[j] / predicted[j])) for each in beside)
        spread = mode.frequency_stddev / mode.frequency
        noise = _UNKNOWN if math.isnan(spread) else spread
        found.append(Found(alpha3, mode, j, float(predicted[j]), math.hypot(noise, turned)))
    return found


def _steps(model: LinkageModel, alpha3: float) -> list[float]:
    """Return steps of the deviation of an angle that remain within the stroke, rad."""
    first, last = model.mechanism.stroke
    steps = [step for step in (-_INCLINOMETER, _INCLINOMETER) if first <= alpha3 + step <= last]
    if not first <= alpha3 <= last or not steps:
        raise MeasurementError(
            f"{math.degrees(alpha3):g} deg is outside the stroke of {model.mechanism.name}, "
            f"{math.degrees(first):g} to {math.degrees(last):g} deg; give alpha3 in degrees."
        )
    return steps


def calibration_text(found: Sequence[Found], mechanism: Path, output: Path) -> str:
    """Return the text of a calibration that fits the rigid bodies to measured modes.

    Parameters
    ----------
    found : sequence of Found
        At all heights.
    mechanism, output : Path
        The mechanism to start from, and the calibration that will be written.

    Raises
    ------
    MeasurementError
        If no measured mode is near one of the mechanism.
    """
    targets = [
        {
            "mode": each.mode + 1,
            "at_deg": round(math.degrees(each.alpha3), 6),
            "hz": float(f"{each.measured.frequency:.7g}"),
            "deviation": float(f"{each.deviation:.3g}"),
        }
        for each in found
        if each.mode is not None
    ]
    if not targets:
        raise MeasurementError(
            "No measured frequency is within a factor of 1.5 of a mode of the mechanism; check "
            "the angles, and the masses and springs of the mechanism."
        )
    mapping = load_yaml(mechanism)[0]
    content = {
        "mechanism": os.path.relpath(mechanism, output.resolve().parent),
        "parameters": _rigid_numbers(mapping),
        "targets": targets,
    }
    head = "# Made from recordings of blows. The parameters and their bounds are yours to choose.\n"
    return head + yaml.safe_dump(content, sort_keys=False)


def _rigid_numbers(mapping: dict[str, Any]) -> dict[str, list[float]]:
    """Return the masses and moments of inertia of the rigid bodies, with wide bounds."""
    bodies = mapping.get("rigid_bodies", {})
    paths = [f"rigid_bodies.{name}.{key}" for name in bodies for key in ("mass", "inertia")]
    numbers = {path: float(number_at(mapping, path)) for path in paths}
    return {path: [value / _BOUNDS, value * _BOUNDS] for path, value in numbers.items()}


def summary(found: Sequence[Found], names: Sequence[str]) -> str:
    """Return a table of measured modes beside the mechanism's.

    Parameters
    ----------
    found : sequence of Found
    names : sequence of str
        Of the mechanism's modes, from the first; further modes have numbers alone.
    """
    lines = [
        f"{'alpha3 [deg]':>12}{'measured [Hz]':>22}{'damping ratio':>20}{'blows':>7}"
        f"{'model [Hz]':>12}  mode"
    ]
    for each in found:
        own = each.measured
        label = "no mode of the model is near" if each.mode is None else f"mode {each.mode + 1}"
        if each.mode is not None and each.mode < len(names):
            label += f" ({names[each.mode]})"
        lines.append(
            f"{math.degrees(each.alpha3):12.2f}"
            f"{_with_deviation(own.frequency, own.frequency_stddev, 3):>22}"
            f"{_with_deviation(own.ratio, own.ratio_stddev, 4):>20}{own.decays:7d}"
            f"{each.predicted:12.3f}  {label}"
        )
    return "\n".join(lines)


def _with_deviation(value: float, deviation: float, digits: int) -> str:
    known = "unknown" if math.isnan(deviation) else f"{deviation:.{digits}f}"
    return f"{value:.{digits}f} +- {known}"


def angle_and_path(word: str) -> tuple[float, Path]:
    """Return the angle (rad) and the file of a word such as ``112.5:low.mcap``.

    Raises
    ------
    MeasurementError
        If it has another form.
    """
    angle, _, path = word.partition(":")
    try:
        alpha3 = math.radians(float(angle))
    except ValueError:
        alpha3 = math.nan
    if not path or not math.isfinite(alpha3):
        raise MeasurementError(f"{word}: write ANGLE:FILE, such as 112.5:low.csv.")
    return alpha3, Path(path)
