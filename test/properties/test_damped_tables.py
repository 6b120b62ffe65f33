# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of random linkages with random dampers are never silently wrong.

A few are tried at every run, and ten thousand by ``pytest -m nightly test/properties``.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.table.table import TableError
from linkage_vibration.table.tabulation import build_table

from .linkages import Linkage, linkages

FEW, MANY = 3, 10_000
ANGLES = 10


@pytest.mark.parametrize("examples", [FEW, pytest.param(MANY, marks=pytest.mark.nightly)])
def test_tables_agree_with_the_eigenvalues(examples: int) -> None:
    """At random angles each mode is an eigenvalue of the model, within twice the reported error."""
    power = st.floats(-2.0, 5.0)  # of ten, N m s/rad
    tried = settings(
        max_examples=examples, derandomize=examples == FEW, database=None, deadline=None
    )
    tried(given(linkages(), power, st.integers(0, 2**32 - 1))(_agree))()


def _agree(linkage: Linkage, power: float, seed: int) -> None:
    mapping, middle = linkage.copy().mapping, linkage.alpha3_deg
    if "factor" in mapping["damping"]:  # viscous and structural damping do not mix
        mapping["damping"] = {"ratio": 0.01, "at_hz": [20.0, 500.0]}
    mapping["springs"]["damper"] = {"joint": "B", "damping": 10.0**power}
    mapping["input"]["range_deg"] = [middle - 4.0, middle + 4.0]
    model = LinkageModel(mechanism_from_mapping(mapping))
    try:
        table = build_table(model, 1e-4)
    except TableError as error:
        assert "; " in str(error)  # what to change
        return
    n = table.n_modes
    for angle in np.random.default_rng(seed).uniform(*table.alpha3_range, ANGLES).tolist():
        row = table.evaluate(np.array([angle]))[0]
        known = np.isfinite(row[:n])
        solution = model.solve(angle)
        exact = np.array([solution.natural_frequencies, solution.damping_ratios])
        found = np.array([row[:n], row[n : 2 * n]])[:, known]
        pairs = np.abs(_pole(found)[:, np.newaxis] - _pole(exact)).argmin(axis=1)
        off = np.abs(found / exact[:, pairs] - 1.0).max(initial=0.0)
        piece = np.searchsorted(table.alpha3[table.pieces[1:-1]], angle)
        assert off <= 2.0 * table.interpolation_error[piece]
        assert len(set(pairs.tolist())) == known.sum()


def _pole(values: "np.typing.NDArray[np.float64]") -> "np.typing.NDArray[np.complex128]":
    """Return the poles of natural frequencies and damping ratios, (2, n), Hz."""
    frequency, ratio = values
    return np.asarray(frequency * np.exp(1j * (math.pi - np.arccos(np.minimum(ratio, 1.0)))))
