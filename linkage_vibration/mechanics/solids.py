# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Solid components: pins tied rigidly to nodes, and Craig-Bampton with sparse factors.

Axes are the component's own: x along the link, z across it in the plane of motion, y out of it;
the plane of motion is y = 0. A pin is a node at its point with three translations and three
rotations, and the nodes of its surface move with it as a rigid body.

Each motion of a pin is an interface DoF, moves freely, or is held:

======================  ==================================  ======================================
motion of the pin       planar                              spatial
======================  ==================================  ======================================
translations x, z       interface                           interface
translation y           held: the plane of symmetry         interface
rotation theta          interface where asked, else free    interface where asked, else free
rotations about x, z    held: the plane of symmetry         free: a pin is a ball joint
======================  ==================================  ======================================

In the spatial model a body with all its pins on one line could still spin about that line, where no
pin excites or holds it; so the rotation of the first pin about that line is held. In the planar
model, fixed-interface modes that are the negative of their mirror image in the plane of motion are
left out: they are out-of-plane bending or torsion, which motion in the plane does not excite.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import eigh
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, eigsh, splu
from scipy.spatial import cKDTree

from linkage_vibration.mechanics.arrays import FloatArray, IntArray, symmetric
from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.reduction import SINGULAR, Reduction, ReductionError, not_held

_DENSE = 400  # LAPACK finds all modes at once up to this number of coordinates.
# A pin's six coordinates in the mirror y = 0: rotations turn over where displacements do not.
_PIN_IMAGE = [1.0, -1.0, 1.0, -1.0, 1.0, -1.0]
# Relative difference of squares within which modes come mixed: a square bar bends along the
# diagonals of its mesh rather than in and out of the plane, and a little differently along each.
_SAME_FREQUENCY = 0.02


@dataclass(frozen=True, slots=True)
class Pin:
    """A point of a solid and the nodes of the surface that moves with it."""

    point: str  # its name
    place: tuple[float, float]  # x and z, m; the pin's node lies there in the plane y = 0
    nodes: IntArray  # (n,): indices of the nodes that are tied to it


def solid_matrices(
    mass: sparse.csc_array,
    stiffness: sparse.csc_array,
    nodes: FloatArray,
    pins: Sequence[Pin],
    n_modes: int,
    *,
    rotations: Collection[str] = (),
    spatial: bool = False,
) -> Matrices:
    """Tie a free solid rigidly to its pins, and reduce it to them, without damping.

    The sparse matrices, (3 n_nodes, 3 n_nodes), have the displacements x, y, z of each node at
    (n_nodes, 3), m. The interface DoFs are x, (y,) z and, for the points in `rotations`, theta,
    point by point in the order of the pins; the fixed-interface modes follow.
    """
    transformation = rigid_ties(nodes, [pin.nodes for pin in pins], _places(pins))
    turning, dofs = _pin_coordinates(pins, rotations, spatial)
    n_free = transformation.shape[1] - 6 * len(pins)
    keep = sparse.block_diag([turning, sparse.identity(n_free)], format="csc")
    transformation = transformation @ keep
    mass = (transformation.T @ mass @ transformation).tocsc()
    stiffness = (transformation.T @ stiffness @ transformation).tocsc()
    parts, _ = connected_components(stiffness, directed=False)
    if parts > 1:
        raise ReductionError(
            f"The solid consists of {parts} separate parts; join their meshes (shared nodes), or "
            "remove the parts that do not belong to the component."
        )
    mirror = None
    if not spatial:
        tied = np.concatenate([pin.nodes for pin in pins])
        free = np.delete(nodes, tied, axis=0)
        mirror = sparse.block_diag(
            [turning.T @ np.diag(_PIN_IMAGE * len(pins)) @ turning, _mirror(free)], format="csr"
        )
    reduction = sparse_craig_bampton(mass, stiffness, len(dofs), n_modes, mirror)
    return Matrices(dofs, reduction.mass, reduction.stiffness, None)


