# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Makes the table from refined pieces, and compares it with the model at other points."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.response import FarPoles, far_poles, pole_residue
from linkage_vibration.support.version import VERSION
from linkage_vibration.table.interpolation import NearTerms, stroke_angle
from linkage_vibration.table.reduced import frf_pairs, shortened
from linkage_vibration.table.table import CELLS, Table
from linkage_vibration.table.tabulation.accuracy import MARGIN, ROUNDING, Accuracy, Bounds
from linkage_vibration.table.tabulation.frf_errors import frf_norms, worst_share
from linkage_vibration.table.tabulation.peaks import SILENT, notable, row_errors
from linkage_vibration.table.tabulation.refinement import Piece, dense
from linkage_vibration.table.tabulation.sampling import Sampler, Terms
from linkage_vibration.table.tabulation.tracking import Tracked

_FRF_ANGLES = 2  # FRFs are compared at so many angles of a piece.


def assemble(
    sampler: Sampler, pieces: list[Piece], tracked: Tracked, accuracy: Accuracy, n_far: int
) -> Table:
    """Make the table from the pieces of the whole stroke; its errors are not measured yet.

    The modes are tracked at all their points, also those to which they are not fitted; ``n_far``
    poles represent the modes above the band.
    """
    band, equal = sampler.response.peak_band, accuracy.equal_height
    at, sizes = tracked.peak_frequencies, tracked.peak_magnitudes
    rows = [tracked.at(piece.fitted + piece.held) for piece in pieces]
    # The maxima that are needed to find the highest peak in each piece.
    notables = np.array([notable(at[r], sizes[r], band, equal, strict=False) for r in rows])
    used, n = notables.any(axis=0), sampler.response.modes
    variables = sorted({x for piece in pieces for x in piece.fitted})
    fitted = tracked.only(tracked.at(variables))
    bounds = [variables.index(piece.fitted[0]) for piece in pieces] + [len(variables) - 1]
    absent = np.isnan(fitted.peak_magnitudes)
    samples = [sampler.at(x) for x in variables]
    deviations = [
        sample.deviations[:, order[:n]]
        for sample, order in zip(samples, fitted.orders, strict=True)
        if sample.deviations is not None
    ]
    by_noise = np.array(deviations).swapaxes(0, 1) if deviations else 2 * [np.empty(0)]
    table = replace(
        bare_table(sampler, np.array([sample.alpha3 for sample in samples]), np.array(bounds)),
        natural_frequencies=np.exp(fitted.log_frequencies[:, :n]),
        damping_ratios=fitted.ratios[:, :n],
        peak_frequencies=np.where(absent, 0.0, fitted.peak_frequencies)[:, used],
        peak_magnitudes=np.where(absent, SILENT, fitted.peak_magnitudes)[:, used],
        peak_notable=notables[:, used],
        frequency_stddev=by_noise[0],
        damping_ratio_stddev=by_noise[1],
    )
    terms = [sample.terms for sample in samples if sample.terms is not None]
    complete = len(terms) == len(samples)
    return _with_frfs(table, sampler, fitted, terms, n_far) if complete else table


def bare_table(sampler: Sampler, alpha3: FloatArray, bounds: IntArray) -> Table:
    """Return a table of some angles (rad) without any values, whose pieces begin at indices."""
    return Table(
        alpha3=alpha3,
        pieces=bounds.astype(np.int64),
        interpolation_error=np.zeros(len(bounds) - 1),
        free_modes=sampler.free_modes,
        toggles=sampler.toggles,
        band=sampler.response.band,
        peak_band=sampler.response.peak_band,
        reference_force=sampler.response.reference_force,
        model_hash=sampler.model.mechanism.model_hash,
        mechanism_name=sampler.model.mechanism.name,
        package_version=VERSION,
    )


def with_bounds(table: Table, bounds: Sequence[Bounds]) -> Table:
    """Return a table with the errors of its pieces."""
    return replace(
        table,
        interpolation_error=np.array([piece.values for piece in bounds]),
        peak_error=max(piece.peak for piece in bounds),
        frf_error=max(piece.frf for piece in bounds) if table.places else math.nan,
        slope_error=max(piece.slope for piece in bounds),
    )


