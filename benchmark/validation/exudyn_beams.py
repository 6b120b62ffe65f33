# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares natural frequencies of beam linkages with those of Exudyn, a flexible multibody code.

Exudyn receives only dimensions, positions and section properties. Everything else is its own: the
geometrically exact beams (three nodes, shear deformable, with rotary inertia), the joints, springs
and point masses, the projection on the null space of the joints and the eigenvalue solution.
"""

import itertools
import math
from dataclasses import replace
from pathlib import Path

import exudyn
import numpy as np
from exudyn import itemInterface as items  # noqa: N813
from numpy.typing import NDArray
from tqdm import tqdm

from benchmark.report import machine, publish, table
from linkage_vibration.mechanics.bodies.beam import Beam
from linkage_vibration.mechanics.description import GROUND, Link, Mechanism, RigidBody, Spring
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.springs import spring_stiffness
from test.support.in_plane import IN_PLANE, plane_mechanism

FloatArray = NDArray[np.float64]

CONFIG = Path(__file__).parents[2] / "config"
ANGLES_DEG = {
    "three_point_linkage": (90.0, 115.0, 140.0, 165.0, 180.0),
    "three_point_linkage_on_tractor": (90.0, 135.0, 180.0),
    "four_bar": (30.0, 200.0),
    "stephenson_six_bar": (50.0, 90.0, 130.0),
}
MODES = 6
EXUDYN_ELEMENTS = 32  # per link; 48 change no frequency by more than 1.1e-5
REFINEMENT = 4  # of our mesh, to separate its error from a difference of the codes


class ExudynModel:
    """Exudyn's model of a linkage of beams in one configuration, unloaded.

    Parameters
    ----------
    mechanism : Mechanism
        A mechanism whose links are beams.
    configuration : Configuration
        Positions of its bodies.
    elements : int
        Three-node elements per link.
    """

    def __init__(self, mechanism: Mechanism, configuration: Configuration, elements: int) -> None:
        self._container = exudyn.SystemContainer()  # it owns the system, so keep it
        self._system = self._container.AddSystem()
        self._configuration = configuration
        # Markers of position and of rotation, by body and point.
        self._places: dict[tuple[str, str], int] = {}
        self._turns: dict[tuple[str, str], int] = {}
        self._add_ground(mechanism)
        for link in mechanism.links:
            self._add_link(link, elements)
        for body in mechanism.rigid_bodies:
            self._add_rigid_body(body)
        for point, first, second in mechanism.joints:
            ends = [self._places[first, point], self._places[second, point]]
            self._system.AddObject(items.RevoluteJoint2D(markerNumbers=ends))
        for spring in mechanism.springs:
            self._add_spring(spring, mechanism)
        self._system.Assemble()

    def natural_frequencies(self) -> FloatArray:
        """Return every natural frequency, ascending, Hz."""
        frequencies, _ = self._system.ComputeODE2Eigenvalues(convert2Frequencies=True)
        return np.sort(np.asarray(frequencies, dtype=float))

    def _add_ground(self, mechanism: Mechanism) -> None:
        ground = self._system.AddObject(items.ObjectGround())
        fixed = self._system.AddNode(items.NodePointGround())
        if mechanism.base is None:
            for point, (x, z) in mechanism.ground:
                self._mark(GROUND, point, ground, (x, z), fixed, 0)
            return
        self._add_rigid_body(mechanism.base.body)
        for mount in mechanism.base.mounts:
            soil = items.MarkerBodyPosition(bodyNumber=ground, localPosition=[*mount.at, 0.0])
            self._system.AddObject(
                items.CartesianSpringDamper(
                    markerNumbers=[self._system.AddMarker(soil), self._places[GROUND, mount.name]],
                    stiffness=[*mount.stiffness, 0.0],
                )
            )

    def _add_link(self, link: Link, elements: int) -> None:
        beam = link.body
        if not isinstance(beam, Beam):
            raise TypeError(f"Link {link.name} is not a beam, so Exudyn cannot model it.")
        stations = {x for _, (x, _) in link.points} | {segment.end for segment in beam.segments}
        places = _places(sorted(stations), elements)
        nodes = [self._add_node(link.name, (float(x), 0.0)) for x in places]
        modulus = link.count * beam.material.youngs_modulus
        shear_modulus = link.count * beam.material.shear_modulus
        density = link.count * beam.material.density
        for i in range(0, len(nodes) - 1, 2):
            middle = places[i + 1]
            section = next(segment.section for segment in beam.segments if segment.end > middle)
            self._system.AddObject(
                items.ObjectBeamGeometricallyExact2D(
                    nodeNumbers=nodes[i : i + 3],
                    length=places[i + 2] - places[i],
                    massPerLength=density * section.area,
                    crossSectionInertia=density * section.second_moment,
                    axialStiffness=modulus * section.area,
                    bendingStiffness=modulus * section.second_moment,
                    shearStiffness=shear_modulus * section.shear_coefficient * section.area,
                    includeReferenceRotations=True,
                )
            )
        for point, (x, z) in link.points:
            node = nodes[int(np.abs(places - x).argmin())]
            # A massless body carries a pin that is not on the axis.
            arm = items.ObjectRigidBody2D(mass=0.0, inertia=0.0, nodeNumber=node)
            self._mark(link.name, point, self._system.AddObject(arm), (0.0, z), node, 2)
        for point, mass in link.masses:
            place = self._configuration.place(link.name, dict(link.points)[point])
            node = self._system.AddNode(items.NodePoint2D(referenceCoordinates=place))
            body = self._system.AddObject(
                items.ObjectMassPoint2D(mass=link.count * mass, nodeNumber=node)
            )
            marker = self._system.AddMarker(items.MarkerBodyPosition(bodyNumber=body))
            ends = [self._places[link.name, point], marker]
            self._system.AddObject(items.RevoluteJoint2D(markerNumbers=ends))
        if link.clamped is not None:
            ends = [self._turns[GROUND, link.clamped], self._turns[link.name, link.clamped]]
            self._system.AddObject(items.CoordinateConstraint(markerNumbers=ends))

    def _add_rigid_body(self, body: RigidBody) -> None:
        node = self._add_node(body.name, body.centre_of_gravity)
        number = self._system.AddObject(
            items.ObjectRigidBody2D(mass=body.mass, inertia=body.inertia, nodeNumber=node)
        )
        x0, z0 = body.centre_of_gravity
        for point, (x, z) in body.points:
            self._mark(body.name, point, number, (x - x0, z - z0), node, 2)

    def _add_spring(self, spring: Spring, mechanism: Mechanism) -> None:
        stiffness = spring_stiffness(spring, mechanism, self._configuration)
        if len(spring.points) == 1:
            ends = [self._turns[body, spring.points[0]] for body in spring.bodies]
            self._system.AddObject(
                items.CoordinateSpringDamper(markerNumbers=ends, stiffness=stiffness)
            )
            return
        ends = [self._places[end] for end in zip(spring.bodies, spring.points, strict=True)]
        a, b = (
            self._configuration.place(body, mechanism.local_points(body)[point])
            for body, point in zip(spring.bodies, spring.points, strict=True)
        )
        self._system.AddObject(
            items.SpringDamper(
                markerNumbers=ends,
                stiffness=stiffness,
                referenceLength=math.hypot(*(b - a)),  # unloaded in every configuration
            )
        )

    def _add_node(self, body: str, local: tuple[float, float]) -> int:
        place = self._configuration.place(body, local)
        angle = self._configuration.angle(body)
        return int(
            self._system.AddNode(items.NodeRigidBody2D(referenceCoordinates=[*place, angle]))
        )

    def _mark(
        self, body: str, point: str, number: int, arm: tuple[float, float], node: int, turn: int
    ) -> None:
        """Mark a point on object ``number``, and the coordinate that rotates it."""
        self._places[body, point] = self._system.AddMarker(
            items.MarkerBodyPosition(bodyNumber=number, localPosition=[*arm, 0.0])
        )
        self._turns[body, point] = self._system.AddMarker(
            items.MarkerNodeCoordinate(nodeNumber=node, coordinate=turn)
        )


def _places(stations: list[float], elements: int) -> FloatArray:
    """Return the positions of the nodes along a link; each station is the end of an element."""
    total = stations[-1] - stations[0]
    places = [np.array(stations[:1])]
    for start, end in itertools.pairwise(stations):
        count = max(1, round(elements * (end - start) / total))
        places.append(np.linspace(start, end, 2 * count + 1)[1:])
    return np.concatenate(places)


def _refined(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with more elements per link."""
    links = []
    for link in mechanism.links:
        assert isinstance(link.body, Beam)  # ExudynModel has checked it
        body = replace(link.body, elements=REFINEMENT * link.body.elements)
        links.append(replace(link, body=body))
    return replace(mechanism, links=tuple(links))


