# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What holds for every linkage, tried on ten thousand random ones a property.

Run by `python -m benchmark.properties`; it takes half an hour. The properties are those of
``test/properties``, in the nightly setting.
"""

import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from benchmark.report import machine, publish, table

TESTS = Path(__file__).parents[1] / "test" / "properties"


@dataclass
class Results:
    """A plugin of pytest that keeps what became of each property."""

    titles: dict[str, str] = field(default_factory=dict)
    rows: list[list[str]] = field(default_factory=list)

    def pytest_itemcollected(self, item: pytest.Function) -> None:
        """Keep what a test shows."""
        self.titles[item.nodeid] = (item.function.__doc__ or "").strip()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep how it ended."""
        if report.when == "call":
            examples = report.nodeid.partition("[")[2].rstrip("]")
            title = self.titles[report.nodeid]
            self.rows.append([title, examples, report.outcome])


def main() -> None:
    """Try every property and publish what became of it."""
    results = Results()
    status = pytest.main(["-m", "nightly", "-q", str(TESTS)], plugins=[results])
    publish(
        "properties",
        "Properties of random linkages",
        [table(["property", "examples", "outcome"], results.rows)],
        machine("hypothesis"),
    )
    sys.exit(status)


if __name__ == "__main__":
    main()
