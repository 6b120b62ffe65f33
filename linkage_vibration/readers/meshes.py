# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Components from solid meshes: gmsh ``.msh`` in, reduced matrices out.

The mesh is of tetrahedra of first or second order, in metres, in the component's own axes: x along
the link from its first point, z across it in the plane of motion, y out of that plane, which is
y = 0. Gmsh saves it as ASCII of version 2.2 or 4.1 (its defaults) and leaves out what is in no
physical group (``Mesh.SaveAll = 0``, its default too); so there are one physical volume at least,
and one named physical surface for every point of the link.

`solids` tells which motions of a pin are kept, free, or held.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.description import Material
from linkage_vibration.mechanics.reduction import ReductionError
from linkage_vibration.mechanics.solids import Pin, solid_matrices
from linkage_vibration.readers.component_files import ComponentFileError, check_file, damaged

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_INSTALL = "needs scikit-fem and meshio; `pip install linkage_vibration[fe]`."
_VOLUMES = {"tetra": 1, "tetra10": 2}  # and their order
_SURFACES = ("triangle", "triangle6")
_MAX_EXTENT = 50.0  # m


def mesh_matrices(
    path: Path,
    material: Material,
    pins: Mapping[str, str],
    points: Sequence[tuple[str, tuple[float, float]]],
    modes: int,
    *,
    rotations: Collection[str] = (),
    spatial: bool = False,
) -> Matrices:
    """Assemble a meshed solid, tie it to its pins and reduce it.

    Parameters
    ----------
    path : Path
        The ``.msh``.
    material : Material
        Of all elements.
    pins : mapping of str to str
        Of each point, the name of its physical surface.
    points : sequence of (str, (float, float))
        Names and x, z, m, in the order that the interface DoFs are to have.
    modes : int
        Fixed-interface modes to keep.
    rotations : collection of str
        Points whose rotation is an interface DoF.
    spatial : bool
        Keep the y DoFs and out-of-plane modes too.

    Returns
    -------
    Matrices
        x, (y,) z and, where asked, theta, point by point, then the modes; no damping.

    Raises
    ------
    ComponentFileError
        If scikit-fem or meshio are missing; if the file is damaged, or not such a mesh; if a
        surface is missing, or not where its point is; or if the pins do not hold the solid.
    """
    nodes, elements, surfaces = _read_mesh(path)
    for point in pins:
        if point not in dict(points):
            raise ComponentFileError(path, f"pins names {point}, which is no point of the link.")
    tied = [_pin(path, point, place, pins, nodes, surfaces) for point, place in points]
    mass, stiffness = _assemble(path, nodes, elements, material)
    try:
        return solid_matrices(
            mass, stiffness, nodes, tied, modes, rotations=rotations, spatial=spatial
        )
    except ReductionError as error:
        raise ComponentFileError(path, str(error)) from None


def _read_mesh(path: Path) -> tuple[FloatArray, IntArray, dict[str, IntArray]]:
    """Return the nodes of the tetrahedra, the tetrahedra, and the nodes of each named surface."""
    try:
        import meshio
    except ImportError:
        raise ComponentFileError(path, _INSTALL) from None
    check_file(path)
    _check_text(path)
    try:
        mesh = meshio.gmsh.read(path)
        return _select(path, mesh)
    except ComponentFileError:
        raise
    # A damaged file raises errors of meshio, NumPy, shlex and of plain indexing.
    except Exception as error:
        raise damaged(path, error) from None


def _check_text(path: Path) -> None:
    """Refuse what is no whole ASCII mesh, or counts more than the file can hold.

    Counts are believed by what reads them: it would take memory for as many.
    """
    try:
        text = path.read_bytes()
    except OSError as error:
        raise ComponentFileError(path, f"cannot be read ({error.strerror}).") from None
    head = re.match(rb"\s*\$MeshFormat\s+(\S+)\s+(\d)", text)
    if path.suffix.lower() != ".msh" or head is None:
        raise ComponentFileError(path, "is no gmsh mesh; give a .msh file that gmsh saved.")
    if head[1] not in (b"2", b"2.2", b"4.1") or head[2] != b"0":
        raise ComponentFileError(
            path,
            "is binary or of another version; save it as ASCII of version 2.2 or 4.1 "
            "(`gmsh -save -format msh41`).",
        )
    sections = re.findall(rb"^\$(\w+)", text, re.MULTILINE)
    for section in sections:
        if not section.startswith(b"End") and b"End" + section not in sections:
            raise ComponentFileError(
                path, f"was cut short: its ${section.decode()} does not end; save it again."
            )
    for section in (b"PhysicalNames", b"Nodes", b"Elements"):
        if section not in sections:
            raise ComponentFileError(
                path,
                f"has no ${section.decode()}; save a mesh with physical groups for its volume and "
                "for the surface of each pin.",
            )
    large = re.search(rb"(?<![\d.])\d{8,}(?![\d.])", text)
    if large:
        raise ComponentFileError(
            path,
            f"counts to {large[0][:20].decode()}; meshes of less than 10 million nodes and "
            "elements can be read, if this one is not damaged.",
        )


