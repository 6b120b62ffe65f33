# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The factors of levels at any angles and speeds, as messages have them."""

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.levels import DEVIATION_FIELDS, LevelTable


def level_factors(
    levels: LevelTable, alpha3: FloatArray, speeds: FloatArray, limit: float
) -> dict[str, FloatArray]:
    """Return the `DEVIATION_FIELDS` at n angles and speeds, (n_sources, n), by their names."""
    columns, every = levels.at(alpha3, speeds), range(len(alpha3))
    columns.crank_angle, columns.speeds = alpha3, speeds.T
    levels.set_factors(columns, every, [1 + i for i in every], np.empty((1, 0)), limit)
    return {name: getattr(columns, name) for name in DEVIATION_FIELDS}
