# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Maps the times of a log to the time axis of its page, on which long gaps are short."""

from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.review.findings import real_times
from linkage_vibration.review.log import Log, gaps

_LEAST, _SHARE, _WIDTH = 5.0, 0.1, 0.03  # s; and shares of the time with predictions


@dataclass(frozen=True, slots=True, eq=False)
class TimeAxis:
    """Corresponding times at the knots of the axis, between which all are linear, (n_knots,), s."""

    times: FloatArray  # as in `Log.times`
    shown: FloatArray  # on the axis of the page
    real: FloatArray  # stamps since the first one
    shortened: tuple[tuple[float, float], ...]  # ends of shortened gaps, as in `Log.times`

    def place(self, times: FloatArray) -> FloatArray:
        """Return the places of times on the axis, s."""
        if np.array_equal(self.shown, self.times):
            return times
        inside = np.interp(times, self.times, self.shown)
        outside = times - np.clip(times, self.times[0], self.times[-1])
        return np.asarray(inside + outside)

    def knots(self) -> dict[str, list[float]] | None:
        """Return the knots as the page reads them; None if the axis shows the time as it is."""
        if np.array_equal(self.shown, self.real):
            return None
        return {"shown": self.shown.tolist(), "real": self.real.tolist()}


def time_axis(log: Log) -> TimeAxis:
    """Return the axis of a log, on which a gap is short if it would take a tenth of the width."""
    times, real, missing = log.times, real_times(log), gaps(log)
    recorded = float(times[-1]) - sum(end - start for start, end in missing)
    least, width = max(_LEAST, _SHARE * recorded), _WIDTH * recorded
    shortened = tuple((start, end) for start, end in missing if end - start > least)
    knots = np.searchsorted(times, np.ravel(shortened))
    rows = np.unique([0, len(times) - 1, *(log.passes - 1), *log.passes, *knots])
    steps = np.diff(times[rows], prepend=times[rows[:1]])
    ends = {end for _, end in shortened}
    steps[[float(time) in ends for time in times[rows]]] = width
    return TimeAxis(times[rows], np.cumsum(steps), real[rows], shortened)
