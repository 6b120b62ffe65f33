# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Says which physics a scene needs: by how much natural frequencies change without each."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import GROUND, Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.mode_names import kinetic_energy
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.modes import MECHANISM

GRAVITY = 9.81  # m/s2, where the mechanism leaves gravity out
CRANK, TRACTOR = "springs that hold the crank", "motion of the tractor"


@dataclass(frozen=True, slots=True)
class Effect:
    """What one part of the physics changes."""

    name: str  # of the part of the physics
    described: bool  # whether the mechanism contains it
    # Largest relative change of a natural frequency in the band if it is left out or added; or NaN.
    change: float
    advice: str  # what to do if it is needed and not described, or why the change is not known

    def verdict(self, tolerance: float) -> str:
        """Return in words whether a scene with this tolerance needs it."""
        if math.isnan(self.change):
            return f"not known; {self.advice}"
        if self.change <= tolerance:
            return "not needed" + (", and may be left out" if self.described else "")
        return "needed, and described" if self.described else f"missing; {self.advice}"


def rigid_crank(mechanism: Mechanism) -> Mechanism | None:
    """Return a mechanism whose input crank is clamped to the ground instead of held by springs.

    It is None if no spring holds the crank.
    """
    crank, ground = mechanism.input_body, dict(mechanism.ground)
    ends = {crank, GROUND}
    others = tuple(spring for spring in mechanism.springs if set(spring.bodies) != ends)
    if len(others) == len(mechanism.springs):
        return None
    links = [
        replace(link, clamped=next(name for name, _ in link.points if name in ground))
        if link.name == crank
        else link
        for link in mechanism.links
    ]
    return replace(mechanism, links=tuple(links), springs=others, uncertainty=None)


def effects(
    mechanism: Mechanism, band: tuple[float, float], angles: Sequence[float]
) -> list[Effect]:
    """Return the parts of the physics in order of what they change in a band (Hz) at angles (rad).

    Modes are compared in ascending order, without those of the tractor.
    """
    plain = replace(mechanism, uncertainty=None)
    kinematics = Kinematics(plain)

    def effect(name: str, other: Mechanism | None, advice: str, *, described: bool) -> Effect:
        """Return what changes from the mechanism to another one; None if it is not known."""
        if other is None:
            return Effect(name, described, math.nan, advice)
        try:
            before, after = (LinkageModel(each, kinematics=kinematics) for each in (plain, other))
            changes = [_change(before.solve(at), after.solve(at), band[1]) for at in angles]
        except LinkageVibrationError as error:
            return Effect(name, described, math.nan, str(error))
        changes = [change for change in changes if not math.isnan(change)]
        if not changes:
            return Effect(name, described, math.nan, "the linkage has no mode in the band")
        return Effect(name, described, max(changes), advice)

    weight = replace(plain, gravity=0.0 if plain.gravity else GRAVITY)
    rigid = rigid_crank(plain)
    still = None if plain.base is None else replace(plain, base=None)
    springs = "describe what holds the crank under `springs:`, such as locked oil"
    parts = [
        effect("gravity", weight, f"add `gravity: {GRAVITY}`", described=plain.gravity != 0.0),
        effect(CRANK, rigid, springs, described=rigid is not None),
        effect(TRACTOR, still, "describe the tractor under `base:`", described=still is not None),
    ]
    return sorted(parts, key=lambda part: math.inf if math.isnan(part.change) else -part.change)


def _change(before: Solution, after: Solution, top: float) -> float:
    """Return the largest relative change of the natural frequencies up to a frequency, Hz."""
    frequencies, others = _of_linkage(before), _of_linkage(after)
    frequencies = frequencies[frequencies <= top][: len(others)]
    if not len(frequencies):
        return math.nan
    return float(np.abs(others[: len(frequencies)] / frequencies - 1.0).max())


def _of_linkage(solution: Solution) -> FloatArray:
    """Return the undamped natural frequencies without those of the tractor's modes, Hz."""
    omega = solution.modes.omega
    kept = (omega > MECHANISM) & (kinetic_energy(solution).mounts <= 0.5)
    return np.asarray(omega[kept] / (2.0 * math.pi))


def physics_table(parts: Sequence[Effect], tolerance: float) -> str:
    """Return lines with what the effects change, and whether a relative tolerance needs them."""
    lines = [f"{'physics':30}{'changes up to':>14}  verdict"]
    for part in parts:
        percent = "" if math.isnan(part.change) else f"{100.0 * part.change:.2g} %"
        lines.append(f"{part.name:30}{percent:>14}  {part.verdict(tolerance)}")
    return "\n".join(lines)
