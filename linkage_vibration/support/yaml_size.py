# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A bound on what YAML may unfold to: aliases of aliases let a page hold more than memory."""

import math

import yaml

_ALWAYS = 10_000  # values


def refuse_unbounded(root: yaml.Node) -> None:
    """Refuse a text whose aliases repeat more values than the text has characters.

    Raises
    ------
    yaml.MarkedYAMLError
        If they do, or if a value holds itself.
    """
    limit = max(_ALWAYS, root.end_mark.index)
    if _unfolded(root, {}) > limit:
        raise yaml.MarkedYAMLError(
            problem=f"with its aliases (*) written out it holds more than {limit} values",
            problem_mark=root.start_mark,
        )


def _unfolded(node: yaml.Node, known: dict[yaml.Node, float]) -> float:
    """Count the values below a node, as often as aliases repeat them; infinite within itself."""
    if node not in known:
        known[node] = math.inf
        below = node.value if isinstance(node, yaml.CollectionNode) else []
        pairs = [pair if isinstance(pair, tuple) else (pair,) for pair in below]
        known[node] = 1.0 + sum(_unfolded(value, known) for pair in pairs for value in pair)
    return known[node]
