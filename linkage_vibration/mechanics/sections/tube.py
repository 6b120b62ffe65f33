# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Round tubes and round bars."""

import math

from linkage_vibration.mechanics.description import Section
from linkage_vibration.mechanics.keys import CheckedMapping


def tube(outer: float, inner: float, poisson_ratio: float) -> Section:
    """Return a round tube or bar, diameters in m, with Cowper's shear coefficient (1966)."""
    area = math.pi * (outer**2 - inner**2) / 4.0
    second_moment = math.pi * (outer**4 - inner**4) / 64.0
    nu, m2 = poisson_ratio, (inner / outer) ** 2
    shear = 6.0 * (1 + nu) * (1 + m2) ** 2 / ((7 + 6 * nu) * (1 + m2) ** 2 + (20 + 12 * nu) * m2)
    return Section(area, second_moment, shear, second_moment, shear)


def read(keys: CheckedMapping, poisson_ratio: float) -> Section:
    """Read a tube."""
    outer = keys.number("outer_diameter", positive=True)
    inner = keys.number("inner_diameter", positive=True)
    if inner >= outer:
        problem = f"{inner:g} m does not fit into the outer diameter of {outer:g} m; correct them."
        raise keys.error("inner_diameter", problem)
    return tube(outer, inner, poisson_ratio)


def read_round(keys: CheckedMapping, poisson_ratio: float) -> Section:
    """Read a round bar."""
    return tube(keys.number("diameter", positive=True), 0.0, poisson_ratio)
