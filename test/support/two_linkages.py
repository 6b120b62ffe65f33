# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Two equal linkages side by side, which have each natural frequency twice."""

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from linkage_vibration.mechanics.compatibility import Joining
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.coupling import CoupledSystem, couple, uncoupled_system
from linkage_vibration.mechanics.model import LinkageModel, Solution


def two_linkages(model: LinkageModel, alone: Solution) -> CoupledSystem:
    """Return two equal linkages as one system; ``alone`` is the solution of one of them."""
    parts = [c for c in model.components if isinstance(c, Component)]
    system = uncoupled_system([*parts, *(replace(c, name=f"other {c.name}") for c in parts)])
    b = alone.joining.compatibility
    none = np.zeros((0, 2 * b.shape[1]))
    both = Joining(block_diag(b, b), 2 * alone.joining.labels, none, np.zeros(0), np.zeros(0))
    return couple(system, both)
