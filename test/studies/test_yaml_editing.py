# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers in a YAML file are replaced without a change of its comments and its layout."""

import pytest
import yaml

from linkage_vibration.studies.calibration import CalibrationError
from linkage_vibration.studies.yaml_editing import edit_text

TEXT = """\
# a comment
links:
  rod: {length: &l 0.5, modes: 3}  # flow
  bar:
    length: *l
    offsets: [0.1, 0.2]
"""


@pytest.mark.parametrize(
    ("keys", "words", "line"),
    [
        (("links", "rod", "length"), ["0.7"], "  rod: {length: &l 0.7, modes: 3}  # flow"),
        (("links", "bar", "length"), ["0.7"], "  rod: {length: &l 0.7, modes: 3}  # flow"),
        (("links", "bar", "offsets"), ["1", "2.5"], "    offsets: [1, 2.5]"),
        (("links", "bar", "offsets", "1"), ["2e-07"], "    offsets: [0.1, 2.0e-07]"),
        (("links", "rod", "mass"), ["4"], "  rod: {mass: 4, length: &l 0.5, modes: 3}  # flow"),
        (("links", "bar", "range"), ["1", "2"], "    range: [1, 2]"),
        (
            ("links", "rod", "modes"),
            ["1", "2e-07"],
            "  rod: {length: &l 0.5, modes: [1, 2.0e-07]}  # flow",
        ),
    ],
)
def test_only_the_number_changes(keys: tuple[str, ...], words: list[str], line: str) -> None:
    """A number is replaced or added; all other lines stay."""
    lines = edit_text(TEXT, [(keys, words)], CalibrationError).splitlines()
    changed = [new for new in lines if new not in TEXT.splitlines()]
    assert changed == [line]
    assert [old for old in TEXT.splitlines() if old in lines] == [x for x in lines if x != line]


def test_alias_ties_two_numbers() -> None:
    """Two paths to one number may get the same number, but not two."""
    same = [(("links", name, "length"), ["0.7"]) for name in ("rod", "bar")]
    assert yaml.safe_load(edit_text(TEXT, same, CalibrationError))["links"]["bar"]["length"] == 0.7
    with pytest.raises(CalibrationError, match=r"links.*length are one number in the file"):
        edit_text(TEXT, [same[0], (("links", "bar", "length"), ["0.8"])], CalibrationError)
