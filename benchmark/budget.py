# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures where accuracy is lost, from table to physics: ``python -m benchmark budget``."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmark.report import RESULTS, machine, publish, table
from linkage_vibration.drawing.palette import COLOURS, GREY, PEAK
from linkage_vibration.mechanics.description import GROUND, Mechanism
from linkage_vibration.mechanics.model import LinkageModel, Solution
from test.support.in_plane import IN_PLANE, plane_mechanism, plane_table

FloatArray = NDArray[np.float64]

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "budget.png"
NAME = "three_point_linkage_on_tractor"
QUANTITIES = "implement heave", "implement pitch", "lower link bending", "highest peak"
N_ANGLES = 7
FINER = 4  # times the elements of the description
N_HITCH, N_TRACTOR = 3, 3  # modes of the hitch, after those of the tractor


@dataclass(frozen=True)
class Entry:
    """What one cause changes.

    Attributes
    ----------
    cause, meaning : str
        Its name, and what was compared.
    changes : ndarray, (4,)
        The largest relative changes over the stroke, of `QUANTITIES`; NaN if it is not known.
    """

    cause: str
    meaning: str
    changes: FloatArray


def logarithms(solution: Solution, mechanism: Mechanism, skipped: int) -> FloatArray:
    """Return the logarithms of the hitch's natural frequencies and of the highest peak, (4,).

    Parameters
    ----------
    solution, mechanism, skipped
        A configuration, its mechanism, and the number of modes below those of the hitch.
    """
    frequencies = solution.natural_frequencies
    peak = solution.peak(mechanism.response.peak_band)
    return np.log([*frequencies[skipped : skipped + N_HITCH], peak.magnitude])


def over_the_stroke(model: LinkageModel) -> FloatArray:
    """Return `logarithms` at even angles over the stroke, (n_angles, 4)."""
    own = model.mechanism
    angles = np.linspace(*own.stroke, N_ANGLES).tolist()
    skipped = N_TRACTOR if own.base else 0
    return np.array([logarithms(model.solve(at), own, skipped) for at in angles])


def largest(changes: FloatArray) -> FloatArray:
    """Return the largest relative changes over the stroke, (4,), from those of logarithms."""
    return np.asarray(np.abs(np.expm1(changes)).max(axis=0))


def meshed(mechanism: Mechanism, factor: int) -> Mechanism:
    """Return a mechanism with a multiple of its elements.

    Parameters
    ----------
    mechanism, factor
        Whose links are beams; the multiple.
    """
    links = [
        replace(link, body=link.body.with_elements(factor * (link.body.elements or 1)))
        for link in mechanism.links
    ]
    return replace(mechanism, links=tuple(links))


def numerical(exact: FloatArray, model: LinkageModel) -> list[Entry]:
    """Return what table, reduction and mesh change.

    Parameters
    ----------
    exact, model
        The result over the stroke, and the model that it comes from.
    """
    own = model.mechanism
    built = plane_table()
    bound = [float(built.interpolation_error.max())] * N_HITCH
    whole = LinkageModel(own, reduced=False, kinematics=model.kinematics)
    fine = LinkageModel(meshed(own, FINER), kinematics=model.kinematics)
    elements = own.links[0].body.elements
    return [
        Entry("table", "its bound", np.array([*bound, built.peak_error])),
        Entry("reduction", "20 modes a link against all", largest(over_the_stroke(whole) - exact)),
        Entry(
            "mesh",
            f"{elements} elements a link against {FINER * (elements or 1)}",
            largest(over_the_stroke(fine) - exact),
        ),
    ]


