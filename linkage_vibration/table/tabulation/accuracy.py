# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a table promises, all of it from one tolerance."""

from dataclasses import dataclass

TOLERANCE = 1e-6
"""Of natural frequencies, unless told otherwise."""

LOOSER = 100.0
"""Times the tolerance of natural frequencies: that of peaks and FRFs.

A resonance that is off by a share e puts its FRF off by e / (sqrt(2) zeta) in the L2 norm, as a
Lorentzian's derivative tells: a hundred times e at a damping ratio of 0.7 %.
"""

FRF_FLOOR = 1e-5
"""No better is promised of FRFs: far poles stand for the modes above the band."""

_SHARPER = 5.0  # peaks change more between the points than at those that tell their error
_EQUAL_AT_MOST = 0.1  # of a height: maxima that differ by more are two, whatever the tolerance


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Relative errors that a table may have.

    Attributes
    ----------
    frequency : float
        Of the natural frequencies.
    """

    frequency: float

    @property
    def peak(self) -> float:
        """Of the highest peak's frequency and magnitude."""
        return LOOSER * self.frequency

    @property
    def refined_peak(self) -> float:
        """Of the same, at the points by which pieces are refined."""
        return LOOSER / _SHARPER * self.frequency

    @property
    def equal_height(self) -> float:
        """Relative difference up to which two maxima are of one height."""
        return min(self.refined_peak, _EQUAL_AT_MOST)

    @property
    def frf(self) -> float:
        """Of each FRF between the table's points, L2 norm over the band."""
        return max(LOOSER * self.frequency, FRF_FLOOR)
