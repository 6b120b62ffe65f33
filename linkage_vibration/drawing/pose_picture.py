# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws a linkage at one angle with the names of its pins, at rest or in the shape of a mode."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from linkage_vibration.drawing import palette
from linkage_vibration.drawing.geometry import (
    Curves,
    largest,
    left_curves,
    mode_curves,
    scene,
    size,
)
from linkage_vibration.drawing.plots import plain, tidy
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import GROUND
from linkage_vibration.mechanics.mode_names import kinetic_energy, name_modes
from linkage_vibration.mechanics.model import LinkageModel, ModeShape, Solution
from linkage_vibration.mechanics.modes import MECHANISM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_SHARE = 0.08  # of the size of the linkage: the largest displacement of a shape


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """The displacements of a linkage in a shape as they are drawn, m."""

    curves: Curves  # (n, 2), along x and z
    points: dict[str, FloatArray]  # (3,), along x, y and z, on the left
    mirrored: FloatArray  # (3,), factors of those on the right
    scale: float  # m per 1/sqrt(kg)


def pose_figure(model: LinkageModel, alpha3: float) -> "Figure":
    """Draw a linkage at a crank angle, rad, and beside it from behind if that is described."""
    figure, [panel] = _panels(model, alpha3, 1)
    title = f"{plain(model.mechanism.name)} at α₃ = {math.degrees(alpha3):.2f}°"
    _draw_views(panel, model, alpha3, title)
    return _with_legend(figure)


def shapes_figure(shapes: Sequence[ModeShape]) -> "Figure":
    """Draw shapes of modes of one solution, each over the linkage at rest, which is dashed."""
    solution = shapes[0].solution
    model, alpha3, side = solution.model, solution.configuration.alpha3, ""
    if model.half == "lateral":
        side = "; left side"
        model = LinkageModel(model.mechanism, kinematics=model.kinematics)
    figure, panels = _panels(model, alpha3, len(shapes))
    modes = lowest_modes(solution)
    named = name_modes(kinetic_energy(solution, np.array(modes)))
    names = dict(zip(modes, named, strict=True))
    for panel, shape in zip(panels, shapes, strict=True):
        moved, frequency = _moved(shape, model), solution.modes.omega[shape.mode] / (2.0 * math.pi)
        title = (
            f"mode {shape.mode + 1} at α₃ = {math.degrees(alpha3):.2f}°: {frequency:.2f} Hz"
            f"{plain(', ' + names[shape.mode]) if shape.mode in names else ''}{side}\n"
            f"0.1 m of displacement in the picture is {0.1 / moved.scale:.2g} / √kg"
        )
        _draw_views(panel, model, alpha3, title, moved)
    return _with_legend(figure)


def lowest_modes(solution: Solution) -> list[int]:
    """Return the indices of the lowest elastic modes, as many as a table of the linkage has."""
    elastic = np.flatnonzero(solution.modes.omega >= MECHANISM)
    return [int(mode) for mode in elastic[: solution.model.mechanism.response.modes]]


def _at_rest(model: LinkageModel, alpha3: float) -> Curves:
    """Return the curves of the links and the rigid bodies without the base, m."""
    bodies = scene(model, model.kinematics.at(alpha3)).bodies
    return {body.name: bodies[body.name] for body in model.mechanism.bodies}


