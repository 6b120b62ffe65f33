# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The units of the inputs, and how numbers in them become crank angles and speeds."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray

ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}  # Units of an angle, in rad
CALIBRATED = ("percent", "m", "any")  # units of hitch positions whose angles the calibration gives
ROTATIONS = {"rpm": 1.0, "rad/s": 30.0 / math.pi, "Hz": 60.0}  # of engine and PTO, in rpm
SPEEDS = {"m/s": 1.0, "km/h": 1.0 / 3.6}  # Units of the ground speed, in m/s

_NAMES = {unit.lower(): unit for unit in (*ANGLES, "percent", "m", *ROTATIONS, *SPEEDS)}
_NAMES |= {"%": "percent", "°": "deg", "degree": "deg", "degrees": "deg", "1/min": "rpm"}
_NAMES |= {"kph": "km/h", "kmh": "km/h"}
_NAMES |= {each.lower(): each for each in ("mm", "cm", "in", "mph", "kn", "knots", "V", "mV", "mA")}

PERCENT_STEP = 0.4  # Resolution of a hitch position on the ISO 11783 bus, % per bit

_LONGEST = 10.0  # m; no part of a hitch moves so far


class InputError(LinkageVibrationError):
    """The parameters of an input cannot be used."""


def wrong_unit(stated: str, expected: str, name: str) -> str:
    """Return that a stated unit is another than an input expects; empty if that is not sure."""
    unit = _NAMES.get(stated.strip().lower(), "")
    if not unit or expected in ("", "any", unit):
        return ""
    hitch = name == "hitch"
    if unit in ((*ANGLES, *CALIBRATED) if hitch else SPEEDS if name == "ground" else ROTATIONS):
        remedy = f"write `{name}_unit: {unit}`"
    elif hitch:
        remedy = "write `hitch_unit: any` and a calibration in this unit"
    else:
        remedy = f"write {name}_scale, the {expected} in one {unit}"
    return f"is in {unit}, but {name}_unit is {expected}; {remedy}."


@dataclass(frozen=True, slots=True)
class Reading:
    """The crank angle that one message reports."""

    crank_angle: float  # alpha3, rad; NaN if it is not available
    velocity: float  # rad/s; NaN if it is unknown
    stddev: float  # standard deviation of the crank angle, rad


