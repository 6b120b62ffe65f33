# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws FRFs: magnitude and phase over frequency."""

from typing import TYPE_CHECKING

import numpy as np

from linkage_vibration.drawing import palette
from linkage_vibration.drawing.plots import PlotError, tidy
from linkage_vibration.mechanics.frf import Frf

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 8  # FRFs in a picture, as many as there are colours


def draw_frf(figure: "Figure", frf: Frf) -> None:
    """Draw each FRF with its error as a band about the magnitude, and below it the phase."""
    pairs = [(i, j) for i in range(len(frf.outputs)) for j in range(len(frf.inputs))]
    if not 0 < len(pairs) <= _MOST:
        raise PlotError(f"{len(pairs)} FRFs cannot be told apart; choose 1 to {_MOST} of them.")
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
