# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Makes the table from refined pieces."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.response import FarPoles, far_poles
from linkage_vibration.support.version import VERSION
from linkage_vibration.table.reduced import frf_pairs, shortened
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation.accuracy import Accuracy, Bounds
from linkage_vibration.table.tabulation.peaks import SILENT, notable
from linkage_vibration.table.tabulation.refinement import Piece
from linkage_vibration.table.tabulation.sampling import Sampler, Terms
from linkage_vibration.table.tabulation.tracking import Tracked


def assemble(
    sampler: Sampler, pieces: list[Piece], tracked: Tracked, accuracy: Accuracy, n_far: int
) -> Table:
    """Make the table from the pieces of the whole stroke; its errors are not measured yet.

    The modes are tracked at all their points, also those to which they are not fitted; ``n_far``
    poles represent the modes above the band.
    """
    band, equal = sampler.response.peak_band, accuracy.equal_height
    notables = np.array([_notable(tracked, piece, band, equal) for piece in pieces])
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
    w, (outputs, inputs) = math.tau * far.frequencies, frf_pairs(len(terms.own), terms.n_inputs)
    parts = 1.0 / (k[:, np.newaxis] - w**2 + 1j * np.outer(c, w))
    shapes = terms.own[:, others].astype(complex)
    sums = (shapes[outputs] * shapes[inputs] @ parts).T
    real = not k.imag.any()
    weights = far.fit(sums, real=real)[: 1 + len(far.decay)]
    return weights.real if real else weights
