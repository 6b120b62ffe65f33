# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes what a calibration leaves uncertain into the text of a mechanism.

The section ``uncertainty`` of the mechanism gets the standard deviations of all uncertain numbers
and their correlations.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import yaml

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.mechanics.paths import number_at, split_paths, with_numbers

KINDS = ("relative", "absolute")

_NEGLIGIBLE = 1e-3  # correlations below it are not written
_LEAST = 1e-6  # eigenvalue of the correlations that are written, which rounding keeps positive
_NOTE = "# `linkage-vibration calibrate` wrote this section.\n"


def prior_section(mapping: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Return a description's section ``uncertainty`` in which parameters have their own names.

    A parameter takes the deviation of any of its places, also if the section names it by an alias.
    Other places of that number keep a deviation of their own.
    """
    claims = mapping.get("uncertainty", {})
    exact = {key: value for key, value in mapping.items() if key != "uncertainty"}
    marked = {
        name: with_numbers(exact, [(at, math.nan) for at in split_paths(name)]) for name in names
    }
    prior: dict[str, Any] = {kind: {} for kind in KINDS}
    renamed = {}
    for kind in KINDS:
        for path, value in claims.get(kind, {}).items():
            rest, new = list(split_paths(path)), []
            for name, other in marked.items():
                kept = [place for place in rest if not math.isnan(number_at(other, place))]
                new += [name] * (len(kept) < len(rest))
                rest = kept
            new += [", ".join(rest)] * bool(rest)
            new = [name for name in new if not any(name in prior[each] for each in KINDS)]
            prior[kind] |= dict.fromkeys(new, value)
            renamed[path] = next(iter(new), "")
    prior["correlations"] = [
        {"between": [renamed[path] for path in pair["between"]], "value": pair["value"]}
        for pair in claims.get("correlations", [])
        if all(renamed[path] for path in pair["between"])
    ]
    return {key: value for key, value in prior.items() if value}


def posterior_section(
    names: Sequence[str], relative: Sequence[bool] | BoolArray, covariance: FloatArray
) -> dict[str, Any]:
    """Return a section ``uncertainty`` of a covariance, (n, n), by logarithms where relative."""
    deviations = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviations, deviations)
    correlation[np.abs(correlation) < _NEGLIGIBLE] = 0.0
    least = float(np.linalg.eigvalsh(correlation)[0])
    if least < _LEAST:
        correlation *= (1.0 - _LEAST) / (1.0 - least)
    section: dict[str, Any] = {kind: {} for kind in KINDS}
    for name, share, deviation in zip(names, relative, deviations.tolist(), strict=True):
        # A mechanism takes no relative deviation above 1.
        kind, value = (KINDS[0], min(deviation, 1.0)) if share else (KINDS[1], deviation)
        section[kind][name] = float(f"{value:.6g}")
    section["correlations"] = [
        {"between": [names[i], names[j]], "value": round(float(correlation[i, j]), 8)}
        for i, j in itertools.combinations(range(len(names)), 2)
        if correlation[i, j] != 0.0
    ]
    return {key: value for key, value in section.items() if value}


def replace_section(
    text: str, claims: Mapping[str, Any], error: type[LinkageVibrationError]
) -> str:
    """Return a mechanism's text, which is not all in braces, with another ``uncertainty``."""
    root: Any = yaml.compose(text, yaml.SafeLoader)
    if root.flow_style:
        raise error("The mechanism is in braces; write its first level with one key on a line.")
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
