# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers of members in a file are those in memory, to the last bit."""

import numpy as np
import pytest

from linkage_vibration.table.packing import pack, rounded, unpack

LARGEST = 1.0 - 2.0**-14  # It is rounded to 1, which has another power of two above it.


@pytest.mark.parametrize("kind", [np.float32, np.complex64])
def test_a_file_keeps_members_to_the_last_bit(kind: type) -> None:
    """They are off by half of 2^-12 of the power above the largest; what is not known stays so."""
    random = np.random.default_rng(3)
    values = random.standard_normal((9, 4, 3, 5)) * 10.0 ** random.uniform(-9.0, 6.0, (3, 5))
    values = (values * np.exp(0.3j)).astype(kind) if kind is np.complex64 else values.astype(kind)
    values[2, :, 1], values[0, 1, 2, 3], values[:, :, 0, 0] = np.nan, 0.0, 0.0
    values[:, :, 1, 1], values[:, :, 1, 2] = np.nan, -1e-30
    values[:, :, 2, 2], values[3, 2, 2, 2] = 1e-9, LARGEST
    known = rounded(values)
    assert known[3, 2, 2, 2] == 1.0
    planes, exponents = pack(known)
    assert unpack(planes, exponents, kind).tobytes() == known.tobytes()
    assert (np.isnan(known) == np.isnan(values)).all()
    for part in (np.real, np.imag):
        off, largest = np.abs(part(known) - part(values)), np.abs(part(values))
        above = 2.0 ** np.ceil(np.log2(np.maximum(np.nan_to_num(largest).max(axis=(0, 1)), 1e-45)))
        assert (np.nan_to_num(off) <= above / 2.0**13 + 1e-45).all()
