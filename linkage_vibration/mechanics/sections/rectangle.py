# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Full rectangles."""

import math

from linkage_vibration.mechanics.description import Section
from linkage_vibration.mechanics.keys import Keys

_ZETA_5 = 1.0369277551433699  # sum of 1 / n^5


def rectangle(width: float, height: float, poisson_ratio: float) -> Section:
    """Return a full rectangle, with its width across the plane of motion and its height in it, m.

    The shear coefficient is Cowper's (J. Appl. Mech. 33, 1966, 335-340), for any ratio of the
    sides, and so for both planes. With sides b <= a, Saint-Venant's torsion constant is J = a b^3
    (1/3 - 64 b / (pi^5 a) sum over odd n of tanh(n pi a / (2 b)) / n^5), exact to rounding.

    >>> round(rectangle(1.0, 1.0, 0.3).torsion_constant, 4)  # of a square of side a: 0.1406 a^4
    0.1406
    """
    shear = 10.0 * (1.0 + poisson_ratio) / (12.0 + 11.0 * poisson_ratio)
    b, a = sorted((width, height))
    # The sum of 1 / n^5 over odd n, minus the sum of (1 - tanh) / n^5, below 1e-19 from n = 11 on.
    lack = sum((1.0 - math.tanh(n * math.pi * a / (2.0 * b))) / n**5 for n in (1, 3, 5, 7, 9))
    series = 31.0 / 32.0 * _ZETA_5 - lack
    return Section(
        area=width * height,
        second_moment=width * height**3 / 12.0,
        shear_coefficient=shear,
        second_moment_out=height * width**3 / 12.0,
        shear_coefficient_out=shear,
        torsion_constant=a * b**3 * (1.0 / 3.0 - 64.0 * b / (math.pi**5 * a) * series),
        outer_fibre=height / 2.0,
    )


def read(keys: Keys, poisson_ratio: float) -> Section:
    """Read a rectangle."""
    width, height = keys.number("width", positive=True), keys.number("height", positive=True)
    return rectangle(width, height, poisson_ratio)
