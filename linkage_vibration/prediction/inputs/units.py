# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The units of the inputs, and how numbers in them become crank angles and speeds."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from linkage_vibration.errors import LinkageVibrationError

FloatArray = NDArray[np.float64]

ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}
"""Units of an angle, in rad."""
CALIBRATED = ("percent", "m", "any")
"""Units of a hitch position whose angle follows from the calibration."""
ROTATIONS = {"rpm": 1.0, "rad/s": 30.0 / math.pi, "Hz": 60.0}
"""Units of the speeds of engine and PTO, in rpm."""
SPEEDS = {"m/s": 1.0, "km/h": 1.0 / 3.6}
"""Units of the ground speed, in m/s."""

_NAMES = {unit.lower(): unit for unit in (*ANGLES, "percent", "m", *ROTATIONS, *SPEEDS)}
_NAMES |= {"%": "percent", "°": "deg", "degree": "deg", "degrees": "deg", "1/min": "rpm"}
_NAMES |= {"kph": "km/h", "kmh": "km/h"}
_NAMES |= {each.lower(): each for each in ("mm", "cm", "in", "mph", "kn", "knots", "V", "mV", "mA")}

PERCENT_STEP = 0.4
"""Resolution of a hitch position on the ISO 11783 bus, % per bit."""

_LEAST_STEP = 1e-3  # %; below, the slope of a calibration is meaningless
_LONGEST = 10.0  # m; no part of a hitch moves as far


class InputError(LinkageVibrationError):
    """The parameters of an input cannot be used."""


def wrong_unit(stated: str, expected: str, name: str) -> str:
    """Return that a number has another unit than is expected; empty if that cannot be said.

    Parameters
    ----------
    stated, expected : str
        The unit that a description of the number states, as people write it, and that of the
        input; each may be empty.
    name : str
        The input: "hitch", "engine", "pto" or "ground".
    """
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


@dataclass(frozen=True)
class Calibration:
    """A monotone curve from a hitch position to the crank angle, through given points (PCHIP).

    Attributes
    ----------
    pairs : tuple of float
        A position and the crank angle there (rad), one pair after the other. The positions ascend,
        and the angles all ascend or all descend.

    Raises
    ------
    InputError
        If there are fewer than two pairs, if they are not finite and strictly monotone, or if an
        angle exceeds a full turn, as angles in degrees do.
    """

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
    def curve(self) -> PchipInterpolator:
        """The crank angle over the position, rad."""
        return PchipInterpolator(self.points, self.pairs[1::2])

    @cached_property
    def slope(self) -> PchipInterpolator:
        """Its derivative, rad per unit of the position."""
        return self.curve.derivative()


@dataclass(frozen=True)
class HitchScale:
    """How a number becomes a crank angle: position = sign * scale * number + offset, in its unit.

    An angle is the crank angle. Other positions are looked up in the calibration; outside of it
    the crank angle is NaN, also for the values by which the ISO 11783 bus says "error" and "not
    available" (101.6 and 102 %).

    Attributes
    ----------
    unit : str
        "rad", "deg", "percent" (0 is down, 100 is up), "m" such as the stroke of a cylinder, or
        "any" such as V.
    sign : int
        1 or -1.
    scale, offset : float
        Unit per unit of the number, and the position at the number 0.
    calibration : Calibration
    angle_stddev : float
        Standard deviation of the crank angle, rad; with percent, the standard deviation that the
        bus's steps of 0.4 % cause is added.

    Raises
    ------
    InputError
        If the calibration does not reach from 0 to 100 %, or is not one of lengths in m.
    """

    unit: str
    sign: int = 1
    scale: float = 1.0
    offset: float = 0.0
    calibration: Calibration = Calibration((0.0, math.pi, 100.0, math.pi / 2.0))
    angle_stddev: float = 0.0

    def __post_init__(self) -> None:
        """Check that the calibration is one of this unit."""
        first, last = self._ends
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
        """Return the crank angle of a number.

        Parameters
        ----------
        number, rate : float
            The number and its rate, 1/s, which is NaN if unknown.
        """
        gain = self._gain
        position, moved = gain * number + self._offset, gain * rate
        if self.unit in ANGLES:
            return Reading(position, moved, self.angle_stddev)
        first, last = self._ends
        if not first <= position <= last:
            return Reading(math.nan, math.nan, math.nan)
        slope, stddev = float(self.calibration.slope(position)), self.angle_stddev
        if self.unit == "percent":
            # Rounding to a step causes a standard deviation of step / sqrt(12).
            stddev = math.hypot(abs(slope) * PERCENT_STEP / math.sqrt(12.0), stddev)
        return Reading(float(self.calibration.curve(position)), slope * moved, stddev)

    def columns(
        self, numbers: FloatArray, rates: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return crank angles, velocities and standard deviations, each (n,); see `reading`.

        Parameters
        ----------
        numbers, rates : ndarray, (n,)
        """
        if self.unit in ANGLES:
            angles = self._gain * numbers + self._offset
            return angles, self._gain * rates, np.full(len(numbers), self.angle_stddev)
        pairs = zip(numbers.tolist(), rates.tolist(), strict=True)
        readings = [self.reading(*pair) for pair in pairs]
        found = [(one.crank_angle, one.velocity, one.stddev) for one in readings]
        angles, velocities, stddevs = np.array(found, float).reshape(-1, 3).T
        return angles, velocities, stddevs

    @cached_property
    def _gain(self) -> float:
        return self.sign * self.scale * ANGLES.get(self.unit, 1.0)

    @cached_property
    def _offset(self) -> float:
        return self.offset * ANGLES.get(self.unit, 1.0)

    @cached_property
    def _ends(self) -> tuple[float, float]:
        return self.calibration.points[0], self.calibration.points[-1]
