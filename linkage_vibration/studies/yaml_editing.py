# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads and replaces numbers of a YAML file, in the data read from it and in its text.

A parameter is named by its path: keys joined by dots, with positions in lists counted from 0, as in
``links.coupler.sections.1.height``. Several paths, joined by commas, share one number.
"""

import copy
import functools
import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import yaml

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import MechanismError


def split_paths(path: str) -> tuple[str, ...]:
    """Return the paths that a parameter's name consists of."""
    return tuple(part.strip() for part in path.split(","))


def number_at(mapping: Any, path: str) -> float:
    """Return the number at a path in a description.

    Parameters
    ----------
    mapping : Any
        The description, as read from YAML.
    path : str

    Raises
    ------
    MechanismError
        If the path does not lead to a number.
    """
    below = mapping
    for key in path.split("."):
        try:
            below = _below(below, key)
        except (KeyError, IndexError, ValueError, TypeError):
            raise MechanismError(
                f"parameters.{path}", f"the mechanism has no key {key!r} there; check the path."
            ) from None
    if isinstance(below, bool) or not isinstance(below, int | float):
        what = f"{below!r} is not a number; give the path of a number."
        raise MechanismError(f"parameters.{path}", what)
    return below


def with_numbers(mapping: dict[str, Any], numbers: Iterable[tuple[str, float]]) -> dict[str, Any]:
    """Return a copy of a description with other numbers.

    Parameters
    ----------
    mapping : dict
        The description, as read from YAML.
    numbers : iterable of (path, number)
        The new numbers; each path has to exist.
    """
    changed = copy.deepcopy(mapping)
    for path, number in numbers:
        *keys, last = path.split(".")
        parent = functools.reduce(_below, keys, changed)
        parent[int(last) if isinstance(parent, list) else last] = number
    return changed


def edit_text(
    text: str,
    numbers: Iterable[tuple[Sequence[str], Sequence[str]]],
    error: type[LinkageVibrationError],
) -> str:
    """Replace numbers in the text of a YAML file, and keep its comments and its layout.

    Parameters
    ----------
    text : str
        The text of the file.
    numbers : iterable of (keys, words)
        The keys that lead to a number or to a list of numbers, and the new numbers as text. If the
        file lacks the last key, it is added before the first key beside it.
    error : type
        What to raise if an alias in the file ties together two numbers that are to differ.
    """
    root = yaml.compose(text, yaml.SafeLoader)
    edits = {  # an alias leads to the place of its anchor, so two paths may yield the same edit
        edit: ".".join(keys) for keys, words in numbers for edit in _edits(root, keys, words)
    }
    replaced = sorted(edit for edit in edits if edit[0] < edit[1])
    for one, other in itertools.pairwise(replaced):
        if one[0] == other[0]:
            raise error(
                f"{edits[one]} and {edits[other]} are one number in the file, through an alias, so "
                f"they cannot become {one[2]} and {other[2]}; write a number of its own for each."
            )
    for start, end, word in sorted(edits, reverse=True):
        text = text[:start] + word + text[end:]
    return text


def _edits(root: Any, keys: Sequence[str], words: Sequence[str]) -> Iterator[tuple[int, int, str]]:
    """Yield the start and the end of each text to replace, and the new text."""
    # YAML 1.1 reads 1e-05 as text, but 1.0e-05 as a number.
    words = [word if "." in word else word.replace("e", ".0e") for word in words]
    parent = functools.reduce(_node_below, keys[:-1], root)
    # A number from a merge key (<<) is not replaced there: its own key beside it overrides it.
    old = _node_below(parent, keys[-1], merged=False)
    if old is None:
        first = parent.value[0][0].start_mark
        value = words[0] if len(words) == 1 else f"[{', '.join(words)}]"
        after = ", " if parent.flow_style else "\n" + " " * first.column
        yield first.index, first.index, f"{keys[-1]}: {value}{after}"
        return
    scalars = old.value if isinstance(old, yaml.SequenceNode) else [old]
    for scalar, word in zip(scalars, words, strict=True):
        # The mark of a number with an anchor begins at the anchor, so this counts from the end.
        end = scalar.end_mark.index
        yield end - len(scalar.value), end, word


def _below(data: Any, key: str) -> Any:
    return data[int(key) if isinstance(data, list) else key]


def _node_below(node: Any, key: str, *, merged: bool = True) -> Any:
    """Return the node of a key, also if a merge key (<<) provides it, or None."""
    if isinstance(node, yaml.SequenceNode):
        return node.value[int(key)]
    sources: list[Any] = []
    for name, value in node.value:
        if name.tag == "tag:yaml.org,2002:merge":
            sources += value.value if isinstance(value, yaml.SequenceNode) else [value]
        elif name.value == key:
            return value
    found = (_node_below(source, key) for source in sources if merged)
    return next((value for value in found if value is not None), None)
