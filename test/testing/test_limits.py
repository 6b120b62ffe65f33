# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Limits that cannot be are refused, in Python and in a file, whose errors name the key."""

import math
from pathlib import Path
from typing import Any

import pytest

from linkage_vibration.prediction.predictor import Status
from linkage_vibration.testing.limits import Limits, TestKitError, read_limits


@pytest.mark.parametrize(
    "limits",
    [{"known_share": -0.1}, {"gap": -1}, {"gap": "x"}, {"load_ratio": math.nan}, {"latency": True}]
    + [{name: -1e-9} for name in ("velocity", "warning_time", "note_time", "duration")],
)
def test_limits_that_cannot_be(limits: Any) -> None:
    """A limit that is not a number from 0, or no status, is refused where it is made."""
    with pytest.raises(TestKitError, match="give a number from 0, or None"):
        Limits(**limits)
    with pytest.raises(TestKitError, match="statuses contains 'OK'"):
        Limits(statuses=("OK",))  # type: ignore[arg-type]
    with pytest.raises(TestKitError, match=r"known_share is 1\.1; give at most 1"):
        Limits(known_share=1.1)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"crank_angle_deg": (100.0, 100.0)}, "crank_angle_deg is .*two ascending numbers"),
        ({"crank_angle_deg": 100.0}, "crank_angle_deg is 100.0; give two ascending numbers"),
        ({"frequencies": {1: (5.0,)}}, "frequencies of mode 1 is .*two ascending numbers"),
        ({"frequencies": {0: (5.0, 9.0)}}, "give ranges by modes, from 1"),
        ({"frequencies": [5.0, 9.0]}, "give ranges by modes, from 1"),
        ({"windows": ()}, r"windows is \(\); give a list"),
        ({"windows": (0.0, 5.0)}, r"windows\[0\] is 0.0; give two ascending numbers"),
        ({"windows": ((-1.0, 5.0),)}, "give ascending times from 0 s"),
        ({"windows": ((0.0, 5.0), (4.0, 6.0))}, "give ascending times from 0 s"),
        ({"excitation": "engine 3"}, "excitation is 'engine 3', but limits nothing"),
        ({"place": "lift_rod:Q1", "velocity": 1.0}, "place is 'lift_rod:Q1', but limits nothing"),
        ({"place": 3, "load_ratio": 1.0}, "place is 3; give its name as text"),
    ],
)
def test_ranges_and_names_that_cannot_be(limits: Any, words: str) -> None:
    """A range that does not ascend, or a name that limits nothing, is refused."""
    with pytest.raises(TestKitError, match=words):
        Limits(**limits)


def test_ranges_that_touch() -> None:
    """Windows may touch, and a mode may be any from 1 on."""
    limits = Limits(windows=((0.0, 5.0), (5.0, 6.0)), frequencies={1: (5.0, 5.1)}, velocity=0.0)
    assert (limits.windows, limits.velocity) == (((0.0, 5.0), (5.0, 6.0)), 0.0)


def test_a_file(tmp_path: Path) -> None:
    """A file has the names of the fields; null switches a limit off."""
    path = tmp_path / "limits.yaml"
    path.write_text(
        "load_ratio: 0.33\nknown_share: null\nstatuses: [OK, NEAR_TOGGLE]\nexcitation: engine 3\n"
        "frequencies: {1: [4, 9.5]}\nwindows: [[0, 10], [20, 30]]\n"
    )
    limits = read_limits(path)
    assert (limits.load_ratio, limits.known_share, limits.excitation) == (0.33, None, "engine 3")
    assert limits.statuses == (Status.OK, Status.NEAR_TOGGLE)
    assert (limits.frequencies, limits.windows) == ({1: [4, 9.5]}, [[0, 10], [20, 30]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("load_ration: 1", "load_ration: this key is not known; did you mean load_ratio?"),
        ("wheels: 4", "wheels: this key is not known; did you mean load_ratio, known_share"),
        ("gap: -1", "gap is -1; give a number from 0"),
        ("gap: 1 s", "gap is '1 s'; give a number from 0"),
        ("statuses: [OK, GOOD]", "statuses contains 'GOOD'; use Status, as Status.OK, or in a "),
        ("statuses: GOOD", "statuses contains 'GOOD'"),
        ("", "None holds no limits; add one, such as `gap: 0.05`"),
        ("gap: [", "is not valid YAML"),
    ],
)
def test_files_that_cannot_be(tmp_path: Path, text: str, words: str) -> None:
    """An error names the file and the key."""
    path = tmp_path / "limits.yaml"
    path.write_text(text)
    with pytest.raises(TestKitError) as error:
        read_limits(path)
    assert str(error.value).startswith(f"{path}: ")
    assert words in str(error.value)


def test_a_file_that_is_missing(tmp_path: Path) -> None:
    """A file that is not there is named."""
    with pytest.raises(TestKitError, match=r"limits\.yaml: cannot be opened"):
        read_limits(tmp_path / "limits.yaml")
