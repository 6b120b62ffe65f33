# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Levels of vibration against the model, independent samples, and themselves one by one."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
import yaml

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.forces import tyre_place
from linkage_vibration.mechanics.ground_motion import transmissibility
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction import levels as levels_module
from linkage_vibration.prediction.doubts import excitation_doubts
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable, first_largest
from linkage_vibration.prediction.loads import ExcitationError, soil_motion
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import mechanism_of, read_mechanism
from linkage_vibration.support.resources import PAPER_TABLE, config_file
from linkage_vibration.table.table import Table, load_table
from linkage_vibration.table.tabulation.building import build_table
from test.support.in_plane import in_plane, plane_mechanism, plane_table

SPEEDS = {Source.ENGINE: 1800.0, Source.PTO: 540.0, Source.GROUND: math.nan}
ORDERS = {
    "engine": {"speed": "engine", "orders": [0.5, 1, 3]},
    "rotor": {
        "speed": "pto",
        "ratio": 0.45,
        "orders": [1, 2],
        "force": [150.0, 40.0],
        "at": "E2.x",
        "at_speed": 1080.0,
        "exponent": 2,
        "amplitude_stddev": 0.3,
    },
    "shaft": {
        "speed": "pto",
        "orders": [1, 2],
        "moment": [20.0, 30.0],
        "at": "implement",
        "at_speed": 540.0,
    },
    "lugs": {
        "speed": "ground",
        "rolling_radius": 0.8,
        "orders": [20],
        "force": [100.0],
        "at": "E1.z",
        "at_speed": 5.0,
    },
}
NAMES = ("three_point_linkage", "three_point_linkage_on_tractor")


def shipped(name: str, orders: dict[str, Any] = ORDERS) -> tuple[LevelTable, Mechanism, Predictor]:
    """Return the levels of a shipped linkage."""
    mechanism = read_mechanism(config_file(f"{name}.yaml"))
    predictor = Predictor(load_table(config_file(f"tables/{name}.npz")))
    return LevelTable(predictor, mechanism, excitations_from_mapping(orders)), mechanism, predictor


def speeds(**other: float) -> tuple[float, ...]:
    """Return the speeds of all sources."""
    return tuple(other.get(source.value, SPEEDS[source]) for source in Source)


def level_at(levels: LevelTable, alpha3: float, at: tuple[float, ...]) -> Any:
    """Return the levels at an angle and at speeds."""
    return levels.at(np.array([alpha3]), np.array([at]).T).message(0)


@pytest.mark.parametrize("name", NAMES)
def test_levels_are_those_of_the_model(name: str) -> None:
    """Velocity and acceleration are those of the FRF of the model times the load at this speed."""
    actual, mechanism, _ = shipped(name)
    model = LinkageModel(mechanism)
    for alpha3 in (1.6, 2.2345, 3.1):
        level, solution = level_at(actual, alpha3, speeds()), model.solve(alpha3)
        hertz = 540.0 * 0.45 / 60.0 * np.array([1.0, 2.0])
        frf = solution.frf([("E1", "z")], [("E2", "x")]).frf(hertz)[:, 0, 0]
        force = np.array([150.0, 40.0]) * (540.0 / 1080.0) ** 2
        velocity = 2.0 * math.pi * hertz * np.abs(frf) * force / math.sqrt(2.0)
        np.testing.assert_allclose(level.velocities[3:5], velocity, rtol=2e-4)
        acceleration = 2.0 * math.pi * hertz * velocity
        np.testing.assert_allclose(level.accelerations[3:5], acceleration, rtol=2e-4)
        # A moment does work on the rotation of the implement, whose places turn with it.
        first, other = (solution.configuration.place("implement", p) for p in ((0, 0), (0.438, 0)))
        lever, turn = other - first, 9.0
        across = np.array([-lever[1], lever[0]]) / (lever @ lever)
        receptance = solution.frf(
            [("E1", "z")], [("E1", "x"), ("E1", "z"), ("E2", "x"), ("E2", "z")]
        )
        turned = receptance.frf(np.array([turn]))[0, 0] @ np.concatenate([-across, across])
        moved = 2.0 * math.pi * turn * abs(turned) * 20.0 / math.sqrt(2.0)
        assert level.velocities[5] == pytest.approx(moved, rel=2e-4)
        drive = solution.drive_point
        at, static = np.abs(drive.frf(np.array([15.0, 0.0]))[:, 0, 0])
        assert level.amplifications[0] == pytest.approx(at / static, rel=2e-4)
        known = level.velocities[[3, 4, 5, 6]]
        assert level.total_velocity == pytest.approx(math.sqrt(float((known**2).sum())), rel=1e-6)
        assert np.isnan(level.velocities[[0, 1, 2, 7]]).all()  # no amplitude, and no speed


