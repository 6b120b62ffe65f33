# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the chart of three panels: error against cost, and error against points of a table."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmark.speed import assembled, coupled, peers
from benchmark.speed.chart import CONFIGURATION, FRFS, INTERPOLATED, PACKAGE, Point
from linkage_vibration.drawing.palette import COLOURS, GREY, INK

BLUE, RED, GREEN, SKY, AMBER = COLOURS
PURPLE = "#AA4499"
_SIZE = 13  # of text, in points: as large as the text of the page that shows the picture
_TABLES = INTERPOLATED[0]
# Of each panel: title, label of the error, and for each line that it shows the text, the colour,
# the marker, the index of the point that has the text, and its distance from there in points.
_Line = tuple[str, str, str, int, tuple[int, int]]
_FRFS_LINES: dict[str, _Line] = {
    coupled.NO_RESIDUAL: ("without\nresidual", SKY, "v", -1, (-33, -24)),
    coupled.FAR_POLES: ("far poles (this package)", BLUE, "D", -1, (-120, -18)),
    coupled.BATCHED: ("LM-FBS,\nbatched", AMBER, "o", 0, (8, -8)),
    peers.SDYNPY_MODES: ("SDynPy,\nmodes", GREY, "<", -1, (8, -4)),
    coupled.AS_WRITTEN: ("LM-FBS,\neq. 19", GREEN, "o", -1, (-58, 2)),
    peers.PYFBS: ("pyFBS", RED, "d", -1, (-18, -16)),
    peers.SDYNPY_FRF: ("SDynPy by FRFs", PURPLE, ">", -1, (8, -14)),
    assembled.FAMILY: ("unreduced, sparse", INK, "s", 3, (22, 4)),
}
_PANELS: dict[str, tuple[str, str, dict[str, _Line]]] = {
    CONFIGURATION: (
        "Natural frequencies at another angle",
        "error of the worst of modes 1 to 3",
        {
            coupled.ALL_MODES: ("null space (this package)", BLUE, "o", -1, (10, -2)),
            coupled.REDUCED_MESH: ("the same,\ncoarser mesh", GREEN, "o", 0, (12, -8)),
            peers.SDYNPY_MODES: ("SDynPy", GREY, "<", 2, (10, -4)),
            assembled.FAMILY: ("unreduced, sparse", INK, "s", 1, (8, 4)),
            peers.EXUDYN: ("Exudyn", RED, "P", -1, (-62, -18)),
        },
    ),
    FRFS: ("Eleven FRFs on 2001 lines at another angle", "relative L2 error", _FRFS_LINES),
    _TABLES: (
        "Tables: natural frequencies between their points",
        "error of the worst of modes 1 to 3",
        {
            "linear": ("linear", AMBER, "o", -1, (8, 0)),
            "PCHIP": ("PCHIP", RED, "v", -1, (8, 0)),
            "cubic": ("cubic", GREEN, "^", -1, (8, 0)),
            "Hermite": ("Hermite", BLUE, "D", -1, (8, 0)),
            "piecewise Chebyshev": ("piecewise\nChebyshev", SKY, "s", -1, (8, -8)),
            "Chebyshev": ("Chebyshev", PURPLE, "P", -1, (8, 0)),
            PACKAGE: ("this package,\nto a tolerance", INK, "*", -1, (-112, -8)),
        },
    ),
}
PARTS = tuple(_PANELS)
_COUNTED = {assembled.FAMILY, coupled.ALL_MODES, coupled.FAR_POLES, peers.EXUDYN}


def draw(points: Sequence[Point], lookup: float, path: Path) -> None:
    """Write the chart as a PNG.

    Parameters
    ----------
    points, lookup, path
        Every method; what one lookup of the package's table takes, s, which costs count in; the
        PNG.
    """
    figure = Figure(figsize=(8.0, 15.0), layout="constrained")
    for axes, (part, (title, label, lines)) in zip(
        figure.subplots(3, 1), _PANELS.items(), strict=True
    ):
        unit = 1.0 if part == _TABLES else 1e3 * lookup
        axes.set_xscale("log")
        axes.set_yscale("log")
        for family, style in lines.items():
            own = [p for p in points if (p.part, p.family) == (part, family)]
            _draw_line(axes, [p for p in own if math.isfinite(p.error)], unit, style)
        axes.margins(x=0.25, y=0.1)
        axes.set_title(title, fontsize=15, color=INK, loc="left")
        axes.set_ylabel(label, fontsize=_SIZE)
        cost = "points of the table, each a solution of the model"
        axes.set_xlabel(cost if part == _TABLES else "processor time [ms]", fontsize=_SIZE)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.grid(True, color="#dddddd", linewidth=0.5)
        axes.tick_params(labelsize=_SIZE)
        axes.spines[["top", "right"]].set_visible(False)
    figure.supxlabel(
        "Numbers: modes of a link, or elements of a link (unreduced, Exudyn).",
        fontsize=_SIZE,
        color=GREY,
    )
    draft = path.with_suffix(".part")
    figure.savefig(draft, format="png", dpi=100)
    draft.replace(path)


def _draw_line(axes: Axes, points: Sequence[Point], unit: float, style: _Line) -> None:
    """Draw one method with its text beside one of its points, if it was measured."""
    if not points:
        return
    text, colour, marker, index, offset = style
    costs = [p.cost.median * unit for p in points]
    errors = [max(p.error, 1e-16) for p in points]
    size = 12 if marker == "*" else 6
    axes.plot(costs, errors, color=colour, marker=marker, markersize=size, linewidth=1.5)
    index = index if index < len(points) else -1
    place: dict[str, Any] = {"textcoords": "offset points", "color": colour}
    axes.annotate(
        text, (costs[index], errors[index]), xytext=offset, fontsize=_SIZE, va="center", **place
    )
    if points[0].family in _COUNTED:
        for p, cost, error in zip(points, costs, errors, strict=True):
            number = p.setting.split()[0]
            # Another line would cross a number on the left of these.
            beside: dict[str, Any] = {"xytext": (-5, -4), "ha": "right"}
            if p.family == peers.EXUDYN or p.part == FRFS:
                beside = {"xytext": (4, 5), "ha": "left"}
            axes.annotate(number, (cost, error), fontsize=10, **beside, **place)