@dataclass(frozen=True)
class HitchCurve:
    """A monotone curve (PCHIP) through pairs of a hitch position and the crank angle there, rad."""

    pairs: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check the pairs."""
        pairs, points, angles = self.pairs, self.points, self.pairs[1::2]
        if len(pairs) % 2 or len(pairs) < 4:
            raise InputError(
                f"calibration has {len(pairs)} numbers; give at least two pairs of a hitch "
                "position and a crank angle, such as [0.0, 3.14159, 100.0, 1.5708]."
            )
        if not all(map(math.isfinite, pairs)):
            raise InputError("calibration must be finite; replace NaN and infinity.")
        largest = max(angles, key=abs)
        if abs(largest) > 2.0 * math.pi:
            raise InputError(
                f"calibration has an angle of {largest:g} rad, which exceeds a full turn; "
                f"give angles in rad. If it is in degrees, write {math.radians(largest):.6g}."
            )
        least = 1e-5 * abs(points[-1] - points[0])
        for i, step in enumerate(np.diff(points), start=1):
            if not step > 0.0 or step < least:
                raise InputError(
                    f"The positions of calibration must ascend, but position {i + 1} "
                    f"({points[i]:g}) does not exceed {points[i - 1]:g}; sort the pairs."
                )
        steps = np.diff(angles)
        wrong = np.flatnonzero(steps * steps[0] <= 0.0)
        if len(wrong):
            i = 1 + int(wrong[0])
            raise InputError(
                "The angles of calibration must all ascend or all descend, but angle "
                f"{i + 1} ({angles[i]:g} rad) does not continue from {angles[i - 1]:g} rad; "
                "correct one of them."
            )

    @property
    def points(self) -> tuple[float, ...]:
        """The positions."""
        return self.pairs[0::2]

    @cached_property
    def curve(self) -> "scipy.interpolate.PchipInterpolator":
        """The crank angle over the position, rad."""
        return scipy.interpolate.PchipInterpolator(self.points, self.pairs[1::2])

    @cached_property
    def slope(self) -> "scipy.interpolate.PchipInterpolator":
        """Its derivative, rad per unit of the position."""
        return self.curve.derivative()


@dataclass(frozen=True)
class HitchScale:
    """How a number becomes a crank angle: position = sign * scale * number + offset, in its unit.

    Positions that are no angle are looked up in the calibration; outside of it the crank angle is
    NaN, also for what the ISO 11783 bus sends as error or not available (101.6 and 102 %).
    """

    unit: str  # "rad", "deg", "percent" (0 is down), "m" (of a cylinder), or "any" (such as V)
    sign: int = 1  # 1 or -1
    scale: float = 1.0  # unit per unit of the number
    offset: float = 0.0  # position at the number 0
    calibration: HitchCurve = HitchCurve((0.0, math.pi, 100.0, math.pi / 2.0))
    angle_stddev: float = 0.0  # rad; with percent, that of the bus's steps of 0.4 % is added
    fixed: float = math.nan  # a number that replaces all numbers; NaN if there is none

    def __post_init__(self) -> None:
        """Check that the calibration is one of this unit, and that it has a fixed position."""
        first, last = self._ends
        if self.unit not in ANGLES and (self.fixed < first or self.fixed > last):
            raise InputError(
                f"hitch_position is {self.fixed:g}, but calibration reaches from {first:g} to "
                f"{last:g}; give a position between them, in the unit {self.unit}."
            )
        if self.unit == "percent" and (first, last) != (0.0, 100.0):
            raise InputError(
                f"calibration reaches from {first:g} to {last:g} %; begin at 0 and end at 100 %."
            )
        if self.unit == "m" and max(abs(first), abs(last)) > _LONGEST:
            raise InputError(
                f"calibration reaches from {first:g} to {last:g} m, which no hitch does; give "
                "pairs of a length in m and the crank angle there in rad, as the unit is m."
            )

    def reading(self, number: float, rate: float = math.nan) -> Reading:
        """Return the crank angle of a number and its rate (1/s, NaN if unknown)."""
        if self.unit in ANGLES and math.isnan(self.fixed):  # joint states may come at a high rate
            return Reading(self._gain * number + self._offset, self._gain * rate, self.angle_stddev)
        columns = self.columns(np.array([number]), np.array([rate]))
        return Reading(*(float(column[0]) for column in columns))

    def columns(
        self, numbers: FloatArray, rates: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return crank angles, velocities and standard deviations, each (n,); see `reading`."""
        if not math.isnan(self.fixed):
            numbers, rates = np.full(len(numbers), self.fixed), np.zeros(len(numbers))
        position, moved = self._gain * numbers + self._offset, self._gain * rates
        stddev = np.full(len(numbers), self.angle_stddev)
        if self.unit in ANGLES:
            return position, moved, stddev
        first, last = self._ends
        position = np.where((first <= position) & (position <= last), position, math.nan)
        slope = self.calibration.slope(position)
        if self.unit == "percent":
            # Rounding to a step causes a standard deviation of step / sqrt(12).
            stddev = np.hypot(slope * PERCENT_STEP / math.sqrt(12.0), stddev)
        return self.calibration.curve(position), slope * moved, stddev + 0.0 * position

    @cached_property
    def _gain(self) -> float:
        return self.sign * self.scale * ANGLES.get(self.unit, 1.0)

    @cached_property
    def _offset(self) -> float:
        return self.offset * ANGLES.get(self.unit, 1.0)

    @cached_property
    def _ends(self) -> tuple[float, float]:
        return self.calibration.points[0], self.calibration.points[-1]
