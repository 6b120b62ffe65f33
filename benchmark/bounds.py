# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the errors that tables report with true ones: ``python -m benchmark.bounds``.

The true errors are those at random angles, at which the model is solved.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import linear_sum_assignment
from tqdm import tqdm

from benchmark.report import machine, publish, table
from linkage_vibration.drawing.palette import COLOURS, GREY, INK
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table
from linkage_vibration.table.tabulation.verification import frf_lines, worst_frf_error

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "bounds.png"
LINKAGES = ("three_point_linkage", "three_point_linkage_as_printed", "four_bar")
QUANTITIES = ("frequency", "damping ratio", "peak frequency", "peak height", "slope", "FRF")
TOLERANCES = (1e-4, 1e-6, 1e-8)
ANGLES = 200
_CLOSE = 1e-4  # of a natural frequency: modes that are closer may be exchanged


def true_errors(model: LinkageModel, built: Table, angles: FloatArray) -> FloatArray:
    """Return the errors of a table at angles, (n, 6), in the order of `QUANTITIES`.

    They are relative, and the worst of all modes or FRFs; those of slopes are divided by the
    natural frequencies, 1/rad.

    Parameters
    ----------
    model, built
        The model, and its table.
    angles : ndarray, (n,)
        rad.
    """
    n, values, slopes = built.n_modes, built.evaluate(angles), built.evaluate_slopes(angles)
    rows = []
    for angle, value, slope in zip(angles.tolist(), values, slopes, strict=True):
        solution = model.solve(angle)
        elastic = np.flatnonzero(~solution.modes.mechanism)
        exact = np.array(
            [
                solution.natural_frequencies[elastic],
                solution.damping_ratios[elastic],
                solution.frequency_derivatives[elastic],
            ]
        )
        off = np.abs(exact[0] / value[:n, np.newaxis] - 1.0)
        pairs = linear_sum_assignment(off)[1]
        near = off < np.maximum(_CLOSE, off[np.arange(n), pairs] * 1.001)[:, np.newaxis]
        ratio = np.where(near, np.abs(value[n : 2 * n, np.newaxis] / exact[1] - 1.0), np.inf)
        turn = np.where(near, np.abs(slope[:, np.newaxis] - exact[2]) / exact[0], np.inf)
        peak = solution.peak(built.band)
        apart = abs(value[-2] - peak.frequency) / (peak.frequency or 1.0)
        frf = np.nan
        if built.places:
            right = solution.frf(built.places, built.places)
            lines, weights = frf_lines(right, built.band)
            found = built.frf(angle, built.places, built.places).frf(lines)
            frf = worst_frf_error(weights * found, weights * right.frf(lines))
        worst = [off[np.arange(n), pairs].max(), ratio.min(axis=1).max(), apart]
        rows.append([*worst, abs(value[-1] / peak.magnitude - 1.0), turn.min(axis=1).max(), frf])
    return np.array(rows)


def reported_errors(built: Table, angles: FloatArray) -> FloatArray:
    """Return the errors that a table reports at angles, (n, 6), in the order of `QUANTITIES`.

    Parameters
    ----------
    built, angles
        As `true_errors` takes them.
    """
    starts = built.alpha3[built.pieces[:-1]]
    own = built.interpolation_error[np.searchsorted(starts, angles, side="right") - 1]
    rest = built.peak_error, built.peak_error, built.slope_error, built.frf_error
    return np.column_stack([own, own, *(np.full(len(angles), error) for error in rest)])


def draw(solutions: FloatArray, ratios: FloatArray) -> None:
    """Draw solutions over the tolerance, and true over reported errors.

    Parameters
    ----------
    solutions, ratios : ndarray, (n_linkages, n_tolerances) and (n_linkages, n_tolerances, 6)
        Number of solutions, and the largest ratios of a true error to the reported one.
    """
    figure = Figure(figsize=(10.5, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.4])
    for i, (name, colour) in enumerate(zip(LINKAGES, COLOURS, strict=False)):
        label = name.replace("_", " ")
        left.loglog(TOLERANCES, solutions[i], "o-", color=colour, label=label, markersize=5)
        for j in range(len(QUANTITIES)):
            at = j + 0.2 * (i - 1) + np.linspace(-0.06, 0.06, len(TOLERANCES))
            right.plot(at, ratios[i, :, j], "o", color=colour, markersize=4)
    left.invert_xaxis()
    left.set_yticks([30, 100, 300], ["30", "100", "300"])
    left.minorticks_off()
    left.set(xlabel="tolerance of the natural frequencies", ylabel="solutions of the model")
    left.set_title("What a table costs", loc="left", color=INK)
    left.legend(frameon=False, fontsize=8)
    right.axhline(1.0, color=INK, linewidth=1.0)
    right.text(5.45, 1.02, "the true error equals the reported one", ha="right", color=INK)
    right.axhline(2.0, color=GREY, linewidth=0.8, linestyle="--")
    right.text(5.45, 1.94, "no angle may exceed this", ha="right", va="top", color=GREY)
    names = [name.replace(" ", "\n") for name in QUANTITIES]
    right.set_xticks(range(len(QUANTITIES)), names)
    right.set(ylim=(0.0, 2.1), ylabel="largest true error / reported error")
    right.set_title("Are the reported errors bounds?", loc="left", color=INK)
    for axes in (left, right):
        axes.grid(axis="y", color="#e4e4e4", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(PICTURE, dpi=150)


def main() -> None:
    """Build the tables, measure them, and write the results and the picture."""
    random, rows, rates = np.random.default_rng(1), [], []
    counts, ratios = [], []
    progress = tqdm(total=len(LINKAGES) * len(TOLERANCES), unit="table")
    for name in LINKAGES:
        model = LinkageModel(read_mechanism(config_file(f"{name}.yaml")))
        angles = random.uniform(*model.mechanism.stroke, ANGLES)
        for tolerance in TOLERANCES:
            solved: list[float] = []
            built = build_table(model, tolerance, progress=solved.append)
            share = true_errors(model, built, angles) / reported_errors(built, angles)
            counts.append(len(solved))
            ratios.append(share.max(axis=0))
            rates.append((share > 1.0).mean(axis=0).max())
            head = [name, f"{tolerance:.0e}", str(len(solved)), str(len(built.alpha3))]
            worst = [f"{ratio:.2f}" for ratio in ratios[-1]]
            rows.append([*head, *worst, f"{100.0 * rates[-1]:.1f} %"])
            progress.update()
    progress.close()
    shape = len(LINKAGES), len(TOLERANCES)
    draw(np.reshape(counts, shape), np.reshape(ratios, (*shape, len(QUANTITIES))))
    columns = ["linkage", "tolerance", "solutions", "points", *QUANTITIES, "angles above 1"]
    publish(
        "bounds",
        "Errors that tables report",
        [
            f"The errors of tables at {ANGLES} random angles of the stroke, in units of the error "
            "that the table reports for that quantity; the largest of all angles. The last column "
            "is the share of the angles at which any error is larger than reported, for the worst "
            "quantity. The picture is `docs/pictures/bounds.png`.",
            table(columns, rows),
        ],
        machine("matplotlib"),
    )


if __name__ == "__main__":
    main()
