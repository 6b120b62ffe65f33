# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies as the rest of the mechanics sees them: matrices or FRFs on interface DoFs.

A component is invariant: its numbers are in its own axes and are made once. Only the compatibility
matrix that couples the components changes with the configuration.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.regularisation import Measured

FloatArray = NDArray[np.float64]

CENTRE_OF_GRAVITY = "centre of gravity"


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """How the coordinates of a component move the points by which it is drawn.

    Attributes
    ----------
    places : ndarray, (n_points, 2)
        Local x and z of the points, in order along the body, m.
    displacement : ndarray, (n_points, 3, n)
        Local x, y and z displacement of each point for each coordinate.
    """

    places: FloatArray
    displacement: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """A body known by its matrices.

    Attributes
    ----------
    name : str
        Name of the body.
    dofs : tuple of InterfaceDof, (n_interface,)
        The first rows and columns of the matrices; all others are inner coordinates.
    mass, stiffness, damping : ndarray, (n, n)
        SI; damping is viscous.
    loss_factor : float
        Structural damping: the stiffness is K (1 + i eta).
    drawing : Drawing or None
        None where the shape of the body is unknown.
    """

    name: str
    dofs: tuple[InterfaceDof, ...]
    mass: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    loss_factor: float
    drawing: Drawing | None


@dataclass(frozen=True, slots=True, eq=False)
class FrfComponent:
    """A body known by its FRFs alone.

    Attributes
    ----------
    name : str
        Name of the body.
    dofs : tuple of InterfaceDof, (n_interface,)
        Rows and columns.
    frequencies : ndarray, (n_freq,)
        Hz, ascending, above 0.
    measured : Measured
        Receptances of the free body, regularised.
    noise : float
        Relative noise of the receptances as they were measured, 1.
    """

    name: str
    dofs: tuple[InterfaceDof, ...]
    frequencies: FloatArray
    measured: Measured
    noise: float
