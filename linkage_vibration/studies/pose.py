# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Places the pins of a linkage, and tabulates angles of bodies, static forces and cylinders."""

import math
from collections.abc import Sequence

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import GROUND, Cylinder, Mechanism
from linkage_vibration.mechanics.forces import GRAVITY
from linkage_vibration.mechanics.kinematics import Configuration, Kinematics
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.springs import length_and_rate, oil_pressure


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
    rows = [heads]
    for alpha3 in angles:
        configuration = kinematics.at(alpha3)
        degrees = [round(math.degrees(configuration.angle(name)), 2) % 360.0 for name in names]
        x, z = pin_places(mechanism, configuration)[point]
        numbers = [f"{angle:.2f}" for angle in (round(math.degrees(alpha3), 2) + 0.0, *degrees)]
        rows.append([*numbers, *(f"{round(float(place), 3) + 0.0:.3f}" for place in (x, z))])
    return aligned(rows)


def cylinder_rows(model: LinkageModel, angles: Sequence[float]) -> str:
    """Return tables of cylinders at crank angles, rad: length, lever, thrust of one, and oil."""
    tables, mechanism = [], model.mechanism
    for spring in mechanism.springs:
        if not isinstance(spring.stiffness, Cylinder):
            continue
        rows = [["alpha3", "length [m]", "lever [mm]", "load [kN]", "oil [bar]"]]
        for alpha3 in angles:
            at, tension = model.kinematics.at(alpha3), math.nan
            length, lever = length_and_rate(spring, mechanism, at)
            if model.force_places:
                row = model.forces.places.index((spring.name, "force"))
                tension = float(model.forces.at_rest(at, model.interface.join(at))[row])
            bar = oil_pressure(spring.stiffness, tension) / 1e5
            numbers = f"{length:.4f}", f"{1e3 * lever:.1f}", f"{-tension / 1e3:.2f}", f"{bar:.1f}"
            rows.append([f"{math.degrees(alpha3):.2f}", *numbers])
        tables.append(f"{spring.name}, one of {spring.stiffness.count}:\n{aligned(rows)}")
    hint = "describe the spring that holds the crank by a `cylinder` with its bore"
    unknown = f"The lever and the oil pressure of lift cylinders are not known; {hint}."
    return "\n\n".join(tables) or unknown


def axle_rows(model: LinkageModel, angles: Sequence[float]) -> str:
    """Return a table of the static loads of the base's mounts at crank angles, rad, in kg."""
    base = model.mechanism.base
    if base is None or not base.mounts or not model.force_places:
        hint = "give the base mounts, and no link by its FRFs alone"
        return f"The static loads of axles are not known; {hint}."
    rows = [["alpha3", *(f"{mount.name} [kg]" for mount in base.mounts)]]
    for alpha3 in angles:
        loads = [f"{load / GRAVITY:.0f}" for load in model.mount_loads(alpha3)]
        rows.append([f"{math.degrees(alpha3):.2f}", *loads])
    return f"Static loads, as a weighbridge shows them:\n{aligned(rows)}"


def force_rows(model: LinkageModel, angles: Sequence[float]) -> str:
    """Return a table of the forces under the weight at crank angles, rad, and what is wrong."""
    rows = [["alpha3", *(f"{name} [kN]" for name in model.force_places)]]
    for alpha3 in angles:
        rows.append([f"{math.degrees(alpha3):.2f}"])
        if model.force_places:
            rows[-1] += [f"{force:.2f}" for force in model.static_forces(alpha3) / 1e3]
    text = aligned(rows)
    if any("nan" in row for row in rows):
        hint = "give the crank `clamped`, a spring, or a cylinder with a lever"
        text += f"\nNothing holds the linkage against its weight where forces are nan; {hint}."
    return text


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Return rows of cells in columns that are as wide as their cells, and at least 12."""
    widths = [max(12, *(len(cell) + 2 for cell in column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True)) for row in rows
    )
