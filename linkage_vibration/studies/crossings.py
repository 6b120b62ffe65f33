# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Crossings: at which heights and speeds orders meet natural frequencies, and how they load."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import predict_many
from linkage_vibration.prediction.severity import speed_words
from linkage_vibration.prediction.worst_levels import implement_mass
from linkage_vibration.studies.pose import aligned

Speeds = Mapping[Source, tuple[float, float]]
"""The lowest and the highest speed of each source, rpm or m/s; the same twice for a fixed one."""

_ANGLES = 181  # of the heights, between which natural frequencies are nearly straight
_ROWS = 10  # of a printed table


@dataclass(frozen=True, slots=True)
class Crossing:
    """Where an order meets a mode at permitted heights and speeds, and loads most by itself."""

    order: str
    mode: str  # such as "mode 4 (implement heave)"
    crank_angle: float  # rad
    source: Source
    speed: float  # rpm or m/s
    load_ratio: float  # NaN if it is known at none of the heights
    factor: float  # exp of the standard deviation of its logarithm, as in ``Levels.msg``
    unknown: str  # why the load is not known at all of the heights; empty if it is
    mass: str  # of the implement, kg, if there are several; else empty


def find_crossings(
    every: Sequence[LevelTable],
    excitations: Sequence[Excitation],
    ends: tuple[float, float],
    speeds: Speeds,
    limit: float,
) -> list[Crossing]:
    """Return the crossing of each order with each mode that it can excite, by their load ratios.

    Loads that are not known come after those above the limit, before those below it. Of several
    levels, with other masses of the implement, the worst crossing counts. Ends are angles, rad.
    """
    angles, found = np.linspace(*ends, _ANGLES), list[Crossing]()
    for levels in every:
        predictor, mass = levels.predictor, implement_mass(levels) if len(every) > 1 else ""
        frequencies = predict_many(predictor, angles, np.zeros(_ANGLES)).natural_frequencies
        for i, order in enumerate(excitations):
            if order.terrain or order.source not in speeds:
                continue
            for mode in np.flatnonzero(levels.excites[i]).tolist():
                needed = frequencies[:, mode] / order.ratio
                alpha3, speed = _permitted(angles, needed, speeds[order.source])
                if len(alpha3):
                    at, load, factor, why = _worst(levels, order, i, alpha3, speed)
                    place = float(alpha3[at]), order.source, float(speed[at])
                    label = predictor.table.mode_label(mode)
                    found.append(Crossing(order.name, label, *place, load, factor, why, mass))

    def rank(crossing: Crossing) -> tuple[bool, bool, float]:
        load = -1.0 if math.isnan(crossing.load_ratio) else crossing.load_ratio
        return load <= limit, not crossing.unknown, -load

    first: dict[tuple[str, str], Crossing] = {}
    for each in sorted(found, key=rank):
        first.setdefault((each.order, each.mode), each)
    return list(first.values())


def _permitted(
    angles: FloatArray, speeds: FloatArray, ends: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Return the angles and speeds of a curve, (n,), between two speeds, and those at its ends."""
    inside = (ends[0] <= speeds) & (speeds <= ends[1])
    at, of = [angles[inside]], [speeds[inside]]
    for end in {*ends}:
        apart = speeds - end  # NaN where a mode is overdamped
        i = np.flatnonzero(apart[:-1] * apart[1:] < 0.0)
        at.append(angles[i] + apart[i] / (apart[i] - apart[i + 1]) * (angles[i + 1] - angles[i]))
        of.append(np.full(len(i), end))
    return np.concatenate(at), np.concatenate(of)


def _worst(
    levels: LevelTable, order: Excitation, i: int, alpha3: FloatArray, speed: FloatArray
) -> tuple[int, float, float, str]:
    """Return where the order i loads most, its load and factor there, and why some are unknown."""
    every = np.full((len(Source), len(speed)), math.nan)
    every[order.source.index] = speed
    results, why = levels.at(alpha3, every), ""
    loads = results.load_ratios[:, i].astype(float)
    if (lost := np.isnan(loads)).any():
        why = "no amplitude is given"
        if order.load is not None:
            beyond = np.isnan(results.velocities[:, i]).any()
            why = "beyond the band of the table, or the table is not accurate enough"
            why = why if beyond else "there is no static force to compare with"
    at = int(np.where(lost, -1.0, loads).argmax())
    factors = levels.factor_rows(alpha3[[at]], every[:, [at]], math.nan)[0]
    return at, float(loads[at]), float(factors[len(levels.excites) + i]), why


def crossing_table(
    crossings: Sequence[Crossing], speeds: Speeds, ends: tuple[float, float]
) -> tuple[str, list[list[str]], str]:
    """Return the title of a table of crossings, its rows with the head, and what is left out.

    Speeds and ends are those of `find_crossings`.
    """
    where = "from {:.4g} to {:.4g} deg".format(*np.degrees(ends))
    for source, pair in speeds.items():
        low, high = (speed_words(source, source.si * speed) for speed in pair)
        span = low if low == high else f"{low} to {high}"
        where += f", {source.label} {'speed not known' if math.isnan(pair[0]) else span}"
    if not crossings:
        return f"No order meets a natural frequency {where}.", [], ""
    head = ["order", "mode", "angle [deg]", "speed", "load ratio", "factor", "mass [kg]", "unknown"]
    rows = [head, *(_cells(each) for each in crossings[:_ROWS])]
    used = [k for k, (_, *cells) in enumerate(zip(*rows, strict=True)) if any(cells)]
    left, text = crossings[_ROWS:], ""
    if left:
        largest = np.fmax.reduce([0.0, *(each.load_ratio for each in left)])
        text = f"Of {len(left)} more, the largest known load ratio is {largest:.2g}"
        unknown = sum(bool(each.unknown) for each in left)
        text += f"; those of {unknown} are not or not fully known." if unknown else "."
    title = f"Where orders meet natural frequencies and load most, {where}:"
    return title, [[row[k] for k in used] for row in rows], text


def _cells(crossing: Crossing) -> list[str]:
    """Return the cells of a crossing in a table."""
    load, factor = (
        "not known" if math.isnan(value) else f"{value:.2g}"
        for value in (crossing.load_ratio, crossing.factor)
    )
    speed = speed_words(crossing.source, crossing.source.si * crossing.speed)
    some = "" if math.isnan(crossing.load_ratio) else "at some heights: "
    why = some * bool(crossing.unknown) + crossing.unknown
    angle = f"{math.degrees(crossing.crank_angle):.4g}"
    return [crossing.order, crossing.mode, angle, speed, load, factor, crossing.mass, why]


def crossing_text(title: str, rows: Sequence[Sequence[str]], left: str) -> str:
    """Return what `crossing_table` does as lines of text."""
    return "\n".join(filter(None, [f"\n{title}", aligned(rows) if rows else "", left]))
