# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Holds a table against the model, at points that it was not fitted to."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation.accuracy import Accuracy
from linkage_vibration.table.tabulation.peaks import apart
from linkage_vibration.table.tabulation.refinement import Piece
from linkage_vibration.table.tabulation.sampling import Sample, Sampler
from linkage_vibration.table.tabulation.tracking import Tracked

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_LINES = 201  # frequencies at which FRFs are compared, beside those about the resonances
_SILENT = 1e-6  # of what two places respond to themselves: an FRF between them that is none


def verify(
    table: Table, sampler: Sampler, pieces: list[Piece], tracked: Tracked, accuracy: Accuracy
) -> tuple[Table, list[Piece]]:
    """Measure a table's errors where its pieces were held against the model.

    Parameters
    ----------
    table : Table
        As assembled.
    sampler, pieces, tracked
        What it was assembled from.
    accuracy : Accuracy
        What is asked for.

    Returns
    -------
    table : Table
        With its errors.
    poor : list of Piece
        Those that are not good enough.
    """
    frequencies = np.exp(tracked.log_frequencies[:, : table.n_modes])
    exact = dict(zip(tracked.variables.tolist(), frequencies, strict=True))
    found = []
    for piece in pieces:
        frequency, peak, frf = piece.gap, 0.0, 0.0
        for x in piece.held:
            sample = sampler.at(x)
            frequency = max(frequency, _frequency_error(table, sample, exact[x]))
            peak = _peak_error(table, sample, peak)
            frf = max(frf, _frf_error(table, sample))
        found.append((frequency, peak, frf))
    errors = np.array(found)
    told = replace(
        table,
        interpolation_error=errors[:, 0],
        peak_error=float(errors[:, 1].max()),
        frf_error=float(errors[:, 2].max()) if table.places else math.nan,
    )
    allowed = accuracy.frequency, accuracy.peak, accuracy.frf
    return told, [pieces[i] for i in np.flatnonzero((errors > allowed).any(axis=1))]


def frf_lines(exact: PoleResidue, band: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return where FRFs are compared, Hz, (n_freq,), and weights, (n_freq, 1, 1).

    The sum of the squares of what is weighted is its integral over the band.
    """
    lines = exact.lines(band, _LINES)
    return lines, np.sqrt(np.gradient(lines))[:, np.newaxis, np.newaxis]


def worst_frf_error(found: ComplexArray, exact: ComplexArray) -> float:
    """Return the relative L2 error of the worst of weighted FRFs, (n_freq, n_places, n_places)."""
    size = np.linalg.norm(exact, axis=0)
    # What does not respond at all but for rounding has no relative error.
    size = np.maximum(size, _SILENT * np.sqrt(np.outer(np.diag(size), np.diag(size))))
    off = np.linalg.norm(found - exact, axis=0)
    return float((off[size > 0.0] / size[size > 0.0]).max(initial=0.0))


def _frequency_error(table: Table, sample: Sample, exact: FloatArray) -> float:
    """Return the relative error of the worst natural frequency."""
    values = table.interpolate(sample.alpha3)[0]
    return float(np.abs(np.array(values[: len(exact)]) / exact - 1.0).max())


def _peak_error(table: Table, sample: Sample, known: float) -> float:
    """Return the relative error of the highest peak, or the known one of a piece if larger."""
    _, at, size, _ = table.interpolate(sample.alpha3)
    peak = sample.peak
    error = max(known, abs(size / peak.magnitude - 1.0))
    # Of two peaks of one height, as far as that is told, either is the highest.
    places, sizes = np.hstack([sample.peaks, sample.edges])
    rivals = [peak.frequency, *places[sizes >= (1.0 - 2.0 * error) * peak.magnitude]]
    return max(error, float(apart(at, np.array(rivals)).min()))


def _frf_error(table: Table, sample: Sample) -> float:
    """Return the relative L2 error over the band of the worst FRF between the table's places."""
    if not table.places:
        return 0.0
    assert sample.terms is not None
    exact = sample.terms.frf
    found = table.frf(sample.alpha3, table.places, table.places)
    lines, weights = frf_lines(exact, table.band)
    return worst_frf_error(weights * found.frf(lines), weights * exact.frf(lines))
