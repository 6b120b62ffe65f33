# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws a map of the load ratio over height and ground speed, with the advice in it."""

from pathlib import Path

import numpy as np

from linkage_vibration.drawing import palette
from linkage_vibration.drawing.plots import write_png
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.advice import BOTH, HEIGHT, NOW, Advice
from linkage_vibration.prediction.excitation import KMH

_MARKS = {NOW: ("X", "now"), HEIGHT: ("o", "quietest height"), BOTH: ("*", "quietest of all")}


def draw_advice(advice: Advice, limit: float, picture: Path) -> None:
    """Draw a map with the limit of a warning into a PNG file, which is replaced if it exists."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.6), dpi=120, layout="constrained")
    ax = figure.subplots()
    speeds, angles = KMH * advice.ground_speeds, np.degrees(advice.crank_angles)
    ax.set_facecolor(palette.GAP_SHADE)  # where nothing is known
    drawn = ax.pcolormesh(
        _edges(speeds), _edges(angles), advice.load_ratios, cmap="cividis", vmin=0.0
    )
    figure.colorbar(drawn, ax=ax, label="load ratio: vibration over static force")
    if min(advice.load_ratios.shape) > 1 and np.nanmax(advice.load_ratios, initial=0.0) > limit:
        lines = ax.contour(speeds, angles, advice.load_ratios, [limit], colors="white")
        ax.clabel(lines, fmt=f"limit {limit:g}", fontsize=9)
    for place, (mark, label) in _MARKS.items():
        x, y = KMH * advice.message.ground_speeds[place], advice.message.crank_angles[place]
        ax.plot(x, np.degrees(y), mark, color="white", mec=palette.INK, markersize=13, label=label)
    ax.legend(loc="upper left", framealpha=0.9)
    ax.set(xlabel="ground speed [km/h]", ylabel="crank angle α₃ [deg]")
    ax.set_title(advice.message.sentence, loc="left", fontsize=10, wrap=True)
    write_png(figure, picture)


def _edges(values: FloatArray) -> FloatArray:
    """Return the edges of cells around evenly spaced values, (n + 1,)."""
    half = 0.5 * (values[1] - values[0]) if len(values) > 1 else 0.5
    return np.append(values - half, values[-1] + half)
