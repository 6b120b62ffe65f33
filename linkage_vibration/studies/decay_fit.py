# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Fits decaying oscillations with the same poles to several decays, by least squares.

The amplitudes, which differ between decays and channels, follow from the poles (variable
projection, Golub and Pereyra 1973). Start values come from a matrix pencil (Hua and Sarkar 1990)
and from a search in the residuals; poles that explain no more than noise does are left out.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray

Decays = Sequence[FloatArray]  # (n_samples, n_channels) each

_COLUMNS = 100  # of a pencil; more would take long and change little
_NOISE = 1.2  # medians of the singular values of the pencil: larger ones are not noise alone
_CHANCE = 0.01  # probability that noise alone makes a pole as strong as the faintest that is kept
MOST_DAMPED = 0.5  # damping ratio; beyond it there is hardly an oscillation
_STEP = 0.04  # relative, between frequencies of the search
_SOUGHT = (0.02, 0.08)  # damping ratios of the search
_MOST = 20  # largest number of poles
_SAME_SHAPE = 0.5  # cosine between the squares of channels, above which poles may be of one mode
_STEPS = 30  # largest number of steps of a fit; few are needed
_RANK = 1e-8  # ratio of singular values, below which rounding decides how terms differ
_EXACT = 1e-12  # variance of residuals that are rounding, in the unit of the signals
_CONVERGED = 1e-6  # relative change of the sum of squares


@dataclass(frozen=True, slots=True, eq=False)
class DecayFit:
    """Poles that fit several decays, and how the residuals depend on them.

    The parameters are the real parts of all poles, and then the imaginary parts.
    """

    poles: ComplexArray  # (n_poles,), rad/s, with positive imaginary parts
    squares: float  # sum of the squares of the residuals
    curvatures: FloatArray  # (n_decays, 2 n_poles, 2 n_poles): J^T J of the residuals of each decay
    gradients: FloatArray  # (n_decays, 2 n_poles): -J^T times these residuals


def fit_decays(decays: Decays, rate: float) -> DecayFit:
    """Return the fit with all poles that are stronger than noise; the rate is in Hz."""
    fit = without_faint(decays, refined(decays, _pencil(decays, rate), rate), rate, _CHANCE)
    while len(fit.poles) < _MOST:
        pole = _strongest(decays, fit.poles, rate)
        more = refined(decays, np.append(fit.poles, pole), rate)
        more = without_faint(decays, more, rate, _CHANCE)
        if len(more.poles) <= len(fit.poles):
            break
        fit = more
    return fit


def gains(decays: Decays, fit: DecayFit, rate: float) -> FloatArray:
    """Return what poles take off the squares of decays, in variances, (n_decays, n_poles)."""
    count, lowered = len(fit.poles), []
    for signals, (_, columns) in zip(decays, _bases(decays, fit.poles, rate), strict=True):
        basis, upper = np.linalg.qr(columns)
        inverse = np.linalg.pinv(upper)
        weights = (inverse @ (basis.T @ signals))[: 2 * count].reshape(2, count, -1)
        spread = (inverse @ inverse.T)[: 2 * count, : 2 * count].reshape(2, count, 2, count)
        pairs = np.linalg.pinv(np.moveaxis(spread.diagonal(axis1=1, axis2=3), 2, 0))
        lowered.append(np.einsum("apc,pab,bpc->p", weights, pairs, weights))
    return np.array(lowered) / variance(decays, fit)


def energies(decays: Decays, poles: ComplexArray, rate: float) -> FloatArray:
    """Return the energy of each pole, and what no pole can replace of it, (2, n_poles).

    Only poles that move the channels alike replace one another: others are modes of their own.
    """
    count, each = len(poles), np.zeros((2, len(poles)))
    bases = [columns for _, columns in _bases(decays, poles, rate)]
    weights = [np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(bases, decays, strict=True)]
    pairs = np.array([w[: 2 * count].reshape(2, count, w.shape[1]) for w in weights])
    squares = np.einsum("dapc,dape->pce", pairs, pairs)  # of channels, whose shape a mode shares
    products = np.einsum("pce,qce->pq", squares, squares)
    sizes = np.sqrt(products.diagonal())
    apart = products < _SAME_SHAPE * np.outer(sizes, sizes)
    for columns, own in zip(bases, weights, strict=True):
        for i in range(count):
            pair = [i, count + i]
            part, away = columns[:, pair] @ own[pair], np.flatnonzero(apart[i])
            others = np.delete(columns, [*pair, *away, *(count + away)], axis=1)
            left = part - others @ np.linalg.lstsq(others, part, rcond=None)[0]
            each[:, i] += (part**2).sum(), (left**2).sum()
    return each


def variance(decays: Decays, fit: DecayFit) -> float:
    """Return the variance of the residuals."""
    free = sum(each.size - each.shape[1] * (2 * len(fit.poles) + 1) for each in decays)
    return float(max(fit.squares / max(free - 2 * len(fit.poles), 1), _EXACT))


