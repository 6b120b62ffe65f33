# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Transmissibility: how the linkage follows a motion of the soil under its base.

The result is dimensionless: the displacement of a point per displacement of the soil, which is
also its acceleration per acceleration. The soil moves under all mounts of the base together or
under one, and acts through their stiffness and damping.
"""

from dataclasses import replace

import numpy as np

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.forces import tyre_place
from linkage_vibration.mechanics.model import ModelError, Place, Places, Solution, pairs
from linkage_vibration.mechanics.response import PoleResidue, pole_residue

MOTION = "base"
"""The name of a motion of all the soil."""


def soil_places(mechanism: Mechanism) -> tuple[Place, ...]:
    """Return inputs that move all soil, or that under a mount: ("base:rear_axle", "z")."""
    if mechanism.base is None:
        return ()
    names = [MOTION, *(f"{MOTION}:{mount.name}" for mount in mechanism.base.mounts)]
    return tuple((name, direction) for name in names for direction in ("x", "z"))


def transmissibility(solution: Solution, outputs: Places, soil: Place | str) -> PoleResidue:
    """Return how points follow a motion of the soil: displacement per displacement, (n_out, 1).

    It is also acceleration per acceleration.

    Parameters
    ----------
    solution : Solution
        The linkage at an angle.
    outputs : sequence of (point, direction)
        Along the global axes; "E1.z" is ("E1", "z").
    soil : (motion, direction)
        "base.z" moves all of the soil, "base:rear_axle.z" that under one mount.

    Raises
    ------
    ModelError
        If the soil has no such motion, as without a base, or a place does not exist.
    """
    mechanism = solution.model.mechanism
    if solution.model.half == "lateral":
        raise ModelError("The soil moves the vertical half alone here; solve that one.")
    outputs, [soil] = pairs(outputs), pairs([soil])
    if soil not in soil_places(mechanism):
        places = ", ".join(".".join(place) for place in soil_places(mechanism))
        places = places or "none, as the mechanism has no base"
        raise ModelError(f"The soil has no motion {'.'.join(soil)}; name one of: {places}.")
    out = solution.powers(outputs)
    springs, axis = mechanism.mount_springs, "xz".index(soil[1])
    first = len(solution.joining.stiffness) - len(springs)
    which = [
        first + i
        for i, (mount, along) in enumerate(springs)
        if along == axis and soil[0] in (MOTION, f"{MOTION}:{mount.name}")
    ]
    joining, modes = solution.joining, solution.modes.shapes
    into = joining.elongation[which] @ modes[: joining.elongation.shape[1]]
    k, c = (each[which, np.newaxis] for each in (joining.stiffness, joining.damping))
    response = pole_residue(solution.damped, out, into).driven(k, c)
    # A tyre is compressed by the motion of the soil under it, too.
    tyres = [tyre_place(springs[i - first][0].name) if axis else None for i in which]
    own = np.array([[float(output == tyre) for tyre in tyres] for output in outputs])
    rest, rate = response.residual - own @ k, response.residual_rate - own @ c
    response = replace(response, residual=rest, residual_rate=rate, error=np.zeros(1))
    return replace(response, outputs=tuple(outputs), inputs=(soil,))
