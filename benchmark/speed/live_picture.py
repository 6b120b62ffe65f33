# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws a chart of docs/performance.md: error of one live prediction against its time."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from benchmark.speed import assembled, peers
from benchmark.speed.chart import CONFIGURATION, EXACT, LIVE, PACKAGE, Point
from benchmark.speed.timing import Spread
from linkage_vibration.drawing.palette import COLOURS, GREY, INK

BLUE, RED, GREEN, _, AMBER = COLOURS
PURPLE = "#AA4499"
_PERIOD = 1e-3  # s, between two readings at 1 kHz


@dataclass(frozen=True, slots=True)
class _Label:
    """One method at one setting, as the chart shows it.

    Attributes
    ----------
    part, family, setting : str
        The `Point`; the package's own table has the setting of its default tolerance.
    text : str
        The text beside the point.
    colour : str
        Colour of point and text.
    offset : tuple of float
        Distance from the point to the text, in points of 1/72 inch.
    """

    part: str
    family: str
    setting: str
    text: str
    colour: str
    offset: tuple[float, float] = (9.0, 0.0)


# Tables of about as many solutions as the package's own has with its default tolerance.
_TABLES = {
    "linear": (9.0, 0.0),
    "PCHIP": (9.0, 0.0),
    "cubic": (9.0, 4.0),
    "piecewise Chebyshev": (9.0, -5.0),
    "Hermite": (9.0, 0.0),
    "Chebyshev": (9.0, 4.0),
}
_LABELS = (
    *(_Label(LIVE, name, "23 points", name, AMBER, offset) for name, offset in _TABLES.items()),
    _Label(LIVE, EXACT, "3 modes", "solved each time, 3 modes a link", BLUE),
    _Label(LIVE, EXACT, "20 modes", "solved each time, 20 modes a link", BLUE, (9.0, -4.0)),
    _Label(CONFIGURATION, peers.SDYNPY_MODES, "10 modes", "SDynPy, 10 modes a link", PURPLE),
    _Label(CONFIGURATION, assembled.FAMILY, "8 elements", "unreduced, sparse, 8 elements", GREEN),
    _Label(CONFIGURATION, peers.EXUDYN, "16 elements", "Exudyn, 16 elements", RED, (9.0, -6.0)),
)


def draw_live(points: Sequence[Point], lookup: Spread, path: Path) -> None:
    """Write the chart as a PNG.

    Parameters
    ----------
    points : sequence of Point
        Of `LIVE` and `CONFIGURATION`; a method without a point is left out.
    lookup : Spread
        What one lookup of the package's table takes, s, which the costs of the points count in.
    path : Path
        Of the PNG.
    """
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    axes = figure.subplots()
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.axvline(_PERIOD, color=GREY, linewidth=1.0, linestyle="--", zorder=0)
    axes.annotate(
        "1 ms: readings\nat 1 kHz",
        (_PERIOD, 0.035),
        xytext=(5, 0),
        textcoords="offset points",
        fontsize=12,
        color=GREY,
        va="top",
    )
    axes.annotate("tables of 23 angles:", (1.4e-6, 8e-3), fontsize=12, color=AMBER)
    for label in _LABELS:
        _draw_point(axes, points, lookup.median, label)
    _draw_own_table(axes, points, lookup.median)
    axes.set_xlim(0.8e-6, 4.0)
    axes.set_ylim(3e-7, 5e-2)
    axes.set_xticks([1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0])
    axes.xaxis.set_major_formatter(FuncFormatter(lambda seconds, _: _time(seconds)))
    axes.set_xlabel("processor time of one prediction", fontsize=13)
    axes.set_ylabel("relative error of modes 1 to 3", fontsize=12)
    axes.set_title(
        "A live prediction: lower is more accurate, left is faster",
        fontsize=13,
        color=INK,
        loc="left",
    )
    axes.grid(True, color="#dddddd", linewidth=0.5)
    axes.tick_params(labelsize=12)
    axes.spines[["top", "right"]].set_visible(False)
    draft = path.with_suffix(".part")
    figure.savefig(draft, format="png", dpi=120)
    draft.replace(path)


def _draw_point(axes: Axes, points: Sequence[Point], unit: float, label: _Label) -> None:
    """Draw one method with its text beside it, if it was measured."""
    result = [
        p
        for p in points
        if (p.part, p.family) == (label.part, label.family)
        and p.setting.startswith(label.setting)
        and p.error > 0.0
    ]
    if not result:
        return
    place = (result[0].cost.median * unit, result[0].error)
    axes.plot(*place, "o", color=label.colour, markersize=7)
    axes.annotate(
        label.text,
        place,
        xytext=label.offset,
        textcoords="offset points",
        ha="left" if label.offset[0] else "center",
        va="center",
        fontsize=12,
        color=label.colour,
    )


def _draw_own_table(axes: Axes, points: Sequence[Point], unit: float) -> None:
    """Draw this package's table to its default tolerance, the second of those measured."""
    own = [p for p in points if (p.part, p.family) == (LIVE, PACKAGE)]
    point = sorted(own, key=lambda p: -p.error)[min(1, len(own) - 1)]
    place = (point.cost.median * unit, point.error)
    axes.plot(*place, "*", color=INK, markersize=18)
    axes.annotate(
        f"this package:\n{1e6 * place[0]:.2g} \N{MICRO SIGN}s, error {place[1]:.0e}".replace(
            "e-0", "e-"
        ),
        place,
        xytext=(-14, -34),
        textcoords="offset points",
        va="center",
        fontsize=13,
        fontweight="bold",
        color=INK,
    )


def _time(seconds: float) -> str:
    """Return a time with the unit in which it is a small whole number."""
    for unit, name in ((1.0, "s"), (1e-3, "ms"), (1e-6, "\N{MICRO SIGN}s")):
        if seconds >= 0.999 * unit:
            return f"{seconds / unit:.0f} {name}"
    return ""
