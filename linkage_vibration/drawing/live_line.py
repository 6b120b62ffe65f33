# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Shows the newest prediction as one line of text."""

import math
import shutil
import time
from typing import Any, TextIO

import numpy as np

from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.severity import ResonanceState


class LiveLine:
    """Shows the newest prediction: in one line of a terminal, or in a file line once a second."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._in_place, self._due = stream, stream.isatty(), 0.0
        self._load = ""
        self.received = False  # whether there was a prediction

    def take(self, load: Any) -> None:
        """Show the load ratio and the state of a ``LoadState`` with the next predictions."""
        state = ResonanceState(load.state).name.lower()
        ratio = load.total_load_ratio
        text = "unknown" if math.isnan(ratio) else f"{ratio:.2f}"
        self._load = f"load {text:>7} {state:<7} | "

    def say(self, text: str) -> None:
        """Write a sentence into a line of its own."""
        self.close()
        print(text, file=self._stream, flush=True)

    def show(self, prediction: Any) -> None:
        """Write the line, if its time has come."""
        self.received = True
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + (0.1 if self._in_place else 1.0)
        line = self._load + _line(prediction)
        # A line that wraps could not be overwritten.
        width = shutil.get_terminal_size().columns - 1
        self._stream.write(f"\r{line[:width]}" if self._in_place else f"{line}\n")
        self._stream.flush()

    def close(self) -> None:
        """End the line."""
        if self._in_place and self._due:
            self._stream.write("\n")
        self._due = 0.0


def _line(prediction: Any) -> str:
    """Return a line of constant width, whose end a narrow terminal cuts."""
    missing = "overd." if prediction.status in (Status.OK, Status.NEAR_TOGGLE) else "nan"
    frequencies = "".join(
        f"{missing:>7}" if math.isnan(frequency) else f"{frequency:7.2f}"
        for frequency in prediction.natural_frequencies
    )
    return (
        f"crank {np.rad2deg(prediction.crank_angle):6.2f} deg | peak "
        f"{prediction.frf_peak_magnitude:8.2e} m/N at {prediction.frf_peak_frequency:6.2f} Hz |"
        f"{frequencies} Hz"
    )