def with_implement(file: str, mass: float, inertia: float) -> Mechanism:
    """Return a shipped mechanism with another implement, kg and kg m2, and no uncertain numbers."""
    mapping = in_plane(yaml.safe_load(config_file(file).read_text(encoding="utf-8")))
    mapping["rigid_bodies"]["implement"] |= {"mass": mass, "inertia": inertia}
    del mapping["uncertainty"]
    return mechanism_of(mapping, config_file(file))


def check_velocity(mechanism: Mechanism, table: Table, angles: Sequence[float]) -> None:
    """Check the velocity by a force in a table with that of the unreduced model at angles, rad."""
    levels = LevelTable(Predictor(table), mechanism, excitations_from_mapping(ORDERS))
    model = LinkageModel(mechanism, reduced=False)
    for alpha3 in angles:
        frf = model.solve(alpha3).frf([("E1", "z")], [("E2", "x")])
        force = np.abs(frf.frf(np.array([4.05]))[0, 0, 0]) * 150.0 * (540.0 / 1080.0) ** 2
        velocity = 2.0 * math.pi * 4.05 * force / math.sqrt(2.0)
        level = level_at(levels, alpha3, speeds())
        assert level.velocities[3] == pytest.approx(velocity, rel=2e-4)
        assert math.isfinite(level.total_load_ratio)


def test_pieces_with_different_numbers_of_poles() -> None:
    """With a heavy implement, levels are those of the unreduced model on both sides of a piece."""
    mechanism = with_implement("three_point_linkage_on_tractor.yaml", 1500.0, 200.0)
    table = build_table(LinkageModel(mechanism))
    first, end, last = table.alpha3[table.pieces].tolist()
    poles = [len(table.frf(at, ["E1.z"], ["E1.z"]).stiffness) for at in (first, last)]
    assert poles[0] != poles[1]
    check_velocity(mechanism, table, [0.5 * (first + end), end - 1e-6, end, end + 1e-6, last])


