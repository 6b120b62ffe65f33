# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Says how accurate a model can be, given how well the numbers of its mechanism are known."""

import math
from collections.abc import Sequence

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel

NUMERICAL = 0.1  # numerical error that is small enough, of the deviation by uncertain numbers
EXACT = 1e-4  # numerical error that is small enough if no number is uncertain

_STEP = 0.1  # standard deviations to both sides: hardly a curve, and more than a mesh changes
_EQUAL = 1e-6  # of the variance; only rounding may distinguish shares that differ by less


def needed_tolerance(
    mechanism: Mechanism, band: tuple[float, float], angles: Sequence[float]
) -> tuple[float, str]:
    """Return the error below which a finer model is no more accurate, and what to measure next."""
    uncertainty = mechanism.uncertainty
    if uncertainty is None or not uncertainty.numbers:
        return EXACT, ""
    model, correlation = LinkageModel(mechanism), np.array(uncertainty.correlation)
    variances, shares = list[float](), list[FloatArray]()
    for changes in log_changes(model, list(dict.fromkeys(angles)), band[1]):
        parts = changes * (correlation @ changes)
        for column in parts[:, parts.sum(axis=0) > 0.0].T:
            variances.append(float(column.sum()))
            shares.append(column / column.sum())
    if not shares:
        return EXACT, ""
    mean, least = np.mean(shares, axis=0), math.sqrt(min(variances))
    most = int((mean > mean.max() - _EQUAL).argmax())
    return NUMERICAL * least, (
        "By the uncertain numbers, natural frequencies have standard deviations of "
        f"{100.0 * least:.2g} % or more. Measure next: {uncertainty.numbers[most].path}, which "
        f"causes {100.0 * mean[most]:.0f} % of the variance."
    )


def log_changes(model: LinkageModel, angles: Sequence[float], highest: float) -> list[FloatArray]:
    """Return changes of ln(frequency) by one deviation, (n_numbers, n_modes), at angles, rad."""
    uncertainty = model.mechanism.uncertainty
    assert uncertainty is not None
    limit, modes = 2.0 * math.pi * highest, [model.solve(alpha3).modes for alpha3 in angles]
    kept = [np.flatnonzero(~each.mechanism & (each.omega <= limit)) for each in modes]
    changes = [np.empty((len(uncertainty.numbers), len(each))) for each in kept]
    for i, number in enumerate(uncertainty.numbers):
        values = [other.value for other in uncertainty.numbers]
        sides = []
        for steps in (-_STEP, _STEP):
            values[i] = number.moved(steps)
            moved = uncertainty.described(values)
            sides.append(LinkageModel(moved, kinematics=model.kinematics.nearby(moved)))
        for rows, alpha3, chosen in zip(changes, angles, kept, strict=True):
            low, high = (np.log(side.solve(alpha3).modes.omega[chosen]) for side in sides)
            rows[i] = (high - low) / (2.0 * _STEP)
    return changes
