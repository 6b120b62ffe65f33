# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the errors that tables report with true ones: ``python -m benchmark.bounds``.

The true errors are those at random angles, at which the model is solved.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import linear_sum_assignment
from tqdm import tqdm

from benchmark.rates import joining_rates, undamped_slopes
from benchmark.report import machine, publish, table
from linkage_vibration.drawing.palette import COLOURS, GREY, INK, PEAK
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.description import Spring
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.modes import oscillating_indices
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table
from linkage_vibration.table.tabulation.frf_errors import frf_lines, worst_shares
from test.support.in_plane import IN_PLANE, plane_mechanism

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "bounds.png"
QUANTITIES = (
    "frequency",
    "damping ratio",
    "peak frequency",
    "peak height",
    "slope",
    "FRF",
    "force",
)
TOLERANCES = (1e-4, 1e-6, 1e-8)
ANGLES = 200
_CLOSE = 1e-4  # of a natural frequency: modes that are closer may be exchanged
_ALONE = 1e-6  # N/m or N m/rad, of a spring that is almost only a damper
_MICROMETRE = 1e-6  # m


@dataclass(frozen=True)
class Case:
    """A shipped linkage, often with a damper, or with another point on a link."""

    linkage: str
    damper: tuple[str, ...] = ()  # the points between which it acts, or the joint
    damping: float = 0.0  # N s/m or N m s/rad
    apart: float = 0.0  # m, from the first point of a link to another one
    link: str = "coupler"  # that has the other point

    def __str__(self) -> str:
        """Name it in a table."""
        unit = "N s/m" if len(self.damper) > 1 else "N m s/rad"
        name = self.linkage.replace("_", " ")
        name += f", {self.damping:g} {unit} at {' and '.join(self.damper)}" if self.damper else ""
        return name + (f", points {1e6 * self.apart:g} um apart" if self.apart else "")

    @property
    def model(self) -> LinkageModel:
        """The linkage, ready to be solved."""
        mechanism = plane_mechanism(f"{self.linkage}.yaml")
        links, springs = list(mechanism.links), list(mechanism.springs)
        if self.damper:
            bodies = [mechanism.owners(point) for point in self.damper]
            pair = bodies[0][:2] if len(bodies) == 1 else (bodies[0][0], bodies[1][0])
            springs.append(Spring("damper", (pair[0], pair[1]), self.damper, _ALONE, self.damping))
        if self.apart:
            i = [link.name for link in links].index(self.link)
            start, *rest = links[i].points
            beside = ("Q", (start[1][0] + self.apart, start[1][1]))
            links[i] = replace(links[i], points=(start, beside, *rest))
        return LinkageModel(replace(mechanism, links=tuple(links), springs=tuple(springs)))


SHIPPED = (
    Case("three_point_linkage"),
    Case("three_point_linkage_as_printed"),
    Case("four_bar"),
    Case("stephenson_six_bar"),
    Case("three_point_linkage_on_tractor"),
)
COUPLED = (
    *(Case("three_point_linkage", ("P1",), c) for c in (20.0, 100.0, 500.0, 5e3)),
    *(Case("four_bar", ("A", "C"), c) for c in (10.0, 1e3, 1e4, 1e6)),
    Case("four_bar", apart=_MICROMETRE),
    Case("three_point_linkage", apart=_MICROMETRE, link="lower_link"),
)
CASES = (*SHIPPED, *COUPLED)