@pytest.mark.nightly(short="test_pieces_with_different_numbers_of_poles")
@pytest.mark.parametrize("divided", [True, False])
def test_modes_that_nearly_coincide(divided: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Levels are known where two modes veer within a thousandth of the stroke.

    Where such a range may not be divided any more, a doubt names it, and levels beside it hold.
    """
    monkeypatch.setattr("linkage_vibration.prediction.levels._MOST_DIVIDED", 32 * divided)
    file = "starters/category_4.yaml"
    mapping = yaml.safe_load(config_file(file).read_text(encoding="utf-8"))
    body = mapping["rigid_bodies"]["implement"]
    mass = 0.15 * (4.0 / 0.15) ** (5.0 / 11.0)
    mechanism = with_implement(file, body["mass"] * mass, body["inertia"] * mass)
    table = build_table(LinkageModel(mechanism))
    check_velocity(mechanism, table, np.linspace(*table.alpha3_range, 5)[1:-1].tolist())
    orders = excitations_from_mapping({"rotor": ORDERS["rotor"]})
    levels = LevelTable(Predictor(table), mechanism, orders)
    doubts = [each for each in excitation_doubts(orders, levels) if "Levels" in each]
    assert len(doubts) == len(levels.gaps) == (not divided)
    for low, high in levels.gaps:
        assert f"{math.degrees(low):.6g} to {math.degrees(high):.6g} deg" in doubts[0]
        at = np.array([low - 1e-6, (low + high) / 2.0, high + 1e-6])
        rpm = np.array([[math.nan] * 3, [540.0] * 3, [math.nan] * 3])
        known = np.isfinite(levels.at(at, rpm).total_velocity)
        assert known.tolist() == [True, False, high < table.alpha3_range[1] - 1e-6]
        # The remedy of the doubt: a stroke that ends before these angles.
        ends = (table.alpha3_range[0], low - 1e-6)
        shorter = build_table(LinkageModel(replace(mechanism, stroke=ends)))
        assert LevelTable(Predictor(shorter), mechanism, orders).gaps == []


def test_places_that_are_divided_are_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where half of all cells are not accurate at any size, 32 ranges are divided."""
    table = load_table(config_file("tables/three_point_linkage_on_tractor.npz"))
    mechanism = read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    ends = []

    def refined(samples: levels_module._Samples) -> tuple[FloatArray, FloatArray, Any]:
        at, values = samples._along(8)
        ends.append(samples._ends)
        return at, values, np.arange(8) % 2 == 0

    monkeypatch.setattr(levels_module._Samples, "refined", refined)
    orders = excitations_from_mapping({"rotor": ORDERS["rotor"]})
    levels = LevelTable(Predictor(table), mechanism, orders)
    assert len(ends) == len(table.pieces) - 1 + 32
    lost = sum(high - low for low, high in levels.gaps)
    assert 0.0 < lost < 0.5 * (table.alpha3_range[1] - table.alpha3_range[0])


@pytest.mark.nightly(short="test_pieces_with_different_numbers_of_poles")
@pytest.mark.parametrize(
    "file",
    ["three_point_linkage_on_tractor.yaml", *(f"starters/category_{i}.yaml" for i in range(1, 5))],
)
def test_implements(file: str) -> None:
    """Levels are those of the unreduced model for light, heavy, compact and long implements."""
    body = yaml.safe_load(config_file(file).read_text(encoding="utf-8"))["rigid_bodies"][
        "implement"
    ]
    for mass, shape in product(np.geomspace(0.15, 4.0, 12), (0.5, 1.0, 2.0)):
        mechanism = with_implement(file, body["mass"] * mass, body["inertia"] * mass * shape)
        table = build_table(LinkageModel(mechanism))
        first, last = table.alpha3_range
        ends = table.alpha3[table.pieces].tolist()
        check_velocity(mechanism, table, [*ends, *np.linspace(first, last, 5)[1:-1]])


def test_shaft_at_rest() -> None:
    """A shaft that does not turn exerts nothing, whatever its exponent; an unknown speed is NaN."""
    shaft = {**ORDERS["shaft"], "exponent": -1}  # type: ignore[dict-item]
    orders = {"rotor": ORDERS["rotor"], "shaft": shaft}
    actual, _, _ = shipped("three_point_linkage_on_tractor", orders)
    still, unknown = (level_at(actual, 2.0, speeds(pto=pto)) for pto in (0.0, math.nan))
    for name in ("velocities", "accelerations", "load_ratios"):
        assert (getattr(still, name) == 0.0).all()
        assert np.isnan(getattr(unknown, name)).all()


def test_load_ratios_are_those_of_the_model() -> None:
    """A load ratio is the force of the unreduced model over its static force, worst over the pins.

    The total adds squares over the excitations in each pin or cylinder.
    """
    orders = {name: ORDERS[name] for name in ("rotor", "shaft")}
    actual, mechanism, _ = shipped("three_point_linkage_on_tractor", orders)
    model = LinkageModel(mechanism, reduced=False)
    for alpha3 in (1.7, 2.4, 3.0):
        level, solution = level_at(actual, alpha3, speeds()), model.solve(alpha3)
        static = model.reference_forces(alpha3)
        squares = []
        loads = [(4.05, ("E2", "x"), 37.5), (8.1, ("E2", "x"), 10.0)]
        for hertz, place, force in loads:
            rows = [place for place in model.forces.places if not place[0].startswith("base:")]
            frf = solution.frf([*rows], [place]).frf(np.array([hertz]))[0, :, 0]
            parts = np.abs(frf * force) ** 2 / 2.0
            names = [name for name, _ in rows]
            squares.append([sum(parts[[n == p for n in names]]) for p in dict.fromkeys(names)])
        ratios = np.sqrt(squares) / static[: len(squares[0])]  # tyres are last
        np.testing.assert_allclose(level.load_ratios[:2], ratios.max(axis=1), rtol=2e-3)
        assert level.load_places[:2].tolist() == ratios.argmax(axis=1).tolist()
        assert level.total_load_ratio >= np.sqrt((ratios**2).sum(axis=0)).max() * (1.0 - 2e-3)


def test_rounding_does_not_choose_a_pin() -> None:
    """Of two forces that are equal but for rounding, the first counts; a larger one is larger."""
    values = np.array([[1.0, 1.0, math.nan], [1.0 + 1e-12, 1.0 + 1e-5, math.nan], [0.5, 0.5, 1.0]])
    assert first_largest(values, values.max(axis=0)).tolist() == [0, 1, 0]
    assert first_largest(np.zeros((2, 1)), np.zeros(1)).tolist() == [0]


def test_accelerated_soil() -> None:
    """An acceleration of the soil moves the hitch as the model's transmissibility says."""
    mechanism = read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    model = LinkageModel(mechanism)
    predictor = Predictor(load_table(config_file("tables/three_point_linkage_on_tractor.npz")))
    road = {"speed": "ground", "rolling_radius": 0.8, "orders": [1], "base_acceleration": [0.3]}
    orders = {
        name: {**road, "at": place, "at_speed": 1.0}
        for name, place in (("all", "base.z"), ("rear", "base:rear_axle.x"))
    }
    levels = LevelTable(predictor, mechanism, excitations_from_mapping(orders))
    hertz = 8.0 / (2.0 * math.pi * 0.8)
    level = level_at(levels, 2.2, speeds(ground=8.0))
    solution = model.solve(2.2)
    for k, soil in enumerate((("base", "z"), ("base:rear_axle", "x"))):
        moved = transmissibility(solution, [("E1", "z")], soil).frf(np.array([hertz]))[0, 0, 0]
        acceleration = abs(moved) * 0.3 / math.sqrt(2.0)
        assert level.accelerations[k] == pytest.approx(acceleration, rel=2e-4)


def test_displaced_soil() -> None:
    """A runout r moves the hitch by |T| r, so its velocity is w |T| r, at any speed.

    T is the transmissibility of the model; the runout itself does not depend on the speed.
    """
    tyre = {"speed": "ground", "rolling_radius": 0.8, "orders": [1], "base_displacement": [2e-3]}
    orders = {"tyre": {**tyre, "at": "base:rear_axle.z", "at_speed": 5.0}}
    actual, mechanism, _ = shipped("three_point_linkage_on_tractor", orders)
    solution = LinkageModel(mechanism).solve(2.2)
    soil = transmissibility(solution, [("E1", "z")], ("base:rear_axle", "z"))
    for speed in (0.2, 8.0):
        moved = soil.frf(np.array([speed / (2.0 * math.pi * 0.8)]))[0, 0, 0]
        level = level_at(actual, 2.2, speeds(ground=speed))
        w = speed / 0.8
        velocity = w * abs(moved) * 2e-3 / math.sqrt(2.0)
        assert level.velocities[0] == pytest.approx(velocity, rel=2e-4)
        assert level.accelerations[0] == pytest.approx(w * velocity, rel=2e-4)


@pytest.mark.parametrize("name", NAMES)
def test_one_by_one_and_together(name: str) -> None:
    """Levels of one angle and of many are equal to the last bit, also outside the table."""
    actual, _, _ = shipped(name)
    rng = np.random.default_rng(1)
    alpha3 = np.concatenate([rng.uniform(1.6, 3.1, 67), [math.nan, 0.0, 2.0]])
    values = np.vstack([rng.uniform(0.0, 4000.0, (2, 70)), rng.uniform(0.0, 10.0, (1, 70))])
    values[:, ::7] = math.nan
    values[1, 3] = 0.0
    many = actual.at(alpha3, values)
    for i, angle in enumerate(alpha3.tolist()):
        first = level_at(actual, angle, tuple(values[:, i].tolist()))
        for name, expected in vars(many).items():
            np.testing.assert_array_equal(getattr(first, name), expected[i], name)
    assert np.isnan(many.amplifications[[67, 68]]).all()


def test_totals_of_nothing() -> None:
    """Amplitudes of zero add up to zero, and the total of what is not known is not known."""
    still = {**ORDERS["rotor"], "force": [0.0, 0.0]}  # type: ignore[dict-item]
    actual, _, _ = shipped("three_point_linkage_on_tractor", {"rotor": still})
    level, unknown = (level_at(actual, 2.0, speeds(pto=pto)) for pto in (540.0, math.nan))
    for name in ("total_velocity", "total_acceleration", "total_load_ratio"):
        assert getattr(level, name) == 0.0
        assert np.isnan(getattr(unknown, name))


def test_load_without_a_static_response() -> None:
    """A slow motion of the soil along x does not lift the hitch, so nothing is amplified."""
    road: dict[str, Any] = {"speed": "ground", "rolling_radius": 0.8, "orders": [1]}
    road["base_acceleration"] = [1.0]
    orders = {axis: {**road, "at": f"base.{axis}", "at_speed": 5.0} for axis in "xz"}
    actual, _, _ = shipped("three_point_linkage_on_tractor", orders)
    level = level_at(actual, 2.2, speeds(ground=5.0))
    assert np.isnan(level.amplifications).tolist() == [True, False]
    assert (level.velocities > 0.0).all()


def test_what_is_not_known() -> None:
    """Above the band, numbers are NaN."""
    actual, _, _ = shipped("three_point_linkage")
    level = level_at(actual, 2.0, speeds(engine=4100.0))
    assert np.isnan(level.amplifications[2])  # 205 Hz, while the band ends at 200 Hz
    assert not np.isnan(level.amplifications[1])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"at": "E9.z"}, r"has no place E9.z; give a point and a direction, such as E1.z"),
        ({"at": "P1.x"}, r"no FRF at P1, where P1.x acts; name them and E1 in .*--frf-points"),
        (
            {"force": None, "moment": [1.0], "at": "upper_link"},
            r"upper_link is not one; give one of",
        ),
        ({"force": None, "base_acceleration": [1.0], "at": "E1.z"}, r"no motion E1.z; name one of"),
    ],
)
def test_loads_that_cannot_be_used(changes: dict[str, Any], words: str) -> None:
    """The error names the excitation, the place, and what to do about it."""
    given = {"speed": "pto", "orders": [1], "force": [1.0], "at": "E1.z", "at_speed": 540.0}
    given = {key: value for key, value in (given | changes).items() if value is not None}
    with pytest.raises(ExcitationError, match=f"excitation rotor 1: .*{words}"):
        shipped("three_point_linkage_on_tractor", {"rotor": given})


