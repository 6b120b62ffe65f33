# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares two logs of the same drive, which two models or two versions may have made."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, IntArray
from linkage_vibration.prediction.verdict import Drive, above_and_below
from linkage_vibration.review.log import Log, ReviewError
from linkage_vibration.review.review_page import DEG, clock
from linkage_vibration.support.resources import command

_SAME_ANGLE = math.radians(2.0)  # largest difference of the crank angles of one moment in two logs
_MOST_APART = 0.05  # largest share of the moments with a larger difference
_LEAST_MATCHED = 0.5  # of the shorter log, by a difference of the clocks
_SMALL = 0.1  # of the largest value of a quantity; a change of less is not judged by the value


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """A quantity in two logs A and B, at the n moments that both logs have."""

    name: str
    unit: str  # in which it is shown
    a: FloatArray  # (n,), values in log A
    b: FloatArray  # (n,), values in log B
    known_a: BoolArray  # (n,): the whole of it is known in log A
    known_b: BoolArray  # (n,): in log B

    @property
    def change(self) -> FloatArray:
        """B less A, (n,), in the unit of the logs; NaN where one of both has no number."""
        return np.asarray(self.b - self.a)

    @property
    def one_sided(self) -> int:
        """Number of moments at which only one log knows the whole of it."""
        return int((self.known_a != self.known_b).sum())

    @property
    def farthest(self) -> int | None:
        """Index of the largest difference; None if nothing can be compared."""
        size = np.abs(self.change)
        return int(np.nanargmax(size)) if np.isfinite(size).any() else None

    @property
    def largest(self) -> float:
        """B less A where they differ most, or NaN."""
        return math.nan if self.farthest is None else float(self.change[self.farthest])

    @property
    def largest_relative(self) -> float:
        """The largest of abs(B - A) / abs(A), or NaN."""
        size = np.where(self.a != 0.0, np.abs(self.a), math.nan)
        return float(np.fmax.reduce(np.abs(self.change) / size, initial=math.nan))

    def beyond(self, tolerance: float) -> BoolArray:
        """Return where B differs from A by more than a share, (n,), or only one has a number."""
        size = np.abs(np.where(np.isfinite(self.a), self.a, 0.0))
        allowed = tolerance * np.maximum(size, _SMALL * size.max(initial=0.0))
        one_sided = (self.known_a != self.known_b) | (np.isfinite(self.a) != np.isfinite(self.b))
        return np.asarray((np.abs(self.change) > allowed) | one_sided)


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """Two logs A and B, whose predictions are matched by their place in the drive."""

    a: Log
    b: Log
    rows_a: IntArray  # (n,), indices of the predictions at the moments of both logs, in log A
    rows_b: IntArray  # (n,), the same in log B
    angle: Quantity
    frequencies: tuple[Quantity, ...]  # of the modes that both logs have
    others: tuple[Quantity, ...]  # the FRF peak, and last the load ratio
    offset: int  # ns, by which the stamps of B are later than those of A
    apart: int  # number of moments that were left out, as their crank angles differ too much
    unmatched_modes: tuple[str, ...]  # labels of the modes that only one log has

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """All quantities."""
        return (self.angle, *self.frequencies, *self.others)

    @property
    def other_status(self) -> BoolArray:
        """At which moments the statuses differ, (n,)."""
        return np.asarray(self.a.status[self.rows_a] != self.b.status[self.rows_b])

    @property
    def sides(self) -> tuple[tuple[str, Log, IntArray], tuple[str, Log, IntArray]]:
        """The name of each log, the log, and the rows of its predictions."""
        return ("A", self.a, self.rows_a), ("B", self.b, self.rows_b)

    def clock(self, moment: int) -> str:
        """Return the time of a moment since the first one that both logs have."""
        times = self.a.times[self.rows_a]
        return clock(float(times[moment] - times[0]), float(times[-1] - times[0]))


