# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies as the rest of the mechanics sees them: matrices or FRFs on interface DoFs.

A component is invariant: its numbers are in its own axes and are made once. Only the compatibility
matrix that couples the components changes with the configuration.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from linkage_vibration.mechanics.beams import beam_matrices
from linkage_vibration.mechanics.description import (
    Beam,
    Damping,
    Frfs,
    Link,
    LossFactor,
    MechanismError,
    ModalRatio,
    Rayleigh,
    RigidBody,
)
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.reduction import ReductionError, craig_bampton
from linkage_vibration.mechanics.regularisation import (
    Measured,
    RegularisationError,
    noise_level,
    regularise,
    rigid_motions,
)

FloatArray = NDArray[np.float64]

CENTRE_OF_GRAVITY = "centre of gravity"


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """How a component's coordinates move the points by which it is drawn.

    Attributes
    ----------
    places : ndarray, (n_points, 2)
        Local x and z of the points, in order along the body, m.
    displacement : ndarray, (n_points, 3, n)
        Local x, y and z displacement of each for each coordinate.
    """

    places: FloatArray
    displacement: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """A body known by its matrices.

    Attributes
    ----------
    name : str
        Of the body.
    dofs : tuple of InterfaceDof, (n_interface,)
        The first rows and columns of the matrices; all others are inner coordinates.
    mass, stiffness, damping : ndarray, (n, n)
        SI; damping is viscous.
    loss_factor : float
        Structural damping: the stiffness is K (1 + i eta).
    drawing : Drawing or None
        Where it is known what the body looks like.
    """

    name: str
    dofs: tuple[InterfaceDof, ...]
    mass: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    loss_factor: float
    drawing: Drawing | None


@dataclass(frozen=True, slots=True, eq=False)
class FrfComponent:
    """A body known by its FRFs alone.

    Attributes
    ----------
    name : str
        Of the body.
    dofs : tuple of InterfaceDof, (n_interface,)
        Rows and columns.
    frequencies : ndarray, (n_freq,)
        Hz, ascending, above 0.
    measured : Measured
        Receptances of the free body, regularised.
    noise : float
        Of the receptances as they were measured, relative, 1.
    """

    name: str
    dofs: tuple[InterfaceDof, ...]
    frequencies: FloatArray
    measured: Measured
    noise: float


