# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predictions and resonances as the bytes of their messages, and in words; needs no rclpy."""

import struct
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.prediction.batch import Predictions
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.predictor import Prediction
from linkage_vibration.prediction.resonance import Resonance, Resonances, ResonanceState

FloatArray = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

# The encapsulation of plain CDR (OMG DDS-RTPS, 10.2): which byte order follows.
_ENCAPSULATION = b"\x00\x01\x00\x00" if sys.byteorder == "little" else b"\x00\x00\x00\x00"


def encode_prediction(prediction: Prediction, sec: int, nanosec: int, frame_id: str) -> bytes:
    """Return a prediction as the CDR of ``linkage_vibration_interfaces/msg/VibrationPrediction``.

    The same prediction gives the same bytes always. A ROS 2 serializer does not promise that: it
    may leave what memory held where CDR pads.

    Parameters
    ----------
    prediction : Prediction
        At least one mode, as CDR pads an empty sequence otherwise.
    sec, nanosec : int
        The header's stamp, s and ns.
    frame_id : str
        The header's frame.

    Returns
    -------
    bytes
        With the encapsulation header, as DDS carries it and MCAP keeps it.
    """
    frame = frame_id.encode() + b"\x00"
    table = prediction.table_id.encode() + b"\x00"
    n_modes = prediction.natural_frequencies.size
    # CDR aligns every number to its own size, which is what struct does natively.
    return _ENCAPSULATION + struct.pack(
        f"iII{len(frame)}sdBI{n_modes}dI{n_modes}dI{n_modes}d3dI{len(table)}s",
        sec,
        nanosec,
        len(frame),
        frame,
        prediction.crank_angle,
        prediction.status,
        n_modes,
        *prediction.natural_frequencies.tolist(),
        n_modes,
        *prediction.frequency_stddev.tolist(),
        n_modes,
        *prediction.damping_ratios.tolist(),
        prediction.frf_peak_frequency,
        prediction.frf_peak_magnitude,
        prediction.interpolation_error,
        len(table),
        table,
    )


def encode_resonance(resonance: Resonance, sec: int, nanosec: int, frame_id: str) -> bytes:
    """Return a resonance as the CDR of ``linkage_vibration_interfaces/msg/Resonance``.

    Parameters
    ----------
    resonance : Resonance
        Of any state.
    sec, nanosec : int
        The header's stamp, s and ns.
    frame_id : str
        The header's frame.

    Returns
    -------
    bytes
        With the encapsulation header; the same always, as those of a prediction.
    """
    frame = frame_id.encode() + b"\x00"
    excitation = resonance.excitation.encode() + b"\x00"
    table = resonance.table_id.encode() + b"\x00"
    return _ENCAPSULATION + struct.pack(
        f"iII{len(frame)}sBI{len(excitation)}sdI3dbdI{len(table)}s",
        sec,
        nanosec,
        len(frame),
        frame,
        resonance.state,
        len(excitation),
        excitation,
        resonance.excitation_frequency,
        resonance.mode,
        resonance.natural_frequency,
        resonance.margin,
        resonance.relative_margin,
        resonance.approach,
        resonance.time_to_crossing,
        len(table),
        table,
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
    numbers[:] = np.frombuffer(example, layout, 1, len(_ENCAPSULATION))
    for name, column in columns.items():
        numbers[name] = column
    rows = np.empty((n, len(example)), np.uint8)
    rows[:] = np.frombuffer(example, np.uint8)
    rows[:, len(_ENCAPSULATION) : len(_ENCAPSULATION) + layout.itemsize] = numbers.view(
        np.uint8
    ).reshape(n, layout.itemsize)
    return rows
