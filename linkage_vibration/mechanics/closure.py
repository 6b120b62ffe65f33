# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds every closed pose at an input angle, or the loop that no pose can close.

With the angles of the bodies given, the gaps of the pins are linear in the positions of the bodies.
The positions with the smallest gaps are eliminated, which leaves as many equations as unknown
angles. They are solved by Levenberg and Marquardt's method from many starting angles at once.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.mechanics.description import Mechanism, MechanismError

NEAR = math.radians(5.0)
"""Angle of every body from those given, within which a pose is used without a search for others."""

_ROUGH = math.radians(20.0)  # Angles are wrong if a body turns by more than this from them.
_AMBIGUOUS = 2.0  # A pose is clear if the others are so many times farther away.
_STARTS = 200  # number of random starting angles, beside the angles given
_ITERATIONS = 60
_CLOSED = 1e-9  # A pose is closed if its gap, over the largest length, is smaller.
_DONE, _STUCK = 1e-28, 1e4  # square of a gap, and damping, at which a search ends
_SAME = 1e-4  # rad; two poses are the same if all their angles differ by less
_EQUAL = 1e-6  # rad; only rounding may distinguish distances or turns that differ by less
_OPEN = 1e-3  # weight of a pin that is opened
_REST = 0.02  # largest ratio of the gaps of the other pins to that of the opened one


