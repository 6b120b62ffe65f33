# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads how uncertain the numbers of a description are."""

import difflib
from collections.abc import Callable
from typing import Any

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import (
    Mechanism,
    MechanismError,
    UncertainNumber,
    Uncertainty,
)
from linkage_vibration.mechanics.keys import Keys
from linkage_vibration.mechanics.paths import number_at, number_paths, split_paths, with_numbers

_ROOTS = ("base", "damping", "ground", "links", "rigid_bodies", "springs")
_COUNTS = ("count", "elements", "modes")  # Counts are exact.
_STEP = 1e-4  # Differences are over this share of a standard deviation,
_LEAST_STEP = 1e-6  # and at least this share of the number, below which they are rounding.
_SINGULAR = 1e-9  # The correlations contradict one another below this eigenvalue.


def read_uncertainty(
    keys: Keys, mapping: dict[str, Any], parse: Callable[[dict[str, Any]], Mechanism]
) -> Uncertainty:
    """Read standard deviations and correlations of numbers.

    The keys are ``relative`` and ``absolute`` standard deviations by the paths of numbers, and
    ``correlations``, a list of ``between`` (two paths) and ``value``. The mapping is the
    description without them, and ``parse`` returns the mechanism of a changed description.
    """
    numbers: dict[str, UncertainNumber] = {}
    for kind in ("relative", "absolute"):
        for path in keys.names(kind):
            if path in numbers:
                raise keys[kind].error(path, "it is also under relative; give it once.")
            numbers[path] = _number(keys[kind], path, mapping, parse, relative=kind == "relative")
    _check_places(keys, list(numbers), mapping)
    correlation = _correlation(keys, list(numbers))
    kept = [i for i, number in enumerate(numbers.values()) if number.deviation > 0.0]
    rows = correlation[np.ix_(kept, kept)].tolist()
    uncertain = tuple(number for number in numbers.values() if number.deviation > 0.0)
    return Uncertainty(uncertain, tuple(map(tuple, rows)))


def _number(
    keys: Keys,
    path: str,
    mapping: dict[str, Any],
    parse: Callable[[dict[str, Any]], Mechanism],
    *,
    relative: bool,
) -> UncertainNumber:
    """Read the standard deviation of one number, and change the number a little."""
    deviation = keys.number(path)
    if deviation < 0.0:
        raise keys.error(path, f"{deviation:g} is negative; give a standard deviation.")
    if relative and deviation > 1.0:
        raise keys.error(path, f"{deviation:g} is more than the number itself; 5 % are 0.05.")
    places = split_paths(path)
    valid = [
        place
        for place in number_paths(mapping)
        if place.split(".")[0] in _ROOTS and place.split(".")[-1] not in _COUNTS
    ]
    for place in places:
        if place not in valid:
            near = difflib.get_close_matches(place, valid, 3, 0.0)
            raise keys.error(
                path,
                f"there is no number that can be uncertain at {place}; the paths that are most "
                f"like it are {', '.join(near)}.",
            )
        if ".file." in place:
            raise keys.error(
                path, "the file of a link is read as it is, so no number of it can be uncertain."
            )
    values = [float(number_at(mapping, place)) for place in places]
    if max(values) > min(values):
        raise keys.error(path, "its places hold different numbers; list each of them alone.")
    if relative and values[0] == 0.0:
        raise keys.error(path, "the number is 0, so that a share of it is 0; put it in absolute.")
    deviation *= abs(values[0]) if relative else 1.0
    step = max(_STEP * deviation, _LEAST_STEP * abs(values[0]))
    try:
        low, high = (
            parse(with_numbers(mapping, [(place, value) for place in places]))
            for value in (values[0] - step, values[0] + step)
        )
    except MechanismError as error:
        raise keys.error(path, f"the number cannot vary by {step:.3g} ({error}).") from None
    return UncertainNumber(path, values[0], deviation, step, relative, (low, high))


def _check_places(keys: Keys, paths: list[str], mapping: dict[str, Any]) -> None:
    """Refuse two paths that lead to one number, perhaps by an alias."""
    marks = [(place, float(i)) for i, path in enumerate(paths) for place in split_paths(path)]
    marked = with_numbers(mapping, marks)
    for place, mark in marks:
        other = int(number_at(marked, place))
        if other != mark:
            raise MechanismError(
                keys.path,
                f"{place} and {paths[other]} are one number, perhaps by an alias; remove one of "
                "them.",
            )


def _correlation(keys: Keys, paths: list[str]) -> FloatArray:
    """Read the correlations of the numbers, (n, n)."""
    matrix = np.eye(len(paths))
    for entry in keys.items("correlations") if "correlations" in keys else ():
        pair, value = entry.words("between"), entry.number("value")
        for path in pair:
            if path not in paths:
                near = difflib.get_close_matches(path, paths, 3, 0.0)
                raise entry.error(
                    "between",
                    f"{path} has no standard deviation; those that are most like it are "
                    f"{', '.join(near)}.",
                )
        if len(set(pair)) != 2:
            raise entry.error("between", "give two paths that differ.")
        i, j = (paths.index(path) for path in pair)
        if matrix[i, j] != 0.0:
            raise entry.error("between", "these two have a correlation already; remove one.")
        if not -1.0 < value < 1.0:
            raise entry.error("value", f"{value:g} is not between -1 and 1.")
        matrix[i, j] = matrix[j, i] = value
    values, vectors = np.linalg.eigh(matrix)
    if len(paths) and values[0] < _SINGULAR:
        involved = [
            path for path, share in zip(paths, vectors[:, 0], strict=True) if share**2 > 0.01
        ]
        raise keys.error(
            "correlations",
            f"those of {', '.join(involved)} contradict one another (the matrix has the eigenvalue "
            f"{values[0]:.2g}); bring their values nearer to 0.",
        )
    return matrix
