# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The stiffness of a spring in a configuration.

A spring has one stiffness, or it is the oil column of a hydraulic cylinder. Oil of the bulk modulus
B in the volume V resists a piston of the area A with B A^2 / V, where V = V_hose + A x grows with
the travel x of the piston. On a joint, the cylinder acts with its lever r about the pin, as a
spring of k r^2.
"""

import math

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.mechanics.description import (
    Cylinder,
    Mechanism,
    MechanismError,
    Point,
    Spring,
)
from linkage_vibration.mechanics.keys import RIGID, STIFFEST, CheckedMapping
from linkage_vibration.mechanics.kinematics import Configuration

# No cylinder comes near these limits; numbers in millimetres, litres or MPa go beyond them.
_LONGER = 10.0  # largest ratio of bore or stroke to the closed length
_MOST_HOSE = 100.0  # largest ratio of the volumes of hoses and cylinder
_SOFTEST = 1e5  # Pa, the bulk modulus of air
_SAME_PLACE = 1e-9  # m; the ends of a spring meet if they are nearer to one another

Values = float | FloatArray


def spring_stiffness(spring: Spring, mechanism: Mechanism, configuration: Configuration) -> Values:
    """Return the stiffness of a spring, N/m or N m/rad, in each configuration."""
    if isinstance(spring.stiffness, float):
        return spring.stiffness
    _, length = spring_line(spring, mechanism, configuration)
    axial = _column(spring.name, spring.stiffness, length, configuration)
    if spring.stiffness.ends is None:
        return axial
    return axial * _lever(spring, mechanism, configuration) ** 2


def has_force(spring: Spring) -> bool:
    """Return whether a spring or damper carries a force along a line, rather than a moment."""
    return len(spring.points) == 2 or isinstance(spring.stiffness, Cylinder)


def tension_share(spring: Spring, mechanism: Mechanism, configuration: Configuration) -> Values:
    """Return the tension of one of the equal parts of a spring, per N or N m of the spring."""
    if not isinstance(spring.stiffness, Cylinder):
        return 1.0
    if spring.stiffness.ends is None:
        return 1.0 / spring.stiffness.count
    lever = spring.stiffness.count * _lever(spring, mechanism, configuration)
    # A cylinder without a lever holds nothing.
    return np.asarray(1.0 / np.where(lever == 0.0, math.nan, lever))


def read_stiffness(keys: CheckedMapping) -> float | Cylinder:
    """Read the stiffness of a spring: a number, or that of a cylinder."""
    if "cylinder" in keys:
        return _read_cylinder(keys["cylinder"], on_joint="joint" in keys)
    return keys.number("stiffness", default=0.0, least=0.0, most=STIFFEST, hint=RIGID)


def _read_cylinder(keys: CheckedMapping, *, on_joint: bool) -> Cylinder:
    closed = keys.number("closed_length", positive=True)
    bore, stroke = (
        keys.number(key, positive=True, most=_LONGER * closed, hint="lengths are in m")
        for key in ("bore", "stroke")
    )
    rod = keys.number("rod", positive=True) if "rod" in keys else None
    if rod is not None and rod >= bore:
        raise keys.error("rod", f"{rod:g} m does not fit into a bore of {bore:g} m; check both.")
    most = _MOST_HOSE * math.pi / 4.0 * bore**2 * stroke
    hint = f"the cylinder has {most / _MOST_HOSE:.3g} m3, and a litre is 1.0e-3"
    hose = keys.number("hose_volume", default=0.0, least=0.0, most=most, hint=hint)
    return Cylinder(
        ends=(keys.point("base_end"), keys.point("rod_end")) if on_joint else None,
        count=keys.integer("count", default=1),
        bore=bore,
        rod=rod,
        stroke=stroke,
        closed_length=closed,
        hose_volume=hose,
        bulk_modulus=keys.number("bulk_modulus", least=_SOFTEST, hint="mineral oil has 1.6e+9 Pa"),
    )


def _ends(spring: Spring, mechanism: Mechanism) -> list[tuple[str, Point]]:
    """Return the two ends of a spring or of a cylinder on a joint: body and place in its axes."""
    if isinstance(spring.stiffness, Cylinder) and spring.stiffness.ends is not None:
        return list(zip(spring.bodies, spring.stiffness.ends, strict=True))
    both = zip(spring.bodies, spring.points, strict=True)
    return [(body, mechanism.local_points(body)[point]) for body, point in both]


def spring_line(
    spring: Spring, mechanism: Mechanism, configuration: Configuration
) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors from the first end of a spring to the second, and lengths.

    Of the unit vectors, (..., 2) are seen from the side, as both ends may have another y.
    """
    first, second = _ends(spring, mechanism)
    away = configuration.place(*second) - configuration.place(*first)
    y = dict(mechanism.lateral.y) if mechanism.lateral and len(spring.points) == 2 else {}
    aside = y.get(spring.points[-1], 0.0) - y.get(spring.points[0], 0.0)
    length = np.sqrt(away[..., 0] ** 2 + away[..., 1] ** 2 + aside**2)
    if (length < _SAME_PLACE).any():
        between = len(spring.points) == 2
        hint = "put it on the joint instead" if between else "correct base_end or rod_end"
        where = f"alpha3 = {_degrees(configuration, length < _SAME_PLACE):.3f} deg"
        problem = f"its two ends meet at {where}, so it has no direction there; {hint}."
        raise MechanismError(f"springs.{spring.name}", problem)
    return away / length[..., np.newaxis], length


