# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Meshes straight links with gmsh: solid bars with an eye around every pin.

Each segment is a box with the area and the second moment of area of the beam. Beams have no eyes
and bores, so the natural frequencies of the solids are close to the beams', but not equal.
"""

import math
from pathlib import Path

import gmsh

from linkage_vibration.mechanics.bodies.beam import Beam
from linkage_vibration.mechanics.description import Link

EYE = 0.75  # radius of the eye / height of the bar
BORE = 0.5  # radius of the bore / radius of the eye
LEAST_EYE = 0.025  # m


def write_mesh(path: Path, link: Link) -> None:
    """Mesh a link with straight-sided ten-node tetrahedra.

    Parameters
    ----------
    path : Path
        The ``.msh`` file. It has the link's axes: x along it, z across it in the plane of motion,
        y along the pins. The bore at every point is a physical surface of the point's name.
    link : Link
        A beam with its pins on the axis.
    """
    beam = link.body
    if not isinstance(beam, Beam) or any(z != 0.0 for _, (_, z) in link.points):
        raise ValueError(f"Link {link.name} is not a beam with its pins on the axis.")
    places = {point: x for point, (x, _) in link.points}
    heights = [math.sqrt(12.0 * s.section.second_moment / s.section.area) for s in beam.segments]
    widths = [s.section.area / height for s, height in zip(beam.segments, heights, strict=True)]
    starts = [min(places.values()), *(segment.end for segment in beam.segments)]
    eye = max(EYE * max(heights), LEAST_EYE)
    size = max(0.6 * min(*widths, *heights), 0.012)

    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        boxes = [
            (3, occ.addBox(start, -width / 2, -height / 2, end - start, width, height))
            for start, end, width, height in zip(starts, starts[1:], widths, heights, strict=False)
        ]
        width = max(widths)
        eyes = [(3, occ.addCylinder(x, -width / 2, 0, 0, width, 0, eye)) for x in places.values()]
        solid, _ = occ.fuse(boxes[:1], boxes[1:] + eyes)
        bores = [
            (3, occ.addCylinder(x, -width, 0, 0, 2 * width, 0, BORE * eye)) for x in places.values()
        ]
        solid, _ = occ.cut(solid, bores)
        occ.synchronize()
        for point, x in places.items():
            reach = 1.01 * BORE * eye
            box = (x - reach, -width, -reach, x + reach, width, reach)
            surfaces = gmsh.model.getEntitiesInBoundingBox(*box, dim=2)
            gmsh.model.addPhysicalGroup(2, [tag for _, tag in surfaces], name=point)
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in solid], name=link.name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 10)
        # With straight sides both codes integrate the same elements exactly.
        gmsh.option.setNumber("Mesh.SecondOrderLinear", 1)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