def _panels(model: LinkageModel, alpha3: float, count: int) -> tuple["Figure", list["SubFigure"]]:
    """Return a figure, and parts of it with room for the views of a linkage."""
    from matplotlib.figure import Figure

    wide = model.mechanism.lateral is not None
    columns = 1 if wide else min(count, 2)
    rows = -(-count // columns)
    length, height = np.ptp(np.vstack(list(_at_rest(model, alpha3).values())), axis=0)
    high = 5.0 if wide else 2.0 + 7.0 * max(0.3, float(height / max(length, height)))
    inches = (13.0 if wide else 8.0) * columns, high * rows
    figure = Figure(figsize=inches, dpi=120)
    figure.set_layout_engine("constrained", h_pad=0.12)
    ratios = [inches[1] - 0.5, 0.5]  # The names of the bodies are below.
    upper = figure.subfigures(2, 1, squeeze=False, height_ratios=ratios)[0, 0]
    return figure, list(upper.subfigures(rows, columns, squeeze=False).flat)[:count]


def _with_legend(figure: "Figure") -> "Figure":
    """Return a figure with the names of the bodies below all of its parts."""
    handles = figure.axes[0].get_legend_handles_labels()
    figure.subfigs[-1].legend(*handles, loc="center", ncol=5, frameon=False)
    return figure


def _moved(shape: ModeShape, vertical: LinkageModel) -> Moved:
    """Return the displacements of a shape, scaled so that the largest is easily seen."""
    solution, mode, mechanism = shape.solution, shape.mode, vertical.mechanism
    lateral, directions = solution.model.half == "lateral", solution.model.interface.directions
    curves = left_curves(solution, mode, vertical) if lateral else mode_curves(solution, mode)
    moving = mechanism.moving_points
    places = [(point, direction) for point in moving for direction in directions]
    points = {point: np.zeros(3) for point in (*moving, *mechanism.local_points(GROUND))}
    for (point, along), value in zip(places, solution.participation(places)[:, mode], strict=True):
        points[point]["xyz".index(along)] = value
    rest = _at_rest(vertical, solution.configuration.alpha3)
    drawn = [points[point] for name in rest for point in mechanism.local_points(name)]
    longest = max(float(np.linalg.norm(drawn, axis=1).max()), largest({n: curves[n] for n in rest}))
    scale = _SHARE * size(rest) / longest
    curves = {name: scale * curve for name, curve in curves.items()}
    mirrored = np.array([-1.0, 1.0, -1.0] if lateral else [1.0, -1.0, 1.0])
    return Moved(curves, {name: scale * each for name, each in points.items()}, mirrored, scale)


def _draw_views(
    panel: "SubFigure", model: LinkageModel, alpha3: float, title: str, moved: Moved | None = None
) -> None:
    """Draw a linkage from the left, and beside it from behind if that is described."""
    ax, *behind = panel.subplots(1, 1 + (model.mechanism.lateral is not None), squeeze=False)[0]
    draw_linkage(ax, model, alpha3, moved)
    ax.set_title(title, loc="left")
    for other in behind:
        _draw_from_behind(other, model, alpha3, moved)


def draw_linkage(
    ax: "Axes", model: LinkageModel, alpha3: float, moved: Moved | None = None
) -> None:
    """Draw a linkage at an angle, rad, with the names of its pins; below a shape it is dashed."""
    mechanism, configuration = model.mechanism, model.kinematics.at(alpha3)
    drawn = scene(model, configuration)
    names = [body.name for body in mechanism.bodies]
    for name, colour in zip(names, palette.mode_colours(len(names)), strict=True):
        label, curve = plain(name.replace("_", " ")), drawn.bodies[name]
        if moved:
            ax.plot(*curve.T, "--", color=palette.GREY, lw=1, zorder=1)
            curve = curve + moved.curves[name]
        ax.plot(*curve.T, color=colour, lw=3, label=label, zorder=2)
    pins = np.vstack([drawn.joints, drawn.ground])
    if moved:
        pins = pins + [moved.points[name][::2] for name in drawn.names]
    joints, ground = np.split(pins, [len(drawn.joints)])
    ax.plot(*joints.T, "o", color="white", mec=palette.INK, markersize=7, zorder=3)
    ax.plot(*ground.T, "^", color=palette.INK, markersize=10, zorder=3)
    for name in (GROUND, *names):
        for point, local in mechanism.local_points(name).items():
            if name == GROUND and point not in dict(mechanism.ground):
                continue  # a mount of the base, far away
            place = configuration.place(name, local)
            x, z = place + moved.points[point][::2] if moved else place
            ax.annotate(plain(point), (x, z), (6, 6), textcoords="offset points", zorder=4)
    ax.margins(0.1)
    ax.set(xlabel="x, forward [m]", ylabel="z, up [m]", aspect="equal")
    tidy(ax)


def _draw_from_behind(ax: "Axes", model: LinkageModel, alpha3: float, moved: Moved | None) -> None:
    """Draw both sides of a linkage with a lateral half at an angle, rad, as seen from behind."""
    mechanism, configuration = model.mechanism, model.kinematics.at(alpha3)
    assert mechanism.lateral is not None
    y, both = dict(mechanism.lateral.y), np.array([[-1.0, 1.0]])
    rigid = {body.name for body in mechanism.rigid_bodies}
    names = [body.name for body in mechanism.bodies]
    for name, colour in zip(names, palette.mode_colours(len(names)), strict=True):
        points = mechanism.local_points(name)
        left = np.array(
            [(y.get(p, 0.0), configuration.place(name, at)[1]) for p, at in points.items()]
        )
        sides = [left, left * both]
        if moved:
            for side in _outlines(sides, name in rigid):
                ax.plot(*side.T, "--", color=palette.GREY, lw=1, zorder=1)
            by = np.array([moved.points[p] for p in points])
            sides = [left + by[:, 1:], left * both + (by * moved.mirrored)[:, 1:]]
        for side in _outlines(sides, name in rigid):
            ax.plot(*side.T, "o-", color=colour, lw=3, mfc="white", mec=palette.INK, zorder=2)
    for chain in () if moved else mechanism.lateral.chains:
        link = next(link for link in mechanism.links if link.name == chain.link)
        (first, (begin, _)), (_, aside, z) = link.points[0], chain.end
        at = y[first] + link.slope * (chain.at - begin)
        left = np.array([(at, configuration.place(link.name, (chain.at, 0.0))[1]), (aside, z)])
        for line in (left, left * both):
            ax.plot(*line.T, ":", color=palette.INK, lw=2, zorder=3)
    ax.set(xlabel="y, to the left [m]", ylabel="z, up [m]", aspect="equal")
    ax.invert_xaxis()
    ax.set_title("from behind" + ("" if moved else "; chains are dotted"), loc="left")
    tidy(ax)


def _outlines(sides: Sequence[FloatArray], rigid: bool) -> list[FloatArray]:
    """Return the lines, (n, 2), of a body on the left and the right; one around a rigid body."""
    left, right = sides
    return [np.vstack([left, right[::-1], left[:1]])] if rigid else [left, right]