@dataclass(frozen=True, slots=True, eq=False)
class Pins:
    """The gaps of all pins, scaled, which are linear in positions, cosines and sines of a pose."""

    # Two rows for each pin, and a last one that is free for another condition.
    positions: FloatArray  # (n_rows, 3 n_bodies): d(gap)/d(pose); zero for the angles
    cosines: FloatArray  # (n_rows, n_bodies): d(gap)/d(cosine of each angle)
    sines: FloatArray  # (n_rows, n_bodies): the same of the sines
    ground: FloatArray  # (n_rows,): contribution of the ends on the ground

    def at(self, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gaps, (..., n_rows), and d(gaps)/d(pose), (..., n_rows, 3 n_bodies), of poses."""
        angles = pose[..., 2::3]
        c, s = np.cos(angles), np.sin(angles)
        gaps = pose @ self.positions.T + c @ self.cosines.T + s @ self.sines.T + self.ground
        jacobian = np.tile(self.positions, (*pose.shape[:-1], 1, 1))
        turning = self.sines * c[..., np.newaxis, :] - self.cosines * s[..., np.newaxis, :]
        jacobian[..., 2::3] = turning
        return gaps, jacobian

    def placed(self, angles: FloatArray, weights: FloatArray | float = 1.0) -> FloatArray:
        """Return the pose, (3 n_bodies,), of angles, rad, with the least weighted gaps."""
        pose = np.zeros(3 * len(angles))
        pose[2::3] = angles
        gaps, jacobian = self.at(pose)
        places = np.arange(len(pose)) % 3 != 2
        rows = np.repeat(np.broadcast_to(weights, len(gaps) // 2), 2)
        matrix, gaps = rows[:, np.newaxis] * jacobian[:-1, places], rows * gaps[:-1]
        pose[places] = -np.linalg.lstsq(matrix, gaps, rcond=None)[0]
        return pose


def closed_angles(pins: Pins, guess: FloatArray, free: BoolArray) -> FloatArray:
    """Return the angles of closed poses, (n_poses, n_bodies), rad, nearest to a guess first."""
    angles, gaps = _descend(pins, np.ones(len(pins.ground) // 2), guess, free)
    angles = angles[gaps < _CLOSED]
    turned = turns(angles - guess)
    keys = np.column_stack([distance(turned, free), turned]) / _EQUAL
    order = np.lexsort(keys.round().T[::-1])
    kept: list[FloatArray] = []
    for turn in turned[order]:
        if all(np.abs(turns(turn - other)).max() > _SAME for other in kept):
            kept.append(turn)
    return guess + np.reshape(kept, (len(kept), len(guess)))


def pose_notice(mechanism: Mechanism, poses: Sequence[FloatArray], chosen: int) -> str:
    """Return how the chosen pose, (n_bodies,), rad, differs from the angles; empty if clear."""
    names = [body.name for body in mechanism.bodies]
    held, given = names.index(mechanism.input_body), mechanism.assembly_alpha3
    angles = dict(mechanism.assembly_angles)
    guess = np.array([angles.get(name, given) for name in names])
    free = np.arange(len(names)) != held
    turned = turns(np.array(poses) - guess) * free
    away = distance(turned, free)
    moves = turned[chosen]
    others = [i for i in range(len(poses)) if i != chosen]
    rival = others[0] if others and away[others[0]] < _AMBIGUOUS * away[chosen] else None
    if rival is None and np.abs(moves).max() <= _ROUGH:
        return ""

    def written(pose: FloatArray) -> str:
        degrees = (np.degrees(pose).round(2) % 360.0).tolist()
        pairs = zip(names, degrees, free.tolist(), strict=True)
        angles = [f"{name}: {angle:.2f}" for name, angle, is_free in pairs if is_free]
        return f"{{{', '.join(angles)}}}"

    sizes = np.abs(moves)
    body = int((sizes > sizes.max() - _EQUAL).argmax())
    text = (
        f"assembly: the closed pose that is used has {names[body]} turned by "
        f"{math.degrees(moves[body]):+.1f} deg from the angle given; write `assembly: "
        f"{{alpha3_deg: {math.degrees(given):.6g}, angles_deg: {written(poses[chosen])}}}`."
    )
    if rival is not None:
        nearer = ", which is nearer, but whose branch ends within the stroke" * (rival < chosen)
        text += (
            f" The choice is ambiguous: the loops also close with `angles_deg: "
            f"{written(poses[rival])}`{nearer}. These are {math.degrees(away[rival]):.0f} deg from "
            f"the angles given (root mean square), and those used {math.degrees(away[chosen]):.0f} "
            "deg; write the angles that your linkage has."
        )
    return text


def turns(angles: FloatArray) -> FloatArray:
    """Return angles without full turns, -pi to pi."""
    return np.asarray((angles + math.pi) % (2.0 * math.pi) - math.pi)


def distance(turned: FloatArray, free: BoolArray) -> FloatArray:
    """Return the root mean square of the turns, (..., n_bodies), of the free bodies, (...), rad."""
    return np.asarray(np.sqrt((turned[..., free] ** 2).mean(axis=-1)))


def cannot_close(
    pins: Pins, mechanism: Mechanism, guess: FloatArray, free: BoolArray, length: float
) -> MechanismError:
    """Return the error that loops cannot close, with the gap of each pin if all others close."""
    gaps = [_opened(pins, pin, guess, free) for pin in range(len(mechanism.joints))]
    open_pins = [
        f"{point} by {gap * length:.4g} m"
        for (point, *_), gap in zip(mechanism.joints, gaps, strict=True)
        if gap < math.inf
    ]
    given = math.degrees(mechanism.assembly_alpha3)
    text = f"the loops do not close at alpha3 = {given:.6g} deg"
    if open_pins:
        text += f": one pin stays open if all others close, {' or '.join(open_pins)}"
    hint = "correct this angle, the lengths of bodies with these pins, or the points of the ground"
    return MechanismError("assembly", f"{text}; {hint}.")


def _opened(pins: Pins, pin: int, guess: FloatArray, free: BoolArray) -> float:
    """Return the smallest gap of a pin where all others are closed, or infinity."""
    weights = np.ones(len(pins.ground) // 2)
    weights[pin] = _OPEN
    angles, norms = _descend(pins, weights, guess, free)
    gaps = pins.at(pins.placed(angles[norms.argmin()], weights))[0][:-1].reshape(-1, 2)
    sizes = np.hypot(*gaps.T)
    return float(sizes[pin]) if np.delete(sizes, pin).max() < _REST * sizes[pin] else math.inf


def _descend(
    pins: Pins, weights: FloatArray, guess: FloatArray, free: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return angles with the least weighted gaps, (n, n_bodies), and the norms of gaps, (n,)."""
    weight, columns = np.repeat(weights, 2), np.arange(pins.positions.shape[1]) % 3 != 2
    left, sizes, _ = np.linalg.svd(weight[:, np.newaxis] * pins.positions[:-1, columns])
    kept = left[:, int((sizes > 1e-12).sum()) :].T * weight
    cosines, sines, ground = (kept @ part[:-1] for part in (pins.cosines, pins.sines, pins.ground))

    def gaps_at(angles: FloatArray) -> FloatArray:
        return np.asarray(np.cos(angles) @ cosines.T + np.sin(angles) @ sines.T + ground)

    n_free = int(free.sum())
    angles = np.tile(guess, (_STARTS + 1, 1))
    # A generator with a fixed seed: the same description always has the same result.
    angles[1:, free] += np.random.default_rng(0).uniform(-math.pi, math.pi, (_STARTS, n_free))
    gaps, damping = gaps_at(angles), np.full(len(angles), 1e-2)
    active = np.arange(len(angles))
    for _ in range(_ITERATIONS):
        sizes = (gaps[active] ** 2).sum(axis=1)
        active = active[(sizes > _DONE) & (damping[active] < _STUCK)]
        if not len(active):
            break
        old, trial = gaps[active], angles[active]
        c, s = np.cos(trial)[:, np.newaxis], np.sin(trial)[:, np.newaxis]
        slopes = (sines * c - cosines * s)[:, :, free]
        across = slopes.swapaxes(1, 2)
        matrix = across @ slopes + damping[active, np.newaxis, np.newaxis] * np.eye(n_free)
        trial[:, free] -= np.linalg.solve(matrix, across @ old[:, :, np.newaxis])[:, :, 0]
        new = gaps_at(trial)
        better = (new**2).sum(axis=1) < (old**2).sum(axis=1)
        angles[active[better]], gaps[active[better]] = trial[better], new[better]
        damping[active] *= np.where(better, 0.1, 4.0)
        damping = np.maximum(damping, 1e-14)
    return angles, np.sqrt((gaps**2).sum(axis=1))
