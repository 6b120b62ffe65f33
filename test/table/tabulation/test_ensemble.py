# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Models of an ensemble are the same with any arithmetic."""

import math

import numpy as np
import pytest

from linkage_vibration.table.tabulation.ensemble import first_widest


@pytest.mark.parametrize(("wider", "first"), [(9e-7, 1), (1.1e-6, 3)])
def test_the_last_bit_does_not_choose_where_modes_are_followed_from(
    wider: float, first: int
) -> None:
    """Gaps within a millionth of the widest are the same, and the first one is chosen."""
    assert first_widest(np.array([0.1, 0.4, 0.2, 0.4 * (1.0 + wider), 0.4])) == first
    assert first_widest(np.array([0.0, 0.0])) == 0
    assert first_widest(np.array([0.1, math.inf, math.inf])) == 1  # with a single mode