def compare(a: Log, b: Log) -> Difference:
    """Compare two logs of the same drive; a `ReviewError` says what they do not have in common."""
    modes, unmatched = _same_modes(a, b)
    offset, rows_a, rows_b = _same_moments(a, b)
    differences = _angle_differences(a.crank_angle[rows_a], b.crank_angle[rows_b])
    same = ~(differences > _SAME_ANGLE)
    if (~same).mean() > _MOST_APART:
        farthest = int(np.nanargmax(differences))
        where = f"{DEG * differences[farthest]:.3g} deg at {a.times[rows_a[farthest]]:.2f} s of A"
        raise ReviewError(
            f"{a.path} and {b.path} are not of one drive, or of one calibration of its angle: of "
            f"{len(same)} moments that match best, {int((~same).sum())} have crank angles more "
            f"than {DEG * _SAME_ANGLE:g} deg apart, up to {where}; give two logs of one drive, "
            "such as two replays of one bag with the same offset, or show each log by "
            f"`{command('review')}`."
        )
    rows_a, rows_b = rows_a[same], rows_b[same]

    def quantity(name: str, unit: str, x: FloatArray, y: FloatArray) -> Quantity:
        x, y = (np.where(np.isfinite(each), each, math.nan) for each in (x[rows_a], y[rows_b]))
        return Quantity(name, unit, x, y, np.isfinite(x), np.isfinite(y))

    frequencies = []
    for mode, other in modes:
        name = a.mode_label(mode) + (f", {other + 1} in B" if other != mode else "")
        values = a.natural_frequencies[:, mode], b.natural_frequencies[:, other]
        frequencies.append(quantity(name, "Hz", *values))
    angle = quantity("crank angle", "deg", a.crank_angle, b.crank_angle)
    others = (
        quantity("FRF peak frequency", "Hz", a.peak_frequency, b.peak_frequency),
        quantity("FRF peak", "m/N", a.peak_magnitude, b.peak_magnitude),
        _load_ratio(a.drive, rows_a, b.drive, rows_b),
    )
    compared, apart = (angle, tuple(frequencies), others), int((~same).sum())
    return Difference(a, b, rows_a, rows_b, *compared, offset, apart, unmatched)


def _same_modes(a: Log, b: Log) -> tuple[list[tuple[int, int]], tuple[str, ...]]:
    """Return pairs of modes, from 0, with one name (or one number), and the labels of others."""
    if a.table_id == b.table_id:
        return [(mode, mode) for mode in range(a.n_modes)], ()
    if a.table is None or b.table is None:
        which = " and ".join(str(log.path) for log in (a, b) if log.table is None)
        raise ReviewError(
            f"The logs are of two tables, and {which} does not hold its own, so that its modes "
            "have no names by which they can be compared; make the log again with "
            f"`{command('replay')}`."
        )
    numbers = a.table.mechanism_name == b.table.mechanism_name
    ours, theirs = (
        {name: i for i, name in enumerate(names) if numbers or name != f"mode {i + 1}"}
        for names in (a.table.mode_names, b.table.mode_names)
    )
    pairs = [(mode, theirs[name]) for name, mode in ours.items() if name in theirs]
    if not pairs:
        raise ReviewError(
            "The logs are of two linkages without a mode of the same name: "
            f"{a.path} has {', '.join(a.table.mode_names)}, and {b.path} has "
            f"{', '.join(b.table.mode_names)}; give logs of one linkage, name its modes by "
            f"`mode_names` in its mechanism, or show each log by `{command('review')}`."
        )
    return pairs, tuple(
        f"{log.mode_label(mode)} of {side}"
        for log, side, known in zip((a, b), "AB", zip(*pairs, strict=True), strict=True)
        for mode in range(log.n_modes)
        if mode not in known
    )


