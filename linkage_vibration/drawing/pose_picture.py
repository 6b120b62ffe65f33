# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws a linkage at one angle, with the names of its pins."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from linkage_vibration.drawing import palette
from linkage_vibration.drawing.geometry import scene
from linkage_vibration.drawing.plots import plain, require_matplotlib, tidy, write_png
from linkage_vibration.mechanics.description import GROUND
from linkage_vibration.mechanics.model import LinkageModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_pose(model: LinkageModel, alpha3: float, picture: Path) -> None:
    """Draw a linkage at a crank angle (rad) into a PNG file, which is replaced if it exists."""
    require_matplotlib()
    from matplotlib.figure import Figure

    wide = model.mechanism.lateral is not None
    figure = Figure(figsize=(13.0 if wide else 8.0, 6.0), dpi=120, layout="constrained")
    ax, *behind = figure.subplots(1, 1 + wide, squeeze=False)[0]
    draw_linkage(ax, model, alpha3)
    for other in behind:
        _draw_from_behind(other, model, alpha3)
    ax.legend(frameon=False, loc="best")
    ax.set_title(f"{plain(model.mechanism.name)} at α₃ = {math.degrees(alpha3):.2f}°", loc="left")
    write_png(figure, picture, bbox_inches="tight")


def draw_linkage(ax: "Axes", model: LinkageModel, alpha3: float) -> None:
    """Draw a linkage at an angle, rad, with the names of its pins, into axes."""
    mechanism, configuration = model.mechanism, model.kinematics.at(alpha3)
    drawn = scene(model, configuration)
    names = [body.name for body in mechanism.bodies]
    for name, colour in zip(names, palette.mode_colours(len(names)), strict=True):
        label = plain(name.replace("_", " "))
        ax.plot(*drawn.bodies[name].T, color=colour, lw=3, label=label, zorder=2)
    ax.plot(*drawn.joints.T, "o", color="white", mec=palette.INK, markersize=7, zorder=3)
    ax.plot(*drawn.ground.T, "^", color=palette.INK, markersize=10, zorder=3)
    for name in (GROUND, *names):
        for point, local in mechanism.local_points(name).items():
            if name == GROUND and point not in dict(mechanism.ground):
                continue  # a mount of the base, far away
            place = configuration.place(name, local)
            x, z = place.tolist()
            ax.annotate(plain(point), (x, z), (6, 6), textcoords="offset points", zorder=4)
    ax.set(xlabel="x, forward [m]", ylabel="z, up [m]", aspect="equal")
    tidy(ax)


def _draw_from_behind(ax: "Axes", model: LinkageModel, alpha3: float) -> None:
    """Draw both sides of a linkage with a lateral half at an angle, rad, as seen from behind."""
    mechanism, configuration = model.mechanism, model.kinematics.at(alpha3)
    assert mechanism.lateral is not None
    y, both = dict(mechanism.lateral.y), np.array([[-1.0, 1.0]])
    rigid = {body.name for body in mechanism.rigid_bodies}
    names = [body.name for body in mechanism.bodies]
    for name, colour in zip(names, palette.mode_colours(len(names)), strict=True):
        points = mechanism.local_points(name).items()
        left = np.array([(y.get(p, 0.0), configuration.place(name, at)[1]) for p, at in points])
        right = left * both
        outlines = [np.vstack([left, right[::-1], left[:1]])] if name in rigid else [left, right]
        for outline in outlines:
            ax.plot(*outline.T, "o-", color=colour, lw=3, mfc="white", mec=palette.INK, zorder=2)
    for chain in mechanism.lateral.chains:
        link = next(link for link in mechanism.links if link.name == chain.link)
        (first, (begin, _)), (_, aside, z) = link.points[0], chain.end
        at = y.get(first, 0.0) + link.slope * (chain.at - begin)
        left = np.array([(at, configuration.place(link.name, (chain.at, 0.0))[1]), (aside, z)])
        for line in (left, left * both):
            ax.plot(*line.T, ":", color=palette.INK, lw=2, zorder=3)
    ax.set(xlabel="y, to the left [m]", ylabel="z, up [m]", aspect="equal")
    ax.invert_xaxis()
    ax.set_title("from behind; chains are dotted", loc="left")
    tidy(ax)
