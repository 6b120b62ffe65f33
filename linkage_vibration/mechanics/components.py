# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies as the rest of the mechanics sees them: matrices on interface DoFs and inner coordinates.

A component is invariant: its matrices are in its own axes and are made once. Only the compatibility
matrix that couples the components changes with the configuration.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.beams import DOFS_PER_NODE, link_matrices
from linkage_vibration.mechanics.description import Link, RigidBody
from linkage_vibration.mechanics.reduction import ReductionError, craig_bampton

FloatArray = NDArray[np.float64]

CENTRE_OF_GRAVITY = "centre of gravity"


@dataclass(frozen=True, slots=True)
class InterfaceDof:
    """One physical DoF of a component: displacement along its own x or z, or rotation."""

    point: str
    direction: str  # "x", "z" or "theta"


@dataclass(frozen=True, slots=True)
class Component:
    """Matrices of one body.

    Attributes
    ----------
    name : str
        Of the body.
    dofs : tuple of InterfaceDof, (n_interface,)
        The first rows and columns of the matrices; all others are inner coordinates.
    mass, stiffness : ndarray, (n, n)
        SI.
    """

    name: str
    dofs: tuple[InterfaceDof, ...]
    mass: FloatArray
    stiffness: FloatArray


def link_component(link: Link, *, reduced: bool = True) -> Component:
    """Put a link on two displacements a point, and the rotation where the ground clamps it.

    Parameters
    ----------
    link : Link
        Its ``modes`` fixed-interface modes are kept.
    reduced : bool
        False keeps every DoF of the beam elements instead.

    Raises
    ------
    ReductionError
        If the link has too few points to be held by them.
    """
    mass, stiffness, nodes = link_matrices(link)
    dofs, rows = [], []
    for point, place in link.points:
        first = DOFS_PER_NODE * int(np.abs(nodes - place).argmin())
        for offset, direction in enumerate(("x", "z", "theta")):
            if direction != "theta" or point == link.clamped:
                dofs.append(InterfaceDof(point, direction))
                rows.append(first + offset)
    order = rows + sorted(set(range(len(mass))) - set(rows))
    mass, stiffness = mass[np.ix_(order, order)], stiffness[np.ix_(order, order)]
    if reduced:
        try:
            reduction = craig_bampton(mass, stiffness, len(rows), link.modes)
        except ReductionError as error:
            raise ReductionError(f"links.{link.name}: {error}") from None
        mass, stiffness = reduction.mass, reduction.stiffness
    return Component(link.name, tuple(dofs), mass, stiffness)


def rigid_component(body: RigidBody) -> Component:
    """Put a rigid body on the three DoFs of its centre of gravity, along the global axes.

    Turning the axes leaves its mass matrix as it is, so the global axes serve as its own.
    """
    dofs = tuple(InterfaceDof(CENTRE_OF_GRAVITY, direction) for direction in ("x", "z", "theta"))
    return Component(
        body.name, dofs, np.diag([body.mass, body.mass, body.inertia]), np.zeros((3, 3))
    )
