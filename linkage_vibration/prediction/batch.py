# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predicts at many angles at once, with the same results as `Predictor` to the last bit.

This formula is written twice: for one angle, arrays of one row would take 15 times as long as the
floats of `Predictor.predict`, and the node predicts at each reading.
"""

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.predictor import Predictor, Status, angles_in_table

FloatArray = NDArray[np.float64]


def predict_many(predictor: Predictor, alpha3: FloatArray, stddev: FloatArray) -> MessageColumns:
    """Predict at many angles; the columns have the names of the attributes of `Prediction`.

    Parameters
    ----------
    predictor : Predictor
    alpha3, stddev : ndarray, (n,)
        Angles and their standard deviations, rad.
    """
    table, n = predictor.table, len(alpha3)
    modes = table.n_modes
    with np.errstate(invalid="ignore"):
        angles = angles_in_table(alpha3, table.alpha3_range)
    inside = np.flatnonzero(~np.isnan(angles))
    angles = angles[inside]
    values, slopes = table.evaluate(angles), table.evaluate_slopes(angles)
    ends = table.alpha3[table.pieces]
    piece = np.clip(np.searchsorted(ends, angles, side="right") - 1, 0, len(ends) - 2)
    first, last = table.sound_range
    sound = (first <= angles) & (angles <= last)

    status = np.where(np.isfinite(alpha3), Status.OUT_OF_RANGE, Status.INVALID_ANGLE)
    status[inside] = np.where(sound, Status.OK, Status.NEAR_TOGGLE)
    error = table.interpolation_error[piece]
    modal = values[:, : 2 * modes]
    parameters = table.evaluate_parameter_deviations(angles)
    parameters[:, :modes] *= modal[:, :modes]
    turned = np.abs(slopes) * stddev[inside, np.newaxis]
    noise = np.hstack(list(table.deviations(angles))) if table.measured else 0.0
    missed = error[:, np.newaxis] * modal
    total = np.sqrt(parameters**2 + turned**2 + noise**2 + missed**2)
    per_mode, single = np.full((5, n, modes), np.nan), np.full((3, n), np.nan)
    per_mode[:, inside] = *np.hsplit(modal, 2), slopes[:, :modes], *np.hsplit(total, 2)
    single[:2, inside] = values[:, 2 * modes :].T
    single[2, inside] = error
    frequencies, ratios, rates, frequency_stddevs, ratio_stddevs = per_mode
    return MessageColumns(
        crank_angle=alpha3,
        status=status.astype(np.uint8),
        natural_frequencies=frequencies,
        damping_ratios=ratios,
        frequency_slopes=rates,
        frequency_stddev=frequency_stddevs,
        frf_peak_frequency=single[0],
        frf_peak_magnitude=single[1],
        interpolation_error=single[2],
        table_id=table.table_id,
        damping_ratio_stddev=ratio_stddevs,
    )