def main() -> None:
    """Compare the shipped linkages and publish the result."""
    parts = [
        "This page compares the natural frequencies of the shipped linkages with those of Exudyn, "
        f"a flexible multibody code. Exudyn has {EXUDYN_ELEMENTS} three-node beams per link. Ours "
        "has the elements and fixed-interface modes of the mechanism file; the finer mesh has "
        f"{REFINEMENT} times as many elements and is not reduced.",
        IN_PLANE,
    ]
    columns = ["alpha3, deg", "", *(f"mode {i + 1}" for i in range(MODES))]
    with tqdm(total=sum(map(len, ANGLES_DEG.values())), unit="angle") as progress:
        for name, angles_deg in ANGLES_DEG.items():
            mechanism = plane_mechanism(f"{name}.yaml")
            ours = LinkageModel(mechanism)
            fine = LinkageModel(_refined(mechanism), reduced=False)
            rows, largest = [], np.zeros(2)
            for angle_deg in angles_deg:
                solution = ours.solve(math.radians(angle_deg))
                exudyn_model = ExudynModel(mechanism, solution.configuration, EXUDYN_ELEMENTS)
                theirs = exudyn_model.natural_frequencies()[:MODES]
                # Theirs are undamped.
                shipped = solution.modes.omega[:MODES] / (2.0 * math.pi)
                refined = fine.solve(math.radians(angle_deg)).modes.omega[:MODES] / (2.0 * math.pi)
                differences = np.array([shipped, refined]) / theirs - 1.0
                largest = np.maximum(largest, np.abs(differences).max(axis=1))
                rows += [
                    [f"{angle_deg:g}", "Exudyn, Hz", *(f"{value:.4f}" for value in theirs)],
                    ["", "ours, Hz", *(f"{value:.4f}" for value in shipped)],
                    ["", "difference", *(f"{value:+.1e}" for value in differences[0])],
                    ["", "finer mesh", *(f"{value:+.1e}" for value in differences[1])],
                ]
                progress.update()
            parts += [
                f"## {name}",
                table(columns, rows),
                f"Largest relative difference: {largest[0]:.1e} as shipped, {largest[1]:.1e} with "
                "the finer mesh.",
            ]
    publish(
        "validation.exudyn_beams",
        "Natural frequencies compared with Exudyn",
        parts,
        machine("exudyn"),
    )


if __name__ == "__main__":
    main()
