# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Says how accurate a model can be, given how well the numbers of its mechanism are known."""

from collections.abc import Sequence

import numpy as np

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.sensitivity import Sensitivity

NUMERICAL = 0.1
"""Numerical error that is small enough, of the standard deviation by the uncertain numbers."""

EXACT = 1e-4
"""Numerical error that is small enough if no number is uncertain."""

_EQUAL = 1e-6  # of the variance; only rounding may distinguish shares that differ by less


def needed_tolerance(
    mechanism: Mechanism, band: tuple[float, float], angles: Sequence[float]
) -> tuple[float, str]:
    """Return the relative error below which a finer model is no more accurate, and why.

    The reason names the number to measure next; it is empty if no number is uncertain. The band is
    in Hz, and the angles in rad.
    """
    if mechanism.uncertainty is None or not mechanism.uncertainty.numbers:
        return EXACT, ""
    model = LinkageModel(mechanism)
    sensitivity = Sensitivity(model)
    deviations, shares = [], []
    for alpha3 in dict.fromkeys(angles):
        changes = sensitivity.at(model.solve(alpha3), band[1])
        for mode in np.flatnonzero(changes.stddev > 0.0).tolist():
            deviations.append(float(changes.stddev[mode]))
            shares.append(changes.shares(mode))
    if not shares:
        return EXACT, ""
    mean, least = np.mean(shares, axis=0), min(deviations)
    most = int((mean > mean.max() - _EQUAL).argmax())
    return NUMERICAL * least, (
        "By the uncertain numbers, natural frequencies have standard deviations of "
        f"{100.0 * least:.2g} % or more. Measure next: {sensitivity.numbers[most].path}, which "
        f"causes {100.0 * mean[most]:.0f} % of the variance."
    )
