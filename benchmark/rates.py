# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Derivatives of what joins the links with respect to the input angle, by central differences."""

from collections.abc import Callable, Sequence

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.model import LinkageModel, Place, Solution

STEP = 1e-4  # rad


def rate(values: Callable[[float], FloatArray], alpha3: float, step: float = STEP) -> FloatArray:
    """Return d(values)/d(alpha3); with half of the step, too, so that its square cancels."""
    whole, half = (
        (values(alpha3 + h) - values(alpha3 - h)) / (2.0 * h) for h in (step, step / 2.0)
    )
    return np.asarray((4.0 * half - whole) / 3.0)


def joining_rates(model: LinkageModel, alpha3: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return d/d(alpha3) of the compatibility, the elongation and the stiffness in `Joining`."""

    def of(name: str) -> FloatArray:
        return rate(
            lambda angle: getattr(model.interface.join(model.kinematics.at(angle)), name), alpha3
        )

    return of("compatibility"), of("elongation"), of("stiffness")


def row_rates(model: LinkageModel, places: Sequence[Place], alpha3: float) -> FloatArray:
    """Return d/d(alpha3) of the rows of places, (n_places, n)."""
    return rate(lambda angle: model.rows(places, model.kinematics.at(angle)), alpha3)


def undamped_slopes(solution: Solution) -> FloatArray:
    """Return d(undamped natural frequency)/d(alpha3), (n_modes,), Hz/rad; NaN for a mechanism."""
    at = solution.configuration
    step = min(STEP, 1e-3 * at.toggle_distance)
    slopes = rate(lambda angle: solution.model.solve(angle).modes.omega, at.alpha3, step)
    return np.where(solution.modes.mechanism, np.nan, slopes / (2.0 * np.pi))
