# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The accuracy of a table, which follows from one tolerance."""

from dataclasses import dataclass

TOLERANCE = 1e-6  # Default relative tolerance of natural frequencies
COARSEST = 1.0  # Tables of this tolerance or above have no use.

LOOSER = 100.0
"""Ratio of the tolerance of peaks and FRFs to that of natural frequencies.

A relative error e of a resonance causes a relative error of its FRF of e / (sqrt(2) zeta) in the L2
norm, by the derivative of a Lorentzian: a hundred times e at a damping ratio of 0.7 %.
"""

FORCES_LOOSER = 10.0  # Tolerance of forces over that of FRFs, as load ratios need fewer digits
FRF_FLOOR = 1e-5  # Best tolerance of FRFs, since far poles represent the modes above the band
MARGIN = 1.02  # Factor of the errors found, since the worst place lies between those compared
CELL_SHARE = 0.05  # Share of the tolerance that the error of a cubic cell may have
_CELL = 1e-9  # Larger errors of cells make a table hardly smaller.


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Relative errors that a table may have."""

    frequency: float  # tolerance of the natural frequencies

    @property
    def peak(self) -> float:
        """Tolerance of frequency and magnitude of the highest peak."""
        return LOOSER * self.frequency

    @property
    def cell(self) -> float:
        """Largest error of a value in a cubic cell."""
        return min(_CELL, CELL_SHARE * self.frequency)

    @property
    def frf(self) -> float:
        """Tolerance of each FRF between the points of the table, L2 norm over the band."""
        return max(LOOSER * self.frequency, FRF_FLOOR)

    @property
    def force(self) -> float:
        """Tolerance of each force, relative to the largest by the same input, likewise."""
        return FORCES_LOOSER * self.frf


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of the relative errors in a piece of a table."""

    values: float  # natural frequencies and damping ratios
    peak: float  # frequency and magnitude of the highest peak
    frf: float  # FRFs between the places, L2 norm over the band; 0 without FRFs
    force: float  # forces, relative to the largest by the same input, likewise
    slope: float  # slopes of natural frequencies, divided by these, 1/rad

    def meet(self, accuracy: Accuracy) -> bool:
        """Return whether the errors are small enough; slopes have no tolerance."""
        small = self.values <= accuracy.frequency and self.peak <= accuracy.peak
        return small and self.frf <= accuracy.frf and self.force <= accuracy.force
