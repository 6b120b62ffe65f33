# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Lines at a component's resonance, undamped peaks, coincident poles and identical links."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh

from benchmark.report import table
from benchmark.stability.static_limit import (
    ALPHA3,
    PLACES,
    component_frfs,
    linkage,
    picture_of,
    plain_lm_fbs,
    saddle_point_frf,
    share,
)
from linkage_vibration.drawing.palette import COLOURS, GREY
from linkage_vibration.mechanics.compatibility import CouplingError
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.coupling import assembled_frf
from linkage_vibration.mechanics.description import Rayleigh
from linkage_vibration.mechanics.fbs import (
    FbsError,
    component_frf,
    couple_frfs,
    couple_frfs_with_error,
)
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.modes import damp_modes, solve_modes
from linkage_vibration.mechanics.response import pole_residue
from test.support.two_linkages import two_linkages

FloatArray = NDArray[np.float64]

TITLE = "On a component's own resonance, and poles that coincide"


def section(pictures: Path) -> str:
    """Measure LM-FBS closer and closer to a free link's resonance, and report."""
    model = linkage(Rayleigh(0.0, 0.0))
    solution = model.solve(ALPHA3)
    rows, b = model.rows(PLACES, solution.configuration), solution.joining.compatibility
    resonance = _first_bending(model, "lift_rod")
    away = np.logspace(-15, -1, 43)
    lines = resonance * (1.0 + away)
    exact = saddle_point_frf(solution, lines, rows)
    blocks = component_frfs(model, lines)
    plain = share(plain_lm_fbs(blocks, b, rows), exact)
    estimate = couple_frfs_with_error(blocks, b, rows, rows)[1] / np.abs(exact).max(axis=(1, 2))
    ours = share(assembled_frf(solution.coupled, lines, rows, rows), exact)

    figure = picture_of(
        f"Error of the FRFs beside {resonance:.2f} Hz, where the free lift rod resonates"
    )
    ax = figure.subplots()
    ax.loglog(away, plain, color=COLOURS[1], label="LM-FBS as it stands")
    ax.loglog(away, estimate, "--", color=COLOURS[1], label="its estimate, by which we judge")
    ax.loglog(away, ours, color=COLOURS[2], label="ours, the assembly")
    ax.axhline(1e-6, color=GREY, linewidth=1.0)
    ax.annotate("above this line FRFs alone are refused", (0.1, 1.5e-6), color=GREY, ha="right")
    ax.set(
        xlabel="distance from the free rod's own undamped resonance / frequency [1]",
        ylabel="error / largest FRF [1]",
    )
    ax.grid(color="#dddddd", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    figure.savefig(pictures / "resonance.png")

    texts = [
        [f"{distance:.0e}", *(f"{value:.0e}" for value in values)]
        for distance, *values in zip(away, plain, estimate, ours, strict=True)
    ]
    chosen = [texts[int(np.abs(np.log10(away) + power).argmin())] for power in (2, 6, 10, 14)]
    columns = ["distance / frequency", "LM-FBS", "its estimate", "assembly"]
    apart, summed = _two_linkages()
    return f"""\
At an undamped resonance of a free component, its receptances are infinite, while those of the
assembly are not. The table is for the undamped linkage at 140 deg beside {resonance:.2f} Hz, where
the free lift rod resonates. It shows the error relative to the largest of 16 FRFs, compared with
the saddle-point system in extended precision:

{table(columns, chosen)}

Where all components have matrices, the assembly is used. If there are only FRFs, they are rejected
where the estimate exceeds 1e-6: "{_refused(solution, rows, b, resonance)}"

- **Two identical links.** {_two_rods(solution, rows)}
- **Coincident poles.** Two equal linkages side by side have each pole twice. The first 20 natural
  frequencies form ten pairs within {apart:.0e}. Their 64 FRFs, most of them zero, agree within
  {summed:.0e} with those of one linkage, as a sum over modes.
- **An undamped peak of the assembly** is infinite, and rejected: "{_peak(solution, rows)}"

Tests: `test/mechanics/test_fbs.py::test_on_a_components_own_resonance`,
`::test_two_identical_links`, `test/mechanics/test_coupling.py::test_coincident_poles`,
`::test_undamped_resonance_of_the_assembly_is_refused`.

![Error of LM-FBS and of the assembly beside a free link's own resonance](stability/resonance.png)
"""


def _component(model: LinkageModel, name: str) -> Component:
    component = next(c for c in model.components if c.name == name)
    assert isinstance(component, Component)
    return component


def _first_bending(model: LinkageModel, name: str) -> float:
    """Return the first natural frequency (Hz) of a free link, above its three rigid motions."""
    component = _component(model, name)
    values = eigh(component.stiffness, component.mass, eigvals_only=True)
    return math.sqrt(values[3]) / (2.0 * math.pi)


def _refused(solution: Solution, rows: FloatArray, b: FloatArray, resonance: float) -> str:
    lines = np.array([resonance])
    try:
        couple_frfs(component_frfs(solution.model, lines), b, rows, rows, frequencies=lines)
    except FbsError as error:
        return str(error)
    raise AssertionError("a line on a component's resonance was not refused")


def _peak(solution: Solution, rows: FloatArray) -> str:
    try:
        assembled_frf(solution.coupled, solution.natural_frequencies[:1], rows, rows)
    except CouplingError as error:
        return str(error)
    raise AssertionError("an undamped peak was not refused")


def _two_rods(solution: Solution, rows: FloatArray) -> str:
    """Return the errors for the two lift rods as two components with the same poles."""
    model, b = solution.model, solution.joining.compatibility
    rod, n = _component(model, "lift_rod"), b.shape[1]
    start = 0
    for component in model.components:
        if component is rod:
            break
        start += len(component.dofs)
    own = slice(start, start + len(rod.dofs))
    # The other rod has the same ends, so its DoFs (the last ones) follow the first's.
    other = np.zeros((len(rod.dofs), n + len(rod.dofs)))
    other[:, own], other[:, n:] = np.eye(len(rod.dofs)), -np.eye(len(rod.dofs))
    both = np.vstack([np.pad(b, ((0, 0), (0, len(rod.dofs)))), other])
    wide = np.pad(rows, ((0, 0), (0, len(rod.dofs))))
    resonance = _first_bending(model, "lift_rod")
    lines = resonance * (1.0 + np.array([1e-6, 1e-2]))
    blocks = component_frfs(model, lines)
    half = component_frf(rod.mass / 2, rod.stiffness / 2, rod.damping / 2, len(rod.dofs), lines)
    blocks = [half if c is rod else f for c, f in zip(model.components, blocks, strict=True)]
    receptances = couple_frfs([*blocks, half], both, wide, wide)
    exact = saddle_point_frf(solution, lines, rows)
    near, off = share(receptances, exact)
    return (
        "The two lift rods as two components share every pole of their own. Coupled by LM-FBS "
        f"they give the FRFs of one rod twice as strong within {off:.0e} at 1e-2 from their "
        f"resonance and {near:.0e} at 1e-6 from it."
    )


def _two_linkages() -> tuple[float, float]:
    """Return the distance of coincident poles, and the relative error of the FRFs."""
    model = linkage()
    alone = model.solve(ALPHA3)
    b = alone.joining.compatibility
    coupled = two_linkages(model, alone)
    modes, vectors = solve_modes(coupled)
    pairs = modes.omega[:20].reshape(-1, 2) / alone.modes.omega[:10, np.newaxis]
    rows = model.rows(PLACES, alone.configuration)
    lines = np.linspace(0.5, 200.0, 400)
    exact = alone.frf(PLACES, PLACES).frf(lines)
    apart = np.zeros_like(exact)
    expected = np.block([[exact, apart], [apart, exact]])
    shares = block_diag(rows, rows) @ modes.shapes[: 2 * b.shape[1]]
    receptances = pole_residue(damp_modes(coupled, modes.omega, vectors), shares, shares).frf(lines)
    return float(np.abs(pairs - 1.0).max()), float(share(receptances, expected).max())
