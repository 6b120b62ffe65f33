# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""First-order changes of natural frequencies, as differences of whole models."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.description import coarser
from linkage_vibration.mechanics.model import LinkageModel

_STEP = 0.01  # standard deviations


def first_order(model: LinkageModel, angles: Sequence[float], n_modes: int) -> NDArray[np.float64]:
    """Return changes of ln(frequency) by one standard deviation, (n_angles, n_numbers, n_modes)."""
    uncertainty = model.mechanism.uncertainty
    assert uncertainty is not None
    changes = []
    for i, number in enumerate(uncertainty.numbers):
        values, logs = [other.value for other in uncertainty.numbers], []
        for steps in (-_STEP, _STEP):
            values[i] = number.moved(steps)
            side = coarser(uncertainty.described(values), 10, 6)
            near = model.kinematics.nearby(side)
            moved = LinkageModel(side, kinematics=near, half=model.half)
            hertz = [moved.solve(angle).natural_frequencies[:n_modes] for angle in angles]
            logs.append(np.log(hertz))
        changes.append((logs[1] - logs[0]) / (2.0 * _STEP))
    return np.moveaxis(changes, 0, 1)
