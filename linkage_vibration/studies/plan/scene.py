# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The question that a plan answers: which results, where, and how accurate."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import Place
from linkage_vibration.table.tabulation.accuracy import LOOSER


class PlanError(LinkageVibrationError):
    """A scene is invalid, or no setting meets its tolerance."""


@dataclass(frozen=True)
class Scene:
    """The results that are needed, and their tolerance.

    A plan replaces the mechanism's elements, modes, band, number of natural frequencies and stroke.
    The tolerance is the relative error allowed for every natural frequency in the band. A hundred
    times as much is allowed for the highest peak's magnitude (at the mechanism's own drive point)
    and for each FRF (L2 norm over the band). The errors of these three are arrays, (3,).
    """

    mechanism: Mechanism
    band: tuple[float, float]  # Hz
    places: tuple[Place, ...]  # FRFs are needed between all of these; without places, none are
    tolerance: float
    angles: tuple[float, float]  # the range of alpha3, rad; for a single angle, twice the same
    seconds_per_prediction: float | None = None  # for frequencies, damping ratios and the peak

    @property
    def one_angle(self) -> bool:
        """Whether the range is a single angle."""
        return self.angles[0] == self.angles[1]

    @property
    def peak_band(self) -> tuple[float, float]:
        """The band in which the highest peak is sought, Hz."""
        return self.mechanism.response.with_band(self.band).peak_band

    @property
    def spatial(self) -> bool:
        """Whether a result out of the plane of motion is needed."""
        return any(direction == "y" for _, direction in self.places)

    @property
    def points(self) -> list[str]:
        """The points of the places, each once."""
        return list(dict.fromkeys(point for point, _ in self.places))

    @property
    def allowed(self) -> FloatArray:
        """The errors that meet the tolerance, (3,)."""
        return self.tolerance * np.array([1.0, LOOSER, LOOSER])

    def share(self, errors: FloatArray) -> float:
        """Return the largest of errors, (3,), each divided by the allowed one."""
        return float((errors / self.allowed).max())

    def angles_at(self, fractions: ArrayLike) -> list[float]:
        """Return angles at fractions of the range, or the single angle."""
        low, high = self.angles
        if self.one_angle:
            return [low]
        return [float(angle) for angle in low + (high - low) * np.asarray(fractions)]

    def with_settings(self, elements: int, modes: int, n_modes: int) -> Mechanism:
        """Return the mechanism with other settings, and with the band and range of the scene.

        These are the elements of each beam, the fixed-interface modes of each link, and the number
        of natural frequencies that a prediction reports.
        """
        mechanism = self.mechanism
        links = [
            replace(link, modes=modes, body=link.body.with_elements(elements))
            for link in mechanism.links
        ]
        stroke = mechanism.stroke if self.one_angle else self.angles
        response = replace(mechanism.response.with_band(self.band), modes=n_modes)
        return replace(mechanism, links=tuple(links), stroke=stroke, response=response)


def check_scene(scene: Scene) -> None:
    """Refuse an invalid scene by a PlanError."""
    low, high = scene.band
    if not 0.0 <= low < high < math.inf:
        what = f"The band from {low:g} to {high:g} Hz is invalid"
        raise PlanError(f"{what}; give two frequencies that ascend from 0 or above.")
    if not 1e-9 <= scene.tolerance < 1.0:
        what = f"The tolerance {scene.tolerance:g} is invalid"
        raise PlanError(f"{what}; give a relative error from 1e-9 to 1.")
    limit = scene.seconds_per_prediction
    if limit is not None and not 0.0 < limit < math.inf:
        what = f"The time limit of {1e6 * limit:g} microseconds for a prediction is invalid"
        raise PlanError(f"{what}; give a positive number.")
    if not scene.angles[0] <= scene.angles[1]:
        raise PlanError("The range of angles does not ascend; give the smaller one first.")
    for link in scene.mechanism.links:
        if isinstance(link.body, Frfs):
            raise PlanError(
                f"links.{link.name} is given by FRFs, so its measurement sets the accuracy and a "
                "plan has nothing to choose; describe the link as a beam or by matrices."
            )
