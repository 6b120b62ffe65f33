# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a reader finds in messages: one number of each, with the header of its message."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Block, Integers
from linkage_vibration.errors import LinkageVibrationError

FloatArray = NDArray[np.float64]

LISTED_NAMES, MAX_NAMES = 20, 1000
"""What messages contain instead is listed up to so many names, and kept up to so many."""
_LONG = 60  # characters of a name that are listed


class CdrError(ValueError):
    """Bytes that are not a message in plain CDR."""


class ReadingError(LinkageVibrationError):
    """A message has no reliable number."""


class Scalar(NamedTuple):
    """The number of one message, its rate (1/s, NaN if unknown), and the header of the message."""

    value: float
    rate: float = math.nan
    sec: int = 0
    nanosec: int = 0
    frame_id: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class ScalarBatch:
    """The numbers of messages whose headers have the same frame, by columns."""

    rows: Integers  # (n,), of the block
    value: FloatArray  # (n,), as in `Scalar`
    rate: FloatArray  # (n,), likewise
    sec: NDArray[np.int32]  # (n,), s; 0 without a header
    nanosec: NDArray[np.uint32]  # (n,), ns
    frame_id: str  # empty without a header
    senders: NDArray[np.uint32] | None = None  # (n,), on a CAN bus


@dataclass(slots=True)
class SkippedMessages:
    """How many messages of a bag were left out, and why."""

    others: int = 0  # do not contain the number
    unreadable: int = 0  # are not valid CDR
    refused: int = 0  # have no reliable number
    fault: str = ""  # of the first unreadable or refused one
    names: set[str] = field(default_factory=set)
    unavailable: dict[str, int] = field(default_factory=dict)  # reasons, and how many messages


class NumberReader(ABC):
    """Reads one number from each message of a type."""

    what: str  # in words, such as "joint boom"
    kind: str = ""  # of what messages contain instead, such as "joint"
    remedy: str = "Choose one of them."
    has_header: bool = False
    note: str = ""  # why the last number, or the first of many, is NaN
    sender: str = ""

    @abstractmethod
    def read_one(self, data: bytes) -> Scalar | None:
        """Return the number of a message or None; a `CdrError` or `ReadingError` refuses it."""

    @abstractmethod
    def read(
        self, block: Block, rows: Integers, left_out: SkippedMessages
    ) -> Iterator[ScalarBatch]:
        """Read messages of a bag, as `read_one` does each; count those without a number."""

    def other_names(self, data: bytes) -> Sequence[str]:
        """Return what a message contains instead of the number, by names."""
        return ()

    def explain_missing(self, topic: str, names: Sequence[str]) -> str:
        """Return why no number came, by `other_names`, and the remedy; empty if unknown."""
        if names:
            listed = (f"{n[:_LONG]}..." if len(n) > _LONG else n or "''" for n in sorted(names))
            listing = ", ".join(islice(listed, LISTED_NAMES))
            if len(names) > LISTED_NAMES:
                listing += f" and {len(names) - LISTED_NAMES} more"
            return f"{topic} has no {self.what}; it has {listing}. {self.remedy}"
        if self.kind:
            fix = "check its publisher, or choose another topic"
            return f"{topic} has no {self.kind} at all; {fix}."
        return ""
