# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The changes that benchmark/mutants.py draws, and which tests run for them."""

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
    """They run it, or lines with a constant's name; the quickest test of each file comes first.

    Where no test runs a module, the files of tests that name it are chosen.
    """
    path = Path("module.py")
    (tmp_path / path).write_text(MODULE)
    monkeypatch.setattr(line_tests, "COPY", tmp_path)
    imported = {"", "a.py::process"}  # a process that a test starts imports the module
    lines = {1: imported, 2: imported, 5: {"a.py::slow", "a.py::quick", "b.py"}}
    seconds = {"a.py::slow": 3.0, "a.py::quick": 1.0, "a.py::process": 0.1, "b.py::t": 2.0}
    runs = line_tests.Runs({path: lines}, seconds)
    for line in (1, 5):  # the constant, and where it is used
        assert runs.tests_of(path, line) == ["a.py::quick", "b.py::t", "a.py::slow"]
    for file in ("a.py", "b.py"):
        (tmp_path / file).write_text("import module" if file == "b.py" else "")
    assert line_tests.Runs({}, seconds).tests_of(path, 5) == ["b.py::t"]
    monkeypatch.setattr(line_tests, "LIMIT", 4.0)
    assert runs.tests_of(path, 5) == ["a.py::quick", "b.py::t"]
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