def without_faint(decays: Decays, fit: DecayFit, rate: float, chance: float) -> DecayFit:
    """Leave out poles that do not oscillate, or that noise makes with more than this chance."""
    least = float(chdtri(2 * sum(each.shape[1] for each in decays) + 2, chance))
    while len(fit.poles):
        strengths = np.where(
            _oscillates(fit.poles), gains(decays, fit, rate).sum(axis=0), -math.inf
        )
        if strengths.min() >= least:
            break
        # Poles that are alike seem faint beside each other, so a third of them goes at a time.
        gone = np.argsort(strengths)[: max(int((strengths < least).sum()) // 3, 1)]
        fit = refined(decays, np.delete(fit.poles, gone), rate)
    return fit


def _oscillates(poles: ComplexArray) -> BoolArray:
    ratios = -poles.real / np.maximum(np.abs(poles), 1e-9)
    return np.asarray((ratios > 0.0) & (ratios < MOST_DAMPED))


def _bases(
    decays: Decays, poles: ComplexArray, rate: float
) -> Iterator[tuple[ComplexArray, FloatArray]]:
    """Yield exp(s t) of each pole at each decay's samples, and its real parts with a constant."""
    terms = np.exp(np.multiply.outer(np.arange(max(map(len, decays))) / rate, poles))
    columns = np.hstack([terms.real, terms.imag, np.ones((len(terms), 1))])
    for each in decays:
        yield terms[: len(each)], columns[: len(each)]


def _evaluated(decays: Decays, poles: ComplexArray, rate: float) -> DecayFit:
    """Return the fit with given poles, with the slopes of Kaufman (1975)."""
    count, squares, curvatures, gradients = len(poles), 0.0, [], []
    for signals, (terms, columns) in zip(decays, _bases(decays, poles, rate), strict=True):
        basis, upper = np.linalg.qr(columns)
        weights = np.linalg.lstsq(upper, basis.T @ signals, rcond=_RANK)[0]
        turned, sizes, _ = np.linalg.svd(upper)
        basis = basis @ turned[:, sizes > _RANK * sizes[0]]
        residuals = signals - basis @ (basis.T @ signals)
        slopes = (np.arange(len(signals))[:, np.newaxis] / rate * terms)[:, :, np.newaxis]
        slopes = slopes * (weights[:count] - 1j * weights[count : 2 * count])
        flat = np.concatenate([slopes.real, -slopes.imag], axis=1).reshape(len(signals), -1)
        flat = flat - basis @ (basis.T @ flat)
        jacobian = np.moveaxis(flat.reshape(len(signals), 2 * count, signals.shape[1]), 1, 2)
        jacobian = jacobian.reshape(signals.size, 2 * count)
        squares += float((residuals**2).sum())
        curvatures.append(jacobian.T @ jacobian)
        gradients.append(jacobian.T @ residuals.ravel())
    return DecayFit(poles, squares, np.array(curvatures), np.array(gradients))


def refined(decays: Decays, poles: ComplexArray, rate: float, free: int | None = None) -> DecayFit:
    """Move the first poles, or all, to the least residuals, by Levenberg and Marquardt's steps."""
    fit, damping = _evaluated(decays, poles, rate), 1e-3
    at = np.arange(2 * len(poles)).reshape(2, -1)[:, :free].ravel()
    for _ in range(_STEPS if len(poles) else 0):
        curvature, step = fit.curvatures.sum(axis=0)[np.ix_(at, at)], np.zeros(2 * len(poles))
        curvature += damping * np.diag(np.diag(curvature))
        step[at] = np.linalg.lstsq(curvature, fit.gradients.sum(axis=0)[at], rcond=None)[0]
        moved = fit.poles + step[: len(poles)] + 1j * step[len(poles) :]
        moved = np.minimum(moved.real, 0.0) + 1j * np.clip(moved.imag, 0.0, math.pi * rate)
        tried = _evaluated(decays, moved, rate)
        better = tried.squares < fit.squares
        done = abs(tried.squares - fit.squares) < _CONVERGED * fit.squares
        fit, damping = (tried, damping / 10.0) if better else (fit, damping * 10.0)
        if done or damping > 1.0 / _CONVERGED:
            break
    return fit


def _pencil(decays: Decays, rate: float) -> ComplexArray:
    """Return the poles of a matrix pencil of all decays and channels."""
    columns = min(*(len(each) // 2 for each in decays), _COLUMNS)
    products = np.zeros((columns, columns))
    for channel in (each for signals in decays for each in (signals - signals.mean(axis=0)).T):
        shifted = np.lib.stride_tricks.sliding_window_view(channel, columns)
        products += shifted.T @ shifted
    squares, vectors = np.linalg.eigh(products)
    kept = vectors[:, squares > _NOISE**2 * np.median(squares)][:, -columns // 2 :]
    turns = np.linalg.eigvals(np.linalg.lstsq(kept[:-1], kept[1:], rcond=None)[0]).astype(complex)
    poles = np.log(turns[np.abs(turns) > 0.0]) * rate
    return np.asarray(poles[(poles.imag > 0.0) & _oscillates(poles)])


def _strongest(decays: Decays, poles: ComplexArray, rate: float) -> complex:
    """Return the pole of a grid that lowers the residuals of a fit most."""
    longest = max(map(len, decays))
    hertz = np.exp(np.arange(math.log(rate / longest / 2.0), math.log(0.5 * rate), _STEP))
    grid = np.concatenate([2.0 * math.pi * hertz * (1j - ratio) for ratio in _SOUGHT])
    tried = [terms for terms, _ in _bases(decays, grid, rate)]
    lower = np.zeros(len(grid))
    for signals, terms, (_, columns) in zip(
        decays, tried, _bases(decays, poles, rate), strict=True
    ):
        basis = np.linalg.qr(columns)[0]
        residuals = signals - basis @ (basis.T @ signals)
        terms = terms - basis @ (basis.T @ terms)
        sizes = (np.abs(terms) ** 2).sum(axis=0)
        lower += (np.abs(terms.T @ residuals) ** 2).sum(axis=1) / np.maximum(sizes, 1e-6)
    return complex(grid[int(lower.argmax())])
