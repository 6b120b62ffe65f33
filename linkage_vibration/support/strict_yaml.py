# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Loads YAML, and refuses what it would change silently, or what does not fit into memory."""

import itertools
import math
from contextlib import suppress
from typing import Any

import yaml

_ALWAYS = 10_000  # values that any text may hold
_SHALLOW = 2000  # beginnings of collections; the loader in C ends the process at some depth
_INT, _FLOAT, _MERGE = (f"tag:yaml.org,2002:{kind}" for kind in ("int", "float", "merge"))


def load_yaml_text(text: str) -> Any:
    """Return plain data; a YAMLError, or another exception, says why a text has none."""
    # The loader in C also accepts tabs that other readers of the same text do not.
    if "\t" not in text and sum(map(text.count, "[{-?")) < _SHALLOW:
        with suppress(yaml.YAMLError):
            return yaml.load(text, _QuickLoader)
    return yaml.load(text, _StrictLoader)  # whose errors say more


def refuse_unbounded(root: yaml.Node) -> None:
    """Refuse more values than characters after expanding aliases, or a value that holds itself."""
    limit = max(_ALWAYS, root.end_mark.index)
    if _unfolded(root, {}) > limit:
        problem = f"with its aliases (*) expanded it holds more than {limit} values"
        raise yaml.MarkedYAMLError(problem=problem, problem_mark=root.start_mark)


def _unfolded(node: yaml.Node, counts: dict[yaml.Node, float]) -> float:
    """Count the values below a node with aliases expanded; infinite if it contains itself."""
    if node not in counts:
        counts[node] = math.inf
        below = node.value if isinstance(node, yaml.CollectionNode) else []
        pairs = [pair if isinstance(pair, tuple) else (pair,) for pair in below]
        counts[node] = 1.0 + sum(_unfolded(value, counts) for pair in pairs for value in pair)
    return counts[node]


def _error(problem: str, node: yaml.Node) -> yaml.YAMLError:
    return yaml.constructor.ConstructorError(None, None, problem, node.start_mark)


def _number(loader: Any, node: Any) -> float:
    """Return a number that a float can hold, and that YAML reads as people do."""
    whole = node.tag == _INT
    value = loader.construct_yaml_int(node) if whole else loader.construct_yaml_float(node)
    digits = node.value.lstrip("+-")
    if ":" in digits or (whole and digits[0] == "0" and digits[1:2].isdecimal()):
        hint = "write a decimal number without a colon or a zero before it"
        raise _error(f"YAML reads {node.value} as {value:g}; {hint}", node)
    try:
        float(value)
    except OverflowError:
        raise _error("the number is too large", node) from None
    return value if isinstance(value, float) else int(value)


class _Strict(yaml.constructor.SafeConstructor):
    """Loads plain data of bounded size; a repeated key, which YAML drops silently, is an error."""

    yaml_constructors = yaml.constructor.SafeConstructor.yaml_constructors | {
        _INT: _number,
        _FLOAT: _number,
    }

    def construct_document(self, node: Any) -> Any:
        refuse_unbounded(node)
        return super().construct_document(node)

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ArithmeticError, LookupError, ValueError) as error:
            raise _error(f"{node.value!r} does not fit its tag ({error})", node) from None

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        for (_, before), (key, value) in itertools.pairwise(node.value):
            tags = before.tag.rpartition(":")[2], value.tag.rpartition(":")[2]
            if tags == ("int", "null") and str(key.value).isdecimal():
                number = f"{before.value}.{key.value}"
                hint = f"a comma ends a number; write {number} with a decimal point"
                raise _error(hint, key)
        return super().construct_mapping(node, deep)

    def flatten_mapping(self, node: Any) -> None:
        """Merge (<<): own keys count most, then those of earlier mappings, in each PyYAML alike."""
        own, merged = dict[Any, Any](), dict[Any, Any]()
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else id(key)
            if name in own:
                raise _error(f"the key {name!r} occurs twice; remove one", key)
            own[name] = key, value
        if "<<" in own and own["<<"][0].tag == _MERGE:
            _, value = own.pop("<<")
            for part in value.value if isinstance(value, yaml.SequenceNode) else [value]:
                if not isinstance(part, yaml.MappingNode):
                    raise _error("only mappings can be merged (<<)", part)
                self.flatten_mapping(part)
                merged = {key.value: (key, value) for key, value in part.value} | merged
        node.value = list((merged | own).values())


class _QuickLoader(_Strict, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """The loader in C, which takes a tenth of the time."""


class _StrictLoader(_Strict, yaml.SafeLoader):
    """The loader in Python."""
