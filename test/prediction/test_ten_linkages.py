# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Load ratios of the ten linkages of `benchmark.loads` are those of bodies that are cut free."""

from dataclasses import replace

import numpy as np
import pytest

from linkage_vibration.mechanics.description import coarser
from linkage_vibration.mechanics.model import LinkageModel

LARGEST = 9  # the linkage whose levels by the ground have the largest error of interpolation


@pytest.mark.nightly(alone="test_levels.py and test_ground.py compare with models of their own")
@pytest.mark.parametrize("number", range(10))
def test_load_ratios(number: int) -> None:
    """Those by orders are within 2e-6, and those by the ground and in total within 1e-4.

    Levels by the ground are interpolated between angles 1 deg apart and between speeds. That makes
    an error of 2.6e-4 for one of the linkages, at an angle between two of its table.
    """
    loads = pytest.importorskip("benchmark.loads", reason="it needs exudyn")
    case = loads.cases()[number]
    mechanism = coarser(case.model.mechanism, 1000, 1000)
    case = replace(case, model=LinkageModel(mechanism, reduced=False))
    (ours, total), exact = loads.by_package(case), loads.cut_free(case)
    limit = 3e-4 if number == LARGEST else 1e-4
    for i, (actual, expected) in enumerate(zip(ours, exact, strict=True)):
        counts = expected.ratios > loads.LEAST * expected.ratios.max()
        error = np.abs(actual.ratios[counts] / expected.ratios[counts] - 1.0).max()
        assert error < (2e-6 if i < len(loads.sizes(case)) else limit)
        assert actual.velocity == pytest.approx(expected.velocity, rel=1e-4)
    assert total == pytest.approx(exact[-1].ratios.max(), rel=limit)
