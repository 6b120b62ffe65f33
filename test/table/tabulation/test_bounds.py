# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The errors that a table reports are bounds of those at random angles."""

import numpy as np
import pytest

from benchmark.bounds import LINKAGES, QUANTITIES, reported_errors, true_errors
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.tabulation import build_table

FEW, MANY = 150, 10_000  # angles


@pytest.mark.parametrize("name", LINKAGES)
@pytest.mark.parametrize(
    ("count", "tolerance"),
    [
        (FEW, 1e-6),
        pytest.param(MANY, 1e-6, marks=pytest.mark.nightly),
        pytest.param(MANY, 1e-4, marks=pytest.mark.nightly),
    ],
)
def test_reported_errors_are_bounds(count: int, name: str, tolerance: float) -> None:
    """At most 1 % of the angles exceed the reported error of a quantity, none twofold."""
    model = LinkageModel(read_mechanism(config_file(f"{name}.yaml")))
    built = build_table(model, tolerance)
    angles = np.random.default_rng(3).uniform(*built.alpha3_range, count)
    share = true_errors(model, built, angles) / reported_errors(built, angles)
    for quantity, ratios in zip(QUANTITIES, share.T, strict=True):
        assert (ratios > 1.0).mean() <= 0.01, quantity
        assert ratios.max() <= 2.0, quantity
