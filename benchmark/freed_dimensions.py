# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Fits the printed frequencies with one dimension of Table 1 freed, to find a misprint.

``python -m benchmark.freed_dimensions`` draws docs/reproduction/freed_dimensions.png, and beside it
mast_and_inertia.png, which shows what the two lengths of the upper link do to the implement.

Each fit also chooses the area and the radius of gyration of each link, of the lower link in two
sections, and the rotational spring at P3 that holds the crank. Their bounds are wide, so that a
frequency that is missed even so cannot be the fault of the sections.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares
from tqdm import tqdm

from benchmark.paper.figures import (
    CRANK,
    Sweeps,
    add_legend,
    label_place,
    stroke_axis,
    styled,
    titled_figure,
)
from benchmark.paper.numbers import (
    GEOMETRY,
    OVER_THE_SWEEP,
    SUBSTRUCTURING,
    Number,
    frequencies,
    printed_numbers,
)
from benchmark.reproduce import FILES, PRINTED_FILE
from linkage_vibration.drawing.palette import COLOURS, GREY
from linkage_vibration.drawing.plots import tidy
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.coupling import couple
from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.kinematics import Configuration, Kinematics
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.modes import solve_modes
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import number_at, with_numbers
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.support.resources import config_file

Closed = dict[float, tuple[Kinematics, list[Configuration]]]
"""Kinematics and configurations by the value of the freed dimension, because they take longest."""

FITTED = (*printed_numbers(SUBSTRUCTURING), *printed_numbers(OVER_THE_SWEEP))
"""The nine natural frequencies that a choice of sections has to meet."""
DIMENSIONS = {number.key: number for number in printed_numbers(GEOMETRY)}
FREED = tuple(DIMENSIONS)[2:16]
PICTURE = Path(__file__).parents[1] / "docs/reproduction/freed_dimensions.png"
_UPRIGHT = math.radians(10.0)  # a well-built hitch keeps its mast this near to the vertical

_AREA = (4e-4, 100e-4)  # m2
_GYRATION = (6e-3, 60e-3)  # m
_SPRING = (1e4, 1e9)  # N m/rad
_SECTIONS = ("lower_link", "lower_link_end", "upper_link", "input_crank", "lift_rod")
_LOW, _HIGH = (
    np.log([*[area, gyration] * len(_SECTIONS), spring])
    for area, gyration, spring in zip(_AREA, _GYRATION, _SPRING, strict=True)
)
_STARTS = [
    np.log([*[area, gyration] * len(_SECTIONS), 1e7])
    for area, gyration in ((16e-4, 12e-3), (30e-4, 25e-3))
]
_ANGLES = np.radians([90.0, 110.0, 125.0, 140.0, 155.0, 168.0, 180.0])
_REACH = 0.3  # by which a dimension is freed, of its length; a coordinate, of half a metre
_SHARES: FloatArray = np.linspace(-0.9, 0.9, 7)  # of that reach, where it is held at first


@dataclass(frozen=True, slots=True)
class FreedFit:
    """How well straight beams meet the nine printed frequencies with one dimension freed."""

    key: str  # of the number of Table 1 that was fitted too; empty if none was
    value: float  # its fitted value; NaN if none was fitted
    cost: float  # half the sum of the squared logarithms of the ratios to the printed frequencies
    worst: float  # the largest relative difference from them
    lean: float  # largest angle between the implement's mast and the vertical over the stroke, rad


def scan_freed_dimensions(
    keys: Sequence[str] = FREED,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    evaluations: int = 10,
) -> list[FreedFit]:
    """Fit the sections and one dimension of Table 1 at a time to the nine printed frequencies.

    A misprinted dimension is one that, freed alone, lets the frequencies be met. The first fit that
    is returned has no dimension freed. While a dimension is held, least squares takes so many
    evaluations; once it is free, twice as many.
    """
    described = load_yaml(config_file(PRINTED_FILE))[0]
    total = 1 + len(keys)
    progress(0, total)
    fits = [_best_fit(described, "", _STARTS, (_LOW, _HIGH), evaluations)]
    for key in keys:
        progress(len(fits), total)
        fits.append(_free(described, key, evaluations))
    progress(total, total)
    return fits


