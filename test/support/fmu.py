# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Simulates FMUs with FMPy on the crank angles of a log."""

from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from linkage_vibration.prediction.predictor import Predictor, predict_many
from linkage_vibration.review.log import Log

FIRST = 0.5  # s; the comparison begins after the first steps


def simulate(fmu: Path, interface: str, log: Log, step: float, **options: Any) -> Any:
    """Return the outputs of an FMU over a log, as a structured array with the times."""
    given = np.zeros(len(log.times), [("time", float), ("crank_angle", float)])
    given["time"], given["crank_angle"] = log.times, log.crank_angle
    more = {"solver": "Euler"} if interface == "ModelExchange" else {}
    return fmpy.simulate_fmu(
        str(fmu),
        fmi_type=interface,
        input=given,
        start_time=0.0,
        stop_time=step * int(log.times[-1] / step),
        step_size=step,
        output_interval=step,
        **more,
        **options,
    )


def differences(actual: Any, log: Log, step: float) -> tuple[float, float]:
    """Return the largest relative differences of natural frequencies from the node's predictions.

    They are compared at the same times, and with those one step before.
    """
    assert log.table is not None
    predictor = Predictor(log.table)
    times = actual["time"]
    own = np.array([actual[f"natural_frequencies[{i + 1}]"] for i in range(log.n_modes)]).T
    off = []
    for lag in (0.0, step):
        angles = np.interp(times - lag, log.times, log.crank_angle)
        expected = predict_many(predictor, angles, 0.0 * angles).natural_frequencies
        late = times > FIRST
        off.append(float(np.abs(own / expected - 1.0)[late].max()))
    return off[0], off[1]
