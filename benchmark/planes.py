# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Distinguishes modes in the plane of motion from those out of it, and gives rates of points."""

import math

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.mechanics.description import Point
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.model import Solution


def in_plane(solution: Solution) -> BoolArray:
    """Return which modes of a linkage of beams move in the plane, (n_modes,).

    The two kinds do not mix as long as every link is symmetric about the plane.
    """
    system, lateral = solution.model.system, np.zeros(len(solution.modes.omega))
    for component in system.components:
        shapes = solution.modes.shapes[system.rows[component.name]]
        if component.drawing is None:  # a rigid body, which is held in the plane
            lateral -= (shapes**2).sum(axis=0)
        else:
            squares = ((component.drawing.displacement @ shapes) ** 2).sum(axis=0)
            lateral += squares[1] - squares[0] - squares[2]
    return np.asarray(lateral <= 0.0)


def place_rate(configuration: Configuration, body: str, local: Point) -> FloatArray:
    """Return d(place)/d(alpha3) of a point of a body, (2,), m/rad; local is in its axes, m."""
    i, angle = configuration.bodies.index(body), configuration.angle(body)
    turned = [-local[0] * math.sin(angle) - local[1] * math.cos(angle)]
    turned.append(local[0] * math.cos(angle) - local[1] * math.sin(angle))
    ratio = configuration.velocity_ratios[i]
    return np.asarray(configuration.origin_rates[i] + ratio * np.array(turned))
