# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The ground as one of the excitations: its description, levels, states, sentences and logs."""

import math
from functools import cache
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
import pytest
from scipy.integrate import trapezoid

from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.ground import MAX_OFF_GROUND, ground_spectrum
from linkage_vibration.prediction.levels import LevelTable, kept_levels
from linkage_vibration.prediction.loads import ExcitationError
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor
from linkage_vibration.prediction.resonance import described as with_derived
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.prediction.severity import (
    DEFAULT_LIMITS,
    ResonanceState,
    WarningLimits,
    present_sentence,
)
from linkage_vibration.readers.excitations import excitation_files, read_excitations
from linkage_vibration.readers.loaded_model import load_model, read_loads
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import (
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    PAPER_MECHANISM,
    PAPER_TABLE,
    config_file,
)
from linkage_vibration.table.table import load_table

GROUND = {"speed": "ground", "terrain": {"class": "C"}, "raised": True}
SHAFT = {"speed": "pto", "orders": [1], "force": [400.0], "at": "E1.z", "at_speed": 540.0}
ALPHA3, SPEED, PTO = math.radians(135.0), 8.0, 540.0


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """Return what looks up the table of the shipped tractor."""
    return Predictor(load_table(config_file(DEFAULT_TABLE)))


def described(**changes: Any) -> tuple[Excitation, ...]:
    """Return a shaft, and the ground with changes of its keys."""
    return excitations_from_mapping({"shaft": SHAFT, "field": GROUND | changes})


@cache
def levels_of(predictor: Predictor, excitations: tuple[Excitation, ...]) -> LevelTable:
    """Return the levels of excitations on the shipped tractor."""
    return kept_levels(predictor, read_mechanism(config_file(DEFAULT_MECHANISM)), excitations)


def test_class_and_roughness_are_the_same_ground() -> None:
    """Class C of ISO 8608 has 256e-6 m3 at 0.1 1/m, and lugs are a part of the circumference."""
    _, first = described(lugs=20, rolling_radius=0.8)
    _, other = described(terrain={"roughness": 256e-6, "exponent": 2.0, "reference": 0.1})
    assert (first.name, other.name) == ("field (class C)", "field")
    assert first.terrain is not None
    assert other.terrain is not None
    terrains = first.terrain, other.terrain
    actual, expected = (each.psd(np.array([3.0]), np.array(8.0)) for each in terrains)
    assert actual == pytest.approx(expected, rel=1e-12)
    assert first.terrain.lug_pitch == pytest.approx(math.tau * 0.8 / 20)
    assert (first.terrain.relative_stddev, other.terrain.relative_stddev) == (0.2, 0.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"raised": None}, "field.raised: None is neither true nor false"),
        ({"terrain": {}}, "field.terrain: give a class, a roughness, or a profile"),
        ({"terrain": "C"}, "field.terrain: 'C' is not a mapping"),
        ({"terrain": {"class": "X"}}, "terrain.class: 'X' is not one of: A, B"),
        ({"terrain": {"class": "C", "exponent": 2.0}}, "terrain.exponent: this key is not known"),
        (
            {"terrain": {"roughness": 256.0, "exponent": 2.0, "reference": 0.1}},
            "terrain.roughness: 256 is above 1; give 1e-09 to 1",
        ),
        ({"terrain": {"profile": "a/road.csv"}}, "profile: a/road.csv is not beside this file"),
        ({"terrain": {"profile": r"a\road.csv"}}, r"road\.csv is not beside this file"),
        ({"lugs": 20}, "field.rolling_radius: this key is missing"),
        ({"rolling_radius": 0.8}, "field.lugs: this key is missing"),
        ({"speed": "pto"}, "field.speed: wheels follow"),
        ({"band_hz": [5.0, 1.0]}, r"field.band_hz: \[5, 1\] does not ascend from above zero"),
        ({"orders": [1]}, "field.orders: this key is not known"),
        ({"amplitude_stddev": 2.0}, "field.amplitude_stddev: 2 is above 1; give 0 to 1"),
    ],
)
def test_invalid_descriptions(changes: dict[str, Any], words: str) -> None:
    """The error names the key and the fix."""
    with pytest.raises(ExcitationError, match=words):
        described(**changes)


def test_whether_tools_are_raised_must_be_said_and_there_is_one_ground() -> None:
    """Neither is guessed."""
    silent = {key: value for key, value in GROUND.items() if key != "raised"}
    with pytest.raises(ExcitationError, match="write true if no tool is in the soil"):
        excitations_from_mapping({"field": silent})
    with pytest.raises(ExcitationError, match=r"b \(class C\) is a second terrain"):
        excitations_from_mapping({"a": GROUND, "b": GROUND})


