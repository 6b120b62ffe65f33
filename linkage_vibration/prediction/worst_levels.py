# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The worst levels of one linkage with several masses of its implement."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.levels import LevelTable


@dataclass(frozen=True, slots=True)
class WorstLevels:
    """The largest levels of several `LevelTable` of the same stroke; NaN if one is not known."""

    levels: Sequence[LevelTable]

    @property
    def alpha3_range(self) -> tuple[float, float]:
        """First and last angle of the tables, rad."""
        return self.levels[0].alpha3_range

    def at_all_pairs(self, alpha3: FloatArray, speeds: FloatArray) -> MessageColumns:
        """Return as `LevelTable` does the largest totals and velocities, and why one is unknown."""
        each = [levels.at_all_pairs(alpha3, speeds) for levels in self.levels]
        names = "total_load_ratio", "total_velocity", "velocities"
        worst = {name: np.max([getattr(one, name) for one in each], axis=0) for name in names}
        reasons = np.stack([one.ground_unknown for one in each])
        first: Any = np.take_along_axis(reasons, (reasons != "").argmax(axis=0)[np.newaxis], 0)[0]
        return MessageColumns(**worst, ground_unknown=first)

    def member_totals(self, alpha3: FloatArray, speeds: FloatArray) -> tuple[FloatArray, ...]:
        """Return the largest totals of each member of the ensemble, as `LevelTable` does."""
        each = [levels.member_totals(alpha3, speeds) for levels in self.levels]
        n = min(len(totals) for totals, _ in each)
        return tuple(np.max([value[:n] for value in of], axis=0) for of in zip(*each, strict=True))

    def masses(self, alpha3: FloatArray, speeds: FloatArray) -> list[str]:
        """Return the masses, kg, with the largest loads; empty if there is one, or if not known."""
        loads = np.array([each.at(alpha3, speeds).total_load_ratio for each in self.levels])
        which = np.where(np.isnan(loads).any(axis=0), -1, loads.argmax(axis=0)).tolist()
        several = len(self.levels) > 1
        return [implement_mass(self.levels[i]) if several and i >= 0 else "" for i in which]


def implement_mass(levels: LevelTable) -> str:
    """Return the mass of the only rigid body of a mechanism, kg."""
    [body] = levels.mechanism.rigid_bodies
    return f"{body.mass:.5g}"
