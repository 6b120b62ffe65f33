# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of other machines are read; they say nothing about the model."""

from pathlib import Path

import pytest

from benchmark.recordings import listen

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "imu"
NAMES = "ardrone_imu", "phidgets_imu_upside_down", "sparkfun_razor", "rl_test1", "rl_test2"


@pytest.mark.parametrize("name", NAMES)
def test_recordings_of_other_machines(name: str, tmp_path: Path) -> None:
    """Each is compared live and in `listen`, and no natural frequency is reported of any."""
    pytest.importorskip("matplotlib", reason="the extra plots is not installed")
    bag = FOLDER / f"{name}.bag"
    if not bag.exists():
        pytest.skip(f"{bag} is not there; benchmark/results/recordings.md says where it is from")
    _, samples, compared, *_, answer = listen(bag, tmp_path)
    assert int(compared) > 20
    assert int(samples) > 2000
    assert answer.startswith(("None of", "No natural frequency was found"))
