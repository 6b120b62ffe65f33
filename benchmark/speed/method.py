# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the chart knows of a way to get an answer."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Method:
    """A method at one setting; what is made once is made before.

    Attributes
    ----------
    family : str
        Line of the chart.
    setting : str
        Point on the line.
    frequencies : callable or None
        From an angle (rad) to the first three natural frequencies, (3,), Hz.
    frf : callable or None
        From an angle to the eleven FRFs on the lines, (n_lines, 11).
    missing : str
        Why a part is missing.
    """

    family: str
    setting: str
    frequencies: Callable[[float], FloatArray] | None = None
    frf: Callable[[float], ComplexArray] | None = None
    missing: str = ""


def counted(n: int, what: str) -> str:
    """Return a number of things in words.

    Examples
    --------
    >>> counted(1, "mode"), counted(3, "mode")
    ('1 mode', '3 modes')
    """
    return f"{n} {what}{'s' * (n != 1)}"
