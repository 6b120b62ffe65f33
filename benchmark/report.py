# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the results of a benchmark as a Markdown page, with the command and the machine."""

import os
import platform
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path

RESULTS = Path(__file__).parent / "results"


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table with padded columns, so that it can be read as plain text, too.

    Examples
    --------
    >>> print(table(["mode", "Hz"], [["1", "2.84"]]))
    | mode | Hz   |
    |------|------|
    | 1    | 2.84 |
    """
    cells = [list(columns), *map(list, rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(columns))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |"
        for row in cells
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def machine(*others: str) -> str:
    """Return the machine's cores and the versions of Python, NumPy, SciPy and others.

    Parameters
    ----------
    *others : str
        Installed distributions, or ``name version`` of a program that is no distribution.
    """
    distributions = ["numpy", "scipy", *others]
    versions = [name if " " in name else f"{name} {version(name)}" for name in distributions]
    cores = f"{os.cpu_count()} cores, {platform.machine()}, {platform.system()}"
    return f"{cores}; Python {platform.python_version()}, {', '.join(versions)}"


def publish(name: str, title: str, parts: Sequence[str], machine_line: str, file: str = "") -> None:
    """Print a benchmark's results and write them to ``benchmark/results``.

    Parameters
    ----------
    name : str
        Module in ``benchmark``, such as ``validation.solid_fe``; its last part names the file.
    title : str
        Heading.
    parts : sequence of str
        Paragraphs and tables. The first sentence says what the page shows.
    machine_line : str
        What `machine` returns.
    file : str
        Another name of the file, without its suffix.
    """
    command = f"Made by `python -m benchmark.{name}` on: {machine_line}."
    text = "\n\n".join([f"# {title}", *parts, command]) + "\n"
    print(text)
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{file or name.rsplit('.', 1)[-1]}.md"
    draft = path.with_suffix(".part")
    draft.write_text(text, encoding="utf-8")
    draft.replace(path)
