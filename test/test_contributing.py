# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The worked examples of CONTRIBUTING are all that an I-section and a field of a message take."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import linkage_vibration

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = Path(linkage_vibration.__file__).parent
SECTIONS = PACKAGE / "mechanics" / "sections"
TEXT = (ROOT / "CONTRIBUTING.md").read_text()
EXAMPLE = TEXT.partition("## Worked example: a section")[2].partition("\n## ")[0]
FIELD = TEXT.partition("## Worked example: a field")[2].partition("\n## ")[0]
REPLAY = """
import sys
import numpy as np
from pathlib import Path
import linkage_vibration as lv
from linkage_vibration.review.log import csv_text
log, table = sys.argv[1:]
lv.replay(lv.__path__[0] + "/../config/drives/hitch_duty_cycle.mcap", log)
drive = lv.read_log(log)
Path(table).write_text(csv_text(drive))
resonances, rows = drive.resonances, np.arange(len(drive.stamps))
expected = 2.0 * drive.damping_ratios[rows, resonances.mode] * resonances.natural_frequency
answered = np.diff(resonances.margin, prepend=0.0) != 0.0  # by the prediction of that row
np.testing.assert_allclose(resonances.half_power_bandwidth[answered], expected[answered], 1e-12)
assert answered.sum() > 100  # messages, of which there are ten in each of 20 s
"""


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


def test_a_field_of_a_message_takes_two_lines(tmp_path: Path) -> None:
    """With both lines of the example, a replay, `read_log` and CSV have the field."""
    for name in ("linkage_vibration", "linkage_vibration_interfaces", "config"):
        shutil.copytree(ROOT / name, tmp_path / name)
    shutil.copy(ROOT / "package.xml", tmp_path)
    message, code = (
        "\n".join(line.removeprefix("   ") for line in block.splitlines()) + "\n"
        for block in re.findall(r"^ *```(?:python)?\n(.*?)^ *```$", FIELD, re.DOTALL | re.MULTILINE)
    )
    assert (message.count("\n"), code.count("\n")) == (1, 1)
    definition = tmp_path / "linkage_vibration_interfaces" / "msg" / "Resonance.msg"
    definition.write_text(definition.read_text() + message)
    formula = tmp_path / "linkage_vibration" / "prediction" / "resonance.py"
    before = "            frequency_slope=slope,\n"
    assert before in formula.read_text()
    formula.write_text(formula.read_text().replace(before, before + code))
    outputs = [str(tmp_path / "log.mcap"), str(tmp_path / "log.csv")]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", REPLAY, *outputs]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    [head, *_] = (tmp_path / "log.csv").read_text().splitlines()
    assert "half_power_bandwidth_hz" in head.split(",")
