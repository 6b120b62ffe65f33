# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predicts and encodes by the thousand: to the last bit what `Predictor` and `messages` give."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.excitation import Excitation, Resonance, Resonances, ResonanceState
from linkage_vibration.messages import encode_prediction, encode_resonance
from linkage_vibration.prediction import Prediction, Predictor, Status

FloatArray = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

_ENCAPSULATION = 4  # bytes


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
        Of the table.
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
        """Return one of them."""
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
        Whose `Predictor.predict` it does.
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
    # What is left is out of range, no angle, or that of a crank that turns all the way.
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


def encode_predictions(
    predictions: Predictions,
    sec: NDArray[np.int32],
    nanosec: NDArray[np.uint32],
    frame_id: str,
) -> Bytes:
    """Encode predictions whose headers have one frame.

    Parameters
    ----------
    predictions : Predictions
        One at least.
    sec, nanosec : ndarray, (n,)
        The headers' stamps, s and ns.
    frame_id : str
        The headers' frame.

    Returns
    -------
    ndarray of uint8, (n, n_bytes)
        Each row is what `encode_prediction` gives.
    """
    n, modes = predictions.natural_frequencies.shape
    example = encode_prediction(predictions.row(0), 0, 0, frame_id)
    frame = len(frame_id.encode()) + 1
    layout = np.dtype(
        [
            ("sec", "i4"),
            ("nanosec", "u4"),
            ("frame_length", "u4"),
            ("frame", "u1", (frame,)),
            ("crank_angle", "f8"),
            ("status", "u1"),
            ("frequencies", "u4"),
            ("natural_frequencies", "f8", (modes,)),
            ("stddevs", "u4"),
            ("frequency_stddev", "f8", (modes,)),
            ("ratios", "u4"),
            ("damping_ratios", "f8", (modes,)),
            ("frf_peak_frequency", "f8"),
            ("frf_peak_magnitude", "f8"),
            ("interpolation_error", "f8"),
        ],
        align=True,  # as CDR does
    )
    columns = {
        name: getattr(predictions, name)
        for name in (
            "crank_angle",
            "status",
            "natural_frequencies",
            "frequency_stddev",
            "damping_ratios",
            "frf_peak_frequency",
            "frf_peak_magnitude",
            "interpolation_error",
        )
    }
    return _alike(example, layout, {"sec": sec, "nanosec": nanosec, **columns})


def encode_resonances(
    resonances: Resonances,
    excitations: Sequence[Excitation],
    table_id: str,
    sec: NDArray[np.int32],
    nanosec: NDArray[np.uint32],
    frame_id: str,
) -> Iterator[tuple[Integers, Bytes]]:
    """Encode resonances whose headers have one frame.

    Parameters
    ----------
    resonances : Resonances
        Any number of them.
    excitations : sequence of Excitation
        The monitor's.
    table_id : str
        Of the predictions.
    sec, nanosec : ndarray, (n,)
        The headers' stamps, s and ns.
    frame_id : str
        The headers' frame.

    Yields
    ------
    which : ndarray, (m,)
        Those of one excitation, whose messages are of one size.
    encoded : ndarray of uint8, (m, n_bytes)
        Each row is what `encode_resonance` gives.
    """
    nan = float("nan")
    frame = len(frame_id.encode()) + 1
    for number in np.unique(resonances.excitation).tolist():
        [which] = np.nonzero(resonances.excitation == number)
        name = excitations[number].name if number >= 0 else ""
        stale = Resonance(ResonanceState.STALE, name, nan, 0, nan, nan, nan, 0, nan, table_id)
        layout = np.dtype(
            [
                ("sec", "i4"),
                ("nanosec", "u4"),
                ("frame_length", "u4"),
                ("frame", "u1", (frame,)),
                ("state", "u1"),
                ("excitation_length", "u4"),
                ("excitation", "u1", (len(name.encode()) + 1,)),
                ("excitation_frequency", "f8"),
                ("mode", "u4"),
                ("natural_frequency", "f8"),
                ("margin", "f8"),
                ("relative_margin", "f8"),
                ("approach", "i1"),
                ("time_to_crossing", "f8"),
            ],
            align=True,
        )
        columns = {
            column: getattr(resonances, column)[which]
            for column in (
                "state",
                "excitation_frequency",
                "mode",
                "natural_frequency",
                "margin",
                "relative_margin",
                "approach",
                "time_to_crossing",
            )
        }
        stamps = {"sec": sec[which], "nanosec": nanosec[which]}
        example = encode_resonance(stale, 0, 0, frame_id)
        yield which, _alike(example, layout, {**stamps, **columns})


def _alike(example: bytes, layout: np.dtype[np.void], columns: Mapping[str, NDArray[Any]]) -> Bytes:
    """Return messages that have these numbers in their layout, and else the example's bytes."""
    n = len(columns["sec"])
    numbers = np.zeros(n, layout)  # what CDR pads with, too
    numbers[:] = np.frombuffer(example, layout, 1, _ENCAPSULATION)
    for name, column in columns.items():
        numbers[name] = column
    rows = np.empty((n, len(example)), np.uint8)
    rows[:] = np.frombuffer(example, np.uint8)
    rows[:, _ENCAPSULATION : _ENCAPSULATION + layout.itemsize] = numbers.view(np.uint8).reshape(
        n, layout.itemsize
    )
    return rows
