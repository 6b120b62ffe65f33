# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers of a description that are valid, but probably mistakes."""

import math
from collections.abc import Iterator

import numpy as np

from linkage_vibration.mechanics.description import Mechanism, RigidBody
from linkage_vibration.mechanics.kinematics import Configuration

_STEEL, _WIDEST = 7850.0, 6.0  # kg/m3 and m: no implement is a solid bar of steel of this width
_BESIDE = 0.5  # A centre of gravity is beside two pins beyond this share of their distance.


def doubts(mechanism: Mechanism, configuration: Configuration) -> Iterator[str]:
    """Yield a sentence for each rigid body whose inertia or centre of gravity is not plausible."""
    for body in mechanism.rigid:
        least = math.sqrt(body.mass / (2.0 * math.pi * _STEEL * _WIDEST))  # a bar seen from its end
        radius = math.sqrt(body.inertia / body.mass)
        if radius < least:
            problem = f"a radius of gyration of {radius:.2g} m, below the {least:.2g} m of a solid"
            hint = "is the inertia in kg m2, about the centre of gravity"
            yield f"{body.name} has {problem} bar of steel {_WIDEST:g} m wide; {hint}?"
    for body in mechanism.rigid_bodies:
        yield from _overlap(mechanism, body, configuration)


def _overlap(mechanism: Mechanism, body: RigidBody, at: Configuration) -> Iterator[str]:
    """Yield a sentence if a body that links carry by upright pins lies on the ground's side."""
    pins = [place for point, place in body.points if len(mechanism.owners(point)) > 1]
    if len(pins) != 2:
        return
    places = [at.place(body.name, place) for place in (*pins, body.centre_of_gravity)]
    places.append(np.mean([place for _, place in mechanism.ground], axis=0))
    along, size = places[1] - places[0], math.dist(*pins)
    across = np.array([-along[1], along[0]]) / size
    centre, carrier = (float(across @ (place - places[0])) for place in places[2:])
    upright = abs(along[1]) > abs(along[0])
    if upright and centre * carrier > 0.0 and abs(centre) > _BESIDE * size:
        problem = f"is {abs(centre):.2g} m from the line of its pins towards the ground"
        hint = "where its carrier is; check `side`, or the signs of its coordinates"
        yield f"The centre of gravity of {body.name} {problem}, {hint}."
