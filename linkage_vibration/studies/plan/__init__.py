# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Chooses the cheapest model that meets a tolerance.

`scene` states the question. `choice` finds the cheapest settings: elements and modes a link, terms
of an FRF, and a table or a solve for each prediction. `physics` says which physics the scene needs.
`measurement` compares the choice with an unreduced, finer model. `report` presents both. `results`
holds what a model or a table gives at one angle, its errors and its cost.
"""

from linkage_vibration.studies.plan.choice import Plan, plan
from linkage_vibration.studies.plan.measurement import (
    Measured,
    measure,
    plan_and_measure,
    solve_reference,
)
from linkage_vibration.studies.plan.physics import Effect, effects, physics_table
from linkage_vibration.studies.plan.report import plan_report, write_planned
from linkage_vibration.studies.plan.scene import PlanError, Scene
from linkage_vibration.studies.plan.unknowns import Unknowns, unknowns

__all__ = ["Effect", "Measured", "Plan", "PlanError", "Scene", "Unknowns", "effects", "measure"]
__all__ += [
    "physics_table",
    "plan",
    "plan_and_measure",
    "plan_report",
    "solve_reference",
    "unknowns",
]
__all__ += ["write_planned"]
