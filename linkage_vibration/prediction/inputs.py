# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a tractor tells of its hitch, a joint's position or a percentage, as a crank angle."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.interpolate import PchipInterpolator

from linkage_vibration.errors import LinkageVibrationError

PERCENT_STEP = 0.4
"""Of a hitch position on the ISO 11783 bus, % a bit."""

# Of a calibration: beyond, its slopes are no numbers of use.
_LEAST_STEP = 1e-3  # %
_LARGEST_ANGLE = 1e3  # rad


class InputError(LinkageVibrationError):
    """A calibration, or another rule that makes angles of readings, cannot be used."""


class ReadingError(LinkageVibrationError):
    """A joint state holds no trustworthy position of the joint."""


class Named(Protocol):
    """What a reading needs of ``sensor_msgs/msg/JointState``."""

    name: Sequence[str]
    position: Sequence[float]
    velocity: Sequence[float]


@dataclass(frozen=True, slots=True)
class Reading:
    """The crank angle, as one message tells it.

    Attributes
    ----------
    crank_angle : float
        alpha3, rad; may be NaN.
    velocity : float
        Its rate, rad/s; NaN where it is not known.
    stddev : float
        Standard deviation of the angle, rad.
    """

    crank_angle: float
    velocity: float
    stddev: float


@dataclass(frozen=True, slots=True)
class JointInput:
    """The position of a joint: crank angle = sign * scale * position + offset.

    Attributes
    ----------
    joint_name : str
        The joint's name.
    sign : int
        1 or -1.
    scale : float
        rad per unit of position.
    offset : float
        rad.
    stddev : float
        Standard deviation of the crank angle, rad.
    """

    joint_name: str
    sign: int = 1
    scale: float = 1.0
    offset: float = 0.0
    stddev: float = 0.0

    def reading(self, joint_state: Named) -> Reading | None:
        """Return what a joint state tells; None where it is about other joints alone.

        Parameters
        ----------
        joint_state : sensor_msgs.msg.JointState
            Names in any order. A velocity counts when there is one for each name.

        Raises
        ------
        ReadingError
            If the joint is named more than once, or there is not one position for each name.
        """
        names, positions = joint_state.name, joint_state.position
        joint = self.joint_name
        count = names.count(joint)
        if count == 0:
            return None
        if count > 1:
            raise ReadingError(
                f"Joint {joint} is named {count} times; name it once in a joint state."
            )
        if len(names) != len(positions):
            raise ReadingError(
                f"A joint state has {len(names)} names but {len(positions)} positions, so that of "
                f"{joint} is not known; publish one position for each name."
            )
        at = names.index(joint)
        velocities, gain = joint_state.velocity, self.sign * self.scale
        velocity = gain * velocities[at] if len(velocities) == len(names) else math.nan
        return Reading(gain * positions[at] + self.offset, velocity, self.stddev)


@dataclass(frozen=True)
class PercentInput:
    """The hitch position of ISO 11783, from 0 % (down) to 100 % (up), through a calibration.

    Between the points of the calibration the angle follows a monotone cubic (PCHIP), so that it
    never turns back. A value outside of 0 to 100 %, as the bus has for "error" and "not available",
    is no angle.

    Attributes
    ----------
    percents : tuple of float
        Hitch positions, from 0 to 100, ascending, %.
    angles : tuple of float
        Crank angles there, ascending or descending, rad.
    stddev : float
        Standard deviation of the calibrated angle, rad; that of the bus's steps of 0.4 % comes on
        top.

    Raises
    ------
    InputError
        If the points are not two at least, finite, within 1000 rad, and strictly monotone, with
        0.001 % at least between them, or do not reach from 0 to 100 %.
    """

    percents: tuple[float, ...]
    angles: tuple[float, ...]
    stddev: float = 0.0

    def __post_init__(self) -> None:
        """Check the points."""
        if len(self.percents) != len(self.angles) or len(self.percents) < 2:
            raise InputError(
                f"A calibration has {len(self.percents)} percents and {len(self.angles)} angles; "
                "give two points at least, and one angle for each percent."
            )
        if not all(map(math.isfinite, (*self.percents, *self.angles))):
            raise InputError("A calibration has a number that is not finite; mend it.")
        if max(map(abs, self.angles)) > _LARGEST_ANGLE:
            raise InputError(
                f"A calibration has an angle beyond {_LARGEST_ANGLE:g} rad; give crank angles."
            )
        if (self.percents[0], self.percents[-1]) != (0.0, 100.0):
            raise InputError(
                f"A calibration reaches from {self.percents[0]:g} to {self.percents[-1]:g} %; "
                "let it begin at 0 and end at 100 %."
            )
        for i, step in enumerate(np.diff(self.percents), start=1):
            if step < _LEAST_STEP:
                raise InputError(
                    f"The percents of a calibration must ascend, but point {i + 1} "
                    f"({self.percents[i]:g} %) does not follow {self.percents[i - 1]:g} %."
                )
        steps = np.diff(self.angles)
        wrong = np.flatnonzero(steps * steps[0] <= 0.0)
        if steps[0] == 0.0 or len(wrong):
            i = 1 + (int(wrong[0]) if steps[0] != 0.0 else 0)
            raise InputError(
                "The angles of a calibration must all ascend or all descend, but point "
                f"{i + 1} ({math.degrees(self.angles[i]):g} deg) does not go on from "
                f"{math.degrees(self.angles[i - 1]):g} deg."
            )

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.percents, self.angles)

    @cached_property
    def _slope(self) -> PchipInterpolator:
        return self._curve.derivative()

    def reading(self, percent: float) -> Reading:
        """Return what a hitch position (%) tells; its velocity is not known.

        Examples
        --------
        >>> hitch = PercentInput((0.0, 100.0), (3.0, 1.8))
        >>> hitch.reading(25.0).crank_angle
        2.7
        """
        if not 0.0 <= percent <= 100.0:
            return Reading(math.nan, math.nan, math.nan)
        # Rounded to a step, a position is off by a standard deviation of step / sqrt(12).
        step = abs(float(self._slope(percent))) * PERCENT_STEP / math.sqrt(12.0)
        return Reading(float(self._curve(percent)), math.nan, math.hypot(step, self.stddev))
