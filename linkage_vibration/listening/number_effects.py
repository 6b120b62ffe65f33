# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How uncertain numbers change the natural frequencies of a table, by its ensemble."""

import math

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.uncertainty import across
from linkage_vibration.table.interpolation import interpolation_matrix, stroke_variable
from linkage_vibration.table.table import Table


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
