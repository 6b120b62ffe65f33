# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Links known by their frequency response functions alone."""

import math
from dataclasses import dataclass

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.components import FrfComponent
from linkage_vibration.mechanics.description import Body, Link, Mechanism, MechanismError
from linkage_vibration.mechanics.dofs import Dofs
from linkage_vibration.mechanics.mass_lines import find_mass_lines, shown_mass
from linkage_vibration.mechanics.regularisation import (
    RegularisationError,
    noise_level,
    regularise,
    rigid_motions,
)


@dataclass(frozen=True, slots=True, eq=False)
class Frfs(Body):
    """An elastic body known by its frequency response functions alone, measured or computed."""

    dofs: Dofs  # (n_dofs,): rows (responses) and columns (forces)
    frequencies: FloatArray  # (n_freq,), Hz, ascending
    frf: ComplexArray  # (n_freq, n_dofs, n_dofs): receptances of the free body in its axes, m/N
    mass: float | None = None  # kg, on a scale

    def component(self, link: Link, mechanism: Mechanism, *, reduced: bool) -> FrfComponent:
        """Return the component of the body; FRFs that contradict one another are refused."""
        wanted = mechanism.interface_dofs(link)
        order = link.positions(wanted, self.dofs)
        if link.masses:
            problem = "a link known by its FRFs takes none; remove them, or measure it with them."
            raise MechanismError(f"links.{link.name}.masses", problem)
        moving = self.frequencies > 0.0
        frequencies = self.frequencies[moving]
        frf = self.frf[moving][:, order][:, :, order] / link.count
        try:
            measured = regularise(wanted, frequencies, frf, rigid_motions(wanted, link.points))
        except RegularisationError as error:
            raise RegularisationError(f"links.{link.name}: {error}") from None
        noise, gain = noise_level(frequencies, frf), self._gain_stddev(link)
        return FrfComponent(link.name, wanted, frequencies, measured, noise, gain)

    def _gain_stddev(self, link: Link) -> float:
        """Return the relative error of a gain of all FRFs by the mass that they show, or 0."""
        if self.mass is None:
            return 0.0
        moving = self.frequencies > 0.0
        lines = find_mass_lines(self.frequencies[moving], self.frf[moving])
        weighed = None if lines is None else shown_mass(self.dofs, lines, dict(link.points))
        if weighed is None or not math.isfinite(weighed[1]):
            return 0.0
        return math.hypot(math.log(weighed[0] / self.mass), weighed[1])
