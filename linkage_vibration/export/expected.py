# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the node computes at the angles of the generated test, and how far C may be from it."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from linkage_vibration.export.constants import ROW_ERROR, BoolArray, Constants
from linkage_vibration.export.cubics import FloatArray, Reals
from linkage_vibration.export.exported import Export
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.predictor import Predictor, angles_in_table, predict_many
from linkage_vibration.table.table import Table, widened

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
_NEAR = 1e-5  # rad: how far single precision may move a border
_FORCES = 0.03  # of the largest load ratio, whose numbers have errors of 1 %


class Comparison(NamedTuple):
    """Numbers to compare, (n, width), and the largest difference that is allowed, (width,)."""

    given: Reals
    numbers: FloatArray
    allowed: FloatArray


def expected_predictions(export: Export) -> tuple[Comparison, list[int]]:
    """Return the node's predictions with their statuses; given are angles and deviations, rad."""
    errors, angles = export.errors, angles_to_test(export.constants)
    angles = angles[comparable(export, angles)]
    stddev = np.where(np.arange(len(angles)) % 2, 1e-3, 0.0).astype(angles.dtype)
    given = np.stack([angles, stddev], axis=1)
    node = predict_many(Predictor(export.table), *given.T.astype(float))
    # The error of an export is added to that of the table, and is a part of standard deviations.
    added = max(errors.frequency, errors.damping_ratio)
    spread = 2.0 * (ROW_ERROR + errors.slope) if added else 0.0
    largest = (2.0 * float(np.nanmax(x)) for x in (node.natural_frequencies, node.damping_ratios))
    of_frequency, of_ratio = (added * each for each in largest)
    parts = [
        (node.natural_frequencies, errors.frequency, 0.0),
        (node.frequency_stddevs, spread, of_frequency),
        (node.damping_ratios, errors.damping_ratio, 0.0),
        (node.damping_ratio_stddevs, spread, of_ratio),
        (node.frequency_slopes, errors.slope, 0.0),
        (node.frf_peak_frequency, errors.peak, 0.0),
        (node.frf_peak_magnitude, errors.peak, 0.0),
        (node.interpolation_error + added, _MESSAGE if added else 0.0, 0.0),
    ]
    return Comparison(given, *_columns(parts, _ROUNDING)), node.status.tolist()


def expected_levels(export: Export, angles: Reals) -> Comparison:
    """Return the node's levels at some of the angles in the table.

    Given are angles, rad, and the speeds of engine, PTO and ground.
    """
    assert export.levels is not None
    assert export.constants.orders is not None
    orders, errors, levels = export.constants.orders, export.errors, export.levels
    low, high = export.constants.alpha3_range
    angles = angles[(angles >= low) & (angles <= high)][-_ASSESSED:]
    speeds = np.random.default_rng(_SEED).uniform(0.0, _HIGHEST_SPEEDS, (len(angles), 3))
    speeds[::7], speeds[::11, 1] = 0.0, math.nan
    given = np.column_stack([angles, speeds]).astype(angles.dtype)
    node_angles, *node_speeds = given.T.astype(float)
    sources = [list(Source).index(excitation.source) for excitation in orders.excitations]
    ratios = np.array([excitation.ratio for excitation in orders.excitations])
    frequency = np.transpose(node_speeds)[:, sources] * ratios
    natural = export.table.evaluate(node_angles)[:, : export.table.n_modes]
    apart = np.abs(frequency[..., np.newaxis] / natural[:, np.newaxis] - 1.0)
    node = levels.at(node_angles, np.array(node_speeds))
    of_force = _FORCES if orders.forces else 0.0
    parts = [(frequency, 0.0, 0.0), (np.fmin.reduce(apart, axis=2), 2.0 * errors.frequency, 0.0)]
    parts += [
        (getattr(node, name), 2.0 * errors.response + of_force * ("ratio" in name), 0.0)
        for name in LEVELS
    ]
    return Comparison(given, *_columns(parts, _MESSAGE))


