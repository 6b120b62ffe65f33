# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Makes one HTML page, that needs nothing else, of columns and of what to draw of them."""

import base64
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import linkage_vibration
from linkage_vibration.review.log import ReviewError
from linkage_vibration.support.atomic_files import write_text

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MAX_SAMPLES = 400_000
"""Of a page; it has 50 MB then at most, with three modes."""

COVERAGE = 2.0  # standard deviations to each side, of a band of uncertainty

_FOLDER = Path(__file__).parent / "page"
_SCRIPTS = (
    *("data", "decimation", "state", "words", "elements", "axes", "shades", "pointer", "charts"),
    *("receptance", "waterfall", "overlays", "excitations", "angle_chart", "linkage", "readout"),
    *("modes", "tables", "histograms", "provenance", "rows", "strip", "layout", "controls"),
    "start",
)  # the parts of the page's script, each of which may use the parts before it


@dataclass(frozen=True, slots=True)
class Page:
    """What a page shows.

    Attributes
    ----------
    title, subtitle : str
        Its heading.
    columns : mapping of str to ndarray, (n,)
        Quantities: float64 or float32, as they are to be kept, or uint8. ``time`` (s) ascends.
    start_ns : int
        Stamp at time 0, ns.
    breaks : sequence of int
        Samples before which some are missing.
    modes : sequence of str
        Colours of the modes whose columns are ``f1``, ``f2`` and on.
    content : mapping
        The rest, in the words of the scripts in ``page``: ``charts``, ``overview``, ``readings``,
        ``tables``, ``summary``, ``histograms``, ``provenance``, ``shades``, and where they are known
        ``excitations``, ``frf`` and ``linkage``.
    """

    title: str
    subtitle: str
    columns: Mapping[str, NDArray[Any]]
    start_ns: int
    breaks: Sequence[int]
    modes: Sequence[str]
    content: Mapping[str, Any]


def page_html(page: Page) -> str:
    """Return a page as text."""
    data = {
        "columns": {name: _column(values) for name, values in page.columns.items()},
        "n": len(page.columns["time"]),
        "start_ms": page.start_ns / 1e6,
        "breaks": [int(i) for i in page.breaks],
        "modes": list(page.modes),
        "coverage": COVERAGE,
        "subtitle": page.subtitle,
        **page.content,
    }
    told = {
        "title": html.escape(page.title),
        "version": linkage_vibration.__version__,
        "uplot_css": _file("uPlot.min.css"),
        "css": _file("page.css"),
        # No text of a log may end the script that holds it.
        "data": json.dumps(data, allow_nan=False).replace("<", "\\u003c"),
        "uplot_js": f"/*{_file('uPlot.LICENSE.txt')}*/\n{_file('uPlot.iife.min.js')}",
        "js": _script(),
    }
    parts = _file("page.html").split("{{")
    made = [parts[0]]
    for part in parts[1:]:
        name, rest = part.split("}}", 1)
        made += [told[name], rest]
    return "".join(made)


def write_page(page: Page, path: Path) -> None:
    """Write a page to a file, beside and renamed.

    Raises
    ------
    ReviewError
        If it cannot be written.
    """
    write_text(path, page_html(page), ReviewError)


def packed(values: NDArray[Any]) -> dict[str, Any]:
    """Return an array as the page's script reads it: little-endian bytes in base64."""
    kind = {"f": f"f{values.dtype.itemsize}", "u": "u1"}[values.dtype.kind]
    data = np.ascontiguousarray(values).astype(f"<{kind}").tobytes()
    return {"type": kind, "base64": base64.b64encode(data).decode()}


def thinned(
    quantities: Sequence[FloatArray], edges: IntArray, limit: int = MAX_SAMPLES
) -> IntArray:
    """Return which samples a page keeps.

    Parameters
    ----------
    quantities : sequence of ndarray, (n,)
        The least and the greatest value of each, in every stretch of samples, stay.
    edges : ndarray of int
        Samples that stay in any case.
    limit : int
        How many samples are too many to keep them all.
    """
    n = len(quantities[0])
    if n <= limit:
        return np.arange(n)
    length = -(-n // max(1, limit // (2 * len(quantities))))
    starts = np.arange(0, n, length)
    kept = [np.array([0, n - 1]), edges]
    for values in quantities:
        # Filled up with what is neither the least nor the greatest of the last stretch.
        for unknown, extreme in ((np.inf, np.argmin), (-np.inf, np.argmax)):
            known = np.pad(
                np.where(np.isnan(values), unknown, values),
                (0, len(starts) * length - n),
                constant_values=unknown,
            )
            kept.append(starts + extreme(known.reshape(-1, length), axis=1))
    return np.unique(np.concatenate(kept))


def _column(values: NDArray[Any]) -> dict[str, Any]:
    """Return a column; of one that does not change, one number."""
    if len(values) and (values == values[0]).all():
        return {"type": packed(values[:1])["type"], "constant": float(values[0])}
    if values.dtype.kind == "f" and np.isnan(values).all():
        return {"type": packed(values[:1])["type"], "constant": None}
    return packed(values)


def _script() -> str:
    """Return the page's own script: all parts in one function, so that nothing is global."""
    parts = "\n".join(_file(f"{name}.js") for name in _SCRIPTS)
    return f'"use strict";\n(() => {{\n{parts}}})();\n'


def _file(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")
