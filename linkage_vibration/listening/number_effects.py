# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How uncertain numbers change the natural frequencies of a table, by its ensemble."""

import math

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.table.interpolation import interpolation_matrix, stroke_variable
from linkage_vibration.table.table import Table


class NumberEffects:
    """Changes of ln(frequency) along independent directions of the uncertain numbers.

    A direction is a pair of opposite members of the ensemble, which are as probable as one standard
    deviation. The table has an ensemble.
    """

    def __init__(self, table: Table) -> None:
        self._nodes = stroke_variable(table.ensemble_alpha3, table.toggles)
        self._toggles, self._coordinates = table.toggles, table.ensemble_coordinates
        logs = np.log(np.abs(table.ensemble_poles)).astype(float)  # (n_members, n_nodes, k)
        hertz = table.evaluate(table.ensemble_alpha3)[:, : table.n_modes]
        away = np.abs(logs[0][:, :, np.newaxis] - np.log(2.0 * math.pi * hertz)[:, np.newaxis])
        modes = np.nan_to_num(away, nan=math.inf).argmin(axis=1)  # (n_nodes, n_modes), of k
        first, second = np.split(np.take_along_axis(logs, modes[np.newaxis], axis=2)[1:], 2)
        half = (first - second) / 2.0
        self._known = np.isfinite(half).all(axis=(1, 2))
        self._values = half[self._known] / math.sqrt(max(int(self._known.sum()), 1))

    def at(self, alpha3: FloatArray) -> FloatArray:
        """Return changes by one standard deviation, (n, n_modes, n_directions), at rad, (n,)."""
        weights = interpolation_matrix(self._nodes, stroke_variable(alpha3, self._toggles))
        return np.asarray(np.einsum("an,dnk->akd", weights, self._values))

    def of_numbers(self, mechanism: Mechanism, changes: FloatArray) -> dict[str, FloatArray]:
        """Return changes, (..., n_directions), by one standard deviation of each number alone."""
        uncertainty = mechanism.uncertainty
        assert uncertainty is not None
        n = len(uncertainty.numbers)
        directions = self._coordinates[self._known] / math.sqrt(int(self._known.sum()))
        root = np.linalg.cholesky(np.array(uncertainty.correlation).reshape(n, n))
        each = changes @ directions @ np.linalg.inv(root)
        paths = [number.path for number in uncertainty.numbers]
        return dict(zip(paths, np.moveaxis(each, -1, 0), strict=True))
