# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The table of the angles of a linkage's bodies."""

import math

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.studies.pose import angle_rows


def test_the_table_of_angles(mechanism: Mechanism) -> None:
    """Its numbers are those of the kinematics."""
    lines = angle_rows(mechanism, Kinematics(mechanism), [math.radians(90.0)]).splitlines()
    assert lines[1].split()[:5] == ["90.00", "158.90", "141.14", "238.69", "87.80"]
