# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers of the members of an ensemble in a file: differences from the mechanism itself.

Members scatter by percents, so the numbers are multiples of 2^-12 of the power of two above their
largest, over members and nodes. The file has these multiples, and similar bytes side by side, which
compress to a third.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.arrays import FloatArray, IntArray

PACKED = {
    "ensemble_shapes": np.complex64,
    "ensemble_far": np.float32,
    "ensemble_static": np.float32,
}
"""Arrays of a table that a file has in this form, (n_members, n_nodes, ...), and their types."""

_BITS = 12
_SPARE = 2  # Rounding may have changed the power of two.
_UNKNOWN = np.uint32(0xFFFFFFFF)


def rounded(values: NDArray[Any]) -> NDArray[Any]:
    """Return numbers of `PACKED` as multiples, which a file keeps to the last bit."""
    parts, exponents = _parts(values)
    multiples = np.round(np.ldexp(parts, _BITS - exponents)) + 0.0  # no negative zeros
    numbers = np.ldexp(multiples, exponents - _BITS).astype(np.float32, order="C")
    return np.asarray(numbers.view(values.dtype))


def pack(values: NDArray[Any]) -> tuple[NDArray[np.uint8], IntArray]:
    """Return the bytes of multiples, (4, n_nodes, ..., n_members), and exponents of 2, (...)."""
    parts, exponents = _parts(values)
    steps = np.round(np.ldexp(parts, _BITS + _SPARE - exponents))
    steps[1:] -= np.nan_to_num(steps[0])
    known = np.isfinite(steps)
    steps = np.where(known, steps, 0.0).astype(np.int64)
    unsigned = np.where(known, 2 * np.abs(steps) - (steps < 0), _UNKNOWN).astype("<u4")
    unsigned = np.ascontiguousarray(np.moveaxis(unsigned, 0, -1))[..., np.newaxis]
    return np.ascontiguousarray(np.moveaxis(unsigned.view(np.uint8), -1, 0)), exponents


def unpack(planes: NDArray[np.uint8], exponents: IntArray, kind: type) -> NDArray[Any]:
    """Return the numbers that `pack` took, of a type of `PACKED`."""
    unsigned: NDArray[np.uint32] = np.ascontiguousarray(np.moveaxis(planes, 0, -1)).view("<u4")
    unsigned = unsigned[..., 0]
    half = np.moveaxis((unsigned.astype(np.int64) + 1) // 2, -1, 0)
    steps = np.where(np.moveaxis(unsigned % 2 == 1, -1, 0), -half, half).astype(float)
    steps[np.moveaxis(unsigned == _UNKNOWN, -1, 0)] = np.nan
    steps[1:] += np.nan_to_num(steps[0])
    numbers = np.ldexp(steps, exponents - _BITS - _SPARE).astype(np.float32, order="C")
    return np.asarray(numbers.view(kind))


def _parts(values: NDArray[Any]) -> tuple[FloatArray, IntArray]:
    """Return real numbers, and the exponents of the powers of 2 above all members and nodes."""
    parts = np.ascontiguousarray(values).view(np.float32).astype(float)
    largest = np.fmax.reduce(np.abs(parts), axis=(0, 1))
    return parts, np.frexp(np.nan_to_num(largest))[1]
