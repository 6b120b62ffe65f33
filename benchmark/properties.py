# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Checks the properties of ``test/properties`` on ten thousand random linkages each.

`python -m benchmark.properties` takes half an hour; it runs the tests marked nightly.
"""

import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from benchmark.report import machine, publish, table

TESTS = Path(__file__).parents[1] / "test" / "properties"


@dataclass
class Results:
    """A plugin of pytest that keeps the outcome of each property."""

    titles: dict[str, str] = field(default_factory=dict)
    rows: list[list[str]] = field(default_factory=list)

    def pytest_itemcollected(self, item: pytest.Function) -> None:
        """Keep the first line of a test's docstring."""
        self.titles[item.nodeid] = (item.function.__doc__ or "").strip()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the outcome of a test."""
        if report.when == "call":
            examples = report.nodeid.partition("[")[2].rstrip("]")
            title = self.titles[report.nodeid]
            self.rows.append([title, examples, report.outcome])


def main() -> None:
    """Check every property and publish the outcomes."""
    results = Results()
    status = pytest.main(["-m", "nightly", "-q", str(TESTS)], plugins=[results])
    publish(
        "properties",
        "Properties of random linkages",
        [
            "This page shows which properties of mechanics were checked with random linkages.",
            table(["property", "examples", "outcome"], results.rows),
        ],
        machine("hypothesis"),
    )
    sys.exit(status)


if __name__ == "__main__":
    main()
