# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Loop closure: an input angle goes in, the configuration of every body comes out.

The pins alone leave one degree of freedom, so the closed positions of the linkage form a curve.
It is traced once by its arc length, from the pose that the description gives to the toggles at
which it turns back (or through a full turn); a configuration is then Newton's solution between
two traced points. Arc length passes a toggle where the input angle, as a parameter, cannot, and
stays on one branch of the assembly.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import GROUND, Mechanism, MechanismError, Point

FloatArray = NDArray[np.float64]

_STEP = 0.1  # of arc length, with lengths scaled by the largest body: some 6 deg of rotation
_TOLERANCE = 1e-13  # of a Newton step, in the same scale
_BRANCH_MARGIN = math.radians(45.0)  # how far a body may turn from the described pose


@dataclass(frozen=True, slots=True)
class Toggle:
    """An input angle at which the linkage locks and turns back.

    Attributes
    ----------
    alpha3 : float
        rad.
    aligned : tuple of str
        Joints that are in line there, of an arm that is stretched or folded; empty where more than
        two bodies lock one another.
    bodies : tuple of str
        The bodies that could move there with the input held still.
    """

    alpha3: float
    aligned: tuple[str, ...]
    bodies: tuple[str, ...]

    def __str__(self) -> str:
        """Return where it is and why, in words."""
        words = f"{math.degrees(self.alpha3):.3f} deg"
        if self.aligned:
            return f"{words} with {', '.join(self.aligned[:-1])} and {self.aligned[-1]} in line"
        return f"{words} where {', '.join(self.bodies)} lock one another"


class KinematicsError(LinkageVibrationError):
    """The linkage cannot take the angle asked for.

    Parameters
    ----------
    alpha3 : float
        The angle asked for, rad.
    nearest : Toggle or None
        The end of the range in which the linkage closes, on that side; None where it closes at
        every angle and what was asked for is none.
    """

    def __init__(self, alpha3: float, nearest: Toggle | None) -> None:
        where = f"The linkage cannot close at alpha3 = {math.degrees(alpha3):.3f} deg; "
        if nearest is None:
            super().__init__(f"{where}give a finite angle.")
        else:
            super().__init__(
                f"{where}the nearest angle at which it can is its toggle at {nearest}."
            )
        self.alpha3 = alpha3
        self.nearest = nearest


@dataclass(frozen=True, slots=True)
class Configuration:
    """Where every body is at one input angle, and how it moves with that angle.

    Attributes
    ----------
    alpha3 : float
        Input angle, rad.
    bodies : tuple of str, (n,)
        Names, in the order of the rows below.
    origins : ndarray, (n, 2)
        Global x and z of each body's own origin, m.
    angles : ndarray, (n,)
        Angle of each body's own x axis, rad, continuous between the toggles.
    origin_rates : ndarray, (n, 2)
        d(origin)/d(alpha3), m/rad.
    velocity_ratios : ndarray, (n,)
        d(angle)/d(alpha3), 1.
    toggle_distance : float
        How far alpha3 is from the nearer toggle, rad; infinite where there is none.
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
        """Return d(angle of a body)/d(alpha3), 1."""
        return float(self.velocity_ratios[self.bodies.index(body)])

    def place(self, body: str, local: Point) -> FloatArray:
        """Return the global x and z, in m, of a point given in a body's own axes."""
        if body == GROUND:
            return np.array(local)
        arm = rotation(self.angle(body)) @ np.array(local)
        return np.asarray(self.origins[self.bodies.index(body)] + arm)

    def place_rate(self, body: str, local: Point) -> FloatArray:
        """Return d(place)/d(alpha3), (2,), m/rad, of a point given in a body's own axes."""
        if body == GROUND:
            return np.zeros(2)
        i = self.bodies.index(body)
        turning = rotation_derivative(self.angle(body)) @ np.array(local)
        return np.asarray(self.origin_rates[i] + self.velocity_ratios[i] * turning)


