# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The position of a joint as the crank angle."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from linkage_vibration.bags.joint_states import JointState, JointStateReader
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.bags.streams import Block
from linkage_vibration.prediction.inputs.crank_input import (
    CrankInput,
    Integers,
    LeftOut,
    Reading,
    ReadingError,
    Readings,
)

_MAX_NAMES = 20


@dataclass(frozen=True)
class JointInput(CrankInput):
    """The position of a joint: crank angle = sign * scale * position + offset.

    Attributes
    ----------
    joint_name : str
    sign : int
        1 or -1.
    scale, offset, angle_stddev : float
        rad per unit of position, rad, and the standard deviation of the crank angle, rad.
    """

    topic = "joint_states"
    type = JOINT_STATE
    description = "The node finds the joint by its name, in any order."
    unique_type = True

    joint_name: str
    sign: int = 1
    scale: float = 1.0
    offset: float = 0.0
    angle_stddev: float = 0.0

    def describe(self, topic: str) -> str:
        """Return the joint and its topic, in words."""
        return f"joint {self.joint_name} on {topic}"

    def decode(self, data: bytes) -> JointState:
        """Return the joint state that plain CDR contains; see `JointStateReader.read_one`."""
        return self._reader.read_one(data)

    def header(self, message: JointState, received: int) -> tuple[int, int, str]:
        """Return the stamp and the frame of a joint state.

        Parameters
        ----------
        message, received : JointState, int
            As in `CrankInput.header`.
        """
        return message.sec, message.nanosec, message.frame_id

    def reading(self, message: JointState) -> Reading | None:
        """Return what a joint state reports; None if it does not contain the joint.

        Parameters
        ----------
        message : JointState
            Its names may have any order. Its velocities are used if there is one for each name.

        Raises
        ------
        ReadingError
            If the joint occurs more than once, or there is not one position for each name.
        """
        at = self._index(message.name, len(message.position))
        if at is None:
            return None
        gain, velocities = self.sign * self.scale, message.velocity
        velocity = gain * velocities[at] if len(velocities) == len(message.name) else math.nan
        return Reading(gain * message.position[at] + self.offset, velocity, self.angle_stddev)

    def read_block(self, block: Block, rows: Integers, left_out: LeftOut) -> Iterator[Readings]:
        """Read many joint states; those with the same names in the same order together.

        Parameters
        ----------
        block, rows, left_out : Block, ndarray and LeftOut
            As in `CrankInput.read_block`.
        """
        gain = self.sign * self.scale
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
                left_out.joints.update(states.name[:_MAX_NAMES])
                continue
            known = len(states.velocity) == len(states.name)
            yield Readings(
                states.rows,
                states.data,
                gain * states.position[at] + self.offset,
                gain * states.velocity[at] if known else np.full(n, math.nan),
                np.full(n, self.angle_stddev),
                states.sec,
                states.nanosec,
                states.frame_id,
            )
        left_out.unreadable += self._reader.unreadable
        left_out.fault = left_out.fault or self._reader.fault
        self._reader.unreadable = 0

    def other_names(self, message: JointState) -> Sequence[str]:
        """Return the names of the joints in a joint state, at most 20."""
        return list(message.name[:_MAX_NAMES])

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
            f"{topic} has no joint {self.joint_name}; it has {listing}. Set joint_name "
            "(`--joint`) to one of them, or choose another topic."
        )

    @cached_property
    def _reader(self) -> JointStateReader:
        return JointStateReader()

    def _index(self, names: list[str], n_positions: int) -> int | None:
        """Return where the joint is among the names of a joint state, if it is there."""
        count = names.count(self.joint_name)
        if count == 0:
            return None
        if count > 1:
            raise ReadingError(
                f"A joint state contains the joint {self.joint_name} {count} times; publish each "
                "joint once in a message."
            )
        if len(names) != n_positions:
            raise ReadingError(
                f"A joint state has {len(names)} names but {n_positions} positions, so the "
                f"position of {self.joint_name} is unknown; publish one position for each name."
            )
        return names.index(self.joint_name)
