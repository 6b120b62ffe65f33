# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Which share of single changes of the package its tests notice.

The default tests run once and note which lines each of them runs. Changes are then drawn by a seed,
in each room in proportion to its code. For each, the tests that run its line run in a copy of the
checkout. All of it is in `build/mutants`, from where a run that was interrupted goes on.
"""

import argparse
import ast
import json
import math
import random
import re
import shutil
import signal
import subprocess
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from queue import SimpleQueue

from tqdm import tqdm

from benchmark.line_tests import COPY, LIMIT, MADE, WORK, measure, measured, python
from benchmark.report import machine, publish, table
from tools.count_lines import by_room

PACKAGE = "linkage_vibration"
JUDGED = Path(__file__).with_suffix(".txt")
SWAPS: dict[type[ast.AST], str] = {
    ast.Lt: "<=",
    ast.LtE: "<",
    ast.Gt: ">=",
    ast.GtE: ">",
    ast.Eq: "!=",
    ast.NotEq: "==",
    ast.Add: "-",
    ast.Sub: "+",
    ast.Mult: "/",
    ast.Div: "*",
    ast.And: "or",
    ast.Or: "and",
}
OPERATOR = re.compile(r"(\)*\s*)([-+*/<>=!]+|and|or)(\s*\(*)")


@dataclass(frozen=True)
class Mutant:
    """A change of a part of one line of a file."""

    path: Path  # in the checkout
    line: int
    start: int  # columns, in bytes
    end: int
    new: str

    def change(self, text: bytes) -> bytes:
        """Return the text of the file with the change."""
        lines = text.splitlines(keepends=True)
        line = lines[self.line - 1]
        lines[self.line - 1] = line[: self.start] + self.new.encode() + line[self.end :]
        return b"".join(lines)

    def describe(self, text: bytes) -> str:
        """Return where and what it changes, as an entry of a list."""
        before, after = (each.splitlines()[self.line - 1] for each in (text, self.change(text)))
        code = " -> ".join(f"`{line.decode().strip()}`" for line in (before, after))
        return f"- {self.path.as_posix()}:{self.line}: {code}"


def mutants(path: Path, text: bytes) -> Iterator[Mutant]:
    """Yield the changes of a file: of operators, comparisons and numbers; no `not`, no `abs`."""
    lines = text.splitlines()

    def swapped(left: ast.expr, operator: ast.AST, right: ast.expr) -> Iterator[Mutant]:
        start, end, line = left.end_col_offset or 0, right.col_offset, right.lineno
        new, between = SWAPS.get(type(operator)), lines[line - 1][start:end].decode()
        if new and left.end_lineno == line and (match := OPERATOR.fullmatch(between)):
            yield Mutant(path, line, start, end, f"{match[1]}{new}{match[3]}")

    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Compare(left, [operator, *_], [right, *_]):
                yield from swapped(left, operator, right)
            case ast.BinOp(left, operator, right) if not any(map(is_text, (left, right))):
                yield from swapped(left, operator, right)
            case ast.BoolOp(operator, [left, right, *_]):
                yield from swapped(left, operator, right)
            case ast.UnaryOp(ast.Not(), operand):
                yield Mutant(path, node.lineno, node.col_offset, operand.col_offset, "")
            case ast.Call(ast.Name("abs") | ast.Attribute(ast.Name("np"), "abs") as func):
                yield Mutant(path, node.lineno, node.col_offset, func.end_col_offset or 0, "")
            case ast.Constant(int() | float() as value) if not isinstance(value, bool):
                new = repr(value + 1 if isinstance(value, int) else 1.5 * value or 1.0)
                yield Mutant(path, node.lineno, node.col_offset, node.end_col_offset or 0, new)


def is_text(node: ast.AST) -> bool:
    """Return whether a node is a text, for which operators have another meaning."""
    constant = isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    return constant or isinstance(node, ast.JoinedStr)


def drawn(count: int, seed: int) -> list[tuple[str, Mutant]]:
    """Return rooms and changes, of each room in proportion to its code, in a random order."""
    generator, rooms = random.Random(seed), by_room(COPY / PACKAGE)
    code = {room: each for room, (_, each) in rooms.items()}
    chosen, before, done = list[tuple[str, Mutant]](), 0, 0
    for room in sorted(code.keys() - {"."}):
        before, done = done, done + code[room]
        share = [round(count * each / (sum(code.values()) - code["."])) for each in (before, done)]
        every = [
            each
            for path in sorted((COPY / PACKAGE / room).rglob("*.py"))
            for each in mutants(path.relative_to(COPY), path.read_bytes())
        ]
        chosen += [(room, each) for each in generator.sample(every, share[1] - share[0])]
    generator.shuffle(chosen)
    return chosen


def run(checkout: Path, tests: Sequence[str], *options: str) -> str:
    """Return which test fails first in a checkout, "" if none does, or why there is no answer."""
    arguments = checkout / "arguments.txt"
    arguments.write_text("\n".join(tests))
    options = ("-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *options, f"@{arguments}")
    try:
        done = python(checkout, *options, capture_output=True, timeout=5.0 * LIMIT)
    except subprocess.TimeoutExpired:
        return "the limit of time"
    if done.returncode in (0, 5):
        return ""
    interrupted = re.search(r"^!+ KeyboardInterrupt !", done.stdout, re.MULTILINE)
    if done.returncode == -signal.SIGINT or interrupted:
        raise KeyboardInterrupt  # which is no answer
    lines = re.findall(r"^(?:FAILED|ERROR) (.*)$", done.stdout, re.MULTILINE)
    failed = (t for t in tests for line in lines if line == t or line.startswith(f"{t} - "))
    return next(failed, "the import")


def finder(checkout: Path, mutant: Mutant, tests: list[str]) -> str:
    """Return which test fails with a change and passes without it, "" if there is none."""
    file = checkout / mutant.path
    text = file.read_bytes()
    while tests:
        file.write_bytes(mutant.change(text))
        failed = run(checkout, tests)
        file.write_bytes(text)
        alone = [failed] if failed in tests else tests
        options = [] if failed in tests else ["--collect-only"]
        if not failed or not run(checkout, alone, *options):
            return failed
        if failed not in tests:
            raise SystemExit(f"{mutant.describe(text)}: its tests cannot be collected: {tests}")
        tests = [test for test in tests if test != failed]
    return ""


def describe(mutant: Mutant) -> str:
    """Return where and what a change of the copy is."""
    return mutant.describe((COPY / mutant.path).read_bytes())


def results(changes: list[tuple[str, Mutant]], file: Path, jobs: int) -> dict[str, str]:
    """Return by which test each change is found, of those of a file and of new runs."""
    lines = file.read_text().splitlines() if file.exists() else []
    known: dict[str, str] = dict(map(json.loads, lines))
    checkouts: SimpleQueue[Path] = SimpleQueue()
    for job in range(jobs):
        checkouts.put(WORK / f"checkout_{job}")
        shutil.rmtree(WORK / f"checkout_{job}", ignore_errors=True)
        shutil.copytree(COPY, WORK / f"checkout_{job}", ignore=MADE)
    runs = measured()

    def answer(mutant: Mutant) -> tuple[str, str]:
        if (what := describe(mutant)) in known:
            return what, known[what]
        checkout = checkouts.get()
        first, others = runs.tests_of(mutant.path, mutant.line)
        found = finder(checkout, mutant, first) or finder(checkout, mutant, others)
        checkouts.put(checkout)
        with file.open("a") as lines:
            lines.write(json.dumps([what, found]) + "\n")
        return what, found

    with ThreadPoolExecutor(jobs) as pool:
        return dict(tqdm(pool.map(answer, (each for _, each in changes)), total=len(changes)))


def main() -> None:
    """Draw changes, run their tests, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, help="run only as many, in their random order")
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    measure()
    changes = drawn(given.count, given.seed)[: given.first]
    found = results(changes, WORK / f"seed_{given.seed}.jsonl", given.jobs)
    rooms, missed = dict[str, list[bool]](), list[str]()
    judged = dict(re.findall(r"^(- .*)\n(  .*)$", JUDGED.read_text(), re.MULTILINE))
    for room, mutant in sorted(changes, key=itemgetter(0)):
        rooms.setdefault(room, []).append(bool(found[what := describe(mutant)]))
        if not found[what]:
            missed.append(f"{what}\n{judged.get(what, '')}".rstrip())
    seen = [each for of_room in rooms.values() for each in of_room]
    same = sum("\n  Changes nothing" in each for each in missed)
    (noticed, part, error), rest = share(seen), share(sorted(seen)[same:])
    publish(
        "mutants",
        "Changes that tests notice",
        [
            "On this page you find which share of single changes of the package its tests notice. "
            f"The seed {given.seed} drew {given.count} changes, in each room in proportion to its "
            f"code, for which no test was added before. The first {len(seen)} in a random order "
            "were made. For each, the tests that run its line ran, the quickest first, for up "
            f"to {LIMIT / 2.0:.0f} s, then the quickest of each file, for as long, and then others "
            f"of the folder of its room, for {LIMIT:.0f} s. They found {noticed} changes, or "
            f"{part} % (standard error {error} %). Of the others, {same} change nothing that a "
            f"test could see; the tests found {rest[1]} % of the rest.",
            table(
                ["room", "changes", "found", "share, %", "standard error, %"],
                [[room, str(len(each)), *share(each)] for room, each in rooms.items()],
            ),
            "Not found:",
            "\n".join(missed) or "none",
        ],
        machine("pytest", "coverage", f"seed {given.seed}", f"count {given.count}"),
    )


def share(found: Sequence[bool]) -> tuple[str, str, str]:
    """Return how many are found, their share and its standard error, %."""
    part = sum(found) / len(found)
    error = math.sqrt(part * (1.0 - part) / len(found))
    return str(sum(found)), f"{100.0 * part:.0f}", f"{100.0 * error:.0f}"


if __name__ == "__main__":
    main()
