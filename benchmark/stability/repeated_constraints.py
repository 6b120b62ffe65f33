# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Joints closed twice, dependent rows of B, a body joined to itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.report import table
from benchmark.stability.static_limit import (
    ALPHA3,
    PLACES,
    component_frfs,
    linkage,
    picture_of,
    plain_lm_fbs,
    share,
)
from linkage_vibration.drawing.palette import COLOURS, GREY
from linkage_vibration.mechanics.compatibility import CouplingError, row_space
from linkage_vibration.mechanics.coupling import couple
from linkage_vibration.mechanics.fbs import couple_frfs
from linkage_vibration.mechanics.modes import solve_modes

FloatArray = NDArray[np.float64]

TITLE = "Repeated constraints"
LINES = np.linspace(0.5, 200.0, 400)


def section(pictures: Path) -> str:
    """Repeat constraints of the paper's linkage in several ways, draw B's spectra, and report."""
    model = linkage()
    solution = model.solve(ALPHA3)
    rows, joining = model.rows(PLACES, solution.configuration), solution.joining
    b, labels = joining.compatibility, joining.labels
    v1 = [i for i, label in enumerate(labels) if "pin V1" in label]
    e2 = model.interface.displacement("implement", "E2", solution.configuration)
    further: dict[str, tuple[NDArray[np.floating], list[str]]] = {
        "pin V1 closed twice": (b[v1], [labels[i] for i in v1]),
        "V1 once more, at an angle": (0.6 * b[v1[:1]] + 0.8 * b[v1[1:]], ["V1 aslant"]),
        "E2 of the implement on itself": (e2 - e2, ["E2 on itself in x", "E2 on itself in z"]),
        "every joint closed twice": (b, list(labels)),
    }
    blocks = component_frfs(model, LINES)
    once = couple_frfs(blocks, b, rows, rows)
    table_rows: list[list[str]] = []
    spectra: dict[str, NDArray[np.floating]] = {"as it is": np.linalg.svd(b, compute_uv=False)}
    for words, (extra, names) in further.items():
        more = np.vstack([b, extra])
        spectra[words] = np.linalg.svd(more, compute_uv=False)
        coupled = couple(
            model.system, replace(joining, compatibility=more, labels=(*labels, *names))
        )
        rank = len(row_space(more, (*labels, *names))[0])
        assert rank == len(b)
        omega = solve_modes(coupled)[0].omega[:10]
        plain = [share(plain_lm_fbs(blocks, more, rows, how), once) for how in ("solve", "inv")]
        table_rows.append(
            [
                words,
                f"{len(more) - rank} of {len(more)}",
                *(_of_lines(errors) for errors in plain),
                f"{share(couple_frfs(blocks, more, rows, rows), once).max():.0e}",
                f"{np.abs(omega / solution.modes.omega[:10] - 1.0).max():.0e}",
            ]
        )
    near = np.vstack([b, b[v1[0]] + 1e-9 * np.roll(b[v1[0]], 1)])
    spectra["V1 again, 1e-9 askew"] = np.linalg.svd(near, compute_uv=False)
    try:
        row_space(near, (*labels, "V1 askew"))
        raise AssertionError("a row that nearly repeats another was not refused")
    except CouplingError as error:
        refusal = str(error)
    _draw(pictures / "repeated_constraints.png", spectra)
    columns = [
        "what repeats",
        "rows",
        "eq. 19, `solve`",
        "eq. 19, `inv`",
        "ours, FRFs",
        "ours, frequencies",
    ]
    return f"""\
A row of B that is a combination of other rows makes B H B^T singular. Rounding often hides this,
and equation 19 then silently gives wrong results. The table shows on how many of 400 lines it stops
with an error, on how many its error exceeds 1e-6 of the largest of 16 FRFs, and the error of ours
on the worst line:

{table(columns, table_rows)}

Ours replaces the rows by a basis of their span, by an SVD of B that drops singular values below
1e-12 of the largest one, in the assembly and in LM-FBS. Between 1e-12 and 1e-6 a joint cannot be
distinguished from rounding. Therefore such constraints are rejected: "{refusal}"

A mechanism file cannot contain this fault: points are joined by their names, a name occurs once
on a body, and if pins hold a linkage twice, it has fewer than one degree of freedom.

Tests: `test/mechanics/test_coupling.py::test_linkage_with_joints_closed_twice`,
`::test_joints_nearly_closed_twice_are_refused`,
`test/mechanics/test_fbs.py::test_joints_closed_twice`,
`test/mechanics/test_compatibility.py::test_rows_that_repeat_are_left_out`,
`::test_a_joint_of_a_body_with_itself`.

![Singular values of B with joints repeated, and the cut-off](stability/repeated_constraints.png)
"""


def _of_lines(errors: FloatArray) -> str:
    """Return the numbers of lines with an error or a wrong result, and the largest error."""
    stopped, wrong = int(np.isnan(errors).sum()), int((errors > 1e-6).sum())
    words = [f"stops on {stopped}"] if stopped else []
    return ", ".join(
        [*words, f"wrong on {wrong}, by up to {np.nanmax(errors):.0e}"] if wrong else words
    )


def _draw(path: Path, spectra: dict[str, NDArray[np.floating]]) -> None:
    figure = picture_of("Singular values of B at 140 deg, zeros drawn at 1e-18")
    ax = figure.subplots()
    ax.axhspan(1e-12, 1e-6, color="#f3dede", zorder=0)
    ax.axhspan(1e-19, 1e-12, color="#eeeeee", zorder=0)
    markers = "osv^Dx"
    colours = (*COLOURS, "#AA4499")
    for i, (words, values) in enumerate(spectra.items()):
        ax.semilogy(
            np.arange(1, len(values) + 1) + 0.12 * (i - 2.5),
            np.maximum(values / values[0], 1e-18),
            markers[i],
            color=colours[i],
            markersize=4.5,
            linestyle="none",
            label=words,
        )
    ax.annotate("refused", (0.5, 1e-9), color=GREY, va="center")
    ax.annotate("cut off: repeats others", (0.5, 1e-15), color=GREY, va="center")
    ax.set(
        xlabel="singular value, from the largest [1]",
        ylabel="singular value / largest [1]",
        ylim=(1e-19, 10.0),
    )
    ax.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    figure.savefig(path)
