# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Readings out of joint states and hitch positions."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from linkage_vibration.prediction.inputs import (
    PERCENT_STEP,
    InputError,
    JointInput,
    PercentInput,
    Reading,
    ReadingError,
)


def state(names: list[str], positions: list[float], velocities: list[float] | None = None) -> Any:
    """Return what a joint state has of names, positions and velocities."""
    return SimpleNamespace(name=names, position=positions, velocity=velocities or [])


def test_position_is_found_by_name() -> None:
    """In any order; a message about other joints has none."""
    joint = JointInput("b")
    for names, positions in ((["a", "b"], [1.0, 2.0]), (["b", "a"], [2.0, 1.0])):
        reading = joint.reading(state(names, positions))
        assert reading is not None
        assert reading.crank_angle == 2.0
    for others in (state(["a"], [1.0]), state(["a"], []), state([], [])):
        assert joint.reading(others) is None


def test_crank_angle_and_velocity() -> None:
    """Angle = sign * scale * position + offset, and the velocity is turned and scaled alike."""
    joint = JointInput("b", sign=-1, scale=0.5, offset=2.0, stddev=0.01)
    assert joint.reading(state(["b"], [0.25], [4.0])) == Reading(1.875, -2.0, 0.01)


@pytest.mark.parametrize("velocities", [[], [1.0], [1.0, 2.0, 3.0]])
def test_velocity_that_belongs_to_no_joint(velocities: list[float]) -> None:
    """Without one velocity for each name it is not known."""
    reading = JointInput("b").reading(state(["a", "b"], [1.0, 2.0], velocities))
    assert reading is not None
    assert math.isnan(reading.velocity)


@pytest.mark.parametrize(
    ("names", "positions", "words"),
    [
        (["b"], [], "1 names but 0 positions"),
        (["a", "b"], [1.0], "2 names but 1 positions"),
        (["b"], [1.0, 2.0], "1 names but 2 positions"),
        (["b", "b"], [1.0, 2.0], "named 2 times"),
    ],
)
def test_untrustworthy_readings(names: list[str], positions: list[float], words: str) -> None:
    """Sizes that differ and a joint named twice are told."""
    with pytest.raises(ReadingError, match=words):
        JointInput("b").reading(state(names, positions))


def test_hitch_position_through_a_calibration() -> None:
    """The points are met, whether the angle falls or rises with the hitch."""
    percents, angles = (0.0, 40.0, 100.0), (3.1, 2.6, 1.7)
    for sign in (1.0, -1.0):
        hitch = PercentInput(percents, tuple(sign * angle for angle in angles))
        for percent, angle in zip(percents, angles, strict=True):
            assert hitch.reading(percent).crank_angle == pytest.approx(sign * angle, rel=1e-14)


@given(st.data())
def test_calibration_never_turns_back(data: st.DataObject) -> None:
    """Between the points of any monotone calibration the angle goes one way."""
    inner = data.draw(st.lists(st.floats(0.5, 99.5), max_size=6, unique=True))
    percents = (0.0, *sorted(inner), 100.0)
    assume(min(np.diff(percents)) > 1e-3)
    steps = data.draw(
        st.lists(st.floats(1e-4, 1.0), min_size=len(inner) + 1, max_size=len(inner) + 1)
    )
    hitch = PercentInput(percents, tuple(3.1 - np.cumsum([0.0, *steps])))
    found = [hitch.reading(p).crank_angle for p in np.linspace(0.0, 100.0, 251)]
    assert (np.diff(found) <= 1e-12).all()


def test_resolution_of_the_bus_is_an_uncertainty() -> None:
    """Positions rounded to 0.4 % are off by what the reading says, and the given share is added."""
    hitch = PercentInput((0.0, 50.0, 100.0), (3.1, 2.2, 1.8))
    true = np.random.default_rng(4).uniform(29.0, 31.0, 20_000)
    rounded = PERCENT_STEP * np.rint(true / PERCENT_STEP)
    errors = [
        hitch.reading(seen).crank_angle - hitch.reading(own).crank_angle
        for seen, own in zip(rounded.tolist(), true.tolist(), strict=True)
    ]
    assert np.std(errors) == pytest.approx(hitch.reading(30.0).stddev, rel=0.03)
    both = PercentInput(hitch.percents, hitch.angles, stddev=0.05).reading(30.0).stddev
    assert both == math.hypot(0.05, hitch.reading(30.0).stddev)


@pytest.mark.parametrize("percent", [-0.4, 100.4, 101.6, 102.0, math.nan, math.inf])
def test_positions_that_are_none(percent: float) -> None:
    """Beyond 0 to 100 %, where the bus says "error" or "not available", there is no angle."""
    assert math.isnan(PercentInput((0.0, 100.0), (3.1, 1.7)).reading(percent).crank_angle)


@pytest.mark.parametrize(
    ("percents", "angles", "words"),
    [
        ((0.0,), (1.0,), "two points"),
        ((0.0, 100.0), (1.0, 2.0, 3.0), "2 percents and 3 angles"),
        ((0.0, 99.0), (1.0, 2.0), "from 0 to 99 %"),
        ((0.0, 60.0, 40.0, 100.0), (1.0, 2.0, 3.0, 4.0), r"point 3 \(40 %\)"),
        ((0.0, 50.0, 50.0, 100.0), (1.0, 2.0, 3.0, 4.0), r"point 3 \(50 %\)"),
        ((0.0, 50.0, 100.0), (1.0, 2.0, 1.5), r"point 3 \(85.9"),
        ((0.0, 50.0, 100.0), (1.0, 1.0, 0.5), r"point 2 \(57.2"),
        ((0.0, 50.0, 100.0), (3.0, 2.0, 2.0), r"point 3 \(114.5"),
        ((0.0, 50.0, 50.0 + 1e-9, 100.0), (1.0, 2.0, 3.0, 4.0), r"point 3 \(50 %\)"),
        ((0.0, 100.0), (1.0, math.nan), "not finite"),
        ((0.0, 100.0), (1e308, -1e308), "beyond 1000 rad"),
    ],
)
def test_calibrations_that_cannot_be_used(
    percents: tuple[float, ...], angles: tuple[float, ...], words: str
) -> None:
    """What is not a strictly monotone calibration from 0 to 100 % is refused at its place."""
    with pytest.raises(InputError, match=words):
        PercentInput(percents, angles)