def _free(described: Any, key: str, evaluations: int) -> FreedFit:
    """Fit one dimension: first hold it at several values, then free it from the best two.

    The valley is not convex, so that a fit from the printed value alone may miss the best one.
    """
    at = number_at(described, DIMENSIONS[key].place)
    reach = _REACH * (0.5 if key.endswith((".x", ".z")) else abs(at))
    held = [
        _fit_held(described, key, start, value, evaluations)
        for value in (at + reach * _SHARES).tolist()
        for start in _STARTS
    ]
    held.sort(key=lambda x: _fit(described, key, x).cost)
    bounds = np.append(_LOW, at - reach), np.append(_HIGH, at + reach)
    return _best_fit(described, key, held[:2], bounds, evaluations)


def _fit_held(
    described: Any, key: str, start: FloatArray, value: float, evaluations: int
) -> FloatArray:
    """Fit the sections alone, which leaves the loops closed as they are."""
    closed: Closed = {}

    def residuals(sections: FloatArray) -> FloatArray:
        return _residuals(np.append(sections, value), described, key, closed)

    fit = least_squares(residuals, start, bounds=(_LOW, _HIGH), max_nfev=evaluations)
    return np.append(fit.x, value)


def _best_fit(
    described: Any,
    key: str,
    starts: Sequence[FloatArray],
    bounds: tuple[FloatArray, FloatArray],
    evaluations: int,
) -> FreedFit:
    fits = []
    for x in starts:
        options = {"bounds": bounds, "max_nfev": 2 * evaluations, "args": (described, key, {})}
        fits.append(_fit(described, key, least_squares(_residuals, x, **options).x))
    return min(fits, key=lambda fit: fit.cost)


def _fit(described: Any, key: str, x: FloatArray) -> FreedFit:
    closed: Closed = {}
    off = _residuals(x, described, key, closed)
    angles = [
        at.angle("implement") for _, configurations in closed.values() for at in configurations
    ]
    lean = max((abs(angle - math.pi / 2.0) for angle in angles), default=math.nan)
    cost, worst = float(off @ off) / 2.0, float(np.abs(np.expm1(off)).max())
    return FreedFit(key, float(x[-1]) if key else math.nan, cost, worst, lean)


def _residuals(x: FloatArray, described: Any, key: str, closed: Closed) -> FloatArray:
    """Return ln(ours / printed) of the nine frequencies; ones if the loops do not close."""
    value = float(x[-1]) if key else 0.0
    try:
        mechanism = _straight_beams(described, key, x)
        if value not in closed:
            kinematics = Kinematics(mechanism)
            closed[value] = kinematics, [kinematics.at(float(alpha3)) for alpha3 in _ANGLES]
        f = _first_three(mechanism, *closed[value])
    except MechanismError:
        return np.ones(len(FITTED))
    ours = frequencies(f, f[3])
    return np.log([ours[number.key] / number.value for number in FITTED])


def _first_three(
    mechanism: Mechanism, kinematics: Kinematics, configurations: Sequence[Configuration]
) -> FloatArray:
    """Return natural frequencies in Hz, (n, 3), without closing the loops again."""
    model = LinkageModel(mechanism, kinematics=kinematics)
    joined = (couple(model.system, model.interface.join(at)) for at in configurations)
    return np.array([solve_modes(system)[0].omega[:3] for system in joined]) / (2.0 * math.pi)


def _straight_beams(described: Any, key: str, x: FloatArray) -> Mechanism:
    """Return a coarse linkage with other sections, a sprung crank, and one dimension freed.

    ``x`` holds the logarithms of the sections' properties and of the spring's stiffness, and the
    value of the freed dimension, if there is one.
    """
    mapping = with_numbers(described, [(DIMENSIONS[key].place, float(x[-1]))] if key else [])
    values = np.exp(x[: 2 * len(_SECTIONS) + 1])
    sections = {
        name: {"shape": "general", "area": float(a), "second_moment": float(a * r**2)}
        for name, a, r in zip(_SECTIONS, values[0:-1:2], values[1:-1:2], strict=True)
    }
    for name, link in mapping["links"].items():
        link.update(section=sections[name], elements=8, modes=3)
    del mapping["links"]["input_crank"]["clamped"]
    mapping["springs"] = {"rockshaft": {"joint": "P3", "stiffness": float(values[-1])}}
    lower = mapping["links"]["lower_link"]
    del lower["section"]
    lower["sections"] = [
        {"until": lower["points"]["V1"], **sections["lower_link"]},
        {"until": lower["points"]["E1"], **sections["lower_link_end"]},
    ]
    return mechanism_from_mapping(mapping)


