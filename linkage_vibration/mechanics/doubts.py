# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers of a description that are valid, but probably mistakes."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from linkage_vibration.mechanics.description import Cylinder, Mechanism, RigidBody
from linkage_vibration.mechanics.forces import GRAVITY
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.springs import length_and_rate, oil_pressure

_STEEL, _WIDEST = 7850.0, 6.0  # kg/m3 and m: no implement is a solid bar of steel of this width
_PUMP = 200e5  # Pa; the pumps of tractors reach about this pressure
_NO_LEVER = 1e-6  # m; a shorter lever of a cylinder is rounding
_BESIDE = 0.5  # A centre of gravity is beside two pins beyond this share of their distance.


def doubts(
    mechanism: Mechanism, configuration: Configuration, over: Sequence[Configuration]
) -> Iterator[str]:
    """Yield a sentence for each rigid body and each lift cylinder that is not plausible.

    The configurations are that of the assembly, and some over the stroke.
    """
    for body in mechanism.rigid:
        least = math.sqrt(body.mass / (2.0 * math.pi * _STEEL * _WIDEST))  # a bar seen from its end
        radius = math.sqrt(body.inertia / body.mass)
        if radius < least:
            problem = f"a radius of gyration of {radius:.2g} m, below the {least:.2g} m of a solid"
            hint = "is the inertia in kg m2, about the centre of gravity"
            yield f"{body.name} has {problem} bar of steel {_WIDEST:g} m wide; {hint}?"
    for body in mechanism.rigid_bodies:
        yield from _overlap(mechanism, body, configuration)
    yield from _overload(mechanism, over)


def _overload(mechanism: Mechanism, over: Sequence[Configuration]) -> Iterator[str]:
    """Yield a sentence if the weight of the rigid bodies needs a pressure that no tractor has.

    A cylinder that alone holds the crank has the tension T with T dL = -dV: virtual work.
    """
    springs = [spring for spring in mechanism.springs if spring.stiffness != 0.0]
    cylinder = springs[0].stiffness if len(springs) == 1 else None
    if not isinstance(cylinder, Cylinder) or any(link.clamped for link in mechanism.links):
        return
    loads = []
    for at in over:
        _, lever = length_and_rate(springs[0], mechanism, at)
        if abs(lever) < _NO_LEVER:
            angle = math.degrees(at.alpha3)
            text = f"has no lever at alpha3 = {angle:.0f} deg, so it holds nothing there"
            yield f"{springs[0].name} {text}; check where its ends are."
            return
        bodies = mechanism.rigid_bodies
        rates = [body.mass * at.place_rate(body.name, body.centre_of_gravity)[1] for body in bodies]
        tension = -GRAVITY * sum(rates) / (cylinder.count * lever)
        loads.append((oil_pressure(cylinder, tension), lever, math.degrees(at.alpha3)))
    if any(math.isnan(pressure) for pressure, *_ in loads):
        text = "would have to pull, but no oil is locked on the side of its rod"
        yield f"{springs[0].name} {text}; check base_end and rod_end, or give `rod`."
        return
    pressure, lever, angle = max(loads)
    if pressure > _PUMP:
        need = f"needs {pressure / 1e5:.0f} bar in {springs[0].name} at alpha3 = {angle:.0f} deg"
        has = f"its lever is {1e3 * abs(lever):.0f} mm, and tractors reach {_PUMP / 1e5:.0f} bar"
        yield f"The implement's weight {need}, where {has}; check base_end, rod_end and bore."


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
