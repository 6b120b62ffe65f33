# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Type checkers find the installed package, and accept what its errors advise."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

ADVISED = """
import linkage_vibration as lv

model = lv.LinkageModel(lv.read_mechanism("a.yaml"))
table = lv.build_table(model)
predictor = lv.Predictor(lv.load_table("a.npz"))
many = predictor.predict([2.0, 2.1], [0.01, 0.02])
one = predictor.predict(2.0)
solution = model.stack([2.0, 2.1]).rows[0]
receptances = solution.frf(["E1.z"], [("E1", "z")]).frf([10.0, 20.0])
frf = table.frf(2.0, ["E1.z"], ["E1.z"]).at([10.0, 20.0])
coupled = model.coupled_frf(2.0, [10.0], ["E1.z"], ["E1.z"])
values = table.evaluate([2.0, 2.1])
for source in (model.mechanism, solution, solution.shape(0), frf, table, many):
    lv.plot(source, "a.png")
lv.plot(lv.read_log("a.mcap"))
lv.plot(lv.sweep(model.mechanism.with_values({"a": 1.0}), {"a": [1.0]}, [2.0]))
lv.summaries(["a.mcap"])
lv.check_bag("a.mcap", lv.Limits(gap=1.0))
"""

REFUSED = """
import linkage_vibration as lv

lv.LinkageModel("a.yaml")
model = lv.LinkageModel(lv.read_mechanism())
lv.build_table(model.mechanism)
lv.Predictor(model)
lv.plot(model)
lv.load_table().frf(2.0, ["E1.z"], ["E1.z"]).at(10.0)
lv.predictor
"""


def wrong_lines(code: str, folder: Path) -> list[int]:
    """Return the lines of a program outside of the checkout that mypy refuses."""
    pytest.importorskip("mypy", reason="mypy is not installed")
    program = folder / "program.py"
    program.write_text(code)
    cache = str(ROOT / ".pytest_cache/mypy")
    command = ["-m", "mypy", "--strict", "--follow-imports=silent", "--cache-dir", cache]
    run = subprocess.run(
        [sys.executable, *command, program.name], cwd=folder, capture_output=True, text=True
    )
    assert run.returncode in (0, 1), run.stderr
    return [int(line) for line in re.findall(r"program\.py:(\d+): error", run.stdout)]


def test_types_of_the_public_api(tmp_path: Path) -> None:
    """What the errors advise has right types, and what they refuse has wrong ones."""
    assert wrong_lines(ADVISED, tmp_path) == []
    assert wrong_lines(REFUSED, tmp_path) == [4, 6, 7, 8, 9, 10]
