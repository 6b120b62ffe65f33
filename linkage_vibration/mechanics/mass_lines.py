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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, symmetric
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.regularisation import rigid_motions

_RATIO = 2.5  # least ratio of the last line to the first, so that no resonance hides below them
_LEAST_LINES = 6
_START_STEP, _END_STEP = 1.3, 1.6
_SMOOTH = 0.02  # largest misfit that noise does not explain, as a share of A
_BEND = 0.7  # largest departure from A within the lines, as a share of A
_LAG = 0.5  # largest imaginary part, as a share of A
_DOUBT = 0.1  # largest standard deviation of A, as a share of A
_NEAR = 2.0  # The most precise window is chosen among those that begin up to this factor higher.


@dataclass(frozen=True, slots=True, eq=False)
class MassLines:
    """The terms of the FRFs of a free body in lines below its first resonance."""

    first: float  # Hz, of these lines
    last: float  # Hz
    accelerance: FloatArray  # (n, n): A, 1/kg between displacements


def find_mass_lines(frequencies: FloatArray, frf: ComplexArray) -> MassLines | None:
    """Find the lines below the first resonance of a body that show A best, or None."""
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
    first, last = frequencies[[lines.start, lines.stop - 1]].tolist()
    return MassLines(first, last, values[0].real.reshape(frf.shape[1:]))


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
    """Fit 1, w^2, 1 / w^2 and w^4; return factors, deviations of their real parts, and the rest."""
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


def shown_mass(
    dofs: Sequence[InterfaceDof], lines: MassLines, points: Mapping[str, tuple[float, float]]
) -> tuple[float, float] | None:
    """Return the mass (kg) of a planar body with this A, and the largest misfit; or None."""
    used = [i for i, dof in enumerate(dofs) if dof.direction != "y" and dof.point in points]
    planar = [dofs[i] for i in used]
    if len(planar) < 3 or not {"x", "z"} <= {dof.direction for dof in planar}:
        return None
    accelerance = lines.accelerance[np.ix_(used, used)]
    unit = np.sqrt(np.diag(accelerance))
    scaled = symmetric(accelerance) / np.outer(unit, unit)
    r = rigid_motions(planar, list(points.items())) / unit[:, np.newaxis]
    inverse = np.linalg.pinv(r)
    free = inverse @ scaled @ inverse.T  # M^-1, if it may be any symmetric matrix
    turned = float(free[2, 2])  # 1 / J
    arm = np.append(free[:2, 2] / turned, 1.0)
    moved = float(np.trace(free[:2, :2]) - turned * (arm[:2] @ arm[:2])) / 2.0  # 1 / m
    if not min(moved, turned) > 0.0:
        return math.nan, math.inf
    fitted = moved * (r[:, :2] @ r[:, :2].T) + turned * np.outer(r @ arm, r @ arm)
    return 1.0 / moved, float(np.abs(fitted - scaled).max())
