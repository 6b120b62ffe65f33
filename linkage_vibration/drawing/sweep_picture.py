# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws what `sweep` returns: natural frequencies over one of its numbers, or over the angle."""

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from linkage_vibration.drawing import palette
from linkage_vibration.drawing.plots import PlotError, frequency_axis, name_modes, plain, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLES = "-", "--", ":", "-."


def is_sweep(source: Any) -> bool:
    """Return whether an object is a dataset with natural frequencies; xarray is not imported."""
    return hasattr(source, "data_vars") and "natural_frequencies" in source


def draw_sweep(ax: "Axes", sweep: Any) -> None:
    """Draw natural frequencies over the longest axis, with a style for each value of the others."""
    frequencies, modes = sweep.natural_frequencies, sweep.mode.values
    axes = [name for name in frequencies.dims if name != "mode"]
    if not axes:
        raise PlotError("The dataset has one solution, so there is no axis; `sel` fewer numbers.")
    if len(modes) > (most := len(set(palette.mode_colours(99)))):
        raise PlotError(f"{len(modes)} modes cannot be told apart; `sel` at most {most} of them.")
    along = max(axes, key=lambda name: int(frequencies.sizes[name]))
    others = [name for name in axes if name != along]
    rows = frequencies.transpose(*others, along, "mode").values.reshape(
        -1, frequencies.sizes[along], len(modes)
    )
    if not 0 < len(rows) <= len(_STYLES):
        problem = f"{len(rows)} combinations of {' and '.join(others)} cannot be told apart"
        raise PlotError(f"{problem}; choose at most {len(_STYLES)} of them with `sel`.")
    x, label = sweep[along].values, plain(along)
    if along == "alpha3":
        x, label = np.degrees(x), "crank angle α₃ [deg]"
    combinations = itertools.product(*(sweep[name].values.tolist() for name in others))
    mark = "o" if len(x) == 1 else ""
    for style, row, values in zip(_STYLES, rows, combinations, strict=False):
        for column, colour in zip(row.T, palette.mode_colours(len(modes)), strict=True):
            ax.plot(x, column, marker=mark, ls=style, color=colour, lw=1.7)
        pairs = zip(others, values, strict=True)
        text = ", ".join(
            f"{n} = {np.degrees(v):g} deg" if n == "alpha3" else f"{n} = {v:g}" for n, v in pairs
        )
        ax.plot([], [], ls=style, color=palette.INK, label=plain(text))
    if len(rows) > 1:
        ax.legend(loc="upper left", bbox_to_anchor=(0.0, -0.12), frameon=False)
    frequency_axis(ax, frequencies.values)
    ends = np.array([[np.nan, *each[np.isfinite(each)]][-1] for each in rows[0].T])
    name_modes(ax, ends, [f"mode {mode}" for mode in modes.tolist()])
    ax.set_xlabel(label)
    tidy(ax)
