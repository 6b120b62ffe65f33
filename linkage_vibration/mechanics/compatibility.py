# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The compatibility matrix B(configuration): B u = 0 joins the components.

For a pin between bodies r and s it holds R(angle_r) u_r - R(angle_s) u_s = 0 (Brunetti, D'Ambrogio,
Fregolent 2022, eq. 20 to 22, in the plane), u in the bodies' own axes; the ground does not move; a
rigid body moves at a point by its centre of gravity's displacement and its rotation times the arm.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.components import CENTRE_OF_GRAVITY, Component, InterfaceDof
from linkage_vibration.mechanics.description import GROUND, Mechanism
from linkage_vibration.mechanics.kinematics import Configuration, rotation

FloatArray = NDArray[np.float64]


class InterfaceMap:
    """Which interface DoF of which component stands where in the vector u.

    Parameters
    ----------
    mechanism : Mechanism
        Names the pins and the rigid bodies' points.
    components : sequence of Component
        Their interface DoFs, component by component, make u.
    """

    def __init__(self, mechanism: Mechanism, components: Sequence[Component]) -> None:
        self._mechanism = mechanism
        self._index: dict[tuple[str, InterfaceDof], int] = {}
        for component in components:
            for dof in component.dofs:
                self._index[component.name, dof] = len(self._index)
        self._centres = {body.name: body.centre_of_gravity for body in mechanism.rigid_bodies}

    def __len__(self) -> int:
        """Return the number of interface DoFs."""
        return len(self._index)

    def displacement(self, body: str, point: str, configuration: Configuration) -> FloatArray:
        """Return the (2, n) matrix that turns u into a point's global x and z displacement."""
        rows = np.zeros((2, len(self)))
        if body == GROUND:
            return rows
        if body in self._centres:
            place = self._mechanism.local_points(body)[point]
            arm = configuration.place(body, place) - configuration.place(body, self._centres[body])
            at = [self._at(body, CENTRE_OF_GRAVITY, name) for name in ("x", "z", "theta")]
            rows[:, at] = [[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]]]
        else:
            at = [self._at(body, point, name) for name in ("x", "z")]
            rows[:, at] = rotation(configuration.angle(body))
        return rows

    def compatibility(self, configuration: Configuration) -> FloatArray:
        """Return B, (n_constraints, n): two rows a pin, then one for each clamped rotation."""
        rows = [
            self.displacement(first, point, configuration)
            - self.displacement(second, point, configuration)
            for point, first, second in self._mechanism.joints()
        ]
        for link in self._mechanism.links:
            if link.clamped is not None:
                row = np.zeros((1, len(self)))
                row[0, self._at(link.name, link.clamped, "theta")] = 1.0
                rows.append(row)
        return np.vstack(rows)

    def _at(self, body: str, point: str, direction: str) -> int:
        return self._index[body, InterfaceDof(point, direction)]
