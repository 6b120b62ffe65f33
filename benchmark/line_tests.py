# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Which tests run which lines of the package, measured by one run of the default tests."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "build" / "mutants"  # delete it to study another state of the package
COPY = WORK / "measured"
LIMIT = 120.0  # s, of the tests of a line
MADE = shutil.ignore_patterns(".*", "build", "*.egg-info", "__pycache__")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Note which lines a test runs, and how long it takes."""
    began = time.monotonic()
    attribute(item.nodeid)
    result = yield
    with (item.config.rootpath / "seconds.jsonl").open("a") as file:
        file.write(json.dumps({item.nodeid: time.monotonic() - began}) + "\n")
    return result


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any, request: pytest.FixtureRequest) -> Iterator[Any]:
    """Attribute what a fixture of several tests runs to their file, and the rest to the test."""
    item = request._pyfuncitem
    if fixturedef.scope != "function":
        attribute(item.nodeid.partition("::")[0])
    result = yield
    attribute(item.nodeid)
    return result


def attribute(context: str) -> None:
    """Attribute the lines that run from now on, here and in new processes, to a test or a file."""
    from coverage import Coverage  # which the environment of colcon lacks

    if measuring := Coverage.current():
        measuring.switch_context(context)
        measuring.config.context = context
        os.environ["COVERAGE_PROCESS_CONFIG"] = measuring.config.serialize()


@dataclass(frozen=True)
class Runs:
    """Which tests run which lines: contexts by file and line, and the seconds of each test."""

    lines: dict[Path, dict[int, set[str]]]
    seconds: dict[str, float]

    def tests_of(self, path: Path, line: int) -> tuple[list[str], list[str]]:
        """Return the tests that run a line, or lines with the name that an import gives at it.

        If there are none, they run other lines of its file, or name its module. Others of the
        folder of its room are apart. Both are for up to the limit.
        """
        lines = self.lines.get(path, {})
        head, name = statement_at((COPY / path).read_text(), line)
        tests = self._run(lines, [line]) or self._run(lines, head)
        if name:
            word, tests = re.compile(rf"\b{name}\b"), set()
            for file, of in self.lines.items():
                numbered = enumerate((COPY / file).read_text().splitlines(), 1)
                # What each import runs belongs to no test, and to all that start a process.
                used = {n for n, text in numbered if word.search(text)}
                tests |= self._run(of, (n for n in used if "" not in of.get(n, {""})))
        tests = tests or self._run(lines, lines) or self._naming(path.stem)
        first, folder = self._in_order(tests), f"{Path('test', *path.parts[1:2])}/"
        return first, self._in_order({t for t in tests if t.startswith(folder)} - {*first})

    def _naming(self, module: str) -> set[str]:
        """Return the tests of files that name a module, of which processes alone run lines."""
        word = re.compile(rf"\b{module}\b")
        files = {test.partition("::")[0] for test in self.seconds}
        naming = {file for file in files if word.search((COPY / file).read_text())}
        return {test for test in self.seconds if test.partition("::")[0] in naming}

    def _run(self, lines: dict[int, set[str]], numbers: Iterable[int]) -> set[str]:
        """Return the tests that run any of some lines of a file."""
        contexts = set[str]().union(*(lines.get(n, ()) for n in numbers))
        return {t for t in self.seconds if t in contexts or t.partition("::")[0] in contexts}

    def _in_order(self, tests: set[str]) -> list[str]:
        """Return the quickest tests for half of the limit, then those of each file for the rest."""
        before, ranks = Counter[str](), dict[str, int]()
        quickest = sorted(tests, key=self.seconds.__getitem__)
        for test in quickest:
            ranks[test] = before[file := test.partition("::")[0]]
            before[file] += 1
        of_files = sorted(quickest, key=ranks.__getitem__)
        chosen, total = dict[str, None](), 0.0
        for order, most in ((quickest, LIMIT / 2.0), (of_files, LIMIT)):
            for test in order:
                if test not in chosen and (not chosen or total + self.seconds[test] <= most):
                    chosen[test] = None
                    total += self.seconds[test]
        return list(chosen)


def statement_at(text: str, line: int) -> tuple[range, str]:
    """Return the lines of the statement at a line, and the name that it gives at import, or ""."""
    head, in_function = range(line, line + 1), False
    for node in ast.walk(ast.parse(text)):  # outer ones come first
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or 0):
            first = getattr(node, "body", [None])[0]
            end = max(node.lineno, first.lineno - 1) if first else node.end_lineno or 0
            head = range(node.lineno, end + 1)
            is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
            in_function |= is_function and line not in head
    named = re.match(r"\s*(?:async )?(?:def |class )?(\w+)", text.splitlines()[head[0] - 1])
    return head, named[1] if named and not in_function else ""


def measure() -> None:
    """Run the default tests in a copy of the checkout, if that was not done."""
    if not (COPY / ".coverage").exists():
        shutil.rmtree(WORK, ignore_errors=True)
        shutil.copytree(ROOT, COPY, ignore=MADE)
        tests = [
            "-m",
            "pytest",
            "-q",
            "-p",
            "benchmark.line_tests",
            "-n",
            "3",
            "--dist",
            "loadfile",
        ]
        if python(COPY, "-m", "coverage", "run", *tests).returncode > 1:  # more than failed tests
            raise SystemExit("The tests did not run to their end; see above.")
        python(COPY, "-m", "coverage", "combine", "-q")


def measured() -> Runs:
    """Return which tests ran which lines of the copy."""
    from coverage import CoverageData  # as above

    data, lines, seconds = CoverageData(str(COPY / ".coverage")), {}, dict[str, float]()
    data.read()
    for path in map(Path, data.measured_files()):
        contexts = data.contexts_by_lineno(str(path))
        lines[path.relative_to(COPY)] = {n: set(each) for n, each in contexts.items()}
    for line in (COPY / "seconds.jsonl").read_text().splitlines():
        seconds |= json.loads(line)
    return Runs(lines, seconds)


def python(checkout: Path, *arguments: str, **keywords: Any) -> subprocess.CompletedProcess[str]:
    """Run Python in a checkout, whose package is imported."""
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=checkout, env=environment, text=True, **keywords)
