# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the chart of six panels: error against cost, and error against points of a table."""

import io
import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmark.speed import assembled, coupled, peers
from benchmark.speed.chart import (
    CHOSEN,
    CONFIGURATION,
    EXACT,
    FRFS,
    INTERPOLATED,
    LIVE,
    PACKAGE,
    Point,
)
from linkage_vibration.drawing.palette import COLOURS, GREY, INK

BLUE, RED, GREEN, SKY, AMBER = COLOURS
PURPLE = "#AA4499"
STYLES = {
    assembled.FAMILY: (INK, "s"),
    coupled.ALL_MODES: (BLUE, "o"),
    coupled.NO_RESIDUAL: (SKY, "v"),
    coupled.RESIDUAL: (SKY, "^"),
    coupled.FAR_POLES: (BLUE, "D"),
    coupled.REDUCED_MESH: (GREEN, "o"),
    coupled.BATCHED: (AMBER, "o"),
    coupled.AS_WRITTEN: (AMBER, "x"),
    peers.EXUDYN: (RED, "P"),
    peers.SDYNPY_MODES: (PURPLE, "<"),
    peers.SDYNPY_FRF: (PURPLE, ">"),
    peers.PYFBS: (RED, "d"),
    peers.CALCULIX: (GREY, "*"),
    peers.SUBSTRUCTURED: (GREY, "p"),
    EXACT: (INK, "s"),
    PACKAGE: (INK, "*"),
    "linear": (AMBER, "o"),
    "PCHIP": (RED, "v"),
    "cubic": (GREEN, "^"),
    "Hermite": (BLUE, "D"),
    "piecewise Chebyshev": (SKY, "s"),
    "Chebyshev": (PURPLE, "P"),
}
_SIZE = 12  # of text, in points: as large as the text of the page that shows the picture
_ERRORS = (
    "relative error of the worst of modes 1 to 3",
    "relative L2 error, worst configuration",
    "relative error of the worst of modes 1 to 3",
    "relative error of the worst of modes 1 to 3",
    "relative error of frequency or magnitude",
    "relative L2 error, worst angle",
)
_LABELLED = {
    assembled.FAMILY,
    coupled.ALL_MODES,
    coupled.REDUCED_MESH,
    coupled.BATCHED,
    peers.EXUDYN,
    EXACT,
}
TITLES = {
    CONFIGURATION: "Natural frequencies: a configuration",
    FRFS: "Eleven FRFs on 2001 lines: a configuration",
    LIVE: "A live prediction",
    INTERPOLATED[0]: "Tables: natural frequencies",
    INTERPOLATED[1]: "Tables: the FRF's peak",
    INTERPOLATED[2]: "Tables: whole FRFs",
}


def draw(points: Sequence[Point], path: Path) -> None:
    """Write the chart as a PNG."""
    figure = Figure(figsize=(8.0, 38.0), layout="constrained")
    panels = figure.subplots(6, 1)
    for axes, (part, title) in zip(panels.flat, TITLES.items(), strict=True):
        own = [p for p in points if p.part == part and math.isfinite(p.error)]
        _draw_panel(axes, own, part)
        axes.set_title(title, fontsize=14, color=INK, loc="left")
    for axes, label in zip(panels, _ERRORS, strict=True):
        axes.set_ylabel(label, fontsize=_SIZE)
    for axes in panels[:3]:
        axes.set_xlabel("cost, in lookups of the package's table", fontsize=_SIZE)
    for axes in panels[3:]:
        axes.set_xlabel("points of the table, each a solution of the model", fontsize=_SIZE)
    figure.supxlabel(
        "Panels 1 to 3 compare with the same linkage with 96 elements a link, unreduced.\n"
        "The grey line joins the methods that no other beats in both error and cost. Numbers are\n"
        "modes or elements per link, and bars are quartiles. Panels 4 to 6 compare with the model\n"
        "that is tabulated; dashed lines have their points where the error is largest.",
        fontsize=_SIZE,
        color=GREY,
    )
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=100)
    draft = path.with_suffix(".part")
    draft.write_bytes(image.getvalue())
    draft.replace(path)


def _draw_panel(axes: Axes, points: Sequence[Point], part: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    if part not in INTERPOLATED:
        _draw_front(axes, points)
    families = list(dict.fromkeys(p.family for p in points))
    for family in families:
        line = [p for p in points if p.family == family]
        name = family.removesuffix(CHOSEN)
        colour, marker = STYLES[name]
        axes.plot(
            [p.cost.median for p in line],
            [max(p.error, 1e-16) for p in line],
            color=colour,
            marker=marker,
            markersize=8 if marker == "*" else 5,
            markerfacecolor="white" if family.endswith(CHOSEN) else colour,
            linewidth=1.2,
            linestyle="--" if family.endswith(CHOSEN) else "-",
            label=None if family.endswith(CHOSEN) else family,
        )
        axes.hlines(
            [max(p.error, 1e-16) for p in line],
            [p.cost.low for p in line],
            [p.cost.high for p in line],
            color=colour,
            linewidth=0.8,
            alpha=0.6,
        )
        if name == peers.CALCULIX:
            axes.annotate(
                "solid links are another model",
                (line[0].cost.median, line[0].error),
                textcoords="offset points",
                xytext=(-8, -14),
                ha="right",
                fontsize=_SIZE,
                color=colour,
            )
        if family in _LABELLED:
            for p in line:
                axes.annotate(
                    p.setting.split()[0],
                    (p.cost.median, max(p.error, 1e-16)),
                    textcoords="offset points",
                    xytext=(5, 4),
                    fontsize=10,
                    color=colour,
                )
    axes.grid(True, color="#dddddd", linewidth=0.5)
    axes.tick_params(labelsize=_SIZE)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.legend(
        fontsize=_SIZE,
        loc="upper center",
        bbox_to_anchor=(0.45, -0.14),
        frameon=False,
        ncols=2,
        columnspacing=0.8,
    )


def _draw_front(axes: Axes, points: Sequence[Point]) -> None:
    """Join the points that no other beats in both cost and error."""
    front: list[Point] = []
    for point in sorted(points, key=lambda p: p.cost.median):
        if not front or point.error < 0.95 * front[-1].error:  # a difference beyond rounding
            front.append(point)
    axes.plot(
        [p.cost.median for p in front],
        [max(p.error, 1e-16) for p in front],
        drawstyle="steps-post",
        color="#c8c8c8",
        linewidth=5.0,
        solid_capstyle="round",
        zorder=0,
    )
