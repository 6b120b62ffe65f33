# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes benchmark/results/nightly.md from the JUnit XML of runs of the nightly set.

Usage: write_nightly.py FILES [TESTS]: paths with a comma between them, where what a test did in a
later file counts; and the tests that ran if not all did.
"""

import sys
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

sys.path.insert(0, str(Path(__file__).parents[1]))  # also of the pages of benchmarks

from benchmark.report import RESULTS, machine, table

suites = [ElementTree.parse(file).getroot()[0] for file in sys.argv[1].split(",")]
cases = {
    (case.get("classname", ""), case.get("name", "")): case
    for suite in suites
    for case in suite.iter("testcase")
}
# A run that pytest itself ends early has such an error.
broken = [key for key in cases if key[0] in ("", "pytest")]
for key in broken:
    del cases[key]
seconds: Counter[str] = Counter()
counts: dict[str, Counter[str]] = {}
for (folder, _), case in cases.items():
    name = folder.replace(".", "/") + ".py"
    seconds[name] += float(case.get("time", 0.0))  # type: ignore[assignment]
    outcome = next((each.tag for each in case if each.tag in ("failure", "error", "skipped")), "")
    counts.setdefault(name, Counter())[outcome or "passed"] += 1
kinds = "passed", "failure", "error", "skipped"
rows = [
    [f"`{name}`", *(str(of[kind] or "") for kind in kinds), f"{seconds[name]:.0f}"]
    for name, of in sorted(counts.items())
]
which = "All files ran" if len(sys.argv) < 3 or not sys.argv[2] else f"Only `{sys.argv[2]}` ran"
which = f"A run ended early, so that only {len(cases)} tests have a result" if broken else which
day = suites[-1].get("timestamp", "")[:10]
day += f", in {len(suites)} runs" if len(suites) > 1 else ""
page = [
    "# The nightly set",
    "On this page you find the last result of the tests that take too long for every run. "
    f"`make nightly` writes it. {which}, on {day}.",
    table(["file", *kinds, "s"], rows),
    f"Made by `make nightly` on: {machine('hypothesis', 'pytest')}.",
]
(RESULTS / "nightly.md").write_text("\n\n".join(page) + "\n")
sys.exit(bool(broken) or any(of["failure"] + of["error"] for of in counts.values()))
