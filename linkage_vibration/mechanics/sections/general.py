# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Sections of any shape, given by their properties."""

import math

from linkage_vibration.mechanics.description import Section
from linkage_vibration.mechanics.keys import Keys


def read(keys: Keys, poisson_ratio: float) -> Section:
    """Read a section by its properties; those out of the plane are NaN if they are missing."""
    return Section(
        area=keys.number("area", positive=True),
        second_moment=keys.number("second_moment", positive=True),
        shear_coefficient=keys.number("shear_coefficient", positive=True, default=5 / 6),
        second_moment_out=keys.number("second_moment_out", positive=True, default=math.nan),
        shear_coefficient_out=keys.number("shear_coefficient_out", positive=True, default=5 / 6),
        torsion_constant=keys.number("torsion_constant", positive=True, default=math.nan),
        outer_fibre=keys.number("outer_fibre", positive=True, default=math.nan),
    )