def _select(path: Path, mesh: Any) -> tuple[FloatArray, IntArray, dict[str, IntArray]]:
    kinds = {block.type for block in mesh.cells if block.dim == 3}
    if not kinds:
        raise ComponentFileError(path, "has no volume elements; give its volume a physical group.")
    if len(kinds) > 1 or not kinds <= set(_VOLUMES):
        raise ComponentFileError(
            path, f"has {', '.join(sorted(kinds))} elements; mesh it with one kind of tetrahedra."
        )
    elements = np.vstack([block.data for block in mesh.cells if block.dim == 3]).astype(np.intp)
    # Version 2.2 repeats an element for every physical group that it is in.
    _, first = np.unique(np.sort(elements, axis=1), axis=0, return_index=True)
    elements = elements[np.sort(first)]
    if elements.min() < 0 or elements.max() >= len(mesh.points):
        raise ComponentFileError(path, "has elements on nodes that it does not have; mesh it anew.")
    used = np.unique(elements)
    nodes = np.asarray(mesh.points, dtype=np.float64)[used]
    if not np.isfinite(nodes).all():
        raise ComponentFileError(path, "has a node whose coordinates are not finite numbers.")
    extent = np.ptp(nodes, axis=0).max()
    if extent > _MAX_EXTENT:
        raise ComponentFileError(
            path, f"is {extent:.4g} m long, which no link is; is it in mm? Scale it to metres."
        )

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
            raise ComponentFileError(
                path, f"surface {name!r} has nodes that no volume element has; mesh them together."
            )
        surfaces[name] = np.searchsorted(used, tied)
    return nodes, np.searchsorted(used, elements), surfaces


def _pin(
    path: Path,
    point: str,
    place: tuple[float, float],
    pins: Mapping[str, str],
    nodes: FloatArray,
    surfaces: Mapping[str, IntArray],
) -> Pin:
    """Find the surface of a point, and refuse one that lies elsewhere."""
    if point not in pins:
        raise ComponentFileError(path, f"no surface is named for the point {point}; name it.")
    surface = surfaces.get(pins[point], np.zeros(0, dtype=np.intp))
    if len(surface) < 3:
        raise ComponentFileError(
            path,
            f"has no physical surface {pins[point]!r} for the point {point}; its surfaces are "
            f"{', '.join(surfaces) or 'none'}.",
        )
    low, high = nodes[surface].min(axis=0), nodes[surface].max(axis=0)
    slack = 0.01 * np.linalg.norm(high - low)
    target = np.array([place[0], 0.0, place[1]])
    if (target < low - slack).any() or (target > high + slack).any():
        centre = (low + high) / 2.0
        raise ComponentFileError(
            path,
            f"surface {pins[point]!r} lies about x, y, z = {centre[0]:.4g}, {centre[1]:.4g}, "
            f"{centre[2]:.4g} m, not around its point {point} at {place[0]:.4g}, 0, "
            f"{place[1]:.4g} m; place the mesh in the link's own axes, in metres.",
        )
    return Pin(point, place, surface)


def _assemble(
    path: Path, nodes: FloatArray, elements: IntArray, material: Material
) -> tuple[Any, Any]:
    """Return consistent mass and stiffness, x, y, z node by node."""
    try:
        import skfem
        from skfem.helpers import dot
        from skfem.models.elasticity import lame_parameters, linear_elasticity
    except ImportError:
        raise ComponentFileError(path, _INSTALL) from None

    corners = nodes[elements[:, :4]]
    edges = corners[:, 1:] - corners[:, :1]
    volumes = np.linalg.det(edges) / 6.0
    if (volumes <= 1e-9 * np.linalg.norm(edges, axis=2).max(axis=1) ** 3).any():
        raise ComponentFileError(
            path, "has flat or inverted elements; mesh it anew, as `Mesh.Optimize = 1` does."
        )
    second = elements.shape[1] == 10
    try:
        mesh = (skfem.MeshTet2 if second else skfem.MeshTet1)(nodes.T, elements.T)
        element = skfem.ElementVector(skfem.ElementTetP2() if second else skfem.ElementTetP1())
        basis = skfem.Basis(mesh, element)
        upright = not second or (basis.mapping.detDF(basis.X) > 0.0).all()
    except Exception as error:  # neighbours that share corners but not the nodes between, ...
        raise damaged(path, error) from None
    if not upright:
        raise ComponentFileError(
            path, "has inverted curved elements; mesh it anew with `Mesh.HighOrderOptimize = 1`."
        )

    def inertia(u: Any, v: Any, _: Any) -> Any:
        return material.density * dot(u, v)

    lame = lame_parameters(material.youngs_modulus, material.poisson_ratio)
    numbers = np.empty((len(nodes), 3), dtype=np.intp)  # of scikit-fem, of each node's x, y, z
    numbers[elements.T] = basis.element_dofs.reshape(-1, 3, len(elements)).transpose(0, 2, 1)
    order = numbers.ravel()
    mass, stiffness = (
        skfem.BilinearForm(inertia).assemble(basis),
        linear_elasticity(*lame).assemble(basis),
    )
    return mass[order][:, order], stiffness[order][:, order]
