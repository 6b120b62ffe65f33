# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Cross-sections of beams from their dimensions.

Shear coefficients are Cowper's (J. Appl. Mech. 33, 1966, 335-340), torsion constants
Saint-Venant's, for which the ends are free to warp.
"""

import math

from linkage_vibration.mechanics.description import Section

_ZETA_5 = 1.0369277551433699  # sum of 1 / n^5


def rectangle(width: float, height: float, poisson_ratio: float) -> Section:
    """Return a full rectangle, ``height`` in the plane of motion and ``width`` across it, in m.

    With sides b <= a its torsion constant is
    J = a b^3 (1/3 - 64 b / (pi^5 a) sum over odd n of tanh(n pi a / (2 b)) / n^5), exact to
    rounding. Cowper's shear coefficient holds for any ratio of the sides, and so in both planes.

    Examples
    --------
    A square of side a has J = 0.1406 a^4:

    >>> round(rectangle(1.0, 1.0, 0.3).torsion_constant, 4)
    0.1406
    """
    shear = 10.0 * (1.0 + poisson_ratio) / (12.0 + 11.0 * poisson_ratio)
    b, a = sorted((width, height))
    # The sum of 1 / n^5 over odd n less what tanh lacks to 1, which is below 1e-19 from n = 11 on.
    lack = sum((1.0 - math.tanh(n * math.pi * a / (2.0 * b))) / n**5 for n in (1, 3, 5, 7, 9))
    series = 31.0 / 32.0 * _ZETA_5 - lack
    return Section(
        area=width * height,
        second_moment=width * height**3 / 12.0,
        shear_coefficient=shear,
        second_moment_out=height * width**3 / 12.0,
        shear_coefficient_out=shear,
        torsion_constant=a * b**3 * (1.0 / 3.0 - 64.0 * b / (math.pi**5 * a) * series),
    )


def tube(outer: float, inner: float, poisson_ratio: float) -> Section:
    """Return a round tube of the given diameters in m; inner 0 makes a full bar.

    Its torsion constant is the polar second moment of area, exactly.

    Examples
    --------
    >>> bar = tube(0.02, 0.0, 0.3)
    >>> bar.torsion_constant == 2.0 * bar.second_moment
    True
    """
    area = math.pi * (outer**2 - inner**2) / 4.0
    second_moment = math.pi * (outer**4 - inner**4) / 64.0
    nu, m2 = poisson_ratio, (inner / outer) ** 2
    shear = 6.0 * (1 + nu) * (1 + m2) ** 2 / ((7 + 6 * nu) * (1 + m2) ** 2 + (20 + 12 * nu) * m2)
    return Section(area, second_moment, shear, second_moment, shear, 2.0 * second_moment)
