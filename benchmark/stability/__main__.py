# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes docs/stability.md and its pictures anew: ``python -m benchmark.stability``."""

import sys
from importlib import import_module
from pathlib import Path

from tqdm import tqdm

from benchmark.report import machine

CASES = (
    "toggle",
    "static_limit",
    "repeated_constraints",
    "resonance",
    "veering",
    "truncation",
    "measured",
    "precision",
    "table_edges",
    "peaks",
)
DOCS = Path(__file__).parents[2] / "docs"
INTRODUCTION = """\
For each case the plain method is made to fail, with the figure, beside what this package does: the
right answer, or a refusal that names the cause and the mend. Every number and picture here is
written by `python -m benchmark.stability`; what has to hold is held by the tests named. Random
linkages are tried against eight invariants of mechanics in `test/properties`: 320 in every run, ten
thousand for each with `pytest -m nightly`, or `python -m benchmark.properties`. Every
file reader is tried on spoilt files in `test/readers/test_fuzz.py`, and 104,000 times by
`python -m benchmark.fuzz` ([results](../benchmark/results/fuzz.md)).
"""


def main() -> None:
    """Write the sections named on the command line, or all, and keep the others as they are."""
    asked = sys.argv[1:] or list(CASES)
    pictures = DOCS / "stability"
    pictures.mkdir(exist_ok=True)
    page = DOCS / "stability.md"
    old = _sections(page.read_text(encoding="utf-8")) if page.exists() else {}
    parts = ["# Where methods fail", INTRODUCTION.strip()]
    for number, name in enumerate(tqdm(CASES, unit="case"), start=1):
        case = import_module(f"benchmark.stability.{name}")
        heading = f"{number}. {case.TITLE}"
        body = case.section(pictures).strip() if name in asked else old.get(heading, "")
        parts += [f"## {heading}", body]
    parts.append(f"Made by `python -m benchmark.stability` on: {machine()}.")
    draft = page.with_suffix(".part")
    draft.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    draft.replace(page)


def _sections(text: str) -> dict[str, str]:
    """Return the bodies of a page's sections by their headings."""
    body = text[: text.rindex("\n\nMade by ")]
    parts = [part.partition("\n") for part in body.split("\n## ")[1:]]
    return {heading: section.strip() for heading, _, section in parts}


if __name__ == "__main__":
    main()
