# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Joint states to readings, and predictions to the bytes of their message; needs no rclpy."""

import math
import struct
import sys
from collections.abc import Sequence
from typing import Protocol

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction import Prediction, Status

# The encapsulation of plain CDR (OMG DDS-RTPS, 10.2): which byte order follows.
_ENCAPSULATION = b"\x00\x01\x00\x00" if sys.byteorder == "little" else b"\x00\x00\x00\x00"


class ReadingError(LinkageVibrationError):
    """A joint state holds no trustworthy position of the joint."""


class Named(Protocol):
    """What a reading needs of ``sensor_msgs/msg/JointState``."""

    name: Sequence[str]
    position: Sequence[float]


def joint_position(joint_state: Named, joint: str) -> float | None:
    """Return the position of a joint, looked up by its name.

    Parameters
    ----------
    joint_state : sensor_msgs.msg.JointState
        Names in any order.
    joint : str
        The joint's name.

    Returns
    -------
    float or None
        The position, which may be NaN; None where the message is about other joints alone.

    Raises
    ------
    ReadingError
        If the joint is named more than once, or there is not one position for each name.
    """
    names, positions = joint_state.name, joint_state.position
    count = names.count(joint)
    if count == 0:
        return None
    if count > 1:
        raise ReadingError(f"Joint {joint} is named {count} times; name it once in a joint state.")
    if len(names) != len(positions):
        raise ReadingError(
            f"A joint state has {len(names)} names but {len(positions)} positions, so that of "
            f"{joint} is not known; publish one position for each name."
        )
    return positions[names.index(joint)]


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
        f"iII{len(frame)}sdBI{n_modes}dI{n_modes}d3dI{len(table)}s",
        sec,
        nanosec,
        len(frame),
        frame,
        prediction.crank_angle,
        prediction.status,
        n_modes,
        *prediction.natural_frequencies.tolist(),
        n_modes,
        *prediction.damping_ratios.tolist(),
        prediction.frf_peak_frequency,
        prediction.frf_peak_magnitude,
        prediction.interpolation_error,
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
        if turned <= last:
            told += f", but {turned:.7g} deg is: is the joint's zero a turn off?"
        return told
    if prediction.status is Status.NEAR_TOGGLE:
        return (
            f"crank angle {angle:.7g} deg is less than 1 deg from a toggle, where a small error of "
            "the angle is a large one of the configuration"
        )
    return ""
