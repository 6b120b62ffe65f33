# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Crank angles from joint states and hitch positions."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.bags.scalar_reader import NumberReader, ReadingError, Scalar
from linkage_vibration.bags.schemas import schema_of_store
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs.presets import PRESETS
from linkage_vibration.prediction.inputs.units import (
    PERCENT_STEP,
    HitchCurve,
    HitchScale,
    InputError,
    Reading,
    wrong_unit,
)
from linkage_vibration.prediction.settings import ParameterError, Parameters, with_values

STORE = get_typestore(Stores.LATEST)
JOINTS, FLOATS = (schema_of_store(STORE, kind) for kind in (JOINT_STATE, FLOAT64))
RECEIVED = 1_700_000_000 * 10**9 + 5


def state(names: list[str], positions: list[float], velocities: list[float] | None = None) -> bytes:
    """Return a joint state in CDR."""
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=3, nanosec=4)
    header = STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id="base")
    numbers = [np.array(each or [], float) for each in (positions, velocities, [])]
    return bytes(
        STORE.serialize_cdr(STORE.types[JOINT_STATE](header, names, *numbers), JOINT_STATE)
    )


def joint_reader(name: str) -> NumberReader:
    """Return a reader of the position of a joint."""
    return Parameters(joint_name=name).crank_input(JOINTS).reader


def float64(value: float) -> bytes:
    """Return a number in CDR."""
    return bytes(STORE.serialize_cdr(STORE.types[FLOAT64](value), FLOAT64))


def percent_input(percents: Sequence[float], angles: Sequence[float]) -> HitchScale:
    """Return the scale with these points of its calibration (%, rad)."""
    pairs = tuple(v for pair in zip(percents, angles, strict=True) for v in pair)
    return HitchScale("percent", calibration=HitchCurve(pairs))


def test_position_is_found_by_name() -> None:
    """The order of the names does not matter; a message about other joints gives no reading."""
    joint = joint_reader("b")
    for names, positions in ((["a", "b"], [1.0, 2.0]), (["b", "a"], [2.0, 1.0])):
        assert joint.read_one(state(names, positions))[:1] == (2.0,)  # type: ignore[index]
    for others in (state(["a"], [1.0]), state(["a"], []), state([], [])):
        assert joint.read_one(others) is None


def test_crank_angle_and_velocity() -> None:
    """Angle = sign * scale * position + offset, and the velocity is turned and scaled alike."""
    settings = Parameters(
        joint_name="b", hitch_sign=-1, hitch_scale=0.5, hitch_offset=2.0, angle_stddev=0.01
    )
    reading = settings.crank_input(JOINTS).read_one(state(["b"], [0.25], [4.0]), RECEIVED)
    assert reading == (Reading(1.875, -2.0, 0.01), 3, 4, "base", RECEIVED)


@pytest.mark.parametrize("velocities", [[], [1.0], [1.0, 2.0, 3.0]])
def test_velocity_that_belongs_to_no_joint(velocities: list[float]) -> None:
    """The velocity is unknown unless there is one for each name."""
    reading = joint_reader("b").read_one(state(["a", "b"], [1.0, 2.0], velocities))
    assert reading is not None
    assert math.isnan(reading.rate)


@pytest.mark.parametrize(
    ("names", "positions", "words"),
    [
        (["b"], [], "1 names but 0 elements in position"),
        (["a", "b"], [1.0], "2 names but 1 elements in position"),
        (["b"], [1.0, 2.0], "1 names but 2 elements in position"),
        (["b", "b"], [1.0, 2.0], "contains the name b 2 times"),
    ],
)
def test_unreliable_readings(names: list[str], positions: list[float], words: str) -> None:
    """Arrays of different lengths and a repeated joint are reported."""
    with pytest.raises(ReadingError, match=words):
        joint_reader("b").read_one(state(names, positions))


