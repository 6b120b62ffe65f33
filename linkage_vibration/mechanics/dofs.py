# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Names of interface degrees of freedom."""

from dataclasses import dataclass

DIRECTIONS = ("x", "y", "z", "theta")
"""The directions that a file may give to the DoFs of a body."""


@dataclass(frozen=True, slots=True, order=True)
class InterfaceDof:
    """One physical DoF of a component, in its own axes: how one of its points moves.

    x (m) is along a link from its first point, z across it in the plane, y out of it; theta (rad)
    turns it from x towards z, chi from x towards y; roll and yaw turn rigid bodies about x and z.
    """

    point: str
    direction: str

    def __str__(self) -> str:
        """Return the DoF as files and errors write it, such as ``P1 x``."""
        return f"{self.point} {self.direction}"


Dofs = tuple[InterfaceDof, ...]
