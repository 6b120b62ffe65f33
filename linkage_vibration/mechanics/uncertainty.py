# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads how uncertain the numbers of a description are."""

import difflib
import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.mechanics.description import (
    Mechanism,
    MechanismError,
    UncertainNumber,
    Uncertainty,
)
from linkage_vibration.mechanics.keys import CheckedMapping
from linkage_vibration.mechanics.paths import (
    Data,
    number_at,
    number_paths,
    refuse_shared,
    split_paths,
    with_numbers,
)

Parse = Callable[[Data], Mechanism]
"""Returns the mechanism of a changed description."""

INTERVAL = 1.96
"""Standard deviations that an interval of 95 % reaches to either side."""

_ROOTS = ("base", "damping", "ground", "lateral", "links", "rigid_bodies", "springs")
_COUNTS = ("count", "elements", "modes")
_STEP = 1e-4  # Differences are over this share of a standard deviation,
_LEAST_STEP = 1e-6  # and at least this share of the number, below which they are rounding.
_ROWS = 32  # pairs of members, at least
_MOST_ALIKE = 16  # columns of so many pairs, so that amplitudes of loads have others
_SINGULAR = 1e-9  # The correlations contradict one another below this eigenvalue.


def across(uncertainty: Uncertainty) -> BoolArray:
    """Return on which numbers, (n,), no vertical mode depends; y changes lengths of links."""
    paths = [split_paths(number.path) for number in uncertainty.numbers]
    return np.array([all(map(_is_across, each)) for each in paths], dtype=bool)


def _is_across(path: str) -> bool:
    own = path.startswith("lateral.") and not path.startswith("lateral.y.")
    return own or path.endswith(".track")


def paired_draws(uncertainty: Uncertainty, seed: int) -> FloatArray:
    """Return draws of n numbers, in standard deviations, for m pairs of members, (2, m, n).

    They have the variance 1 and no correlations. The second of a pair has the opposite draws. More
    than m numbers would need more pairs, so it has the same draws of those that are known best.
    """
    numbers, random = uncertainty.numbers, np.random.default_rng(seed)
    share = [each.deviation / (abs(each.value) or each.deviation) for each in numbers]
    n = min(max(len(numbers) - _ROWS, 0), _MOST_ALIKE)
    alike, opposite = (np.sort(each) for each in np.split(np.argsort(share, kind="stable"), [n]))
    m = max(len(opposite), _ROWS)
    draws = np.empty((2, m, len(numbers)))
    rotation = np.linalg.qr(random.standard_normal((m, m)))[0][:, : len(opposite)]
    draws[:, :, opposite] = math.sqrt(m) * rotation * [[[1.0]], [[-1.0]]]
    draws[:, :, alike] = balanced(random, np.ones((m, 1)), n)
    return draws


def balanced(random: np.random.Generator, taken: FloatArray, n: int) -> FloatArray:
    """Return random numbers, (m, n), of mean square 1, not correlated with those taken, (m, k)."""
    normal, basis = random.standard_normal((len(taken), n)), np.linalg.qr(taken)[0]
    rest = np.linalg.qr(normal - basis @ (basis.T @ normal))[0]
    return np.asarray(math.sqrt(len(taken)) * rest)


def read_uncertainty(keys: CheckedMapping, mapping: Data, parse: Parse) -> Uncertainty:
    """Read the deviations of numbers and correlations; ``parse`` reads a changed mapping."""
    numbers: dict[str, UncertainNumber] = {}
    # Counts are exact, and the file of a link is read as it is.
    split = [place.split(".") for place in number_paths(mapping)]
    free = [parts for parts in split if parts[-1] not in _COUNTS and "file" not in parts]
    valid = [".".join(parts) for parts in free if parts[0] in _ROOTS]
    for kind in ("relative", "absolute"):
        for path in keys.names(kind):
            if path in numbers:
                raise keys[kind].error(path, "it is also under relative; give it once.")
            numbers[path] = _number(keys[kind], path, mapping, valid, relative=kind == "relative")
    refuse_shared(mapping, list(numbers), keys.path)
    try:
        _vary(mapping, list(numbers.values()), parse)  # at once, as that takes some milliseconds
    except MechanismError:
        for path, number in numbers.items():
            try:
                _vary(mapping, [number], parse)
            except MechanismError as error:
                problem = f"the number cannot vary by {number.step:.3g} ({error})."
                kind = "relative" if number.relative else "absolute"
                raise keys[kind].error(path, problem) from None
    correlation = _correlation(keys, list(numbers))
    kept = [i for i, number in enumerate(numbers.values()) if number.deviation > 0.0]
    rows = correlation[np.ix_(kept, kept)].tolist()
    uncertain = tuple(number for number in numbers.values() if number.deviation > 0.0)
    # Another process builds the table of another implement, so a mechanism has to be picklable.
    described = partial(_described, mapping, [split_paths(each.path) for each in uncertain], parse)
    return Uncertainty(uncertain, tuple(map(tuple, rows)), described)