def rigid_ties(
    nodes: FloatArray, groups: Sequence[IntArray], places: FloatArray
) -> sparse.csc_array:
    """Move groups of nodes as rigid bodies: u = T q for small displacements.

    The rows of T, (3 n_nodes, 6 n_groups + 3 n_free), are x, y, z node by node. The columns are
    translations x, y, z and rotations about x, y, z of each group at its place, (n_groups, 3), m,
    then x, y, z of each node that is in no group.
    """
    tied = np.concatenate(groups)
    if len(np.unique(tied)) != len(tied):
        raise ReductionError("Two pins share a node; leave elements between their surfaces.")
    free = np.setdiff1d(np.arange(len(nodes)), tied)
    blocks = []
    for group, place in zip(groups, places, strict=True):
        x, y, z = (nodes[group] - place).T
        o, i = np.zeros(len(group)), np.ones(len(group))
        # u + omega x r, row by row
        rigid = np.array([[i, o, o, o, z, -y], [o, i, o, -z, o, x], [o, o, i, y, -x, o]])
        blocks.append(rigid.transpose(2, 0, 1).reshape(-1, 6))
    rows = np.concatenate([tied, free])
    order = (3 * rows[:, None] + np.arange(3)).ravel()
    stacked = sparse.block_diag([*blocks, sparse.identity(3 * len(free))], format="csr")
    return stacked[np.argsort(order)].tocsc()


