# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Where poles of the crank with a tuned mass and a damper meet, to the last digits."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, root

from test.support.crossing import exact_poles

GAP, AT, RATIO = 0.5, 0.8137, 0.01  # Hz, rad and 1, of the crank
HEAVY = 4000.0  # N s/m, with which one of its modes is overdamped over a part of the stroke
_HIGHEST = 1e3  # rad/s, below the mode in which the crank is stretched


def poles_at(dashpot: float, alpha3: float) -> NDArray[np.complex128]:
    """Return the oscillating poles of the lower two modes, ascending, (2,) or (1,), rad/s.

    Parameters
    ----------
    dashpot, alpha3 : float
        N s/m and rad.
    """
    poles = exact_poles(GAP, AT, RATIO, dashpot, alpha3)
    return np.array(sorted(poles[(poles.imag > 0.0) & (np.abs(poles) < _HIGHEST)], key=abs))


def meeting_off_axis() -> tuple[float, float]:
    """Return the dashpot (N s/m) and the angle (rad) at which the poles of both modes meet."""

    def apart(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        one, other = poles_at(100.0 * float(unknown[1]), float(unknown[0]))
        square = (one - other) ** 2  # smooth, where the difference is not
        return np.array([square.real, square.imag])

    angle, dashpot = root(apart, [AT, 0.95], tol=1e-14).x
    return 100.0 * float(dashpot), float(angle)


def meeting_on_axis() -> tuple[float, float]:
    """Return the same where a pole meets its conjugate, and the mode becomes overdamped."""

    def square(alpha3: float) -> float:
        poles = exact_poles(GAP, AT, RATIO, HEAVY, alpha3)
        one, other = sorted(poles, key=lambda pole: abs(pole.imag))[:2]
        return float(((one - other) ** 2).real)

    return HEAVY, float(brentq(square, AT, 0.9, xtol=1e-15))
