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

Curve = tuple[FloatArray, FloatArray]  # angles, rad, and speeds, (n,) each

_ANGLES = 181  # of the heights, between which natural frequencies are nearly straight
_ROWS = 10  # of a printed table
_BEYOND = "beyond the band of the table, or the table is not accurate enough"


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
            if not (order.is_order and order.source in speeds):
                continue
            for mode in np.flatnonzero(levels.excites[i]).tolist():
                curve = _permitted(angles, frequencies[:, mode] / order.ratio, speeds[order.source])
                if len(curve[0]):
                    label = predictor.table.mode_label(mode)
                    found.append(_worst(levels, order, i, label, curve, mass))

    def rank(crossing: Crossing) -> tuple[bool, bool, float]:
        load = -1.0 if math.isnan(crossing.load_ratio) else crossing.load_ratio
        return load <= limit, not crossing.unknown, -load

    first: dict[tuple[str, str], Crossing] = {}
    for each in sorted(found, key=rank):
        first.setdefault((each.order, each.mode), each)
    return list(first.values())


def _permitted(angles: FloatArray, speeds: FloatArray, ends: tuple[float, float]) -> Curve:
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
    levels: LevelTable, order: Excitation, i: int, mode: str, curve: Curve, mass: str
) -> Crossing:
    """Return the point of a curve at which the order i loads most; the first if none is known."""
    (alpha3, speed), source, why = curve, order.source, ""
    every = np.full((len(Source), len(speed)), math.nan)
    every[source.index] = speed
    results = levels.at(alpha3, every)
    loads = results.load_ratios[:, i].astype(float)
    if np.isnan(loads).any():
        beyond = np.isnan(results.velocities[:, i]).any()
        why = _BEYOND if beyond else "there is no static force to compare with"
        why = "no amplitude is given" if order.load is None else why
    at = [int(np.nan_to_num(loads, nan=-1.0).argmax())]
    factors = levels.factor_rows(alpha3[at], every[:, at], math.nan)[0]
    numbers = float(loads[at[0]]), float(factors[len(levels.excites) + i])
    return Crossing(
        order.name, mode, float(alpha3[at[0]]), source, float(speed[at[0]]), *numbers, why, mass
    )


def crossing_table(
    crossings: Sequence[Crossing], speeds: Speeds, ends: tuple[float, float], why: str
) -> tuple[str, list[list[str]], str]:
    """Return title, rows with head, and what is left out; ``why`` a factor is not known."""
    where = "from {:.4g} to {:.4g} deg".format(*np.degrees(ends))
    for source, pair in speeds.items():
        low, high = (speed_words(source, source.si * speed) for speed in pair)
        span = low if low == high else f"{low} to {high}"
        where += f", {source.label} {'speed not known' if math.isnan(pair[0]) else span}"
    if not crossings:
        return f"No order meets a natural frequency {where}.", [], ""
    head = ["order", "mode", "angle [deg]", "speed", "load ratio", "factor", "mass [kg]", "unknown"]
    rows = [head, *map(_cells, crossings[:_ROWS])]
    used = [k for k, (_, *cells) in enumerate(zip(*rows, strict=True)) if any(cells)]
    rest, left = crossings[_ROWS:], list[str]()
    if rest:
        largest = np.fmax.reduce([0.0, *(each.load_ratio for each in rest)])
        left = [f"Of {len(rest)} more, the largest known load ratio is {largest:.2g}."]
        if unknown := sum(bool(each.unknown) for each in rest):
            left.append(f"Those of {unknown} are not or not fully known.")
    if any(math.isnan(each.factor) > math.isnan(each.load_ratio) for each in crossings):
        left.append(f"A factor is not known where {why}.")
    title = f"Where orders meet natural frequencies and load most, {where}:"
    return title, [[row[k] for k in used] for row in rows], " ".join(left)


def _cells(of: Crossing) -> list[str]:
    """Return the cells of a crossing in a table."""
    words = ["not known" if math.isnan(n) else f"{n:.2g}" for n in (of.load_ratio, of.factor)]
    place = f"{math.degrees(of.crank_angle):.4g}", speed_words(of.source, of.source.si * of.speed)
    some = bool(of.unknown) and not math.isnan(of.load_ratio)
    return [of.order, of.mode, *place, *words, of.mass, "at some heights: " * some + of.unknown]


def crossing_text(title: str, rows: Sequence[Sequence[str]], left: str) -> str:
    """Return what `crossing_table` does as lines of text."""
    return "\n".join(filter(None, [f"\n{title}", aligned(rows) if rows else "", left]))
