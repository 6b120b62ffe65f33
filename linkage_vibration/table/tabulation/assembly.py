# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Makes the table from refined pieces."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.response import FarPoles, PoleResidue, far_poles
from linkage_vibration.support.version import VERSION
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation.accuracy import Accuracy, Bounds
from linkage_vibration.table.tabulation.near_terms import near_terms
from linkage_vibration.table.tabulation.peaks import SILENT, notable
from linkage_vibration.table.tabulation.refinement import Piece
from linkage_vibration.table.tabulation.sampling import Sample, Sampler, Terms
from linkage_vibration.table.tabulation.tracking import Tracked


def assemble(
    sampler: Sampler, pieces: list[Piece], tracked: Tracked, accuracy: Accuracy, n_far: int
) -> Table:
    """Make the table from the pieces of the whole stroke; its errors are not measured yet.

    The modes are tracked at all their points, also those to which they are not fitted; ``n_far``
    poles represent the modes above the band.
    """
    band, equal = sampler.response.band, accuracy.equal_height
    notables = np.array([_notable(tracked, piece, band, equal) for piece in pieces])
    used, n = notables.any(axis=0), sampler.response.modes
    variables = sorted({x for piece in pieces for x in piece.fitted})
    fitted = tracked.only(tracked.at(variables))
    bounds = [variables.index(piece.fitted[0]) for piece in pieces] + [len(variables) - 1]
    absent = np.isnan(fitted.peak_magnitudes)
    samples = [sampler.at(x) for x in variables]
    deviations = np.array(
        [_deviations(*pair, n) for pair in zip(samples, fitted.orders, strict=True)]
    )
    table = replace(
        bare_table(sampler, np.array([sample.alpha3 for sample in samples]), np.array(bounds)),
        natural_frequencies=np.exp(fitted.log_frequencies[:, :n]),
        damping_ratios=fitted.ratios[:, :n],
        peak_frequencies=np.where(absent, 0.0, fitted.peak_frequencies)[:, used],
        peak_magnitudes=np.where(absent, SILENT, fitted.peak_magnitudes)[:, used],
        peak_notable=notables[:, used],
        frequency_stddev=deviations[:, 0],
        damping_ratio_stddev=deviations[:, 1],
    )
    terms = [found for x in variables if (found := sampler.at(x).terms) is not None]
    return (
        table if len(terms) < len(variables) else _with_frfs(table, sampler, fitted, terms, n_far)
    )


def bare_table(sampler: Sampler, alpha3: FloatArray, bounds: IntArray) -> Table:
    """Return a table of some angles (rad) without any values, whose pieces begin at indices."""
    nothing = np.zeros((len(alpha3), 0))
    return Table(
        alpha3=alpha3,
        pieces=bounds.astype(np.int64),
        natural_frequencies=nothing,
        damping_ratios=nothing,
        peak_frequencies=nothing,
        peak_magnitudes=nothing,
        peak_notable=np.zeros((len(bounds) - 1, 0), dtype=np.bool_),
        interpolation_error=np.zeros(len(bounds) - 1),
        peak_error=math.nan,
        frf_error=math.nan,
        slope_error=math.nan,
        free_modes=sampler.free_modes,
        toggles=sampler.toggles,
        band=sampler.response.band,
        places=(),
        term_stiffness=nothing.astype(complex),
        term_decay=nothing,
        participations=np.zeros((len(alpha3), 0, 0), dtype=complex),
        far_stiffness=np.zeros(0, dtype=complex),
        far_decay=np.zeros(0),
        far_residues=np.zeros((len(alpha3), 1, 0)),
        reduced_orders=np.zeros(0, dtype=np.int64),
        reduced_inertia=np.zeros(0),
        reduced_stiffness=np.zeros(0),
        reduced_shapes=np.zeros(0),
        reduced_far=np.zeros(0),
        cell_starts=np.zeros(0),
        cell_cubics=np.zeros((0, 4, 0)),
        cell_poles=np.zeros((0, 2, 0), dtype=complex),
        frequency_stddev=nothing,
        damping_ratio_stddev=nothing,
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


def _deviations(sample: Sample, order: IntArray, n_modes: int) -> FloatArray:
    """Return the standard deviations of the tracked modes, (2, n_modes), or (2, 0)."""
    if sample.deviations is None:
        return np.empty((2, 0))
    return sample.deviations[:, order[:n_modes]]


def _notable(
    tracked: Tracked, piece: Piece, band: tuple[float, float], equal: float
) -> BoolArray | None:
    """Return which maxima are needed to find the highest peak in a piece."""
    rows = tracked.at(piece.fitted + piece.held)
    at, sizes = tracked.peak_frequencies[rows], tracked.peak_magnitudes[rows]
    return notable(at, sizes, band, equal, strict=False)


def _with_frfs(
    table: Table, sampler: Sampler, tracked: Tracked, terms: Sequence[Terms], n_far: int
) -> Table:
    """Add the terms of FRFs: those of the tracked modes, and far poles for the sum of all others.

    Terms have the same indices as the modes, since there is no mechanism mode.
    """
    stiffness, decay, participations = near_terms(terms, tracked)
    both = zip(terms, tracked.orders, strict=True)
    kept = [_mask(order, len(term.damped.decay)) for term, order in both]
    far = far_poles(
        np.concatenate(
            [
                t.damped.stiffness[~tracked_modes]
                for t, tracked_modes in zip(terms, kept, strict=True)
            ]
        ),
        np.concatenate(
            [t.damped.decay[~tracked_modes] for t, tracked_modes in zip(terms, kept, strict=True)]
        ),
        table.band,
        n_far,
    )
    residues = np.array(
        [
            _far_residues(t.triangle, tracked_modes, far)
            for t, tracked_modes in zip(terms, kept, strict=True)
        ]
    )
    return replace(
        table,
        places=sampler.places,
        term_stiffness=stiffness,
        term_decay=decay,
        participations=participations,
        far_stiffness=far.stiffness,
        far_decay=far.decay,
        far_residues=residues if residues.imag.any() else residues.real,
    )


def _mask(order: IntArray, count: int) -> BoolArray:
    """Return which of ``count`` modes are in an order, (count,)."""
    mask = np.zeros(count, dtype=np.bool_)
    mask[order] = True
    return mask


def _far_residues(triangle: PoleResidue, kept: BoolArray, far: FarPoles) -> ComplexArray:
    """Return static flexibility and residues of far poles, as a table has them."""
    condensed = triangle.condensed(kept, far)
    tail = condensed.residues[:, 0, len(condensed.decay) - len(far.decay) :]
    return np.hstack([condensed.residual, tail]).T
