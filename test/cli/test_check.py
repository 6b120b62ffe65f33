# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""`review --limits` prints a sentence for each failure, and its exit code says what it is."""

import shlex
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from linkage_vibration.cli.main import main
from test.support.random_resonances import CLEAR, START, Message, random_drive, write_drive
from test.test_documentation import ROOT, blocks_of

DRIVE = ROOT / "config" / "drives" / "hitch_duty_cycle.mcap"
PAGE = Path("docs/review.md")


def written(path: Path, angle: float = 2.0) -> Path:
    """Write a log of 5 s."""
    quiet = (CLEAR,) * 4, (0.05,) * 4, 0.1, "engine 3", 0, 0.33
    messages = [Message(START + k * 10**8, angle, CLEAR, *quiet) for k in range(50)]
    return write_drive(path, messages)


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with a log and limits, which is the current one."""
    written(tmp_path / "log.mcap")
    (tmp_path / "limits.yaml").write_text("gap: 0.11\nload_ratio: 0.11\nduration: 4.9\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_limits_hold(files: Path, capsys: Any) -> None:
    """The code is 0, and each limit is a test case without a failure."""
    assert main(["review", "log.mcap", "--limits", "limits.yaml", "--junit", "out.xml"]) == 0
    assert capsys.readouterr().out == "log.mcap: 50 predictions within their limits\n"
    cases = list(ElementTree.parse(files / "out.xml").iter("testcase"))
    assert [case.get("name") for case in cases] == [
        *["duration", "gap", "statuses", "input_faults", "load_ratio"]
    ]
    assert all(len(case) == 0 for case in cases)


def test_limits_fail(files: Path, capsys: Any) -> None:
    """The code is 3, as of each result that is not what it should be; each failure is a line."""
    (files / "limits.yaml").write_text("gap: 0.09\nload_ratio: 0.09\n")
    assert main(["review", "log.mcap", "--limits", "limits.yaml", "--junit", "out.xml"]) == 3
    out, err = capsys.readouterr()
    gap, load = err.splitlines()
    assert out == ""
    assert gap.startswith("linkage-vibration: log.mcap: gap: no prediction for 0.100 s, more than")
    assert "load_ratio: the load ratio in the pins is 0.1 (most severe: engine 3)" in load
    failed = [
        case.get("name") for case in ElementTree.parse("out.xml").iter("testcase") if len(case)
    ]
    assert failed == ["gap", "load_ratio"]


def test_doubtful_inputs_fail(files: Path, capsys: Any) -> None:
    """Stamps that repeat fail by default; a file of limits that allows the fault has it printed."""
    quiet = (CLEAR,) * 4, (0.05,) * 4, 0.1, "engine 3", 0, 0.33
    messages = [Message(START + k // 5 * 5 * 10**8, 2.0, CLEAR, *quiet) for k in range(50)]
    write_drive(files / "frozen.mcap", messages)
    words = "stamps of readings are those of the reading before"
    for text, code in (("{gap: 1}", 3), ("{input_faults: 0}", 3), ("{input_faults: 1}", 0)):
        (files / "limits.yaml").write_text(text)
        assert main(["review", "frozen.mcap", "--limits", "limits.yaml"]) == code
        out, err = capsys.readouterr()
        assert [words in out, words in err] == [code == 0, code == 3]
        assert ("input_faults: " in err) == (code == 3)


@pytest.mark.parametrize(
    ("limits", "arguments", "words"),
    [
        ("gab: 1", [], "limits.yaml: gab: this key is not known; did you mean gap?"),
        ("excitation: x\nload_ratio: 1", [], "excitation is 'x'; log.mcap has only engine 1"),
        ("gap: 1", ["--junit", "log.mcap"], "log.mcap is an input"),
        ("gap: 1", ["--junit", "limits.yaml"], "limits.yaml is an input"),
        ("gap: 1", ["--baseline", "none.mcap"], "none.mcap"),
        ("gap: 1", ["--baseline", "other.mcap"], "other.mcap"),
    ],
)
def test_errors(files: Path, capsys: Any, limits: str, arguments: list[str], words: str) -> None:
    """An error of a file is no failure of a limit: its code is 1, the XML has it, a page stays."""
    write_drive(files / "other.mcap", random_drive(1)[3:])
    (files / "limits.yaml").write_text(limits)
    (files / "page.html").write_text("of another day")
    junit = [] if "--junit" in arguments else ["--junit", "out.xml"]
    arguments = ["--limits", "limits.yaml", "-o", "page.html", *arguments, *junit]
    assert main(["review", "log.mcap", *arguments]) == 1
    assert (files / "page.html").read_text() == "of another day"
    [line] = capsys.readouterr().err.splitlines()
    assert words in line
    assert (files / "out.xml").exists() == bool(junit)
    if junit:
        [case] = ElementTree.parse(files / "out.xml").iter("testcase")
        assert [each.tag for each in case] == ["error"]
        assert words in str(case[0].text)


def test_baseline(files: Path, capsys: Any) -> None:
    """An equal earlier log passes; another one fails with what differs most."""
    shutil.copy("log.mcap", "same.mcap")
    written(files / "changed.mcap", 2.02)
    (files / "limits.yaml").write_text("gap: 0.11\nbaseline_tolerance: 0.001\n")
    arguments = ["review", "log.mcap", "--limits", "limits.yaml", "--baseline"]
    assert main([*arguments, "same.mcap"]) == 0
    capsys.readouterr()
    assert main([*arguments, "changed.mcap"]) == 3
    [line] = capsys.readouterr().err.splitlines()
    assert "baseline: the log (B) differs from changed.mcap (A) by more than 0.1 % in " in line
    assert "exceeded 50 times" in line
    (files / "limits.yaml").write_text("gap: 0.11\n")  # the default is 5 %
    assert main([*arguments, "changed.mcap"]) == 0


def test_examples_of_the_documentation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """The workflow of GitHub is YAML, and its check of the shipped drive passes."""
    blocks = [yaml.safe_load(b.text) for b in blocks_of(PAGE) if b.language == "yaml"]
    [limits] = [block for block in blocks if "load_ratio" in block]
    [github] = [block for block in blocks if "jobs" in block]
    [job] = github["jobs"].values()
    lines = [step["run"] for step in job["steps"] if "run" in step]
    reports = {step["with"]["report_paths"] for step in job["steps"] if "report_paths" in str(step)}
    assert len(reports) == 1
    (tmp_path / "bags").mkdir()
    shutil.copy(DRIVE, tmp_path / "bags" / "headland.mcap")
    (tmp_path / "limits.yaml").write_text(yaml.safe_dump(limits))
    monkeypatch.chdir(tmp_path)
    ran = [shlex.split(line)[1:] for line in lines if line.startswith("linkage-vibration")]
    assert [main(arguments) for arguments in ran] == [0], capsys.readouterr().err
    assert {path.name for path in tmp_path.glob("*.xml")} == reports
