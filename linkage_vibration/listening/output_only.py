# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes from responses alone, by covariance-driven stochastic subspace identification.

If white noise drives a linear system, the covariances of its responses are sums of its decays.
The same noise arriving again later, as from a road under a second axle, adds to the covariances up
to that delay alone; so the identification may begin behind it.
"""

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np
from scipy.special import stdtrit

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.uncertainty import INTERVAL

_ORDERS = range(4, 25, 2)  # numbers of poles that the stability diagram compares
ALIKE = 0.8  # least MAC of two shapes of one mode

_ROWS = 18  # block rows of the Hankel matrix
_BLOCK = 4.0  # s, the shortest block that a jackknife leaves out
_STABLE, _STABLE_RATIO = 0.02, 0.3  # relative changes from an order to the next
_FEWEST_ORDERS = 3  # at which a mode is stable
_LARGEST_RATIO = 0.2  # damping ratio of a mode; beyond it a pole describes the noise
_MOST_LOST = 0.1  # share of the blocks without which a mode may be missing

_Poles = tuple[ComplexArray, ComplexArray]  # of an order, and their shapes
_Result = TypeVar("_Result")
PausableTask = Generator[None, None, _Result]
"""A computation that pauses between its parts, so that something else need not wait for it."""


def finish(steps: PausableTask[_Result]) -> _Result:
    """Return the result of a computation without pauses."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: _Result = end.value
            return result


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A mode that a stability diagram shows."""

    frequency: float  # Hz, undamped
    ratio: float  # damping ratio, 1
    shape: ComplexArray  # (n_channels,), the largest is 1
    frequency_stddev: float  # Hz; 1.96 of it reach to the ends of the 95 % interval
    ratio_stddev: float


def covariances(
    windows: Sequence[FloatArray], first_lag: int, block: int
) -> tuple[FloatArray, FloatArray]:
    """Return sums of products of signals over blocks, and the number of products in each.

    The sums are (n_blocks, 2 `_ROWS`, n_channels, n_channels), for lags from `first_lag` samples
    on; windows, (n, n_channels), have no mean; a block has at least so many samples.
    """
    sums, counts = [], []
    for window in windows:
        longest = first_lag + 2 * _ROWS
        used = len(window) - longest
        parts = max(used // block, 1) if used > 0 else 0
        for start, end in pairwise(np.linspace(0, used, parts + 1).astype(int).tolist()):
            now = window[start:end]
            lags = range(first_lag, longest)
            sums.append([window[start + lag : end + lag].T @ now for lag in lags])
            counts.append(end - start)
    return np.array(sums), np.array(counts, dtype=float)


def poles_and_shapes(covariance: FloatArray, rate: float) -> list[_Poles]:
    """Return the oscillating poles, rad/s, (n,), and shapes, (n_channels, n), of each order.

    The covariances, (2 `_ROWS`, n_channels, n_channels), are one sample apart, at a rate in Hz.
    """
    n = covariance.shape[1]
    at = np.add.outer(np.arange(_ROWS), np.arange(_ROWS))
    hankel = covariance[at].transpose(0, 2, 1, 3).reshape(_ROWS * n, _ROWS * n)
    left = np.linalg.svd(hankel)[0][:, : max(_ORDERS)]  # observability, but for scales of columns
    gram, shifted = left[:-n].T @ left[:-n], left[:-n].T @ left[n:]
    results = []
    for order in _ORDERS:
        step = np.linalg.lstsq(gram[:order, :order], shifted[:order, :order], rcond=None)[0]
        values, vectors = np.linalg.eig(step)
        kept = (values.imag > 0.0) & (np.abs(values) > 0.0)
        shapes = left[:n, :order] @ vectors[:, kept]
        results.append((np.log(values[kept].astype(complex)) * rate, shapes.astype(complex)))
    return results


def identify(
    windows: Sequence[FloatArray], rate: float, band: tuple[float, float], first_lag: int = 1
) -> PausableTask[list[Candidate]]:
    """Return the stable modes within a band, ascending, with deviations of a jackknife.

    It yields between parts. Windows, (n, n_channels), have no gap; noise that recurs within
    ``first_lag`` samples does not bias; blocks, each left out once, outlast the decays.
    """
    scale = np.sqrt(np.mean([(window**2).mean(axis=0) for window in windows], axis=0))
    if not scale.all():  # A channel that shows nothing has no shape.
        return []
    yield
    windows = [window / scale for window in windows]
    sums, counts = covariances(windows, first_lag, round(_BLOCK * rate))
    n = len(counts)
    if n < 4:  # The deviation of fewer blocks says nothing.
        return []
    yield
    diagram = poles_and_shapes(sums.sum(axis=0) / counts.sum(), rate)
    yield
    clusters = stable_poles(diagram, band)
    if not clusters:
        return []
    without = []
    for i in range(n):
        yield
        rest = (sums.sum(axis=0) - sums[i]) / (counts.sum() - counts[i])
        without.append(poles_and_shapes(rest, rate))
    candidates = []
    for cluster in clusters:
        yield
        candidate = _candidate(cluster, diagram, without, scale)
        candidates += [candidate] if candidate else []
    return sorted(candidates, key=lambda each: each.frequency)


def _candidate(
    cluster: Sequence[tuple[int, int]],
    diagram: Sequence[_Poles],
    without: Sequence[Sequence[_Poles]],
    scale: FloatArray,
) -> Candidate | None:
    """Return the mode of a pole, None if too few blocks show it; scales are (n_channels,)."""
    ratios = []
    for order, k in cluster:
        pole, shape = diagram[order][0][k], diagram[order][1][:, k]
        ratios.append([nearest(pole, shape, *each[order]) / pole for each in without])
    # A pole that is missing in one order says nothing there; the median of the others counts.
    shown = np.isfinite(ratios).any(axis=0)
    pole = _median(np.array([diagram[order][0][k] for order, k in cluster]))
    estimates = pole * _median(np.array(ratios)[:, shown])
    if len(estimates) < max((1.0 - _MOST_LOST) * len(without), 4):
        return None
    factor = float(stdtrit(len(estimates) - 1, 0.975)) / INTERVAL
    factor *= math.sqrt(len(estimates) - 1.0)
    frequency, ratio = (float(each) for each in _values(pole))
    order, k = cluster[len(cluster) // 2]
    shape = diagram[order][1][:, k] * scale
    shape = shape / shape[np.abs(shape).argmax()]
    stddevs = (factor * float(each.std()) for each in _values(estimates))
    return Candidate(frequency, ratio, shape, *stddevs)


def _median(values: ComplexArray) -> ComplexArray:
    """Return medians of the real and of the imaginary parts along the first axis."""
    return np.asarray(np.nanmedian(values.real, axis=0) + 1j * np.nanmedian(values.imag, axis=0))


def _values(poles: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Return natural frequencies, Hz, and damping ratios of poles."""
    size = np.abs(poles)
    return size / (2.0 * math.pi), -poles.real / size


