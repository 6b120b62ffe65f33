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

from linkage_vibration.bags.blocks import Block
from linkage_vibration.errors import LinkageVibrationError

FloatArray = NDArray[np.float64]
Integers = NDArray[np.int64]

LISTED_NAMES, MAX_NAMES = 20, 1000
"""What messages contain instead is listed up to so many names, and kept up to so many."""
_LONG = 60  # characters of a name that are listed


class CdrError(ValueError):
    """Bytes that are not a message in plain CDR."""


class ReadingError(LinkageVibrationError):
    """A message has no reliable number."""


class MessageNumber(NamedTuple):
    """The number of one message, its rate (1/s, NaN if unknown), and the header of the message."""

    value: float
    rate: float = math.nan
    sec: int = 0
    nanosec: int = 0
    frame_id: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """The numbers of messages whose headers have the same frame, by columns.

    Attributes
    ----------
    rows : ndarray, (n,)
        Which messages of the block they are.
    value, rate : ndarray, (n,)
        As those of `MessageNumber`.
    sec, nanosec : ndarray, (n,)
        Stamps of their headers, s and ns; 0 for messages without a header.
    frame_id : str
        Frame of their headers; empty for messages without a header.
    senders : ndarray, (n,), optional
        Their source addresses on a CAN bus, if the signal may come from any.
    """

    rows: Integers
    value: FloatArray
    rate: FloatArray
    sec: NDArray[np.int32]
    nanosec: NDArray[np.uint32]
    frame_id: str
    senders: NDArray[np.uint32] | None = None


@dataclass(slots=True)
class LeftOut:
    """How many messages of a bag were left out, and why.

    Attributes
    ----------
    others, unreadable, refused : int
        Messages that do not contain the number, such as joint states of other joints; that are not
        valid CDR; and whose number is not reliable.
    fault : str
        Why the first unreadable or refused message was left out.
    names : set of str
        What some of the other messages contain instead, such as joints.
    unavailable : dict of str to int
        What was not available, with the reason, and in how many messages.
    """

    others: int = 0
    unreadable: int = 0
    refused: int = 0
    fault: str = ""
    names: set[str] = field(default_factory=set)
    unavailable: dict[str, int] = field(default_factory=dict)


class NumberReader(ABC):
    """Reads one number from each message of a type.

    Attributes
    ----------
    what : str
        What is read, in words, such as "joint boom".
    kind : str
        What messages contain instead, such as "joint"; empty if they do not say it.
    remedy : str
        What to do if messages contain others of this kind only.
    has_header : bool
        Whether the messages begin with a header.
    note : str
        Why the last number, or the first of many, is NaN; empty if the message does not say it.
    sender : str
        The field that reads the sender of the last number alone, such as ``engine_speed@0x00``;
        empty if the messages do not name their sender, or the field has chosen one.
    """

    what: str
    kind: str = ""
    remedy: str = "Choose one of them."
    has_header: bool = False
    note: str = ""
    sender: str = ""

    @abstractmethod
    def read_one(self, data: bytes) -> MessageNumber | None:
        """Return the number of a message in plain CDR; None if it does not contain it.

        It raises a `CdrError` if the bytes are not such a message, and a `ReadingError` if its
        number is not reliable.
        """

    @abstractmethod
    def read(self, block: Block, rows: Integers, left_out: LeftOut) -> Iterator[Numbers]:
        """Read messages of a bag, (n,), which gives the same numbers as `read_one` for each.

        Those without a number are counted in ``left_out``.
        """

    def other_names(self, data: bytes) -> Sequence[str]:
        """Return what a message contains instead of the number, by names."""
        return ()

    def explain_missing(self, topic: str, names: Sequence[str]) -> str:
        """Return why no number may have come, and the remedy; empty if that is unknown.

        The names are those that `other_names` returns for messages on the topic.
        """
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
