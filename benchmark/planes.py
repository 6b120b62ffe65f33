# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Distinguishes modes in the plane of motion from those out of it."""

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray
from linkage_vibration.mechanics.model import Solution


def in_plane(solution: Solution) -> BoolArray:
    """Return which modes of a linkage of beams move in the plane, (n_modes,).

    The two kinds do not mix as long as every link is symmetric about the plane.
    """
    system, lateral = solution.model.system, np.zeros(len(solution.modes.omega))
    for component in system.components:
        shapes = solution.modes.shapes[system.rows[component.name]]
        if component.drawing is None:  # a rigid body, which is held in the plane
            lateral -= (shapes**2).sum(axis=0)
        else:
            squares = ((component.drawing.displacement @ shapes) ** 2).sum(axis=0)
            lateral += squares[1] - squares[0] - squares[2]
    return np.asarray(lateral <= 0.0)