def _described(
    mapping: Data, paths: list[tuple[str, ...]], parse: Parse, values: Sequence[float]
) -> Mechanism:
    """Return the mechanism with other values of the numbers at paths."""
    both = zip(paths, values, strict=True)
    return parse(with_numbers(mapping, [(path, value) for same, value in both for path in same]))


def _number(
    keys: CheckedMapping, path: str, mapping: Data, valid: Sequence[str], *, relative: bool
) -> UncertainNumber:
    """Read the standard deviation of one number, which is at valid paths."""
    hint = "5 % of the number are 0.05" if relative else "give a standard deviation"
    deviation = keys.number(path, least=0.0, most=1.0 if relative else math.inf, hint=hint)
    places = split_paths(path)
    for place in places:
        if place not in valid:
            near = f"the paths that are most like it are {_most_like(place, valid)}"
            raise keys.error(path, f"no number that can be uncertain is at {place}; {near}.")
    values = [float(number_at(mapping, place)) for place in places]
    if max(values) > min(values):
        raise keys.error(path, "its places hold different numbers; list each of them alone.")
    if relative and values[0] == 0.0:
        raise keys.error(path, "the number is 0, so that a share of it is 0; put it in absolute.")
    deviation *= abs(values[0]) if relative else 1.0
    step = max(_STEP * deviation, _LEAST_STEP * abs(values[0]))
    return UncertainNumber(path, values[0], deviation, step, relative)


def _vary(mapping: Data, numbers: Sequence[UncertainNumber], parse: Parse) -> None:
    """Parse a mapping whose numbers are changed by their steps, up and down in turn, and back."""
    paths = [split_paths(each.path) for each in numbers]
    for sign in (-1.0, 1.0):
        values = [each.value + sign * (-1.0) ** i * each.step for i, each in enumerate(numbers)]
        _described(mapping, paths, parse, values)


def _most_like(path: str, paths: Sequence[str]) -> str:
    return ", ".join(difflib.get_close_matches(path, paths, 3, 0.0))


def _correlation(keys: CheckedMapping, paths: list[str]) -> FloatArray:
    """Read the correlations of the numbers, (n, n)."""
    matrix = np.eye(len(paths))
    for entry in keys.items("correlations") if "correlations" in keys else ():
        pair = entry.words("between")
        value = entry.number("value", least=-1.0, most=1.0, hint="it is between -1 and 1")
        for path in pair:
            if path not in paths:
                near = f"those that are most like it are {_most_like(path, paths)}"
                raise entry.error("between", f"{path} has no standard deviation; {near}.")
        if len(set(pair)) != 2:
            raise entry.error("between", "give two paths that differ.")
        i, j = (paths.index(path) for path in pair)
        if matrix[i, j] != 0.0:
            raise entry.error("between", "these two have a correlation already; remove one.")
        matrix[i, j] = matrix[j, i] = value
    values, vectors = np.linalg.eigh(matrix)
    if len(paths) and values[0] < _SINGULAR:
        involved = ", ".join(np.array(paths)[vectors[:, 0] ** 2 > 0.01])
        hint = f"(the matrix has the eigenvalue {values[0]:.2g}); bring their values nearer to 0"
        raise keys.error("correlations", f"those of {involved} contradict one another {hint}.")
    return matrix
