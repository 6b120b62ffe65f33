# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Replaces numbers in the text of a YAML file, and keeps its comments and its layout."""

import functools
import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import yaml

from linkage_vibration.errors import LinkageVibrationError


def edit_text(
    text: str,
    numbers: Iterable[tuple[Sequence[str], Sequence[str]]],
    error: type[LinkageVibrationError],
) -> str:
    """Replace numbers in the text of a YAML file, and keep its comments and its layout.

    Each entry has the keys of a number or a list, and the new words; a last key that is missing is
    added before the first one beside it. The error says that an alias ties two such numbers.
    """
    root = yaml.compose(text, yaml.SafeLoader)
    edits = {  # an alias leads to the place of its anchor, so two paths may yield the same edit
        edit: ".".join(keys) for keys, words in numbers for edit in _edits(root, keys, words)
    }
    replaced = sorted(edit for edit in edits if edit[0] < edit[1])
    for first, second in itertools.pairwise(replaced):
        if first[0] == second[0]:
            problem = f"{edits[first]} and {edits[second]} are one number in the file, by an alias"
            hint = f"write one for each, as they become {first[2]} and {second[2]}"
            raise error(f"{problem}; {hint}.")
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
    if isinstance(old, yaml.ScalarNode) and len(words) > 1:  # one number becomes a list
        end = old.end_mark.index
        yield end - len(old.value), end, f"[{', '.join(words)}]"
        return
    scalars = old.value if isinstance(old, yaml.SequenceNode) else [old]
    for scalar, word in zip(scalars, words, strict=True):
        # The mark of a number with an anchor begins at the anchor, so this counts from the end.
        end = scalar.end_mark.index
        yield end - len(scalar.value), end, word


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
    nodes = (_node_below(source, key) for source in sources if merged)
    return next((value for value in nodes if value is not None), None)