def _columns(
    parts: Sequence[tuple[Reals, float, float]], least: float
) -> tuple[FloatArray, FloatArray]:
    """Return numbers side by side, and what is allowed: a share of the largest, and an addition.

    The least share is that by rounding.
    """
    columns, allowed = [], []
    for values, share, addition in parts:
        rows = np.column_stack([values.astype(float)])
        largest = np.fmax.reduce(np.abs(rows), axis=None, initial=0.0)
        columns.append(rows)
        allowed += [float((least + share) * largest + addition)] * rows.shape[1]
    return np.hstack(columns), np.array(allowed)


def comparable(export: Export, angles: Reals) -> BoolArray:
    """Return at which angles, (n,), C must agree with the node.

    Left out are gaps; angles that single precision may move over a border; and those at which
    another peak may be the highest one within its error.
    """
    table, constants, exact = export.table, export.constants, angles.astype(float)
    with np.errstate(invalid="ignore"):
        position = angles_in_table(exact, table.alpha3_range)
    inside = ~np.isnan(position)
    position = np.where(inside, position, exact)
    good = ~(np.isfinite(exact) & (np.abs(exact) >= constants.farthest))
    near = _NEAR if angles.dtype == np.float32 else 0.0
    for start, end in constants.gaps:
        good &= ~((start - near <= position) & (position < end + near))
    if near:
        borders = np.hstack([table.cells.arrays[0], constants.alpha3_range, constants.sound_range])
        good &= ~(np.abs(position[:, np.newaxis] - borders) <= near).any(axis=1)
    if export.errors.peak:
        good[inside] &= _clear_peak(table, position[inside], export.errors.peak)
    return np.asarray(good)


def _clear_peak(table: Table, alpha3: FloatArray, error: float) -> BoolArray:
    """Return at which angles one peak in the band is the highest, also if all have errors."""
    at, size = np.split(table.cells.many_values(alpha3)[:, 2 * table.n_modes :].T, 2)
    (low, high), margin = widened(table.peak_band), 1.0 + 3.0 * error
    may_count = (at * margin >= low) & (at <= high * margin)
    ends = np.isclose(at, low, atol=_MESSAGE) | np.isclose(at, high)  # these do not move
    counts = ends | ((at >= low * margin) & (at * margin <= high))
    heights = np.where(may_count, size, 0.0)
    clear = (size * margin >= heights.max(axis=0)) & may_count
    return np.asarray((clear.sum(axis=0) == 1) & (clear & counts).any(axis=0))


def angles_to_test(constants: Constants, count: int = _TESTED) -> Reals:
    """Return angles in and around the range, with its ends, borders of cells, NaN and infinity.

    There are at least 20. Single precision moves borders, so its angles are a little beside them.
    """
    kind = constants.starts.dtype
    low, high = constants.alpha3_range
    apart = 2.0 * _NEAR if kind == np.float32 else 0.0
    special = [math.nan, math.inf, -math.inf, 0.0, -low, high + 2.0 * math.pi]
    special += [low - 20.0 * math.pi, 1e5, 1e30]
    cells = constants.starts[:: max(1, 4 * len(constants.starts) // count)]
    at = np.array([low, high, *cells.tolist()])
    sides = [at - apart, at + apart, [high + apart]]
    below, above, beyond = (np.asarray(side, kind) for side in sides)
    ends = (
        np.nextafter(below, kind.type(-math.inf)),
        above,
        np.nextafter(beyond, kind.type(math.inf)),
    )
    chosen = np.concatenate([np.array(special, kind), *ends])[:count]
    random = np.random.default_rng(_SEED)
    rest = count - len(chosen)
    inside = random.uniform(low, high, rest)
    far = random.uniform(-constants.farthest, constants.farthest, rest)
    others = np.where(np.arange(rest) % 10 == 0, far, inside)
    return np.concatenate([chosen, others.astype(kind)])
