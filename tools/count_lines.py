# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Counts the lines of the package by room: ``python -m tools.count_lines [FOLDER]``.

The second number counts code alone, without docstrings, comments and blank lines. A string behind
an assignment documents it, as Sphinx and numpydoc see it, and is a docstring, too.
"""

import ast
import sys
from collections import Counter
from itertools import pairwise
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "linkage_vibration"
DOCUMENTED = ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef
ASSIGNMENTS = ast.Assign, ast.AnnAssign
LINES, CODE = 36_500, 25_500
"""The budget of the package."""


def count(text: str) -> tuple[int, int]:
    """Return the lines of a module and its lines of code."""
    lines, documented = text.splitlines(), set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, DOCUMENTED):
            for before, each in pairwise((node, *node.body)):
                documents = before is node or isinstance(before, ASSIGNMENTS)
                match each:
                    case ast.Expr(value=ast.Constant(value=str())) if documents:
                        documented |= set(range(each.lineno, (each.end_lineno or 0) + 1))
    code = [
        line
        for number, line in enumerate(lines, 1)
        if line.strip() and not line.lstrip().startswith("#") and number not in documented
    ]
    return len(lines), len(code)


def by_room(package: Path = PACKAGE) -> dict[str, tuple[int, int]]:
    """Return the lines and the lines of code of each room; "." holds the files beside them."""
    lines, code = Counter[str](), Counter[str]()
    for path in sorted(package.rglob("*.py")):
        room = path.relative_to(package).parts[0] if path.parent != package else "."
        all_lines, code_lines = count(path.read_text(encoding="utf-8"))
        lines[room] += all_lines
        code[room] += code_lines
    return {room: (lines[room], code[room]) for room in lines}


def main() -> None:
    """Print the lines of each room and of all."""
    rooms = by_room(Path(sys.argv[1]) if len(sys.argv) > 1 else PACKAGE)
    rooms["all"] = tuple(map(sum, zip(*rooms.values(), strict=True)))  # type: ignore[assignment]
    print(f"{'room':<12} {'lines':>7} {'code':>7}")
    for room, (lines, code) in rooms.items():
        print(f"{room:<12} {lines:7} {code:7}")
    print(f"{'budget':<12} {LINES:7} {CODE:7}")


if __name__ == "__main__":
    main()
