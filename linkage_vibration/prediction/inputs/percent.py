# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The hitch position in percent as the crank angle."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator

from linkage_vibration.bags.message_types import FLOAT64
from linkage_vibration.bags.streams import Block
from linkage_vibration.prediction.inputs.crank_input import (
    CrankInput,
    InputError,
    Integers,
    LeftOut,
    Reading,
    Readings,
    read_float,
    read_floats,
)

PERCENT_STEP = 0.4
"""Resolution of a hitch position on the ISO 11783 bus, % per bit."""

# Below this step, the slope of a calibration is meaningless.
_LEAST_STEP = 1e-3  # %


@dataclass(frozen=True)
class PercentInput(CrankInput):
    """The hitch position of ISO 11783, from 0 % (down) to 100 % (up), through a calibration.

    Between the points of the calibration the angle follows a monotone cubic (PCHIP), so that it
    never turns back. A value outside 0 to 100 %, which the bus uses for "error" and "not
    available", gives the angle NaN.

    Attributes
    ----------
    percent_calibration : tuple of float
        Pairs of a hitch position (%) and the crank angle there (rad), one after the other. The
        positions ascend from 0 to 100, and the angles are monotone.
    angle_stddev : float
        Standard deviation of the calibrated angle, rad; the standard deviation that the bus's
        steps of 0.4 % cause is added.

    Raises
    ------
    InputError
        If there are fewer than two pairs, if they are not finite and strictly monotone with at
        least 0.001 % between them, if they do not reach from 0 to 100 %, or if an angle exceeds a
        full turn, as angles in degrees do.
    """

    topic = "hitch_position"
    type = FLOAT64
    description = (
        "Where `input` is `percent`, this topic replaces `joint_states`: the ISO 11783 rear hitch "
        "position, from 0 (down) to 100 (up)."
    )

    percent_calibration: tuple[float, ...]
    angle_stddev: float = 0.0

    def __post_init__(self) -> None:
        """Check the pairs."""
        pairs, points, angles = self.percent_calibration, self._points, self._angles
        if len(pairs) % 2 or len(pairs) < 4:
            raise InputError(
                f"percent_calibration has {len(pairs)} numbers; give at least two pairs of a hitch "
                "position and a crank angle, such as [0.0, 3.14159, 100.0, 1.5708]."
            )
        if not all(map(math.isfinite, pairs)):
            raise InputError("percent_calibration must be finite; replace NaN and infinity.")
        largest = max(angles, key=abs)
        if abs(largest) > 2.0 * math.pi:
            raise InputError(
                f"percent_calibration has an angle of {largest:g} rad, which exceeds a full turn; "
                f"give angles in rad. If it is in degrees, write {math.radians(largest):.6g}."
            )
        if (points[0], points[-1]) != (0.0, 100.0):
            raise InputError(
                f"percent_calibration reaches from {points[0]:g} to {points[-1]:g} %; begin at 0 "
                "and end at 100 %."
            )
        for i, step in enumerate(np.diff(points), start=1):
            if step < _LEAST_STEP:
                raise InputError(
                    f"The positions of percent_calibration must ascend, but position {i + 1} "
                    f"({points[i]:g} %) does not exceed {points[i - 1]:g} %; sort the pairs."
                )
        steps = np.diff(angles)
        wrong = np.flatnonzero(steps * steps[0] <= 0.0)
        if len(wrong):
            i = 1 + int(wrong[0])
            raise InputError(
                "The angles of percent_calibration must all ascend or all descend, but angle "
                f"{i + 1} ({angles[i]:g} rad) does not continue from {angles[i - 1]:g} rad; "
                "correct one of them."
            )

    def describe(self, topic: str) -> str:
        """Return the topic of the hitch position, in words."""
        return f"hitch position on {topic}"

    def decode(self, data: bytes) -> float:
        """Return the number in a ``std_msgs/Float64``; see `read_float`."""
        return read_float(data)

    def reading(self, message: float) -> Reading:
        """Return what a hitch position (%) reports; see `angle_at`."""
        return self.angle_at(message)

    def angle_at(self, percent: float) -> Reading:
        """Return the crank angle at a hitch position (%); its velocity is unknown.

        Examples
        --------
        >>> hitch = PercentInput((0.0, 3.0, 100.0, 1.8))
        >>> hitch.angle_at(25.0).crank_angle
        2.7
        """
        if not 0.0 <= percent <= 100.0:
            return Reading(math.nan, math.nan, math.nan)
        # Rounding to a step causes a standard deviation of step / sqrt(12).
        step = abs(float(self._slope(percent))) * PERCENT_STEP / math.sqrt(12.0)
        return Reading(float(self._curve(percent)), math.nan, math.hypot(step, self.angle_stddev))

    def read_block(self, block: Block, rows: Integers, left_out: LeftOut) -> Iterator[Readings]:
        """Read many hitch positions; their stamps are their log times.

        Parameters
        ----------
        block, rows, left_out : Block, ndarray and LeftOut
            As in `CrankInput.read_block`.
        """
        for same, data, values in read_floats(block, rows, left_out):
            readings = [self.angle_at(value) for value in values.tolist()]
            sec, nanosec = np.divmod(block.log_times[same], 10**9)
            yield Readings(
                same,
                data,
                np.array([reading.crank_angle for reading in readings]),
                np.full(len(same), math.nan),
                np.array([reading.stddev for reading in readings]),
                sec.astype(np.int32),
                nanosec.astype(np.uint32),
                "",
            )

    @property
    def _points(self) -> tuple[float, ...]:
        return self.percent_calibration[0::2]

    @property
    def _angles(self) -> tuple[float, ...]:
        return self.percent_calibration[1::2]

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self._points, self._angles)

    @cached_property
    def _slope(self) -> PchipInterpolator:
        return self._curve.derivative()
