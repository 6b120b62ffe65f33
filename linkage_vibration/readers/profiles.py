# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads measured profiles of a road or a field from CSV files."""

from pathlib import Path

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.ground import profile_spectrum
from linkage_vibration.readers.recordings import RecordingError, read_numbers

_COLUMNS = 2, 3  # the distance, and the height of one track or of two
_FEWEST = 256  # samples
_LONGEST, _SMOOTH = 1e9, 1e-12  # m, and of the largest number
_LINE = 5.0  # of the density beside it: random profiles stay below 3.2
_GAP = 3.0  # of the median distance between samples


class ProfileError(LinkageVibrationError):
    """A profile cannot be used."""


def read_profile(path: Path) -> tuple[FloatArray, FloatArray]:
    """Return distances, (n,), ascending, and heights, (n,), both in m.

    The columns of the file are the distance, the height, and that of the other track, if it was
    measured. An axle feels the mean of both tracks.
    """
    try:
        table = read_numbers(path)
    except RecordingError as error:
        raise ProfileError(str(error)) from None
    problem = _problem(table)
    if problem:
        raise ProfileError(f"{path}: {problem}")
    return table[:, 0], table[:, 1:].mean(axis=1)


def _problem(table: FloatArray) -> str:
    """Return what is wrong with a profile and how to fix it; empty if nothing is."""
    n, columns = table.shape
    if columns not in _COLUMNS:
        return (
            f"has {columns} columns; give the distance, the height and, if it was measured, that "
            "of the other track, in m."
        )
    if n < _FEWEST:
        return f"has {n} samples; give at least {_FEWEST}, for a spectrum."
    lost = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(lost):
        return f"sample {lost[0] + 1} is not finite; give a number, or the part without gaps."
    distance = table[:, 0]
    steps = np.diff(distance)
    back = np.flatnonzero(steps <= 0.0)
    if len(back):
        return (
            f"the distance of {distance[back[0] + 1]:g} m follows {distance[back[0]]:g} m; sort "
            "the samples by distance, and give each distance once."
        )
    gap = int(steps.argmax())
    if steps[gap] > _GAP * np.median(steps):
        return (
            f"there is a gap from {distance[gap]:g} m to {distance[gap + 1]:g} m; give a part "
            "without gaps."
        )
    if np.abs(table).max() > _LONGEST:
        return f"a number is beyond {_LONGEST:g}; distances and heights are in m."
    heights = table[:, 1:].mean(axis=1)
    straight = np.polyval(np.polyfit(distance - distance[0], heights, 1), distance - distance[0])
    if not np.ptp(heights - straight) > _SMOOTH * (1.0 + np.abs(table).max()):
        whose = "mean of both heights" if columns == max(_COLUMNS) else "height"
        return f"the {whose} is a straight line, so it has no spectrum; give a measured profile."
    at, density = np.array(profile_spectrum(distance, heights)).T
    with np.errstate(all="ignore"):
        height = density[2:-2] / np.sqrt(density[:-4] * density[4:])
    most = int(height.argmax())
    if height[most] > _LINE:
        return (
            f"waves of about {1.0 / at[2 + most]:.3g} m repeat evenly, for which a spectrum of "
            "random waves gives a wrong level; give them as an order with `base_displacement`, and "
            "a profile without them."
        )
    return ""