def _with_frfs(
    table: Table, sampler: Sampler, tracked: Tracked, terms: Sequence[Terms], n_far: int
) -> Table:
    """Add the terms of FRFs: those of the tracked modes, and far poles for the sum of all others.

    Terms have the same indices as the modes, since there is no mechanism mode.
    """
    tracks = list(zip(terms, tracked.orders, tracked.shapes, strict=True))
    both = [
        (each, np.delete(np.arange(len(each.damped.decay)), order)) for each, order, _ in tracks
    ]
    shapes = [each.rows @ shapes[: each.rows.shape[1]] for each, _, shapes in tracks]
    far = far_poles(
        np.concatenate([each.damped.stiffness[rest] for each, rest in both]),
        np.concatenate([each.damped.decay[rest] for each, rest in both]),
        table.band,
        n_far,
    )
    return replace(
        table,
        places=sampler.places,
        forces=sampler.forces,
        term_stiffness=np.array([each.damped.stiffness[order] for each, order, _ in tracks]),
        term_decay=np.array([each.damped.decay[order] for each, order, _ in tracks]),
        participations=np.array(shapes).astype(complex),
        far_stiffness=far.stiffness,
        far_decay=far.decay,
        far_residues=shortened(
            np.array([_far_residues(each, rest, far) for each, rest in both]), len(sampler.places)
        ),
    )


def _far_residues(terms: Terms, others: IntArray, far: FarPoles) -> FloatArray | ComplexArray:
    """Return static flexibility and residues of far poles, as a table has them."""
    k, c = terms.damped.stiffness[others], terms.damped.decay[others]
    shapes, w = terms.participations[:, others].astype(complex), math.tau * far.frequencies
    outputs, inputs = frf_pairs(len(shapes), terms.n_inputs)
    parts = 1.0 / (k[:, np.newaxis] - w**2 + 1j * np.outer(c, w))
    sums = (shapes[outputs] * shapes[inputs] @ parts).T
    real = not k.imag.any()
    weights = far.fit(sums, real=real)[: 1 + len(far.decay)]
    return weights.real if real else weights


def thin(finer: Table, pieces: Sequence[Piece]) -> Table:
    """Return the table of pieces from that of their finer polynomials; its errors are unknown."""
    variables = sorted({x for piece in pieces for x in piece.finer.fitted})
    fitted = {x for piece in pieces for x in piece.fitted}
    return finer.thinned(np.array([x in fitted for x in variables], dtype=np.bool_))


def bound_errors(
    table: Table, finer: Table, index: int, piece: Piece, tracked: Tracked, sampler: Sampler
) -> Bounds:
    """Bound the errors of a piece of a table by finer polynomials and by the model."""
    angles, k = stroke_angle(dense(*piece.ends), table.toggles), table.n_modes
    coarse, exact = table.polynomials(index, angles), finer.polynomials(index, angles)
    ends = np.linspace(*piece.ends, CELLS + 1)
    middles = stroke_angle((ends[1:] + ends[:-1]) / 2.0, table.toggles)
    in_cells, resampled = table.cells.many_values(middles), table.polynomials(index, middles)
    errors = row_errors(coarse, exact, k, table.peak_band)
    errors += row_errors(in_cells, resampled, k, table.peak_band)
    slopes = CubicSpline(angles, coarse[:, :k] / exact[:, :k] - 1.0)(angles, 1)
    # A slope that is wrong by e at the end of a cell causes an error of e / 8 cells in its middle.
    cell_slopes = 8.0 * (in_cells[:, :k] / resampled[:, :k] - 1.0)
    cell_slopes /= np.diff(stroke_angle(ends, table.toggles))[:, np.newaxis]
    slope = np.abs(slopes).max() + np.abs(cell_slopes).max()
    errors[0] = max(errors[0], piece.gap)
    for x in piece.held:
        sample, row = sampler.at(x), int(np.searchsorted(tracked.variables, x))
        peak = sample.drive.peak(table.peak_band)
        maxima = np.hstack([sample.peaks, sample.edges, [[peak.frequency], [peak.magnitude]]])
        values = np.exp(tracked.log_frequencies[row, :k]), tracked.ratios[row, :k]
        looked_up = table.cells.many_values(np.array([sample.alpha3]))
        exact = np.concatenate([*values, *maxima])[np.newaxis]
        errors = np.maximum(errors, row_errors(looked_up, exact, k, table.peak_band, errors[1]))
    rounding, frf, far = sampler.rounding(piece.finer.fitted), 0.0, 0.0
    if table.places:
        frf, far = _frf_error(table, finer, index, sampler, piece)
        frf += rounding.frf
    # The height of a resonance follows its frequency and its damping.
    values, peak = errors + rounding.values * np.array([1.0, 2.0])
    bounds = np.maximum(MARGIN * np.array([values, peak, frf, slope, far]), ROUNDING)
    return Bounds(*bounds.tolist())