def rotation(angle: float) -> FloatArray:
    """Return the (2, 2) matrix that turns a body's own components into global ones."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def rotation_derivative(angle: float) -> FloatArray:
    """Return d(rotation)/d(angle), (2, 2)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[-s, -c], [c, -s]])


class Kinematics:
    """The closed positions of one mechanism on one branch of its assembly.

    Parameters
    ----------
    mechanism : Mechanism
        Its ``assembly`` chooses the branch.

    Raises
    ------
    MechanismError
        If the linkage cannot close near the pose described, or not over its whole stroke.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._bodies = tuple(body.name for body in mechanism.bodies)
        self._input = 3 * self._bodies.index(mechanism.input_body) + 2
        points = [p for b in (GROUND, *self._bodies) for p in mechanism.local_points(b).values()]
        self._length = max(math.hypot(*point) for point in points)
        self._pins = [
            (self._end(mechanism, first, point), self._end(mechanism, second, point))
            for point, first, second in mechanism.joints
        ]
        self._poses = self._trace(mechanism, self._assemble(mechanism))
        self._alphas = np.array([pose[self._input] for pose in self._poses])
        self._check_stroke(mechanism)

    @property
    def toggles(self) -> tuple[Toggle, Toggle] | None:
        """The toggles below and above; None where the input can turn all the way."""
        return self._toggles

    @property
    def closable_range(self) -> tuple[float, float]:
        """The toggles' angles, rad; infinite where the input can turn all the way."""
        if self._toggles is None:
            return -math.inf, math.inf
        return self._toggles[0].alpha3, self._toggles[1].alpha3

    def at(self, alpha3: float) -> Configuration:
        """Return the configuration at an input angle.

        Parameters
        ----------
        alpha3 : float
            Input angle, rad.

        Raises
        ------
        KinematicsError
            If the linkage cannot close there; it tells the nearest angle at which it can.
        """
        low, high = self.closable_range
        if not low < alpha3 < high:
            raise self._out_of_reach(alpha3)
        alpha = alpha3
        first, last = self._alphas[0], self._alphas[-1]
        if not first <= alpha <= last:  # the input turns all the way: every turn repeats another
            alpha = first + (alpha - first) % (2.0 * math.pi)
        i = int(np.clip(np.searchsorted(self._alphas, alpha) - 1, 0, len(self._alphas) - 2))
        share = (alpha - self._alphas[i]) / (self._alphas[i + 1] - self._alphas[i])
        pose = self._poses[i] + share * (self._poses[i + 1] - self._poses[i])
        solved = self._correct(pose, np.eye(len(pose))[self._input], alpha)
        if solved is None:
            raise self._out_of_reach(alpha3)
        matrix = np.vstack([self._jacobian(solved), np.eye(len(pose))[self._input]])
        right = np.zeros(len(pose))
        right[-1] = 1.0
        scale = np.array([self._length, self._length, 1.0])
        bodies = solved.reshape(-1, 3) * scale
        rates = np.linalg.solve(matrix, right).reshape(-1, 3) * scale
        return Configuration(
            alpha3=alpha3,
            bodies=self._bodies,
            origins=bodies[:, :2],
            angles=bodies[:, 2],
            origin_rates=rates[:, :2],
            velocity_ratios=rates[:, 2],
            toggle_distance=min(alpha3 - low, high - alpha3),
        )

    def _out_of_reach(self, alpha3: float) -> KinematicsError:
        if self._toggles is None:
            return KinematicsError(alpha3, None)
        low, high = self._toggles
        below = alpha3 - low.alpha3 < high.alpha3 - alpha3
        return KinematicsError(alpha3, low if below else high)

    def _end(self, mechanism: Mechanism, body: str, point: str) -> tuple[int | None, FloatArray]:
        """One end of a pin: the body's first row in a pose (None: the ground), and the place."""
        local = np.array(mechanism.local_points(body)[point]) / self._length
        return (None if body == GROUND else 3 * self._bodies.index(body)), local

    def _residual(self, pose: FloatArray) -> FloatArray:
        """By how much the two ends of each pin are apart, (2 n_pins,), scaled."""
        gaps = np.empty((len(self._pins), 2))
        for row, ends in enumerate(self._pins):
            first, second = (
                place if at is None else pose[at : at + 2] + rotation(pose[at + 2]) @ place
                for at, place in ends
            )
            gaps[row] = first - second
        return gaps.ravel()

    def _jacobian(self, pose: FloatArray) -> FloatArray:
        """d(residual)/d(pose), (2 n_pins, 3 n_bodies)."""
        jacobian = np.zeros((2 * len(self._pins), len(pose)))
        for row, ends in enumerate(self._pins):
            for sign, (at, place) in zip((1.0, -1.0), ends, strict=True):
                if at is not None:
                    block = jacobian[2 * row : 2 * row + 2, at : at + 3]
                    block[0, 0] = block[1, 1] = sign
                    block[:, 2] = sign * (rotation_derivative(pose[at + 2]) @ place)
        return jacobian

    def _correct(self, pose: FloatArray, direction: FloatArray, target: float) -> FloatArray | None:
        """Newton's closed pose with ``direction @ pose == target``; None if there is none near."""
        for _ in range(30):
            residual = np.append(self._residual(pose), direction @ pose - target)
            matrix = np.vstack([self._jacobian(pose), direction])
            try:
                step = np.linalg.solve(matrix, residual)
            except np.linalg.LinAlgError:
                return None
            size = float(np.abs(step).max())
            if not size < 2.0:  # also when not a number: far from any solution
                return None
            pose = pose - step
            if size < _TOLERANCE * (1.0 + float(np.abs(pose).max())):
                return pose
        # Beside a toggle rounding keeps the steps from falling further; the pins tell.
        return pose if float(np.abs(self._residual(pose)).max()) < _TOLERANCE else None

    def _tangent(self, pose: FloatArray, along: FloatArray) -> FloatArray:
        """Return the unit vector along the curve of closed poses, on the side of ``along``."""
        right = np.zeros(len(pose))
        right[-1] = 1.0
        tangent = np.linalg.solve(np.vstack([self._jacobian(pose), along]), right)
        return np.asarray(tangent / np.linalg.norm(tangent))

    def _assemble(self, mechanism: Mechanism) -> FloatArray:
        """Close the loops at the angle and near the pose that the description gives."""
        angles = dict(mechanism.assembly_angles)
        pose = np.zeros(3 * len(self._bodies))
        for i, body in enumerate(self._bodies):
            pose[3 * i + 2] = angles.get(body, mechanism.assembly_alpha3)
        # With the angles given, the pins are linear in the positions.
        places = [i for i in range(len(pose)) if i % 3 != 2]
        shift = np.linalg.lstsq(self._jacobian(pose)[:, places], -self._residual(pose), rcond=None)
        pose[places] += shift[0]
        guess = pose.copy()
        closed = self._correct(pose, np.eye(len(pose))[self._input], mechanism.assembly_alpha3)
        if closed is None:
            raise MechanismError(
                "assembly",
                f"the loops do not close at alpha3 = {math.degrees(mechanism.assembly_alpha3):g} "
                "deg near the angles given; correct the angles, or the lengths under links and "
                "rigid_bodies.",
            )
        turned = np.abs(closed - guess)[2::3]
        if turned.max() > _BRANCH_MARGIN:
            body = self._bodies[int(turned.argmax())]
            angle = math.degrees(closed[3 * int(turned.argmax()) + 2])
            raise MechanismError(
                f"assembly.angles_deg.{body}",
                f"from the angles given the loops close with this body at {angle:.1f} deg, too far "
                "away to be the branch that was meant; give the angles more closely.",
            )
        return closed

    def _trace(self, mechanism: Mechanism, start: FloatArray) -> list[FloatArray]:
        """List closed poses from the lower to the upper toggle, alpha3 ascending; set the range."""
        upward = np.eye(len(start))[self._input]
        try:
            tangent = self._tangent(start, upward)
        except np.linalg.LinAlgError:
            raise MechanismError(
                "assembly.alpha3_deg", "the linkage is at a toggle there; give another angle."
            ) from None
        above, high = self._walk(mechanism, start, tangent)
        below, low = self._walk(mechanism, start, -tangent)
        self._toggles = None if low is None or high is None else (low, high)
        return [*reversed(below), start, *above]

    def _walk(
        self, mechanism: Mechanism, pose: FloatArray, tangent: FloatArray
    ) -> tuple[list[FloatArray], Toggle | None]:
        """Follow the curve to its next toggle, or through a full turn; return the poses passed."""
        way = math.copysign(1.0, tangent[self._input])
        start = pose[self._input]
        poses: list[FloatArray] = []
        step = _STEP
        while step > 1e-9:
            ahead = self._correct(pose + step * tangent, tangent, float(tangent @ pose) + step)
            if ahead is None:
                step /= 2.0
                continue
            onward = self._tangent(ahead, tangent)
            if way * onward[self._input] <= 0.0:
                locked = self._locked(pose, tangent, step)
                return [*poses, locked], self._toggle(mechanism, locked, tangent)
            poses.append(ahead)
            pose, tangent, step = ahead, onward, min(_STEP, 2.0 * step)
            if way * (pose[self._input] - start) > 2.0 * math.pi:
                return poses, None
        raise MechanismError(
            "links",
            f"two ways of closing the loops meet at alpha3 = "
            f"{math.degrees(pose[self._input]):.3f} deg and the branch cannot be told there; "
            "change a length.",
        )

    def _locked(self, pose: FloatArray, tangent: FloatArray, step: float) -> FloatArray:
        """Return the pose at which alpha3 turns back, within one step ahead of a pose."""

        def ahead(share: float) -> FloatArray:
            length = share * step
            found = self._correct(pose + length * tangent, tangent, float(tangent @ pose) + length)
            assert found is not None  # the whole step closed
            return found

        def turning(share: float) -> float:
            return float(self._tangent(ahead(share), tangent)[self._input])

        return ahead(float(brentq(turning, 0.0, 1.0, xtol=1e-12)))

    def _toggle(self, mechanism: Mechanism, pose: FloatArray, along: FloatArray) -> Toggle:
        """Tell why the linkage locks in a pose: which bodies could move with the input held."""
        motion = self._tangent(pose, along).reshape(-1, 3)
        moves = np.abs(motion[:, 2]) > 1e-6 * np.abs(motion).max()
        moving = {body: i for i, body in enumerate(self._bodies) if moves[i]}

        def pivots(body: str, but: str) -> list[str]:
            """Points of a moving body that stand still."""
            i = moving[body]
            turn = rotation_derivative(pose[3 * i + 2]) * motion[i, 2]
            return [
                point
                for point, local in mechanism.local_points(body).items()
                if point != but
                and np.abs(motion[i, :2] + turn @ np.array(local) / self._length).max() < 1e-6
            ]

        aligned: tuple[str, ...] = ()
        for point, first, second in mechanism.joints:
            if first in moving and second in moving:
                for one in pivots(first, point):
                    for other in pivots(second, point):
                        aligned = (one, point, other)
        return Toggle(float(pose[self._input]), aligned, tuple(moving))

    def _check_stroke(self, mechanism: Mechanism) -> None:
        for angle in mechanism.stroke:
            if self._toggles and not self._toggles[0].alpha3 < angle < self._toggles[1].alpha3:
                raise MechanismError(
                    "input.range_deg",
                    f"the linkage cannot close at {math.degrees(angle):g} deg: it locks at its "
                    f"toggles, {self._toggles[0]}, and {self._toggles[1]}; keep the range between "
                    "them.",
                )
