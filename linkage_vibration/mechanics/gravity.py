# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The stiffness that the weight of a linkage adds to it.

The configuration at an angle is that of the linkage at rest under its weight. Joints, springs and
links then carry forces, which turn with the bodies in a vibration. To the second order, the energy
of a force that turns is that of a stiffness: of beams by tension and shear force
(`components.Component.prestress`), of rigid bodies, points beside the axis of a beam, springs and
cylinders by their arms (`InterfaceMap.prestress`).
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.compatibility import CouplingError, InterfaceMap, Joining
from linkage_vibration.mechanics.components import Component, FrfComponent
from linkage_vibration.mechanics.coupling import CoupledSystem, UncoupledSystem, congruent, couple
from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.modes import MECHANISM, lowest_square

_SINGULAR = 1e-13  # Nothing holds a motion whose scaled singular value, of the largest, is smaller.
_BALANCED = 1e-6  # A larger part of the weight that nothing carries is more than rounding.

Components = Sequence[Component | FrfComponent]


def check_gravity(mechanism: Mechanism, components: Components) -> None:
    """Refuse gravity where a link is not made of beams."""
    if not mechanism.gravity:
        return
    for link, component in zip(mechanism.links, components, strict=False):
        if not isinstance(component, Component) or component.prestress is None:
            problem = f"the stiffness that forces add to links.{link.name} is not known"
            hint = "describe the link by material and section, or remove gravity"
            raise MechanismError("gravity", f"{problem}; {hint}.")


def prestress(
    mechanism: Mechanism,
    components: Components,
    interface: InterfaceMap,
    system: UncoupledSystem,
    configuration: Configuration,
    joining: Joining,
) -> FloatArray:
    """Return the stiffness that gravity adds to the components in a configuration, (n, n)."""
    parts = [c for c in components if isinstance(c, Component)]
    load = weight(parts, system, configuration, mechanism.gravity)
    moved = at_rest(couple(system, joining), load, configuration)
    b = slice(0, system.n_interface)
    springs = joining.stiffness * (joining.elongation @ moved[b])
    on_bodies = system.stiffness[b] @ moved - load[b]
    on_joints = -on_bodies - joining.elongation.T @ springs
    joints = np.linalg.lstsq(joining.compatibility.T, on_joints, rcond=None)[0]
    stiffness = np.zeros_like(system.stiffness)
    stiffness[b, b] = interface.prestress(configuration, np.asarray(joints, np.float64), springs)
    for part in parts:
        if part.prestress is not None:
            rows = system.rows[part.name]
            down = _down(part, configuration, mechanism.gravity)
            loads = np.append(on_bodies[rows[: len(part.dofs)]], down)
            stiffness[np.ix_(rows, rows)] += np.tensordot(loads, part.prestress, 1)
    return stiffness


def weight(
    parts: Sequence[Component], system: UncoupledSystem, configuration: Configuration, g: float
) -> FloatArray:
    """Return the weight of components with a gravity of g, m/s2, on all coordinates, (n,)."""
    load = np.zeros(len(system.mass))
    for part in parts:
        load[system.rows[part.name]] = part.mass @ part.translation(_down(part, configuration, g))
    return load


def _down(part: Component, configuration: Configuration, g: float) -> FloatArray:
    return part.own_axes(np.array([0.0, -g]), configuration.angle(part.name))


def at_rest(coupled: CoupledSystem, weight: FloatArray, configuration: Configuration) -> FloatArray:
    """Return how far weights, (n,), N, move the components until something carries them, (n,)."""
    n = len(coupled.basis)
    load = np.concatenate([coupled.basis.T @ weight[:n], weight[n:]])
    size = np.diag(coupled.stiffness)
    scale = np.sqrt(np.maximum(size, _SINGULAR * size.max() or 1.0))
    scaled = coupled.stiffness / np.outer(scale, scale)
    moved = np.linalg.lstsq(scaled, load / scale, rcond=_SINGULAR)[0] / scale
    unbalanced = np.abs(coupled.stiffness @ moved - load).max()
    if not unbalanced <= _BALANCED * np.abs(weight).max():
        at = f"alpha3 = {math.degrees(configuration.alpha3):.3f} deg"
        hint = "hold the crank with `clamped` or a spring and the base with mounts"
        raise CouplingError(f"Nothing carries the weight at {at}; {hint}, or remove gravity.")
    return coupled.expand(moved[:, np.newaxis])[:, 0]


def with_prestress(
    coupled: CoupledSystem, system: UncoupledSystem, added: FloatArray, alpha3: float
) -> CoupledSystem:
    """Return an assembly with the stiffness that gravity adds; refuse one that buckles or falls."""
    loaded = replace(coupled, stiffness=coupled.stiffness + congruent(system, added, coupled.basis))
    if lowest_square(loaded) < -(MECHANISM**2):
        at = f"alpha3 = {math.degrees(alpha3):.3f} deg"
        hint = "make springs and links stiffer, or remove gravity"
        raise CouplingError(f"Under its weight the linkage does not stay at {at}; {hint}.")
    return loaded
