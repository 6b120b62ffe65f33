# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Messages as columns."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Messages of several topics as columns."""

    buffer: Bytes  # holds the bytes of the messages
    starts: Integers  # (n,), in the buffer
    sizes: Integers  # (n,), in bytes
    topics: Integers  # (n,), indices in the requested names
    log_times: Integers  # (n,), of receiving, ns
    publish_times: Integers  # (n,), of sending, ns; as received except in MCAP

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.starts)

    def message(self, row: int) -> bytes:
        """Return the bytes of one message."""
        start = int(self.starts[row])
        return self.buffer[start : start + int(self.sizes[row])].tobytes()

    def rows(self, which: Integers | slice) -> "Block":
        """Return the messages with these indices, in their order."""
        return Block(self.buffer, *(column[which] for column in self.columns()))

    def columns(self) -> tuple[Integers, ...]:
        """Return everything except the buffer."""
        return self.starts, self.sizes, self.topics, self.log_times, self.publish_times
