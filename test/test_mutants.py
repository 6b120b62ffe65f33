# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The changes that benchmark/mutants.py draws, and which tests run for them."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from benchmark import line_tests, mutants

CODE = b'''"""A text of 1 + 1."""
if (a < b) and not c or "x" * d:
    e = abs(f - 2.0) * 3
'''
CHANGED = [
    b"if (a < b) or not c",
    b"if (a <= b) and",
    b"and c or",
    b'not c and "x"',
    b"abs(f - 2.0) / 3",
    b"e = (f - 2.0) * 3",
    b"abs(f + 2.0)",
    b"abs(f - 3.0)",
    b"* 4\n",
]


def test_each_operator_and_number_is_changed_alone() -> None:
    """Texts stay as they are; every other operator and number has one change."""
    changes = list(mutants.mutants(Path("code.py"), CODE))
    texts = [each.change(CODE) for each in changes]
    assert len(set(texts)) == len(texts) == len(CHANGED)
    for part in CHANGED:
        assert part not in CODE
        assert sum(part in text for text in texts) == 1, part


MODULE = """LIMIT = 3
def f(
    x,
):
    return x < LIMIT
"""


def test_tests_are_those_of_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They run it, or lines with a constant's name; half of the time is for the quickest ones.

    The rest is for the quickest of each file, as others are too many where all tests run a line.

    Where no test runs a module, the files of tests that name it are chosen. Tests of the folder of
    its room for which no time was left come after them.
    """
    path = Path("package/room/module.py")
    (tmp_path / path.parent).mkdir(parents=True)
    (tmp_path / path).write_text(MODULE)
    monkeypatch.setattr(line_tests, "COPY", tmp_path)
    imported = {"", "a.py::process"}  # a process that a test starts imports the module
    lines = {1: imported, 2: imported, 5: {"a.py::slow", "a.py::quick", "b.py"}}
    seconds = {"a.py::slow": 3.0, "a.py::quick": 1.0, "a.py::process": 0.1, "b.py::t": 2.0}
    runs = line_tests.Runs({path: lines}, seconds)
    for line in (1, 5):  # the constant, and where it is used
        assert runs.tests_of(path, line) == (["a.py::quick", "b.py::t", "a.py::slow"], [])
    for file in ("a.py", "b.py"):
        (tmp_path / file).write_text("import module" if file == "b.py" else "")
    assert line_tests.Runs({}, seconds).tests_of(path, 5) == (["b.py::t"], [])
    monkeypatch.setattr(line_tests, "LIMIT", 4.0)
    assert runs.tests_of(path, 5) == (["a.py::quick", "b.py::t"], [])
    own = "test/room/test_module.py::slow"
    lines[5].add(own)
    seconds[own] = 3.5
    assert runs.tests_of(path, 5) == (["a.py::quick", "b.py::t"], [own])
    seconds |= {"a.py::quick": 1.0, "a.py::third": 1.0, "a.py::slow": 1.0, "b.py::t": 1.5}
    lines[5].add("a.py::third")  # after two tests of a file, half of the time is over
    chosen, _ = runs.tests_of(path, 5)
    assert chosen[2:] == ["b.py::t"]
    assert line_tests.statement_at(MODULE, 3) == (range(2, 5), "f")
    assert line_tests.statement_at(MODULE, 5) == (range(5, 6), "")


def test_a_test_that_fails_without_the_change_finds_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is left out, and the next one that fails with the change alone finds it."""
    (tmp_path / "module.py").write_text("x = 1 < 2\n")
    change = mutants.Mutant(Path("module.py"), 1, 6, 7, ">")

    def run(checkout: Path, tests: Sequence[str], *options: str) -> str:
        is_changed = ">" in (checkout / "module.py").read_text()
        fail = [t for t in tests if t == "broken" or (t == "finds" and is_changed)]
        return fail[0] if fail else ""

    monkeypatch.setattr(mutants, "run", run)
    assert mutants.finder(tmp_path, change, ["passes", "broken", "finds"]) == "finds"
    assert mutants.finder(tmp_path, change, ["passes", "broken"]) == ""
    assert (tmp_path / "module.py").read_text() == "x = 1 < 2\n"


@pytest.mark.parametrize(
    ("code", "output", "answer"),
    [
        (0, "1 passed", ""),
        (1, "FAILED a.py::t[1 - 2] - assert 1 == 2", "a.py::t[1 - 2]"),
        (1, "ERROR a.py::t[1 - 2]", "a.py::t[1 - 2]"),
        (2, "ERROR a.py - NameError", "the import"),
    ],
)
def test_answers_of_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, output: str, answer: str
) -> None:
    """The first test that fails is the answer; a run that is interrupted has none."""
    done = [subprocess.CompletedProcess([], code, f"{output}\n")]
    monkeypatch.setattr(mutants, "python", lambda *_, **__: done[0])
    assert mutants.run(tmp_path, ["a.py::t[1 - 2]"]) == answer
    for code, output in ((2, "!!! KeyboardInterrupt !!!"), (-2, "")):
        done[0] = subprocess.CompletedProcess([], code, output)
        with pytest.raises(KeyboardInterrupt):
            mutants.run(tmp_path, ["a.py::t[1 - 2]"])


def test_rooms_are_weighted_by_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rooms with 30 and 70 % of the code have 3 and 7 of ten changes; other files have none."""
    same = mutants.Mutant(Path("code.py"), 1, 0, 0, "")
    monkeypatch.setattr(mutants, "mutants", lambda *_: [same] * 10)
    monkeypatch.setattr(mutants, "COPY", line_tests.ROOT)
    code = {".": (90, 90), "bags": (90, 30), "cli": (90, 70)}
    monkeypatch.setattr(mutants, "by_room", lambda _: code)
    rooms = [room for room, _ in mutants.drawn(10, 3)]
    assert sorted(rooms) == 3 * ["bags"] + 7 * ["cli"]
    assert rooms != sorted(rooms)  # so that the first ones are a fair sample


def test_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of four changes two are found; of the others, one changes nothing that a test could see."""
    (tmp_path / "module.py").write_text("x = 1\n")
    changes = [mutants.Mutant(Path("module.py"), 1, 4, 5, str(k)) for k in range(4)]
    names = [f"- module.py:1: `x = 1` -> `x = {k}`" for k in range(4)]
    judged, parts = tmp_path / "judged.txt", list[str]()
    judged.write_text(f"{names[0]}\n  Changes nothing: a reason.\n{names[1]}\n  Now found.\n")
    monkeypatch.setattr(mutants, "COPY", tmp_path)
    monkeypatch.setattr(mutants, "JUDGED", judged)
    monkeypatch.setattr(mutants, "measure", lambda: None)
    monkeypatch.setattr(mutants, "drawn", lambda *_: [("bags", each) for each in changes])
    found = dict(zip(names, ["", "", "a test", "a test"], strict=True))
    monkeypatch.setattr(mutants, "results", lambda *_: found)
    monkeypatch.setattr(mutants, "publish", lambda *given: parts.extend(given[2]))
    monkeypatch.setattr("sys.argv", ["mutants"])
    mutants.main()
    assert "They found 2 changes, or 50 % (standard error 25 %). Of the others, 1 ch" in parts[0]
    assert "found 67 % of the rest" in parts[0]
    assert "| bags | 4       | 2     | 50       | 25                |" in parts[1]
    assert parts[-1] == f"{names[0]}\n  Changes nothing: a reason.\n{names[1]}\n  Now found."
