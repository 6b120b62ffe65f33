# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The hitch position in percent as the crank angle."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

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
    read_floats,
)

PERCENT_STEP = 0.4
"""Resolution of a hitch position on the ISO 11783 bus, % per bit."""

# Beyond these limits the slopes of a calibration are meaningless.
_LEAST_STEP = 1e-3  # %
_LARGEST_ANGLE = 1e3  # rad


@dataclass(frozen=True)
class PercentInput(CrankInput):
    """The hitch position of ISO 11783, from 0 % (down) to 100 % (up), through a calibration.

    Between the points of the calibration the angle follows a monotone cubic (PCHIP), so that it
    never turns back. A value outside 0 to 100 %, which the bus uses for "error" and "not
    available", gives the angle NaN.

    Attributes
    ----------
    percent_points, percent_angles : tuple of float
        Hitch positions from 0 to 100, ascending, %, and crank angles there, monotone, rad.
    angle_stddev : float
        Standard deviation of the calibrated angle, rad; the standard deviation that the bus's
        steps of 0.4 % cause is added.

    Raises
    ------
    InputError
        If there are fewer than two points, if they are not finite, within 1000 rad, and strictly
        monotone with at least 0.001 % between them, or if they do not reach from 0 to 100 %.
    """

    topic = "hitch_position"
    type = FLOAT64
    description = (
        "Where `input` is `percent`, this topic replaces `joint_states`: the ISO 11783 rear hitch "
        "position, from 0 (down) to 100 (up)."
    )

    percent_points: tuple[float, ...]
    percent_angles: tuple[float, ...]
    angle_stddev: float = 0.0

    def __post_init__(self) -> None:
        """Check the points."""
        points, angles = self.percent_points, self.percent_angles
        if len(points) != len(angles) or len(points) < 2:
            raise InputError(
                f"percent_points has {len(points)} values and percent_angles has {len(angles)}; "
                "give at least two points, and one angle for each of them."
            )
        if not all(map(math.isfinite, (*points, *angles))):
            raise InputError(
                "percent_points and percent_angles must be finite; replace NaN and infinity."
            )
        if max(map(abs, angles)) > _LARGEST_ANGLE:
            raise InputError(
                f"percent_angles has an angle beyond {_LARGEST_ANGLE:g} rad; give angles in rad."
            )
        if (points[0], points[-1]) != (0.0, 100.0):
            raise InputError(
                f"percent_points reaches from {points[0]:g} to {points[-1]:g} %; begin at 0 and "
                "end at 100 %."
            )
        for i, step in enumerate(np.diff(points), start=1):
            if step < _LEAST_STEP:
                raise InputError(
                    f"percent_points must ascend, but point {i + 1} ({points[i]:g} %) does not "
                    f"exceed {points[i - 1]:g} %; sort the points."
                )
        steps = np.diff(angles)
        wrong = np.flatnonzero(steps * steps[0] <= 0.0)
        if len(wrong):
            i = 1 + int(wrong[0])
            raise InputError(
                f"percent_angles must all ascend or all descend, but angle {i + 1} "
                f"({math.degrees(angles[i]):g} deg) does not continue from "
                f"{math.degrees(angles[i - 1]):g} deg; correct one of them."
            )

    def describe(self, topic: str) -> str:
        """Return the topic of the hitch position, in words."""
        return f"hitch position on {topic}"

    def reading(self, message: Any) -> Reading:
        """Return what a ``std_msgs/Float64`` reports; see `angle_at`."""
        return self.angle_at(float(message.data))

    def angle_at(self, percent: float) -> Reading:
        """Return the crank angle at a hitch position (%); its velocity is unknown.

        Examples
        --------
        >>> hitch = PercentInput((0.0, 100.0), (3.0, 1.8))
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

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.percent_points, self.percent_angles)

    @cached_property
    def _slope(self) -> PchipInterpolator:
        return self._curve.derivative()
