# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A crank with a tuned mass, whose two modes have a gap of a given width.

A spring holds the crank's end to the ground. It becomes stiffer across the crank as the crank
turns, so the mode of the crank rises with alpha3. The mode of the tuned mass is constant. With a
dashpot in the spring the poles of both meet, off the real axis or on it.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, root

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
GAP, AT, RATIO = 0.5, 0.8137, 0.01  # Hz, rad and 1, of the crank whose poles meet
HEAVY = 4000.0  # N s/m, with which one of its modes is overdamped over a part of the stroke

_HIGHEST = 1e3  # rad/s, below the mode in which the crank is stretched
_MASS = 10.0  # kg, at the crank's end; the tuned mass has 1 kg
_AXIAL = _MASS * (2.0 * math.pi * 5000.0) ** 2  # N/m
_BENDING = _MASS * (2.0 * math.pi * 20.0) ** 2  # N/m, of the crank without the spring
_SPRING = 6e4  # N/m
_ANCHOR = (2.2, 0.5)  # m, its end on the ground; the crank is 1 m long


def crossing_crank(
    gap: float, at: float, ratio: float = 0.01, dashpot: float | None = None
) -> Mechanism:
    """Return the mechanism, whose two modes are nearest at an angle, rad, with a gap, Hz.

    A gap of 0 lets them cross. The damping ratio, 1, is that at 10 and 100 Hz. The damping of the
    spring, N s/m, is by default that of the rule, so that the modes stay real.
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
    values = np.empty((len(alpha3), 2))
    for row, angle in zip(values, alpha3, strict=True):
        matrix = np.zeros((3, 3))
        matrix[:2, :2] = (np.diag([_AXIAL, _BENDING]) + _spring(angle)) / _MASS
        matrix[1, 2] = matrix[2, 1] = coupling / math.sqrt(_MASS)
        matrix[2, 2] = tuned
        row[:] = np.sqrt(np.linalg.eigvalsh(matrix)[:2]) / (2.0 * math.pi)
    return values


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


def poles_at(dashpot: float, alpha3: float) -> NDArray[np.complex128]:
    """Return the oscillating poles of the lower two modes, ascending, (2,) or (1,), rad/s.

    They are those with a dashpot, N s/m, at an angle, rad.
    """
    poles = exact_poles(GAP, AT, RATIO, dashpot, alpha3)
    return np.array(sorted(poles[(poles.imag > 0.0) & (np.abs(poles) < _HIGHEST)], key=abs))


def meeting_off_axis() -> tuple[float, float]:
    """Return the dashpot (N s/m) and the angle (rad) at which the poles of both modes meet."""

    def apart(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        first, other = poles_at(100.0 * float(unknown[1]), float(unknown[0]))
        square = (first - other) ** 2  # smooth, where the difference is not
        return np.array([square.real, square.imag])

    angle, dashpot = root(apart, [AT, 0.95], tol=1e-14).x
    return 100.0 * float(dashpot), float(angle)


def meeting_on_axis() -> tuple[float, float]:
    """Return the same where a pole meets its conjugate, and the mode becomes overdamped."""

    def square(alpha3: float) -> float:
        poles = exact_poles(GAP, AT, RATIO, HEAVY, alpha3)
        first, other = sorted(poles, key=lambda pole: abs(pole.imag))[:2]
        return float(((first - other) ** 2).real)

    return HEAVY, float(brentq(square, AT, 0.9, xtol=1e-15))


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
