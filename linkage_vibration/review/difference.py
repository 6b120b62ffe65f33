# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How two logs of the same drive differ, whether the drive or the model made it so."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from linkage_vibration.drawing.intervals import gap_starts
from linkage_vibration.drawing.palette import COLOURS
from linkage_vibration.review.html import Page, thinned, write_page
from linkage_vibration.review.log import Log, ReviewError, read_log
from linkage_vibration.review.review_page import DEG, STATUSES, clock, provenance_rows

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_A, _B = COLOURS[0], COLOURS[1]


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """A quantity in both logs, at the stamps that they share.

    Attributes
    ----------
    key, name, unit : str
        For the page, for people, and of ``factor`` times the values.
    factor : float
        From the logs' unit to that.
    a, b : ndarray, (n,)
        Values, in the logs' unit.
    """

    key: str
    name: str
    unit: str
    factor: float
    a: FloatArray
    b: FloatArray

    @property
    def compared(self) -> int:
        """At how many stamps both have a number."""
        return int(np.isfinite(self.b - self.a).sum())

    @property
    def one_sided(self) -> int:
        """At how many stamps one has a number and the other has none."""
        return int((np.isfinite(self.a) != np.isfinite(self.b)).sum())

    @property
    def farthest(self) -> int | None:
        """Where they are farthest apart; None where nothing can be compared."""
        apart = np.abs(self.b - self.a)
        return int(np.nanargmax(apart)) if np.isfinite(apart).any() else None

    @property
    def largest(self) -> float:
        """B less A there, in the logs' unit; NaN where nothing can be compared."""
        at = self.farthest
        return math.nan if at is None else float(self.b[at] - self.a[at])

    @property
    def largest_relative(self) -> float:
        """The largest of abs(B - A) / abs(A), 1; NaN where nothing can be compared."""
        known = np.isfinite(self.b - self.a) & (self.a != 0.0)
        relative = np.abs(self.b - self.a)[known] / np.abs(self.a[known])
        return float(relative.max()) if len(relative) else math.nan

    @property
    def rms(self) -> float:
        """Root mean square of B less A, in the logs' unit; NaN where nothing can be compared."""
        known = np.isfinite(self.b - self.a)
        return float(np.sqrt(np.mean((self.b - self.a)[known] ** 2))) if known.any() else math.nan


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """Two logs, matched by their stamps.

    Attributes
    ----------
    a, b : Log
        The logs.
    stamps : ndarray of int, (n,)
        Those that both have, ns.
    rows_a, rows_b : ndarray of int, (n,)
        Which predictions of each have them.
    quantities : tuple of Quantity
        All that both have.
    status_changes : int
        At how many stamps the statuses differ.
    """

    a: Log
    b: Log
    stamps: IntArray
    rows_a: IntArray
    rows_b: IntArray
    quantities: tuple[Quantity, ...]
    status_changes: int

    @property
    def times(self) -> FloatArray:
        """Seconds since the first stamp that both have, (n,)."""
        return np.asarray((self.stamps - self.stamps[0]) / 1e9)


def compare(path_a: Path, path_b: Path) -> Difference:
    """Compare two logs of the same drive.

    Raises
    ------
    LinkageVibrationError
        If one cannot be read or holds no prediction, or if they have no stamp in common.
    """
    a, b = read_log(path_a), read_log(path_b)
    stamps, rows_a, rows_b = np.intersect1d(a.stamps, b.stamps, return_indices=True)
    if not len(stamps):
        raise ReviewError(
            f"{path_a} and {path_b} have no stamp in common; give two logs of the same drive, such "
            "as two replays of one bag."
        )
    quantities = [
        Quantity(
            "angle",
            "crank angle",
            "deg",
            DEG,
            _finite(a.crank_angle[rows_a]),
            _finite(b.crank_angle[rows_b]),
        )
    ]
    for mode in range(min(a.n_modes, b.n_modes)):
        of_mode = [x.natural_frequencies[rows, mode] for x, rows in ((a, rows_a), (b, rows_b))]
        quantities.append(Quantity(f"f{mode + 1}", f"mode {mode + 1}", "Hz", 1.0, *of_mode))
    for key, name, unit in (
        ("peak_frequency", "FRF peak's frequency", "Hz"),
        ("peak_magnitude", "FRF peak", "m/N"),
    ):
        quantities.append(
            Quantity(key, name, unit, 1.0, getattr(a, key)[rows_a], getattr(b, key)[rows_b])
        )
    if a.resonances is not None and b.resonances is not None:
        margins = a.resonances.relative_margin[rows_a], b.resonances.relative_margin[rows_b]
        quantities.append(Quantity("margin", "margin to resonance", "%", 100.0, *margins))
    changes = int((a.status[rows_a] != b.status[rows_b]).sum())
    return Difference(a, b, stamps, rows_a, rows_b, tuple(quantities), changes)


