# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes and FRF peaks of many variants of a mechanism."""

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from linkage_vibration.errors import LinkageVibrationError, check_type
from linkage_vibration.mechanics.arrays import FloatArray, Reals, real_numbers
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.support.conversions import import_xarray
from linkage_vibration.support.progress import Map, gathered

UNITS = {
    "natural_frequencies": "Hz",
    "damping_ratios": "1",
    "frf_peak_frequency": "Hz",
    "frf_peak_magnitude": "m/N",
}
_Row = tuple[FloatArray, FloatArray, float, float]  # one of each quantity of UNITS


def sweep(
    mechanism: Mechanism, values: Mapping[str, Reals], angles: Reals, *, map: Map = map
) -> Any:
    """Solve every combination of values of numbers at some angles.

    Parameters
    ----------
    mechanism : Mechanism
        As `read_mechanism` returns it.
    values : mapping of str to sequence of float
        The values of each number, by its path in the mechanism file, such as
        ``rigid_bodies.implement.mass``. Paths joined by commas share their values.
    angles : array_like, (n,)
        alpha3, rad.
    map : callable
        Python's own `map`, that of a process pool, or that of a Dask client; one call of it solves
        one combination at all angles.

    Returns
    -------
    xarray.Dataset
        With a dimension for each path, and the dimensions ``alpha3`` and ``mode``: natural
        frequencies (Hz, ascending), damping ratios (1), and the highest peak of the FRF within the
        band (Hz, m/N). Where a combination has no solution they are NaN, and ``problem`` says why.

    Raises
    ------
    LinkageVibrationError
        If xarray is not installed, a path or an angle is wrong, or no combination has a solution.
    """
    check_type(mechanism, "read the file with `read_mechanism`", Mechanism)
    check_type(values, "give the values of each number by its path", Mapping)
    xarray = import_xarray()
    axes = {path: np.atleast_1d(real_numbers(numbers, path)) for path, numbers in values.items()}
    alpha3 = np.atleast_1d(real_numbers(angles, "angles"))
    combinations = list(itertools.product(*(axis.tolist() for axis in axes.values())))
    if not combinations or not len(alpha3):
        raise LinkageVibrationError("There is nothing to solve; give values and angles.")
    solve = partial(_solved, mechanism, tuple(axes), alpha3)
    found = gathered(map(solve, combinations), len(combinations))
    problems = [problem for _, problem in found]
    if all(problems):
        raise LinkageVibrationError(f"No combination has a solution; the first: {problems[0]}")
    shape = (*(len(axis) for axis in axes.values()), len(alpha3))
    columns: dict[str, Any] = {}
    for i, (name, unit) in enumerate(UNITS.items()):
        data = np.array([[row[i] for row in rows] for rows, _ in found])
        dimensions = [*axes, "alpha3", "mode"][: len(axes) + data.ndim - 1]
        columns[name] = dimensions, data.reshape(*shape, *data.shape[2:]), {"units": unit}
    columns["problem"] = list(axes), np.array(problems).reshape(shape[:-1])
    modes = np.arange(1, 1 + mechanism.response.modes)
    return xarray.Dataset(columns, coords={**axes, "alpha3": alpha3, "mode": modes})


def _solved(
    mechanism: Mechanism, paths: Sequence[str], angles: FloatArray, numbers: Sequence[float]
) -> tuple[list[_Row], str]:
    """Return the modes and the FRF peak at each angle, and why there are none."""
    n = mechanism.response.modes
    try:
        model = LinkageModel(mechanism.with_values(dict(zip(paths, numbers, strict=True))))
        return [_row(model, alpha3) for alpha3 in angles.tolist()], ""
    except LinkageVibrationError as error:
        unknown = np.full(n, math.nan)
        return [(unknown, unknown, math.nan, math.nan)] * len(angles), str(error)


def _row(model: LinkageModel, alpha3: float) -> _Row:
    """Return the lowest modes, NaN where there are fewer, and the FRF peak at an angle, rad."""
    measured = model.measured_frequencies is not None
    solution = model.identify(alpha3) if measured else model.solve(alpha3)
    response = model.mechanism.response
    frequencies = solution.natural_frequencies
    modes = np.full((2, response.modes), math.nan)
    oscillating = np.flatnonzero(frequencies > 0.0)[: response.modes]  # not those of a mechanism
    modes[:, : len(oscillating)] = (frequencies[oscillating], solution.damping_ratios[oscillating])
    peak = solution.peak(response.peak_band)
    return *modes, peak.frequency, peak.magnitude
