# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers in a description by their paths, in the data read from YAML.

A number is named by its path: keys joined by dots, with positions in lists counted from 0, as in
``links.coupler.sections.1.height``. Several paths, joined by commas, share one number.
"""

import copy
import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from linkage_vibration.mechanics.description import MechanismError

Data = dict[str, Any]
"""A description, as read from YAML."""


def split_paths(path: str) -> tuple[str, ...]:
    """Return the paths that a parameter's name consists of."""
    return tuple(part.strip() for part in path.split(","))


def number_at(mapping: Any, path: str) -> float:
    """Return the number at a path in a description, as read from YAML."""
    below = mapping
    for key in path.split("."):
        try:
            below = _below(below, key)
        except (KeyError, IndexError, ValueError, TypeError):
            problem = f"the mechanism has no key {key!r} there; check the path."
            raise MechanismError(f"parameters.{path}", problem) from None
    if isinstance(below, bool) or not isinstance(below, int | float):
        what = f"{below!r} is not a number; give the path of a number."
        raise MechanismError(f"parameters.{path}", what)
    return below


def with_numbers(mapping: Data, numbers: Iterable[tuple[str, float]]) -> Data:
    """Return a copy of a description with other numbers at paths, each of which has to exist."""
    changed = copy.deepcopy(mapping)
    for path, number in numbers:
        *keys, last = path.split(".")
        parent = functools.reduce(_below, keys, changed)
        parent[int(last) if isinstance(parent, list) else last] = number
    return changed


def refuse_shared(mapping: Data, names: Sequence[str], where: str) -> None:
    """Refuse two parameters that are one number, perhaps by an alias."""
    marks = [(path, float(i)) for i, name in enumerate(names) for path in split_paths(name)]
    for path, _ in marks:
        number_at(mapping, path)  # it has to exist
    marked = with_numbers(mapping, marks)
    for path, mark in marks:
        other = int(number_at(marked, path))
        if other != mark:
            problem = "are one number, perhaps by an alias; remove one of them"
            raise MechanismError(where, f"{path} and {names[other]} {problem}.")


def number_paths(data: Any, above: str = "") -> Iterator[str]:
    """Yield the path of every number in a description; `above` is the path of a part, with a dot.

    >>> list(number_paths({"ground": {"P1": [0.0, 1.0]}, "name": "crank"}))
    ['ground.P1.0', 'ground.P1.1']
    """
    if isinstance(data, Mapping | list | tuple):
        pairs = data.items() if isinstance(data, Mapping) else enumerate(data)
        for key, value in pairs:
            yield from number_paths(value, f"{above}{key}.")
    elif isinstance(data, int | float) and not isinstance(data, bool):
        yield above[:-1]


def _below(data: Any, key: str) -> Any:
    return data[int(key) if isinstance(data, list) else key]
