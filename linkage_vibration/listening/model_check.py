# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the modes of a drive say about a model: differences, what may explain them, and targets."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.listening.drive_modes import DriveMode
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.uncertainty import across
from linkage_vibration.readers.targets import HALVES, ModelMode, targets_text
from linkage_vibration.table.interpolation import interpolation_matrix, stroke_variable
from linkage_vibration.table.table import Table

WARNING = (
    "These are suggestions: other numbers, or another form of the model, may explain the same "
    "difference. Measure the number before you change it."
)


class DriveError(LinkageVibrationError):
    """A drive has nothing that can be written."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """An uncertain number whose change alone brings the predictions nearer to what was measured."""

    path: str  # in the description
    change: float  # most probable, in standard deviations that the description states
    left: float  # share of the squared differences that it leaves, with the change's own, 1


def explanations(
    table: Table, mechanism: Mechanism, modes: Iterable[DriveMode]
) -> tuple[Explanation, ...]:
    """Return the uncertain numbers by what they explain of the differences, the best first.

    Doubtful modes do not count. A difference is weighted by the measured deviation alone, and a
    change of the number costs its square, in standard deviations.
    """
    sure = [mode for mode in modes if not mode.doubt]
    known = all(len(half.ensemble_alpha3) for half in table.halves)
    if mechanism.uncertainty is None or not known or not sure:
        return ()
    effects = number_effects(table, mechanism, np.array([mode.alpha3 for mode in sure]))
    rates = effects[:, range(len(sure)), [mode.mode for mode in sure]]  # (n_numbers, n_sure)
    weights = 1.0 / np.array([mode.deviation for mode in sure])
    apart = weights * np.log([mode.frequency / mode.predicted for mode in sure])
    weighted = rates * weights
    shifts = weighted @ apart / (1.0 + (weighted**2).sum(axis=1))
    left = 1.0 - shifts * (weighted @ apart) / (apart @ apart)
    paths = [number.path for number in mechanism.uncertainty.numbers]
    order = np.argsort(left, kind="stable").tolist()
    return tuple(Explanation(paths[i], float(shifts[i]), float(left[i])) for i in order)


def number_effects(table: Table, mechanism: Mechanism, alpha3: FloatArray) -> FloatArray:
    """Return changes of ln(frequency) by one deviation of each number, (n_numbers, n, n_modes).

    They are least squares over the members of the table's ensemble, interpolated to rad, (n,).
    Numbers that act across the plane change modes of the lateral half alone.
    """
    uncertainty, parts = mechanism.uncertainty, []
    assert uncertainty is not None
    n, at = len(uncertainty.numbers), stroke_variable(alpha3, table.toggles)
    root = np.linalg.cholesky(np.array(uncertainty.correlation).reshape(n, n))
    for half in table.halves:
        rows, solved = np.insert(half.ensemble_coordinates @ root.T, 0, 1.0, axis=1), []
        for logs in _logarithms(half):
            known = np.isfinite(logs).all(axis=1)
            solved.append(np.linalg.lstsq(rows[known], logs[known], rcond=None)[0][1:])
        effects = np.stack(solved, axis=1)
        if half is table.vertical:
            effects[across(uncertainty)] = 0.0
        weights = interpolation_matrix(stroke_variable(half.ensemble_alpha3, half.toggles), at)
        parts.append(np.einsum("an,dnk->dak", weights, effects))
    return np.asarray(table.listed(parts))


def _logarithms(table: Table) -> FloatArray:
    """Return ln(rad/s) of the modes of the members, (n_nodes, n_members, n_modes)."""
    logs = np.log(np.abs(table.ensemble_poles)).astype(float)  # (n_members, n_nodes, k)
    hertz = table.evaluate(table.ensemble_alpha3)[:, : table.n_modes]
    away = np.abs(logs[0][:, :, np.newaxis] - np.log(2.0 * math.pi * hertz)[:, np.newaxis])
    modes = np.nan_to_num(away, nan=math.inf).argmin(axis=1)  # (n_nodes, n_modes), of k
    return np.take_along_axis(logs, modes[np.newaxis], axis=2)[1:].swapaxes(0, 1)


def difference_text(mode: DriveMode, name: str) -> str:
    """Return a sentence about a mode with a name, in degrees and hertz."""
    what = f"The {name} at {math.degrees(mode.alpha3):.1f} deg"
    if mode.doubt:
        return f"{what}, {mode.frequency:.3f} Hz, is doubtful: {mode.doubt}."
    percent = 100.0 * (mode.frequency / mode.predicted - 1.0)
    side = "lower" if percent < 0.0 else "higher"
    apart = f"{what} is {abs(percent):.1f} % {side} than predicted"
    return f"{apart}, {mode.frequency:.3f} +- {mode.frequency_stddev:.3f} Hz: {verdict(mode)}."


def verdict(mode: DriveMode) -> str:
    """Return in words whether a mode is consistent, or why that is not known."""
    if mode.doubt:
        return f"not known, because {mode.doubt}"
    if mode.consistent is None:
        return "not known, because the deviation of the prediction is not known"
    apart = f"{abs(mode.difference):.1f} standard deviations"
    return f"{'consistent' if mode.consistent else 'not consistent'}, {apart}"


def drive_targets(modes: Sequence[DriveMode], table: Table, mechanism: Path, output: Path) -> str:
    """Return the text of a calibration to the modes without doubts, counted as they ascend."""
    targets = []
    for each in modes:
        if not each.doubt:
            every = table.evaluate(np.array([each.alpha3]))[0, : table.n_modes]
            lateral = table.lateral_modes[each.mode]
            rank = int((every[table.lateral_modes == lateral] < every[each.mode]).sum())
            mode = ModelMode(HALVES[int(lateral)], rank)
            targets.append((mode, each.alpha3, each.frequency, each.deviation))
    if not targets:
        text = "no mode of the drive is without doubt, so there is no target"
        raise DriveError(f"{output}: {text}; drive longer, or elsewhere, or leave out --targets.")
    return targets_text(targets, mechanism, output, "a drive")