def test_profile(tmp_path: Path) -> None:
    """A profile is read beside its file, and a log keeps both."""
    step, rng = 0.1, np.random.default_rng(5)
    heights = np.cumsum(rng.standard_normal(20_000)) * 1e-3
    rows = [f"{step * i:.3f},{height:.6f}" for i, height in enumerate(heights)]
    (tmp_path / "road.csv").write_text("\n".join(rows) + "\n")
    path = tmp_path / "mine.yaml"
    path.write_text("field: {speed: ground, terrain: {profile: road.csv}, raised: true}\n")
    [first] = read_excitations(path)
    assert first.terrain is not None
    assert first.name == "field (road.csv)"
    # The density of a random walk with steps of variance s^2 is 2 s^2 / (step (2 pi n)^2).
    n, expected = 0.5, 2.0 * 1e-6 / (step * (math.tau * 0.5) ** 2)
    density = first.terrain.psd(np.array([n * SPEED]), np.array(SPEED))[0] * SPEED
    assert density == pytest.approx(expected, rel=0.15)
    assert first.terrain.exponent == pytest.approx(2.0, abs=0.1)
    assert set(excitation_files(path)) == {"excitations.yaml", "road.csv"}


def test_the_total_is_that_of_orders_and_ground(predictor: Predictor) -> None:
    """Squares add up: of velocities, and of forces in each pin; the ground is that of its sum."""
    both = described()
    speeds = np.array([[0.0], [PTO], [SPEED]])
    actual, shaft, ground = (
        levels_of(predictor, part).at(np.array([ALPHA3]), speeds)
        for part in (both, both[:1], both[1:])
    )
    for name in ("total_velocity", "total_acceleration"):
        parts = [float(getattr(part, name)[0]) for part in (shaft, ground)]
        assert getattr(actual, name)[0] == pytest.approx(math.hypot(*parts), rel=1e-5)
    total, parts = actual.total_load_ratio[0], actual.load_ratios[0]
    assert parts.max() < total <= math.hypot(*parts) * (1.0 + 1e-6)
    assert np.isnan(actual.amplifications[0, 1])
    assert both[1].terrain is not None
    place = ("E1", "z")
    hertz, density = ground_spectrum(
        predictor.table,
        read_mechanism(config_file(DEFAULT_MECHANISM)),
        both[1].terrain,
        place,
        ALPHA3,
        SPEED,
    )
    mean = trapezoid(density, hertz)
    assert actual.velocities[0, 1] == pytest.approx(math.sqrt(mean), rel=2e-3)


def assessed(
    predictor: Predictor,
    excitations: tuple[Excitation, ...],
    speed: float,
    seconds: float = 3.0,
    limits: WarningLimits = DEFAULT_LIMITS,
) -> MessageColumns:
    """Return the last message after some time at 50 Hz, with the shaft at rest."""
    monitor = ResonanceMonitor(excitations, limits, levels=levels_of(predictor, excitations))
    prediction = predictor.predict(ALPHA3)
    for i in range(1, round(50 * seconds) + 1):
        time = 20_000_000 * i
        monitor.set_speed(Source.PTO, 0.0, time)
        monitor.set_speed(Source.GROUND, speed, time)
        message = monitor.assess(prediction, 0.0, time)
    return with_derived(message)


def test_levels_over_angles_and_speeds_are_those_of_each_pair(predictor: Predictor) -> None:
    """To the last bit, also where an angle or a speed is not known, or lies outside the table."""
    levels = levels_of(predictor, read_excitations(config_file("excitations.yaml")))
    angles = np.append(np.linspace(1.4, 3.2, 70), math.nan)
    speeds = np.array([[1800.0] * 4, [math.nan] * 4, [0.0, 3.0, 9.0, math.nan]])
    together = vars(levels.at_all_pairs(angles, speeds))
    each = vars(levels.at(np.repeat(angles, 4), np.tile(speeds, len(angles))))
    assert np.isfinite(each["total_load_ratio"]).sum() > 100
    for name, values in each.items():
        np.testing.assert_array_equal(together[name], values)


@pytest.mark.parametrize(
    ("name", "state"),
    [
        pytest.param("A", ResonanceState.CLEAR, marks=pytest.mark.nightly),
        pytest.param("B", ResonanceState.NOTE, marks=pytest.mark.nightly),
        ("C", ResonanceState.WARNING),
    ],
)
def test_states_of_the_ground(predictor: Predictor, name: str, state: ResonanceState) -> None:
    """They follow its load ratio, which doubles from class to class: clear, note and warning."""
    actual = assessed(predictor, described(terrain={"class": name}), 9.0)
    assert (actual.state, actual.excitation) == (state, f"field (class {name})")
    assert math.isnan(actual.excitation_frequency)
    assert math.isnan(actual.natural_frequency)
    assert math.isnan(actual.probability)
    assert actual.excitation_speed == 9.0
    assert actual.ground_unknown == ""


