# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Cells of cubics are joined as far as their limits allow."""

import numpy as np
import pytest

from linkage_vibration.export.orders import joined_cells, largest_sizes
from linkage_vibration.support.resources import PAPER_TABLE, config_file
from linkage_vibration.table.cells import Cells
from linkage_vibration.table.table import load_table


def test_largest_sizes() -> None:
    """They are magnitudes, and those of cells without cubics do not count."""
    cubics = np.array([[0.0, 0.0, 2.0, -7.0], [np.nan] * 4, [0.0, 0.0, 1.0, 4.0]])[..., np.newaxis]
    np.testing.assert_array_equal(largest_sizes(cubics), [7.0])
    np.testing.assert_array_equal(largest_sizes(cubics[1:2]), [0.0])


@pytest.mark.parametrize(("share", "left"), [(1e-8, 1.0), (1e-5, 0.5), (1e-2, 0.5)])
def test_joined_cells(share: float, left: float) -> None:
    """Fewer cells differ from those of a table by no more than the limits, which they use."""
    table = load_table(config_file(PAPER_TABLE))
    starts, cubics = table.cells.arrays
    ends = np.append(starts, table.alpha3_range[1])
    limits = share * largest_sizes(cubics)
    fewer = Cells(*joined_cells(ends, cubics, limits))
    angles = np.linspace(*table.alpha3_range, 20_001)
    off = np.abs(fewer.many_values(angles) - table.cells.many_values(angles)) / limits
    assert 0.5 < off.max() <= 1.0
    assert len(fewer.arrays[0]) < left * len(starts)
    same = joined_cells(ends, cubics, 0.0 * limits)
    assert len(same[0]) == len(starts)