def test_hitch_position_through_a_calibration() -> None:
    """The curve passes through the points, whether the angle falls or rises with the hitch."""
    percents, angles = (0.0, 40.0, 100.0), (3.1, 2.6, 1.7)
    for sign in (1.0, -1.0):
        hitch = percent_input(percents, [sign * angle for angle in angles])
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
    hitch = percent_input(percents, 3.1 - np.cumsum([0.0, *steps]))
    actual = [hitch.reading(p).crank_angle for p in np.linspace(0.0, 100.0, 251)]
    assert (np.diff(actual) <= 1e-12).all()


def test_resolution_of_the_bus_is_an_uncertainty() -> None:
    """The reading gives the error that steps of 0.4 % cause, and adds the given deviation."""
    hitch = percent_input((0.0, 50.0, 100.0), (3.1, 2.2, 1.8))
    true = np.random.default_rng(4).uniform(29.0, 31.0, 20_000)
    rounded = PERCENT_STEP * np.rint(true / PERCENT_STEP)
    errors = [
        hitch.reading(seen).crank_angle - hitch.reading(own).crank_angle
        for seen, own in zip(rounded.tolist(), true.tolist(), strict=True)
    ]
    assert np.std(errors) == pytest.approx(hitch.reading(30.0).stddev, rel=0.03)
    both = replace(hitch, angle_stddev=0.05).reading(30.0).stddev
    assert both == math.hypot(0.05, hitch.reading(30.0).stddev)


@pytest.mark.parametrize("percent", [-0.4, 100.4, 101.6, 102.0, math.nan, math.inf])
def test_positions_outside_the_range(percent: float) -> None:
    """Beyond 0 to 100 %, where the bus says "error" or "not available", there is no angle."""
    assert math.isnan(percent_input((0.0, 100.0), (3.1, 1.7)).reading(percent).crank_angle)