def draw(fits: Sequence[FreedFit]) -> Figure:
    """Draw the cost of each fit, with how far the mast leans."""
    title = "The printed frequencies with one dimension of Table 1 freed at a time"
    note = "fitted with all sections; degrees: how far the mast leans, orange: up to 10 deg"
    """Draw the cost of each fit, with how far the mast leans."""
    figure = titled_figure(title, note, (8, 5.6))
    ordered = sorted(fits, key=lambda fit: fit.cost, reverse=True)
    names = ["none" if not fit.key else _change(DIMENSIONS[fit.key], fit.value) for fit in ordered]
    ax = figure.subplots()
    colours = [COLOURS[1] if fit.lean < _UPRIGHT else GREY for fit in ordered]
    ax.barh(names, [fit.cost for fit in ordered], color=colours, height=0.7)
    for row, fit in enumerate(ordered):
        lean = f"{math.degrees(fit.lean):.0f} deg"
        text = f"{fit.cost:.3f}  within {100 * fit.worst:.0f} %, {lean}"
        label_place(ax, text, (fit.cost, row), (4, 0), va="center", fontsize=8)
    tidy(ax)
    ax.grid(visible=False, axis="y")
    ax.tick_params(axis="y", labelsize=7.5, length=0)
    label = "half the sum of squared ln(ours / the paper's)"
    ax.set(xlim=(0.0, 1.35 * ordered[0].cost), xlabel=label)
    return figure


def generalised_inertia(mechanism: Mechanism, configuration: Configuration) -> float:
    """Return J = sum of m v^2 + I theta'^2 of the rigid bodies, kg m2, rates per rad of alpha3.

    It is the inertia at the input: the lower it is, the higher the first natural frequency.
    """
    return sum(
        body.mass * float(np.sum(configuration.place_rate(body.name, body.centre_of_gravity) ** 2))
        + body.inertia * configuration.velocity_ratio(body.name) ** 2
        for body in mechanism.rigid_bodies
    )


def draw_mast_and_inertia(sweeps: Sweeps) -> Figure:
    """Draw the angle of the mast and the inertia at the input, for both upper links."""
    note = "without any section: kinematics and the implement's printed mass and inertia alone"
    title = "What the length of the upper link does to the implement"
    figure = titled_figure(title, note, (8, 6))
    mast, inertia = figure.subplots(2, sharex=True)
    alpha3 = np.linspace(90.0, 180.0, 181)
    for solutions, style in styled(sweeps):
        model = solutions[0].model
        places = [model.kinematics.at(math.radians(alpha)) for alpha in alpha3]
        mast.plot(alpha3, np.degrees([place.angle("implement") for place in places]), **style)
        inertias = [generalised_inertia(model.mechanism, place) for place in places]
        inertia.plot(alpha3, inertias, **style)
    mast.axhline(90.0, color=GREY, linewidth=1, linestyle=":")
    mast.annotate("upright", (91, 90.4), fontsize=8, color=GREY)
    inertia.set_ylim(bottom=0.0)
    stroke_axis(mast, ylabel="mast, E1 to E2 [deg]")
    stroke_axis(inertia, xlabel=CRANK, ylabel="implement's inertia\nabout $α_3$ [kg m²]")
    add_legend(figure, mast, 2)
    return figure


def _change(number: Number, fitted: float) -> str:
    return f"{number.quantity}\n{number.value:g} to {fitted:.3g} {number.unit}".strip()


def main() -> None:
    """Fit with each dimension freed, and draw the picture."""
    with tqdm(total=len(FREED) + 1, unit="fit") as bar:

        def show(done: int, total: int) -> None:
            bar.update(done - bar.n)

        fits = scan_freed_dimensions(progress=show)
    draw(fits).savefig(PICTURE)
    sweeps = {
        label: [LinkageModel(mechanism_from_mapping(load_yaml(config_file(name))[0])).solve(2.0)]
        for label, name in FILES.items()
    }
    draw_mast_and_inertia(sweeps).savefig(PICTURE.with_name("mast_and_inertia.png"))


if __name__ == "__main__":
    main()
