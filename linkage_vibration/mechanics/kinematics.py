# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Loop closure: finds the configuration of every body at an input angle.

The pins alone leave one degree of freedom, so the closed positions of the linkage form a curve.
It is traced once by its arc length, from the pose that the description gives to the toggles at
which it turns back (or through a full turn). A configuration is then found by Newton's method from
a guess between traced points. Arc length passes a toggle where the input angle, as a parameter,
cannot, and stays on one branch of the assembly: where another crosses it, the determinant of the
equations of the pins changes its sign (Allgower and Georg, Numerical Continuation Methods, 1990,
ch. 8), and the trace ends.
"""

import copy
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray, Reals, real_number, real_numbers
from linkage_vibration.mechanics.closure import NEAR, Pins, cannot_close, closed_angles, pose_notice
from linkage_vibration.mechanics.description import GROUND, Mechanism, MechanismError, Point

_STEP = 0.3  # arc length, with lengths scaled by the largest body; about 10 deg of rotation
# A branch ends where even shorter steps fail; the error of alpha3 there is the square of it.
_LEAST_STEP = 1e-8
_BEND = 0.25  # rad; the curve should turn by this in a step, and twice that is rejected
_FASTEST = 1e6  # d(pose)/d(alpha3), in the same scale, of a pose that is not at a toggle
_APART = 1e-8  # Traced poses are distinguished if their variable differs by more.
_REMEMBERED = 8  # mechanisms of different geometry whose curves are not traced again
_TOLERANCE = 1e-13  # size of a Newton step, in the same scale, that ends the iteration


@dataclass(frozen=True, slots=True)
class Toggle:
    """An input angle at which the linkage locks and turns back, or may take another branch.

    Attributes
    ----------
    alpha3 : float
        rad.
    aligned : tuple of str
        Joints in line; empty if more than two bodies lock one another.
    bodies : tuple of str
        Bodies that could move there with the input held still.
    """

    alpha3: float
    aligned: tuple[str, ...]
    bodies: tuple[str, ...]

    def __str__(self) -> str:
        """Return where it is and why."""
        words = f"{math.degrees(self.alpha3):.3f} deg"
        if self.aligned:
            return f"{words} with {', '.join(self.aligned[:-1])} and {self.aligned[-1]} in line"
        return f"{words} where {', '.join(self.bodies)} lock one another"


class KinematicsError(LinkageVibrationError):
    """The linkage cannot close at alpha3, rad; `nearest` is a toggle, None if it is not finite."""

    def __init__(self, alpha3: float, nearest: Toggle | None, question: str = "") -> None:
        text = f"alpha3 = {alpha3} is not an angle; give a finite one."
        if nearest is not None:
            text = f"The linkage cannot close at alpha3 = {math.degrees(alpha3):.3f} deg; the "
            text += f"nearest angle at which it can is its toggle at {nearest}. {question}".rstrip()
        super().__init__(text)
        self.alpha3 = alpha3
        self.nearest = nearest


@dataclass(frozen=True)
class Configuration:
    """The pose of every body at one input angle, and its rate of change with that angle.

    In a stack of configurations, `Kinematics.stack`, each array and number has an axis before.

    Attributes
    ----------
    alpha3 : float
        Input angle, rad.
    bodies : tuple of str, (n,)
        Names, in the order of the rows below.
    origins, origin_rates : ndarray, (n, 2)
        Global x and z of each body's own origin, m, and their derivatives by alpha3, m/rad.
    angles, velocity_ratios : ndarray, (n,)
        Angle of each body's own x axis, rad, continuous between the toggles, and its derivative by
        alpha3, 1.
    toggle_distance : float
        rad, between alpha3 and the nearer toggle; infinite without toggles.
    """

    alpha3: float
    bodies: tuple[str, ...]
    origins: FloatArray
    angles: FloatArray
    origin_rates: FloatArray
    velocity_ratios: FloatArray
    toggle_distance: float

    def angle(self, body: str) -> float:
        """Return the angle of a body's own x axis, rad; that of the ground is 0."""
        return 0.0 if body == GROUND else float(self.angles[self.bodies.index(body)])

    def velocity_ratio(self, body: str) -> float:
        """Return d(angle of a body)/d(alpha3), 1; that of the ground is 0."""
        return 0.0 if body == GROUND else float(self.velocity_ratios[self.bodies.index(body)])

    def turn(self, body: str) -> FloatArray:
        """Return the (2, 2) matrix that turns a body's own components into global ones."""
        return self._turns[body]

    @cached_property
    def _turns(self) -> dict[str, FloatArray]:
        turns = np.ascontiguousarray(rotation(self.angles))
        return {GROUND: np.eye(2), **dict(zip(self.bodies, turns, strict=True))}

    def place(self, body: str, local: Point) -> FloatArray:
        """Return the global x and z, (2,), m, of a point.

        Parameters
        ----------
        body : str
            Its name, or "ground".
        local : (float, float)
            x and z in its axes, m.
        """
        if body == GROUND:
            return np.array(local)
        arm = self.turn(body) @ np.array(local)
        return np.asarray(self.origins[..., self.bodies.index(body), :] + arm)

    def place_rate(self, body: str, local: Point) -> FloatArray:
        """Return d(place)/d(alpha3) of a point, (2,), m/rad.

        Parameters
        ----------
        body : str
            Its name, or "ground".
        local : (float, float)
            x and z in its axes, m.
        """
        if body == GROUND:
            return np.zeros(2)
        i = self.bodies.index(body)
        turning = rotation_derivative(self.angle(body)) @ np.array(local)
        return np.asarray(self.origin_rates[i] + self.velocity_ratios[i] * turning)


