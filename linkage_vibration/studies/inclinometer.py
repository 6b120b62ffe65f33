# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Derives the calibration from readings of the hitch sensor to alpha3 from inclinations."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import yaml
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.stats import chi2

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics

PERCENT = "percent"
"""The unit of a position that the node takes in steps of 0.4 %."""

_BEYOND = math.radians(3.0)  # of the stroke, within which an inclination may lie by its error
_ANGLES = 361  # over the stroke, between which an inclination is searched
_HIGHEST_DEGREE = 5
_UNLIKELY = 1e-3  # probability of a scatter that the deviation of the inclinometer explains
_LARGEST = 1e12  # of a reading; beyond it, numbers lose their digits
_KNOTS = 13  # of a calibration that is not a straight line
_WINDOW = 0.5  # s, before and after a moment
_STILL = 3.0  # deviations by which the hitch may drift in a window
_TURNED_BACK = 3.0  # deviations by which an angle may turn back between two points
_FLAT = 1e-6  # of the largest slope; a curve with a smaller one is not monotone
_EQUAL = 1e-9  # rad; only rounding may distinguish angles that differ by less
_EQUAL_SCORE = 1e-6  # by which a higher degree has to be better


class InclinometerError(LinkageVibrationError):
    """Measured inclinations give no calibration."""


@dataclass(frozen=True, slots=True)
class AngleReading:
    """A reading of the hitch sensor, and the crank angle that was measured with it."""

    label: str  # the moment or the reading, as it was given
    reading: float  # in the unit of the sensor
    inclination: float  # of the body against the tractor, rad
    alpha3: float  # rad
    stddev: float  # of alpha3, rad


@dataclass(frozen=True, slots=True, eq=False)
class ReadingCurve:
    """A monotone curve from readings to crank angles."""

    points: tuple[AngleReading, ...]  # their readings ascend
    residuals: FloatArray  # (n_points,): measured less fitted crank angles, rad
    degree: int  # of the polynomial
    pairs: tuple[float, ...]  # the parameter ``calibration``: readings and angles (rad) in turn
    stddev: float  # the largest of a crank angle between the ends of the curve, rad
    excess: float  # RMS of residuals over their deviations if it is too large for chance, or NaN


@dataclass(frozen=True, slots=True, eq=False)
class Inclinometer:
    """Where the inclinometer lies, and how far its angles can be trusted."""

    mechanism: Mechanism
    kinematics: Kinematics
    body: str  # along whose x axis it lies
    tractor_deg: float  # inclination of the tractor
    stddev_deg: float  # standard deviation of an angle

    def point(self, label: str, reading: float, degrees: float) -> AngleReading:
        """Return the point of a reading and an inclination in degrees; errors name the label."""
        inclination = math.radians(degrees - self.tractor_deg)
        try:
            alpha3, slope = crank_angle(self.mechanism, self.kinematics, self.body, inclination)
        except InclinometerError as error:
            raise InclinometerError(f"{label}: {error}") from None
        stddev = math.radians(self.stddev_deg) * abs(slope)
        return AngleReading(label, reading, inclination, alpha3, stddev)


def calibrate(
    inclinometer: Inclinometer,
    times: Sequence[str],
    readings: Sequence[str],
    series: tuple[IntArray, FloatArray] | None,
    unit: str,
) -> ReadingCurve:
    """Fit the calibration to angles (deg) at moments of a bag and at readings.

    The words are such as ``12.5=-38.2``: seconds after the first reading of the bag, or readings,
    and the angle that the inclinometer showed. The series holds times (ns) and readings of the bag,
    which the calibration contains; that of percent reaches from 0 to 100.
    """
    if not 0.0 < inclinometer.stddev_deg < math.inf or not math.isfinite(inclinometer.tractor_deg):
        raise InclinometerError(
            f"The deviation of {inclinometer.stddev_deg:g} deg and the inclination of "
            f"{inclinometer.tractor_deg:g} deg have to be finite, and the first greater than 0."
        )
    points, squares = [], []
    for label, moment, degrees in pairs_of(times, "S=DEG, such as 12.5=-38.2"):
        assert series is not None
        reading, noise = still_reading(*series, moment, label)
        points.append(inclinometer.point(label, reading, degrees))
        squares.append(noise**2)
    for label, reading, degrees in pairs_of(readings, "READING=DEG, such as 43.2=-38.2"):
        points.append(inclinometer.point(label, reading, degrees))
    available = np.empty(0) if series is None else np.unique(series[1][np.isfinite(series[1])])
    if series is not None and not len(available):
        raise InclinometerError(
            "The bag has no reading that is available; record it while the sensor works, or "
            "give --readings without a bag."
        )
    noise = math.sqrt(np.mean(squares)) if squares else 0.0
    if unit == PERCENT:
        return fit(points, [0.0, 100.0], noise)
    # A hitch at rest does not show how coarse its sensor is.
    steps = np.diff(available)
    coarseness = float(steps.min()) / math.sqrt(12.0) if len(steps) else 0.0
    return fit(points, available, max(noise, coarseness))


