# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Solves a linkage of solid links as one assembled model in CalculiX, a finite-element program.

Each pin is one node. The bores of its links follow it as rigid bodies, each with its own rotation
about the pin, which makes the revolute joints. Pins move in the plane and do not tilt. The mass of
the rigid implement is in two points whose distance gives its inertia. CalculiX assembles the model,
eliminates the constraints and solves the eigenproblem.
"""

import math
import os
import re
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.bodies.beam import Beam
from linkage_vibration.mechanics.description import Link, Mechanism, RigidBody
from linkage_vibration.mechanics.kinematics import Configuration

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

X, Y, Z = 1, 2, 3  # DoFs of a node; of a rotation node: rotations about the axes


@dataclass(frozen=True, slots=True)
class SolidMesh:
    """A link's mesh in the link's axes.

    Attributes
    ----------
    nodes : ndarray, (n_nodes, 3), m
        Coordinates.
    tetrahedra : ndarray, (n_elements, 10)
        Rows of ``nodes``, corners first, then edges 01, 12, 20, 03, 13, 23.
    bores : mapping
        From the name of a point to the rows of ``nodes`` on its bore.
    """

    nodes: FloatArray
    tetrahedra: IntArray
    bores: Mapping[str, IntArray]


def read_mesh(path: Path) -> SolidMesh:
    """Read ten-node tetrahedra and the named surfaces of six-node triangles from a ``.msh``."""
    mesh = meshio.gmsh.read(path)
    bores = {
        name: np.unique(mesh.cells_dict["triangle6"][cells["triangle6"]])
        for name, cells in mesh.cell_sets_dict.items()
        if "triangle6" in cells and not name.startswith("gmsh:")
    }
    return SolidMesh(mesh.points, mesh.cells_dict["tetra10"], bores)


def calculix_frequencies(
    mechanism: Mechanism,
    configuration: Configuration,
    meshes: Mapping[str, SolidMesh],
    n_modes: int,
    folder: Path,
) -> FloatArray:
    """Solve the assembled linkage in one configuration.

    Parameters
    ----------
    mechanism : Mechanism
        Straight links and one rigid body, without springs and point masses.
    configuration : Configuration
        Positions of the bodies.
    meshes : mapping
        From a link's name to its mesh.
    n_modes : int
        Number of modes, the lowest ones.
    folder : Path
        Folder for the files of CalculiX.

    Returns
    -------
    ndarray, (n_modes,), Hz
        Natural frequencies.
    """
    if mechanism.springs or any(link.masses for link in mechanism.links):
        raise ValueError(f"{mechanism.name} has springs or point masses; remove them.")
    deck = _Deck()
    deck.write(mechanism, configuration, meshes, n_modes)
    (folder / "linkage.inp").write_text("\n".join(deck.lines) + "\n", encoding="ascii")
    run = subprocess.run(
        ["ccx", "-i", "linkage"],
        cwd=folder,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    result = (folder / "linkage.dat").read_text() if (folder / "linkage.dat").exists() else ""
    rows = re.findall(r"^ +\d+ +[\d.E+-]+ +[\d.E+-]+ +([\d.E+-]+) +[\d.E+-]+$", result, re.M)
    if len(rows) < n_modes:
        raise RuntimeError(f"CalculiX found no modes; it printed:\n{run.stdout[-2000:]}")
    return np.array(rows[:n_modes], dtype=float)


class _Deck:
    """An input deck of CalculiX, with consecutive numbers of nodes and elements."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._nodes = 0
        self._elements = 0

    def write(
        self,
        mechanism: Mechanism,
        configuration: Configuration,
        meshes: Mapping[str, SolidMesh],
        n_modes: int,
    ) -> None:
        pins = self._pins(mechanism, configuration)
        held: list[tuple[int, int]] = []  # node, DoF
        for point, node in pins.items():
            grounded = point in dict(mechanism.ground)
            held += [(node, dof) for dof in ((X, Y, Z) if grounded else (Y,))]
        for link in mechanism.links:
            held += self._link(link, configuration, meshes[link.name], pins)
        (body,) = mechanism.rigid_bodies
        dependent, turning = self._implement(body, configuration, pins)
        held += turning
        self._add("*BOUNDARY", *(f"{n},{dof},{dof}" for n, dof in held if n not in dependent))
        self._add("*STEP", "*FREQUENCY", f"{n_modes}", "*END STEP")

    def _pins(self, mechanism: Mechanism, configuration: Configuration) -> dict[str, int]:
        """Add a node for every pin."""
        places = {
            point: configuration.place(link.name, mechanism.local_points(link.name)[point])
            for link in mechanism.links
            for point, _ in link.points
        }
        first = self._add_nodes([(x, 0.0, z) for x, z in places.values()])
        return {point: first + i for i, point in enumerate(places)}

    def _link(
        self, link: Link, configuration: Configuration, mesh: SolidMesh, pins: Mapping[str, int]
    ) -> list[tuple[int, int]]:
        """Add a link tied to its pins; return its fixed rotations."""
        x, z = configuration.place(link.name, (0.0, 0.0))
        angle = configuration.angle(link.name)
        cos, sin = math.cos(angle), math.sin(angle)
        along, out, across = mesh.nodes.T
        placed = np.column_stack(
            [x + cos * along - sin * across, out, z + sin * along + cos * across]
        )
        first = self._add_nodes(placed)
        self._add(f"*ELEMENT, TYPE=C3D10, ELSET={link.name}")
        for row in mesh.tetrahedra + first:
            self._elements += 1
            self._add(",".join(map(str, [self._elements, *row])))
        # Parallel links move as one link with that many times the stiffness and the mass.
        assert isinstance(link.body, Beam)  # the mesh was made from it
        material = link.body.material
        self._add(
            f"*MATERIAL, NAME={link.name}",
            "*ELASTIC",
            f"{link.count * material.youngs_modulus:.12g},{material.poisson_ratio:.12g}",
            "*DENSITY",
            f"{link.count * material.density:.12g}",
            f"*SOLID SECTION, ELSET={link.name}, MATERIAL={link.name}",
        )
        held = []
        for point, bore in mesh.bores.items():
            rotation = self._follow(f"{link.name}_{point}", bore + first, pins[point])
            held += [(rotation, dof) for dof in ((X, Y, Z) if point == link.clamped else (X, Z))]
        return held

    def _implement(
        self, body: RigidBody, configuration: Configuration, pins: Mapping[str, int]
    ) -> tuple[list[int], list[tuple[int, int]]]:
        """Add the rigid body; return the pins that follow it and its fixed rotations."""
        x, z = configuration.place(body.name, body.centre_of_gravity)
        radius = math.sqrt(body.inertia / body.mass)
        first = self._add_nodes([(x - radius, 0.0, z), (x + radius, 0.0, z)])
        self._add(f"*ELEMENT, TYPE=MASS, ELSET={body.name}")
        self._add(f"{self._elements + 1},{first}", f"{self._elements + 2},{first + 1}")
        self._add(f"*MASS, ELSET={body.name}", f"{body.mass / 2.0:.12g}")
        leader, *followers = [pins[point] for point, _ in body.points if point in pins]
        rotation = self._follow(body.name, [*followers, first, first + 1], leader)
        return followers, [(rotation, X), (rotation, Z)]

    def _follow(self, name: str, nodes: Iterable[int], pin: int) -> int:
        """Make nodes follow a pin as a rigid body; return the node that carries its rotation."""
        rotation = self._add_nodes([(0.0, 0.0, 0.0)])  # its position is irrelevant
        self._add(f"*NSET, NSET=N_{name}", *(f"{node}," for node in nodes))
        self._add(f"*RIGID BODY, NSET=N_{name}, REF NODE={pin}, ROT NODE={rotation}")
        return rotation

    def _add_nodes(self, places: Iterable[Iterable[float]]) -> int:
        """Add nodes; return the number of the first."""
        first = self._nodes + 1
        self._add("*NODE")
        for place in places:
            self._nodes += 1
            # CalculiX reads 20 characters of a number and ignores the exponent of a longer one.
            self._add(",".join([str(self._nodes), *(f"{value:.12g}" for value in place)]))
        return first

    def _add(self, *lines: str) -> None:
        self.lines += lines
