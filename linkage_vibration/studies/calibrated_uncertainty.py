# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes what a calibration leaves uncertain into the text of a mechanism.

The section ``uncertainty`` of the mechanism gets the standard deviations of the fitted numbers, and
their correlations with one another and with the other uncertain numbers of the mechanism.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import yaml

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.paths import number_at, split_paths, with_numbers

KINDS = ("relative", "absolute")

_NEGLIGIBLE = 1e-3  # correlations below it are not written
_LEAST = 1e-6  # eigenvalue of the correlations that are written, which rounding keeps positive
_NOTE = "# `linkage-vibration calibrate` wrote this section.\n"


def other_claims(mapping: Mapping[str, Any], paths: Sequence[str]) -> dict[str, Any]:
    """Return a description's section ``uncertainty`` without the numbers of some paths.

    Numbers that the section names by an alias are left out, too.
    """
    claims = mapping.get("uncertainty", {})
    places = [place for path in paths for place in split_paths(path)]
    exact = {key: value for key, value in mapping.items() if key != "uncertainty"}
    marked = with_numbers(exact, [(place, math.nan) for place in places])
    names = {}  # of the numbers that stay, by their names now
    for kind in KINDS:
        for path in claims.get(kind, {}):
            kept = [p for p in split_paths(path) if not math.isnan(number_at(marked, p))]
            names[path] = ", ".join(kept)
    left: dict[str, Any] = {
        kind: {names[path]: value for path, value in claims.get(kind, {}).items() if names[path]}
        for kind in KINDS
    }
    left["correlations"] = [
        {"between": [names[path] for path in pair["between"]], "value": pair["value"]}
        for pair in claims.get("correlations", [])
        if all(names.get(path) for path in pair["between"])
    ]
    return {key: value for key, value in left.items() if value}


def with_fitted(
    claims: Mapping[str, Any],
    fitted: Sequence[str],
    others: Sequence[str],
    covariance: FloatArray,
) -> dict[str, Any]:
    """Return a section ``uncertainty``, which lacks the fitted numbers, with them.

    The covariance, (n, n), is that of the logarithms of the numbers of both lists of paths, each
    divided by its own standard deviation.
    """
    deviations = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviations, deviations)
    correlation[np.abs(correlation) < _NEGLIGIBLE] = 0.0
    least = float(np.linalg.eigvalsh(correlation)[0])
    if least < _LEAST:
        correlation *= (1.0 - _LEAST) / (1.0 - least)
    relative = dict(claims.get("relative", {}))
    relative |= {path: _digits(value) for path, value in zip(fitted, deviations, strict=False)}
    names = [*fitted, *others]
    n = len(fitted)
    pairs = [
        {"between": [names[i], names[j]], "value": round(float(correlation[i, j]), 8)}
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True)
        if correlation[i, j] != 0.0 and i < n
    ]
    section = {**claims, "relative": relative}
    pairs = [*claims.get("correlations", []), *pairs]
    return section | ({"correlations": pairs} if pairs else {})


def replace_section(
    text: str, claims: Mapping[str, Any], error: type[LinkageVibrationError]
) -> str:
    """Return the text of a mechanism with another section ``uncertainty``.

    The error is raised if the YAML file is one mapping in braces.
    """
    root: Any = yaml.compose(text, yaml.SafeLoader)
    if root.flow_style:
        raise error(
            "The mechanism is written in braces, so no section uncertainty can be added; write its "
            "first level as a block, one key on a line."
        )
    for key, value in root.value:
        if key.value == "uncertainty":
            end = text.find("\n", _end(value))
            text = text[: key.start_mark.index] + (text[end + 1 :] if end >= 0 else "")
    section = yaml.safe_dump(
        {"uncertainty": dict(claims)}, sort_keys=False, default_flow_style=None, width=100
    )
    return f"{text.rstrip()}\n\n{_NOTE}{section}"


def _end(node: Any) -> int:
    """Return where the text of a node ends, without the comments below it."""
    if isinstance(node, yaml.ScalarNode) or node.flow_style or not node.value:
        return int(node.end_mark.index)
    last = node.value[-1]
    return _end(last[1] if isinstance(node, yaml.MappingNode) else last)


def _digits(value: float) -> float:
    return float(f"{value:.3g}")
