# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""LM-FBS at and near 0 Hz, where free components have no receptance, and a mechanism's mode."""

import contextlib
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.linalg import block_diag

from benchmark.report import table
from linkage_vibration.drawing.palette import COLOURS, GREY, INK
from linkage_vibration.mechanics.compatibility import CouplingError
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.coupling import assembled_frf
from linkage_vibration.mechanics.description import Damping, ModalRatio
from linkage_vibration.mechanics.fbs import FbsError, component_frf, couple_frfs_with_error
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

TITLE = "0 Hz and below 0.1 Hz"
PLACES = [("E1", "z"), ("E1", "x"), ("E2", "x"), ("V1", "z")]
ALPHA3 = math.radians(140.0)


def linkage(damping: Damping | None = None) -> LinkageModel:
    """Return the paper's linkage, with another damping if one is given."""
    mechanism = read_mechanism(config_file("three_point_linkage.yaml"))
    return LinkageModel(replace(mechanism, damping=damping) if damping else mechanism)


def component_frfs(model: LinkageModel, frequencies: FloatArray) -> list[ComplexArray]:
    """Return the receptances of all components."""
    known = [c for c in model.components if isinstance(c, Component)]
    return [
        component_frf(c.mass, c.stiffness, c.damping, len(c.dofs), frequencies, c.loss_factor)
        for c in known
    ]


def plain_lm_fbs(
    blocks: Sequence[ComplexArray], compatibility: FloatArray, rows: FloatArray, how: str = "solve"
) -> ComplexArray:
    """Couple by eq. 19 as it stands, line by line, by ``solve`` or ``inv``; NaN where it stops."""
    b = compatibility
    values = np.full((len(blocks[0]), len(rows), len(rows)), np.nan + 0.0j)
    for frf, line in zip(values, zip(*blocks, strict=True), strict=True):
        h = block_diag(*line)
        interface, driven = b @ h @ b.T, b @ h @ rows.T
        with contextlib.suppress(np.linalg.LinAlgError):
            forces = (
                np.linalg.solve(interface, driven)
                if how == "solve"
                else np.linalg.inv(interface) @ driven
            )
            frf[:] = rows @ h @ rows.T - rows @ h @ b.T @ forces
    return values


def saddle_point_frf(solution: Solution, frequencies: FloatArray, rows: FloatArray) -> ComplexArray:
    """Solve [[Z, B^T], [B, 0]] of the uncoupled components, refined in extended precision.

    It uses neither the coordinates nor the receptances of the methods that are compared with it.
    """
    system, b = solution.model.system, solution.joining.compatibility
    n, scale = len(system.mass), float(np.diag(system.stiffness).max())
    b = np.pad(scale * b, ((0, 0), (0, n - b.shape[1])))
    size = n + len(b)
    force = np.pad(rows, ((0, 0), (0, size - rows.shape[1]))).T.astype(complex)
    values = np.empty((len(frequencies), len(rows), len(rows)), dtype=complex)
    for frf, frequency in zip(values, frequencies, strict=True):
        omega = 2.0 * math.pi * frequency
        matrix = np.zeros((size, size), dtype=np.clongdouble)
        matrix[:n, :n] = system.stiffness - np.longdouble(omega) ** 2 * system.mass
        matrix[:n, :n] += 1j * (system.loss + omega * system.damping)
        matrix[n:, :n], matrix[:n, n:] = b, b.T
        rough = np.linalg.inv(matrix.astype(complex))
        x = (rough @ force).astype(np.clongdouble)
        for _ in range(4):
            x = x + rough @ (force - matrix @ x).astype(complex)
        frf[:] = (force.T @ x).astype(complex)
    return values


def share(result: ComplexArray, exact: ComplexArray) -> FloatArray:
    """Return the largest difference at each frequency, of the largest FRF there."""
    return np.asarray(np.abs(result - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2)))


def picture_of(title: str, width: float = 8.0, height: float = 4.4) -> Figure:
    """Return an empty figure with its title."""
    figure = Figure(figsize=(width, height), dpi=110, layout="constrained")
    figure.suptitle(title, x=0.01, horizontalalignment="left", fontsize=11, fontweight="bold")
    return figure


