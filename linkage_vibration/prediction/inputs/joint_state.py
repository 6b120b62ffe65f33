# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The position of a joint in ``sensor_msgs/JointState``, with its velocity.

This is the common input, for which `JointStateReader` is faster than `FieldReader`.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from linkage_vibration.bags.joint_states import JointStateReader
from linkage_vibration.bags.numbers import (
    Integers,
    LeftOut,
    Number,
    NumberReader,
    Numbers,
    ReadingError,
)
from linkage_vibration.bags.streams import Block

_MAX_NAMES = 20


class JointReader(NumberReader):
    """Reads the position of a joint, found by its name in any order, and its velocity."""

    has_header = True

    def __init__(self, joint_name: str) -> None:
        self._joint = joint_name
        self._reader = JointStateReader()

    def describe(self) -> str:
        """Return the name of the joint, in words."""
        return f"joint {self._joint}"

    def read_one(self, data: bytes) -> Number | None:
        """Return the position and the velocity of the joint; None if it is not in the message.

        The velocity is known if there is one for each name.
        """
        state = self._reader.read_one(data)
        at = self._index(state.name, len(state.position))
        if at is None:
            return None
        velocity = state.velocity[at] if len(state.velocity) == len(state.name) else math.nan
        return Number(state.position[at], velocity, state.sec, state.nanosec, state.frame_id)

    def read(self, block: Block, rows: Integers, left_out: LeftOut) -> Iterator[Numbers]:
        """Read many joint states; those with the same names in the same order together.

        Parameters
        ----------
        block, rows, left_out : Block, ndarray and LeftOut
            As in `NumberReader.read`.
        """
        for states in self._reader.read(block, rows):
            n = len(states.rows)
            try:
                at = self._index(states.name, len(states.position))
            except ReadingError as error:
                left_out.refused += n
                left_out.fault = left_out.fault or str(error)
                continue
            if at is None:
                left_out.others += n
                left_out.names.update(states.name[:_MAX_NAMES])
                continue
            known = len(states.velocity) == len(states.name)
            yield Numbers(
                states.rows,
                states.position[at],
                states.velocity[at] if known else np.full(n, math.nan),
                states.sec,
                states.nanosec,
                states.frame_id,
            )
        left_out.unreadable += self._reader.unreadable
        left_out.fault = left_out.fault or self._reader.fault
        self._reader.unreadable = 0

    def other_names(self, data: bytes) -> Sequence[str]:
        """Return the names of the joints in a message, at most 20."""
        return self._reader.read_one(data).name[:_MAX_NAMES]

    def explain_missing(self, topic: str, names: Sequence[str]) -> str:
        """Return that the joint is missing, which joints are there, and the remedy.

        Parameters
        ----------
        topic, names : str and sequence of str
            The topic that was read, and the joints that its messages contain.
        """
        if not names:
            return f"{topic} has no joint at all; check its publisher, or choose another topic."
        listing = ", ".join(sorted(names)[:_MAX_NAMES])
        return (
            f"{topic} has no joint {self._joint}; it has {listing}. Set joint_name "
            "(`--joint`) to one of them, or choose another topic."
        )

    def _index(self, names: list[str], n_positions: int) -> int | None:
        """Return where the joint is among the names of a joint state, if it is there.

        Raises
        ------
        ReadingError
            If the joint occurs more than once, or there is not one position for each name.
        """
        count = names.count(self._joint)
        if count == 0:
            return None
        if count > 1:
            raise ReadingError(
                f"A joint state contains the joint {self._joint} {count} times; publish each "
                "joint once in a message."
            )
        if len(names) != n_positions:
            raise ReadingError(
                f"A joint state has {len(names)} names but {n_positions} positions, so the "
                f"position of {self._joint} is unknown; publish one position for each name."
            )
        return names.index(self._joint)
