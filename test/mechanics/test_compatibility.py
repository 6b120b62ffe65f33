# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The compatibility matrix against the paper's equation and the linkage's own motion."""

import math

import numpy as np
import pytest

from linkage_vibration.mechanics.compatibility import InterfaceMap
from linkage_vibration.mechanics.components import link_component, rigid_component
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics, rotation


def interface(mechanism: Mechanism) -> InterfaceMap:
    """Return the interface DoFs of all components."""
    components = [link_component(link) for link in mechanism.links]
    return InterfaceMap(mechanism, components + [rigid_component(mechanism.rigid_bodies[0])])


def test_pin_rows_are_equation_22(mechanism: Mechanism) -> None:
    """A pin's two rows hold the rotations of the two links, the second with a minus."""
    configuration = Kinematics(mechanism).at(math.radians(117.0))
    rows = interface(mechanism).compatibility(configuration)
    pin = [point for point, _, _ in mechanism.joints()].index("V1")
    r, s = configuration.angle("lower_link"), configuration.angle("lift_rod")
    expected = np.array(
        [
            [math.cos(r), -math.sin(r), -math.cos(s), math.sin(s)],
            [math.sin(r), math.cos(r), -math.sin(s), -math.cos(s)],
        ]
    )
    block = rows[2 * pin : 2 * pin + 2]
    np.testing.assert_allclose(block[:, np.abs(block).sum(axis=0) > 0.0], expected, rtol=1e-14)


@pytest.mark.parametrize("alpha3_deg", [90.0, 133.0, 180.0])
def test_the_linkages_own_motion_is_compatible(mechanism: Mechanism, alpha3_deg: float) -> None:
    """What the kinematics say of every point's motion opens no pin.

    Only the rotation that holds the crank is violated, by the crank's own unit rotation.
    """
    configuration = Kinematics(mechanism).at(math.radians(alpha3_deg))
    motion: list[float] = []
    for link in mechanism.links:
        for point, place in link.points:
            rate = configuration.place_rate(link.name, (place, 0.0))
            motion += (rotation(configuration.angle(link.name)).T @ rate).tolist()
            if point == link.clamped:
                motion.append(configuration.velocity_ratio(link.name))
    body = mechanism.rigid_bodies[0]
    motion += configuration.place_rate(body.name, body.centre_of_gravity).tolist()
    motion.append(configuration.velocity_ratio(body.name))
    violation = interface(mechanism).compatibility(configuration) @ np.array(motion)
    np.testing.assert_allclose(violation[:-1], 0.0, atol=1e-13)
    assert violation[-1] == pytest.approx(1.0)
