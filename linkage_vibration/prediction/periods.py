# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Which messages an output at a limited rate has, decided by stamps alone, live and offline."""

import numpy as np
from numpy.typing import NDArray


class Periods:
    """Chooses messages for an output at a limited rate: the first in each period of their stamps.

    Periods are counted from a stamp of 0. A message is the first also where the clock jumps back,
    and of those with the same stamp only one is. The attribute ``rate``, Hz, is 0 for each message.
    """

    def __init__(self, rate: float = 0.0) -> None:
        self.rate = rate
        self._last = -(2**63)

    def is_due(self, stamp: int) -> bool:
        """Return whether the next message is due, from its stamp, ns."""
        if not self.rate:
            return True
        before, self._last = self._last, stamp // round(1e9 / self.rate)
        return self._last != before

    def due(self, stamps: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which messages are due, (n,), from their stamps, ns, in the order of arrival."""
        if not self.rate:
            return np.ones(len(stamps), np.bool_)
        periods = np.concatenate([[self._last], stamps // round(1e9 / self.rate)])
        self._last = int(periods[-1])
        return np.asarray(periods[1:] != periods[:-1])
