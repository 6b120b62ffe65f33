# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Describes the Campbell plot of a drive: orders over speed, with the bands of the modes."""

from typing import Any

import numpy as np

from linkage_vibration.drawing import palette
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.review.findings import excitation_of
from linkage_vibration.review.log import Log

_NAMES = {Source.ENGINE: "engine", Source.PTO: "PTO", Source.GROUND: "ground"}


def campbell(log: Log, warnings: list[int]) -> list[dict[str, Any]]:
    """Return a plot for each source whose speed is known; warnings are resonances, drawn as dots.

    It has ``orders``, names with Hz per ``unit`` of speed; ``speeds``, the lowest and the highest;
    ``bands``, colours with the ends of each mode in the drive; ``dots``, speed and Hz.
    """
    bands = []
    for values, colour in zip(
        log.natural_frequencies.T, palette.mode_colours(log.n_modes), strict=True
    ):
        finite = values[np.isfinite(values)]
        ends = [float(finite.min()), float(finite.max())] if len(finite) else None
        bands.append({"colour": colour, "ends": ends})
    plots = []
    for source, (_, speeds) in log.speeds.items():
        orders = [each for each in log.excitations if each.source is source and not each.terrain]
        turning = speeds[np.isfinite(speeds) & (speeds > 0.0)]
        if not orders or not len(turning):
            continue
        at = None if log.drive is None else log.drive.resonances.rows(np.array(warnings, np.int64))
        pairs = [] if at is None else zip(at.excitation, at.excitation_frequency, strict=True)
        met = [(excitation_of(log, name), float(frequency)) for name, frequency in pairs]
        plots.append(
            {
                "title": f"Campbell plot of the drive: orders of {_NAMES[source]}",
                "unit": f"{_NAMES[source]} speed [{source.unit}]",
                "speeds": [float(turning.min()), float(turning.max())],
                "orders": [[order.name, order.ratio] for order in orders],
                "bands": bands,
                "dots": [
                    [frequency / order.ratio, frequency]
                    for order, frequency in met
                    if order is not None and order in orders
                ],
            }
        )
    return plots
