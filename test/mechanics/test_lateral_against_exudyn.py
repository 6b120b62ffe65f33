# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The lateral half of a clamped hitch against Exudyn, which has both sides in space."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

pytest.importorskip("exudyn", reason="exudyn comes with the test extra, on x86_64")

import exudyn
from exudyn import itemInterface as items  # noqa: N813

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.support.resources import config_file
from test.support.hitch_in_space import (
    ASIDE,
    CHAIN,
    CHAIN_AT,
    CHAIN_END,
    IMPLEMENT,
    RHO,
    SECTIONS,
    E,
    FloatArray,
    G,
    implement_tensor,
    pose,
)


class Hitch:
    """Exudyn's hitch with geometrically exact beams of so many elements a link, ball joints."""

    def __init__(self, alpha3: float, elements: int) -> None:
        self._container = exudyn.SystemContainer()  # it owns the system
        self.system, self._elements = self._container.AddSystem(), elements
        self._ground = self.system.AddObject(items.ObjectGround())
        places = pose(alpha3)
        self.spots = {
            (point, side): np.insert(places[point], 1, side * aside)
            for point, aside in ASIDE.items()
            for side in (1.0, -1.0)
        }
        tensor = implement_tensor(alpha3)
        centre = np.insert(places["M"], 1, 0.0)
        given: dict[str, Any] = {"referenceCoordinates": [*centre, 0.0, 0.0, 0.0]}
        node = self.system.AddNode(items.NodeRigidBodyRotVecLG(**given))
        products = [tensor[1, 2], tensor[0, 2], tensor[0, 1]]
        given = {"mass": IMPLEMENT[0], "inertia": [*tensor.diagonal(), *products]}
        given |= {"nodeNumber": node}
        body = self.system.AddObject(items.ObjectRigidBody(**given))
        ends = self._link("upper", "P2", "E2", 1.0)[0]
        self._join(self._mark(self._ground, self.spots["P2", 1.0]), ends[0])
        self._join(ends[-1], self._mark(body, self.spots["E2", 1.0] - centre))
        for side in (1.0, -1.0):
            (p1, v1, hook, e1), _ = self._link(
                "lower", "P1", "E1", side, [0.366 / 0.810, CHAIN_AT / 0.810]
            )
            (top, foot), _ = self._link("rod", "V2", "V1", side)
            (_, tip), held = self._link("crank", "P3", "V2", side)
            self._hold(held, self.spots["P3", side])
            self._join(self._mark(self._ground, self.spots["P1", side]), p1)
            self._join(v1, foot)
            self._join(tip, top)
            self._join(e1, self._mark(body, self.spots["E1", side] - centre))
            end, begin = CHAIN_END * [1.0, side, 1.0], self.spots["P1", side]
            begin = begin + CHAIN_AT / 0.810 * (self.spots["E1", side] - begin)
            given = {"markerNumbers": [hook, self._mark(self._ground, end)], "stiffness": CHAIN}
            given |= {"referenceLength": float(np.linalg.norm(end - begin))}
            self.system.AddObject(items.ObjectConnectorSpringDamper(**given))
        self.system.Assemble()

    def natural_frequencies(self) -> FloatArray:
        """Return them, Hz, without the spin of links about their axes, which nothing holds."""
        hertz = np.asarray(self.system.ComputeODE2Eigenvalues(convert2Frequencies=True)[0])
        return np.sort(hertz[hertz > 0.5])

    def _mark(self, body: int, place: FloatArray) -> int:
        marker = items.MarkerBodyPosition(bodyNumber=body, localPosition=place)
        return int(self.system.AddMarker(marker))

    def _join(self, first: int, second: int) -> None:
        self.system.AddObject(items.ObjectJointSpherical(markerNumbers=[first, second]))

    def _hold(self, node: int, place: FloatArray) -> None:
        """Clamp a node, whose axes are its body's, at a place of the ground."""
        rigid = self.system.AddMarker(items.MarkerNodeRigid(nodeNumber=node))
        turned = self.system.GetNode(node)["referenceCoordinates"][3:]
        axes = np.eye(4)
        axes[:3, :3], axes[:3, 3] = Rotation.from_rotvec(turned).as_matrix(), place
        base = items.MarkerBodyRigid(bodyNumber=self._ground, localHT=axes)
        both = [self.system.AddMarker(base), rigid]
        self.system.AddObject(items.ObjectJointGeneric(markerNumbers=both))

    def _link(
        self, name: str, first: str, last: str, side: float, stations: list[float] | None = None
    ) -> tuple[list[int], int]:
        """Add a link; return markers at its ends and stations, shares of it, and its first node."""
        begin, end = self.spots[first, side], self.spots[last, side]
        length = float(np.linalg.norm(end - begin))
        x = (end - begin) / length
        z = np.array([-x[2], 0.0, x[0]]) / math.hypot(x[0], x[2])
        turned = Rotation.from_matrix(np.array([x, np.cross(z, x), z]).T).as_rotvec()
        area, in_plane, across, shear = SECTIONS[name]
        section, polar, sheared = exudyn.BeamSection(), in_plane + across, shear * G * area
        section.massPerLength = RHO * area
        section.inertia = RHO * np.diag([polar, in_plane, across])
        rigid = [E * area, sheared, sheared, G * polar, E * in_plane, E * across]
        section.stiffnessMatrix = np.diag(rigid)
        cuts, places = [0.0, *(length * share for share in stations or []), length], [0.0]
        for here, there in pairwise(cuts):
            count = max(2, round(self._elements * (there - here) / length))
            places += np.linspace(here, there, count + 1)[1:].tolist()
        nodes = [
            self.system.AddNode(
                items.NodeRigidBodyRotVecLG(referenceCoordinates=[*(begin + at * x), *turned])
            )
            for at in places
        ]
        for pair, (here, there) in zip(pairwise(nodes), pairwise(places), strict=True):
            given: dict[str, Any] = {"nodeNumbers": [*pair], "length": there - here}
            self.system.AddObject(items.ObjectBeamGeometricallyExact(**given, sectionData=section))
        found = [nodes[int(np.abs(np.array(places) - cut).argmin())] for cut in cuts]
        markers = [items.MarkerNodePosition(nodeNumber=node) for node in found]
        return [int(self.system.AddMarker(marker)) for marker in markers], nodes[0]


@pytest.mark.parametrize("alpha3_deg", [100.0, 165.0])
def test_a_clamped_hitch_has_the_lateral_modes_of_exudyn(alpha3_deg: float) -> None:
    """Roll, sway and yaw differ by less than 1e-3 from those of 8 and 16 elements, extrapolated.

    Exudyn's beams have linear shapes, so their error falls with the square of their length.
    """
    path = config_file("three_point_linkage_on_tractor.yaml")
    lateral = yaml.safe_load(path.read_text())["lateral"]
    del lateral["axles"], lateral["inertia"]["base"]
    lateral["weight"] = "ignored"  # Exudyn's model has none
    clamped = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    mechanism = mechanism_from_mapping(clamped | {"lateral": lateral})
    alpha3 = math.radians(alpha3_deg)
    solution = LinkageModel(mechanism, half="lateral").solve(alpha3)
    ours = solution.modes.omega[:3] / (2.0 * math.pi)
    coarse, fine = (Hitch(alpha3, n).natural_frequencies()[:9] for n in (8, 16))
    theirs = fine + (fine - coarse) / 3.0
    nearest = theirs[np.abs(np.subtract.outer(ours, theirs)).argmin(axis=1)]
    np.testing.assert_allclose(ours, nearest, rtol=1e-3, atol=0.0)
