# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws FRFs, and what `sweep` returns: frequencies over one of its numbers, or over the angle."""

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from linkage_vibration.drawing import palette
from linkage_vibration.drawing.plots import PlotError, frequency_axis, name_modes, plain, tidy
from linkage_vibration.mechanics.frf import Frf

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST = 8  # FRFs in a picture, as many as there are colours
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
        problem = f"{len(modes)} modes cannot be distinguished"
        raise PlotError(f"{problem}; `sel` at most {most} of them.")
    along = max(axes, key=lambda name: int(frequencies.sizes[name]))
    others = [name for name in axes if name != along]
    rows = frequencies.transpose(*others, along, "mode").values
    rows = rows.reshape(-1, *rows.shape[-2:])
    if not 0 < len(rows) <= len(_STYLES):
        problem = f"{len(rows)} combinations of {' and '.join(others)} cannot be distinguished"
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


def draw_frf(figure: "Figure", frf: Frf) -> None:
    """Draw each FRF with its error as a band about the magnitude, and below it the phase."""
    pairs = [(i, j) for i in range(len(frf.outputs)) for j in range(len(frf.inputs))]
    if not 0 < len(pairs) <= _MOST:
        raise PlotError(f"{len(pairs)} FRFs cannot be distinguished; choose 1 to {_MOST} of them.")
    upper, lower = figure.subplots(2, sharex=True, height_ratios=[2.0, 1.0])
    mark = "o" if len(frf.frequencies) == 1 else ""
    for (i, j), colour in zip(pairs, palette.mode_colours(len(pairs)), strict=True):
        values = np.where(np.isfinite(frf.values[:, i, j]), frf.values[:, i, j], np.nan)
        size, turn = np.abs(values), np.degrees(np.angle(values))
        size[size == 0.0] = np.nan  # which a logarithmic axis does not have
        # A line down the whole panel would only show that the phase is cut at half a turn.
        turn[np.flatnonzero(np.abs(np.diff(turn)) > 180.0)] = np.nan
        label = f"{'.'.join(frf.outputs[i])} per {'.'.join(frf.inputs[j])}"
        upper.plot(frf.frequencies, size, marker=mark, color=colour, lw=1.6, label=label)
        lower.plot(frf.frequencies, turn, marker=mark, color=colour, lw=1.2)
        if 0.0 < (error := float(frf.error[i])) < 1.0:
            band = size * (1.0 - error), size * (1.0 + error)
            upper.fill_between(frf.frequencies, *band, color=colour, alpha=0.3, lw=0)
    units = sorted({unit for row in frf.units for unit in row})
    upper.set(ylabel=f"magnitude [{' or '.join(units)}]", yscale="log")
    lower.set(xlabel="frequency [Hz]", ylabel="phase [deg]", ylim=(-185.0, 185.0))
    lower.set_yticks([-180, -90, 0, 90, 180])
    upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False)
    for ax in (upper, lower):
        tidy(ax)