def true_errors(model: LinkageModel, tables: Sequence[Table], angles: FloatArray) -> FloatArray:
    """Return the errors of tables at angles, (n_tables, n, 7), in the order of `QUANTITIES`.

    They are relative, and the worst of all modes or FRFs; those of slopes are divided by the
    natural frequencies, 1/rad. They are infinite if a mode has no values although it oscillates.

    Parameters
    ----------
    model, tables
        The model, and tables of it.
    angles : ndarray, (n,)
        rad.
    """
    values = [built.evaluate(angles) for built in tables]
    slopes = [built.evaluate_slopes(angles)[:, : built.n_modes] for built in tables]
    result = np.full((len(tables), len(angles), len(QUANTITIES)), math.nan)
    for i, angle in enumerate(angles.tolist()):
        solution = model.solve(angle)
        poles, rates = _poles(solution), slopes_of_poles(solution)
        overdamped = len(solution.modes.omega) - len(solution.natural_frequencies)
        peak, frfs = solution.peak(tables[0].peak_band), _Frfs(solution, tables[0])
        for k, built in enumerate(tables):
            value, slope = values[k][i], slopes[k][i]
            if np.isnan(slope).sum() > overdamped:
                result[k, i] = math.inf
                continue
            result[k, i, [0, 1, 4]] = _mode_errors(value[:-2], slope, poles, rates)
            result[k, i, 2] = abs(value[-2] - peak.frequency) / (peak.frequency or 1.0)
            result[k, i, 3] = abs(value[-1] / peak.magnitude - 1.0)
            result[k, i, 5:] = frfs.errors(built, angle)
    return result


def _poles(solution: Solution) -> ComplexArray:
    """Return the upper poles of elastic modes, (n,), Hz, ascending."""
    kept = solution.natural_frequencies > 0.01
    ratio = np.minimum(solution.damping_ratios[kept], 1.0)
    turn = np.asarray(-ratio + 1j * np.sqrt(1.0 - ratio**2), dtype=np.complex128)
    return np.asarray(solution.natural_frequencies[kept] * turn)


def slopes_of_poles(solution: Solution) -> FloatArray:
    """Return d(natural frequency)/d(alpha3) of elastic modes that oscillate, (n,), Hz/rad.

    As `undamped_slopes`, but of damped poles s where damping couples the modes: with
    L = psi^T (K + s C + s^2 M) psi + 2 mu^T B psi stationary in psi and mu,
    ds/d(alpha3) = -(psi^T (K' + s C') psi + 2 mu^T B' psi) / (psi^T (C + 2 s M) psi). The
    denominator is 1 for viscous damping, and 2 s for structural damping, with K complex.

    Parameters
    ----------
    solution : Solution
        The model at one angle.
    """
    if solution.damped.shapes is None:
        # One loss factor for all links raises every frequency by the same factor.
        elastic = ~solution.modes.mechanism
        raised = math.tau * solution.natural_frequencies[elastic] / solution.modes.omega[elastic]
        return np.asarray(raised * undamped_slopes(solution)[elastic])
    terms = oscillating_indices(solution.damped._upper_poles)
    poles, joining, system = solution.damped.oscillating, solution.joining, solution.model.system
    psi = solution.modes.shapes @ solution.damped.shapes[0][:, terms]
    alpha3 = solution.configuration.alpha3
    rate, stretch_rate, stiffness_rate = joining_rates(solution.model, alpha3)
    n = solution.model.system.n_interface
    u, stretch = psi[:n], joining.elongation @ psi[:n]
    force = joining.stiffness[:, np.newaxis] + poles * joining.damping[:, np.newaxis]
    residual = (system.stiffness + 1j * system.loss)[:n] @ psi + poles * (system.damping[:n] @ psi)
    residual += poles**2 * (system.mass[:n] @ psi) + joining.elongation.T @ (force * stretch)
    multipliers = np.linalg.lstsq(joining.compatibility.T + 0j, -residual, rcond=None)[0]
    slope = -2.0 * (multipliers * (rate @ u)).sum(axis=0)
    slope -= 2.0 * (force * stretch * (stretch_rate @ u)).sum(axis=0) + stiffness_rate @ stretch**2
    slope = slope if solution.damped.poles is not None else slope / (2.0 * poles)
    return np.asarray((poles.conj() * slope).real / np.abs(poles) / (2.0 * math.pi))