def summary(found: Difference) -> str:
    """Return a difference in words and numbers, for a terminal."""
    lines = [
        f"A: {found.a.path}, table {found.a.table_id}",
        f"B: {found.b.path}, table {found.b.table_id}",
        _matched(found),
        f"{'B - A':<24}{'largest':>14}{'at [s]':>12}{'relative':>12}{'rms':>14}  unit",
    ]
    for row in _rows(found):
        name, largest, at, relative, rms, unit = row
        lines.append(f"{name:<24}{largest:>14}{at:>12}{relative:>12}{rms:>14}  {unit}")
    for name in ("mechanism_text", "parameters_text"):
        changed = _changes(getattr(found.a, name), getattr(found.b, name))
        if changed:
            lines += ["", f"{name.split('_')[0]}, A -> B:", *(f"  {line}" for line in changed)]
    return "\n".join(lines)


def write_difference(found: Difference, path: Path) -> None:
    """Write a page of a difference.

    Raises
    ------
    ReviewError
        If it cannot be written.
    """
    write_page(difference_page(found), path)


def difference_page(found: Difference) -> Page:
    """Return what a page shows of a difference."""
    kept = thinned(
        [values for q in found.quantities for values in (q.a, q.b, q.b - q.a)],
        np.array([q.farthest or 0 for q in found.quantities], dtype=np.int64),
    )
    times = found.times
    columns: dict[str, NDArray[Any]] = {"time": times[kept]}
    charts: list[dict[str, Any]] = []
    readings: list[dict[str, Any]] = []
    for q in found.quantities:
        columns[f"a_{q.key}"], columns[f"b_{q.key}"] = q.a[kept], q.b[kept]
        both = [
            {"column": f"a_{q.key}", "factor": q.factor, "colour": _A, "width": 2.4},
            {"column": f"b_{q.key}", "factor": q.factor, "colour": _B, "style": "dashed"},
        ]
        less = {"column": f"b_{q.key}", "minus": f"a_{q.key}", "factor": q.factor}
        title = q.name[0].upper() + q.name[1:]
        key = [{"label": "A", "colour": _A}, {"label": "B", "colour": _B, "style": "dashed"}]
        chart = {"id": q.key, "title": title, "unit": q.unit, "series": both, "key": key}
        charts.append(chart | {"log": q.unit == "m/N"})
        charts.append(
            {
                "id": f"d_{q.key}",
                "title": f"{title}, B \N{MINUS SIGN} A",
                "unit": q.unit,
                "series": [{**less, "colour": "#222222"}],
                "guides": [0.0],
                "height": 90,
            }
        )
        for part, column in (("A", f"a_{q.key}"), ("B", f"b_{q.key}")):
            readings.append(
                {"id": column, "label": f"{title}, {part}", "column": column, "unit": q.unit}
                | {"factor": q.factor, "digits": 8, "colour": _A if part == "A" else _B}
            )
        readings.append(
            {"id": f"d_{q.key}", "label": "B \N{MINUS SIGN} A", "unit": q.unit, "digits": 4, **less}
        )
    for part, log, rows in (("A", found.a, found.rows_a), ("B", found.b, found.rows_b)):
        key_ = f"{part.lower()}_status"
        columns[key_] = log.status[rows][kept].astype(np.uint8)
        readings.append({"id": key_, "label": f"Status, {part}", "column": key_, "words": STATUSES})
    gaps = gap_starts(times) if len(kept) == len(times) else np.empty(0, np.int64)
    content: dict[str, Any] = {
        "charts": charts,
        "overview": {"column": "a_angle", "factor": DEG, "label": "α3"},
        "readings": readings,
        "brief": [f"d_{q.key}" for q in found.quantities[1:3]],
        "tables": [_table(found, kept)],
        "summary": _cards(found),
        "histograms": [],
        "provenance": _provenance(found),
        "shades": [[float(times[i]), float(times[i + 1]), "gap"] for i in gaps],
        "stale_after": 1.0,
        "wide": True,
    }
    return Page(
        title="Two logs of one drive",
        subtitle=f"A: {found.a.path.name}; B: {found.b.path.name}. {_matched(found)}",
        columns=columns,
        start_ns=int(found.stamps[0]),
        breaks=(gaps + 1).tolist(),
        modes=[],
        content=content,
    )


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


