# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares a table with the model, at points to which it was not fitted."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.table.interpolation import stroke_angle
from linkage_vibration.table.table import CELLS, Table
from linkage_vibration.table.tabulation.accuracy import (
    MARGIN,
    N_LINES,
    ROUNDING,
    SILENT_SHARE,
    Bounds,
)
from linkage_vibration.table.tabulation.near_terms import term_change
from linkage_vibration.table.tabulation.peaks import apart, heights
from linkage_vibration.table.tabulation.refinement import Piece, dense
from linkage_vibration.table.tabulation.sampling import Sample, Sampler
from linkage_vibration.table.tabulation.tracking import Tracked

_FRF_ANGLES = 2  # FRFs are compared at so many angles of a piece.


def thin(finer: Table, pieces: Sequence[Piece]) -> Table:
    """Return the table of pieces from that of their finer polynomials; its errors are unknown."""
    variables = sorted({x for piece in pieces for x in piece.finer.fitted})
    fitted = {x for piece in pieces for x in piece.fitted}
    return finer.thinned(np.array([x in fitted for x in variables], dtype=np.bool_))


def bound_errors(
    table: Table, finer: Table, index: int, piece: Piece, tracked: Tracked, sampler: Sampler
) -> Bounds:
    """Bound the errors of a piece of a table by finer polynomials and by the model."""
    variables = dense(*piece.ends)
    values, peak, slope = _between_points(table, finer, index, variables)
    values = max(values, piece.gap)
    for x in piece.held:
        row = int(np.searchsorted(tracked.variables, x))
        exact = np.exp(tracked.log_frequencies[row]), tracked.ratios[row]
        exact_values = np.concatenate([each[: table.n_modes] for each in exact])
        values = max(values, _value_error(table, sampler.at(x), exact_values))
        peak = _peak_error(table, sampler.at(x), peak)
    rounding, frf, far = sampler.rounding(piece.finer.fitted), 0.0, 0.0
    if table.places:
        frf, far = _frf_error(table, finer, sampler, piece)
        frf += rounding.frf
    # The height of a resonance follows its frequency and its damping.
    values, peak = values + rounding.values, peak + 2.0 * rounding.values
    bounds = np.maximum(MARGIN * np.array([values, peak, frf, slope, far]), ROUNDING)
    return Bounds(*bounds.tolist())