def _degrees(configuration: Configuration, where: BoolArray) -> float:
    """Return the first of the angles alpha3 that are flagged, deg."""
    return math.degrees(np.extract(where, configuration.alpha3)[0])


def length_and_rate(
    spring: Spring, mechanism: Mechanism, configuration: Configuration
) -> tuple[float, float]:
    """Return the length of a spring, m, and d(length)/d(alpha3), its lever about the crank, m."""
    unit, length = spring_line(spring, mechanism, configuration)
    first, second = (configuration.place_rate(*end) for end in _ends(spring, mechanism))
    return float(length), float(unit @ (second - first))


def oil_pressure(cylinder: Cylinder, tension: float) -> float:
    """Return the oil pressure, Pa, of one cylinder under a tension, N; NaN if it cannot pull."""
    area = math.pi / 4.0 * cylinder.bore**2
    if tension > 0.0:
        area -= math.pi / 4.0 * (cylinder.rod or cylinder.bore) ** 2
    return abs(tension) / area if area else math.nan


def _lever(spring: Spring, mechanism: Mechanism, configuration: Configuration) -> FloatArray:
    """Return the lever of a cylinder about its pin, m."""
    unit, _ = spring_line(spring, mechanism, configuration)
    body, pin = spring.bodies[0], spring.points[0]
    start = configuration.place(body, mechanism.local_points(body)[pin])
    arm = configuration.place(*_ends(spring, mechanism)[1]) - start  # to the end that turns
    # This end moves across the arm.
    return np.asarray(unit[..., 1] * arm[..., 0] - unit[..., 0] * arm[..., 1])


def _column(
    name: str, cylinder: Cylinder, length: FloatArray, configuration: Configuration
) -> FloatArray:
    """Return the stiffness of the oil along the cylinder, N/m."""
    travel = length - cylinder.closed_length
    off = ~((travel >= -cylinder.margin) & (travel <= cylinder.stroke + cylinder.margin))
    if off.any():
        at, far = f"alpha3 = {_degrees(configuration, off):.2f} deg", np.extract(off, length)[0]
        fits = f"{cylinder.closed_length:g} to {cylinder.closed_length + cylinder.stroke:g} m long"
        problem = f"its ends are {far:.4g} m apart at {at}, but it is {fits}; correct the ends, "
        raise MechanismError(f"springs.{name}.cylinder", f"{problem}closed_length or stroke.")
    bore = math.pi / 4.0 * cylinder.bore**2
    sides = [(bore, travel)]
    if cylinder.rod is not None:
        ring = bore - math.pi / 4.0 * cylinder.rod**2
        sides.append((ring, cylinder.stroke - travel))
    stiffness = np.zeros_like(length)
    for area, height in sides:
        volume = cylinder.hose_volume + area * height
        low = cylinder.count * cylinder.bulk_modulus * area**2 > STIFFEST * volume
        if low.any():
            at, least = f"{_degrees(configuration, low):.2f} deg", np.extract(low, height)[0]
            problem = f"at alpha3 = {at} its oil is only {least:.2g} m high, and as stiff as a "
            problem += "rigid body"
            hint = "give hose_volume, or correct closed_length"
            raise MechanismError(f"springs.{name}.cylinder", f"{problem}; {hint}.")
        stiffness = stiffness + cylinder.count * cylinder.bulk_modulus * area**2 / volume
    return stiffness
