# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads many ``std_msgs/Float64`` at once."""

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.bags.message_types import FLOAT64
from linkage_vibration.bags.streams import Block
from linkage_vibration.prediction.inputs.crank_input import FloatArray, Integers, LeftOut

_SIZE = 12  # bytes: the encapsulation header and the number


def read_floats(
    block: Block, rows: Integers, left_out: LeftOut
) -> Iterator[tuple[Integers, NDArray[np.uint8], FloatArray]]:
    """Yield the rows, bytes (m, n_bytes) and numbers (m,) of messages that have the same size.

    Parameters
    ----------
    block, rows : Block and ndarray, (n,)
        Part of a bag, and which of its messages to read.
    left_out : LeftOut
        Counts the messages that are not valid CDR.
    """
    sizes = block.sizes[rows]
    for size in np.unique(sizes).tolist():
        same = rows[sizes == size]
        valid = np.zeros(len(same), bool)
        if size >= _SIZE:
            data = sliding_window_view(block.buffer, size)[block.starts[same]]
            valid = (data[:, 0] == 0) & (data[:, 1] <= 1)
        if not valid.all():
            left_out.unreadable += int((~valid).sum())
            left_out.fault = left_out.fault or f"{size} bytes are not a {FLOAT64} in plain CDR"
        if valid.any():
            data = data[valid]
            numbers = np.ascontiguousarray(data[:, 4:_SIZE])
            little, big = numbers.view("<f8")[:, 0], numbers.view(">f8")[:, 0]
            yield same[valid], data, np.where(data[:, 1] == 1, little, big)
