# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads components from solid meshes (gmsh ``.msh``), and reduces their matrices.

A mesh has tetrahedra of first or second order, in metres, in the component's own axes: x along the
link from its first point, z across it in the plane of motion, and y out of that plane, which is
y = 0. Gmsh saves only physical groups by default, so the mesh needs one physical volume or more,
and a named physical surface for each point.

`solids` describes which motions of a pin are kept, free or held.
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.description import Material
from linkage_vibration.mechanics.solids import Pin, solid_matrices
from linkage_vibration.readers.component_files import FileError, check_file, file_errors
from linkage_vibration.support.missing_library import needed

_VOLUMES = ("tetra", "tetra10")
_SURFACES = ("triangle", "triangle6")
_MAX_EXTENT = 50.0  # m


def mesh_matrices(
    path: Path,
    material: Material,
    pins: Mapping[str, str],
    points: Sequence[tuple[str, tuple[float, float]]],
    modes: int,
    rotations: Collection[str] = (),
) -> Matrices:
    """Assemble the matrices of a meshed solid, connect it to its pins, and reduce them.

    `pins` has the physical surface of each point; the points (m) are in the order of the interface
    DoFs: x, z and, for `rotations`, theta of each. The modes follow, without damping.
    """
    with file_errors(path):
        with needed("fe", "needs scikit-fem and meshio", FileError):
            nodes, elements, surfaces = _read_mesh(path)
            tied = _pins(points, pins, nodes, surfaces)
            mass, stiffness = _assemble(path, nodes, elements, material)
        return solid_matrices(mass, stiffness, nodes, tied, modes, rotations)


def _read_mesh(path: Path) -> tuple[FloatArray, IntArray, dict[str, IntArray]]:
    """Return the nodes of the tetrahedra, the tetrahedra, and the nodes of each named surface."""
    import meshio

    check_file(path)
    with file_errors(path, Exception):  # of meshio, NumPy, shlex and plain indexing
        return _select(meshio.gmsh.read(path))


def _select(mesh: Any) -> tuple[FloatArray, IntArray, dict[str, IntArray]]:
    kinds = {block.type for block in mesh.cells if block.dim == 3}
    if not kinds:
        raise FileError("has no volume elements; define a physical group for its volume.")
    if len(kinds) > 1 or not kinds <= {*_VOLUMES}:
        raise FileError(
            f"has {', '.join(sorted(kinds))} elements; use tetrahedra of one order only."
        )
    elements = np.vstack([block.data for block in mesh.cells if block.dim == 3]).astype(np.intp)
    # Version 2.2 repeats an element for every physical group that it is in.
    _, first = np.unique(np.sort(elements, axis=1), axis=0, return_index=True)
    elements = elements[np.sort(first)]
    if elements.min() < 0 or elements.max() >= len(mesh.points):
        raise FileError("has elements with unknown nodes; mesh it again.")
    used = np.unique(elements)
    nodes = np.asarray(mesh.points, dtype=np.float64)[used]
    if not np.isfinite(nodes).all():
        raise FileError("has a node whose coordinates are not finite; mesh it again.")
    extent = np.ptp(nodes, axis=0).max()
    if extent > _MAX_EXTENT:
        raise FileError(f"is {extent:.4g} m long, which no link is; convert it to metres.")

    surfaces = {}
    for name, (tag, dimension) in mesh.field_data.items():
        if dimension != 2:
            continue
        corners = [np.zeros(0, dtype=np.intp)]
        for k, block in enumerate(mesh.cells):
            if block.type in _SURFACES:
                if name in mesh.cell_sets:
                    chosen = mesh.cell_sets[name][k]
                else:
                    chosen = mesh.cell_data["gmsh:physical"][k] == tag
                corners.append(block.data[chosen].ravel().astype(np.intp))
        tied = np.unique(np.concatenate(corners))
        if not np.isin(tied, used).all():
            raise FileError(
                f"has a surface {name!r} with nodes outside of the volume; mesh them together."
            )
        surfaces[name] = np.searchsorted(used, tied)
    return nodes, np.searchsorted(used, elements), surfaces


def _pins(
    points: Sequence[tuple[str, tuple[float, float]]],
    pins: Mapping[str, str],
    nodes: FloatArray,
    surfaces: Mapping[str, IntArray],
) -> list[Pin]:
    """Return the surface of each point; raise an error if it lies elsewhere."""
    for point in pins:
        if point not in dict(points):
            raise FileError(f"has pins for {point}, which is not a point of the link; remove it.")
    tied = []
    for point, place in points:
        if point not in pins:
            raise FileError(f"has no pin for the point {point}; add it to pins.")
        surface = surfaces.get(pins[point], np.zeros(0, dtype=np.intp))
        if len(surface) < 3:
            raise FileError(
                f"has no physical surface {pins[point]!r} for the point {point}; choose one of "
                f"{', '.join(surfaces) or 'none'}, or add it."
            )
        low, high = nodes[surface].min(axis=0), nodes[surface].max(axis=0)
        slack = 0.01 * np.linalg.norm(high - low)
        target = np.array([place[0], 0.0, place[1]])
        if (target < low - slack).any() or (target > high + slack).any():
            x, y, z = (low + high) / 2.0
            raise FileError(
                f"has its surface {pins[point]!r} around x, y, z = {x:.4g}, {y:.4g}, {z:.4g} m and "
                f"the point {point} at {place[0]:.4g}, 0, {place[1]:.4g} m; place the mesh in the "
                "link's own axes, in metres."
            )
        tied.append(Pin(point, place, surface))
    return tied


def _assemble(
    path: Path, nodes: FloatArray, elements: IntArray, material: Material
) -> tuple[Any, Any]:
    """Return the consistent mass and stiffness, in the order x, y, z of each node."""
    import skfem
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    corners = nodes[elements[:, :4]]
    edges = corners[:, 1:] - corners[:, :1]
    volumes = np.linalg.det(edges) / 6.0
    if (volumes <= 1e-9 * np.linalg.norm(edges, axis=2).max(axis=1) ** 3).any():
        raise FileError("has flat or inverted elements; mesh it again with `Mesh.Optimize = 1`.")
    second = elements.shape[1] == 10
    # For example, neighbours may share corners but not mid-side nodes.
    with file_errors(path, Exception):
        mesh = (skfem.MeshTet2 if second else skfem.MeshTet1)(nodes.T, elements.T)
        element = skfem.ElementVector(skfem.ElementTetP2() if second else skfem.ElementTetP1())
        basis = skfem.Basis(mesh, element)
        upright = not second or (basis.mapping.detDF(basis.X) > 0.0).all()
    if not upright:
        raise FileError(
            "has inverted curved elements; mesh it again with `Mesh.HighOrderOptimize = 1`."
        )

    def inertia(u: Any, v: Any, _: Any) -> Any:
        return material.density * dot(u, v)

    lame = lame_parameters(material.youngs_modulus, material.poisson_ratio)
    numbers = np.empty((len(nodes), 3), dtype=np.intp)  # of each node's x, y, z in scikit-fem
    numbers[elements.T] = basis.element_dofs.reshape(-1, 3, len(elements)).transpose(0, 2, 1)
    order = numbers.ravel()
    forms = skfem.BilinearForm(inertia), linear_elasticity(*lame)
    mass, stiffness = (form.assemble(basis)[order][:, order] for form in forms)
    return mass, stiffness
