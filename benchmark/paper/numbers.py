# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Every number that the paper prints, with its place in the paper, from ``numbers.csv``.

G. Brunetti, W. D'Ambrogio, A. Fregolent, "Configuration-Dependent Substructuring as a Tool to
Predict the Vibrational Response of Mechanisms", Machines 2022, 10(12), 1146. It prints neither
cross-sections nor damping.
"""

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from linkage_vibration.mechanics.arrays import FloatArray

SOURCE = "Brunetti, D'Ambrogio, Fregolent, Machines 2022, 10(12), 1146"
GEOMETRY = "geometry."
SUBSTRUCTURING = "natural_frequencies_hz.at_140_deg.substructuring."
OVER_THE_SWEEP = "natural_frequencies_hz.over_the_sweep."
"""How the keys of some numbers begin."""


@dataclass(frozen=True, slots=True)
class Number:
    """One printed number."""

    key: str  # our number has the same key
    quantity: str
    value: float  # as printed
    unit: str  # empty for counts and ratios
    source: str  # table or section of the paper
    place: str  # the path in the description of a linkage of those in Table 1


@cache
def printed_numbers(start: str = "") -> tuple[Number, ...]:
    """Return the printed numbers whose keys begin so."""
    with Path(__file__).with_name("numbers.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))[1:]
    return tuple(
        Number(key, quantity, float(value), *about)
        for key, quantity, value, *about in rows
        if key.startswith(start)
    )


def frequencies(over: FloatArray, at_140: FloatArray) -> dict[str, float]:
    """Return natural frequencies in Hz, (n, 3) over the stroke and at 140 deg, by printed keys."""
    ends = [*over[[0, -1], 0], *over[[0, -1], 1], over[:, 2].min(), over[:, 2].max()]
    numbers = printed_numbers("natural_frequencies_hz.")
    pairs = zip(numbers, [*at_140[:3], *at_140[:3], *ends], strict=True)
    return {number.key: float(value) for number, value in pairs}
