# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes benchmark/results/coverage.md from the data of `coverage run`, and prints the share."""

from collections import Counter
from pathlib import Path

from coverage import Coverage

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "linkage_vibration"

coverage = Coverage(config_file=str(ROOT / "pyproject.toml"))
coverage.load()
lines: Counter[str] = Counter()
missing: Counter[str] = Counter()
for path in sorted(PACKAGE.rglob("*.py")):
    room = path.relative_to(PACKAGE).parts[0]
    _, statements, _, not_run, _ = coverage.analysis2(str(path))
    lines[room] += len(statements)
    missing[room] += len(not_run)
share = 100.0 * (1.0 - missing.total() / lines.total())
summary = f"The tests run {share:.1f} % of the {lines.total()} statements of the package."
rows = "".join(
    f"| `{room}` | {count} | {100.0 * (1.0 - missing[room] / count):.1f} % |\n"
    for room, count in lines.items()
    if count
)
(ROOT / "benchmark" / "results" / "coverage.md").write_text(
    "# Coverage\n\n"
    "On this page you can look up which share of each room the tests run. "
    f"`make coverage` writes it.\n\n{summary}\n\n"
    f"| room | statements | run by the tests |\n|---|---|---|\n{rows}"
)
print(summary)