def _same_moments(a: Log, b: Log) -> tuple[int, IntArray, IntArray]:
    """Return by how much the stamps of B are later, ns, and the rows of moments in A and in B.

    Clocks that differ are tried with the beginnings and the ends of the logs at one moment, and
    with the angles that both have. Equal angles count twice, those that differ little once.
    """
    _, first, second = np.intersect1d(a.crank_angle, b.crank_angle, return_indices=True)
    later = np.sort(b.stamps[second] - a.stamps[first])
    tried = [0, int(b.stamps[0] - a.stamps[0]), int(b.stamps[-1] - a.stamps[-1])]
    tried += [int(later[len(later) // 2])] if len(later) else []
    found = [(offset, *_rows_of_same_stamps(a.stamps, b.stamps - offset)) for offset in tried]
    least = _LEAST_MATCHED * min(len(a.stamps), len(b.stamps))
    found = [each for each in found if not each[0] or len(each[1]) >= least]

    def alike(match: tuple[int, IntArray, IntArray]) -> int:
        angles = a.crank_angle[match[1]], b.crank_angle[match[2]]
        differences, equal = _angle_differences(*angles), np.isnan(angles).all(axis=0)
        equal |= differences == 0.0
        return int(equal.sum() + (equal | (differences <= _SAME_ANGLE)).sum())

    best = max(found, key=lambda match: (alike(match), len(match[1])))  # the first of several
    if not len(best[1]):
        raise ReviewError(
            f"{a.path} and {b.path} have no moment in common: they have no equal stamps, and no "
            "difference between their clocks brings half of them together; give two logs of one "
            "drive, such as two replays of one bag."
        )
    return best


def _angle_differences(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return by how much angles, (n,), differ apart from whole turns, rad; NaN if unknown."""
    with np.errstate(invalid="ignore"):  # inf - inf, of readings that are infinite
        return np.asarray(np.abs((b - a + math.pi) % math.tau - math.pi))


def _rows_of_same_stamps(a: IntArray, b: IntArray) -> tuple[IntArray, IntArray]:
    """Return rows of equal stamps in A and B, in the order of A; repeated ones match in turn."""
    _, distinct = np.unique(np.concatenate([a, b]), return_inverse=True)

    def keys(stamps: IntArray) -> IntArray:
        order = np.argsort(stamps, kind="stable")
        earlier = np.empty(len(stamps), np.int64)
        earlier[order] = np.arange(len(stamps)) - np.searchsorted(stamps[order], stamps[order])
        return stamps * len(distinct) + earlier

    both = keys(distinct[: len(a)]), keys(distinct[len(a) :])
    _, rows_a, rows_b = np.intersect1d(*both, assume_unique=True, return_indices=True)
    order = np.argsort(rows_a)
    return rows_a[order], rows_b[order]


def _load_ratio(a: Drive | None, rows_a: IntArray, b: Drive | None, rows_b: IntArray) -> Quantity:
    """Return the load ratios at predictions, where both logs know those of the same sources."""
    ratios_a, known_a, parts_a = _load_of(a, rows_a)
    ratios_b, known_b, parts_b = _load_of(b, rows_b)
    same = known_a & known_b  # a total without a source is no lower total
    if a is not None and b is not None and a.names == b.names:
        same |= (parts_a == parts_b).all(axis=1)
    ratios_a, ratios_b = (np.where(same, each, math.nan) for each in (ratios_a, ratios_b))
    return Quantity("load ratio", "1", ratios_a, ratios_b, known_a, known_b)


def _load_of(drive: Drive | None, rows: IntArray) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Return the latest load ratios, (n,), if all of each is known, and its parts, (n, k)."""
    if drive is None:
        never = np.zeros(len(rows), np.bool_)
        return np.full(len(rows), math.nan), never, never[:, np.newaxis]
    order = np.argsort(drive.predictions, kind="stable")
    latest = np.searchsorted(drive.predictions[order], rows, side="right") - 1
    at, there = order[np.maximum(latest, 0)], latest >= 0
    ratios = np.where(there, drive.resonances.total_load_ratio[at].astype(float), math.nan)
    known = there & np.logical_or(*above_and_below(drive))[at]
    parts = np.isfinite(drive.resonances.load_ratios[at]) & there[:, np.newaxis]
    return np.where(np.isfinite(ratios), ratios, math.nan), known, parts


def problems(delta: Difference, tolerance: float = 0.0) -> list[str]:
    """Return a sentence that says that the logs differ, if they do; see `Quantity.beyond`."""
    counts = {len(delta.rows_a), len(delta.a.stamps), len(delta.b.stamps)}
    same = len(counts) == 1 and not delta.other_status.any() and not delta.unmatched_modes
    same &= (delta.a.drive is None) == (delta.b.drive is None)
    same &= any(each.farthest is not None for each in delta.frequencies)
    if same and not any(each.beyond(tolerance).any() for each in delta.quantities):
        return []
    return ["The logs differ."]


def sentence(delta: Difference) -> str:
    """Return in one sentence what differs most, and by how much."""
    changed = [each for each in delta.frequencies if abs(each.largest) > 0.0]
    if all(each.farthest is None for each in delta.frequencies):
        return "Nothing can be compared, as the logs know no natural frequency at one moment."
    text = "The logs have equal predictions"
    if changed:
        most = max(changed, key=lambda each: each.largest_relative)
        at, change = most.farthest or 0, most.largest
        text = f"{most.name[0].upper()}{most.name[1:]} differs most: in B it is {abs(change):.3g} "
        text += f"{most.unit} ({100.0 * abs(change / most.a[at]):.2g} %) "
        text += f"{'higher' if change > 0.0 else 'lower'} at {delta.clock(at)} s"
    elif problems(delta):
        text = "The natural frequencies are equal; the logs differ in other quantities or in status"
    largest, shares, load = list[str](), list[str](), delta.others[-1]
    for (part, log, rows), known in zip(delta.sides, (load.known_a, load.known_b), strict=True):
        ratios = np.empty(0) if log.resonances is None else log.resonances.total_load_ratio[rows]
        finite = ratios[np.isfinite(ratios)]
        largest.append(f"{finite.max():.2g}" if len(finite) else "not known")
        if share := 1.0 - known.mean():
            shares.append(f"{100.0 * share:.3g} % of the moments in {part}")
    if problems(delta) and set(largest) != {"not known"}:
        text += f"; the largest load ratio is {largest[0]} in A and {largest[1]} in B"
    if shares:
        text += f"; not all loads are known at {' and '.join(shares)}"
    return f"{text}."


def difference_summary(delta: Difference) -> str:
    """Return a difference as a text for a terminal."""
    lines = [f"{part}: {log.path}, table {log.table_id}" for part, log, _ in delta.sides]
    lines += [_matched(delta), sentence(delta)]
    rows = [["B - A", "largest", "at [s]", "relative", "not known", "unit"]]
    for each in delta.quantities:
        shown = (DEG if each.unit == "deg" else 1.0) * each.largest
        pair = f"{shown:.6g}", f"{each.largest_relative:.3g}"
        at = "" if each.farthest is None or not each.largest else delta.clock(each.farthest)
        largest, relative = (text.replace("nan", "") for text in pair)
        unknown = 1.0 - float((each.known_a & each.known_b).mean())
        unit = each.unit + (f"; {each.one_sided} in one log only" if each.one_sided else "")
        rows.append([each.name, largest, at, relative, f"{100.0 * unknown:.3g} %", unit])
    for name, *numbers, unit in rows:
        cells = zip(numbers, (14, 12, 12, 12), strict=True)
        lines.append(f"{name:<30}{''.join(f'{text:>{n}}' for text, n in cells)}  {unit}")
    for part in ("mechanism", "parameters"):
        if changed := _changes(*(getattr(log, f"{part}_text") for _, log, _ in delta.sides)):
            lines += ["", f"{part}, A -> B:", *(f"  {line}" for line in changed)]
    return "\n".join(lines)


def _matched(delta: Difference) -> str:
    """Return how many moments both logs have, and what is not compared, in sentences."""
    n = len(delta.rows_a)
    only_a, only_b = (len(log.stamps) - n - delta.apart for _, log, _ in delta.sides)
    later = f"{1e-9 * abs(delta.offset):.9g} s {'later' if delta.offset > 0 else 'earlier'}"
    clocks = f", with the clock of B {later}, as the crank angles show" if delta.offset else ""
    text = f"{n} moments are in both logs{clocks}; {only_a} are only in A, {only_b} are only in B; "
    text += f"{int(delta.other_status.sum())} differ in status."
    if delta.apart:
        text += f" {delta.apart} more have crank angles above {DEG * _SAME_ANGLE:g} deg apart, and "
        text += "are not compared."
    if delta.unmatched_modes:
        text += f" These modes are in one log only: {', '.join(delta.unmatched_modes)}."
    return text


def _changes(*texts: str) -> Sequence[str]:
    """Return the values that differ between two YAML texts, by the paths of their keys."""
    a, b = (dict(_values(yaml.safe_load(text), "")) for text in texts)
    return [
        f"{path}: {a.get(path, 'absent')} -> {b.get(path, 'absent')}"
        for path in a | b
        if a.get(path) != b.get(path)
    ]


def _values(content: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield each value in nested mappings and lists, with the path of its keys."""
    if isinstance(content, dict | list):
        pairs = content.items() if isinstance(content, dict) else enumerate(content)
        for key, value in pairs:
            yield from _values(value, f"{path}.{key}" if path else str(key))
    else:
        yield path, content