def _mode_errors(
    value: FloatArray, slope: FloatArray, poles: ComplexArray, rates: FloatArray
) -> tuple[float, float, float]:
    """Return the largest errors of frequencies, ratios and slopes of the modes that oscillate."""
    known = np.isfinite(slope)
    if not known.any():
        return 0.0, 0.0, 0.0
    frequency, ratio = np.reshape(value, (2, -1))[:, known]
    result = frequency * (-ratio + 1j * np.sqrt(np.maximum(1.0 - ratio**2, 0.0)))
    off = np.abs(result[:, np.newaxis] / poles - 1.0)
    pairs = linear_sum_assignment(off)[1]
    exact = np.array([np.abs(poles), -poles.real / np.abs(poles)])
    near = off < np.maximum(_CLOSE, off[np.arange(len(off)), pairs] * 1.001)[:, np.newaxis]
    turn = np.where(near, np.abs(slope[known, np.newaxis] - rates) / exact[0], np.inf)
    apart = np.abs(np.array([frequency, ratio]) / exact[:, pairs] - 1.0)
    return float(apart[0].max()), float(apart[1].max()), float(turn.min(axis=1).max())


class _Frfs:
    """The FRFs of the model at one angle between the places of tables."""

    def __init__(self, solution: Solution, built: Table) -> None:
        if built.places:
            exact = solution.frf([*built.places, *built.forces], built.places)
            self.lines, self._weights = frf_lines(exact, built.band)
            self._exact = self._weights * exact.frf(self.lines)

    def errors(self, built: Table, alpha3: float) -> FloatArray:
        """Return the largest errors of FRFs and forces of a table at the angle; NaN without."""
        if not built.places:
            return np.full(2, math.nan)
        rows = [*built.places, *built.forces]
        responses = built.frf(alpha3, rows, built.places).frf(self.lines)
        off = np.linalg.norm(self._weights * responses - self._exact, axis=0)
        return worst_shares(off, np.linalg.norm(self._exact, axis=0))


def reported_errors(built: Table, angles: FloatArray) -> FloatArray:
    """Return the errors that a table reports at angles, (n, 7), in the order of `QUANTITIES`.

    Parameters
    ----------
    built, angles
        As `true_errors` takes them.
    """
    starts = built.alpha3[built.pieces[:-1]]
    own = built.interpolation_error[np.searchsorted(starts, angles, side="right") - 1]
    rest = built.peak_error, built.peak_error, built.slope_error, built.frf_error, built.force_error
    return np.column_stack([own, own, *(np.full(len(angles), error) for error in rest)])


@dataclass(frozen=True)
class Result:
    """A table and its errors at random angles, or why it is refused."""

    case: Case
    tolerance: float
    refusal: str = ""
    solutions: int = 0
    points: int = 0
    share: FloatArray | None = None  # (n, 7): true errors over reported ones

    @property
    def row(self) -> list[str]:
        """The row of the page."""
        head = [str(self.case), f"{self.tolerance:.0e}"]
        if self.share is None:
            return [*head, "refused", *[""] * (len(QUANTITIES) + 2)]
        worst = [f"{ratio:.2f}" for ratio in self.share.max(axis=0)]
        rate = 100.0 * float((self.share > 1.0).mean(axis=0).max())
        return [*head, str(self.solutions), str(self.points), *worst, f"{rate:.1f} %"]


def results(case: Case, tolerances: Sequence[float], angles: FloatArray) -> list[Result]:
    """Build tables of a case and compare them with the model.

    Parameters
    ----------
    case, tolerances
        The linkage; relative tolerances of natural frequencies.
    angles : ndarray, (n,)
        Where they are compared, as shares of the stroke, 1.
    """
    model = case.model
    low, high = model.mechanism.stroke
    at = low + (high - low) * angles
    result: list[Result] = []
    tables: dict[int, Table] = {}
    for tolerance in tolerances:
        solved: list[float] = []
        try:
            built = build_table(model, tolerance, progress=solved.append)
        except LinkageVibrationError as error:
            result.append(Result(case, tolerance, str(error)))
            continue
        tables[len(result)] = built
        result.append(Result(case, tolerance, "", len(solved), len(built.alpha3)))
    errors = [*true_errors(model, list(tables.values()), at)] if tables else []
    for (i, built), off in zip(tables.items(), errors, strict=True):
        result[i] = replace(result[i], share=off / reported_errors(built, at))
    return result


