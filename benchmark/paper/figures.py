# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws counterparts of the paper's figures 3 to 9."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmark.paper.numbers import OVER_THE_SWEEP, SUBSTRUCTURING, printed_numbers
from linkage_vibration.drawing.geometry import curves, largest, mode_curves
from linkage_vibration.drawing.palette import COLOURS, GREY, INK
from linkage_vibration.drawing.plots import tidy, write_png
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.model import Solution
from linkage_vibration.studies.pose import pin_places

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Sweeps = Mapping[str, Sequence[Solution]]
"""Solutions over the stroke by the name of the geometry; the most plausible one comes first."""

_COLOURS = (*COLOURS[:3], COLOURS[4])
_BODIES = ("lower_link", "upper_link", "lift_rod", "implement")
_ANGLES_DEG = (90.0, 140.0, 180.0)
_LINES: FloatArray = np.linspace(0.5, 200.0, 1996)  # Hz
_SWING = 0.16  # m, the largest displacement that is drawn
CRANK = "crank angle $α_3$ [deg]"
_MOVING = ("V1", "V2", "E1", "E2")


def draw_figures(output: Path, sweeps: Sweeps) -> None:
    """Write all figures of two geometries into a folder, and replace those that it has."""
    label = next(iter(sweeps))
    model = sweeps[label][0].model
    chosen = [model.solve(math.radians(angle)) for angle in _ANGLES_DEG]
    drawings: dict[str, Callable[[], Figure]] = {
        "fig3_configurations.png": lambda: _configurations(chosen, label),
        "fig4_link_angles.png": lambda: _link_angles(sweeps[label], label),
        "fig5_drive_point_frf.png": lambda: _drive_point_frf(chosen, label),
        "fig6_natural_frequencies.png": lambda: _natural_frequencies(sweeps),
        "fig7_mode_1.png": lambda: _mode_shapes(chosen, 0, label),
        "fig8_mode_2.png": lambda: _mode_shapes(chosen, 1, label),
        "fig9_mode_3.png": lambda: _mode_shapes(chosen, 2, label),
    }
    for name, draw in drawings.items():
        write_png(draw(), output / name)


