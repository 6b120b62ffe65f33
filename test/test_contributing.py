# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The worked example of CONTRIBUTING is how the I-section is built, and all that it takes."""

import re
from pathlib import Path

import linkage_vibration

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = Path(linkage_vibration.__file__).parent
SECTIONS = PACKAGE / "mechanics" / "sections"
EXAMPLE = (ROOT / "CONTRIBUTING.md").read_text().partition("## Worked example: a section")[2]
EXAMPLE = EXAMPLE.partition("\n## ")[0]


def test_the_files_exist() -> None:
    """Every file that the example names exists."""
    named = re.findall(r"`([\w/.]+/[\w.]+\.(?:py|md))`", EXAMPLE)
    assert len(named) == 5
    for name in named:
        assert (ROOT / name).is_file(), name


def test_the_lines_are_those_of_the_files() -> None:
    """Every line of code in the example is one of the new file or of the list."""
    code = (SECTIONS / "i_section.py").read_text() + (SECTIONS / "__init__.py").read_text()
    blocks = re.findall(r"^ *```python\n(.*?)^ *```$", EXAMPLE, re.DOTALL | re.MULTILINE)
    assert len(blocks) == 4
    for block in blocks:
        lines = [line.removeprefix("   ") for line in block.splitlines()]
        assert "\n".join(lines) in code, block


def test_nothing_else_knows_the_section() -> None:
    """One new file and the list are all the code that an I-section takes."""
    known = {path for path in PACKAGE.rglob("*.py") if "i_section" in path.read_text()}
    assert known == {SECTIONS / "i_section.py", SECTIONS / "__init__.py"}
