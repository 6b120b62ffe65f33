# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes that cross or veer, shapes that lose their sign, and FRFs between angles."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import linear_sum_assignment

from benchmark.report import table
from benchmark.stability.static_limit import PLACES, linkage, picture_of
from linkage_vibration.drawing.palette import COLOURS, INK
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.table.table import Table, TableError
from linkage_vibration.table.tabulation import build_table
from test.support.crossing import STROKE, crossing_crank, exact_frequencies

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

TITLE = "Veering and crossing"

_AT = 0.8137  # rad, where the crank's modes meet
_POINTS = 46  # as many as the paper has configurations
_LINES: FloatArray = np.linspace(0.5, 200.0, 1996)  # Hz


def section(pictures: Path) -> str:
    """Measure the errors of tables where modes veer, and of interpolated FRFs, and report."""
    cases = [(0.0, 1e-6), (1e-6, 1e-6), (1e-6, 1e-9), (1e-3, 1e-6), (0.1, 1e-6), (1.0, 1e-6)]
    rows = [_crank(gap, tolerance) for gap, tolerance in cases]
    model = linkage()
    tables = {"ours": build_table(model)}
    between = [_between(model, tables["ours"], step) for step in (10.0, 2.0, 1.0, 0.5)]
    _draw(model, tables["ours"], pictures / "veering.png")
    columns = ["gap [Hz]", "sorted, spline", "tracked, spline"]
    columns += ["tolerance of ours", "ours", "its estimate", "solutions"]
    steps = ["step", "FRFs, linear", "modes, signs lost", "modes, signs kept"]
    return f"""\
The mode of a crank rises with alpha3 past that of a tuned mass, from 20 to 23 Hz in 0.9 rad. The
two are coupled so that a gap remains between them (`test/support/crossing.py`). The table
shows the largest relative error of the natural frequencies. The common methods use {_POINTS}
equispaced angles and cubic splines. Sorted frequencies have a kink where modes cross. Frequencies
tracked by MAC without a check treat every veering narrower than a step as a crossing. Ours
interpolates a small matrix that has both modes, so neither a crossing nor a veering needs shorter
steps.

{table(columns, rows)}

- **Rounding.** A tolerance of 1e-11 is below the rounding of damping ratios. It is rejected:
  "{_refused()}"

**FRFs between the angles.** The next table is for the paper's linkage on an even grid and 16 FRFs
from 0 to 200 Hz. It shows the largest relative L2 error halfway between grid points. FRFs that are
interpolated directly have two lower peaks instead of one. Interpolating all modes by splines is
accurate only if each shape keeps its sign from angle to angle, which no eigenvalue solver
guarantees:

{table(steps, between)}

The error of our table, from {len(tables["ours"].alpha3)} angles:
{_ours(model, tables["ours"]):.0e}.

Tests: `test/table/tabulation/test_veering.py`,
`test/table/tabulation/test_building.py::test_what_was_asked_for`.

![Two modes that cross or veer, and one FRF between grid points](stability/veering.png)
"""


def _crank(gap: float, tolerance: float) -> list[str]:
    """Return the errors of plain methods and of ours for a gap in Hz."""
    model = LinkageModel(crossing_crank(gap, _AT))
    near = _AT + np.outer([-1.0, 1.0], np.logspace(-8, -2, 60)).ravel()
    angles = np.sort(np.concatenate([np.linspace(*STROKE, 400), near, [_AT]]))
    exact = exact_frequencies(gap, _AT, angles)
    plain = []
    for tracked in (False, True):
        grid, frequencies = _at_even_angles(model, tracked)
        plain.append(np.sort(CubicSpline(grid, frequencies)(angles), axis=1))
    solutions: list[float] = []
    ours = build_table(model, tolerance, progress=solutions.append)
    ordered = np.sort(ours.evaluate(angles)[:, :2], axis=1)
    errors = [np.abs(frequencies / exact - 1.0).max() for frequencies in (*plain, ordered)]
    texts = [f"{error:.0e}" for error in (*errors, ours.interpolation_error.max())]
    return [f"{gap:g}", *texts[:2], f"{tolerance:.0e}", *texts[2:], f"{len(solutions)}"]


def _at_even_angles(model: LinkageModel, tracked: bool) -> tuple[FloatArray, FloatArray]:
    """Return even angles and two natural frequencies at each, ascending or tracked by MAC alone."""
    grid = np.linspace(*STROKE, _POINTS)
    solutions = [model.solve(float(angle)) for angle in grid]
    if not tracked:
        return grid, np.array([s.natural_frequencies[:2] for s in solutions])
    shapes, frequencies = solutions[0].modes.shapes[:, :2], []
    for solution in solutions:
        order, signs = _track(shapes, solution.modes.shapes, model.system.mass)
        shapes = solution.modes.shapes[:, order] * signs
        frequencies.append(solution.natural_frequencies[order])
    return grid, np.array(frequencies)


