# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reduces solid links with scikit-fem to matrices on their pins, as users do with an FE program."""

from dataclasses import replace

import numpy as np
import skfem
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, eigsh, splu
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity

from benchmark.validation.calculix import SolidMesh
from linkage_vibration.mechanics.bodies.beam import Beam
from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.description import Link, Material
from linkage_vibration.mechanics.dofs import InterfaceDof

FIXED_INTERFACE_MODES = 20
"""For each link, as in the paper's Table 2."""

_TRIED = 60  # modes, of which about half move in the plane
_OUT_OF_PLANE = 0.01  # A mode takes part less than this share of the first in motions of the pins.


def solid_link(link: Link, mesh: SolidMesh, rotations: frozenset[str]) -> Link:
    """Return a link with the reduced matrices of its solid mesh instead of beams.

    The nodes of each bore move as a rigid body by x, z and theta, where theta is free unless the
    point is in `rotations`.
    """
    assert isinstance(link.body, Beam)  # the mesh was made from it
    ties, dofs = _ties(link, mesh, rotations)
    mass, stiffness = (ties.T @ matrix @ ties for matrix in _assembled(mesh, link.body.material))
    body = Matrices(dofs, *_reduced(mass.tocsc(), stiffness.tocsc(), len(dofs)))
    return replace(link, body=body, modes=FIXED_INTERFACE_MODES)


def _assembled(mesh: SolidMesh, material: Material) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Return the consistent mass and stiffness, in the order x, y, z of each node."""
    elements = mesh.tetrahedra
    basis = skfem.Basis(
        skfem.MeshTet2(mesh.nodes.T, elements.T), skfem.ElementVector(skfem.ElementTetP2())
    )
    lame = lame_parameters(material.youngs_modulus, material.poisson_ratio)
    inertia = skfem.BilinearForm(lambda u, v, _: material.density * dot(u, v))
    numbers = np.empty((len(mesh.nodes), 3), dtype=np.intp)  # of x, y and z in scikit-fem
    numbers[elements.T] = basis.element_dofs.reshape(-1, 3, len(elements)).transpose(0, 2, 1)
    order = numbers.ravel()
    mass, stiffness = (
        form.assemble(basis)[order][:, order] for form in (inertia, linear_elasticity(*lame))
    )
    return mass, stiffness


def _ties(
    link: Link, mesh: SolidMesh, rotations: frozenset[str]
) -> tuple[sparse.csc_array, tuple[InterfaceDof, ...]]:
    """Return T of u = T q, whose first columns are the interface DoFs, and these."""
    free = np.setdiff1d(np.arange(len(mesh.nodes)), np.concatenate([*mesh.bores.values()]))
    columns, inner, dofs = [], [], []
    for point, place in link.points:
        at = mesh.bores[point]
        x, z = mesh.nodes[at, 0] - place[0], mesh.nodes[at, 2] - place[1]
        moved = np.zeros((3, len(mesh.nodes), 3))
        moved[0, at, 0] = moved[1, at, 2] = 1.0
        moved[2, at, 0], moved[2, at, 2] = -z, x  # theta turns x towards z
        for axis, motion in zip(("x", "z", "theta"), moved.reshape(3, -1), strict=True):
            if axis == "theta" and point not in rotations:
                inner.append(motion)
            else:
                columns.append(motion)
                dofs.append(InterfaceDof(point, axis))
    rigid = sparse.csc_array(np.array(columns + inner).T)
    rows = (3 * free[:, np.newaxis] + np.arange(3)).ravel()
    return sparse.hstack([rigid, sparse.eye_array(3 * len(mesh.nodes)).tocsc()[:, rows]]).tocsc(), (
        *dofs,
    )


def _reduced(
    mass: sparse.csc_array, stiffness: sparse.csc_array, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return mass and stiffness by Craig and Bampton on the first n coordinates.

    Modes out of the plane, which motions of the pins in the plane do not excite, are left out.
    """
    b, i = slice(0, n), slice(n, None)
    held = stiffness[i, i].tocsc()
    # Without pivoting the factor of a positive definite matrix stays symmetric and sparse.
    options = {"SymmetricMode": True}
    factor = splu(held, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    inverse = LinearOperator(held.shape, factor.solve)
    start = np.random.default_rng(0).standard_normal(held.shape[0])
    squares, shapes = eigsh(held, _TRIED, mass[i, i], sigma=0.0, OPinv=inverse, v0=start)
    statics = np.vstack([np.eye(n), -factor.solve(stiffness[i, b].toarray())])
    parts = np.linalg.norm(statics.T @ (mass[:, i] @ shapes), axis=0)
    kept = np.flatnonzero(parts > _OUT_OF_PLANE * parts[0])
    kept = kept[np.argsort(squares[kept])][:FIXED_INTERFACE_MODES]
    t = np.hstack([statics, np.vstack([np.zeros((n, len(kept))), shapes[:, kept]])])
    reduced, modal = t.T @ (mass @ t), np.diag(np.append(np.zeros(n), squares[kept]))
    # The product T^T K T has no other terms; leaving out those that cancel leaves out their noise.
    modal[b, b] = statics.T @ (stiffness @ statics)
    return (reduced + reduced.T) / 2.0, (modal + modal.T) / 2.0
