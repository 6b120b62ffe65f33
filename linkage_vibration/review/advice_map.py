# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Describes the map of the load ratio over height and ground speed, with a drive in it."""

import math
from typing import Any

import numpy as np

from linkage_vibration.prediction.advice import HEIGHT, NOW, is_quieter
from linkage_vibration.prediction.excitation import KMH, Source
from linkage_vibration.review.findings import drive_advice, log_levels, log_limits, speeds_at_drive
from linkage_vibration.review.log import Log

_SHAPE = 61, 31  # heights and speeds
_POINTS = 1500  # of the drive
_BEYOND = 1.15  # of the highest speed of the drive


def advice_map(log: Log) -> dict[str, Any] | None:
    """Return the map of loads over angles, deg, and speeds, km/h; None if none is known."""
    speeds = {} if log.drive is None else speeds_at_drive(log)
    fastest = float(np.nanmax(speeds.get(Source.GROUND, [0.0]), initial=0.0))
    levels = log_levels(log) if fastest > 0.0 else None
    if levels is None or log.drive is None or not log.drive.may_be_worst.any():
        return None
    advice = drive_advice(log, levels, _SHAPE, (0.0, _BEYOND * fastest))
    places = np.column_stack([KMH * speeds[Source.GROUND], np.degrees(log.drive.angles)])
    rows = np.unique(np.linspace(0, len(places) - 1, _POINTS).astype(int))
    of = advice.message
    marks = np.column_stack([KMH * of.ground_speeds, np.degrees(of.crank_angles)])
    note = "Orange: the drive, with its worst moment as a dot. White: the limit, and the quietest "
    note += "height at that speed. Grey: not known. The speeds of engine and PTO are those of the "
    note += "worst moment."
    if of.not_counted:
        note += f" A part of the load: {of.not_counted} not counted, as it is not known."
    return {
        "angles": np.degrees(advice.crank_angles).tolist(),
        "speeds": (KMH * advice.ground_speeds).tolist(),
        "loads": advice.load_ratios.astype(np.float32),
        "reasons": advice.reasons,
        "texts": advice.reason_texts,
        "limit": log_limits(log).warning,
        "drive": [_place(*place) for place in places[rows].tolist()],
        "now": _place(*marks[NOW].tolist()),
        "best": _place(*marks[HEIGHT].tolist()) if is_quieter(of)[HEIGHT] else None,
        "note": note,
    }


def _place(speed: float, angle: float) -> list[float] | None:
    """Return a place in the map; None if it is not known."""
    return None if not math.isfinite(speed + angle) else [round(speed, 3), round(angle, 3)]
