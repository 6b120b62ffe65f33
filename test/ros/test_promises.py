# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The list of promises: each has a test, a sentence, and the section of a page that makes it."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TESTS = sorted((ROOT / "test" / "ros" / "promises").glob("test_*.py"))


def promises() -> list[tuple[str, str, str]]:
    """Return name, place and sentence of each promise."""
    found = []
    for path in TESTS:
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                [call] = [
                    each
                    for each in node.decorator_list
                    if isinstance(each, ast.Call) and ast.unparse(each.func) == "promise"
                ]
                sentence = (ast.get_docstring(node) or "").splitlines()[0]
                found.append((node.name, ast.literal_eval(call.args[0]), sentence))
    return found


def sections(page: str) -> set[str]:
    """Return the anchors of a page."""
    headings = re.findall(r"^#+ (.+)$", (ROOT / "docs" / page).read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize(("name", "place", "sentence"), promises())
def test_promise_has_a_section(name: str, place: str, sentence: str) -> None:
    """The section exists, and the sentence is complete."""
    page, _, section = place.partition("#")
    assert page in ("node.md", "start_the_node.md", "services.md", "can.md")
    assert not section or section in sections(page)
    assert sentence.endswith((".", "?"))


def test_each_promise_has_one_sentence() -> None:
    """No two tests have the same sentence, as the table has one row for each."""
    sentences = [sentence for _, _, sentence in promises()]
    assert len(set(sentences)) == len(sentences) >= 60
