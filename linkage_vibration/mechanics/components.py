# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies as the rest of the mechanics sees them: matrices or FRFs on interface DoFs.

A component is invariant: its numbers are in its own axes and are computed once. Only the
compatibility matrix that couples the components changes with the configuration.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.dofs import Dofs
from linkage_vibration.mechanics.regularisation import RegularisedFrfs

CENTRE_OF_GRAVITY = "centre of gravity"


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """How the coordinates of a component move the points by which it is drawn."""

    places: FloatArray  # (n_points, 2): local x and z of the points, in order along the body, m
    displacement: FloatArray  # (n_points, 3, n): local x, z and theta of each point per coordinate


@dataclass(frozen=True, eq=False)
class Component:
    """A body known by its matrices."""

    name: str  # of the body
    dofs: Dofs  # the first rows and columns; all others are inner coordinates
    mass: FloatArray  # (n, n), SI; damping is viscous
    stiffness: FloatArray  # (n, n)
    damping: FloatArray  # (n, n)
    loss_factor: float  # structural damping: the stiffness is K (1 + i eta)
    drawing: Drawing | None  # None where the shape of the body is unknown
    # (n_points - 1, n, n), 1/m: in the lateral half, stiffness per tension between points
    tightened: FloatArray | None = None

    def translation(self, along: FloatArray, turn: FloatArray) -> FloatArray:
        """Return the coordinates, (..., n), if a body moves by (2,) along the global axes, m.

        The matrices, (..., 2, 2), turn its components into global ones.
        """
        if self.dofs[0].point != CENTRE_OF_GRAVITY:  # a rigid body has the global axes
            along = along @ turn
        return np.asarray(along @ self._moved)

    @cached_property
    def _moved(self) -> FloatArray:
        """The coordinates if the body moves by 1 m along its x and z axes, (2, n)."""
        ends = np.array([[dof.direction == axis for dof in self.dofs] for axis in "xz"], float)
        n = ends.shape[1]
        inner, cross = self.stiffness[n:, n:], self.stiffness[n:, :n]
        return np.hstack([ends, -np.linalg.solve(inner, cross @ ends.T).T])


@dataclass(frozen=True, slots=True, eq=False)
class FrfComponent:
    """A body known by its FRFs alone."""

    name: str  # of the body
    dofs: Dofs  # (n_interface,): rows and columns
    frequencies: FloatArray  # (n_freq,), Hz, ascending, above 0
    measured: RegularisedFrfs  # receptances of the free body
    noise: float  # relative noise of the receptances as they were measured, 1
    gain: float  # relative standard deviation of a gain that all of them share, 1


Components = Sequence[Component | FrfComponent]
