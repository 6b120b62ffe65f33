# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies as the rest of the mechanics sees them: matrices or FRFs on interface DoFs.

A component is invariant: its numbers are in its own axes and are made once. Only the compatibility
matrix that couples the components changes with the configuration.
"""

from dataclasses import dataclass

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.regularisation import Regularised

CENTRE_OF_GRAVITY = "centre of gravity"


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """How the coordinates of a component move the points by which it is drawn."""

    places: FloatArray  # (n_points, 2): local x and z of the points, in order along the body, m
    displacement: FloatArray  # (n_points, 3, n): local x, y and z of each point per coordinate


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """A body known by its matrices."""

    name: str  # of the body
    dofs: tuple[InterfaceDof, ...]  # the first rows and columns; all others are inner coordinates
    mass: FloatArray  # (n, n), SI; damping is viscous
    stiffness: FloatArray  # (n, n)
    damping: FloatArray  # (n, n)
    loss_factor: float  # structural damping: the stiffness is K (1 + i eta)
    drawing: Drawing | None  # None where the shape of the body is unknown


@dataclass(frozen=True, slots=True, eq=False)
class FrfComponent:
    """A body known by its FRFs alone."""

    name: str  # of the body
    dofs: tuple[InterfaceDof, ...]  # (n_interface,): rows and columns
    frequencies: FloatArray  # (n_freq,), Hz, ascending, above 0
    measured: Regularised  # receptances of the free body
    noise: float  # relative noise of the receptances as they were measured, 1
