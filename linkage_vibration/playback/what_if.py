# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism and the table of a replay, with the implement of the mechanism or another one."""

from dataclasses import dataclass

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.playback.remapping import ReplayError
from linkage_vibration.prediction.answers import Implement, Served, with_implement
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.mechanism import load_yaml, mechanism_of
from linkage_vibration.readers.served import read_served
from linkage_vibration.table.tabulation import build_table


@dataclass(frozen=True, slots=True)
class WhatIf:
    """Other values for the only rigid body, the implement; None keeps the mechanism's value.

    Attributes
    ----------
    mass, inertia : float, optional
        kg, and kg m2 about the centre of gravity.
    """

    mass: float | None = None
    inertia: float | None = None


AS_DESCRIBED = WhatIf()


def served_model(settings: Parameters, what_if: WhatIf) -> Served:
    """Return the mechanism and its table; the table is built for another implement.

    Parameters
    ----------
    settings : Parameters
    what_if : WhatIf

    Raises
    ------
    ReplayError
        If an implement is given, and the mechanism does not have exactly one rigid body.
    """
    if what_if == AS_DESCRIBED:
        return read_served(settings)
    path = settings.mechanism_path()
    content, text = load_yaml(path)
    mechanism = mechanism_of(content, path)
    if len(mechanism.rigid_bodies) != 1:
        raise ReplayError(
            f"{path} has {len(mechanism.rigid_bodies)} rigid bodies; another mass or inertia can "
            "be given only for a mechanism with exactly one rigid body."
        )
    [body] = mechanism.rigid_bodies
    mass = body.mass if what_if.mass is None else what_if.mass
    inertia = body.inertia if what_if.inertia is None else what_if.inertia
    implement = Implement(body.name, mass, inertia, ())
    changed, text = with_implement(mechanism, text, implement)
    return Served(Predictor(build_table(LinkageModel(changed))), changed, text)