@pytest.mark.parametrize(
    ("calibration", "words"),
    [
        ((), "has 0 numbers; give at least two pairs"),
        ((0.0, 1.0), "has 2 numbers; give at least two pairs"),
        ((0.0, 1.0, 50.0, 2.0, 100.0), "has 5 numbers; give at least two pairs"),
        ((0.0, 1.0, 99.0, 2.0), "from 0 to 99 %"),
        ((0.0, 1.0, 60.0, 2.0, 40.0, 3.0, 100.0, 4.0), r"position 3 \(40\)"),
        ((0.0, 1.0, 50.0, 2.0, 50.0, 3.0, 100.0, 4.0), r"position 3 \(50\)"),
        ((0.0, 1.0, 50.0, 2.0, 50.0 + 1e-9, 3.0, 100.0, 4.0), r"position 3 \(50\)"),
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
        HitchScale("percent", calibration=HitchCurve(calibration))


def test_velocity_through_a_calibration() -> None:
    """The velocity of a hitch position becomes that of the angle, by the slope of the curve."""
    hitch = replace(percent_input((0.0, 50.0, 100.0), (3.1, 2.2, 1.8)), sign=-1, offset=100.0)
    step = 1e-6
    low, high = (hitch.reading(70.0 + move).crank_angle for move in (-step, step))
    assert hitch.reading(70.0, 5.0).velocity == pytest.approx(
        5.0 * (high - low) / (2.0 * step), rel=1e-6
    )


def test_units_of_the_hitch() -> None:
    """Degrees and the stroke of a cylinder become the angles that they mean."""
    assert HitchScale("deg", offset=90.0).reading(45.0, 180.0) == Reading(
        pytest.approx(0.75 * math.pi), pytest.approx(math.pi), 0.0
    )
    # The cylinder between a pin 0.6 m from the crank's joint and one 0.25 m from it, by cosines.
    lengths = np.linspace(0.45, 0.75, 40)
    angles = np.arccos((0.6**2 + 0.25**2 - lengths**2) / (2.0 * 0.6 * 0.25))
    pairs = np.column_stack([lengths - lengths[0], angles]).ravel().tolist()
    hitch = HitchScale("m", calibration=HitchCurve(tuple(pairs)))
    true = math.acos((0.6**2 + 0.25**2 - 0.6**2) / (2.0 * 0.6 * 0.25))
    assert hitch.reading(0.15).crank_angle == pytest.approx(true, abs=1e-4)
    assert math.isnan(hitch.reading(0.31).crank_angle)
    with pytest.raises(InputError, match=r"from 0 to 100 m, which no hitch does; give pairs"):
        HitchScale("m")


@pytest.mark.parametrize("name", PRESETS)
def test_presets(name: str) -> None:
    """Every preset has a unit of its input, and the default one can be read."""
    for key, preset in PRESETS[name].items():
        changes = {f"{name}_input": key}
        chosen = with_values(Parameters(), changes)
        assert chosen.source(name).topic == preset.topic
        with_values(chosen, {f"{name}_unit": preset.unit})
    settings = Parameters()
    if name == "hitch":
        crank: Any = settings.crank_input(JOINTS)
    else:
        crank = settings.speed_input(Source(name), FLOATS)
    assert crank.describe("/topic").endswith("on /topic")


def test_speeds_in_their_units() -> None:
    """A speed is sign * scale * number + offset in its unit; NaN stays NaN."""
    for changes, number, expected in (
        ({"engine_unit": "rad/s"}, 2.0 * math.pi, 60.0),
        ({"engine_unit": "Hz", "engine_scale": 0.5}, 10.0, 300.0),
        ({"engine_offset": 100.0, "engine_sign": -1}, 30.0, 70.0),
        ({}, math.nan, math.nan),
    ):
        speed = with_values(Parameters(), changes).speed_input(Source.ENGINE, FLOATS)
        assert speed.read_one(float64(number), RECEIVED) == pytest.approx(
            (expected, RECEIVED), nan_ok=True
        )
    ground = Parameters(ground_unit="km/h").speed_input(Source.GROUND, FLOATS)
    assert ground.read_one(float64(-7.2), 0) == (pytest.approx(-2.0), 0)


def test_fixed_position() -> None:
    """A fixed position in its unit is the crank angle at rest, whatever the other number is."""
    data = state(["b"], [2.0], [7.0])
    for changes, angle in (
        ({"hitch_position": 2.5}, 2.5),
        (
            {"hitch_position": 90.0, "hitch_unit": "deg", "hitch_sign": -1, "hitch_scale": 3.0},
            math.pi / 2.0,
        ),
        ({"hitch_position": 100.0, "hitch_input": "percent"}, 1.5708),
    ):
        speed = {"engine_type": JOINT_STATE, "engine_field": "velocity[b]", "engine_topic": "a"}
        settings = with_values(Parameters(), speed | changes)
        assert settings.source("hitch").topic == "a"
        crank = settings.crank_input(JOINTS)
        reading = crank.read_one(data, RECEIVED)
        assert reading is not None
        assert (reading[0].crank_angle, reading[0].velocity) == (
            pytest.approx(angle, abs=1e-12),
            0.0,
        )
        columns = crank.scale.columns(np.array([math.nan]), np.array([1.0]))
        assert (columns[0].tolist(), columns[1].tolist()) == ([reading[0].crank_angle], [0.0])
        assert crank.describe("/a").startswith(f"hitch position {changes['hitch_position']:g} ")
    # The first speed that is not fixed gives the moments; `hitch_field` names another number.
    later = with_values(Parameters(), {"hitch_position": 2.5, "engine_speed": 1800.0})
    assert later.source("hitch").topic == "pto_speed"
    named = with_values(later, {"hitch_field": "position[b]"})
    assert named.source("hitch").topic == "joint_states"


def test_origin_of_the_time() -> None:
    """The stamp is that of the header, or the time of receipt less the delay."""
    data = state(["b"], [2.0])
    later = {"joint_name": "b", "hitch_time": "receipt", "hitch_delay": 0.25}
    reading = with_values(Parameters(), later).crank_input(JOINTS).read_one(data, RECEIVED)
    assert reading is not None
    assert (reading[1], reading[2], reading[4]) == (
        *divmod(RECEIVED - 250_000_000, 10**9),
        RECEIVED - 250_000_000,
    )
    joint_speed = {"engine_type": JOINT_STATE, "engine_field": "velocity[b]"}
    moving = state(["b"], [2.0], [7.0])
    for changes, time in (
        ({}, RECEIVED),
        ({"engine_delay": 1.5}, RECEIVED - 1_500_000_000),
        ({"engine_time": "header"}, 3_000_000_004),
    ):
        speed = with_values(Parameters(), {**joint_speed, **changes})
        assert speed.speed_input(Source.ENGINE, JOINTS).read_one(moving, RECEIVED) == (7.0, time)
    with pytest.raises(
        InputError, match=r"Float64 do not begin with a header; write `pto_time: rec"
    ):
        Parameters(pto_time="header").speed_input(Source.PTO, FLOATS)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"engine_unit": "percent"}, "engine_unit must be rpm or rad/s or Hz, .* not 'percent'"),
        ({"ground_unit": "rpm"}, "ground_unit must be m/s or km/h"),
        ({"hitch_unit": "rpm"}, "hitch_unit must be rad or deg or percent or m or any"),
        ({"hitch_unit": "m"}, "calibration reaches from 0 to 100 m"),
        ({"hitch_unit": "percent", "calibration": [0.0, 1.0, 0.5, 2.0]}, "from 0 to 0.5 %"),
        (
            {"hitch_input": "can", "hitch_position": 100.1},
            "hitch_position is 100.1, but calibration re",
        ),
        ({"engine_input": "percent"}, "engine_input must be float64"),
        ({"pto_time": "header", "pto_delay": 1.0}, "pto_delay is subtracted from the time of rec"),
        ({"hitch_type": "Frame"}, "hitch_type must be a type such as nav_msgs/msg/Odometry"),
        ({"hitch_topic": "a b"}, "hitch_topic must be the name of a topic"),
    ],
)
def test_parameters_that_do_not_fit(changes: dict[str, Any], words: str) -> None:
    """A unit of another quantity, a calibration of another unit and a useless delay are refused."""
    with pytest.raises(ParameterError, match=words):
        with_values(Parameters(), changes)