def draw(computed: Sequence[Result]) -> None:
    """Draw what each table costs, and the largest true errors over the reported ones.

    Parameters
    ----------
    found : sequence of Result
        Those of the cases, one case after the other.
    """
    figure = Figure(figsize=(11.5, 6.2), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=[1.0, 1.3])
    cases = list(dict.fromkeys(result.case for result in computed))
    for result in computed:
        if result.share is None:
            continue
        i = TOLERANCES.index(result.tolerance)
        row = len(cases) - cases.index(result.case) + 0.25 * (1 - i)
        line = [result.points, result.solutions]
        left.semilogx(line, [row, row], "-", color=COLOURS[i], linewidth=1.0)
        left.plot(line[:1], [row], "o", color=COLOURS[i], markersize=5, markerfacecolor="white")
        left.plot(line[1:], [row], "o", color=COLOURS[i], markersize=5)
    shares = [(result.case, result.share) for result in computed if result.share is not None]
    for j, (name, marker) in enumerate(zip(QUANTITIES, "osD^vPX", strict=True)):
        rows, worst = np.arange(len(cases), 0, -1) - 0.11 * (j - 3), np.full(len(cases), math.nan)
        for case, share in shares:
            i = cases.index(case)
            worst[i] = np.fmax(worst[i], share[:, j].max())
        colour = (*COLOURS, PEAK, INK)[j]
        if np.isnan(worst).all():  # A legend names only what is drawn.
            continue
        right.plot(worst, rows, marker, color=colour, markersize=5, label=name)
    left.set_yticks(range(len(cases), 0, -1), [str(case) for case in cases], fontsize=8)
    for i, tolerance in enumerate(TOLERANCES):
        left.plot([], [], "o-", color=COLOURS[i], label=f"tolerance {tolerance:.0e}")
    left.plot([], [], "o", color=INK, markerfacecolor="white", label="points in the table")
    left.plot([], [], "o", color=INK, label="solutions of the model")
    left.set(xlabel="number", xticks=(20, 50, 100, 200), xticklabels=("20", "50", "100", "200"))
    left.minorticks_off()
    left.set_title("What a table costs", loc="left", color=INK)
    right.axvline(1.0, color=INK, linewidth=1.0)
    right.axvline(2.0, color=GREY, linewidth=0.8, linestyle="--")
    back = {"color": "white", "pad": 1.0}
    style = {"ha": "right", "color": GREY, "fontsize": 8, "bbox": back}
    right.text(1.97, 0.8, "no angle may exceed this", **style)
    right.set(xlim=(0.0, 2.1), ylim=(0.3, len(cases) + 0.7))
    right.set(xlabel="largest true error / reported error, for the worst tolerance")
    right.set_title("Are the reported errors bounds?", loc="left", color=INK)
    left.legend(frameon=False, fontsize=8, loc="best")
    boxed = {"framealpha": 1.0, "edgecolor": "white", "fontsize": 8}
    right.legend(loc="upper right", bbox_to_anchor=(1.95 / 2.1, 1.0), **boxed)
    for axes in (left, right):
        axes.grid(axis="x", color="#e4e4e4", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(PICTURE, dpi=150)


def main() -> None:
    """Build the tables, measure them, and write the results and the picture."""
    angles, result = np.random.default_rng(1).uniform(size=ANGLES), list[Result]()
    for case in tqdm(CASES, unit="linkage"):
        result += results(case, TOLERANCES, angles)
    draw(result)
    columns = ["linkage", "tolerance", "solutions", "points", *QUANTITIES, "angles above 1"]
    refusals = [
        f"- {each.case}, {each.tolerance:.0e}: {each.refusal}" for each in result if each.refusal
    ]
    publish(
        "bounds",
        "Errors that tables report",
        [
            f"This page shows the errors of tables at {ANGLES} random angles of the stroke, in "
            "units of the error that the table reports for that quantity; the largest of all "
            "angles. The last column is the share of the angles at which any error is larger than "
            "reported, for the worst quantity. Solutions that are not points of the table measure "
            "its errors, or tell modes apart. Dampers are springs with a stiffness of "
            f"{_ALONE:.0e} N/m or N m/rad. The picture is `docs/pictures/bounds.png`.",
            IN_PLANE,
            table(columns, [each.row for each in result]),
            *(["These are refused:", "\n".join(refusals)] if refusals else []),
        ],
        machine("matplotlib"),
    )


if __name__ == "__main__":
    main()
