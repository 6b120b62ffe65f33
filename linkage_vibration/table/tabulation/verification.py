# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares a table with the model, at points to which it was not fitted."""

import math
from dataclasses import replace

import numpy as np

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation.accuracy import Accuracy
from linkage_vibration.table.tabulation.peaks import apart
from linkage_vibration.table.tabulation.refinement import Piece
from linkage_vibration.table.tabulation.sampling import Sample, Sampler
from linkage_vibration.table.tabulation.tracking import Tracked

_LINES = 201  # frequencies at which FRFs are compared, in addition to those near resonances
_SILENT = 1e-6  # of the drive-point FRFs of two places: an FRF between them that is only rounding


def verify(
    table: Table, sampler: Sampler, pieces: list[Piece], tracked: Tracked, accuracy: Accuracy
) -> tuple[Table, list[Piece]]:
    """Measure the errors of a table at the points that its pieces reserve for that.

    Parameters
    ----------
    table : Table
        The assembled table.
    sampler, pieces, tracked, accuracy
        The arguments from which it was assembled.

    Returns
    -------
    tuple of (Table, list of Piece)
        The table with its errors, and the pieces that are not accurate enough.
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
    measured = replace(
        table,
        interpolation_error=errors[:, 0],
        peak_error=float(errors[:, 1].max()),
        frf_error=float(errors[:, 2].max()) if table.places else math.nan,
    )
    allowed = accuracy.frequency, accuracy.peak, accuracy.frf
    return measured, [pieces[i] for i in np.flatnonzero((errors > allowed).any(axis=1))]


def frf_lines(exact: PoleResidue, band: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return where FRFs are compared, Hz, (n_freq,), and weights, (n_freq, 1, 1).

    The sum of the squares of weighted values is the integral of the squares over the band.

    Parameters
    ----------
    exact, band
        The exact FRFs, whose resonances have more lines; Hz.
    """
    lines = exact.lines(band, _LINES)
    return lines, np.sqrt(np.gradient(lines))[:, np.newaxis, np.newaxis]


def worst_frf_error(found: ComplexArray, exact: ComplexArray) -> float:
    """Return the largest relative L2 error of weighted FRFs.

    Parameters
    ----------
    found, exact : complex ndarray, (n_freq, n_places, n_places)
        m/N, weighted as `frf_lines` says.
    """
    size = np.linalg.norm(exact, axis=0)
    # A response that is only rounding has no relative error.
    size = np.maximum(size, _SILENT * np.sqrt(np.outer(np.diag(size), np.diag(size))))
    off = np.linalg.norm(found - exact, axis=0)
    return float((off[size > 0.0] / size[size > 0.0]).max(initial=0.0))


def _frequency_error(table: Table, sample: Sample, exact: FloatArray) -> float:
    """Return the largest relative error of a natural frequency."""
    values = table.interpolate(sample.alpha3)[0]
    return float(np.abs(np.array(values[: len(exact)]) / exact - 1.0).max())


def _peak_error(table: Table, sample: Sample, known: float) -> float:
    """Return the relative error of the highest peak, or the known one of a piece if larger."""
    _, at, size, _ = table.interpolate(sample.alpha3)
    peak = sample.peak
    error = max(known, abs(size / peak.magnitude - 1.0))
    # Either of two peaks of one height, within the error, is the highest.
    places, sizes = np.hstack([sample.peaks, sample.edges])
    rivals = [peak.frequency, *places[sizes >= (1.0 - 2.0 * error) * peak.magnitude]]
    return max(error, float(apart(at, np.array(rivals)).min()))


def _frf_error(table: Table, sample: Sample) -> float:
    """Return the largest relative L2 error over the band of the FRFs of the table."""
    if not table.places:
        return 0.0
    assert sample.terms is not None
    exact = sample.terms.frf
    found = table.frf(sample.alpha3, table.places, table.places)
    lines, weights = frf_lines(exact, table.band)
    return worst_frf_error(weights * found.frf(lines), weights * exact.frf(lines))