def sparse_craig_bampton(
    mass: sparse.csc_array,
    stiffness: sparse.csc_array,
    n_interface: int,
    n_modes: int,
    mirror: sparse.csr_array | None = None,
) -> Reduction:
    """Reduce to interface DoFs and fixed-interface modes, as `reduction.craig_bampton` does.

    Modes that equal the negative of their image in the `mirror`, (n, n), are left out.
    """
    b, i = slice(0, n_interface), slice(n_interface, None)
    k_ii, m_ii = stiffness[i, i].tocsc(), mass[i, i].tocsc()
    try:
        # Without pivoting the factor of a positive definite matrix stays symmetric and sparse.
        factor = splu(
            k_ii, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        pivots = factor.U.diagonal()[factor.perm_c] / k_ii.diagonal()
    except RuntimeError:
        pivots = np.zeros(1)
    if not (pivots > SINGULAR).all():
        raise not_held(n_interface)
    extension = -factor.solve(stiffness[i, b].toarray())
    reflect = None if mirror is None else mirror[i, i]
    squares, shapes = _fixed_interface_modes(k_ii, m_ii, factor.solve, n_modes, reflect)

    transformation = np.zeros((mass.shape[0], n_interface + len(squares)))
    transformation[b, b] = np.eye(n_interface)
    transformation[i, b] = extension
    transformation[i, i] = shapes
    reduced_mass = transformation.T @ (mass @ transformation)
    # The product T^T K T has no other terms; leaving out those that cancel leaves out their noise.
    reduced_stiffness = np.diag(np.concatenate([np.zeros(n_interface), squares]))
    reduced_stiffness[b, b] = stiffness[b, b].toarray() + stiffness[b, i] @ extension
    return Reduction(symmetric(reduced_mass), symmetric(reduced_stiffness), transformation)


def _fixed_interface_modes(
    stiffness: sparse.csc_array,
    mass: sparse.csc_array,
    solve: Callable[[FloatArray], FloatArray],
    n_modes: int,
    mirror: sparse.csr_array | None,
) -> tuple[FloatArray, FloatArray]:
    """Return the lowest omega^2 and mass-normalised shapes, those of the right symmetry alone."""
    n = mass.shape[0]
    if n_modes == 0:
        return np.zeros(0), np.zeros((n, 0))
    asked = n_modes if mirror is None else 2 * n_modes
    while True:
        whole = n <= _DENSE or asked >= n // 2
        if whole:
            squares, shapes = eigh(stiffness.toarray(), mass.toarray())
        else:
            squares, shapes = eigsh(
                stiffness,
                asked,
                mass,
                sigma=0.0,
                OPinv=LinearOperator((n, n), solve),
                v0=np.random.default_rng(0).standard_normal(n),  # the same result every time
            )
            ascending = np.argsort(squares)
            squares, shapes = squares[ascending], shapes[:, ascending]
        if mirror is not None:
            squares, shapes = _symmetric(squares, shapes, mass, mirror)
        if whole or len(squares) >= n_modes or asked > 8 * n_modes:
            return squares[:n_modes], shapes[:, :n_modes]
        asked *= 2


def _symmetric(
    squares: FloatArray, shapes: FloatArray, mass: sparse.csc_array, mirror: sparse.csr_array
) -> tuple[FloatArray, FloatArray]:
    """Return the modes, of those given, that equal their mirror image.

    Modes that nearly share a frequency are mixed, and are separated together. Mixing others too
    would spoil the low ones if the mesh is not quite symmetric, since the high ones are much
    stiffer.
    """
    images = symmetric(shapes.T @ (mass @ (mirror @ shapes)))
    gaps = np.flatnonzero(np.diff(squares) > _SAME_FREQUENCY * squares[1:]) + 1
    values_kept, shapes_kept = [np.zeros(0)], [shapes[:, :0]]
    for group in np.split(np.arange(len(squares)), gaps):
        likeness, basis = eigh(images[np.ix_(group, group)])
        basis = basis[:, likeness > 0.0]
        if basis.shape[1]:
            values, mixture = eigh(basis.T @ (squares[group, None] * basis))
            values_kept.append(values)
            shapes_kept.append(shapes[:, group] @ (basis @ mixture))
    return np.concatenate(values_kept), np.hstack(shapes_kept)


def _mirror(nodes: FloatArray) -> sparse.csr_array:
    """Reflect displacements of nodes in the plane y = 0, each image taken at the nearest node."""
    _, nearest = cKDTree(nodes).query(nodes * [1.0, -1.0, 1.0])
    n = len(nodes)
    swap = sparse.csr_array((np.ones(n), (np.arange(n), nearest)), shape=(n, n))
    return sparse.kron(swap, np.diag([1.0, -1.0, 1.0]), format="csr")


def _places(pins: Sequence[Pin]) -> FloatArray:
    return np.array([(x, 0.0, z) for x, z in (pin.place for pin in pins)])


def _pin_coordinates(
    pins: Sequence[Pin], rotations: Collection[str], spatial: bool
) -> tuple[FloatArray, tuple[InterfaceDof, ...]]:
    """Return what is left of six coordinates a pin, interface DoFs first, and their names."""
    dofs: list[InterfaceDof] = []
    interface: list[FloatArray] = []
    inner: list[FloatArray] = []
    unit = np.eye(6 * len(pins))
    spin = _spin_axis(pins) if spatial else None
    for p, pin in enumerate(pins):
        x, y, z, about_x, about_y, about_z = unit[6 * p : 6 * p + 6]
        for direction, column in (("x", x), ("y", y), ("z", z)):
            if spatial or direction != "y":
                dofs.append(InterfaceDof(pin.point, direction))
                interface.append(column)
        theta = -about_y  # theta turns x towards z, a positive rotation about y turns z towards x
        if pin.point in rotations:
            dofs.append(InterfaceDof(pin.point, "theta"))
            interface.append(theta)
        else:
            inner.append(theta)
        if spatial and p == 0 and spin is not None:
            inner.append(spin[0] * about_z - spin[1] * about_x)
        elif spatial:
            inner += [about_x, about_z]
    return np.array(interface + inner).T, tuple(dofs)


def _spin_axis(pins: Sequence[Pin]) -> tuple[float, float] | None:
    """Return x and z of the line on which all pins lie, as a unit vector, or None."""
    offsets = np.array([pin.place for pin in pins]) - pins[0].place
    _, sizes, axes = np.linalg.svd(offsets)
    if sizes[1:].size and sizes[1] > 1e-6 * sizes[0]:
        return None
    return float(axes[0, 0]), float(axes[0, 1])
