# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predictions and resonances as the bytes of their messages, and in words; needs no rclpy."""

import math
import struct
import sys

from linkage_vibration.prediction.excitation import Resonance
from linkage_vibration.prediction.predictor import Prediction, Status

# The encapsulation of plain CDR (OMG DDS-RTPS, 10.2): which byte order follows.
_ENCAPSULATION = b"\x00\x01\x00\x00" if sys.byteorder == "little" else b"\x00\x00\x00\x00"
_FARTHEST = 1e6  # deg; beyond, an angle is not off by some turns


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


def fault(prediction: Prediction, alpha3_range: tuple[float, float]) -> str:
    """Return why a prediction has no numbers, or doubtful ones, in words; empty where it is sound.

    Parameters
    ----------
    prediction : Prediction
        Of any status.
    alpha3_range : (float, float)
        The table's first and last angle, rad.
    """
    angle = math.degrees(prediction.crank_angle)
    if prediction.status is Status.INVALID_ANGLE:
        return f"crank angle {angle} deg is not a finite number"
    if prediction.status is Status.OUT_OF_RANGE:
        first, last = map(math.degrees, alpha3_range)
        told = f"crank angle {angle:.7g} deg is not in the table's {first:.7g} to {last:.7g} deg"
        turned = first + (angle - first) % 360.0
        if turned <= last and abs(angle) < _FARTHEST:
            told += f", but {turned:.7g} deg is: is the joint's zero a turn off?"
        return told
    if prediction.status is Status.NEAR_TOGGLE:
        return (
            f"crank angle {angle:.7g} deg is less than 1 deg from a toggle, where a small error of "
            "the angle is a large one of the configuration"
        )
    return ""
