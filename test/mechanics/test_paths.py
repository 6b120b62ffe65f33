# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Paths lead to numbers in a description."""

import pytest

from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.paths import number_at, number_paths, split_paths, with_numbers

DATA = {
    "links": {
        "rod": {"length": 0.5, "modes": 3, "name": "a"},
        "bar": {"offsets": [0.1, 0.2], "free": True},
    }
}


def test_numbers_in_data() -> None:
    """Paths lead through mappings and lists; the original data stays as it was."""
    [first, second] = split_paths("links.bar.offsets.1, links.rod.modes")
    changed = with_numbers(DATA, [(first, 7.0), (second, 2)])
    assert (number_at(changed, first), number_at(changed, second)) == (7.0, 2)
    assert (number_at(DATA, first), number_at(DATA, second)) == (0.2, 3)
    with pytest.raises(MechanismError, match="no key 'none'"):
        number_at(DATA, "links.none.length")
    with pytest.raises(MechanismError, match="is not a number"):
        number_at(DATA, "links.rod")


def test_every_number_has_a_path() -> None:
    """Text and truth values have none."""
    actual = list(number_paths(DATA))
    offsets = [f"links.bar.offsets.{i}" for i in (0, 1)]
    assert actual == ["links.rod.length", "links.rod.modes", *offsets]
