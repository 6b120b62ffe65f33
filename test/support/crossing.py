# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A crank with a tuned mass, whose two modes have a gap of a given width.

A spring holds the crank's end to the ground. It becomes stiffer across the crank as the crank
turns, so the mode of the crank rises with alpha3. The mode of the tuned mass is constant.
"""

import math

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.description import (
    Link,
    Mechanism,
    Response,
    Spring,
    rayleigh_damping,
)
from linkage_vibration.mechanics.dofs import InterfaceDof

FloatArray = NDArray[np.float64]

STROKE = (0.3, 1.2)  # rad
BAND = (0.0, 60.0)  # Hz

_MASS = 10.0  # kg, at the crank's end; the tuned mass has 1 kg
_AXIAL = _MASS * (2.0 * math.pi * 5000.0) ** 2  # N/m
_BENDING = _MASS * (2.0 * math.pi * 20.0) ** 2  # N/m, of the crank without the spring
_SPRING = 6e4  # N/m
_ANCHOR = (2.2, 0.5)  # m, its end on the ground; the crank is 1 m long


def crossing_crank(
    gap: float, at: float, ratio: float = 0.01, dashpot: float | None = None
) -> Mechanism:
    """Return the mechanism.

    Parameters
    ----------
    gap : float
        Hz, between the two modes where they are nearest; 0 lets them cross.
    at : float
        rad, where that is.
    ratio : float
        Damping ratio at 10 and 100 Hz, 1.
    dashpot : float, optional
        Damping of the spring, N s/m; by default that of the rule, so that the modes stay real.
    """
    damping = rayleigh_damping(ratio, 10.0, 100.0)
    tuned, coupling = _tuned(gap, at)
    mass = np.diag([1.0, 1.0, 1.0, _MASS, _MASS, 1.0])
    stiffness = np.diag([0.0, 0.0, 0.0, _AXIAL, _BENDING, tuned])
    stiffness[4, 5] = stiffness[5, 4] = coupling
    held = tuple(InterfaceDof("A", direction) for direction in ("x", "z", "theta"))
    moving = tuple(InterfaceDof("B", direction) for direction in ("x", "z"))
    crank = Link(
        name="crank",
        points=(("A", (0.0, 0.0)), ("B", (1.0, 0.0))),
        body=Matrices((*held, *moving), mass, stiffness),
        count=1,
        modes=1,
        clamped="A",
        masses=(),
        damping=None,
    )
    if dashpot is None:
        dashpot = _SPRING * damping.stiffness_coefficient
    return Mechanism(
        name="crossing_crank",
        ground=(("A", (0.0, 0.0)), ("G", _ANCHOR)),
        links=(crank,),
        rigid_bodies=(),
        springs=(Spring("spring", ("crank", "ground"), ("B", "G"), _SPRING, dashpot),),
        input_body="crank",
        stroke=STROKE,
        assembly_alpha3=STROKE[0],
        assembly_angles=(),
        damping=damping,
        response=Response("B", "z", BAND, 2),
    )


def exact_frequencies(gap: float, at: float, alpha3: FloatArray) -> FloatArray:
    """Return the two natural frequencies, (n, 2), ascending, Hz, from the three equations."""
    tuned, coupling = _tuned(gap, at)
    found = np.empty((len(alpha3), 2))
    for row, angle in zip(found, alpha3, strict=True):
        matrix = np.zeros((3, 3))
        matrix[:2, :2] = (np.diag([_AXIAL, _BENDING]) + _spring(angle)) / _MASS
        matrix[1, 2] = matrix[2, 1] = coupling / math.sqrt(_MASS)
        matrix[2, 2] = tuned
        row[:] = np.sqrt(np.linalg.eigvalsh(matrix)[:2]) / (2.0 * math.pi)
    return found


def exact_poles(
    gap: float, at: float, ratio: float, dashpot: float, alpha3: float
) -> NDArray[np.complex128]:
    """Return the six poles (rad/s) at an angle from the three equations of motion."""
    tuned, coupling = _tuned(gap, at)
    rule = rayleigh_damping(ratio, 10.0, 100.0)
    mass, stiffness = np.diag([_MASS, _MASS, 1.0]), np.diag([_AXIAL, _BENDING, tuned])
    stiffness[1, 2] = stiffness[2, 1] = coupling
    damping = rule.mass_coefficient * mass + rule.stiffness_coefficient * stiffness
    damping[:2, :2] += dashpot * _spring(alpha3) / _SPRING
    stiffness[:2, :2] += _spring(alpha3)
    own = np.block([[np.zeros((3, 3)), np.eye(3)], [-stiffness, -damping]])
    own[3:] /= np.diag(mass)[:, np.newaxis]
    return np.linalg.eigvals(own).astype(complex)


def dashpot_at_meeting(gap: float, at: float, ratio: float) -> float:
    """Return the dashpot (N s/m) with which the poles of both modes meet off the real axis.

    Of two oscillators of one frequency, one of which decays faster by d (1/s), the poles meet where
    the coupling splits the undamped frequencies by d.
    """
    low, high = 0.0, 2e3

    def split(dashpot: float) -> float:
        poles = exact_poles(gap, at, ratio, dashpot, at)
        one, other = sorted(poles[poles.imag > 0.0], key=abs)[:2]
        return abs(one.imag - other.imag) - abs(one.real - other.real)

    for _ in range(200):
        middle = (low + high) / 2.0
        low, high = (middle, high) if split(middle) > 0.0 else (low, middle)
    return low


def _spring(alpha3: float) -> FloatArray:
    """Return the spring's stiffness at the crank's end, along and across the crank, (2, 2)."""
    away = np.array(_ANCHOR) - [math.cos(alpha3), math.sin(alpha3)]
    along = away @ [math.cos(alpha3), math.sin(alpha3)]
    across = away @ [-math.sin(alpha3), math.cos(alpha3)]
    line = np.array([along, across]) / np.linalg.norm(away)
    return np.asarray(_SPRING * np.outer(line, line))


def _tuned(gap: float, at: float) -> tuple[float, float]:
    """Return the tuned mass's stiffness (N/m) and its coupling to the crank's end (N/m)."""
    plane = (np.diag([_AXIAL, _BENDING]) + _spring(at)) / _MASS
    squared = float(np.linalg.eigvalsh(plane)[0])
    return squared, 2.0 * math.pi * gap * math.sqrt(squared) * math.sqrt(_MASS)
