# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Names the modes of a table by their kinetic energy over the stroke."""

import math
from dataclasses import replace
from itertools import zip_longest

import numpy as np
from scipy.optimize import linear_sum_assignment

from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.mechanics.mode_names import kinetic_energy, name_modes
from linkage_vibration.mechanics.modes import MECHANISM
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation.sampling import Sampler

_ANGLES = 5  # The energy is computed at so many points of the table.


def with_mode_names(table: Table, sampler: Sampler) -> Table:
    """Return the table with names of its modes, and mean shares of kinetic energy if known."""
    given = sampler.model.mechanism.response.mode_names
    if table.measured:
        both = zip_longest(given[: table.n_modes], range(table.n_modes), fillvalue="")
        return replace(table, mode_names=tuple(new or f"mode {int(k) + 1}" for new, k in both))
    points = np.linspace(0, len(table.alpha3) - 1, _ANGLES).round().astype(np.int64)
    energies = []
    for point in np.unique(points).tolist():
        solution = sampler.solution(float(table.alpha3[point]))
        modes = _same_modes(table.natural_frequencies[point], solution.modes.omega)
        energies.append(kinetic_energy(solution, modes))
    shares = np.mean([energy.shares for energy in energies], axis=0)
    mounts = np.mean([energy.mounts for energy in energies], axis=0)
    mean = replace(energies[0], shares=shares, mounts=mounts)
    shares = mean.group_shares().round(4)
    return replace(table, mode_names=name_modes(mean, given[: table.n_modes]), mode_shares=shares)


def _same_modes(frequencies: FloatArray, omega: FloatArray) -> IntArray:
    """Return which undamped modes (rad/s) tracked ones (Hz) are; overdamped ones get the rest."""
    logs = np.log(np.where(np.isnan(frequencies), np.inf, 2.0 * math.pi * frequencies))
    apart = np.abs(np.subtract.outer(logs, np.log(np.maximum(omega, MECHANISM / 10.0))))
    # Squares keep the order: sums of distances are equal where modes have moved past each other.
    return np.asarray(linear_sum_assignment(np.minimum(apart, 1e3) ** 2)[1])
