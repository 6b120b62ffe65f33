# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers in a YAML file are replaced without a change of its comments and its layout."""

import pytest
import yaml

from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.studies.calibration import CalibrationError
from linkage_vibration.studies.yaml_editing import edit_text, number_at, split_paths, with_numbers

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


def test_numbers_in_data() -> None:
    """Paths lead through mappings and lists; the original data stays as it was."""
    data = yaml.safe_load(TEXT)
    [first, second] = split_paths("links.bar.offsets.1, links.rod.modes")
    changed = with_numbers(data, [(first, 7.0), (second, 2)])
    assert (number_at(changed, first), number_at(changed, second)) == (7.0, 2)
    assert (number_at(data, first), number_at(data, second)) == (0.2, 3)
    with pytest.raises(MechanismError, match="no key 'none'"):
        number_at(data, "links.none.length")
    with pytest.raises(MechanismError, match="is not a number"):
        number_at(data, "links.rod")


MERGED = """\
steel: &steel {material: {density: 7800.0, modulus: 2.1e+11}, width: 0.05}
rod: {<<: *steel, height: 0.1}
bar:
  <<: [*steel]
  height: 0.2
"""


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        (("rod", "width"), "rod: {width: 0.06, <<: *steel, height: 0.1}"),
        (("bar", "width"), "  width: 0.06"),
        (("bar", "height"), "  height: 0.06"),
        (("steel", "width"), MERGED.splitlines()[0].replace("0.05", "0.06")),
        (("bar", "material", "density"), MERGED.splitlines()[0].replace("7800.0", "0.06")),
    ],
)
def test_merge_keys(keys: tuple[str, ...], line: str) -> None:
    """A merged number gets a key of its own; a merged mapping is one for all, as in the data."""
    text = edit_text(MERGED, [(keys, ["0.06"])], CalibrationError)
    assert [new for new in text.splitlines() if new not in MERGED.splitlines()] == [line]
    data = with_numbers(yaml.safe_load(MERGED), [(".".join(keys), 0.06)])
    read = yaml.safe_load(text)
    if keys[0] != "steel":  # merged numbers are copies in data that has been read
        assert read == data
    assert number_at(read, ".".join(keys)) == 0.06
