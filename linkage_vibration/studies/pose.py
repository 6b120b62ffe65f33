# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Places the pins of a linkage, and tabulates the angles of its bodies over the stroke."""

import math
from collections.abc import Sequence

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import GROUND, Mechanism
from linkage_vibration.mechanics.kinematics import Configuration, Kinematics


def pin_places(mechanism: Mechanism, configuration: Configuration) -> dict[str, FloatArray]:
    """Return the place of every point of the ground and of the bodies, (2,), m."""
    names = (GROUND, *(body.name for body in mechanism.bodies))
    return {
        point: configuration.place(name, local)
        for name in names
        for point, local in mechanism.local_points(name).items()
    }


def angle_rows(mechanism: Mechanism, kinematics: Kinematics, angles: Sequence[float]) -> str:
    """Return a table of the bodies' angles and the drive point's places at crank angles, rad."""
    names = [body.name for body in mechanism.bodies if body.name != mechanism.input_body]
    point = mechanism.response.point
    columns = ["alpha3", *names]
    heads = [*(f"{name} [deg]" for name in columns), f"{point} x [m]", f"{point} z [m]"]
    widths = [max(len(head) + 2, 12) for head in heads]
    rows = [heads]
    for alpha3 in angles:
        configuration = kinematics.at(alpha3)
        degrees = [round(math.degrees(configuration.angle(name)), 2) % 360.0 for name in names]
        x, z = pin_places(mechanism, configuration)[point]
        numbers = [f"{angle:.2f}" for angle in (round(math.degrees(alpha3), 2) + 0.0, *degrees)]
        rows.append([*numbers, *(f"{round(float(place), 3) + 0.0:.3f}" for place in (x, z))])
    return "\n".join(
        "".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True)) for row in rows
    )
