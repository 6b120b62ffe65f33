# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The terms of FRFs that belong to tracked modes, and how much finer polynomials change them."""

import math
from collections.abc import Sequence

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.table.interpolation import NearTerms, interpolate_terms, interpolation_matrix
from linkage_vibration.table.tabulation.accuracy import SILENT_SHARE
from linkage_vibration.table.tabulation.refinement import Piece, dense
from linkage_vibration.table.tabulation.sampling import Sampler, Terms
from linkage_vibration.table.tabulation.tracking import Tracked


def near_terms(terms: Sequence[Terms], tracked: Tracked) -> NearTerms:
    """Return the terms of the tracked modes at n samples, from the terms of all modes there."""
    both = list(zip(terms, tracked.orders, tracked.shapes, strict=True))
    return (
        np.array([term.damped.stiffness[order] for term, order, _ in both]),
        np.array([term.damped.decay[order] for term, order, _ in both]),
        np.array([t.rows @ shapes[: t.rows.shape[1]] for t, _, shapes in both]).astype(complex),
    )


def frf_change(sampler: Sampler, tracked: Tracked, piece: Piece) -> float:
    """Return roughly how much the finer polynomials of a piece change FRFs; 0 without FRFs."""
    tracked = tracked.only(tracked.at(piece.finer.fitted))
    terms = [sampler.at(x).terms for x in tracked.variables.tolist()]
    all_terms = [each for each in terms if each is not None]
    if len(all_terms) < len(terms):
        return 0.0
    near, grid = near_terms(all_terms, tracked), dense(*piece.ends)[::2]

    def through(points: list[float]) -> NearTerms:
        """Return the terms by polynomials through some points."""
        rows = tracked.at(points)
        matrix = interpolation_matrix(tracked.variables[rows], grid)
        return interpolate_terms(matrix, (near[0][rows], near[1][rows], near[2][rows]))

    change = term_change(through(piece.fitted), through(piece.finer.fitted), sampler.response.band)
    return float(change.max())


def term_change(terms: NearTerms, finer: NearTerms, band: tuple[float, float]) -> FloatArray:
    """Return roughly how much finer polynomials change FRFs in a band (Hz) at n angles, (n,).

    A pole that moves by d changes its term by abs(d) / (sqrt(2) w) in the L2 norm, with its
    half-power half-width w.
    """
    (k, c, shapes), (coarse_k, coarse_c, coarse_shapes) = finer, terms
    omega = np.sqrt(k)
    width = c / 2.0 + omega.imag
    moved = np.abs(np.sqrt(coarse_k) - omega + 0.5j * (coarse_c - c)) / (math.sqrt(2.0) * width)
    # The squared L2 norm of a term over the band is pi abs(r)^2 / (4 omega^2 w).
    weight = np.where(omega.real < 2.0 * math.pi * band[1], omega.real**-2 / width, 0.0)
    weight, moved = weight[:, np.newaxis], moved[:, np.newaxis]
    size, change = np.abs(shapes), np.abs(coarse_shapes - shapes)
    inputs = (size**2).swapaxes(1, 2)
    whole = (weight * size**2) @ inputs
    # abs(d(s t)) <= abs(ds) abs(t) + abs(s) abs(dt) for the shapes s and t at two places
    turned = (weight * change**2) @ inputs
    off = turned + turned.swapaxes(1, 2) + (weight * (size * moved) ** 2) @ inputs
    off += 2.0 * (weight * size * change) @ (size * change).swapaxes(1, 2)
    coarse_shapes = np.sqrt(np.diagonal(whole, axis1=1, axis2=2))
    least = SILENT_SHARE**2 * coarse_shapes[:, :, np.newaxis] * coarse_shapes[:, np.newaxis]
    share = off / np.maximum(whole, np.maximum(least, np.finfo(float).tiny))
    return np.asarray(np.sqrt(share.max(axis=(1, 2))))
