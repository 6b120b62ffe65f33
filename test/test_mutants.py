# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The changes that benchmark/mutants.py draws, and the tests that it runs for them."""

from pathlib import Path

import pytest

from benchmark import mutants

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


def test_what_is_named_exists() -> None:
    """A module without a file, or without tests, ends the study; the nearest tests come first."""
    verdict = Path("linkage_vibration/prediction/verdict.py")
    assert mutants.tests_of(verdict)[0][0] == "test/prediction/test_verdict.py"
    for module in ("linkage_vibration/prediction/none.py", "linkage_vibration/none/verdict.py"):
        with pytest.raises(SystemExit, match=r"none.* do not exist"):
            mutants.tests_of(Path(module))


def test_rooms_are_weighted_by_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rooms with 30 and 70 % of the code have 3 and 7 of ten changes; other files have none."""
    same = mutants.Mutant(Path("code.py"), 1, 0, 0, "")
    monkeypatch.setattr(mutants, "mutants", lambda *_: [same] * 10)
    code = {".": (90, 90), "bags": (90, 30), "cli": (90, 70)}
    monkeypatch.setattr(mutants, "by_room", lambda: code)
    assert {room: len(few) for room, few in mutants.drawn(10, 3).items()} == {"bags": 3, "cli": 7}
