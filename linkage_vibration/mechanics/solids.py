# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Solid components: pins tied rigidly to nodes, and Craig-Bampton with sparse factors.

Axes are the component's own: x along the link, z across it in the plane of motion, y out of it;
the plane of motion is y = 0, in which the solid is symmetric. The nodes of the surface of a pin
move with it as a rigid body, by x, z and theta; its rotation is free where it is no interface DoF.
Fixed-interface modes that are the negative of their mirror image in the plane of motion are left
out: they are out-of-plane bending or torsion, which motion in the plane does not excite.
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
# Relative difference of squares within which modes come mixed: a square bar bends along the
# diagonals of its mesh rather than in and out of the plane, and a little differently along each.
_SAME_FREQUENCY = 0.02


@dataclass(frozen=True, slots=True)
class Pin:
    """A point of a solid and the nodes of the surface that moves with it."""

    point: str  # its name
    place: tuple[float, float]  # x and z, m, in the plane y = 0
    nodes: IntArray  # (n,): indices of the nodes that are tied to it


def solid_matrices(
    mass: sparse.csc_array,
    stiffness: sparse.csc_array,
    nodes: FloatArray,
    pins: Sequence[Pin],
    n_modes: int,
    rotations: Collection[str] = (),
) -> Matrices:
    """Tie a free solid rigidly to its pins, and reduce it to them, without damping.

    The matrices, (3 n_nodes, 3 n_nodes), have x, y, z of each node, m. Interface DoFs are x, z and,
    for the points in `rotations`, theta of each pin; the fixed-interface modes follow.
    """
    ties, dofs = rigid_ties(nodes, pins, rotations)
    mass, stiffness = ((ties.T @ matrix @ ties).tocsc() for matrix in (mass, stiffness))
    parts, _ = connected_components(stiffness, directed=False)
    if parts > 1:
        hint = "join their meshes (shared nodes), or remove those that do not belong to the link"
        raise ReductionError(f"The solid consists of {parts} separate parts; {hint}.")
    free = np.delete(nodes, np.concatenate([pin.nodes for pin in pins]), axis=0)
    mirror = sparse.block_diag([sparse.identity(3 * len(pins)), _mirror(free)], format="csr")
    reduction = sparse_craig_bampton(mass, stiffness, len(dofs), n_modes, mirror)
    return Matrices(dofs, reduction.mass, reduction.stiffness, None)


def rigid_ties(
    nodes: FloatArray, pins: Sequence[Pin], rotations: Collection[str] = ()
) -> tuple[sparse.csc_array, tuple[InterfaceDof, ...]]:
    """Move the nodes of each pin as a rigid body: u = T q for small displacements in the plane.

    Rows of T are x, y, z node by node; columns are the interface DoFs, which are returned, too,
    then theta of the other pins, and x, y, z of each node that is in no pin.
    """
    tied = np.concatenate([pin.nodes for pin in pins])
    if len(np.unique(tied)) != len(tied):
        raise ReductionError("Two pins share a node; leave elements between their surfaces.")
    free = np.setdiff1d(np.arange(len(nodes)), tied)
    blocks = []
    for pin in pins:
        x, z = nodes[pin.nodes, 0] - pin.place[0], nodes[pin.nodes, 2] - pin.place[1]
        o, i = np.zeros(len(x)), np.ones(len(x))
        rigid = np.array([[i, o, -z], [o, o, o], [o, i, x]])  # theta turns x towards z
        blocks.append(rigid.transpose(2, 0, 1).reshape(-1, 3))
    rows = np.concatenate([tied, free])
    order = (3 * rows[:, None] + np.arange(3)).ravel()
    stacked = sparse.block_diag([*blocks, sparse.identity(3 * len(free))], format="csr")
    every = [InterfaceDof(pin.point, axis) for pin in pins for axis in ("x", "z", "theta")]
    inner = [dof.direction == "theta" and dof.point not in rotations for dof in every]
    columns = np.argsort([*inner, *np.full(3 * len(free), 2)], kind="stable")
    dofs = tuple(dof for dof, is_inner in zip(every, inner, strict=True) if not is_inner)
    return stacked[np.argsort(order)][:, columns].tocsc(), dofs


def sparse_craig_bampton(
    mass: sparse.csc_array,
    stiffness: sparse.csc_array,
    n_interface: int,
    n_modes: int,
    mirror: sparse.csr_array,
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
    squares, shapes = _fixed_interface_modes(k_ii, m_ii, factor.solve, n_modes, mirror[i, i])

    transformation = np.eye(mass.shape[0], n_interface + len(squares))
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
    mirror: sparse.csr_array,
) -> tuple[FloatArray, FloatArray]:
    """Return the lowest omega^2 and mass-normalised shapes, those of the right symmetry alone."""
    n = mass.shape[0]
    if n_modes == 0:
        return np.zeros(0), np.zeros((n, 0))
    asked = 2 * n_modes
    while True:
        whole = n <= _DENSE or asked >= n // 2
        if whole:
            squares, shapes = eigh(stiffness.toarray(), mass.toarray())
        else:
            start = np.random.default_rng(0).standard_normal(n)  # the same result every time
            inverse = LinearOperator((n, n), solve)
            squares, shapes = eigsh(stiffness, asked, mass, sigma=0.0, OPinv=inverse, v0=start)
            ascending = np.argsort(squares)
            squares, shapes = squares[ascending], shapes[:, ascending]
        squares, shapes = _symmetric(squares, shapes, mass, mirror)
        if whole or len(squares) >= n_modes or asked > 8 * n_modes:
            return squares[:n_modes], shapes[:, :n_modes]
        asked *= 2


def _symmetric(
    squares: FloatArray, shapes: FloatArray, mass: sparse.csc_array, mirror: sparse.csr_array
) -> tuple[FloatArray, FloatArray]:
    """Return the modes, of those given, that equal their mirror image.

    Only modes that nearly share a frequency are separated together, as much stiffer ones would
    spoil the low ones if the mesh is not quite symmetric.
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
