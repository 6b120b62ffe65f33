# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Type checkers find the installed package; `public_types.py` shows which types they see."""

import subprocess
import sys
from pathlib import Path

import pytest


def test_types_are_found_outside_of_the_checkout(tmp_path: Path) -> None:
    """A program elsewhere may import the package, and no library that is missing."""
    pytest.importorskip("mypy", reason="mypy is not installed")
    (tmp_path / "program.py").write_text("import linkage_vibration\nimport missing_library\n")
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=skip", "program.py"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert run.stdout.count(": error: ") == 1, run.stdout
    assert run.stdout.startswith("program.py:2: error: "), run.stdout
