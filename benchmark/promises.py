# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Shows which promises the running node keeps, and beside what: ``python -m benchmark.promises``.

The tests of `test/ros/promises` start the installed command and drive it over DDS.
"""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from benchmark.report import machine, publish, table
from test.support.conditions import CONDITIONS

TESTS = Path(__file__).parents[1] / "test" / "ros" / "promises"
WORDS = {"passed": "kept", "failed": "broken", "skipped": "-"}
WORST = ("broken", "kept", "-")  # of several tests of one promise


@dataclass(frozen=True)
class Promise:
    """A promise: the page and the section that make it, and its sentence."""

    place: str
    sentence: str


@dataclass
class Results:
    """A plugin of pytest that keeps how each promise was kept in each condition."""

    promises: dict[str, Promise] = field(default_factory=dict)
    outcomes: dict[Promise, dict[str, str]] = field(default_factory=dict)
    reasons: dict[str, list[str]] = field(default_factory=dict)

    def pytest_itemcollected(self, item: pytest.Function) -> None:
        """Keep the promise of a test, which the first line of its docstring states."""
        for marker in item.iter_markers("promise"):
            sentence = (item.function.__doc__ or "").strip().splitlines()[0]
            promise = Promise(marker.args[0], sentence)
            self.promises[item.nodeid] = promise
            self.outcomes.setdefault(promise, {})
            for condition, reason in marker.args[1].items():
                known = self.reasons.setdefault(f"{condition}: {reason}", [])
                if sentence not in known:
                    known.append(sentence)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the worst outcome of the tests of a promise in a condition."""
        if report.when == "call" or report.outcome != "passed":
            promise = self.promises[report.nodeid]
            [condition] = [each for each in CONDITIONS if each in report.nodeid]
            known = self.outcomes[promise].get(condition, "-")
            self.outcomes[promise][condition] = min(known, WORDS[report.outcome], key=WORST.index)

    def rows(self) -> list[list[str]]:
        """Return the table of promises."""
        return [
            [promise.place, promise.sentence, *(outcome.get(c, "not run") for c in CONDITIONS)]
            for promise, outcome in self.outcomes.items()
        ]


def main() -> None:
    """Test each promise in each condition, and publish the outcomes."""
    results: Any = Results()
    status = pytest.main(["-q", "-m", "promise", str(TESTS)], plugins=[results])
    rows = results.rows()
    broken = sum("broken" in row for row in rows)
    reasons = [f"- {reason} ({len(found)})" for reason, found in sorted(results.reasons.items())]
    publish(
        "promises",
        "What the running node promises",
        [
            f"This page shows how the installed node kept the {len(rows)} promises of the manual, "
            f"of which {broken} were broken in at least one condition: while the node was idle, "
            "while a goal on `~/set_implement` built a table, and beside 1,000 readings a second. "
            "The goals and the readings come from processes of their own, and a promise counts as "
            "kept only if they were there from the beginning to the end of its test.",
            table(["page", "promise", *CONDITIONS], rows),
            "\n".join(["A dash marks a promise that makes no sense in a condition:", "", *reasons]),
        ],
        machine("ros-rclpy"),
    )
    sys.exit(status)


if __name__ == "__main__":
    main()