def test_a_force_across_the_plane_needs_a_lateral_half() -> None:
    """The error names the key; test_both_halves.py has such a force."""
    given = {"speed": "pto", "orders": [1], "force": [1.0], "at": "E1.y", "at_speed": 540.0}
    with pytest.raises(ExcitationError, match=r"no place E1\.y; .* y needs the key `lateral`"):
        shipped("three_point_linkage", {"rotor": given})


@pytest.mark.parametrize("kind", ["base_acceleration", "base_displacement"])
def test_clamped_ground_is_not_moved(kind: str) -> None:
    """Without a base, a motion of the soil is refused with what to do."""
    given = {"speed": "pto", "orders": [1], kind: [1.0], "at": "base.z"}
    with pytest.raises(ExcitationError, match="no base that the soil could move; describe"):
        shipped("three_point_linkage", {"e": {**given, "at_speed": 540.0}})


def test_table_without_frfs() -> None:
    """Without FRFs in the table, nothing is known, and an amplitude is refused."""
    predictor = Predictor(replace(load_table(config_file(PAPER_TABLE)), places=()))
    mechanism = read_mechanism(config_file("three_point_linkage.yaml"))
    plain = [Excitation("e 1", Source.ENGINE, 1.0 / 60.0)]
    level = level_at(LevelTable(predictor, mechanism, plain), 2.0, speeds())
    assert np.isnan(level.amplifications).all()
    with pytest.raises(ExcitationError, match="has no FRFs to compute a level from; leave"):
        LevelTable(predictor, mechanism, excitations_from_mapping(ORDERS))


