# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Links known by their matrices, as a finite element program exports them."""

from dataclasses import dataclass, field, replace

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.components import Component, Drawing
from linkage_vibration.mechanics.description import Body, Link, Mechanism, MechanismError
from linkage_vibration.mechanics.dofs import Dofs, InterfaceDof
from linkage_vibration.mechanics.reduction import ReductionError, craig_bampton


@dataclass(frozen=True, slots=True, eq=False)
class Matrices(Body):
    """An elastic body known by its matrices."""

    dofs: Dofs  # the first rows and columns; all others are inner coordinates
    mass: FloatArray  # (n, n), SI
    stiffness: FloatArray  # (n, n)
    damping: FloatArray | None = None  # (n, n), viscous; None leaves it to the damping rule
    # How all coordinates of the body move the points by which it is drawn.
    drawing: Drawing | None = field(default=None, compare=False)

    def component(self, link: Link, mechanism: Mechanism, *, reduced: bool) -> Component:
        """Return the component of the body, as `description.Body.component` says."""
        if not self.mass.dtype == self.stiffness.dtype == np.float64:
            problem = f"its matrices are {self.mass.dtype} and {self.stiffness.dtype}, not float64"
            raise MechanismError(f"links.{link.name}", f"{problem}; export them in double.")
        mass = self.mass.copy()
        for point, value in link.masses:
            for direction in ("x", "z"):
                at = link.positions((InterfaceDof(point, direction),), self.dofs)[0]
                mass[at, at] += value
        body = Matrices(self.dofs, mass, self.stiffness, self.damping)
        return component_of(link, mechanism, body, mechanism.interface_dofs(link), reduced=reduced)


def component_of(
    link: Link, mechanism: Mechanism, body: Matrices, wanted: Dofs, *, reduced: bool
) -> Component:
    """Put one of a link's equal bodies on the DoFs wanted, reduce it, and damp the result."""
    first = link.positions(wanted, body.dofs)
    # A file's body is held out of the plane; rotations are free unless they are interface.
    held = {i for i, dof in enumerate(body.dofs) if dof.direction == "y"}
    order = first + [i for i in range(len(body.mass)) if i not in held.union(first)]
    block = np.ix_(order, order)
    mass, stiffness = body.mass[block], body.stiffness[block]
    viscous = None if body.damping is None else body.damping[block]
    drawing = body.drawing
    drawing = drawing and replace(drawing, displacement=drawing.displacement[:, :, order])
    if reduced:
        try:
            reduction = craig_bampton(mass, stiffness, len(wanted), link.modes)
        except ReductionError as error:
            raise ReductionError(f"links.{link.name}: {error}") from None
        mass, stiffness, t = reduction.mass, reduction.stiffness, reduction.transformation
        viscous = None if viscous is None else t.T @ viscous @ t
        drawing = drawing and replace(drawing, displacement=drawing.displacement @ t)
    rule = link.damping or mechanism.damping
    if viscous is None:
        viscous = rule.viscous(mass, stiffness)
    mass, stiffness, viscous = (link.count * each for each in (mass, stiffness, viscous))
    return Component(link.name, wanted, mass, stiffness, viscous, rule.loss_factor, drawing)
