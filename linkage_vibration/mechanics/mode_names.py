# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Names of modes by what moves in them: the shares of their kinetic energy.

A mode is the tractor's if most of its strain energy is in the mounts of the base: there the
implement may move more than the tractor, but it moves with it. Not more modes are the tractor's
than it has motions. Other modes belong to the rigid body or the link that has most of the kinetic
energy. The tractor and rigid bodies surge (along x), heave (along z; the tractor bounces), pitch,
sway (along y), roll or yaw; a link bends or stretches.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.description import GROUND
from linkage_vibration.mechanics.lateral import LateralMap
from linkage_vibration.mechanics.model import Solution
from linkage_vibration.mechanics.modes import MECHANISM

_EQUAL = 1e-9  # of all energy: shares of symmetric bodies differ by rounding alone

_MOTIONS = {"x": "surge", "y": "sway", "z": "heave", "theta": "pitch", "roll": "roll", "yaw": "yaw"}

GROUPS = ("base", "rigid_bodies", "links")
"""The groups of bodies in the columns of `group_shares`."""


@dataclass(frozen=True, slots=True, eq=False)
class KineticEnergy:
    """Shares of the kinetic energy of modes in motions, such as the heave of a body."""

    motions: tuple[tuple[str, str], ...]  # (n_motions,): body and motion
    rigid: tuple[str, ...]  # names of the rigid bodies, without the base
    shares: FloatArray  # (n_motions, n_modes), 1; each column adds up to 1
    mounts: FloatArray  # (n_modes,): share of the mounts in the strain energy, 1

    def group_shares(self) -> FloatArray:
        """Return the shares of the base, the rigid bodies and the links, (n_modes, 3)."""
        shares = np.zeros((self.shares.shape[1], len(GROUPS)))
        for (body, _), row in zip(self.motions, self.shares, strict=True):
            shares[:, 0 if body == GROUND else 1 if body in self.rigid else 2] += row
        return shares


def kinetic_energy(solution: Solution, modes: IntArray | slice = slice(None)) -> KineticEnergy:
    """Return the kinetic energy of modes, of rigid bodies by DoF, of links by direction."""
    motions: list[tuple[str, str]] = []
    rows: list[FloatArray] = []
    rigid = tuple(body.name for body in solution.model.mechanism.rigid_bodies)
    for component in solution.model.system.components:
        shapes = solution.modes.shapes[solution.model.system.rows[component.name]]
        momenta = component.mass @ shapes
        if component.name == GROUND or component.name in rigid:
            named = _MOTIONS | ({"z": "bounce"} if component.name == GROUND else {})
            motions += [(component.name, named[dof.direction]) for dof in component.dofs]
            axes = _tractor_axes(component, solution)
            rows += list((axes @ shapes) * (axes @ momenta))
            continue
        energy = shapes * momenta
        along = _along(component, shapes)
        motions += [(component.name, "stretching"), (component.name, "bending")]
        rows += [energy.sum(axis=0) * along, energy.sum(axis=0) * (1.0 - along)]
    shares, count = np.array(rows), solution.model.interface.n_mounts
    joining, omega = solution.joining, np.maximum(solution.modes.omega, MECHANISM)
    first = len(joining.stiffness) - count
    stretch = joining.elongation[first:] @ solution.modes.shapes[: joining.elongation.shape[1]]
    mounts = joining.stiffness[first:] @ stretch**2 / omega**2
    shares = (shares / shares.sum(axis=0))[:, modes]
    return KineticEnergy(tuple(motions), rigid, shares, mounts[modes])


def _tractor_axes(component: Component, solution: Solution) -> FloatArray:
    """Return the matrix from a rigid body's DoFs to those of which roll is about what is forward.

    Products of angular velocity and momentum about these axes add up to the whole energy.
    """
    axes, interface = np.eye(len(component.dofs)), solution.model.interface
    if isinstance(interface, LateralMap):
        axes[1:, 1:] = interface.rotation_of(component.name, solution.configuration)
    return axes


def _along(component: Component, shapes: FloatArray) -> FloatArray:
    """Return the share of the motion of a link that is along it, (n_modes,)."""
    if component.drawing is None:
        axis = np.array([dof.direction == "x" for dof in component.dofs])
        lateral = np.array([dof.direction in "yz" for dof in component.dofs])
        moved = shapes[: len(component.dofs)] ** 2
        parts = moved[axis].sum(axis=0), moved[lateral].sum(axis=0)
    else:
        squares = ((component.drawing.displacement @ shapes) ** 2).sum(axis=0)
        parts = squares[0], squares[1]
    total = parts[0] + parts[1]
    return np.where(total > 0.0, parts[0] / np.where(total > 0.0, total, 1.0), 0.0)


def name_modes(energy: KineticEnergy, given: Sequence[str] = ()) -> tuple[str, ...]:
    """Return distinct names of modes, by the motions with most energy, or as `given`."""
    bodies = list(dict.fromkeys(body for body, _ in energy.motions))
    owners = np.array([body for body, _ in energy.motions])
    rows = {body: np.flatnonzero(owners == body) for body in bodies}
    totals = np.array([energy.shares[rows[b]].sum(axis=0) for b in bodies])
    if GROUND in bodies:
        most = np.argsort(-energy.mounts, kind="stable")[: len(rows[GROUND])]
        on_tyres = np.isin(np.arange(len(energy.mounts)), most) & (energy.mounts > 0.5)
        totals[bodies.index(GROUND)] = np.where(on_tyres, np.inf, 0.0)
    owner = (totals - _EQUAL * np.arange(len(bodies))[:, np.newaxis]).argmax(axis=0)
    names = [""] * energy.shares.shape[1]
    for i, body in enumerate(bodies):
        modes = np.flatnonzero(owner == i)
        shares = energy.shares[np.ix_(rows[body], modes)]
        shares = shares - _EQUAL * np.outer(range(len(shares)), len(modes) - np.arange(len(modes)))
        chosen = shares.argmax(axis=0)
        if body == GROUND or body in energy.rigid:
            at, motion = linear_sum_assignment(shares.T, maximize=True)
            chosen[at] = motion
        label = "tractor" if body == GROUND else body.replace("_", " ")
        for k, mode in enumerate(modes.tolist()):
            names[mode] = f"{label} {energy.motions[rows[body][chosen[k]]][1]}"
    names[: len(given)] = [new or old for new, old in zip(given, names, strict=False)]
    earlier = [names[:i].count(name) for i, name in enumerate(names)]
    return tuple(f"{name} {n + 1}" if n else name for name, n in zip(names, earlier, strict=True))
