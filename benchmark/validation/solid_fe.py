# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares substructured solid links with one assembled CalculiX model of the same meshes.

This is the counterpart of the paper's Table 3. CalculiX has one model of all links;
scikit-fem reduces each link once, to its pins and 20 fixed-interface modes, and this package
couples the links by B(alpha3).
"""

import math
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmark.report import machine, publish, table
from benchmark.validation.calculix import SolidMesh, calculix_frequencies, read_mesh
from benchmark.validation.solids import write_mesh
from benchmark.validation.substructure import FIXED_INTERFACE_MODES, solid_link
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism

MECHANISM = Path(__file__).parents[2] / "config" / "three_point_linkage.yaml"
ANGLES_DEG = (90.0, 140.0, 180.0)
MODES = 3
FEWER = (1, 3, 5, 10)


def main() -> None:
    """Compare at three angles and publish the result."""
    if shutil.which("ccx") is None:
        sys.exit("This benchmark needs CalculiX; run apt-get install calculix-ccx.")
    mechanism = read_mechanism(MECHANISM)
    beams = LinkageModel(mechanism)
    rows, worst = [], np.zeros(1 + len(FEWER))
    with tempfile.TemporaryDirectory() as name, tqdm(total=len(ANGLES_DEG) + 1) as progress:
        folder = Path(name)
        files = {link.name: folder / f"{link.name}.msh" for link in mechanism.links}
        for link in mechanism.links:
            write_mesh(files[link.name], link)
        meshes = {link: read_mesh(path) for link, path in files.items()}
        solid = _solid(mechanism, meshes)
        substructured = LinkageModel(solid)
        truncated = [LinkageModel(_keep(solid, modes)) for modes in FEWER]
        progress.update()
        for angle_deg in ANGLES_DEG:
            solution = substructured.solve(math.radians(angle_deg))
            whole = calculix_frequencies(mechanism, solution.configuration, meshes, MODES, folder)
            ours = solution.natural_frequencies[:MODES]
            difference = ours / whole - 1.0
            fewer = [
                model.solve(math.radians(angle_deg)).natural_frequencies[:MODES] / whole - 1.0
                for model in truncated
            ]
            worst = np.maximum(worst, np.abs([*fewer, difference]).max(axis=1))
            straight = beams.solve(math.radians(angle_deg)).natural_frequencies[:MODES]
            rows += [
                [f"{angle_deg:g}", "CalculiX, assembled, Hz", *(f"{f:.4f}" for f in whole)],
                ["", "ours, substructured, Hz", *(f"{f:.4f}" for f in ours)],
                ["", "relative difference", *(f"{d:+.1e}" for d in difference)],
                ["", "for comparison: beams, Hz", *(f"{f:.4f}" for f in straight)],
            ]
            progress.update()
    n_nodes = sum(len(mesh.nodes) for mesh in meshes.values())
    n_elements = sum(len(mesh.tetrahedra) for mesh in meshes.values())
    version = subprocess.run(["ccx", "-v"], capture_output=True, text=True, check=False).stdout
    publish(
        "validation.solid_fe",
        "Substructured solids compared with the assembled solid model",
        [
            "This page compares the in-plane natural frequencies of solid links, reduced with "
            "scikit-fem and coupled by us, with those of one assembled model in CalculiX. The "
            f"linkage is `{mechanism.name}`; each link is a bar with an eye around every pin. Both "
            f"codes have one mesh of {n_elements} ten-node tetrahedra with {n_nodes} nodes in all.",
            table(["alpha3, deg", "", *(f"mode {i + 1}" for i in range(MODES))], rows),
            "Largest relative difference by the number of fixed-interface modes per link:",
            table(
                ["modes", *map(str, FEWER), str(FIXED_INTERFACE_MODES)],
                [["difference", *(f"{value:.1e}" for value in worst)]],
            ),
        ],
        machine("scikit-fem", "gmsh", f"CalculiX {version.split()[-1]}"),
    )


def _solid(mechanism: Mechanism, meshes: dict[str, SolidMesh]) -> Mechanism:
    links = tuple(
        solid_link(link, meshes[link.name], mechanism.rotations(link.name))
        for link in mechanism.links
    )
    return replace(mechanism, links=links)


def _keep(mechanism: Mechanism, modes: int) -> Mechanism:
    """Return the mechanism with fewer fixed-interface modes per link."""
    return replace(mechanism, links=tuple(replace(link, modes=modes) for link in mechanism.links))


if __name__ == "__main__":
    main()
