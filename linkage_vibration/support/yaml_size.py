# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Refuses YAML whose aliases expand to more data than fits into memory."""

import math

import yaml

_ALWAYS = 10_000  # values that any text may hold


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