def pairs_of(words: Sequence[str], form: str) -> list[tuple[str, float, float]]:
    """Return the words (of the form that an error shows) and the numbers on both sides of ``=``."""
    entries = []
    for word in words:
        try:
            first, second = map(float, word.split("="))
        except ValueError:
            first = second = math.nan
        if not abs(first) + abs(second) < _LARGEST:
            raise InclinometerError(f"{word}: write {form}.")
        entries.append((word, first, second))
    return entries


def crank_angle(
    mechanism: Mechanism, kinematics: Kinematics, body: str, inclination: float
) -> tuple[float, float]:
    """Return alpha3 (rad) at which a body has an inclination (rad), and d(alpha3)/d(inclination).

    The inclination is the angle of the body's x axis against the ground's, positive where the end
    ahead is higher. Half turns do not count, as an inclinometer does not distinguish the two ends.
    """
    names = [each.name for each in mechanism.bodies]
    if body not in names:
        raise InclinometerError(f"There is no body {body!r}; name one of: {', '.join(names)}.")
    low, high = kinematics.closable_range
    first, last = mechanism.stroke
    edge = 1e-6  # rad, from a toggle
    first, last = max(first - _BEYOND, low + edge), min(last + _BEYOND, high - edge)
    grid = np.linspace(first, last, _ANGLES).tolist()

    def away(alpha3: float) -> float:
        return math.sin(kinematics.at(alpha3).angle(body) - inclination)

    values = [away(alpha3) for alpha3 in grid]
    steps = zip(grid, grid[1:], values, values[1:], strict=False)
    roots = [float(brentq(away, a, b)) for a, b, fa, fb in steps if fa == 0.0 or fa * fb < 0.0]
    if len(roots) == 1:
        ratio = kinematics.at(roots[0]).velocity_ratio(body)
        return roots[0], 1.0 / ratio if abs(ratio) > 1e-9 else math.inf
    degrees = f"{math.degrees(inclination):.2f} deg"
    if roots:
        listing = " and ".join(f"{math.degrees(root):.2f}" for root in roots)
        raise InclinometerError(
            f"{body} has the inclination {degrees} at alpha3 = {listing} deg, so that it does not "
            f"show the crank angle; measure on another body, such as {mechanism.input_body}."
        )
    ends = np.linspace(*mechanism.stroke, 5).tolist()
    turned = [_slope(kinematics.at(alpha3).angle(body)) for alpha3 in ends]
    listing = ", ".join(f"{math.degrees(angle):.1f}" for angle in turned)
    raise InclinometerError(
        f"No pose in the stroke has {body} at the inclination {degrees}; from its beginning to its "
        f"end, {body} has {listing} deg. Check the sign (positive where the end ahead is higher), "
        "the inclination of the tractor, and the lengths of the mechanism."
    )


def _slope(angle: float) -> float:
    """Return an angle as an inclinometer shows it, -pi/2 to pi/2."""
    return (angle + math.pi / 2.0) % math.pi - math.pi / 2.0


