# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares Lagrange-multiplier frequency-based substructuring with that of SDynPy.

Both receive the same component FRFs on all interface DoFs and the same compatibility matrix. SDynPy
uses a pseudo-inverse; ours solves linear equations. The inverse of the assembled dynamic stiffness
at every frequency shows which of the two has the larger error.

SDynPy has the GPL licence. It is used only for this check; the package does not import it.
"""

import math
import os
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from tqdm import tqdm

from benchmark.report import machine, publish, table
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.coupling import CoupledSystem
from linkage_vibration.mechanics.fbs import component_frf, couple_frfs
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")  # SDynPy loads Qt

import sdynpy

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

MECHANISM = Path(__file__).parents[2] / "config" / "three_point_linkage.yaml"
ANGLES_DEG = (90.0, 140.0, 180.0)
FREQUENCIES = np.linspace(0.5, 200.0, 400)  # Hz
DIRECTIONS = {"x": 1, "z": 3, "theta": 5}  # SDynPy's X+, Z+ and RY+


def sdynpy_coupled(
    blocks: Sequence[ComplexArray], components: Sequence[Component], compatibility: FloatArray
) -> ComplexArray:
    """Couple component FRFs with SDynPy.

    Parameters
    ----------
    blocks : sequence of ndarray, (n_freq, n_r, n_r)
        Receptances on the interface DoFs of each component.
    components : sequence of Component
        The components, with their DoFs.
    compatibility : ndarray, (n_constraints, n)
        B.

    Returns
    -------
    ndarray, (n_freq, n, n)
        Receptances of the assembly on all interface DoFs.
    """
    # SDynPy identifies a DoF by the number of a node and a direction, and sorts them by both.
    nodes: dict[tuple[str, str], int] = {}
    for component in components:
        for dof in component.dofs:
            nodes.setdefault((component.name, dof.point), len(nodes) + 1)
    dofs = sdynpy.coordinate_array(
        [nodes[c.name, dof.point] for c in components for dof in c.dofs],
        [DIRECTIONS[dof.direction] for c in components for dof in c.dofs],
    )
    uncoupled = np.stack([block_diag(*matrices) for matrices in zip(*blocks, strict=True)], axis=-1)
    functions = sdynpy.data_array(
        sdynpy.data.FunctionTypes.FREQUENCY_RESPONSE_FUNCTION,
        FREQUENCIES,
        uncoupled,
        np.stack(np.broadcast_arrays(dofs[:, np.newaxis], dofs[np.newaxis, :]), axis=-1),
    )
    coupled = functions.substructure_by_constraint_matrix(dofs, compatibility)
    order = np.searchsorted(coupled[:, 0].response_coordinate, dofs)
    return np.moveaxis(coupled.ordinate[np.ix_(order, order)], -1, 0)


def assembled(system: CoupledSystem, n_interface: int) -> ComplexArray:
    """Return the assembly's receptances, (n_freq, n_interface, n_interface)."""
    rows = system.restrict(np.eye(n_interface))
    omega = 2.0 * math.pi * FREQUENCIES[:, np.newaxis, np.newaxis]
    dynamic = system.stiffness + 1j * (omega * system.damping + system.loss)
    dynamic = dynamic - omega**2 * system.mass
    return np.asarray(rows @ np.linalg.solve(dynamic, rows.T[np.newaxis]))


def difference(first: ComplexArray, second: ComplexArray) -> str:
    """Return the largest difference at any frequency, relative to the largest receptance there."""
    apart = np.abs(first - second).max(axis=(1, 2)) / np.abs(second).max(axis=(1, 2))
    worst = int(apart.argmax())
    return f"{apart[worst]:.1e} at {FREQUENCIES[worst]:g} Hz"


def main() -> None:
    """Compare at three angles and publish the result."""
    mechanism = read_mechanism(MECHANISM)
    model = LinkageModel(mechanism)
    components = [c for c in model.components if isinstance(c, Component)]
    blocks = [
        component_frf(c.mass, c.stiffness, c.damping, len(c.dofs), FREQUENCIES, c.loss_factor)
        for c in components
    ]
    n = len(model.interface)
    rows = []
    for angle_deg in tqdm(ANGLES_DEG, unit="angle"):
        solution = model.solve(math.radians(angle_deg))
        compatibility = solution.joining.compatibility
        started = time.perf_counter()
        ours = couple_frfs(blocks, compatibility, np.eye(n), np.eye(n))
        between = time.perf_counter()
        theirs = sdynpy_coupled(blocks, components, compatibility)
        ended = time.perf_counter()
        exact = assembled(solution.coupled, n)
        rows.append(
            [
                f"{angle_deg:g}",
                f"{np.linalg.norm(ours - theirs) / np.linalg.norm(theirs):.1e}",
                difference(ours, theirs),
                difference(ours, exact),
                difference(theirs, exact),
                f"{between - started:.2f}",
                f"{ended - between:.2f}",
            ]
        )
    columns = [
        "alpha3, deg",
        "relative L2 difference",
        "largest",
        "ours to assembly",
        "SDynPy to assembly",
        "ours, s",
        "SDynPy, s",
    ]
    publish(
        "validation.sdynpy_fbs",
        "Coupling by FRFs compared with SDynPy",
        [
            "This page compares coupled FRFs with those of SDynPy, computed from the same "
            f"component FRFs: all {n} x {n} receptances of `{mechanism.name}` at "
            f"{len(FREQUENCIES)} frequencies from {FREQUENCIES[0]:g} to {FREQUENCIES[-1]:g} Hz. "
            "The largest difference is that of any receptance, relative to the largest receptance "
            "at that frequency. The assembly is the primal assembly of the same components.",
            table(columns, rows),
        ],
        machine("sdynpy"),
    )


if __name__ == "__main__":
    main()