def section(pictures: Path) -> str:
    """Measure LM-FBS and the assembly towards 0 Hz, draw the errors, and report."""
    lines = np.logspace(-4, 1, 41)
    figure = picture_of("Error of the linkage's FRFs towards 0 Hz, alpha3 = 140 deg")
    ax = figure.subplots()
    table_rows = []
    for damping, colour, words in (
        (ModalRatio(0.01), COLOURS[1], "modal damping of the links"),
        (None, COLOURS[4], "Rayleigh damping"),
    ):
        model = linkage(damping)
        solution = model.solve(ALPHA3)
        rows, b = model.rows(PLACES, solution.configuration), solution.joining.compatibility

        def measured(
            at: FloatArray,
            model: LinkageModel = model,
            solution: Solution = solution,
            rows: FloatArray = rows,
            b: FloatArray = b,
        ) -> tuple[FloatArray, FloatArray, FloatArray]:
            """Return the shares of error of LM-FBS, of its estimate, and of the assembly."""
            exact = saddle_point_frf(solution, at, rows)
            blocks = component_frfs(model, at)
            error = couple_frfs_with_error(blocks, b, rows, rows)[1]
            return (
                share(plain_lm_fbs(blocks, b, rows), exact),
                error / np.abs(exact).max(axis=(1, 2)),
                share(assembled_frf(solution.coupled, at, rows, rows), exact),
            )

        plain, estimate, ours = measured(lines)
        ax.loglog(lines, plain, color=colour, label=f"LM-FBS as it stands, {words}")
        ax.loglog(
            lines, estimate, color=colour, linestyle="--", label="its estimate, by which we judge"
        )
        if damping is None:
            continue
        ax.loglog(lines, ours, color=COLOURS[2], label="ours, the assembly")
        static = np.zeros(1)
        exact = saddle_point_frf(solution, static, rows)
        at_rest = float(share(assembled_frf(solution.coupled, static, rows, rows), exact)[0])
        table_rows.append(["0", "singular", "-", f"{at_rest:.0e}"])
        few = np.array([1e-4, 1e-3, 1e-2, 1e-1, 1.0])
        for frequency, *values in zip(few, *measured(few), strict=True):
            table_rows.append([f"{frequency:g}", *(f"{value:.0e}" for value in values)])
    ax.axhline(1e-6, color=GREY, linewidth=1.0)
    ax.annotate("above this line, FRFs alone are rejected", (10.0, 1.5e-6), color=GREY, ha="right")
    ax.set(xlabel="frequency [Hz]", ylabel="error / largest FRF [1]", ylim=(1e-17, 1.0))
    ax.grid(color="#dddddd", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(colors=INK)
    figure.legend(loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    figure.savefig(pictures / "static_limit.png")

    columns = ["Hz", "LM-FBS", "its estimate", "assembly"]
    return f"""\
A free link moves by 1 / (m w^2). Its deformation, on which the coupled FRF depends, is lost in the
rounding of this motion. The table shows the error relative to the largest of 16 FRFs at 140 deg,
for links with 1 % modal damping, compared with the saddle-point system of the uncoupled components
in extended precision:

{table(columns, table_rows)}

The digits are lost in the FRFs of the components, no matter which method couples them. Where all
components have matrices, the assembly is used on such lines, 0 Hz included. If a link is known only
by FRFs, these lines are rejected by the estimate: {_fbs_refusal()}

Without the crank's clamp, the linkage is a mechanism. {_mechanism()}

Tests: `test/mechanics/test_coupling.py::test_static_limit_of_the_linkage`,
`::test_mechanism_has_no_static_limit`,
`test/mechanics/test_fbs.py::test_rounding_at_low_frequencies`.

![Error of LM-FBS and of the assembly from 10 Hz down to 0.1 mHz](stability/static_limit.png)
"""


def _fbs_refusal() -> str:
    """Return the error for component FRFs at 0 Hz."""
    model = linkage(ModalRatio(0.01))
    try:
        component_frfs(model, np.zeros(1))
    except FbsError as error:
        return f'"{error}"'
    raise AssertionError("0 Hz was not refused")


def _mechanism() -> str:
    """Return the results for the linkage with a free crank."""
    mechanism = read_mechanism(config_file("three_point_linkage.yaml"))
    links = tuple(replace(link, clamped=None) for link in mechanism.links)
    model = LinkageModel(replace(mechanism, links=links))
    solutions = [model.solve(angle) for angle in np.linspace(*mechanism.stroke, 46)]
    first, second = np.array([solution.natural_frequencies[:2] for solution in solutions]).T
    rows = model.rows(PLACES, solutions[0].configuration)
    try:
        assembled_frf(solutions[0].coupled, np.zeros(1), rows, rows)
    except CouplingError as error:
        return (
            f"At each of 46 angles, one mode is at {first.max():.0g} Hz and the next one "
            f'at {second.min():.0f} Hz or above. The static limit is rejected: "{error}"'
        )
    raise AssertionError("the static limit of a mechanism was not refused")
