# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of FRFs in the L2 norm over a band."""

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.response import PoleResidue

SILENT_SHARE = 1e-6  # of the drive-point FRFs of two places; a smaller FRF between them is rounding

N_LINES = 201  # Frequencies at which FRFs are compared, in addition to those near resonances


def frf_lines(exact: PoleResidue, band: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return lines, Hz, (n_freq,), denser at resonances, and L2 weights, (n_freq, 1, 1)."""
    lines = exact.lines(band, N_LINES)
    return lines, np.sqrt(np.gradient(lines))[:, np.newaxis, np.newaxis]


def frf_norms(
    approximate: PoleResidue, exact: PoleResidue, band: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Return the L2 norms over a band of the errors of FRFs, and of the exact FRFs."""
    lines, weights = frf_lines(exact, band)
    squared, right = np.repeat(weights.ravel() ** 2, 2), exact.frf(lines)
    # Real and imaginary parts side by side take a third of the time of complex numbers.
    parts = (np.moveaxis(x, 0, -1).copy() for x in (approximate.frf(lines) - right, right))
    off, size = (np.sqrt(np.square(part.view(float)) @ squared) for part in parts)
    return off, size


def worst_shares(off: FloatArray, size: FloatArray, n_outputs: int = 0) -> FloatArray:
    """Return the largest ratios of norms of errors to those of FRFs, (2,), from (n_rows, n_inputs).

    The first is that of motions: between the inputs, whose rows come first, and of other outputs.
    The second is that of forces to the largest force that the same input causes.
    """
    drives, n = np.sqrt(np.diag(size)), size.shape[1] + n_outputs
    # A response that is only rounding has no relative error.
    silent = np.tile(drives * drives.max(initial=0.0), (n, 1))
    silent[: len(drives)] = np.outer(drives, drives)
    moved = np.maximum(size[:n], SILENT_SHARE * silent)
    forces = np.tile(size[n:].max(axis=0, initial=0.0), (len(size) - n, 1))
    parts = (off[:n], moved), (off[n:], forces)
    return np.array([(o[s > 0.0] / s[s > 0.0]).max(initial=0.0) for o, s in parts])
