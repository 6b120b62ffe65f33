# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measured profiles are read from CSV files, and errors name the place and the fix."""

from pathlib import Path

import numpy as np
import pytest

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.readers.profiles import read_profile
from linkage_vibration.readers.recordings import RecordingError

DISTANCE = 0.1 * np.arange(300)
HEIGHT = 0.01 * np.sin(DISTANCE)


def write(path: Path, *columns: FloatArray) -> Path:
    """Write columns as a CSV file with names, and return its path."""
    np.savetxt(path, np.column_stack(columns), delimiter=",", header="distance,height", comments="")
    return path


def test_two_tracks_have_a_mean_and_half_of_a_difference(tmp_path: Path) -> None:
    """With one track, there is its height."""
    path = write(tmp_path / "one.csv", DISTANCE, HEIGHT)
    np.testing.assert_allclose(read_profile(path), [DISTANCE, HEIGHT])
    path = write(tmp_path / "two.csv", DISTANCE, HEIGHT, 3.0 * HEIGHT + 0.2)
    parts = [DISTANCE, 2.0 * HEIGHT + 0.1, -HEIGHT - 0.1]
    np.testing.assert_allclose(read_profile(path), parts)


def changed(values: FloatArray, at: int, value: float) -> FloatArray:
    """Return values with another one at an index."""
    result = values.copy()
    result[at] = value
    return result


SMALL_GAP = DISTANCE + np.where(np.arange(300) > 149, 0.19, 0.0)
FAULTS = {
    "NaN": ((DISTANCE, changed(HEIGHT, 7, np.nan)), "sample 8 is not finite"),
    "endless": ((DISTANCE, changed(HEIGHT, 7, np.inf)), "sample 8 is not finite"),
    "unsorted": ((changed(DISTANCE, 8, 0.65), HEIGHT), "0.65 m follows 0.7 m; sort"),
    "twice": ((changed(DISTANCE, 8, 0.7), HEIGHT), "0.7 m follows 0.7 m; sort"),
    "gap": ((SMALL_GAP + np.where(np.arange(300) > 149, 0.02, 0.0), HEIGHT), "gap from 14.9 m"),
    "constant": ((DISTANCE, 0.0 * HEIGHT + 0.3), "the height is a straight line"),
    "slope": ((DISTANCE, 0.05 * DISTANCE), "the height is a straight line"),
    "opposite tracks": ((DISTANCE, HEIGHT, -HEIGHT), "the mean of both heights is a straight line"),
    "equal tracks": ((DISTANCE, HEIGHT, HEIGHT), "the difference of both heights is a straight"),
    "unit": (
        (DISTANCE, changed(HEIGHT, 7, -1.1e9)),
        "beyond 1e.09; distances and heights are in m",
    ),
    "short": ((DISTANCE[:255], HEIGHT[:255]), "has 255 samples; give at least 256"),
    "one column": ((DISTANCE,), "has 1 columns; give the distance"),
    "four columns": ((DISTANCE, HEIGHT, HEIGHT, HEIGHT), "has 4 columns; give the distance"),
}


def test_just_enough_is_read(tmp_path: Path) -> None:
    """256 samples are enough, and a step of less than three others is no gap."""
    assert len(read_profile(write(tmp_path / "a.csv", DISTANCE[:256], HEIGHT[:256]))[0]) == 256
    assert len(read_profile(write(tmp_path / "b.csv", SMALL_GAP, HEIGHT))[0]) == 300
    far = write(tmp_path / "c.csv", DISTANCE, changed(HEIGHT, 7, -1e9))
    assert read_profile(far)[1].min() == -1e9


@pytest.mark.parametrize(("amplitude", "refused"), [(0.0, False), (0.0016, False), (0.0024, True)])
def test_waves_that_repeat_evenly_are_refused(
    tmp_path: Path, amplitude: float, refused: bool
) -> None:
    """A wave of 1 m on a random walk, whose density falls with the square of the wavenumber.

    Five times the density beside it are the limit. At 1 / m, that of the walk is G = 2 x 0.0023^2 /
    (0.05 x (2 pi)^2) = 5.4e-6 m3, and a wave adds a^2 / (2 x 0.11) to the mean over a sixth of an
    octave, which is 0.11 / m wide: the densities are 3.2 and 5.8 times G.
    """
    rng = np.random.default_rng(5)
    distance = 0.05 * np.arange(8000)
    walk = 0.0023 * np.cumsum(rng.standard_normal(8000))  # about class C
    path = write(tmp_path / "road.csv", distance, walk + amplitude * np.sin(2.0 * np.pi * distance))
    if not refused:
        assert len(read_profile(path)[0]) == 8000
        return
    with pytest.raises(RecordingError, match=r"waves of about (0\.9|1\.0).* m repeat evenly"):
        read_profile(path)
