# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Derivatives of what joins the links with respect to the input angle, by central differences."""

from collections.abc import Sequence

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.model import LinkageModel, Place, Solution

STEP = 1e-4  # rad; the differences are within about 1e-8 of the derivatives


def joining_rates(model: LinkageModel, alpha3: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return d/d(alpha3) of the compatibility, the elongation and the stiffness in `Joining`."""
    angles = alpha3 - STEP, alpha3 + STEP
    low, high = (model.interface.join(model.kinematics.at(angle)) for angle in angles)
    return (
        (high.compatibility - low.compatibility) / (2.0 * STEP),
        (high.elongation - low.elongation) / (2.0 * STEP),
        (high.stiffness - low.stiffness) / (2.0 * STEP),
    )


def row_rates(model: LinkageModel, places: Sequence[Place], alpha3: float) -> FloatArray:
    """Return d/d(alpha3) of the rows of places, (n_places, n)."""
    angles = alpha3 - STEP, alpha3 + STEP
    low, high = (model.rows(places, model.kinematics.at(angle)) for angle in angles)
    return np.asarray((high - low) / (2.0 * STEP))


def undamped_slopes(solution: Solution) -> FloatArray:
    """Return d(undamped natural frequency)/d(alpha3), (n_modes,), Hz/rad; NaN for a mechanism."""
    at = solution.configuration
    step = min(STEP, 1e-3 * at.toggle_distance)
    low, high = (solution.model.solve(at.alpha3 + side).modes.omega for side in (-step, step))
    slopes = (high - low) / (4.0 * np.pi * step)
    return np.where(solution.modes.mechanism, np.nan, slopes)
