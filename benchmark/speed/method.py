# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A method of the chart, with one setting."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Method:
    """A method with one setting; its preparation is finished.

    Attributes
    ----------
    family : str
        Name of the line in the chart.
    setting : str
        Name of the point on the line.
    frequencies : callable or None
        From an angle (rad) to the first three natural frequencies, (3,), Hz.
    frf : callable or None
        From an angle (rad) to the eleven FRFs on the lines, (n_lines, 11).
    missing : str
        The reason if a part is missing.
    """

    family: str
    setting: str
    frequencies: Callable[[float], FloatArray] | None = None
    frf: Callable[[float], ComplexArray] | None = None
    missing: str = ""


def counted(n: int, what: str) -> str:
    """Return a number with its noun.

    Examples
    --------
    >>> counted(1, "mode"), counted(3, "mode")
    ('1 mode', '3 modes')
    """
    return f"{n} {what}{'s' * (n != 1)}"