def mac(shape: ComplexArray, shapes: ComplexArray) -> FloatArray:
    """Return the modal assurance criteria of a shape, (n,), with others, (n, n_shapes)."""
    size = (np.abs(shape) ** 2).sum() * (np.abs(shapes) ** 2).sum(axis=0)
    return np.asarray(np.abs(shape.conj() @ shapes) ** 2 / np.maximum(size, 1e-300))


def nearest(
    pole: complex, shape: ComplexArray, poles: ComplexArray, shapes: ComplexArray
) -> complex:
    """Return the nearest of poles that has a shape alike and is within 20 %, or NaN."""
    away = np.abs(poles / pole - 1.0) + (mac(shape, shapes) < ALIKE)
    i = int(away.argmin()) if len(away) else 0
    return complex(poles[i]) if len(away) and away[i] < 0.2 else complex(math.nan)


def stable_poles(
    diagram: Sequence[_Poles], band: tuple[float, float]
) -> list[list[tuple[int, int]]]:
    """Return chains of poles that hardly change, as indices of an order and of a pole in it."""
    chains: list[list[tuple[int, int]]] = []
    for i, (poles, shapes) in enumerate(diagram):
        frequencies, ratios = _values(poles)
        for k in range(len(poles)):
            inside = band[0] <= frequencies[k] <= band[1] and 0.0 < ratios[k] < _LARGEST_RATIO
            if not inside:
                continue
            fits = []
            for chain in chains:
                before, at = chain[-1]
                if before not in (i - 1, i - 2):
                    continue
                frequency, ratio = (each[at] for each in _values(diagram[before][0]))
                away = abs(frequencies[k] / frequency - 1.0)
                alike = mac(diagram[before][1][:, at], shapes[:, [k]])[0] > ALIKE
                steady = abs(ratios[k] / ratio - 1.0) < _STABLE_RATIO
                if away < _STABLE and steady and alike:
                    fits.append((away, chain))
            if fits:
                min(fits, key=lambda fit: fit[0])[1].append((i, k))
            else:
                chains.append([(i, k)])
    return [chain for chain in chains if len(chain) >= _FEWEST_ORDERS]
