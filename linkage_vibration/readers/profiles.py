# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads measured profiles of a road or a field from CSV files."""

from pathlib import Path

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.ground import Spectrum, profile_spectrum
from linkage_vibration.readers.recordings import RecordingError, read_numbers

_COLUMNS = 2, 3  # the distance, and the height of one track or of two
_FEWEST = 256  # samples
_LONGEST, _SMOOTH = 1e9, 1e-12  # m, and of the largest number
_LINE = 5.0  # of the density beside it: random profiles stay below 3.2
_GAP = 3.0  # of the median distance between samples


def read_spectra(path: Path) -> tuple[Spectrum, Spectrum | None]:
    """Return the spectrum of a profile; of two tracks those of the mean and half the difference."""
    distance, *parts = read_profile(path)
    first, *second = [profile_spectrum(distance, part) for part in parts]
    return first, second[0] if second else None


def read_profile(path: Path) -> list[FloatArray]:
    """Return distances, ascending, and heights, or two means and half differences, each (n,), m."""
    table = read_numbers(path)
    if problem := _problem(table):
        raise RecordingError(f"{path}: {problem}")
    return [table[:, 0], *_parts(table)]


def _parts(table: FloatArray) -> list[FloatArray]:
    """Return the heights of one track, or the mean and half the difference of two, each (n,)."""
    left, right = table[:, 1], table[:, -1]
    return [table[:, 1:].mean(axis=1), (left - right) / 2.0][: table.shape[1] - 1]


def _problem(table: FloatArray) -> str:
    """Return what is wrong with a profile and how to fix it; empty if nothing is."""
    n, columns = table.shape
    if columns not in _COLUMNS:
        hint = "give the distance, the height and, if it was measured, that of the other track"
        return f"has {columns} columns; {hint}, in m."
    if n < _FEWEST:
        return f"has {n} samples; give at least {_FEWEST}, for a spectrum."
    lost = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(lost):
        return f"sample {lost[0] + 1} is not finite; give a number, or the part without gaps."
    distance = table[:, 0]
    steps = np.diff(distance)
    back = np.flatnonzero(steps <= 0.0)
    if len(back):
        problem = f"the distance of {distance[back[0] + 1]:g} m follows {distance[back[0]]:g} m"
        return f"{problem}; sort the samples by distance, and give each distance once."
    gap = int(steps.argmax())
    if steps[gap] > _GAP * np.median(steps):
        problem = f"there is a gap from {distance[gap]:g} m to {distance[gap + 1]:g} m"
        return f"{problem}; give a part without gaps."
    if np.abs(table).max() > _LONGEST:
        return f"a number is beyond {_LONGEST:g}; distances and heights are in m."
    names = ["height"] if columns == 2 else ["mean of both heights", "difference of both heights"]
    for whose, heights in zip(names, _parts(table), strict=True):
        line = np.polyval(np.polyfit(distance - distance[0], heights, 1), distance - distance[0])
        if not np.ptp(heights - line) > _SMOOTH * (1.0 + np.abs(table).max()):
            hint = "give measured profiles of one track or of two"
            return f"the {whose} is a straight line, so it has no spectrum; {hint}."
    at, density = np.array(profile_spectrum(distance, _parts(table)[0])).T
    with np.errstate(divide="ignore", invalid="ignore"):  # a spectrum of zeros
        height = density[2:-2] / np.sqrt(density[:-4] * density[4:])
    most = int(height.argmax())
    if height[most] > _LINE:
        why = "for which a spectrum of random waves gives a wrong level"
        hint = "give them as an order with `base_displacement`, and a profile without them"
        return f"waves of about {1.0 / at[2 + most]:.3g} m repeat evenly, {why}; {hint}."
    return ""
