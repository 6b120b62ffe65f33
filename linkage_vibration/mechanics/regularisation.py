# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measured FRFs: the effect of their noise on a coupling, and how to reduce it.

A free link moves far more as a rigid body than it deforms, so noise of 0.1 % in its receptances is
larger than its flexibility, on which the coupled modes depend. Truncating the singular values of
the interface flexibility B H B^T, or damping them (Tikhonov), does not help: the small ones are the
stiff directions of the joints, and without them joints open.

Instead, the rigid motions are known beforehand. Rigid motions R of the points do no work with
forces in equilibrium, N^T R = 0, so H N is the flexibility alone: a smooth function of a few poles
and residual terms. It is fitted over all lines, with as many terms as are above the noise. The
rigid block, in which noise is as harmless as an equal error of the mass, stays as measured.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, solve_stack, symmetric
from linkage_vibration.mechanics.dofs import Dofs, InterfaceDof
from linkage_vibration.mechanics.link_fit import LinkFit, fit_link

_LEAST_LINES = 30
_SYSTEMATIC = 0.03  # largest systematic share, root mean square over lines, of a free link


class RegularisationError(LinkageVibrationError):
    """Measured FRFs contradict one another, or are not those of a free body."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredFrfs:
    """Receptances with the remaining noise, which is independent from line to line.

    With noise N of the measurement and E = K (N + N^T) / 2 K^T, the error is E plus that of a fit,
    whose variance is the leverage times that of (N + N^T) / 2 - E.
    """

    frf: ComplexArray  # (n_freq, n, n), m/N between displacements
    kept: FloatArray  # (n, n): K, the identity for FRFs that are as measured
    leverage: FloatArray  # (n_freq,): from 0 to 1


Blocks = Sequence[ComplexArray | MeasuredFrfs]
"""The FRFs of components, measured or not, (n_freq, n_r, n_r) each."""


@dataclass(frozen=True, slots=True, eq=False)
class RegularisedFrfs(MeasuredFrfs):
    """Receptances whose elastic part is fitted, and the fit of the whole."""

    fit: LinkFit


def receptances(blocks: Blocks) -> list[ComplexArray]:
    """Return the FRFs of components, measured or not, (n_freq, n_r, n_r) each."""
    return [block.frf if isinstance(block, MeasuredFrfs) else block for block in blocks]


def rigid_motions(
    dofs: Sequence[InterfaceDof], points: Sequence[tuple[str, tuple[float, float]]]
) -> FloatArray:
    """Return how DoFs move with a rigid body by x, z and theta, (n, 3); points in m."""
    places = dict(points)
    rows = []
    for dof in dofs:
        x, z = places[dof.point]
        by_direction = {"x": [1.0, 0.0, -z], "z": [0.0, 1.0, x], "theta": [0.0, 0.0, 1.0]}
        rows.append(by_direction[dof.direction])
    return np.array(rows)


def noise_level(frequencies: FloatArray, frf: ComplexArray) -> float:
    """Estimate the relative noise of receptances, (n_freq, n, n), by third differences of lines."""
    accelerance = np.asarray(frequencies)[:, np.newaxis, np.newaxis] ** 2 * frf
    steps = np.median(np.abs(np.diff(accelerance, n=3, axis=0)), axis=0)
    size = np.median(np.abs(accelerance), axis=0)
    drive = np.diag(size)
    felt = size > 1e-3 * np.sqrt(np.outer(drive, drive))  # others may be only rounding
    # Noise s has differences of sqrt(20) s, and the median of its modulus is sqrt(ln 2) s.
    return float(np.median(steps[felt] / size[felt]) / math.sqrt(20.0 * math.log(2.0)))


def regularise(
    dofs: Dofs, frequencies: FloatArray, frf: ComplexArray, motions: FloatArray
) -> RegularisedFrfs:
    """Fit the elastic part of the receptances, (n_freq, n, n), of a free body by `fit_link`.

    Lines are weighted by the inverse of their size; computed FRFs stay within rounding. `motions`,
    (n, k), are `rigid_motions`. FRFs that depart by more than noise and 3 % are refused.
    """
    omega = 2.0 * math.pi * np.asarray(frequencies, dtype=float)
    if len(omega) < _LEAST_LINES:
        problem = f"{len(omega)} lines above 0 Hz are too few to tell deformation from noise"
        raise RegularisationError(f"{problem}; measure at least {_LEAST_LINES}.")
    square = omega[:, np.newaxis, np.newaxis] ** 2
    drive = np.einsum("kii->ki", np.abs(square * frf))
    unit = np.sqrt(np.median(drive, axis=0))  # normalises DoFs of any unit
    raw = frf / np.outer(unit, unit)
    rigid = scipy.linalg.orth(motions / unit[:, np.newaxis])
    fit = fit_link(omega, frf, unit, rigid)
    kept = fit.rigid
    fitted = kept @ fit.lines @ kept + fit.elastic.at_lines()
    _check_consistent(dofs, raw - fitted, fitted)
    kept = unit[:, np.newaxis] * kept / unit[np.newaxis]
    return RegularisedFrfs(fitted * np.outer(unit, unit), kept, fit.elastic.leverage, fit)


def _check_consistent(dofs: Dofs, rest: ComplexArray, fitted: ComplexArray) -> None:
    """Refuse FRFs if the rest of a fit is smooth over the lines, by von Neumann's ratio (1941)."""
    size = np.sqrt((np.abs(fitted) ** 2).mean(axis=(1, 2), keepdims=True))
    relative = rest / size
    noise = (np.abs(np.diff(relative, axis=0)) ** 2).mean(axis=0) / 2.0
    smooth = (np.abs(relative) ** 2).mean(axis=0) - noise
    i, j = divmod(int(smooth.argmax()), len(dofs))
    share = math.sqrt(max(float(smooth[i, j]), 0.0))
    if share > max(_SYSTEMATIC, math.sqrt(float(noise[i, j]))):
        raise RegularisationError(
            f"The FRF of response {dofs[i]} to a force at {dofs[j]} differs by "
            f"{100.0 * share:.0f} % from that of one free body with the same poles everywhere, "
            "which noise does not explain; check for a pole that drifted, a sensor of wrong gain, "
            "sign or place, FRFs that are not reciprocal, a held body, or lines too far apart."
        )


