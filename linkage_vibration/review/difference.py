# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares two logs of the same drive, which two models or two versions may have made."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.review.log import Log, ReviewError, read_log
from linkage_vibration.review.review_page import DEG, clock


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """A quantity in two logs A and B, at the stamps that both logs have."""

    key: str  # such as "f1" of mode 1
    name: str  # for people
    unit: str  # in which it is shown
    factor: float  # shown value over value in the log
    a: FloatArray  # (n,), values in log A
    b: FloatArray  # (n,), values in log B

    @property
    def title(self) -> str:
        """The name, with a capital letter."""
        return self.name[0].upper() + self.name[1:]

    @property
    def change(self) -> FloatArray:
        """B less A, (n,), in the unit of the logs; NaN where one of both has no number."""
        change = self.b - self.a
        return np.where(np.isfinite(change), change, math.nan)

    @property
    def one_sided(self) -> int:
        """Number of stamps at which only one log has a number."""
        return int((np.isfinite(self.a) != np.isfinite(self.b)).sum())

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

    @property
    def rms(self) -> float:
        """Root mean square of B less A, or NaN."""
        change = self.change[np.isfinite(self.change)]
        return float(np.sqrt(np.mean(change**2))) if len(change) else math.nan

    @property
    def differs(self) -> bool:
        """Whether the logs have different numbers."""
        return abs(self.largest) > 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """Two logs A and B, whose predictions are matched by their stamps."""

    a: Log
    b: Log
    stamps: IntArray  # (n,), ns, that both logs have, in the order of log A
    rows_a: IntArray  # (n,), indices of the predictions with these stamps in log A
    rows_b: IntArray  # (n,), the same in log B
    quantities: tuple[Quantity, ...]  # that both logs have
    status_changes: int  # number of stamps at which the statuses differ

    @property
    def sides(self) -> tuple[tuple[str, Log, IntArray], tuple[str, Log, IntArray]]:
        """The name of each log, the log, and the rows of its predictions."""
        return ("A", self.a, self.rows_a), ("B", self.b, self.rows_b)

    @property
    def times(self) -> FloatArray:
        """Seconds since the first stamp that both logs have, (n,), as in `Log.times` of A."""
        times = self.a.times[self.rows_a]
        return np.asarray(times - times[0])


def compare(path_a: Path, path_b: Path) -> Difference:
    """Compare two logs of the same drive.

    A `BagError` is raised if one cannot be read, and a `ReviewError` if a log holds no prediction,
    or if the logs have no stamp in common.
    """
    a, b = read_log(path_a), read_log(path_b)
    rows_a, rows_b = _rows_of_same_stamps(a.stamps, b.stamps)
    if not len(rows_a):
        raise ReviewError(
            f"{path_a} and {path_b} have no stamp in common; give two logs of the same drive, such "
            "as two replays of one bag."
        )
    values_a, values_b = _quantities(a, rows_a), _quantities(b, rows_b)
    pairs = [(key, values_a[key], values_b[key][-1]) for key in values_a if key in values_b]
    changes = int((a.status[rows_a] != b.status[rows_b]).sum())
    quantities = tuple(Quantity(key, *first, second) for key, first, second in pairs)
    return Difference(a, b, a.stamps[rows_a], rows_a, rows_b, quantities, changes)


def difference_summary(delta: Difference) -> str:
    """Return a difference as a text for a terminal."""
    lines = [
        *(f"{part}: {log.path}, table {log.table_id}" for part, log, _ in delta.sides),
        _matched(delta),
        sentence(delta),
        f"{'B - A':<30}{'largest':>14}{'at [s]':>12}{'relative':>12}{'rms':>14}  unit",
    ]
    for name, largest, at, relative, rms, unit in _rows(delta):
        lines.append(f"{name:<30}{largest:>14}{at:>12}{relative:>12}{rms:>14}  {unit}")
    for name, changed in _changed_files(delta).items():
        lines += ["", f"{name}, A -> B:", *(f"  {line}" for line in changed)]
    return "\n".join(lines)