def _track(
    previous: FloatArray, shapes: FloatArray, mass: FloatArray
) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the modes whose shapes, (n, m), continue others, (n, k), by MAC, and their signs."""
    product = previous.T @ mass @ shapes
    order = linear_sum_assignment(product**2, maximize=True)[1]
    return order, np.where(product[np.arange(len(order)), order] < 0.0, -1.0, 1.0)


def _refused() -> str:
    """Return the error for a veering that no step resolves."""
    try:
        build_table(LinkageModel(crossing_crank(1e-9, _AT)), 1e-11)
    except TableError as error:
        return str(error)
    raise AssertionError("modes that cannot be followed were not refused")


def _terms(model: LinkageModel, angles: FloatArray) -> list[PoleResidue]:
    return [model.solve(float(angle)).frf(PLACES, PLACES) for angle in angles]


def _between(model: LinkageModel, ours: Table, step: float) -> list[str]:
    """Return the errors of plain methods halfway between the points of a grid, step in deg."""
    grid = np.radians(np.arange(90.0, 180.0 + step / 2.0, step))
    sample = np.unique(np.linspace(0, len(grid) - 2, 30).astype(int))
    halfway = (grid[sample] + grid[sample + 1]) / 2.0
    exact = np.array([terms.frf(_LINES) for terms in _terms(model, halfway)])
    linear = np.array([_linear(model, grid[i], grid[i + 1]) for i in sample])
    lost, kept = (_splines(model, grid, halfway, kept) for kept in (False, True))
    return [f"{step:g} deg", *(f"{_apart(frf, exact):.1e}" for frf in (linear, lost, kept))]


def _linear(model: LinkageModel, first: float, last: float) -> ComplexArray:
    """Return the mean of the FRFs at two angles."""
    before, after = (terms.frf(_LINES) for terms in _terms(model, np.array([first, last])))
    return np.asarray((before + after) / 2.0)


def _splines(model: LinkageModel, grid: FloatArray, at: FloatArray, signs: bool) -> ComplexArray:
    """Return FRFs of modes interpolated by splines, with their signs or with random ones."""
    chance = np.random.default_rng(8)
    shapes, squared, decay, shares = None, [], [], []
    for angle in grid:
        solution = model.solve(float(angle))
        modes = solution.modes
        if shapes is not None and signs:
            order, sign = _track(shapes, modes.shapes, model.system.mass)
        else:
            order = np.arange(len(modes.omega))
            sign = np.ones(len(order)) if signs else chance.choice([-1.0, 1.0], len(order))
        shapes = modes.shapes[:, order] * sign
        rows = model.rows(PLACES, solution.configuration)
        squared.append(modes.omega[order] ** 2)
        decay.append(solution.damped.decay[order])
        shares.append(rows @ shapes[: rows.shape[1]])
    k, c, share = (CubicSpline(grid, values)(at) for values in (squared, decay, shares))
    residues = share[:, :, np.newaxis] * share[:, np.newaxis]
    none = np.zeros((len(PLACES), len(PLACES)), dtype=complex)
    return np.array(
        [
            PoleResidue(k[i] + 0j, c[i], residues[i] + 0j, 0j * residues[i], none).frf(_LINES)
            for i in range(len(at))
        ]
    )


def _apart(result: ComplexArray, exact: ComplexArray) -> float:
    """Return the worst relative L2 error over angles, of all FRFs together."""
    size = len(exact), -1
    apart = np.linalg.norm((result - exact).reshape(size), axis=1)
    return float((apart / np.linalg.norm(exact.reshape(size), axis=1)).max())


def _ours(model: LinkageModel, built: Table) -> float:
    """Return the same of the table, halfway between degrees."""
    angles = np.radians(np.arange(90.5, 180.0, 3.0))
    exact = np.array([terms.frf(_LINES) for terms in _terms(model, angles)])
    result = [built.frf(float(angle), PLACES, PLACES).frf(_LINES) for angle in angles]
    return _apart(np.array(result), exact)


def _draw(model: LinkageModel, built: Table, picture: Path) -> None:
    """Draw frequencies where two modes veer, and one FRF between grid points."""
    figure = picture_of("Two modes that veer, and an FRF halfway between grid points", 9.6, 4.6)
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.15])
    crank = LinkageModel(crossing_crank(0.02, _AT))
    angles = np.linspace(_AT - 0.025, _AT + 0.025, 801)
    ours = np.sort(build_table(crank).evaluate(angles)[:, :2], axis=1)
    curves = {"exact": (exact_frequencies(0.02, _AT, angles), INK, "-", 3.5)}
    for name, tracked, colour in (("sorted", False, COLOURS[1]), ("tracked", True, COLOURS[4])):
        values = CubicSpline(*_at_even_angles(crank, tracked))(angles)
        curves[f"plain, {name}"] = (values, colour, "-", 1.4)
    curves["ours"] = (ours, COLOURS[2], "--", 1.4)
    for name, (values, colour, dashes, width) in curves.items():
        lines = left.plot(np.degrees(angles), values, color=colour, ls=dashes, lw=width)
        lines[0].set_label(name)
    left.set(
        xlabel="$\\alpha_3$ [deg]", ylabel="natural frequency [Hz]", title="crank, gap 0.02 Hz"
    )
    grid = np.radians(np.arange(90.0, 181.0, 5.0))
    halfway = (grid[15:16] + grid[16:17]) / 2.0
    lines_near = (_LINES > 50.0) & (_LINES < 100.0)
    frfs = {
        "exact": (_terms(model, halfway)[0].frf(_LINES), INK, "-", 3.5),
        "FRFs, linear": (_linear(model, grid[15], grid[16]), COLOURS[1], "-", 1.4),
        "modes, signs lost": (_splines(model, grid, halfway, False)[0], COLOURS[4], "-", 1.4),
        "ours": (built.frf(float(halfway[0]), PLACES, PLACES).frf(_LINES), COLOURS[2], "--", 1.4),
    }
    for name, (frf, colour, dashes, width) in frfs.items():
        size = np.abs(frf[lines_near, 1, 2])
        right.semilogy(_LINES[lines_near], size, color=colour, ls=dashes, lw=width, label=name)
    right.set(
        xlabel="frequency [Hz]",
        ylabel="|H| of E1 x to E2 x [m/N]",
        title=f"default linkage, {math.degrees(halfway[0]):g} deg, 5 deg grid",
    )
    for ax in (left, right):
        ax.title.set_fontsize(9)
        ax.grid(color="#dddddd", linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
        ax.legend(fontsize=8, frameon=False)
    figure.savefig(picture)
