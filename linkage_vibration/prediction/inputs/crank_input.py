# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What every input of the crank angle offers to the node and to the replay, and Float64s."""

import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.bags.joint_states import CdrError
from linkage_vibration.bags.message_types import FLOAT64
from linkage_vibration.bags.streams import Block
from linkage_vibration.errors import LinkageVibrationError

FloatArray = NDArray[np.float64]
Integers = NDArray[np.int64]


_FLOAT64_SIZE = 12  # bytes: the encapsulation header and the number


class InputError(LinkageVibrationError):
    """The parameters of an input cannot be used."""


class ReadingError(LinkageVibrationError):
    """A message of an input gives no reliable crank angle."""


@dataclass(frozen=True, slots=True)
class Reading:
    """The crank angle that one message reports.

    Attributes
    ----------
    crank_angle : float
        alpha3, rad; it may be NaN.
    velocity : float
        Rate of the crank angle, rad/s; NaN if it is unknown.
    stddev : float
        Standard deviation of the crank angle, rad.
    """

    crank_angle: float
    velocity: float
    stddev: float


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The crank angles of messages that have the same size and frame, by columns.

    Attributes
    ----------
    rows, data : ndarray, (n,), and ndarray of uint8, (n, n_bytes)
        Which messages of the block they are, and their bytes.
    crank_angle, velocity, stddev : ndarray, (n,)
        As those of `Reading`.
    sec, nanosec : ndarray, (n,)
        Stamps, s and ns.
    frame_id : str
        Frame of the headers; empty for messages without a header.
    """

    rows: Integers
    data: NDArray[np.uint8]
    crank_angle: FloatArray
    velocity: FloatArray
    stddev: FloatArray
    sec: NDArray[np.int32]
    nanosec: NDArray[np.uint32]
    frame_id: str


@dataclass(slots=True)
class LeftOut:
    """How many messages of a bag were left out, and why.

    Attributes
    ----------
    others, unreadable, refused : int
        Messages that do not concern the input, such as joint states of other joints; that are not
        valid CDR; and that give no reliable crank angle.
    fault : str
        Why the first unreadable or refused message was left out.
    joints : set of str
        Some of the other joints.
    """

    others: int = 0
    unreadable: int = 0
    refused: int = 0
    fault: str = ""
    joints: set[str] = field(default_factory=set)


def read_float(data: bytes) -> float:
    """Return the number of a message.

    Raises
    ------
    CdrError
        If the bytes are not a ``std_msgs/Float64`` in plain CDR.
    """
    if len(data) < _FLOAT64_SIZE or data[0] != 0 or data[1] > 1:
        raise CdrError(f"{len(data)} bytes are not a {FLOAT64} in plain CDR")
    [value] = struct.unpack_from("<d" if data[1] else ">d", data, 4)
    return float(value)


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
        if size >= _FLOAT64_SIZE:
            data = sliding_window_view(block.buffer, size)[block.starts[same]]
            valid = (data[:, 0] == 0) & (data[:, 1] <= 1)
        if not valid.all():
            left_out.unreadable += int((~valid).sum())
            left_out.fault = left_out.fault or f"{size} bytes are not a {FLOAT64} in plain CDR"
        if valid.any():
            data = data[valid]
            numbers = np.ascontiguousarray(data[:, 4:_FLOAT64_SIZE])
            little, big = numbers.view("<f8")[:, 0], numbers.view(">f8")[:, 0]
            yield same[valid], data, np.where(data[:, 1] == 1, little, big)


class CrankInput(ABC):
    """A kind of message, and how its readings become crank angles.

    A concrete input is a frozen dataclass whose fields are parameters of the node.

    Attributes
    ----------
    topic, type, description : str
        The node's name of the topic, the type of the message, and a sentence for the manual.
    unique_type : bool
        Whether a bag's only topic of this type is the input, whatever its name.
    """

    topic: ClassVar[str]
    type: ClassVar[str]
    description: ClassVar[str]
    unique_type: ClassVar[bool] = False

    @abstractmethod
    def describe(self, topic: str) -> str:
        """Return what is read from a topic, in words."""

    @abstractmethod
    def decode(self, data: bytes) -> Any:
        """Return the message that plain CDR contains.

        Raises
        ------
        CdrError
            If the bytes are not such a message.
        """

    @abstractmethod
    def reading(self, message: Any) -> Reading | None:
        """Return what a message reports; None if it does not concern this input.

        Raises
        ------
        ReadingError
            If it gives no reliable crank angle.
        """

    @abstractmethod
    def read_block(self, block: Block, rows: Integers, left_out: LeftOut) -> Iterator[Readings]:
        """Read many messages of a bag, which gives the same values as `reading` for each.

        Parameters
        ----------
        block, rows : Block and ndarray, (n,)
            Part of a bag, and which of its messages to read.
        left_out : LeftOut
            Counts the messages that give no crank angle.
        """

    def header(self, message: Any, received: int) -> tuple[int, int, str]:
        """Return the stamp (s and ns) and the frame of a message.

        Parameters
        ----------
        message : object
            What `decode` returns.
        received : int
            When it was received, ns; the stamp of a message without a header.
        """
        return *divmod(received, 10**9), ""

    def other_names(self, message: Any) -> Sequence[str]:
        """Return what a message concerns instead of this input, by names."""
        return ()

    def explain_missing(self, topic: str, names: Sequence[str]) -> str:
        """Return why no reading may have come, and the remedy; empty if that is unknown.

        Parameters
        ----------
        topic, names : str and sequence of str
            The topic that was read, and what its messages concern, see `other_names`.
        """
        return ""