def still_reading(
    times: IntArray, values: FloatArray, moment: float, label: str
) -> tuple[float, float]:
    """Return the mean reading around a moment (s), and the standard deviation of one reading.

    Times are in ns, ascending; readings that are not available are NaN. The label is for errors.
    """
    since = (times - times[0]) / 1e9
    if not 0.0 <= moment <= since[-1]:
        raise InclinometerError(
            f"{label}: {moment:g} s is outside the bag, whose readings end after {since[-1]:.3f} "
            "s; give seconds after its first reading."
        )
    near = (np.abs(since - moment) <= _WINDOW) & np.isfinite(values)
    if not near.any():
        raise InclinometerError(
            f"{label}: there is no reading within {_WINDOW:g} s; choose another moment."
        )
    window, at = values[near], since[near]
    if len(window) < 4:
        return float(window.mean()), 0.0
    line = np.polyfit(at - at.mean(), window, 1)
    noise = float(np.std(window - np.polyval(line, at - at.mean()), ddof=2))
    drift = abs(float(line[0])) * float(np.ptp(at))
    step = np.diff(np.unique(window))
    resolution = float(step.min()) if len(step) else 0.0
    rounding = 1e-9 * max(1.0, abs(float(window.mean())))
    if drift > max(_STILL * noise, _STILL * resolution, rounding):
        raise InclinometerError(
            f"{label}: the reading changes by {drift:.4g} within {np.ptp(at):.2f} s, so the hitch "
            "moves; choose a moment at which it is at rest."
        )
    return float(window.mean()), noise


def fit(points: Sequence[AngleReading], readings: ArrayLike, reading_stddev: float) -> ReadingCurve:
    """Fit a monotone polynomial to points so that it contains some more readings, (n,).

    Its degree has the smallest sum of squares plus twice the number of coefficients (Akaike), and
    is the lowest of equal ones.
    """
    ordered = tuple(sorted(points, key=lambda point: point.reading))
    x, y, sigma = (
        np.array([getattr(p, k) for p in ordered]) for k in ("reading", "alpha3", "stddev")
    )
    _check_points(ordered, x, y, sigma)
    inside = np.append(x, readings)
    low, high = float(inside.min()), float(inside.max())
    middle, half = (x[0] + x[-1]) / 2.0, (x[-1] - x[0]) / 2.0
    places, grid = ((at - middle) / half for at in (x, np.linspace(low, high, 201)))
    candidates = []
    highest = min(_HIGHEST_DEGREE, len(ordered) - 2, len(np.unique(x)) - 1)
    for degree in range(1, highest + 1):
        curve, covariance = np.polyfit(places, y, degree, w=1.0 / sigma, cov="unscaled")
        squares = float((((y - np.polyval(curve, places)) / sigma) ** 2).sum())
        if _monotone(curve, grid):
            score = squares + (2.0 + _EQUAL_SCORE) * degree
            candidates.append((score, degree, squares, curve, covariance))
    if not candidates:
        raise InclinometerError(
            "No monotone curve passes near the points; check their order and the angles."
        )
    _, degree, squares, curve, covariance = min(candidates, key=lambda fit: fit[0])
    freedom = len(ordered) - degree - 1
    excess = math.sqrt(squares / freedom)
    powers = np.vander(grid, degree + 1)
    variance = np.einsum("ij,jk,ik->i", powers, covariance, powers) * max(excess, 1.0) ** 2
    slopes = np.polyval(np.polyder(curve), grid) / half
    knots = np.linspace(low, high, 2 if degree == 1 else _KNOTS)
    angles = np.polyval(curve, (knots - middle) / half)
    return ReadingCurve(
        ordered,
        y - np.polyval(curve, places),
        degree,
        tuple(np.stack([knots, angles], axis=1).ravel().tolist()),
        math.sqrt(float((variance + (slopes * reading_stddev) ** 2).max())),
        excess if chi2.sf(squares, freedom) < _UNLIKELY else math.nan,
    )


def _monotone(coefficients: FloatArray, grid: FloatArray) -> bool:
    """Return whether a polynomial rises, or falls, everywhere between the ends of a grid."""
    bends = np.roots(np.polyder(coefficients, 2)).real
    places = np.append(grid, np.clip(bends, grid[0], grid[-1]))
    slopes = np.polyval(np.polyder(coefficients), places)
    sizes = np.abs(slopes)
    return bool(slopes.min() * slopes.max() > 0.0 and sizes.min() > _FLAT * sizes.max())