def noise_gain(
    blocks: Blocks,
    compatibility: FloatArray,
    outputs: FloatArray,
    inputs: FloatArray,
    compliance: FloatArray | ComplexArray | float = 0.0,
) -> FloatArray:
    """Return the relative error of coupled FRFs, (n_freq, n_out, n_in), per that of measured ones.

    H_c changes by T dH U, T = O - O H B^T Z B, U = I^T - B^T Z B H I^T, Z = (B H B^T + S)^-1.
    Errors dH are independent with e abs(H_kl); poles of a fit and blocks that are arrays are exact.
    """
    frfs = receptances(blocks)
    ends = np.cumsum([0, *(each.shape[1] for each in frfs)])
    every = [slice(*pair) for pair in pairwise(ends.tolist())]
    frf: ComplexArray = np.zeros((len(frfs[0]), ends[-1], ends[-1]), np.complex128)
    for dofs, values in zip(every, frfs, strict=True):
        frf[:, dofs, dofs] = values
    interface = compatibility @ frf @ compatibility.T
    diagonal = np.arange(len(compatibility))
    interface[:, diagonal, diagonal] += compliance
    joints = solve_stack(interface, compatibility.astype(complex))  # Z B
    away = outputs - outputs @ frf @ compatibility.T @ joints
    into = inputs.T - joints.swapaxes(1, 2) @ (compatibility @ frf @ inputs.T)
    coupled = np.abs(outputs @ frf @ into)
    power = np.zeros(coupled.shape)
    for block, values, dofs in zip(blocks, frfs, every, strict=True):
        if not isinstance(block, MeasuredFrfs):
            continue
        for i, j in np.ndindex(*coupled.shape[1:]):
            left, right = away[:, i, dofs], into[:, dofs, j]
            kept = _even(left @ block.kept, right @ block.kept)
            rest = np.abs(_even(left, right) - kept) ** 2
            fitted = block.leverage[:, np.newaxis, np.newaxis] * rest
            power[:, i, j] += ((np.abs(kept) ** 2 + fitted) * np.abs(values) ** 2).sum(axis=(1, 2))
    # A response of zero has no relative error.
    return np.asarray(np.sqrt(power) / np.where(coupled > 0.0, coupled, np.inf))


def _even(left: ComplexArray, right: ComplexArray) -> ComplexArray:
    """Return the symmetric part of the product of two vectors at each line, (n_freq, n, n)."""
    return symmetric(left[:, :, np.newaxis] * right[:, np.newaxis, :])