def frf_lines(exact: PoleResidue, band: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return where FRFs are compared, Hz, (n_freq,), and weights, (n_freq, 1, 1).

    The sum of the squares of weighted values is the integral of the squares over the band. The
    resonances of the exact FRFs have more lines.
    """
    lines = exact.lines(band, N_LINES)
    return lines, np.sqrt(np.gradient(lines))[:, np.newaxis, np.newaxis]


def worst_frf_error(frfs: ComplexArray, exact: ComplexArray) -> float:
    """Return the largest relative L2 error of FRFs, (n_freq, n_places, n_places).

    They are weighted as `frf_lines` says.
    """
    return _worst_share(np.linalg.norm(frfs - exact, axis=0), np.linalg.norm(exact, axis=0))


def _worst_share(off: FloatArray, size: FloatArray) -> float:
    """Return the largest ratio of norms of errors to those of FRFs, (n_places, n_places)."""
    # A response that is only rounding has no relative error.
    size = np.maximum(size, SILENT_SHARE * np.sqrt(np.outer(np.diag(size), np.diag(size))))
    return float((off[size > 0.0] / size[size > 0.0]).max(initial=0.0))


def _between_points(
    table: Table, finer: Table, piece: int, variables: FloatArray
) -> tuple[float, float, float]:
    """Compare a piece of a table with finer polynomials, at stroke variables all over it.

    It returns relative errors of values and of the highest peak, and those of slopes, 1/rad.
    """
    angles = _angles(table, variables)
    n, k = 2 * table.n_modes, table.n_modes
    coarse, exact = table.polynomials(piece, angles), finer.polynomials(piece, angles)
    off = np.abs(coarse[:, :n] / exact[:, :n] - 1.0)
    cells, cell_slope, peak_cells = _cell_errors(table, piece, variables)
    slopes = CubicSpline(angles, coarse[:, :k] / exact[:, :k] - 1.0)(angles, 1)
    return (
        float(off.max()) + cells,
        _highest_error(table, coarse[:, n:], exact[:, n:]) + peak_cells,
        float(np.abs(slopes).max()) + cell_slope,
    )


def _angles(table: Table, variables: FloatArray) -> FloatArray:
    """Return the angles of stroke variables over a piece, rad; the ends to the last bit."""
    angles = stroke_angle(variables, table.toggles)
    bounds = table.alpha3[table.pieces]
    angles[[0, -1]] = [bounds[np.abs(bounds - angles[i]).argmin()] for i in (0, -1)]
    return angles


def _cell_errors(table: Table, piece: int, variables: FloatArray) -> tuple[float, float, float]:
    """Return errors of cells: of values, slopes (1/rad) and peaks, from the middles of cells."""
    ends = np.linspace(variables[0], variables[-1], CELLS + 1)
    middles = stroke_angle((ends[1:] + ends[:-1]) / 2.0, table.toggles)
    size = np.diff(stroke_angle(ends, table.toggles))[:, np.newaxis]
    n = 2 * table.n_modes
    looked_up = table.evaluate(middles)
    exact = table.polynomials(piece, middles)
    off = np.abs(looked_up[:, :n] / exact[:, :n] - 1.0)
    _, height = _highest(table, exact[:, n:])
    # A slope that is wrong by e at the end of a cell causes an error of e / 8 cells in its middle.
    slope = 8.0 * off[:, : table.n_modes] / size
    return (
        float(off.max()),
        float(slope.max()),
        float(np.abs(looked_up[:, -1] / height - 1.0).max()),
    )


def _highest(table: Table, peaks: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return frequency and height of the highest of some peaks, (n, 2 n_peaks)."""
    at, sizes = np.hsplit(peaks, 2)
    size = heights(at, sizes, table.band)
    best = size.argmax(axis=1)[:, np.newaxis]
    return np.take_along_axis(at, best, 1)[:, 0], np.take_along_axis(size, best, 1)[:, 0]


def _highest_error(table: Table, peaks: FloatArray, exact: FloatArray) -> float:
    """Return the largest relative error of the highest of some peaks, (n, 2 n_peaks)."""
    at, size = _highest(table, peaks)
    places, sizes = np.hsplit(exact, 2)
    sizes = heights(places, sizes, table.band)
    height = sizes.max(axis=1)
    error = float(np.abs(size / height - 1.0).max())
    # Either of two peaks of one height, within the error, is the highest.
    rival = sizes >= (1.0 - 2.0 * error) * height[:, np.newaxis]
    away = np.where(rival, apart(at[:, np.newaxis], places), math.inf).min(axis=1)
    return max(error, float(away.max()))


def _value_error(table: Table, sample: Sample, exact: FloatArray) -> float:
    """Return the largest relative error of a natural frequency or a damping ratio."""
    values = table.evaluate(np.array([sample.alpha3]))[0]
    return float(np.abs(values[: len(exact)] / exact - 1.0).max())


def _peak_error(table: Table, sample: Sample, least: float) -> float:
    """Return the relative error of the highest peak, at least that which its piece has."""
    at, size = (float(value) for value in table.evaluate(np.array([sample.alpha3]))[0, -2:])
    places, sizes = np.hstack([sample.peaks, sample.edges])
    sizes = heights(places, sizes, table.band)
    # Lines show maxima that are not near a mode; a mechanism responds without limit towards 0 Hz.
    low = min(max(table.band[0], sample.frequencies[0] / 2.0), table.band[1])
    lines = np.abs(sample.drive.frf(sample.drive.lines((low, table.band[1]), N_LINES)))
    height = float(max(sizes.max(), lines.max()))
    error = max(least, abs(size / height - 1.0))
    # Either of two peaks of one height, within the error, is the highest.
    rivals = places[sizes >= (1.0 - 2.0 * error - ROUNDING) * height]
    return max(error, float(apart(at, rivals).min(initial=math.inf)))


def _frf_error(table: Table, finer: Table, sampler: Sampler, piece: Piece) -> tuple[float, float]:
    """Return the largest relative L2 error over the band of an FRF in a piece, and a part of it.

    Finer polynomials differ from the model by the far poles, and from the table by the
    interpolation of terms. The first part, which is also returned, is measured at points of the
    finer ones; the sum of both is evaluated where the second is largest.
    """
    size = len(table.places)
    far, worst, worst_far = np.zeros((size, size)), 0.0, 0.0
    for x in piece.more[:_FRF_ANGLES]:
        terms = sampler.at(x).terms
        assert terms is not None
        far = np.maximum(far, _frf_norms(finer, sampler.at(x).alpha3, terms.frf)[0])
    angles = _angles(table, dense(*piece.ends)[::2])
    change = term_change(table.terms(angles), finer.terms(angles), table.band)
    rises, falls = np.diff(change, prepend=-1.0) > 0.0, np.diff(change, append=-1.0) <= 0.0
    tops = np.flatnonzero(rises & falls)
    for i in tops[np.argsort(change[tops])[-_FRF_ANGLES:]].tolist():
        exact = finer.frf(angles[i], table.places, table.places)
        off, norms = _frf_norms(table, angles[i], exact)
        worst = max(worst, _worst_share(np.hypot(off, far), norms))
        worst_far = max(worst_far, _worst_share(far, norms))
    return worst, worst_far


def _frf_norms(table: Table, alpha3: float, exact: PoleResidue) -> tuple[FloatArray, FloatArray]:
    """Return L2 norms over the band of errors of a table's FRFs, and of exact FRFs."""
    approximate = table.frf(alpha3, table.places, table.places)
    lines, weights = frf_lines(exact, table.band)
    right = exact.frf(lines)
    off = np.linalg.norm(weights * (approximate.frf(lines) - right), axis=0)
    return off, np.linalg.norm(weights * right, axis=0)
