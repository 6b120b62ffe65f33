# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Sections of any shape, given by their properties."""

from linkage_vibration.mechanics.description import Section
from linkage_vibration.mechanics.keys import CheckedMapping


def read(keys: CheckedMapping, poisson_ratio: float) -> Section:
    """Read a section by its properties."""
    return Section(
        area=keys.number("area", positive=True),
        second_moment=keys.number("second_moment", positive=True),
        shear_coefficient=keys.number("shear_coefficient", positive=True, default=5 / 6),
    )
