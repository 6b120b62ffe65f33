# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes columns of numbers, and a description of what to draw of them, as one HTML page."""

import base64
import html
import json
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.support.version import VERSION

MAX_SAMPLES = 350_000  # with 3 modes and 13 excitations, a page of so many has less than 50 MB
COVERAGE = 2.0  # standard deviations on each side of a band of uncertainty

_FOLDER = Path(__file__).parent / "page"
_SCRIPTS = (
    *("data", "decimation", "state", "words", "elements", "axes", "shades", "pointer", "numbers"),
    *("charts", "excitations", "linkage"),
    *("readout", "modes", "tables", "advice", "provenance"),
    *("rows", "strip", "layout", "controls", "start"),
)  # the parts of the page's script, each of which may use the parts before it


@dataclass(frozen=True, slots=True)
class Page:
    """What a page shows; its scripts read the content, whose arrays are packed."""

    title: str
    columns: Mapping[str, NDArray[Any]]  # (n,), float64, float32 or uint8; "time" (s) ascends
    content: Mapping[str, Any]


def page_parts(page: Page) -> Iterator[bytes]:
    """Yield a page that needs no other file and no network, in parts, as columns may be large."""
    return (part.encode(errors="backslashreplace") for part in _parts(page))


def _parts(page: Page) -> Iterator[str]:
    # The parts of the page's own script are in one function, so that nothing in them is global.
    script = "\n".join(page_file(f"{name}.js") for name in _SCRIPTS)
    texts = {
        "title": html.escape(page.title),
        "version": VERSION,
        "uplot_css": page_file("uPlot.min.css"),
        "css": page_file("page.css"),
        "uplot_js": f"/*{page_file('uPlot.LICENSE.txt')}*/\n{page_file('uPlot.iife.min.js')}",
        "js": f'"use strict";\nwindow.opened = (async () => {{\n{script}}})();\n',
    }
    begin, end = page_file("page.html").split("{{data}}")
    yield filled(begin, texts)
    before = '{"columns": {'
    for name, values in page.columns.items():
        yield f"{before}{_json(name)}: {_json(_column(values))}"
        before = ", "
    yield "}, " + _json(page.content).removeprefix("{")
    yield filled(end, texts)


def picture_tag(png: bytes, alt: str) -> str:
    """Return an element with a picture, and the text for those who do not see it."""
    data = base64.b64encode(png).decode()
    return f'<img alt="{html.escape(alt)}" src="data:image/png;base64,{data}">\n'


def table_tag(
    label: str,
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    links: Sequence[str] = (),
    calm: Sequence[bool] = (),
) -> str:
    """Return a table of texts; links lead from first cells, and rows are marked as calm or not."""
    lines = []
    for row, link, its in zip_longest(rows, links, calm):
        first, *others = map(html.escape, row)
        first = f'<a href="{html.escape(link)}">{first}</a>' if link else first
        mark = {None: "", True: " class=calm", False: " class=alarm"}[its]
        lines.append(f"<tr{mark}>{''.join(f'<td>{cell}</td>' for cell in (first, *others))}</tr>\n")
    columns = "".join(f'<th scope="col">{html.escape(text)}</th>' for text in head)
    table = f"<table><thead><tr>{columns}</tr></thead><tbody>\n{''.join(lines)}</tbody></table>"
    return f'<div class="scroll" tabindex="0" aria-label="{html.escape(label)}">{table}</div>\n'


def plain_html(title: str, sentences: Sequence[str], main: str, *, calm: bool | None = None) -> str:
    """Return a page without scripts; a first sentence that is calm or not is marked as answer."""
    texts = {"title": html.escape(title), "css": page_file("page.css"), "main": main}
    lines = [f"<p>{html.escape(text)}</p>" for text in sentences]
    if calm is not None:
        lines[0] = lines[0].replace("<p", f'<p id="answer"{" class=calm" * calm}', 1)
    return filled(page_file("plain.html"), texts | {"sentences": "\n".join(lines)})


def filled(template: str, texts: Mapping[str, str]) -> str:
    """Return a template with texts in place of their names in double braces."""
    return re.sub(r"{{(\w+)}}", lambda name: texts[name[1]], template)


def _json(value: object) -> str:
    """Return a value as JSON that does not end the script that contains it."""
    return json.dumps(value, allow_nan=False, default=packed).replace("<", "\\u003c")


def packed(values: NDArray[Any]) -> dict[str, Any]:
    """Return an array for the page's script: differences of each byte, as neighbours are alike."""
    kind = {"f": f"f{values.dtype.itemsize}", "u": "u1"}[values.dtype.kind]
    data = np.ascontiguousarray(values).astype(f"<{kind}").reshape(-1, 1).view(np.uint8).T
    differences = np.diff(data, axis=1, prepend=np.uint8(0))
    return {
        "type": kind,
        "deflate": base64.b64encode(zlib.compress(differences.tobytes())).decode(),
    }


def thinned(
    quantities: Sequence[FloatArray], edges: IntArray, limit: int = MAX_SAMPLES
) -> IntArray:
    """Return indices of samples to keep, (n_kept,): all up to a limit, or extremes and edges."""
    n = len(quantities[0])
    if n <= limit:
        return np.arange(n)
    length = -(-n // max(1, limit // (2 * len(quantities))))
    starts = np.arange(0, n, length)
    kept = [np.array([0, n - 1]), edges]
    for values in quantities:
        # Padding and missing values are never the extreme value of a stretch.
        for unknown, extreme in ((np.inf, np.argmin), (-np.inf, np.argmax)):
            filled = np.where(np.isnan(values), unknown, values)
            filled = np.pad(filled, (0, len(starts) * length - n), constant_values=unknown)
            kept.append(starts + extreme(filled.reshape(-1, length), axis=1))
    return np.unique(np.concatenate(kept))


def _column(values: NDArray[Any]) -> dict[str, Any]:
    """Return a column as the page's script reads it; one number if the column is constant."""
    if len(values) and np.isfinite(values[0]) and (values == values[0]).all():
        return {"type": packed(values[:1])["type"], "constant": float(values[0])}
    if values.dtype.kind == "f" and np.isnan(values).all():
        return {"type": packed(values[:1])["type"], "constant": None}
    return packed(values)


def page_file(name: str) -> str:
    """Return the text of a file in ``page``."""
    return (_FOLDER / name).read_text(encoding="utf-8")