def unit_question(alpha3: float, low: float, high: float) -> str:
    """Ask whether an angle in rad was given in the other unit; empty if neither is in a range."""
    degrees = math.degrees(alpha3)
    if abs(alpha3) > 2.0 * math.pi and low <= math.radians(alpha3) <= high:
        return f"{alpha3:.7g} deg is in range, so were degrees given in place of rad?"
    if low <= degrees <= high:
        return f"{degrees:.7g} rad is in range, so were radians given in place of degrees?"
    return ""


def rotation(angle: float | FloatArray) -> FloatArray:
    """Return the (2, 2) matrix that turns a body's own components into global ones.

    Of angles, (k, n), those of one column after the other are returned, (n, k, 2, 2).
    """
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s], [-s, c]]).T


def rotation_derivative(angle: float) -> FloatArray:
    """Return d(rotation)/d(angle), (2, 2)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[-s, -c], [c, -s]])


def _pins(mechanism: Mechanism, length: float) -> Pins:
    """Describe every pin, lengths divided by ``length``."""
    column = {body.name: i for i, body in enumerate(mechanism.bodies)}
    places = {name: mechanism.local_points(name) for name in (GROUND, *column)}
    n_rows, n = 2 * len(mechanism.joints) + 1, len(column)
    positions, ground = np.zeros((n_rows, 3 * n)), np.zeros(n_rows)
    cosines, sines = np.zeros((2, n_rows, n))
    for pin, (point, *bodies) in enumerate(mechanism.joints):
        row = 2 * pin
        for sign, body in zip((1.0, -1.0), bodies, strict=True):
            x, z = sign * np.array(places[body][point]) / length
            if body == GROUND:
                ground[row : row + 2] = x, z
                continue
            i = column[body]
            positions[row, 3 * i] = positions[row + 1, 3 * i + 1] = sign
            cosines[row : row + 2, i] = x, z
            sines[row : row + 2, i] = -z, x
    return Pins(positions, cosines, sines, ground)


def _spline(x: FloatArray, y: FloatArray) -> "_Spline":
    """Return the not-a-knot spline through values, (n, m), like CubicSpline, which loads slowly."""
    steps = np.diff(x)
    step, slope = steps[:, np.newaxis], np.diff(y, axis=0) / steps[:, np.newaxis]
    ends = np.array([x[2] - x[0], x[-1] - x[-3]])
    matrix = np.diag([steps[1], *2.0 * (steps[:-1] + steps[1:]), steps[-2]])
    matrix += np.diag([ends[0], *steps[:-1]], 1) + np.diag([*steps[1:], ends[1]], -1)
    right = np.empty_like(y)
    right[1:-1] = 3.0 * (step[1:] * slope[:-1] + step[:-1] * slope[1:])
    first = (step[0] + 2.0 * ends[0]) * step[1] * slope[0] + step[0] ** 2 * slope[1]
    last = step[-1] ** 2 * slope[-2] + (2.0 * ends[1] + step[-1]) * step[-2] * slope[-1]
    right[0], right[-1] = first / ends[0], last / ends[1]
    rates = np.linalg.solve(matrix, right)
    bend = (rates[:-1] + rates[1:] - 2.0 * slope) / step
    return _Spline(
        x, np.stack([y[:-1], rates[:-1], (slope - rates[:-1]) / step - bend, bend / step])
    )


def _same_place(pose: FloatArray, other: FloatArray) -> bool:
    """Return whether two poses differ by no more than full turns of the bodies."""
    difference = pose - other
    difference[2::3] = np.sin(difference[2::3] / 2.0)
    return bool(np.abs(difference).max() < 1e-6)


class _Spline(NamedTuple):
    """A cubic for each interval between knots, (n,), with coefficients (4, n - 1, m)."""

    knots: FloatArray
    coefficients: FloatArray

    def __call__(self, at: FloatArray) -> FloatArray:
        """Return the values at places."""
        i = self.knots[1:-1].searchsorted(at, "right")
        s = (at - self.knots[i])[..., np.newaxis]
        c = self.coefficients[:, i]
        return np.asarray(c[0] + c[1] * s + c[2] * (s * s) + c[3] * (s * s * s))


class Kinematics:
    """The closed positions of one mechanism on the branch of its assembly that it describes.

    Parameters
    ----------
    mechanism : Mechanism
        Its links may be described in any way, as only points and pins count.

    Attributes
    ----------
    toggles : tuple of two Toggle, or None
        Those below and above; None where the input can turn all the way.
    notice : str
        How the assembled pose differs from the angles given; empty if those are clear.

    Raises
    ------
    MechanismError
        If the linkage cannot close over its stroke.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._bodies = tuple(body.name for body in mechanism.bodies)
        points = [place for _, place in mechanism.ground]
        points += [p for body in self._bodies for p in mechanism.local_points(body).values()]
        self._length = max(math.hypot(*point) for point in points)
        self._pins = _pins(mechanism, self._length)
        self._input = np.zeros(3 * len(self._bodies))  # picks alpha3 out of a pose
        self._input[3 * self._bodies.index(mechanism.input_body) + 2] = 1.0
        alpha3, angles = mechanism.assembly_alpha3, dict(mechanism.assembly_angles)
        guess = np.array([angles.get(body, alpha3) for body in self._bodies])
        closed = self._close(self._pins.placed(guess), self._input, alpha3)
        if closed is not None and np.abs(closed[0][2::3] - guess).max() <= NEAR:
            self._follow(mechanism, closed)
            self.notice = ""
        else:
            free = self._input[2::3] == 0.0
            poses = closed_angles(self._pins, guess, free)
            tried = [self._close(self._pins.placed(each), self._input, alpha3) for each in poses]
            starts = [start for start in tried if start is not None]
            if not starts:
                raise cannot_close(self._pins, mechanism, guess, free, self._length)
            chosen = self._choose(mechanism, starts)
            self.notice = pose_notice(mechanism, [pose[2::3] for pose, _ in starts], chosen)

    @property
    def closable_range(self) -> tuple[float, float]:
        """The toggles' angles, rad; infinite where the input can turn all the way."""
        if self.toggles is None:
            return -math.inf, math.inf
        return self.toggles[0].alpha3, self.toggles[1].alpha3

    def at(self, alpha3: float) -> Configuration:
        """Return the configuration at an input angle in rad.

        Raises
        ------
        KinematicsError, LinkageVibrationError
            If the linkage cannot close there, or alpha3 is not one real number.
        """
        hint = "call it for each of them, or `build_table` and give all to `Predictor.predict`"
        alpha3 = real_number(alpha3, "alpha3", hint)
        return self._configuration(alpha3, *self._closed_at(alpha3))

    def stack(self, angles: Reals) -> Configuration:
        """Return the configurations at input angles, (k,), rad, as one with an axis before.

        The first one at which the linkage cannot close is refused, as `at` refuses it.
        """
        angles, closed = real_numbers(angles, "angles"), None
        if (self._away(angles) > 0.0).all():
            within = np.array([self._within(each) for each in angles.tolist()])
            closed = self._close(self._guess(self._evenly(within)), self._input, within)
        if closed is None:  # One by one, the first that does not close is found.
            pose, rate = zip(*map(self._closed_at, angles.tolist()), strict=True)
            closed = np.array(pose), np.array(rate)
        return self._configuration(angles, *closed)

    def _configuration(self, alpha3: Any, pose: FloatArray, rate: FloatArray) -> Configuration:
        """Return the configuration of a closed pose and its rate, (..., 3 n), lengths scaled."""
        scale = np.array([self._length, self._length, 1.0])
        bodies, rates = (rows.reshape(*rows.shape[:-1], -1, 3) * scale for rows in (pose, rate))
        poses = bodies[..., :2], bodies[..., 2], rates[..., :2], rates[..., 2]
        return Configuration(alpha3, self._bodies, *poses, toggle_distance=self._away(alpha3))

    def _away(self, alpha3: Any) -> Any:
        """Return how far input angles are from the nearer toggle, rad."""
        low, high = self.closable_range
        return np.minimum(alpha3 - low, high - alpha3)

    def _within(self, alpha3: float) -> float:
        """Return the angle in the traced turns, which later turns of the input repeat."""
        first, last = self._traced
        if first <= alpha3 <= last:
            return alpha3
        return float(first + (alpha3 - first) % self._period)

    def _closed_at(self, alpha3: float) -> tuple[FloatArray, FloatArray]:
        """Return the closed pose at an input angle, rad, and its rate."""
        low, high = self.closable_range
        closed = None
        if low < alpha3 < high:
            alpha = self._within(alpha3)
            closed = self._close(self._guess(self._evenly(alpha)), self._input, alpha)
        if closed is None:
            raise self._out_of_reach(alpha3)
        return closed

    def nearby(self, mechanism: Mechanism) -> "Kinematics":
        """Return the kinematics of a mechanism whose points differ little, with these toggles."""
        other = copy.copy(self)
        other._pins = _pins(mechanism, self._length)
        return other

    def _evenly(self, alpha3: float | FloatArray) -> FloatArray:
        """Turn alpha3 into a variable over which poses are smooth, also at toggles."""
        if self.toggles is None:
            return np.asarray(alpha3)
        low, high = self.closable_range
        share = (2.0 * np.asarray(alpha3) - low - high) / (high - low)
        return np.asarray(np.arcsin(np.clip(share, -1.0, 1.0)))

    def _out_of_reach(self, alpha3: float) -> KinematicsError:
        if self.toggles is None or not math.isfinite(alpha3):
            return KinematicsError(alpha3, None)
        low, high = self.toggles
        below = alpha3 - low.alpha3 < high.alpha3 - alpha3
        question = unit_question(alpha3, low.alpha3, high.alpha3)
        return KinematicsError(alpha3, low if below else high, question)

    def _close(
        self, pose: FloatArray, direction: FloatArray, target: float | FloatArray
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return closed poses, (..., 3 n), with ``pose @ direction == target``, and rates."""
        try:
            for _ in range(30):
                gaps, matrix = self._pins.at(pose)
                matrix[..., -1, :] = direction
                gaps[..., -1] = pose @ direction - target
                step = np.linalg.solve(matrix, gaps[..., np.newaxis])[..., 0]
                size = np.abs(step).max(axis=-1)
                if not (size < 2.0).all():  # far from any solution, or not a number
                    return None
                pose = pose - step
                if (size < _TOLERANCE * (1.0 + np.abs(pose).max(axis=-1))).all():
                    break
            gaps, matrix = self._pins.at(pose)
            # Near a toggle rounding limits the steps, so the gaps of the pins decide.
            if float(np.abs(gaps[..., :-1]).max()) > _TOLERANCE:
                return None
            matrix[..., -1, :] = direction
            last = np.broadcast_to(np.eye(pose.shape[-1])[:, -1:], (*pose.shape, 1))
            return pose, np.asarray(np.linalg.solve(matrix, last)[..., 0])
        except np.linalg.LinAlgError:
            return None

    def _choose(self, mechanism: Mechanism, starts: list[tuple[FloatArray, FloatArray]]) -> int:
        """Keep the first branch that reaches over the stroke, and return which it is."""
        errors = []
        for i, start in enumerate(starts):
            try:
                self._follow(mechanism, start)
                return i
            except MechanismError as error:
                errors.append(error)
        raise errors[0]

    def _follow(self, mechanism: Mechanism, start: tuple[FloatArray, FloatArray]) -> None:
        """Keep the branch of a closed pose, between its toggles, if it reaches over the stroke."""
        if np.linalg.norm(start[1]) > _FASTEST:
            problem = "the linkage is at a toggle there; give another angle."
            raise MechanismError("assembly.alpha3_deg", problem)
        tangent = start[1] / np.linalg.norm(start[1])
        above, high = self._walk(mechanism, start[0], tangent)
        below, low = self._walk(mechanism, start[0], -tangent)
        self.toggles = None if low is None or high is None else (low, high)
        poses = np.array([*reversed(below), start[0], *above])
        alphas = poses @ self._input
        self._traced = alphas[0], alphas[-1]
        # Without toggles, both directions were traced until they repeat, less than a step further.
        self._period = 2.0 * math.pi * ((alphas[-1] - alphas[0]) // (4.0 * math.pi))
        even = self._evenly(alphas)
        apart = np.append(np.diff(even) > _APART, True)
        self._guess = _spline(even[apart], poses[apart])
        self._check_stroke(mechanism)

    def _walk(
        self, mechanism: Mechanism, pose: FloatArray, tangent: FloatArray
    ) -> tuple[list[FloatArray], Toggle | None]:
        """Follow the curve to its next toggle, or until it repeats; return the poses passed."""
        way = math.copysign(1.0, tangent @ self._input)
        start, side = pose, self._side(pose, tangent)
        poses: list[FloatArray] = []
        turns = 2.0 * math.pi
        curvature, step = np.zeros(len(pose)), _STEP
        while step > _LEAST_STEP:
            guess = pose + step * tangent + step**2 / 2.0 * curvature
            closed = self._close(guess, tangent, float(tangent @ pose) + step)
            if closed is None:
                step /= 2.0
                continue
            ahead, rate = closed
            onward = rate / np.linalg.norm(rate)
            bend = math.acos(min(1.0, float(onward @ tangent)))
            slopes = way * (tangent @ self._input), way * (onward @ self._input)
            # Within the step, alpha3 may have turned back, perhaps back and forth.
            turned = way * ((ahead - pose) @ self._input) < step * min(slopes) / 2.0
            strays = bend > 2.0 * _BEND or self._side(ahead, onward) != side
            if strays or turned or slopes[1] <= 0.0:
                step /= 2.0
                continue
            poses.append(ahead)
            curvature = (onward - tangent) / step
            pose, tangent = ahead, onward
            step = min(_STEP, 2.0 * step, step * _BEND / max(bend, 1e-9))
            full = float(start @ self._input) + way * turns
            beyond = pose @ self._input - full
            if way * beyond > 0.0:
                back = pose - tangent * beyond / (tangent @ self._input)
                again = self._close(back, self._input, full)
                if again is not None and _same_place(again[0], start):
                    return poses, None
                turns += 2.0 * math.pi  # the loops need more than one turn to close again
        # alpha3 turns back here, or another branch crosses this one.
        return poses, self._toggle(mechanism, pose)

    def _side(self, pose: FloatArray, tangent: FloatArray) -> float:
        """Return a sign that stays the same along a branch, and differs where one crosses it."""
        matrix = self._pins.at(pose)[1]
        matrix[-1] = tangent
        return float(np.linalg.slogdet(matrix)[0])

    def _toggle(self, mechanism: Mechanism, pose: FloatArray) -> Toggle:
        """Return the toggle in a pose: the bodies that could move with the input held."""
        matrix = self._pins.at(pose)[1]
        matrix[-1] = self._input
        motion = np.linalg.svd(matrix)[2][-1].reshape(-1, 3)
        still = 1e-4 * np.abs(motion).max()
        moving = {b: i for i, b in enumerate(self._bodies) if abs(motion[i, 2]) > still}
        pivots: dict[str, list[str]] = {}  # the points of moving bodies that do not move
        for body, i in moving.items():
            turn = rotation_derivative(pose[3 * i + 2]) * motion[i, 2] / self._length
            pivots[body] = [
                point
                for point, local in mechanism.local_points(body).items()
                if np.abs(motion[i, :2] + turn @ np.array(local)).max() < still
            ]
        aligned: tuple[str, ...] = ()
        for point, *pair in mechanism.joints:
            ends = [[p for p in pivots.get(body, []) if p != point] for body in pair]
            if all(ends):
                aligned = (ends[0][-1], point, ends[1][-1])
        return Toggle(float(pose @ self._input), aligned, tuple(moving))

    def _check_stroke(self, mechanism: Mechanism) -> None:
        low, high = mechanism.stroke
        if not -math.inf < low < high < math.inf:
            given = f"[{math.degrees(low):g}, {math.degrees(high):g}]"
            raise MechanismError("input.range_deg", f"{given} does not ascend; give [from, to].")
        for angle in mechanism.stroke:
            if self.toggles and not self.toggles[0].alpha3 < angle < self.toggles[1].alpha3:
                problem = f"the linkage cannot close at {math.degrees(angle):g} deg"
                ends = f"its toggles, {self.toggles[0]}, and {self.toggles[1]}"
                hint = f"it locks at {ends}; keep the range between them"
                raise MechanismError("input.range_deg", f"{problem}: {hint}.")


def kinematics_of(mechanism: Mechanism) -> Kinematics:
    """Return the kinematics of a mechanism; those of the same points, pins and stroke share it."""
    bodies = tuple((body.name, body.points) for body in mechanism.bodies)
    assembly = mechanism.assembly_alpha3, mechanism.assembly_angles
    kept = _kept(mechanism.ground, bodies, mechanism.input_body, mechanism.stroke, assembly)
    if not kept:
        kept.append(Kinematics(mechanism))
    return kept[0]


@lru_cache(_REMEMBERED)
def _kept(*geometry: object) -> list[Kinematics]:
    """Return the list that holds the kinematics of a geometry once it is known."""
    return []