def _check_points(
    points: Sequence[AngleReading], x: FloatArray, y: FloatArray, sigma: FloatArray
) -> None:
    """Refuse points from which no monotone calibration follows."""
    if len(points) < 3:
        raise InclinometerError(
            f"{len(points)} points do not show their errors; measure three or more, five to eight "
            "for a sensor that does not follow a straight line."
        )
    if not np.isfinite(sigma).all():
        raise InclinometerError(
            "The body hardly turns with the crank at one of the points; measure on another body."
        )
    spread = float(np.ptp(x))
    way = 1.0 if np.mean((x - x.mean()) * y) >= -_EQUAL * spread else -1.0
    for i, j in itertools.combinations(range(len(points)), 2):
        back = way * (y[i] - y[j])
        if x[j] - x[i] <= 1e-9 * spread:
            back = abs(back)
        if back > _TURNED_BACK * math.hypot(sigma[i], sigma[j]):
            raise InclinometerError(
                f"The calibration is not monotone: {points[i].label} has the reading {x[i]:.6g}"
                f" and {math.degrees(y[i]):.2f} deg, {points[j].label} has {x[j]:.6g} and "
                f"{math.degrees(y[j]):.2f} deg; measure these points again."
            )
    if abs(y[-1] - y[0]) < 2.0 * _TURNED_BACK * math.hypot(sigma[0], sigma[-1]):
        raise InclinometerError(
            f"The points span {abs(math.degrees(y[-1] - y[0])):.2f} deg only; measure over the "
            "whole stroke."
        )


def curve_report(curve: ReadingCurve, body: str) -> str:
    """Return the points with their residuals, the deviation of the fit, and its warnings."""
    lines = [
        f"{'point':>16}{'reading':>12}{body + ' [deg]':>22}{'alpha3 [deg]':>14}{'residual':>10}"
    ]
    for point, residual in zip(curve.points, curve.residuals.tolist(), strict=True):
        lines.append(
            f"{point.label:>16}{point.reading:12.6g}{_degrees(point.inclination):22.2f}"
            f"{_degrees(point.alpha3):14.2f}{_degrees(residual):+10.2f}"
        )
    kind = "straight line" if curve.degree == 1 else f"polynomial of degree {curve.degree}"
    lines.append(
        f"The calibration is a {kind}; its standard deviation is at most "
        f"{math.degrees(curve.stddev):.2f} deg. The node has no angle for readings below "
        f"{curve.pairs[0]:.6g} or above {curve.pairs[-2]:.6g}."
    )
    if not math.isnan(curve.excess):
        sizes = np.abs(curve.residuals)
        worst = curve.points[int((sizes > sizes.max() - _EQUAL).argmax())]
        lines.append(
            f"The residuals are {curve.excess:.1f} times as large as the inclinometer explains, "
            f"most at {worst.label}: measure it again, or check the lengths of the mechanism."
        )
    below = curve.points[0].reading - curve.pairs[0]
    above = curve.pairs[-2] - curve.points[-1].reading
    if max(below, above) > 0.0:
        lines.append(
            f"The calibration is extrapolated by {below:.4g} below and {above:.4g} above the "
            "points, to reach all readings; measure nearer to the ends."
        )
    return "\n".join(lines)


def _degrees(angle: float) -> float:
    """Return an angle in degrees with two decimals, whose zero has no sign."""
    return round(math.degrees(angle), 2) + 0.0


def parameters(curve: ReadingCurve, unit: str) -> str:
    """Return the YAML of the parameters that use a calibration.

    The unit is "any" if it is rad or deg, whose positions are not looked up in a calibration.
    """
    pairs = zip(curve.pairs[::2], curve.pairs[1::2], strict=True)
    values = {
        "sign": 1,
        "scale": 1.0,
        "offset": 0.0,
        "hitch_unit": unit,
        "calibration": [x for a, b in pairs for x in (float(f"{a:.15g}"), round(b, 9))],
        "angle_stddev": round(max(curve.stddev, 1e-6), 6),
    }
    content = {"/**": {"ros__parameters": values}}
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=math.inf)
