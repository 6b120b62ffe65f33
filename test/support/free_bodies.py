# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Forces of bodies that are cut free, solved line by line: no modes, no table, no rows of forces.

Each body has its own equation of motion, and what its pins exert on it are the Lagrange multipliers
of B u = 0. A spring or damper exerts (k + i w c) times its elongation on both of its bodies.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.springs import tension_share

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def forces_by_cuts(
    model: LinkageModel, alpha3: float, frequencies: Array, inputs: Sequence[tuple[str, str]]
) -> Complex:
    """Return the forces of a model per force at inputs, (n_freq, n_forces, n_inputs), N/N.

    They are in the order of its places of forces, at frequencies in Hz.
    """
    rows = model.rows(inputs, model.kinematics.at(alpha3))
    load = np.zeros((len(model.system.mass), len(inputs)))
    load[: rows.shape[1]] = rows.T
    return np.array([solve_cuts(model, alpha3, 2j * math.pi * f, load)[0] for f in frequencies])


def static_forces_by_cuts(model: LinkageModel, alpha3: float) -> Array:
    """Return the components of the forces under the weight, (n_forces,), N."""
    system, configuration = model.system, model.kinematics.at(alpha3)
    load = np.zeros((len(system.mass), 1))
    for part in system.components:
        down = part.translation(np.array([0.0, -9.80665]), configuration.turn(part.name))
        load[system.rows[part.name], 0] = part.mass @ down
    return np.asarray(solve_cuts(model, alpha3, 0j, load)[0][:, 0].real)


def solve_cuts(
    model: LinkageModel, alpha3: float, s: complex, load: Array
) -> tuple[Complex, Complex]:
    """Return forces, (n_forces, k), and motions, (n, k), by loads, (n, k), times exp(s t)."""
    system = model.system
    joining = model.interface.join(model.kinematics.at(alpha3))
    b, stretch = widened(model, joining.compatibility), widened(model, joining.elongation)
    law = joining.stiffness + s * joining.damping
    bodies = system.stiffness + s * system.damping + s**2 * system.mass + 1j * system.loss * bool(s)
    bodies = bodies + stretch.T @ (law[:, np.newaxis] * stretch)
    scale = np.abs(bodies).max()
    whole = np.block([[bodies, scale * b.T], [scale * b, np.zeros((len(b), len(b)))]])
    solved = np.linalg.solve(whole, np.vstack([load, np.zeros((len(b), load.shape[1]))]))
    moved, pulls = solved[: len(bodies)], scale * solved[len(bodies) :]
    by_pulls, shares = places_of(model, alpha3)
    springs = shares @ (law[:, np.newaxis] * (stretch @ moved))
    return by_pulls @ pulls + springs, moved


def widened(model: LinkageModel, rows: Array) -> Array:
    """Return rows on the interface DoFs as rows on all coordinates."""
    return np.pad(rows, ((0, 0), (0, len(model.system.mass) - rows.shape[1])))


def places_of(model: LinkageModel, alpha3: float) -> tuple[Array, Array]:
    """Return forces per multiplier, and per force of springs and mounts, (n_forces, ...)."""
    mechanism, configuration = model.mechanism, model.kinematics.at(alpha3)
    joining = model.interface.join(configuration)
    shape = len(model.forces.places), len(joining.labels)
    by_pulls, shares = np.zeros(shape), np.zeros((shape[0], len(joining.stiffness)))
    counts = {link.name: link.count for link in mechanism.links}
    springs = [spring.name for spring in mechanism.springs]
    for row, (name, direction) in enumerate(model.forces.places):
        if name in springs:
            i = springs.index(name)
            shares[row, i] = tension_share(mechanism.springs[i], mechanism, configuration)
            continue
        link, point = name.split(":")
        if link == "base":
            mounts = [(mount.name, axis) for mount, axis in mechanism.mount_springs]
            shares[row, len(springs) + mounts.index((point, 1))] = 1.0
            continue
        [label] = [
            each
            for each in joining.labels
            if each.startswith(f"pin {point} of ") and each.endswith(f" in {direction[-1]}")
        ]
        sign = -1.0 if label.startswith(f"pin {point} of {link} and") else 1.0
        by_pulls[row, joining.labels.index(label)] = sign / counts[link]
    return by_pulls, shares
