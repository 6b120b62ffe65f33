# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Every example runs, and prints what it should."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"

# What the output of each script contains.
EXPECTED = {
    "engine_speeds_to_avoid.py": "90 deg: avoid 1865 to 2200 rpm",
    "frf_between_two_points.py": "100.0 Hz: 5.98e-08 m/N",
    "heavier_implement.py": "mode 4 (implement heave): at most -6.2 %, at 169.0 deg",
    "resonances_at_an_angle.py": "mode 4:    6.48 Hz",
    "simulated_hammer.py": "175.csv: 5 blows",
    "table_of_my_linkage.py": "mode 1 in the middle: 220.88 Hz",
    "test_my_drive.py": "2 passed",
}
WRITTEN = {"simulated_hammer.py": {"95.csv", "115.csv", "135.csv", "155.csv", "175.csv"}}


def test_every_example_is_run_and_listed() -> None:
    """The scripts in the folder, the list above and the table for readers agree."""
    assert {path.name for path in EXAMPLES.glob("*.py")} == set(EXPECTED)
    text = (EXAMPLES / "README.md").read_text()
    assert all(f"]({name})" in text for name in EXPECTED)


@pytest.mark.parametrize("name", EXPECTED)
def test_example(name: str, tmp_path: Path) -> None:
    """An example runs from any folder, prints its answer and leaves only the files it names."""
    command = [sys.executable, EXAMPLES / name]
    if name.startswith("test_"):
        command[1:1] = ["-m", "pytest", "-p", "no:cacheprovider", "--rootdir", tmp_path]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    assert EXPECTED[name] in run.stdout
    assert {path.name for path in tmp_path.iterdir()} == WRITTEN.get(name, set())
