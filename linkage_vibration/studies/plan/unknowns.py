# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Says how accurate a model can be, given how well the numbers of its mechanism are known."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.sensitivity import Sensitivity

NUMERICAL = 0.1
"""Numerical error that is small enough, of the standard deviation by the uncertain numbers."""

_EQUAL = 1e-6  # of the variance; only rounding may distinguish shares that differ by less


@dataclass(frozen=True, slots=True)
class Unknowns:
    """What the uncertain numbers of a mechanism leave open."""

    stddev: float  # the smallest relative standard deviation of a natural frequency in the band
    path: str  # the first number with the largest share of these frequencies' variances
    share: float  # its share, the mean over modes and angles

    @property
    def tolerance(self) -> float:
        """The numerical error below which a finer model is no more accurate."""
        return NUMERICAL * self.stddev

    def __str__(self) -> str:
        """Return what limits the accuracy, in a sentence, and what to measure next."""
        return (
            "By the uncertain numbers, natural frequencies have standard deviations of "
            f"{100.0 * self.stddev:.2g} % or more. Measure next: {self.path}, which causes "
            f"{100.0 * self.share:.0f} % of the variance."
        )


def unknowns(
    mechanism: Mechanism, band: tuple[float, float], angles: Sequence[float]
) -> Unknowns | None:
    """Return what uncertain numbers leave open in a band (Hz) at angles (rad); None without any."""
    if mechanism.uncertainty is None or not mechanism.uncertainty.numbers:
        return None
    model = LinkageModel(mechanism)
    sensitivity = Sensitivity(model)
    deviations, shares = [], []
    for alpha3 in dict.fromkeys(angles):
        changes = sensitivity.at(model.solve(alpha3), band[1])
        for mode in np.flatnonzero(changes.stddev[0] > 0.0).tolist():
            deviations.append(float(changes.stddev[0, mode]))
            shares.append(changes.shares(mode))
    if not shares:
        return None
    mean = np.mean(shares, axis=0)
    most = int((mean > mean.max() - _EQUAL).argmax())
    return Unknowns(min(deviations), sensitivity.numbers[most].path, float(mean[most]))
