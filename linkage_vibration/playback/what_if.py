# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism and the table that a replay predicts with."""

from dataclasses import dataclass

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.playback.remapping import ReplayError
from linkage_vibration.prediction.answers import Implement, with_implement
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.mechanism import load_yaml, read_mechanism
from linkage_vibration.table.table import Table, load_table
from linkage_vibration.table.tabulation import build_table


@dataclass(frozen=True, slots=True)
class WhatIf:
    """Other numbers of the only rigid body, the implement; None leaves one as it is.

    Attributes
    ----------
    mass, inertia : float, optional
        kg, and kg m2 about the centre of gravity.
    """

    mass: float | None = None
    inertia: float | None = None


AS_IT_IS = WhatIf()


def load_model(settings: Parameters, what_if: WhatIf) -> tuple[str, Table]:
    """Return the mechanism's YAML, and its table, read or built."""
    path = settings.mechanism_path()
    mechanism, text = read_mechanism(path), load_yaml(path)[1]
    if what_if != AS_IT_IS:
        body = mechanism.rigid_bodies[0] if len(mechanism.rigid_bodies) == 1 else None
        if body is None:
            raise ReplayError(
                f"{path} has {len(mechanism.rigid_bodies)} rigid bodies; which implement another "
                "mass means is only known where there is one."
            )
        mass = body.mass if what_if.mass is None else what_if.mass
        inertia = body.inertia if what_if.inertia is None else what_if.inertia
        implement = Implement(body.name, mass, inertia, ())
        changed, text = with_implement(mechanism, text, implement)
        return text, build_table(LinkageModel(changed))
    table_path = settings.table_path()
    if table_path is None:
        return text, build_table(LinkageModel(mechanism))
    return text, load_table(table_path, mechanism)
