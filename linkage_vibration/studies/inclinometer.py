# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Fits the calibration from readings of the hitch sensor to alpha3 to inclinations of a body."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import yaml
from numpy.typing import ArrayLike

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import kinematics_of

_BEYOND = math.radians(3.0)  # an inclination may lie beyond the stroke by its error
_DEGREE = 3  # a sensor that a lever turns bends to both sides of a straight line
_WINDOW = 0.5  # s, before and after a moment
_KNOTS, _STEPS = 13, 20  # of the calibration, and between two of them


class InclinometerError(LinkageVibrationError):
    """Measured inclinations give no calibration."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorFit:
    """A cubic polynomial from readings to crank angles."""

    residuals: FloatArray  # (n_points,): measured less fitted crank angles, rad
    excess: float  # RMS of the residuals over the deviation that the inclinometer explains
    knots: FloatArray  # (13, 2): readings and crank angles of the parameter ``calibration``
    stddev: float  # the largest of a crank angle between the first and the last knot, rad


def calibrate(
    mechanism: Mechanism,
    body: str,
    unit: str,
    moments: Sequence[str],
    readings: Sequence[str],
    series: tuple[IntArray, FloatArray] | None,
    tractor_deg: float = 0.0,
    stddev_deg: float = 0.5,
) -> tuple[SensorFit, str]:
    """Return the fit to angles (deg) at moments of a bag and at readings, and its report.

    The series holds times (ns) and readings of the bag, which the calibration contains; that of
    percent reaches from 0 to 100.
    """
    if not 0.0 < stddev_deg < math.inf or not math.isfinite(tractor_deg):
        given = f"{stddev_deg:g} deg and the inclination of {tractor_deg:g} deg"
        raise InclinometerError(f"The deviation of {given} have to be finite, the first above 0.")
    words = [*moments, *readings]
    points = number_pairs(words)
    noise, ends = 0.0, np.empty(0)
    if series is not None:
        ends = np.unique(series[1][np.isfinite(series[1])])
        if not len(ends):
            raise InclinometerError("The bag has no reading; record it while the sensor works.")
        since = (series[0] - series[0][0]) / 1e9
        # A hitch at rest does not show how coarse its sensor is. The node knows steps of percent.
        step = float(np.diff(ends).min(initial=np.ptp(ends)))
        noise = 0.0 if unit == "percent" else step / math.sqrt(12.0)
        for point in points[: len(moments)]:
            point[0], deviation = reading_at(since, series[1], float(point[0]))
            noise = max(noise, deviation)
    if unit == "percent":
        ends = np.array([0.0, 100.0])
    alpha3, slopes = crank_angles(mechanism, body, np.radians(points[:, 1] - tractor_deg))
    line = fit(points[:, 0], alpha3, np.radians(stddev_deg) * np.abs(slopes), ends, noise)
    return line, report(words, points[:, 0], alpha3, line)


def number_pairs(words: Sequence[str]) -> FloatArray:
    """Return the numbers on both sides of ``=`` of each word, such as 12.5=-38.2, (n, 2)."""
    pairs = []
    for word in words:
        try:
            first, second = map(float, word.split("="))
        except ValueError:
            first = second = math.nan
        if not abs(first) + abs(second) < 1e12:  # larger numbers lose their digits
            raise InclinometerError(f"{word}: write two numbers, such as 12.5=-38.2.")
        pairs.append((first, second))
    return np.reshape(pairs, (-1, 2)).astype(float)


def reading_at(times: FloatArray, readings: FloatArray, moment: float) -> tuple[float, float]:
    """Return the mean of readings, (n,), around a moment (s), and the deviation of one of them."""
    window = readings[(np.abs(times - moment) <= _WINDOW) & np.isfinite(readings)]
    if not len(window):
        hint = f"choose a moment from 0 to {times[-1]:.3f} s after the first reading of the bag"
        raise InclinometerError(f"No reading is within {_WINDOW:g} s of {moment:g} s; {hint}.")
    return float(window.mean()), float(window.std())


def crank_angles(
    mechanism: Mechanism, body: str, inclinations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return alpha3 at inclinations of a body, (n,), rad, and d(alpha3)/d(inclination), (n,).

    The inclination is the angle of the body's x axis against the ground's, positive where the end
    ahead is higher. Half turns do not count, as an inclinometer does not distinguish the two ends.
    """
    names = [each.name for each in mechanism.bodies]
    if body not in names:
        raise InclinometerError(f"There is no body {body!r}; name one of: {', '.join(names)}.")
    kinematics, (first, last) = kinematics_of(mechanism), mechanism.stroke
    low, high = kinematics.closable_range
    grid = np.linspace(max(first - _BEYOND, low + 1e-6), min(last + _BEYOND, high - 1e-6), 721)
    angles = np.unwrap([kinematics.at(alpha3).angle(body) for alpha3 in grid.tolist()])
    if angles[-1] < angles[0]:
        grid, angles = grid[::-1], angles[::-1]
    if np.diff(angles).min() <= 0.0:
        hint = f"measure on another body, such as {mechanism.input_body}"
        raise InclinometerError(f"{body} has one inclination at two crank angles; {hint}.")
    angles -= math.pi * round(angles.mean() / math.pi)
    shown = angles.mean() + np.remainder(inclinations - angles.mean() + math.pi / 2.0, math.pi)
    shown -= math.pi / 2.0
    for angle in inclinations[(shown < angles[0]) | (shown > angles[-1])].tolist():
        raise InclinometerError(
            f"No pose has {body} at the inclination {math.degrees(angle):.2f} deg, but at "
            f"{math.degrees(angles[0]):.1f} to {math.degrees(angles[-1]):.1f} deg. Check the sign "
            "(positive where the end ahead is higher), the inclination of the tractor, and the "
            "lengths of the mechanism."
        )
    return np.interp(shown, angles, grid), np.interp(shown, angles, np.gradient(grid, angles))