def link_component(
    link: Link,
    damping: Damping,
    rotations: frozenset[str],
    *,
    spatial: bool = False,
    reduced: bool = True,
) -> Component | FrfComponent:
    """Put a link on its interface DoFs.

    Parameters
    ----------
    link : Link
        A beam, matrices or FRFs.
    damping : Damping
        The rule for a link that has none of its own.
    rotations : frozenset of str
        Points whose rotation about the joint axis has to be an interface DoF.
    spatial : bool
        Keep the displacement out of plane as well.
    reduced : bool
        False keeps every DoF of the body instead of ``link.modes`` fixed-interface modes.

    Raises
    ------
    MechanismError
        If the body lacks a DoF that the linkage needs.
    ReductionError
        If the link has too few points to be held by them.
    RegularisationError
        If its FRFs contradict one another.
    """
    wanted = tuple(
        InterfaceDof(point, direction)
        for point, _ in link.points
        for direction in ("x", "y", "z", "theta")
        if direction in ("x", "z")
        or (direction == "y" and spatial)
        or (direction == "theta" and point in rotations)
    )
    viscous: FloatArray | None = None
    nodes = motion = None
    if isinstance(link.body, Frfs):
        order = _positions(link, link.body.dofs, wanted)
        if link.masses:
            raise MechanismError(
                f"links.{link.name}.masses", "a link known by its FRFs takes no point masses."
            )
        moving = link.body.frequencies > 0.0
        frequencies = link.body.frequencies[moving]
        frf = link.body.frf[moving][:, order][:, :, order] / link.count
        try:
            measured = regularise(wanted, frequencies, frf, rigid_motions(wanted, link.points))
        except RegularisationError as error:
            raise RegularisationError(f"links.{link.name}: {error}") from None
        return FrfComponent(link.name, wanted, frequencies, measured, noise_level(frequencies, frf))
    if isinstance(link.body, Beam):
        try:
            beam = beam_matrices(
                link.body,
                link.points,
                rotations=rotations,
                masses=link.masses,
                clamped=link.clamped,
                spatial=spatial,
            )
        except MechanismError as error:
            raise MechanismError(f"links.{link.name}.{error.path}", error.problem) from None
        dofs, mass, stiffness = beam.dofs, beam.mass, beam.stiffness
        nodes, motion = np.column_stack([beam.nodes, np.zeros(len(beam.nodes))]), beam.displacement
    else:
        dofs = link.body.dofs
        mass, stiffness = link.body.mass.copy(), link.body.stiffness
        if mass.dtype != np.float64 or stiffness.dtype != np.float64:
            raise MechanismError(
                f"links.{link.name}",
                f"its matrices are {mass.dtype} and {stiffness.dtype}, not float64; single "
                "precision does not hold a stiffness and its effects: export them in double.",
            )
        viscous = link.body.damping
        for point, value in link.masses:
            for direction in ("x", "y", "z") if spatial else ("x", "z"):
                at = _positions(link, dofs, (InterfaceDof(point, direction),))[0]
                mass[at, at] += value
    first = _positions(link, dofs, wanted)
    # A planar model holds the body out of the plane; rotations that nobody holds are free.
    held = {i for i, dof in enumerate(dofs) if dof.direction == "y" and not spatial}
    order = first + [i for i in range(len(mass)) if i not in held.union(first)]
    block = np.ix_(order, order)
    mass, stiffness = mass[block], stiffness[block]
    viscous = None if viscous is None else viscous[block]
    motion = None if motion is None else motion[:, :, order]
    if reduced:
        try:
            reduction = craig_bampton(mass, stiffness, len(wanted), link.modes)
        except ReductionError as error:
            raise ReductionError(f"links.{link.name}: {error}") from None
        mass, stiffness = reduction.mass, reduction.stiffness
        t = reduction.transformation
        viscous = None if viscous is None else t.T @ viscous @ t
        motion = None if motion is None else motion @ t
    rule = link.damping or damping
    if viscous is None:
        viscous = viscous_damping(rule, mass, stiffness)
    return Component(
        name=link.name,
        dofs=wanted,
        mass=link.count * mass,
        stiffness=link.count * stiffness,
        damping=link.count * viscous,
        loss_factor=rule.factor if isinstance(rule, LossFactor) else 0.0,
        drawing=None if nodes is None or motion is None else Drawing(nodes, motion),
    )


def rigid_component(body: RigidBody, damping: Damping) -> Component:
    """Put a rigid body on the three DoFs of its centre of gravity, along the global axes.

    Turning the axes leaves its mass matrix as it is, so the global axes serve as its own. It does
    not move out of the plane: in a spatial model it is held there.
    """
    dofs = tuple(InterfaceDof(CENTRE_OF_GRAVITY, direction) for direction in ("x", "z", "theta"))
    mass, stiffness = np.diag([body.mass, body.mass, body.inertia]), np.zeros((3, 3))
    viscous = viscous_damping(damping, mass, stiffness)
    return Component(body.name, dofs, mass, stiffness, viscous, 0.0, None)


def viscous_damping(rule: Damping, mass: FloatArray, stiffness: FloatArray) -> FloatArray:
    """Return the viscous damping matrix, (n, n), that a rule gives to a component.

    A modal ratio zeta makes C = sum over r of 2 zeta w_r M phi_r phi_r^T M with the free
    component's modes, which damps none of its rigid motions.
    """
    if isinstance(rule, Rayleigh):
        return rule.mass_coefficient * mass + rule.stiffness_coefficient * stiffness
    if isinstance(rule, ModalRatio):
        values, shapes = eigh(stiffness, mass)
        momenta = mass @ shapes
        floor = values.max(initial=0.0) * 1e-13  # rigid motions, but for rounding
        omega = np.sqrt(np.where(values > floor, values, 0.0))
        damped = (momenta * (2.0 * rule.ratio * omega)) @ momenta.T
        return np.asarray((damped + damped.T) / 2.0)
    return np.zeros_like(mass)


def _positions(
    link: Link, have: tuple[InterfaceDof, ...], wanted: tuple[InterfaceDof, ...]
) -> list[int]:
    """Where each wanted DoF stands among those that the body has."""
    for dof in wanted:
        if dof not in have:
            raise MechanismError(
                f"links.{link.name}",
                f"its body lacks the DoF {dof}; it has {', '.join(map(str, have))}.",
            )
    return [have.index(dof) for dof in wanted]
