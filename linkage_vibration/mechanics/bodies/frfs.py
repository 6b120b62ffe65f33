# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Links known by their frequency response functions alone."""

from dataclasses import dataclass

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.components import FrfComponent
from linkage_vibration.mechanics.description import Body, Link, Mechanism, MechanismError
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.regularisation import (
    RegularisationError,
    noise_level,
    regularise,
    rigid_motions,
)


@dataclass(frozen=True, slots=True, eq=False)
class Frfs(Body):
    """An elastic body known by its frequency response functions alone, measured or computed."""

    dofs: tuple[InterfaceDof, ...]  # (n_dofs,): rows (responses) and columns (forces)
    frequencies: FloatArray  # (n_freq,), Hz, ascending
    frf: ComplexArray  # (n_freq, n_dofs, n_dofs): receptances of the free body in its axes, m/N

    def component(
        self, link: Link, mechanism: Mechanism, *, spatial: bool, reduced: bool
    ) -> FrfComponent:
        """Return the component of the body, as `description.Body.component` says.

        FRFs that contradict one another are refused.
        """
        wanted = mechanism.interface_dofs(link, spatial=spatial)
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
        return FrfComponent(link.name, wanted, frequencies, measured, noise_level(frequencies, frf))
