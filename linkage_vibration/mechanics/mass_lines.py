# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the lines below the first resonance of a free body show: its mass, and the signs of FRFs.

There H = -A / w^2 + F + terms of the suspension (1 / w^4) and of the next order (w^2), with the
flexibility F of the body and A = R M^-1 R^T, where R are the rigid motions of its points. A is
positive semi-definite. For a planar body with the mass m, the moment of inertia J about its centre
of gravity, and the arms t of the forces about it, A = d d^T / m + t t^T / J, where d are the
directions of the forces: four numbers describe every FRF.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, symmetric

_RATIO = 2.5  # least ratio of the last line to the first, so that no resonance hides below them
_LEAST_LINES = 6
_START_STEP, _END_STEP = 1.3, 1.6
_SMOOTH = 0.02  # largest misfit that noise does not explain, as a share of A
_BEND = 0.7  # largest departure from A within the lines, as a share of A
_LAG = 0.5  # largest imaginary part, as a share of A
_DOUBT = 0.1  # largest standard deviation of A, as a share of A
_NEAR = 2.0  # The most precise window is chosen among those that begin up to this factor higher.
_LARGEST = 200.0  # largest logarithm of a number whose square is finite


@dataclass(frozen=True, slots=True, eq=False)
class MassLines:
    """The terms of the FRFs of a free body in lines below its first resonance."""

    first: float  # Hz, of these lines
    last: float  # Hz
    accelerance: FloatArray  # (n, n): A, 1/kg between displacements


@dataclass(frozen=True, slots=True)
class RigidFit:
    """The planar rigid body that is nearest to an accelerance."""

    misfit: float  # largest difference of A_ij, of sqrt(A_ii A_jj)
    mass: float  # kg


def find_mass_lines(frequencies: FloatArray, frf: ComplexArray) -> MassLines | None:
    """Find the lines in which a body moves almost as a rigid one, or None.

    They end below its first resonance, and begin above those of its suspension, if it has any.
    Those are chosen that show A best. Receptances are (n_freq, n, n); frequencies ascend from above
    0 Hz.
    """
    omega = 2.0 * math.pi * frequencies
    drive = -(omega[:, np.newaxis] ** 2) * np.einsum("kii->ki", frf)
    windows: list[tuple[float, slice]] = []
    for lines in _windows(frequencies):
        if windows and frequencies[lines.start] > _NEAR * frequencies[windows[0][1].start]:
            break
        doubt = _doubt(omega[lines], drive[lines])
        if doubt is not None:
            windows.append((doubt, lines))
    if not windows:
        return None
    lines = min(windows, key=lambda window: window[0])[1]
    terms = -(omega[lines, np.newaxis, np.newaxis] ** 2) * frf[lines]
    values = _expand(omega[lines], terms.reshape(len(terms), -1))[0]
    return MassLines(
        float(frequencies[lines.start]),
        float(frequencies[lines.stop - 1]),
        values[0].real.reshape(frf.shape[1:]),
    )


def _windows(frequencies: FloatArray) -> Iterator[slice]:
    """Return ranges of lines, those that begin lowest first."""
    start = float(frequencies[0])
    while start * _RATIO <= frequencies[-1]:
        end = start * _RATIO
        while end <= frequencies[-1]:
            first, last = np.searchsorted(frequencies, [start * (1 - 1e-9), end * (1 + 1e-9)])
            if last - first >= _LEAST_LINES:
                yield slice(int(first), int(last))
            end *= _END_STEP
        start *= _START_STEP


def _expand(
    omega: FloatArray, values: ComplexArray
) -> tuple[ComplexArray, FloatArray, ComplexArray]:
    """Fit terms in 1, w^2, 1 / w^2 and w^4.

    It returns them, the standard deviations of their real parts, and the rest of the values.
    """
    x = omega / math.sqrt(omega[0] * omega[-1])
    terms = np.stack([np.ones_like(x), x**2, x**-2.0, x**4][: 4 if len(x) >= 16 else 3], axis=1)
    basis, upper = np.linalg.qr(terms)
    inverse = np.linalg.inv(upper)
    coefficients = inverse @ (basis.T @ values)
    rest = values - terms @ coefficients
    power = (rest.real**2).sum(axis=0) / (len(x) - terms.shape[1])
    deviations = np.sqrt((inverse**2).sum(axis=1)[:, np.newaxis] * power)
    return coefficients, deviations, rest


def _doubt(omega: FloatArray, drive: ComplexArray) -> float | None:
    """Return the relative error of A from drive points, (n_freq, n); None if they show no A."""
    coefficients, deviations, rest = _expand(omega, drive)
    size = np.maximum(np.abs(coefficients[0].real), np.finfo(float).tiny)
    noise = (np.abs(np.diff(rest, axis=0)) ** 2).mean(axis=0) / 2.0
    smooth = np.sqrt(np.maximum((np.abs(rest) ** 2).mean(axis=0) - noise, 0.0)) / size
    fitted = drive - rest
    bend = np.abs(fitted.real - coefficients[0].real).max(axis=0) / size
    lag = np.abs(fitted.imag).max(axis=0) / size
    spread = deviations[0] / size
    for values, limit in ((smooth, _SMOOTH), (bend, _BEND), (lag, _LAG), (spread, _DOUBT)):
        if not (values <= limit).all():
            return None
    return float((spread + smooth).max())


def fit_rigid_body(accelerance: FloatArray, motions: FloatArray) -> RigidFit:
    """Fit the mass, the moment of inertia and the centre of gravity of a planar body to A, (n, n).

    `motions`, (n, 3), are the rigid motions of its DoFs along x, z and about y.
    """
    unit = np.sqrt(np.diag(accelerance))
    scaled = symmetric(accelerance) / np.outer(unit, unit)
    r = motions / unit[:, np.newaxis]
    length = float(np.abs(motions[:, 2]).max()) or 1.0
    upper = np.triu_indices(len(r))

    def misfit(unknowns: FloatArray) -> FloatArray:
        arms = r @ np.array([unknowns[2] * length, -unknowns[1] * length, 1.0])
        moved, turned = np.exp(np.minimum(unknowns[[0, 3]], _LARGEST))
        fitted = moved * (r[:, :2] @ r[:, :2].T) + turned * np.outer(arms, arms)
        return np.asarray((fitted - scaled)[upper])

    starts = _starts(scaled, r, motions, length)
    fits = [least_squares(misfit, start, max_nfev=60) for start in starts]
    best = min(fits, key=lambda fit: float(fit.cost))
    return RigidFit(float(np.abs(best.fun).max()), math.exp(-best.x[0]))


def _starts(
    scaled: FloatArray, r: FloatArray, motions: FloatArray, length: float
) -> Iterator[list[float]]:
    """Return first guesses of log(1 / m), the centre of gravity over the length, and log(1 / J)."""
    inverse = np.linalg.pinv(r)
    free = inverse @ scaled @ inverse.T  # M^-1, if it may be any symmetric matrix
    compliance = max(float(np.trace(free[:2, :2])) / 4.0, 1e-12)
    middle = float(motions[motions[:, 1] != 0.0, 2].mean()) / length
    yield [math.log(compliance), middle, 0.0, math.log(6.0 * compliance / length**2)]
    turn = float(free[2, 2])
    if turn > 0.0:
        moved = (np.trace(free[:2, :2]) - free[:2, 2] @ free[:2, 2] / turn) / 2.0
        x, z = -free[1, 2] / turn / length, free[0, 2] / turn / length
        yield [math.log(max(moved, 1e-3 * compliance)), x, z, math.log(turn)]
