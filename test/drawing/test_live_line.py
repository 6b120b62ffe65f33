# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The line that shows the newest prediction."""

import io
from types import SimpleNamespace

import numpy as np

from linkage_vibration.drawing.live_line import LiveLine
from linkage_vibration.prediction.predictor import Status


def test_live_line_is_written_once_a_second_to_a_file() -> None:
    """Thousands of predictions make few lines with angle, frequencies and peak."""
    stream = io.StringIO()
    live = LiveLine(stream)
    prediction = SimpleNamespace(
        status=Status.OK,
        crank_angle=np.deg2rad(132.0),
        natural_frequencies=[4.25, 97.5, 170.25],
        frf_peak_frequency=4.24,
        frf_peak_magnitude=3.1e-5,
    )
    for _ in range(1000):
        live.show(prediction)
    live.close()
    assert stream.getvalue().splitlines() == [
        "crank 132.00 deg | peak 3.10e-05 m/N at   4.24 Hz |   4.25  97.50 170.25 Hz"
    ]


def test_the_load_comes_first() -> None:
    """Once a resonance is known, the line begins with its load ratio and its state."""
    stream = io.StringIO()
    live = LiveLine(stream)
    prediction = SimpleNamespace(
        status=Status.OK,
        crank_angle=2.0,
        natural_frequencies=[4.25],
        frf_peak_frequency=4.24,
        frf_peak_magnitude=3.1e-5,
    )
    for ratio, state, text in (
        (0.42, 3, "load    0.42 warning | crank"),
        (np.nan, 0, "load unknown unknown | crank"),
    ):
        live.take(SimpleNamespace(total_load_ratio=ratio, state=state))
        live._due = 0.0
        live.show(prediction)
        assert stream.getvalue().splitlines()[-1].startswith(text)
