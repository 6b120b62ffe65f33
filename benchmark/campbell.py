# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the picture of docs/excitation.md: ``python -m benchmark.campbell``.

It shows the natural frequencies over the stroke, and the engine orders over engine speed.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from linkage_vibration.drawing.palette import INK, mode_colours
from linkage_vibration.drawing.plots import tidy
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.support.resources import DEFAULT_TABLE, config_file
from linkage_vibration.table.table import Table, load_table

FloatArray = NDArray[np.float64]

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "campbell.png"
EXCITATIONS = "excitations.yaml"
ENGINE_SPEEDS = np.linspace(700.0, 2200.0, 51)  # rpm
BOTTOM, TOP = 1.0, 250.0  # Hz


def draw(picture: Path) -> None:
    """Draw the picture."""
    table = load_table(config_file(DEFAULT_TABLE))
    figure = Figure(figsize=(9.0, 5.4), dpi=110, layout="constrained")
    stroke, engine = figure.subplots(1, 2, sharey=True)
    over_the_stroke(stroke, table)
    over_engine_speed(engine, table, read_excitations(config_file(EXCITATIONS)))
    for ax in (stroke, engine):
        ax.set(yscale="log", ylim=(BOTTOM, TOP))
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.yaxis.set_major_formatter("{x:g}")
        ax.yaxis.set_minor_locator(NullLocator())
        tidy(ax)
    figure.savefig(picture)


def over_the_stroke(ax: Axes, table: Table) -> None:
    """Draw the natural frequencies over the crank angle."""
    alpha3, frequencies = _swept(table)
    for mode, colour in enumerate(mode_colours(table.n_modes)):
        ax.plot(np.degrees(alpha3), frequencies[:, mode], color=colour, lw=2.0)
        name, middle = table.mode_names[mode], frequencies[len(frequencies) // 2, mode]
        offset = -13 if name == "tractor surge" else 5  # it is just below another mode
        style: dict[str, Any] = {"textcoords": "offset points", "color": colour, "fontsize": 11}
        ax.annotate(name, (95.0, middle), xytext=(0, offset), **style)
    first, last = np.degrees(table.alpha3_range)
    ax.set(
        title="Natural frequencies over the stroke",
        xlabel="crank angle [deg]",
        ylabel="frequency [Hz]",
        xlim=(first, last),
        xticks=np.arange(first, last + 1.0, 15.0),
    )


def over_engine_speed(ax: Axes, table: Table, excitations: Sequence[Excitation]) -> None:
    """Draw the engine's orders over its speed, and the range of each mode over the stroke."""
    _, frequencies = _swept(table)
    for mode, colour in enumerate(mode_colours(table.n_modes)):
        low, high = frequencies[:, mode].min(), frequencies[:, mode].max()
        ax.axhspan(low, high, color=colour, alpha=0.25, lw=0.0)
    for one in excitations:
        if one.source is Source.ENGINE and one.name.startswith("engine"):
            ax.plot(ENGINE_SPEEDS, one.ratio * ENGINE_SPEEDS, color=INK, lw=1.0)
            at = 1500.0
            ax.annotate(
                one.name.split()[-1],
                (at, one.ratio * at),
                ha="center",
                va="center",
                fontsize=10,
                bbox={"boxstyle": "round,pad=0.15", "color": "white"},
            )
    ax.set(
        title="Engine orders, and the range of each mode",
        xlabel="engine speed [rpm]",
        xlim=(ENGINE_SPEEDS[0], ENGINE_SPEEDS[-1]),
    )


def _swept(table: Table) -> tuple[FloatArray, FloatArray]:
    """Return angles over the stroke (rad), and the natural frequencies there (Hz)."""
    alpha3 = np.linspace(*table.alpha3_range, 361)
    return alpha3, table.evaluate(alpha3)[:, : table.n_modes]


if __name__ == "__main__":
    draw(PICTURE)
