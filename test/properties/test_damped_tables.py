# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of random linkages with random dampers are never silently wrong.

A few are tried at every run, and ten thousand by ``pytest -m nightly test/properties``.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmark.bounds import reported_errors, true_errors
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.table.table import TableError
from linkage_vibration.table.tabulation import build_table

from .linkages import Linkage, damped_linkages

FEW, MANY = 2, 10_000
ANGLES = 10


@pytest.mark.parametrize("examples", [FEW, pytest.param(MANY, marks=pytest.mark.nightly)])
def test_reported_errors_are_bounds(examples: int) -> None:
    """At random angles no error exceeds that reported twofold, and hardly any exceeds it.

    That holds for natural frequencies, damping ratios, slopes, peaks and FRFs. A table that cannot
    be built is refused, and the error says what to change.
    """
    above: list[np.ndarray] = []

    def agree(linkage: Linkage, power: float, seed: int) -> None:
        model = LinkageModel(linkage.mechanism)
        try:
            table = build_table(model, 10.0**power)
        except TableError as error:
            assert "; " in str(error)  # what to change
            return
        angles = np.random.default_rng(seed).uniform(*table.alpha3_range, ANGLES)
        share = true_errors(model, [table], angles)[0] / reported_errors(table, angles)
        assert share.max(initial=0.0, where=np.isfinite(reported_errors(table, angles))) <= 2.0
        above.append(share > 1.0)

    tried = settings(
        max_examples=examples, derandomize=examples == FEW, database=None, deadline=None
    )
    tolerance = st.floats(-6.0, -3.0)  # power of ten
    tried(given(damped_linkages(), tolerance, st.integers(0, 2**32 - 1))(agree))()
    assert (np.concatenate(above).mean(axis=0) <= 0.01).all()
