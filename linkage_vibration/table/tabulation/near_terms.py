# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The terms of FRFs that belong to tracked modes, and how much finer polynomials change them."""

import math
from collections.abc import Sequence

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.table.interpolation import NearTerms
from linkage_vibration.table.tabulation.frf_errors import worst_share
from linkage_vibration.table.tabulation.sampling import Terms
from linkage_vibration.table.tabulation.tracking import Tracked


def near_terms(terms: Sequence[Terms], tracked: Tracked) -> NearTerms:
    """Return the terms of the tracked modes at n samples, from the terms of all modes there."""
    both = list(zip(terms, tracked.orders, tracked.shapes, strict=True))
    return (
        np.array([term.damped.stiffness[order] for term, order, _ in both]),
        np.array([term.damped.decay[order] for term, order, _ in both]),
        np.array([t.rows @ shapes[: t.rows.shape[1]] for t, _, shapes in both]).astype(complex),
    )


def term_change(
    terms: NearTerms, finer: NearTerms, band: tuple[float, float], n_inputs: int
) -> FloatArray:
    """Return roughly how much finer polynomials change FRFs in a band (Hz) at n angles, (2, n).

    The first row is of displacements, the second of displacements and forces.

    A pole that moves by d changes its term by abs(d) / (sqrt(2) w) in the L2 norm, with its
    half-power half-width w. The first so many rows of the shapes are inputs, too.
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
