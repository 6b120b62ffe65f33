# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the promises read from messages, in one place."""

import math
from typing import Any

from linkage_vibration_interfaces.msg import LoadState


def numbers(prediction: Any) -> list[str]:
    """Return the numbers and the status of a prediction, in a form that compares."""
    single = ("crank_angle", "frf_peak_frequency", "frf_peak_magnitude", "interpolation_error")
    several = (
        "natural_frequencies",
        "damping_ratios",
        "frequency_stddevs",
        "damping_ratio_stddevs",
    )
    values = [getattr(prediction, name) for name in single]
    for name in several:
        values += list(getattr(prediction, name))
    return [*map(repr, map(float, values)), str(int(prediction.status))]


def state_is_known(message: LoadState) -> bool:
    """Return whether a load state says how strongly the linkage is loaded."""
    return bool(message.state != LoadState.STATE_UNKNOWN)


def present(**permitted: float) -> dict[str, float]:
    """Return the fields of a question for advice: a hitch at work, and what is permitted."""
    now = {
        "crank_angle": math.radians(165.0),
        "ground_speed": 8.3,
        "engine_speed": math.radians(6 * 1800.0),
    }
    return {**now, **permitted}


def advised_loads(answer: Any) -> dict[str, float]:
    """Return the load ratio at each of the places of an advice."""
    advice = answer.advice
    places = {"now": advice.NOW, "height": advice.HEIGHT, "speed": advice.SPEED}
    places["both"] = advice.BOTH
    return {name: advice.places[i].load_ratio for name, i in places.items()}


def unknown_speeds(message: LoadState) -> set[str]:
    """Return the inputs whose speeds are not known, by a load state."""
    bits = {
        "engine": LoadState.UNKNOWN_ENGINE_SPEED,
        "pto": LoadState.UNKNOWN_PTO_SPEED,
        "ground": LoadState.UNKNOWN_GROUND_SPEED,
    }
    return {name for name, bit in bits.items() if message.unknown_sources & bit}