def _matched(found: Difference) -> str:
    n = len(found.stamps)
    alone_a, alone_b = len(found.a.stamps) - n, len(found.b.stamps) - n
    told = f"{n} predictions have the same stamps, {alone_a} are in A alone, {alone_b} in B alone"
    return f"{told}; {found.status_changes} differ in status."


def _rows(found: Difference) -> list[list[str]]:
    rows = []
    times = found.times
    for q in found.quantities:
        at = q.farthest
        rows.append(
            [
                q.name,
                f"{q.factor * q.largest:.6g}",
                "" if at is None or q.largest == 0.0 else clock(float(times[at]), float(times[-1])),
                "" if q.unit == "%" else f"{q.largest_relative:.3g}",
                f"{q.factor * q.rms:.6g}",
                q.unit + (f"; {q.one_sided} in one alone" if q.one_sided else ""),
            ]
        )
    return rows


def _table(found: Difference, kept: IntArray) -> dict[str, Any]:
    rows: list[dict[str, Any]] = []
    for q, cells in zip(found.quantities, _rows(found), strict=True):
        at = q.farthest
        row: dict[str, Any] = {"cells": [f"{q.name} [{cells[-1]}]", *cells[1:-1]]}
        if at is not None and q.largest != 0.0:
            index = int(np.searchsorted(kept, at))
            row |= {"time": float(found.times[at]), "index": index, "length": 0.0}
        rows.append(row)
    return {
        "id": "differences",
        "title": "Differences, B \N{MINUS SIGN} A",
        "note": "Choose one to go where it is largest.",
        "head": ["quantity", "largest", "at", "relative to A", "rms"],
        "rows": rows,
    }


def _cards(found: Difference) -> list[dict[str, Any]]:
    cards = []
    for q in found.quantities:
        moved = q.largest not in (0.0,) and not math.isnan(q.largest)
        value = f"{q.factor * q.largest:+.4g} {q.unit}" if moved else "the same"
        if not q.compared:
            value = "cannot be compared"
        cards.append({"label": f"Largest, {q.name}", "value": value, "alert": moved})
    return cards


def _provenance(found: Difference) -> dict[str, Any]:
    a, b = ({key: told for key, told in provenance_rows(log)} for log in (found.a, found.b))
    rows = [["", "A", "B"]]
    rows += [[key, a.get(key, ""), b.get(key, "")] for key in dict.fromkeys([*a, *b])]
    files = []
    for title, name in (("Mechanism", "mechanism_text"), ("Parameters", "parameters_text")):
        changed = _changes(getattr(found.a, name), getattr(found.b, name))
        if changed:
            files.append({"name": f"{title}: what differs, A -> B", "text": "\n".join(changed)})
    return {"title": "What made them", "rows": rows, "files": files}


def _changes(a: str, b: str) -> list[str]:
    """Return the values that differ between two YAML texts, by the paths of their keys."""
    known_a, known_b = (dict(_values(yaml.safe_load(text), "")) for text in (a, b))
    return [
        f"{path}: {known_a.get(path, 'none')} -> {known_b.get(path, 'none')}"
        for path in dict.fromkeys([*known_a, *known_b])
        if known_a.get(path) != known_b.get(path)
    ]


def _values(found: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield each value in nested mappings and lists, with the path of its keys."""
    if isinstance(found, dict | list):
        pairs = found.items() if isinstance(found, dict) else enumerate(found)
        for key, value in pairs:
            yield from _values(value, f"{path}.{key}" if path else str(key))
    else:
        yield path, found