def _frf_error(
    table: Table, finer: Table, index: int, sampler: Sampler, piece: Piece
) -> tuple[float, float]:
    """Return the largest relative L2 error over the band of an FRF in a piece, and a part of it.

    That part is the finer polynomials' difference from the model, measured at their points; the sum
    with the table's difference from them is evaluated where the latter is largest.
    """
    places = (*table.places, *table.forces), table.places
    far, worst, worst_far = np.zeros([len(each) for each in places]), 0.0, 0.0
    for x in piece.more[:_FRF_ANGLES]:
        terms = sampler.at(x).terms
        assert terms is not None
        approximate = finer.frf(sampler.at(x).alpha3, *places)
        shapes = terms.participations
        exact = pole_residue(terms.damped, shapes, shapes[: terms.n_inputs])
        far = np.maximum(far, frf_norms(approximate, exact, table.band)[0])
    angles = stroke_angle(dense(*piece.ends)[::2], table.toggles).clip(*table.alpha3_range)
    coarse_terms, finer_terms = (each.terms(index, angles) for each in (table, finer))
    highest: set[int] = set()
    for change in _term_change(coarse_terms, finer_terms, table.band, len(table.places)):
        rises, falls = np.diff(change, prepend=-1.0) > 0.0, np.diff(change, append=-1.0) <= 0.0
        tops = np.flatnonzero(rises & falls)
        highest.update(tops[np.argsort(change[tops])[-_FRF_ANGLES:]].tolist())
    for i in highest:
        approximate, exact = (each.frf(angles[i], *places) for each in (table, finer))
        off, norms = frf_norms(approximate, exact, table.band)
        worst = max(worst, worst_share(np.hypot(off, far), norms))
        worst_far = max(worst_far, worst_share(far, norms))
    return worst, worst_far


def _term_change(
    terms: NearTerms, finer: NearTerms, band: tuple[float, float], n_inputs: int
) -> FloatArray:
    """Return roughly how much finer polynomials change FRFs in a band (Hz) at n angles, (2, n).

    The rows are displacements, then also forces. A pole that moves by d changes its term of
    half-power half-width w by abs(d) / (sqrt(2) w) in the L2 norm; inputs come first.
    """
    (k, c, shapes), (coarse_k, coarse_c, coarse_shapes) = finer, terms
    omega = np.sqrt(k)
    width = c / 2.0 + omega.imag
    moved = np.abs(np.sqrt(coarse_k) - omega + 0.5j * (coarse_c - c)) / (math.sqrt(2.0) * width)
    # The squared L2 norm of a term over the band is pi abs(r)^2 / (4 omega^2 w).
    weight = np.where(omega.real < 2.0 * math.pi * band[1], omega.real**-2 / width, 0.0)
    weight, moved = weight[:, np.newaxis], moved[:, np.newaxis]
    size, change = np.abs(shapes), np.abs(coarse_shapes - shapes)
    inputs, turned = (each[:, :n_inputs].swapaxes(1, 2) for each in (size, change))
    whole = (weight * size**2) @ inputs**2
    # abs(d(s t)) <= abs(ds) abs(t) + abs(s) abs(dt) for the shapes s and t at two places
    off = (weight * (change**2 + (size * moved) ** 2)) @ inputs**2
    off += (weight * size**2) @ turned**2
    off += 2.0 * (weight * size * change) @ (inputs * turned)
    norms = list(zip(np.sqrt(off), np.sqrt(whole), strict=True))
    return np.array([[worst_share(o[:n], s[:n]) for o, s in norms] for n in (n_inputs, None)])