def test_responses_of_samples_are_frfs_of_the_table() -> None:
    """Those by a motion of the soil, also in the tyre, which it compresses."""
    table, mechanism = plane_table(), plane_mechanism()
    assert mechanism.base is not None
    [rear] = [mount for mount in mechanism.base.mounts if mount.name == "rear_axle"]
    outputs = [(mechanism.response.point, mechanism.response.direction), tyre_place(rear.name)]
    ends = float(table.alpha3[0]), float(table.alpha3[-1])
    load = soil_motion("base:rear_axle.z", mechanism)
    samples = levels_module._Samples(table, [load], outputs, 0, ends)
    at, values, _ = samples.refined()
    hertz = np.array([0.7, 4.0, 9.0, 30.0, 150.0])
    w = np.broadcast_to(2.0 * math.pi * hertz[:, np.newaxis], (len(at), len(hertz), 1))
    parts = samples.layout.split(np.ascontiguousarray(values.T))
    # Of the motion of the soil: the force of the tyre, which also reacts to that motion itself.
    stiffness = rear.stiffness[1] + 2j * math.pi * hertz * rear.damping[1]
    inputs = [(rear.name, "z")]
    for output, own in enumerate((0.0, stiffness)):
        actual, _ = levels_module._responses(parts, output, w)
        for row in range(1, len(at) - 1, 5):
            frf = table.frf(float(at[row]), [outputs[output]], inputs).frf(hertz)[:, 0, 0]
            np.testing.assert_allclose(actual[row, :, 0], frf * stiffness - own, rtol=1e-9)
