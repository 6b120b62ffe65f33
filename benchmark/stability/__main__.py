# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes results/stability.md and its pictures: ``python -m benchmark.stability [CASE ...]``."""

import sys
from importlib import import_module

from tqdm import tqdm

from benchmark.report import RESULTS, machine

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
    "damping",
)
INTRODUCTION = """\
This page shows how large the errors of common methods are in eleven cases, and those of this
package ("ours"). [Where methods fail](../../docs/stability.md) says what a user does in each case.

The tests that are named check the numbers. In addition, `test/properties` checks eight invariants
of mechanics with random linkages: 320 in every run, and ten thousand for each invariant with
`pytest -m nightly`. `test/readers/test_fuzz.py` reads damaged files with every reader, and
`make bench ONLY=fuzz` reads 104,000 of them ([results](fuzz.md)).
"""


def main() -> None:
    """Write the sections that the command line names, or all; the others stay unchanged."""
    chosen = sys.argv[1:] or list(CASES)
    pictures = RESULTS / "stability"
    pictures.mkdir(exist_ok=True)
    page = RESULTS / "stability.md"
    old = _sections(page.read_text(encoding="utf-8")) if page.exists() else {}
    parts = ["# Where methods fail: evidence", INTRODUCTION.strip()]
    for number, name in enumerate(tqdm(CASES, unit="case"), start=1):
        case = import_module(f"benchmark.stability.{name}")
        heading = f"{number}. {case.TITLE}"
        body = case.section(pictures).strip() if name in chosen else old.get(heading, "")
        parts += [f"## {heading}", body]
    parts.append(f"`make bench ONLY=stability` wrote this page on: {machine()}.")
    draft = page.with_suffix(".part")
    draft.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    draft.replace(page)


def _sections(text: str) -> dict[str, str]:
    """Return the sections of a page by their headings."""
    body = text[: text.rindex("\n\n")]
    parts = [part.partition("\n") for part in body.split("\n## ")[1:]]
    return {heading: section.strip() for heading, _, section in parts}


if __name__ == "__main__":
    main()