def test_a_slower_speed_ends_a_warning(predictor: Predictor) -> None:
    """The sentence names it; at rest, the ground is clear."""
    actual = assessed(predictor, described(), 9.0)
    assert actual.load_ratio > 0.33
    text = present_sentence(actual, described())
    assert text.startswith(f"field (class C) at 32.4 km/h exerts {actual.load_ratio:.2g} of the")
    assert f"It ends at a ground speed of {3.6 * actual.quiet_speed:.3g} km/h" in text
    slower = assessed(predictor, described(), float(actual.quiet_speed))
    assert slower.state != ResonanceState.WARNING
    assert assessed(predictor, described(), 0.0).state == ResonanceState.CLEAR


@pytest.mark.nightly(short="test_a_slower_speed_ends_a_warning")
def test_no_speed_is_named_where_it_is_not_known(predictor: Predictor) -> None:
    """At a slower speed, too few lugs leave the level unknown."""
    lugged = assessed(predictor, described(lugs=8, rolling_radius=0.8), 9.0)
    assert (lugged.state, math.isnan(lugged.quiet_speed)) == (ResonanceState.WARNING, True)


def test_a_tyre_in_the_air_is_a_warning(predictor: Predictor) -> None:
    """The level is not known there, and the total is that of the orders alone, but not calm."""
    rough = described(terrain={"class": "F"})
    actual = assessed(predictor, rough, SPEED)
    assert actual.off_ground_share > MAX_OFF_GROUND
    assert math.isnan(actual.load_ratio)
    assert actual.total_load_ratio == 0.0
    assert actual.state == ResonanceState.WARNING
    text = present_sentence(actual, rough)
    assert "field (class F) at 28.8 km/h lifts a tyre off the ground" in text
    assert "The level of the ground is not known: a tyre is off the ground" in text
    if not math.isnan(actual.quiet_speed):
        after = assessed(predictor, rough, float(actual.quiet_speed))
        assert after.off_ground_share <= MAX_OFF_GROUND


@pytest.mark.parametrize(("factor", "lifts"), [(0.995, False), (1.005, True)])
def test_an_order_that_lifts_a_tyre_warns(predictor: Predictor, factor: float, lifts: bool) -> None:
    """It does so from a ratio of 1 / 0.8416 on, also where pins are far below their limit."""
    tyre = {"speed": "ground", "rolling_radius": 0.8, "orders": [1], "at_speed": 5.0}
    tyre["at"] = "base:front_axle.z"

    def of_runout(size: float) -> tuple[Excitation, ...]:
        return excitations_from_mapping({"tyre": tyre | {"base_displacement": [size]}})

    small = assessed(predictor, of_runout(1e-2), SPEED).off_ground_share
    ratio = -1.0 / NormalDist().inv_cdf(float(small))
    runout = of_runout(1e-2 * factor / (-NormalDist().inv_cdf(MAX_OFF_GROUND) * ratio))
    actual = assessed(predictor, runout, SPEED, limits=WarningLimits(warning=10.0))
    assert actual.load_ratio < 10.0
    assert (actual.state == ResonanceState.WARNING) is lifts
    text = present_sentence(actual, runout)
    assert ("and they lift a tyre off the ground for 0.2 of the time." in text) is lifts


def test_an_unknown_ground_is_not_clear(predictor: Predictor) -> None:
    """With a tool in the soil there is no level, no total without orders, and a reason."""
    working = excitations_from_mapping({"field": GROUND | {"raised": False}})
    actual = assessed(predictor, working, SPEED)
    assert actual.state == ResonanceState.UNKNOWN
    assert math.isnan(actual.total_load_ratio)
    assert "A tool is in the soil" in actual.ground_unknown
    text = present_sentence(actual, working)
    assert text.startswith("No load is known. The level of the ground is not known: a tool is in")
    with_shaft = described(raised=False)
    assert assessed(predictor, with_shaft, SPEED).total_load_ratio == 0.0
    blind = assessed(predictor, described(), math.nan)
    assert blind.states[1] == ResonanceState.UNKNOWN
    assert present_sentence(blind, described()).endswith(
        "The ground speed is not known or not fresh."
    )


def test_a_mechanism_without_wheels(tmp_path: Path) -> None:
    """The default ground is left out with a notice; that of a user's file has a reason."""
    settings = {"mechanism_file": PAPER_MECHANISM, "table_file": PAPER_TABLE}
    files = {key: str(config_file(name)) for key, name in settings.items()}
    served = load_model(Parameters(**files))
    path = tmp_path / "mine.yaml"
    path.write_text("field: {speed: ground, terrain: {class: C}, raised: true}\n")
    mine = read_loads(Parameters(**files, excitation_file=str(path)), served)
    values = LevelTable(served.predictor, served.mechanism, mine).at(
        np.array([ALPHA3]), np.array([[0.0], [0.0], [SPEED]])
    )
    assert "has no base on two or more mounts" in values.ground_unknown[0]
    assert np.isnan(values.total_velocity[0])
