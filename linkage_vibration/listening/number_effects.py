# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How uncertain numbers change the natural frequencies of a table, by its ensemble."""

import math

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.uncertainty import across, draw_of
from linkage_vibration.table.interpolation import interpolation_matrix, stroke_variable
from linkage_vibration.table.table import Table


class NumberEffects:
    """Changes of ln(frequency) along independent directions of the uncertain numbers.

    A direction is a pair of opposite members of the ensemble, which are as probable as one standard
    deviation; it changes no mode of a half in which it is not known. The table has an ensemble.
    """

    def __init__(self, table: Table) -> None:
        self._table, self._coordinates = table, table.ensemble_coordinates
        self._values = []
        for half in table.halves:
            values = _half_differences(half)
            known = np.isfinite(values).all(axis=(1, 2))
            known &= (half.ensemble_coordinates == self._coordinates).all(axis=1)
            values = np.where(known[:, np.newaxis, np.newaxis], values, 0.0)
            self._values.append(values / math.sqrt(max(int(known.sum()), 1)))

    def at(self, alpha3: FloatArray) -> FloatArray:
        """Return changes by one standard deviation, (n, n_modes, n_directions), at rad, (n,)."""
        parts, at = [], stroke_variable(alpha3, self._table.toggles)
        for half, values in zip(self._table.halves, self._values, strict=True):
            nodes = stroke_variable(half.ensemble_alpha3, half.toggles)
            weights = interpolation_matrix(nodes, at)
            parts.append(np.einsum("an,dnk->adk", weights, values))
        return self._table.listed(parts).swapaxes(1, 2)

    def of_numbers(
        self, mechanism: Mechanism, changes: FloatArray, modes: IntArray
    ) -> dict[str, FloatArray]:
        """Return changes of modes, (n, n_directions), by one deviation of each number alone, (n,).

        Numbers that act across the plane, and those whose draws they follow, change modes of one
        half alone.
        """
        uncertainty = mechanism.uncertainty
        assert uncertainty is not None
        n = len(uncertainty.numbers)
        known = np.maximum(np.count_nonzero(changes, axis=-1, keepdims=True), 1)
        root = np.linalg.cholesky(np.array(uncertainty.correlation).reshape(n, n))
        each = changes / np.sqrt(known) @ self._coordinates @ np.linalg.inv(root)
        lateral, draws = across(uncertainty), draw_of(uncertainty)
        followed = np.isin(draws, draws[lateral]) & ~lateral
        each[np.where(self._table.lateral_modes[modes, np.newaxis], followed, lateral)] = 0.0
        paths = [number.path for number in uncertainty.numbers]
        return dict(zip(paths, np.moveaxis(each, -1, 0), strict=True))


def _half_differences(table: Table) -> FloatArray:
    """Return half of what two opposite members differ, (n_pairs, n_nodes, n_modes), in ln(Hz)."""
    logs = np.log(np.abs(table.ensemble_poles)).astype(float)  # (n_members, n_nodes, k)
    hertz = table.evaluate(table.ensemble_alpha3)[:, : table.n_modes]
    away = np.abs(logs[0][:, :, np.newaxis] - np.log(2.0 * math.pi * hertz)[:, np.newaxis])
    modes = np.nan_to_num(away, nan=math.inf).argmin(axis=1)  # (n_nodes, n_modes), of k
    first, second = np.split(np.take_along_axis(logs, modes[np.newaxis], axis=2)[1:], 2)
    return np.asarray((first - second) / 2.0)
