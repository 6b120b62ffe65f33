# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A rigid body that turns about a pin on the ground, as mechanisms of closed forms have it."""

from typing import Any

MASS, INERTIA, ARM = 12.0, 3.0, 0.8  # kg, kg m2 about the centre of gravity, m from the pin
BOB: dict[str, Any] = {
    "points": {"P": [0.0, 0.0], "E": [1.0, 0.0]},
    "centre_of_gravity": [ARM, 0.0],
    "mass": MASS,
    "inertia": INERTIA,
}