@pytest.mark.parametrize("name", ["7", "a]b", "a.b", "{joint_name}", "ä b"])
def test_names_of_joints(name: str) -> None:
    """A joint is found by any name, also by one that looks like a place or a path."""
    number = joint_reader(name).read_one(state(["a", name], [1.0, 2.0]))
    assert number is not None
    assert number.value == 2.0


def test_fields_of_joint_states() -> None:
    """Any field of a joint state can be read; a wrong path is answered with those that exist."""
    data = state(["a", "b"], [1.0, 2.0], [3.0, 4.0])
    for path, value in (("velocity[b]", 4.0), ("position[1]", 2.0), ("header.stamp.sec", 3.0)):
        read = Parameters(hitch_field=path).crank_input(JOINTS).reader.read_one
        assert read(data) == pytest.approx(Scalar(value, math.nan, 3, 4, "base"), nan_ok=True)
    with pytest.raises(
        InputError, match=r"hitch_field: .* no number 'positions\[b\]'; did you mean position\[NAME"
    ):
        Parameters(hitch_field="positions[b]").crank_input(JOINTS)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"joint_name": "c"}, "Set joint_name"),
        ({"hitch_field": "position[c]"}, "Write one of them in the brackets of hitch_field."),
        ({"hitch_field": "velocity[c]"}, "Write one of them in the brackets of hitch_field."),
    ],
)
def test_name_that_messages_do_not_have(parameters: dict[str, str], words: str) -> None:
    """The remedy names the parameter that decides; hitch_field replaces joint_name."""
    reader = Parameters(**parameters).crank_input(JOINTS).reader  # type: ignore[arg-type]
    names = reader.other_names(state(["a", "b"], [1.0, 2.0], [3.0, 4.0]))
    sentence = reader.explain_missing("/joint_states", names)
    assert "[c]; it has a, b. " in sentence or "joint c; it has a, b. " in sentence
    assert words in sentence
    assert ("joint_name" in sentence) == ("joint_name" in parameters)