def sentence(delta: Difference) -> str:
    """Return in one sentence what differs most, and by how much."""
    compared = [q for q in delta.quantities if q.key[0] == "f" and q.differs]
    if not problems(delta):
        return "The logs have equal predictions."
    if not compared:
        others = "the logs differ in other quantities or in status"
        return f"The natural frequencies are equal; {others}{_loads(delta)}."
    most = max(compared, key=lambda q: q.largest_relative)
    at = most.farthest or 0
    change, times = most.largest, delta.times
    text = (
        f"{most.title} differs most: in B it is {abs(change):.3g} "
        f"{most.unit} ({100.0 * abs(change / most.a[at]):.2g} %) "
        f"{'higher' if change > 0.0 else 'lower'} at {clock(float(times[at]), float(times[-1]))} s"
    )
    return f"{text}{_loads(delta)}."


def _loads(delta: Difference) -> str:
    """Return the largest load ratios of both logs, in words; empty if neither is known."""
    texts = []
    for _, log, rows in delta.sides:
        ratios = np.empty(0) if log.resonances is None else log.resonances.total_load_ratio[rows]
        finite = ratios[np.isfinite(ratios)]
        texts.append(f"{finite.max():.2g}" if len(finite) else "not known")
    if set(texts) == {"not known"}:
        return ""
    return f"; the largest load ratio is {texts[0]} in A and {texts[1]} in B"


def problems(delta: Difference) -> list[str]:
    """Return a sentence that says that the logs differ, if they do."""
    n = len(delta.stamps)
    same = len(delta.a.stamps) == len(delta.b.stamps) == n and not delta.status_changes
    same &= (delta.a.resonances is None) == (delta.b.resonances is None)
    if same and not any(q.differs or q.one_sided for q in delta.quantities):
        return []
    return ["The logs differ."]


def _rows_of_same_stamps(a: IntArray, b: IntArray) -> tuple[IntArray, IntArray]:
    """Return the rows of equal stamps in A and in B, in the order of A.

    Of messages with the same stamp, the first of A matches the first of B, and so on.
    """
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


def _quantities(log: Log, rows: IntArray) -> dict[str, tuple[str, str, float, FloatArray]]:
    """Return the name, the unit, the factor and the values of each quantity of a log."""
    angles = np.where(np.isfinite(log.crank_angle), log.crank_angle, np.nan)
    quantities = {"angle": ("crank angle", "deg", DEG, angles[rows])}
    for mode, values in enumerate(log.natural_frequencies[rows].T):
        quantities[f"f{mode + 1}"] = (log.mode_label(mode), "Hz", 1.0, values)
    quantities["peak_frequency"] = ("FRF peak frequency", "Hz", 1.0, log.peak_frequency[rows])
    quantities["peak_magnitude"] = ("FRF peak", "m/N", 1.0, log.peak_magnitude[rows])
    if log.resonances is not None:
        ratios = log.resonances.total_load_ratio[rows].astype(float)
        quantities["load"] = ("load ratio", "1", 1.0, ratios)
    return quantities


def _matched(delta: Difference) -> str:
    n = len(delta.stamps)
    only_a, only_b = len(delta.a.stamps) - n, len(delta.b.stamps) - n
    return (
        f"{n} predictions have the same stamps, {only_a} are only in A, {only_b} are only in B; "
        f"{delta.status_changes} differ in status."
    )


def _rows(delta: Difference) -> list[list[str]]:
    """Return name, largest difference, its time and relative size, rms and unit, as texts."""
    times = delta.times
    return [
        [
            q.name,
            _digits(q.factor * q.largest, 6),
            clock(float(times[q.farthest]), float(times[-1])) if q.differs else "",
            "" if q.unit == "%" else _digits(q.largest_relative, 3),
            _digits(q.factor * q.rms, 6),
            q.unit + (f"; {q.one_sided} in one log only" if q.one_sided else ""),
        ]
        for q in delta.quantities
    ]


def _digits(value: float, count: int) -> str:
    """Return a number with a count of digits; empty if nothing can be compared."""
    return "" if math.isnan(value) else f"{value:.{count}g}"


def _changed_files(delta: Difference) -> dict[str, list[str]]:
    """Return the changed values of the mechanism and of the parameters; none if none changed."""
    changes = {
        "mechanism": _changes(delta.a.mechanism_text, delta.b.mechanism_text),
        "parameters": _changes(delta.a.parameters_text, delta.b.parameters_text),
    }
    return {name: changed for name, changed in changes.items() if changed}


def _changes(*texts: str) -> list[str]:
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