def titled_figure(title: str, note: str, size: tuple[float, float]) -> "Figure":
    """Return a figure with a title and a note above its axes; the size is in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=110, layout="constrained")
    height = size[1]
    figure.get_layout_engine().set(rect=(0.0, 0.0, 1.0, 1.0 - 0.62 / height))  # type: ignore[call-arg, union-attr]
    figure.text(0.01, 1.0 - 0.18 / height, title, fontsize=12, fontweight="bold", va="center")
    figure.text(0.01, 1.0 - 0.42 / height, note, fontsize=9, color=GREY, va="center")
    return figure


def stroke_axis(ax: "Axes", **labels: str) -> None:
    """Let an axis show the stroke."""
    tidy(ax)
    ax.set(xlim=(90.0, 180.0), xticks=range(90, 181, 15), **labels)


def _draw_bodies(ax: "Axes", solution: Solution, mode: int, scale: float, **style: Any) -> None:
    """Draw every body, moved by a mode times a scale."""
    moved = mode_curves(solution, mode)
    for body, places in curves(solution.model, solution.configuration).items():
        ax.plot(*(places + scale * moved[body]).T, **style)


def _draw_mode(
    ax: "Axes", solution: Solution, mode: int, scales: Mapping[str, float], linewidth: float
) -> None:
    """Draw the linkage at rest, and moved by a mode times a scale for each colour."""
    _draw_bodies(ax, solution, mode, 0.0, color=GREY, linestyle="--", linewidth=1)
    points = _points(solution)
    shapes = solution.participation([(point, d) for point in _MOVING for d in "xz"])[:, mode]
    for colour, scale in scales.items():
        _draw_bodies(ax, solution, mode, scale, color=colour, linewidth=linewidth)
        at = np.array([points[point] for point in _MOVING]) + scale * shapes.reshape(-1, 2)
        ax.plot(*at.T, "o", markersize=4.5, color=colour, zorder=5)
    _frame(ax, solution)


def _points(solution: Solution) -> dict[str, FloatArray]:
    """Return the places of the named points and of the centre of gravity M."""
    mechanism, configuration = solution.model.mechanism, solution.configuration
    rigid = mechanism.rigid_bodies[0]
    centre = configuration.place(rigid.name, rigid.centre_of_gravity)
    return {**pin_places(mechanism, configuration), "M": centre}


_NAMES = {  # at these offsets from their points, in points of text
    **{"P1": (-4, -14), "P2": (-17, -3), "P3": (7, 2), "V1": (4, -13)},
    **{"V2": (-4, 8), "E1": (-8, -15), "E2": (-14, 7), "M": (-4, 9)},
}


def _frame(ax: "Axes", solution: Solution) -> None:
    """Draw the ground pins, and set the frame that all configurations share."""
    for _, place in solution.model.mechanism.ground:
        ax.plot(*place, marker="^", markersize=8, color=INK, zorder=6)
    ax.set(aspect="equal", xlim=(-2.1, 0.2), ylim=(-0.75, 0.95), xlabel="x [m]")
    tidy(ax)


def label_place(
    ax: "Axes", text: str, at: tuple[float, float], offset: tuple[int, int], **style: Any
) -> None:
    """Write text beside a place, at an offset in points of text."""
    ax.annotate(text, at, xytext=offset, textcoords="offset points", **style)


def add_legend(figure: "Figure", ax: "Axes", columns: int) -> None:
    """Add the legend of an axis at the bottom of the figure, and leave its height free of axes.

    Matplotlib does so by itself since 3.7, with "outside lower center".
    """
    handles = ax.get_legend_handles_labels()
    legend = figure.legend(*handles, loc="lower center", frameon=False, ncols=columns)
    top = legend.get_window_extent().y1 / figure.bbox.height
    layout: Any = figure.get_layout_engine()
    left, bottom, width, height = layout.get()["rect"]
    layout.set(rect=(left, top, width, bottom + height - top))


def _configurations(solutions: Sequence[Solution], label: str) -> "Figure":
    note = f"{label}; the tractor is to the right, M is the implement's centre of gravity"
    figure = titled_figure("Three configurations of the linkage (figure 3)", note, (10, 3.9))
    axes = figure.subplots(1, 3, sharey=True)
    for ax, solution, angle in zip(axes, solutions, _ANGLES_DEG, strict=True):
        bodies = curves(solution.model, solution.configuration).items()
        for (body, places), colour in zip(bodies, (*_COLOURS, GREY), strict=True):
            width = 1.5 if body == "implement" else 3
            ax.plot(*places.T, color=colour, linewidth=width, label=body.replace("_", " "))
        points = _points(solution)
        for name, (x, z) in points.items():
            label_place(
                ax, name, (float(x), float(z)), _NAMES[name], fontsize=8, color=INK, zorder=7
            )
        _frame(ax, solution)
        at = np.array([points[name] for name in (*_MOVING, "M")])
        ax.plot(*at.T, "o", markersize=4.5, color=INK, zorder=5)
        ax.set_title(f"$α_3$ = {angle:g} deg", fontsize=10)
    axes[0].set_ylabel("z [m]")
    add_legend(figure, axes[0], 5)
    return figure


def _link_angles(solutions: Sequence[Solution], label: str) -> "Figure":
    figure = titled_figure("Angles of the links over the stroke (figure 4)", label, (8, 4.6))
    ax = figure.subplots()
    alpha3 = _degrees(solutions)
    for body, name, colour in zip(_BODIES, ("α_1", "α_2", "α_4", "α_5"), _COLOURS, strict=True):
        angles = np.degrees([s.configuration.angle(body) for s in solutions])
        ax.plot(alpha3, angles, color=colour, linewidth=2)
        text, at = f"${name}$, {body.replace('_', ' ')}", (alpha3[-1], angles[-1])
        label_place(ax, text, at, (6, 0), va="center", color=colour, annotation_clip=False)
    stroke_axis(ax, xlabel=CRANK, ylabel="angle from x towards z [deg]")
    return figure


def _drive_point_frf(solutions: Sequence[Solution], label: str) -> "Figure":
    note = f"{label}; damping is assumed, the paper prints none"
    figure = titled_figure("Drive-point FRF of E1 along z (figure 5)", note, (8, 5.6))
    magnitude, phase = figure.subplots(2, sharex=True, height_ratios=[2.4, 1])
    styles = zip((_COLOURS[0], _COLOURS[2], _COLOURS[1]), ("-", "--", "-"), strict=True)
    for solution, angle, (colour, style) in zip(solutions, _ANGLES_DEG, styles, strict=True):
        frf = solution.drive_point.frf(_LINES)[:, 0, 0]
        about = {"color": colour, "linestyle": style, "linewidth": 1.6}
        magnitude.semilogy(_LINES, np.abs(frf), label=f"$α_3$ = {angle:g} deg", **about)
        phase.plot(_LINES, np.degrees(np.angle(frf)), **about)
    magnitude.set_ylabel("receptance [m/N]")
    magnitude.legend(frameon=False)
    phase.set(xlabel="frequency [Hz]", xlim=(0, 200))
    phase.set(ylabel="phase [deg]", yticks=[-180, -90, 0], ylim=(-190, 10))
    for ax in (magnitude, phase):
        tidy(ax)
    return figure


def _natural_frequencies(sweeps: Sweeps) -> "Figure":
    note = "both geometries with the same sections; markers and band: what the paper prints"
    figure = titled_figure(
        "First three natural frequencies over the stroke (figure 6)", note, (8, 8)
    )
    axes = figure.subplots(3, sharex=True)
    over = [number.value for number in printed_numbers(OVER_THE_SWEEP)]
    for row, ax in enumerate(axes[::-1]):
        for solutions, style in styled(sweeps):
            curve = [solution.natural_frequencies[row] for solution in solutions]
            ax.plot(_degrees(solutions), curve, **style)
        at = {140.0: printed_numbers(SUBSTRUCTURING)[row].value}
        ends = over[2 * row], over[2 * row + 1]
        if row < 2:
            at |= {90.0: ends[0], 180.0: ends[1]}
        else:
            ax.axhspan(*ends, color="#F9E08B", alpha=0.6, lw=0, zorder=0)
            ax.annotate("the paper's interval", (91, ends[0] + 1.5), fontsize=8, color=GREY)
        markers = {"color": INK, "clip_on": False, "zorder": 6, "label": "the paper"}
        ax.plot(list(at), list(at.values()), "D", **markers)
        stroke_axis(ax, ylabel=f"mode {row + 1} [Hz]")
    axes[2].set_xlabel(CRANK)
    add_legend(figure, axes[0], 3)
    return figure


def _mode_shapes(solutions: Sequence[Solution], mode: int, label: str) -> "Figure":
    title = f"Mode {mode + 1} in three configurations (figure {7 + mode})"
    note = f"{label}; dashed: at rest; colours: extremes, magnified; dots: V1, V2, E1, E2"
    figure = titled_figure(title, note, (10, 3.7))
    axes = figure.subplots(1, 3, sharey=True)
    for ax, solution, angle in zip(axes, solutions, _ANGLES_DEG, strict=True):
        scale = _scale(solution, mode)
        _draw_mode(ax, solution, mode, {_COLOURS[0]: scale, _COLOURS[1]: -scale}, 1.8)
        frequency = solution.natural_frequencies[mode]
        ax.set_title(f"$α_3$ = {angle:g} deg: {frequency:.1f} Hz", fontsize=10)
    axes[0].set_ylabel("z [m]")
    return figure


def _scale(solution: Solution, mode: int) -> float:
    """Return the scale of a mode at which its largest displacement is `_SWING`, with E1 upwards."""
    up = float(solution.participation([("E1", "z")])[0, mode])
    return math.copysign(_SWING / largest(mode_curves(solution, mode)), up)


def styled(sweeps: Sweeps) -> Iterator[tuple[Sequence[Solution], dict[str, Any]]]:
    """Yield the solutions of each geometry, with the style of its curves."""
    styles = zip(_COLOURS, ("-", "--"), strict=False)
    for (label, solutions), (colour, line) in zip(sweeps.items(), styles, strict=False):
        yield solutions, {"color": colour, "linestyle": line, "linewidth": 2, "label": label}


def _degrees(solutions: Sequence[Solution]) -> FloatArray:
    return np.degrees([solution.configuration.alpha3 for solution in solutions])
