# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Which share of single changes of the package its tests notice.

The changes are drawn anew by a seed, in each room in proportion to its code. For each, the tests
that import its module run in a copy of the checkout, and then the other ones of its room.
"""

import argparse
import ast
import math
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmark.report import machine, publish, table
from tools.count_lines import by_room

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "linkage_vibration"
LIMIT = 300  # s, of the tests of a change; one that never ends is found
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
MADE = shutil.ignore_patterns(".*", "build", "*.egg-info", "__pycache__")
MOST = 4  # files of tests, those with the most similar names


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


def drawn(count: int, seed: int) -> dict[str, list[Mutant]]:
    """Return changes by room, of each in proportion to its lines of code."""
    generator, code = random.Random(seed), {room: each for room, (_, each) in by_room().items()}
    chosen, before, done = dict[str, list[Mutant]](), 0, 0
    for room in sorted(code.keys() - {"."}):
        before, done = done, done + code[room]
        share = [round(count * each / (sum(code.values()) - code["."])) for each in (before, done)]
        every = [
            each
            for path in sorted((ROOT / PACKAGE / room).rglob("*.py"))
            for each in mutants(path.relative_to(ROOT), path.read_bytes())
        ]
        chosen[room] = generator.sample(every, share[1] - share[0])
    return chosen


def tests_of(module: Path) -> tuple[list[str], list[str]]:
    """Return at most four files of tests that import a module, and the other ones of its room.

    The ones with its name come first, and then those of its room. Only the node's start nodes.
    """
    *package, name = module.with_suffix("").parts
    stem, room = re.escape(name), ROOT / "test" / module.parts[1]
    parent = r"\.".join(package)
    wanted = re.compile(rf"{parent}\.{stem}\b|from {parent} import (\([^)]*|.*)\b{stem}\b")
    files = [path for path in (ROOT / "test").rglob("test_*.py") if is_room(path, module)]
    found = [path for path in files if wanted.search(path.read_text())]
    found.sort(key=lambda path: (name not in path.stem, room not in path.parents, path))
    others = sorted(path for path in files if room in path.parents and path not in found[:MOST])
    if not (ROOT / module).is_file() or not found + others:
        raise SystemExit(f"{module} or its tests in {room} do not exist.")
    first, second = (
        [path.relative_to(ROOT).as_posix() for path in paths] for paths in (found[:MOST], others)
    )
    return first, second


def is_room(path: Path, module: Path) -> bool:
    """Return whether a file of tests starts no nodes, or is one of the room of the node."""
    return "ros" not in path.parts or module.parts[1] == "ros"


def run(checkout: Path, tests: Sequence[str]) -> str | None:
    """Return which test fails first in a checkout, "" if none does; None after the limit."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    try:
        done = subprocess.run(
            command, cwd=checkout, env=environment, capture_output=True, text=True, timeout=LIMIT
        )
    except subprocess.TimeoutExpired:
        return None
    failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", done.stdout, re.MULTILINE)
    return failed[1] if failed else "" if done.returncode in (0, 5) else tests[0]


def notices(checkout: Path, mutant: Mutant) -> bool:
    """Return whether a test of the module fails with a change, and passes without it."""
    file = checkout / mutant.path
    text = file.read_bytes()
    file.write_bytes(mutant.change(text))
    failed: str | None = ""
    for tests in tests_of(mutant.path):
        if failed == "" and tests:
            failed = run(checkout, tests)
    file.write_bytes(text)
    if failed and run(checkout, [failed]) != "":
        raise SystemExit(f"{failed} fails without a change, too; correct it first.")
    return failed != ""


def main() -> None:
    """Draw changes, run their tests, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rows, missed = list[tuple[str, int, int]](), list[str]()
    with tempfile.TemporaryDirectory() as folder:
        checkout = Path(folder) / "checkout"
        shutil.copytree(ROOT, checkout, ignore=MADE)
        for room, few in drawn(given.count, given.seed).items():
            found = [notices(checkout, each) for each in few]
            rows.append((room, len(few), sum(found)))
            pairs = zip(few, found, strict=True)
            missed += [
                x.describe((ROOT / x.path).read_bytes()) for x, is_found in pairs if not is_found
            ]
            print(rows[-1], *missed, sep="\n", flush=True)
    count, noticed = sum(row[1] for row in rows), sum(row[2] for row in rows)
    share = noticed / count
    error = math.sqrt(share * (1.0 - share) / count)
    publish(
        "mutants",
        "Changes that tests notice",
        [
            "On this page you find which share of single changes of the package its tests notice. "
            f"The seed {given.seed} drew {count} changes, for which no test was added before. "
            f"The tests of their modules and rooms found {noticed}, or {100.0 * share:.0f} % "
            f"(standard error {100.0 * error:.0f} %).",
            table(
                ["room", "changes", "found"],
                [[room, str(of), str(seen)] for room, of, seen in rows],
            ),
            "Not found:",
            "\n".join(missed) or "none",
        ],
        machine(f"seed {given.seed}", f"count {count}"),
    )


if __name__ == "__main__":
    main()