def fit(
    readings: FloatArray, alpha3: FloatArray, stddev: FloatArray, ends: ArrayLike, noise: float
) -> SensorFit:
    """Fit a cubic polynomial to points, (n,), that reaches to some more readings, (m,).

    The deviation contains those of the coefficients and the noise of a reading; it grows with the
    residuals if these are larger than the deviations of the points, (n,), explain.
    """
    if len(np.unique(np.float32(readings))) < _DEGREE + 2:
        hint = f"measure at {_DEGREE + 2} or more heights over the whole stroke"
        raise InclinometerError(f"{len(readings)} points do not show their errors; {hint}.")
    reach = np.append(readings, ends)
    middle, half = (reach.max() + reach.min()) / 2.0, np.ptp(reach) / 2.0
    places = (readings - middle) / half
    curve, covariance = np.polyfit(places, alpha3, _DEGREE, w=1.0 / stddev, cov="unscaled")
    residuals = alpha3 - np.polyval(curve, places)
    excess = math.sqrt(((residuals / stddev) ** 2).sum() / (len(readings) - _DEGREE - 1))
    grid = np.linspace(-1.0, 1.0, _STEPS * (_KNOTS - 1) + 1)
    angles, slopes = np.polyval(curve, grid), np.polyval(np.polyder(curve), grid) / half
    if np.ptp(np.sign(slopes)) or not np.all(slopes):
        raise InclinometerError("The curve through the points turns back; check the angles.")
    powers = np.vander(grid, _DEGREE + 1)
    variance = np.einsum("ij,jk,ik->i", powers, covariance, powers) * max(excess, 1.0) ** 2
    largest = math.sqrt((variance + (slopes * noise) ** 2).max())
    knots = np.stack([middle + half * grid, angles], axis=1)[::_STEPS]
    return SensorFit(residuals, excess, knots, largest)


def report(words: Sequence[str], readings: FloatArray, alpha3: FloatArray, line: SensorFit) -> str:
    """Return the points with their residuals, the deviation of the fit, and its warnings."""
    lines = [f"{'point':>16}{'reading':>12}{'alpha3 [deg]':>14}{'residual':>10}"]
    for word, reading, *angles in zip(words, readings, alpha3, line.residuals, strict=True):
        angle, residual = np.degrees(angles).round(2) + 0.0  # a zero has no sign
        lines.append(f"{word:>16}{reading:12.6g}{angle:14.2f}{residual:+10.2f}")
    first, last = line.knots[[0, -1], 0]
    lines.append(
        f"The standard deviation is at most {math.degrees(line.stddev):.2f} deg. The node has no "
        f"angle for readings below {first:.6g} or above {last:.6g}."
    )
    if line.excess > 2.0:
        worst = words[int(np.abs(line.residuals).argmax())]
        lines.append(
            f"The residuals are {line.excess:.1f} times as large as the inclinometer explains, "
            f"most at {worst}: measure it again, or check the lengths of the mechanism."
        )
    return "\n".join(lines)


def parameters(line: SensorFit, unit: str) -> str:
    """Return the YAML of the parameters that use a calibration of readings in a unit."""
    knots = [x for a, b in line.knots.tolist() for x in (float(f"{a:.15g}"), round(b, 9))]
    values: dict[str, object] = {"hitch_sign": 1, "hitch_scale": 1.0, "hitch_offset": 0.0}
    values |= {"hitch_unit": unit, "calibration": knots}
    values["angle_stddev"] = round(max(line.stddev, 1e-6), 6)
    content = {"/**": {"ros__parameters": values}}
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=math.inf)
