# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predicts at many angles at once, with the same results as `Predictor` to the last bit."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.prediction.predictor import Prediction, Predictor, Status

FloatArray = NDArray[np.float64]
Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Predictions:
    """Predictions by columns; see `Prediction`.

    Attributes
    ----------
    crank_angle : ndarray, (n,)
        rad.
    status : ndarray of uint8, (n,)
        Values of `Status`.
    natural_frequencies, damping_ratios : ndarray, (n, n_modes)
        Hz and 1.
    frequency_slopes, frequency_stddev : ndarray, (n, n_modes)
        Hz/rad and Hz.
    frf_peak_frequency, frf_peak_magnitude : ndarray, (n,)
        Hz and m/N.
    interpolation_error : ndarray, (n,)
        1.
    table_id : str
        Identifies the table.
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

    def row(self, i: int) -> Prediction:
        """Return one prediction."""
        return Prediction(
            crank_angle=float(self.crank_angle[i]),
            status=Status(int(self.status[i])),
            natural_frequencies=self.natural_frequencies[i],
            damping_ratios=self.damping_ratios[i],
            frequency_slopes=self.frequency_slopes[i],
            frequency_stddev=self.frequency_stddev[i],
            frf_peak_frequency=float(self.frf_peak_frequency[i]),
            frf_peak_magnitude=float(self.frf_peak_magnitude[i]),
            interpolation_error=float(self.interpolation_error[i]),
            table_id=self.table_id,
        )


def predict_many(predictor: Predictor, alpha3: FloatArray, stddev: FloatArray) -> Predictions:
    """Predict at many angles.

    Parameters
    ----------
    predictor : Predictor
        Looks up the table.
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
    per_mode = np.empty((4, n, modes))
    single = np.empty((3, n))
    status[inside] = np.where(sound, Status.OK, Status.NEAR_TOGGLE)
    per_mode[0, inside] = values[:, :modes]
    per_mode[1, inside] = values[:, modes : 2 * modes]
    per_mode[2, inside] = slopes
    per_mode[3, inside] = np.abs(slopes) * stddev[inside, np.newaxis]
    single[:2, inside] = values[:, 2 * modes :].T
    single[2, inside] = table.interpolation_error[piece]
    # The rest is out of range, not finite, or belongs to a crank that turns all the way.
    outside = np.ones(n, bool)
    outside[inside] = False
    for i in np.flatnonzero(outside):
        one = predictor.predict(float(alpha3[i]), float(stddev[i]))
        status[i] = one.status
        per_mode[0, i], per_mode[1, i] = one.natural_frequencies, one.damping_ratios
        per_mode[2, i], per_mode[3, i] = one.frequency_slopes, one.frequency_stddev
        single[:, i] = one.frf_peak_frequency, one.frf_peak_magnitude, one.interpolation_error
    frequencies, ratios, rates, stddevs = per_mode
    at, size, error = single
    return Predictions(
        alpha3, status, frequencies, ratios, rates, stddevs, at, size, error, table.table_id
    )
