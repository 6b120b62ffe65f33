# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predicts at many angles at once, with the same results as `Predictor` to the last bit."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.prediction.predictor import Predictor, Status

FloatArray = NDArray[np.float64]
Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Predictions:
    """Predictions by columns, whose names and units are those of `Prediction`.

    Attributes
    ----------
    crank_angle, frf_peak_frequency, frf_peak_magnitude, interpolation_error : ndarray, (n,)
    status : ndarray of uint8, (n,)
    natural_frequencies, damping_ratios : ndarray, (n, n_modes)
    frequency_slopes, frequency_stddev : ndarray, (n, n_modes)
    table_id : str
    damping_ratio_stddev : ndarray, (n, n_modes)
    """

    crank_angle: FloatArray
    status: Bytes
    natural_frequencies: FloatArray
    damping_ratios: FloatArray
    frequency_slopes: FloatArray
    frequency_stddev: FloatArray
    frf_peak_frequency: FloatArray
    frf_peak_magnitude: FloatArray
    interpolation_error: FloatArray
    table_id: str
    damping_ratio_stddev: FloatArray


def joined(parts: Sequence[Predictions], which: NDArray[np.int64] | None = None) -> Predictions:
    """Return predictions of one table, one part after the other.

    Parameters
    ----------
    parts : sequence of Predictions
    which : ndarray, optional
        Indices of the predictions to return; all by default.
    """
    rows = slice(None) if which is None else which
    columns: dict[str, Any] = {}
    for name in (column.name for column in fields(Predictions)):
        values = [getattr(part, name) for part in parts]
        columns[name] = values[0] if name == "table_id" else np.concatenate(values)[rows]
    return Predictions(**columns)


def predict_many(predictor: Predictor, alpha3: FloatArray, stddev: FloatArray) -> Predictions:
    """Predict at many angles.

    Parameters
    ----------
    predictor : Predictor
    alpha3, stddev : ndarray, (n,)
        Angles and their standard deviations, rad.
    """
    table, n = predictor.table, len(alpha3)
    modes = table.n_modes
    low, high = table.alpha3_range
    inside = np.flatnonzero((low <= alpha3) & (alpha3 <= high))
    angles = alpha3[inside]
    values, slopes = table.evaluate(angles), table.evaluate_slopes(angles)
    ends = table.alpha3[table.pieces]
    piece = np.clip(np.searchsorted(ends, angles, side="right") - 1, 0, len(ends) - 2)
    first, last = table.sound_range
    sound = (first <= angles) & (angles <= last)

    status = np.empty(n, np.uint8)
    per_mode = np.empty((5, n, modes))
    single = np.empty((3, n))
    status[inside] = np.where(sound, Status.OK, Status.NEAR_TOGGLE)
    error = table.interpolation_error[piece]
    own = values[:, : 2 * modes]
    parameters = table.evaluate_parameter_deviations(angles)
    parameters[:, :modes] *= own[:, :modes]
    turned = np.abs(slopes) * stddev[inside, np.newaxis]
    noise = np.hstack(list(table.deviations(angles))) if table.measured else 0.0
    missed = error[:, np.newaxis] * own
    total = np.sqrt(parameters**2 + turned**2 + noise**2 + missed**2)
    frequencies, ratios = np.hsplit(own, 2)
    frequency_stddevs, ratio_stddevs = np.hsplit(total, 2)
    per_mode[:, inside] = frequencies, ratios, slopes[:, :modes], frequency_stddevs, ratio_stddevs
    single[:2, inside] = values[:, 2 * modes :].T
    single[2, inside] = error
    # The rest is out of range, not finite, or belongs to a crank that turns all the way.
    for i in np.flatnonzero(~((low <= alpha3) & (alpha3 <= high))):
        one = predictor.predict(float(alpha3[i]), float(stddev[i]))
        status[i] = one.status
        per_mode[:2, i] = one.natural_frequencies, one.damping_ratios
        per_mode[2:4, i] = one.frequency_slopes, one.frequency_stddev
        per_mode[4, i] = one.damping_ratio_stddev
        single[:, i] = one.frf_peak_frequency, one.frf_peak_magnitude, one.interpolation_error
    frequencies, ratios, rates, stddevs, ratio_stddevs = per_mode
    columns = alpha3, status, frequencies, ratios, rates, stddevs, single[0], single[1], single[2]
    return Predictions(*columns, table.table_id, ratio_stddevs)