def rigid_crank(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose input crank is clamped to the ground instead of held by springs."""
    crank, ground = mechanism.input_body, dict(mechanism.ground)
    springs = tuple(each for each in mechanism.springs if set(each.bodies) != {crank, GROUND})
    links = [
        replace(link, clamped=next(name for name, _ in link.points if name in ground))
        if link.name == crank
        else link
        for link in mechanism.links
    ]
    return replace(mechanism, links=tuple(links), springs=springs, uncertainty=None)


def physical(exact: FloatArray, model: LinkageModel) -> list[Entry]:
    """Return what the choice of the physics changes.

    Parameters
    ----------
    exact, model
        As `numerical` takes them.
    """
    own, known = model.mechanism, model.kinematics

    def solved(mechanism: Mechanism) -> FloatArray:
        return over_the_stroke(LinkageModel(mechanism, kinematics=known))

    rigid = rigid_crank(own)
    on_base, on_ground = solved(rigid), solved(replace(rigid, base=None))
    return [
        Entry(
            "no base",
            "ground that cannot move against the tractor, rigid rockshaft",
            largest(on_ground - on_base),
        ),
        Entry("no oil", "rigid rockshaft against oil, on the tractor", largest(on_base - exact)),
        Entry("beams", "beams against solids, clamped linkage, 3 angles", solid_changes()),
    ]


def solid_changes() -> FloatArray:
    """Read how solid links differ from beams, from the results of that benchmark, (4,)."""
    rows = (RESULTS / "solid_fe.md").read_text(encoding="utf-8").splitlines()

    def values(label: str) -> FloatArray:
        own = [row.split("|") for row in rows if label in row]
        return np.array([[float(cell) for cell in cells[3:6]] for cells in own])

    changes = np.log(values("for comparison: beams") / values("ours, substructured"))
    return np.append(largest(changes), math.nan)


def uncertain(model: LinkageModel) -> list[Entry]:
    """Return one standard deviation by the uncertain numbers, of dampings and of all others."""
    uncertainty = model.mechanism.uncertainty
    assert uncertainty is not None
    numbers, correlation = uncertainty.numbers, np.array(uncertainty.correlation)
    rates = []
    for i, number in enumerate(numbers):
        values = [other.value for other in numbers]
        sides = []
        for steps in (-0.01, 0.01):
            values[i] = number.moved(steps)
            sides.append(over_the_stroke(LinkageModel(uncertainty.described(values))))
        rates.append((sides[1] - sides[0]) / 0.02)
    changes = np.array(rates)  # (n_numbers, n_angles, 4)
    damping = np.array(["damping" in number.path for number in numbers])

    def deviation(chosen: NDArray[np.bool_]) -> FloatArray:
        own = changes * chosen[:, np.newaxis, np.newaxis]
        variance = (own * np.tensordot(correlation, own, 1)).sum(axis=0)
        return np.asarray(np.sqrt(variance).max(axis=0))

    return [
        Entry("parameters", "one standard deviation, all but damping", deviation(~damping)),
        Entry("damping", "one standard deviation of the dampings", deviation(damping)),
    ]


def draw(entries: list[Entry], picture: Path) -> None:
    """Draw the changes, the smallest cause at the top.

    Parameters
    ----------
    entries, picture
        In their order; the file to write.
    """
    figure = Figure(figsize=(9.0, 4.8), dpi=110, layout="constrained")
    axes = figure.subplots()
    for i, name in enumerate(QUANTITIES):
        colour = (*COLOURS[:N_HITCH], PEAK)[i]
        at = [row + 0.12 * (i - 1.5) for row in range(len(entries))]
        percent = [100.0 * max(float(entry.changes[i]), 1e-9) for entry in entries]
        axes.semilogx(percent, at, "D" if name == QUANTITIES[-1] else "o", color=colour, label=name)
    axes.set_yticks(range(len(entries)), [f"{e.cause}: {e.meaning}" for e in entries], fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("largest relative change over the stroke [%], or 1e-7 % if it is less")
    axes.set_xlim(5e-8, 1e3)
    axes.grid(axis="x", color=GREY, alpha=0.2)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="lower left")
    figure.savefig(picture)


def percent(change: float) -> str:
    """Return a relative change in per cent."""
    return "not known" if math.isnan(change) else f"{100.0 * change:.2g} %"


def main() -> None:
    """Compare, and write the table and the picture."""
    model = LinkageModel(plane_mechanism())
    exact = over_the_stroke(model)
    parts: list[Callable[[], list[Entry]]] = [
        lambda: numerical(exact, model),
        lambda: physical(exact, model),
        lambda: uncertain(model),
    ]
    entries = [entry for part in parts for entry in part()]
    entries.sort(key=lambda entry: float(np.nanmax(entry.changes[:N_HITCH])))
    draw(entries, PICTURE)
    rows = [[e.cause, e.meaning, *map(percent, e.changes.tolist())] for e in reversed(entries)]
    publish(
        "budget",
        "Where accuracy is lost",
        [
            f"This page shows what each cause changes in three natural frequencies of the hitch "
            f"and in its highest peak, for `{NAME}`: the largest relative change at {N_ANGLES} "
            "angles over the stroke, in order of size. The highest peak is that of the tractor's "
            "modes. The dampings "
            "and other numbers are as uncertain as the description says. The row of beams comes "
            "from `benchmark/results/solid_fe.md`, which has no peaks.",
            IN_PLANE,
            table(["cause", "compared", *QUANTITIES], rows),
            "Nothing here was compared with a measured hitch. `docs/limits.md` lists what no row "
            "contains.",
        ],
        machine("matplotlib"),
    )


if __name__ == "__main__":
    main()
