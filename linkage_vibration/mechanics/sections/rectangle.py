# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Full rectangles."""

from linkage_vibration.mechanics.description import Section
from linkage_vibration.mechanics.keys import CheckedMapping


def rectangle(width: float, height: float, poisson_ratio: float) -> Section:
    """Return a full rectangle, with its width across the plane of motion and its height in it, m.

    The shear coefficient is Cowper's (J. Appl. Mech. 33, 1966, 335-340), for any ratio of the
    sides, and so for both directions.
    """
    shear = 10.0 * (1.0 + poisson_ratio) / (12.0 + 11.0 * poisson_ratio)
    area = width * height
    return Section(area, width * height**3 / 12.0, shear, height * width**3 / 12.0, shear)


def read(keys: CheckedMapping, poisson_ratio: float) -> Section:
    """Read a rectangle."""
    width, height = keys.number("width", positive=True), keys.number("height", positive=True)
    return rectangle(width, height, poisson_ratio)
