# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the node computes at the angles of the generated test, and how far C may be from it."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from linkage_vibration.export.constants import FARTHEST, Constants
from linkage_vibration.export.exported import Export
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.predictor import Predictor, predict_many
from linkage_vibration.table.interpolation import angles_in_table

PER_MODE = (
    "natural_frequencies",
    "frequency_stddevs",
    "damping_ratios",
    "damping_ratio_stddevs",
    "frequency_slopes",
)
NUMBERS = (*PER_MODE, "frf_peak_frequency", "frf_peak_magnitude", "interpolation_error")
"""The numbers of a prediction beside the status, in their order in C."""

LEVELS = (
    "velocities",
    "accelerations",
    "amplifications",
    "total_velocity",
    "total_acceleration",
    "load_ratios",
    "total_load_ratio",
)
"""Numbers about excitations that the node has in single precision, in their order in C."""

_TESTED = 1000  # angles of the generated test
_ASSESSED = 200  # of them those with excitations
_HIGHEST_SPEEDS = 3000.0, 1200.0, 12.0  # rpm and m/s, of that test
_SEED = 2
_ROUNDING, _MESSAGE = 1e-12, 1e-6  # of numbers with equal cells, and of those in messages
_FORCES = 0.03  # of the largest load ratio, whose numbers have errors of 1 %


class Comparison(NamedTuple):
    """Numbers to compare, (n, width), and the largest difference that is allowed, (width,)."""

    given: FloatArray
    numbers: FloatArray
    allowed: FloatArray


def expected_predictions(export: Export) -> tuple[Comparison, list[int]]:
    """Return the node's predictions with their statuses; given are angles and deviations, rad."""
    angles = angles_to_test(export.constants)
    angles = angles[comparable(export, angles)]
    given = np.stack([angles, np.where(np.arange(len(angles)) % 2, 1e-3, 0.0)], axis=1)
    node = predict_many(Predictor(export.table), *given.T)
    parts = [(getattr(node, name), _ROUNDING) for name in NUMBERS]
    return Comparison(given, *_columns(parts)), node.status.tolist()


def expected_levels(export: Export, angles: FloatArray) -> Comparison:
    """Return the node's levels at some of the angles in the table.

    Given are angles, rad, and the speeds of engine, PTO and ground.
    """
    assert export.levels is not None
    assert export.constants.orders is not None
    orders, levels = export.constants.orders, export.levels
    low, high = export.constants.alpha3_range
    angles = angles[(angles >= low) & (angles <= high)][-_ASSESSED:]
    speeds = np.random.default_rng(_SEED).uniform(0.0, _HIGHEST_SPEEDS, (len(angles), 3))
    speeds[::7], speeds[::11, 1] = 0.0, math.nan
    sources = [list(Source).index(excitation.source) for excitation in orders.excitations]
    ratios = np.array([excitation.ratio for excitation in orders.excitations])
    frequency = speeds[:, sources] * ratios
    natural = export.table.evaluate(angles)[:, : export.table.n_modes]
    apart = np.abs(frequency[..., np.newaxis] / natural[:, np.newaxis] - 1.0)
    apart = np.where(levels.excites, apart, math.nan)
    node = levels.at(angles, speeds.T)
    parts = [(frequency, _MESSAGE), (np.fmin.reduce(apart, axis=2), _MESSAGE)]
    parts += [(getattr(node, name), _MESSAGE + _FORCES * ("ratio" in name)) for name in LEVELS]
    return Comparison(np.column_stack([angles, speeds]), *_columns(parts))


def _columns(parts: Sequence[tuple[FloatArray, float]]) -> tuple[FloatArray, FloatArray]:
    """Return numbers side by side, and what is allowed: a share of the largest of each kind."""
    columns, allowed = [], []
    for values, share in parts:
        rows = np.column_stack([values.astype(float)])
        largest = np.fmax.reduce(np.abs(rows), axis=None, initial=0.0)
        columns.append(rows)
        allowed += [float(share * largest)] * rows.shape[1]
    return np.hstack(columns), np.array(allowed)


def comparable(export: Export, angles: FloatArray) -> BoolArray:
    """Return at which angles, (n,), C must agree with the node: neither in gaps nor too far."""
    position = angles_in_table(angles, export.table.alpha3_range)
    position = np.where(np.isnan(position), angles, position)
    good = ~(np.isfinite(angles) & (np.abs(angles) >= FARTHEST))
    for start, end in export.constants.gaps:
        good &= ~((start <= position) & (position < end))
    return np.asarray(good)


def angles_to_test(constants: Constants, count: int = _TESTED) -> FloatArray:
    """Return angles in and around the range, with its ends, borders of cells, NaN and infinity.

    There are at least 20.
    """
    low, high = constants.alpha3_range
    special = [math.nan, math.inf, -math.inf, 0.0, -low, high + 2.0 * math.pi]
    special += [low - 20.0 * math.pi, 1e5, 1e30]
    special += [0.7 * low + 0.3 * high + turns * 2.0 * math.pi for turns in (-2, -1, 1, 2)]
    cells = constants.starts[:: max(1, 4 * len(constants.starts) // count)]
    at = np.array([low, high, *cells.tolist()])
    ends = np.nextafter(at, -math.inf), at, [np.nextafter(high, math.inf)]
    chosen = np.concatenate([special, *ends])[:count]
    random = np.random.default_rng(_SEED)
    rest = count - len(chosen)
    inside = random.uniform(low, high, rest)
    far = random.uniform(-FARTHEST, FARTHEST, rest)
    return np.concatenate([chosen, np.where(np.arange(rest) % 10 == 0, far, inside)])
