# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Crank angles from joint states and hitch positions."""

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from linkage_vibration.prediction.inputs import INPUTS, JointInput, PercentInput
from linkage_vibration.prediction.inputs.crank_input import InputError, Reading, ReadingError
from linkage_vibration.prediction.inputs.percent import PERCENT_STEP
from linkage_vibration.prediction.settings import Parameters


def state(names: list[str], positions: list[float], velocities: list[float] | None = None) -> Any:
    """Return an object with the arrays of a joint state."""
    return SimpleNamespace(name=names, position=positions, velocity=velocities or [])


def percent_input(percents: Sequence[float], angles: Sequence[float]) -> PercentInput:
    """Return the input with these points of its calibration (%, rad)."""
    return PercentInput(tuple(v for pair in zip(percents, angles, strict=True) for v in pair))


def test_position_is_found_by_name() -> None:
    """The order of the names does not matter; a message about other joints gives no reading."""
    joint = JointInput("b")
    for names, positions in ((["a", "b"], [1.0, 2.0]), (["b", "a"], [2.0, 1.0])):
        reading = joint.reading(state(names, positions))
        assert reading is not None
        assert reading.crank_angle == 2.0
    for others in (state(["a"], [1.0]), state(["a"], []), state([], [])):
        assert joint.reading(others) is None


def test_crank_angle_and_velocity() -> None:
    """Angle = sign * scale * position + offset, and the velocity is turned and scaled alike."""
    joint = JointInput("b", sign=-1, scale=0.5, offset=2.0, angle_stddev=0.01)
    assert joint.reading(state(["b"], [0.25], [4.0])) == Reading(1.875, -2.0, 0.01)


@pytest.mark.parametrize("velocities", [[], [1.0], [1.0, 2.0, 3.0]])
def test_velocity_that_belongs_to_no_joint(velocities: list[float]) -> None:
    """The velocity is unknown unless there is one for each name."""
    reading = JointInput("b").reading(state(["a", "b"], [1.0, 2.0], velocities))
    assert reading is not None
    assert math.isnan(reading.velocity)


@pytest.mark.parametrize(
    ("names", "positions", "words"),
    [
        (["b"], [], "1 names but 0 positions"),
        (["a", "b"], [1.0], "2 names but 1 positions"),
        (["b"], [1.0, 2.0], "1 names but 2 positions"),
        (["b", "b"], [1.0, 2.0], "contains the joint b 2 times"),
    ],
)
def test_unreliable_readings(names: list[str], positions: list[float], words: str) -> None:
    """Arrays of different lengths and a repeated joint are reported."""
    with pytest.raises(ReadingError, match=words):
        JointInput("b").reading(state(names, positions))


def test_hitch_position_through_a_calibration() -> None:
    """The curve passes through the points, whether the angle falls or rises with the hitch."""
    percents, angles = (0.0, 40.0, 100.0), (3.1, 2.6, 1.7)
    for sign in (1.0, -1.0):
        hitch = percent_input(percents, [sign * angle for angle in angles])
        for percent, angle in zip(percents, angles, strict=True):
            assert hitch.angle_at(percent).crank_angle == pytest.approx(sign * angle, rel=1e-14)


@given(st.data())
def test_calibration_never_turns_back(data: st.DataObject) -> None:
    """Between the points of any monotone calibration the angle goes one way."""
    inner = data.draw(st.lists(st.floats(0.5, 99.5), max_size=6, unique=True))
    percents = (0.0, *sorted(inner), 100.0)
    assume(min(np.diff(percents)) > 1e-3)
    steps = data.draw(
        st.lists(st.floats(1e-4, 1.0), min_size=len(inner) + 1, max_size=len(inner) + 1)
    )
    hitch = percent_input(percents, 3.1 - np.cumsum([0.0, *steps]))
    found = [hitch.angle_at(p).crank_angle for p in np.linspace(0.0, 100.0, 251)]
    assert (np.diff(found) <= 1e-12).all()


def test_resolution_of_the_bus_is_an_uncertainty() -> None:
    """The reading gives the error that steps of 0.4 % cause, and adds the given deviation."""
    hitch = percent_input((0.0, 50.0, 100.0), (3.1, 2.2, 1.8))
    true = np.random.default_rng(4).uniform(29.0, 31.0, 20_000)
    rounded = PERCENT_STEP * np.rint(true / PERCENT_STEP)
    errors = [
        hitch.angle_at(seen).crank_angle - hitch.angle_at(own).crank_angle
        for seen, own in zip(rounded.tolist(), true.tolist(), strict=True)
    ]
    assert np.std(errors) == pytest.approx(hitch.angle_at(30.0).stddev, rel=0.03)
    both = replace(hitch, angle_stddev=0.05).angle_at(30.0).stddev
    assert both == math.hypot(0.05, hitch.angle_at(30.0).stddev)


@pytest.mark.parametrize("percent", [-0.4, 100.4, 101.6, 102.0, math.nan, math.inf])
def test_positions_outside_the_range(percent: float) -> None:
    """Beyond 0 to 100 %, where the bus says "error" or "not available", there is no angle."""
    assert math.isnan(PercentInput((0.0, 3.1, 100.0, 1.7)).angle_at(percent).crank_angle)


@pytest.mark.parametrize(
    ("calibration", "words"),
    [
        ((), "has 0 numbers; give at least two pairs"),
        ((0.0, 1.0), "has 2 numbers; give at least two pairs"),
        ((0.0, 1.0, 50.0, 2.0, 100.0), "has 5 numbers; give at least two pairs"),
        ((0.0, 1.0, 99.0, 2.0), "from 0 to 99 %"),
        ((0.0, 1.0, 60.0, 2.0, 40.0, 3.0, 100.0, 4.0), r"position 3 \(40 %\)"),
        ((0.0, 1.0, 50.0, 2.0, 50.0, 3.0, 100.0, 4.0), r"position 3 \(50 %\)"),
        ((0.0, 1.0, 50.0, 2.0, 50.0 + 1e-9, 3.0, 100.0, 4.0), r"position 3 \(50 %\)"),
        ((0.0, 1.0, 50.0, 2.0, 100.0, 1.5), r"angle 3 \(1.5 rad\)"),
        ((0.0, 1.0, 50.0, 1.0, 100.0, 0.5), r"angle 2 \(1 rad\)"),
        ((0.0, 3.0, 50.0, 2.0, 100.0, 2.0), r"angle 3 \(2 rad\)"),
        ((0.0, 1.0, 100.0, math.nan), "must be finite"),
        ((0.0, 180.0, 100.0, 90.0), r"exceeds a full turn; .* in degrees, write 3\.14159"),
        ((0.0, 1e308, 100.0, -1e308), "exceeds a full turn"),
    ],
)
def test_calibrations_that_cannot_be_used(calibration: tuple[float, ...], words: str) -> None:
    """The error names the point at which a calibration is not strictly monotone."""
    with pytest.raises(InputError, match=words):
        PercentInput(calibration)


@pytest.mark.parametrize("name", INPUTS)
def test_fields_of_an_input_are_parameters_of_the_node(name: str) -> None:
    """Every input in the list can be made from the default parameters."""
    chosen = Parameters(input=name).crank_input()
    assert type(chosen) is INPUTS[name]
    assert chosen.describe("/topic").endswith("on /topic")