@pytest.mark.parametrize(
    ("stated", "expected", "name", "words"),
    [
        ("km/h", "m/s", "ground", "is in km/h, but ground_unit is m/s; write `ground_unit: km/h`."),
        ("mph", "m/s", "ground", "is in mph, but ground_unit is m/s; write ground_scale, the m/s"),
        ("%", "deg", "hitch", "is in percent, but hitch_unit is deg; write `hitch_unit: percent`."),
        ("V", "percent", "hitch", "write `hitch_unit: any` and a calibration in this unit."),
        ("rad/s", "rpm", "pto", "is in rad/s, but pto_unit is rpm; write `pto_unit: rad/s`."),
    ],
)
def test_stated_unit(stated: str, expected: str, name: str, words: str) -> None:
    """A unit that is stated to be another one is named; an unknown or a free one is accepted."""
    assert words in wrong_unit(stated, expected, name)
    assert not any(wrong_unit(stated, own, name) for own in ("", "any"))
    assert not wrong_unit(f" {expected.upper()} ", expected, name)
    assert not wrong_unit("furlong", expected, name)


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        ((0.0, 1.0, 1.0, 6.283), ""),
        ((0.0, 1.0, 1.0, 6.284), "exceeds a full turn"),
        ((0.0, 1.0, 1.0, -6.284), "exceeds a full turn"),
        ((0.0, 1.0, 0.99e-5, 1.1, 1.0, 2.0), "must ascend, but position 2"),
        ((0.0, 1.0, 1.01e-5, 1.1, 1.0, 2.0), ""),
        ((0.0, 1.0, 1.0, 2.0, 2.0, 2.0), "angle 3 .* does not continue"),
        ((0.0, 1.0), "has 2 numbers"),
        ((0.0, 1.0, 1.0), "has 3 numbers"),
        ((0.0, 1.0, 1.0, 2.0, 3.0), "has 5 numbers"),
        ((0.0, 1.0, math.inf, 2.0), "must be finite"),
    ],
)
def test_limits_of_calibrations(pairs: tuple[float, ...], words: str) -> None:
    """Angles up to a turn, and positions a hundred-thousandth of the range apart, are allowed."""
    if not words:
        assert HitchCurve(pairs).pairs == pairs
        return
    with pytest.raises(InputError, match=words):
        HitchCurve(pairs)


def test_longest_calibration_in_metres() -> None:
    """No part of a hitch moves by more than 10 m."""
    assert HitchScale("m", calibration=HitchCurve((-10.0, 1.0, 10.0, 2.0)))
    for ends in ((-10.1, 9.0), (-9.0, 10.1)):
        with pytest.raises(InputError, match="which no hitch does"):
            HitchScale("m", calibration=HitchCurve((ends[0], 1.0, ends[1], 2.0)))


def test_ends_of_a_calibration_belong_to_it() -> None:
    """At the ends there is an angle, and beyond them none; a sign and an offset move the ends."""
    line = HitchCurve((0.0, 3.0, 100.0, 1.0))
    plain = HitchScale("any", calibration=line)
    assert [plain.reading(x).crank_angle for x in (0.0, 25.0, 100.0)] == [3.0, 2.5, 1.0]
    assert all(math.isnan(plain.reading(x).crank_angle) for x in (-1e-9, 100.0 + 1e-9))
    moved = HitchScale("any", sign=-1, scale=20.0, offset=110.0, calibration=line)
    reading = moved.reading(0.5, 0.25)  # a position of 100, which falls by 5 in a second
    assert reading.crank_angle == pytest.approx(1.0)
    assert reading.velocity == pytest.approx(0.1)
    actual = moved.columns(np.array([0.5, 5.5]), np.array([0.25, math.nan]))
    np.testing.assert_allclose(actual[0], [1.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(actual[1], [0.1, math.nan])
    assert actual[2].tolist() == [0.0, 0.0]
