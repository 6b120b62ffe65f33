# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Levels of vibration against the model, independent samples, and themselves one by one."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.ground_motion import transmissibility
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.excitation import (
    Excitation,
    ExcitationError,
    Source,
    excitations_from_mapping,
)
from linkage_vibration.prediction.levels import LevelTable, _unknown
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table

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


def level_at(levels: LevelTable, alpha3: float, at: tuple[float, ...], stddev: Any) -> Any:
    """Return the levels at an angle and at speeds, with deviations, (2, n_modes)."""
    return levels.at(np.array([alpha3]), np.array([at]).T, stddev[:, np.newaxis]).message(0)


def deviations(predictor: Predictor, alpha3: float, frequency: float, ratio: float) -> Any:
    """Return relative standard deviations of frequencies, and those of damping ratios."""
    zeta = predictor.predict(alpha3).damping_ratios
    return np.array([np.full(len(zeta), frequency), ratio * zeta])


@pytest.mark.parametrize("name", NAMES)
def test_levels_are_those_of_the_model(name: str) -> None:
    """Velocity and acceleration are those of the FRF of the model times the load at this speed."""
    found, mechanism, predictor = shipped(name)
    model, stddev = LinkageModel(mechanism), deviations(predictor, 2.0, 0.0, 0.0)
    for alpha3 in (1.6, 2.2345, 3.1):
        level, solution = level_at(found, alpha3, speeds(), stddev), model.solve(alpha3)
        hertz = 540.0 * 0.45 / 60.0 * np.array([1.0, 2.0])
        frf = solution.frf([("E1", "z")], [("E2", "x")]).frf(hertz)[:, 0, 0]
        force = np.array([150.0, 40.0]) * (540.0 / 1080.0) ** 2
        velocity = 2.0 * math.pi * hertz * np.abs(frf) * force / math.sqrt(2.0)
        np.testing.assert_allclose(level.velocities[3:5], velocity, rtol=2e-4)
        acceleration = 2.0 * math.pi * hertz * velocity
        np.testing.assert_allclose(level.accelerations[3:5], acceleration, rtol=2e-4)
        # A moment does work on the rotation of the implement, whose places turn with it.
        one, other = (solution.configuration.place("implement", p) for p in ((0, 0), (0.438, 0)))
        lever, turn = other - one, 9.0
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
    found = LevelTable(predictor, mechanism, excitations_from_mapping(orders))
    hertz = 8.0 / (2.0 * math.pi * 0.8)
    level = level_at(found, 2.2, speeds(ground=8.0), deviations(predictor, 2.2, 0.0, 0.0))
    solution = model.solve(2.2)
    for k, soil in enumerate((("base", "z"), ("base:rear_axle", "x"))):
        moved = transmissibility(solution, [("E1", "z")], soil).frf(np.array([hertz]))[0, 0, 0]
        acceleration = abs(moved) * 0.3 / math.sqrt(2.0)
        assert level.accelerations[k] == pytest.approx(acceleration, rel=2e-4)


@pytest.mark.parametrize("name", NAMES)
def test_one_by_one_and_together(name: str) -> None:
    """Levels of one angle and of many are equal to the last bit, also outside the table."""
    found, _, predictor = shipped(name)
    found.states_uncertainty = True
    rng = np.random.default_rng(1)
    alpha3 = np.concatenate([rng.uniform(1.6, 3.1, 67), [math.nan, 0.0, 2.0]])
    values = np.vstack([rng.uniform(0.0, 4000.0, (2, 70)), rng.uniform(0.0, 10.0, (1, 70))])
    values[:, ::7] = math.nan
    values[1, 3] = 0.0
    stddev = np.repeat(deviations(predictor, 2.0, 0.01, 0.1)[:, np.newaxis], 70, axis=1)
    stddev[:, 5] = math.nan
    many = found.at(alpha3, values, stddev)
    for i, angle in enumerate(alpha3.tolist()):
        one = level_at(found, angle, tuple(values[:, i].tolist()), stddev[:, i])
        for name, expected in vars(many).items():
            np.testing.assert_array_equal(getattr(one, name), expected[i], name)
    assert np.isnan(many.amplifications[[67, 68]]).all()


@pytest.mark.parametrize("name", NAMES)
def test_standard_deviations_by_an_independent_sample(name: str) -> None:
    """A deviation that is known is that of 2000 samples within 10 %, but for 2 in 100."""
    found, _, predictor = shipped(name)
    found.states_uncertainty = True
    n, t, count = predictor.table.n_modes, found._layout.n_terms, 2000
    rng, errors = np.random.default_rng(3), list[float]()
    for _ in range(30):
        alpha3, pto = rng.uniform(1.6, 3.1), rng.uniform(100.0, 1500.0)
        spread, ratio = 10.0 ** rng.uniform(-2.5, -1.0), rng.uniform(0.0, 0.3)
        stddev = deviations(predictor, alpha3, spread, ratio)
        level = level_at(found, alpha3, speeds(pto=pto), stddev)
        drawn = np.repeat(found._values(np.array([alpha3])), count, axis=1)
        size = np.exp(spread * rng.standard_normal((n, count)))
        drawn[:n] *= size**2
        drawn[2 * t : 2 * t + n] *= size * (1.0 + ratio * rng.standard_normal((n, count)))
        forcing = found._forcing(np.array([speeds(pto=pto)] * count).T)
        sampled = _unknown(8, count)
        each = np.repeat(stddev[:, np.newaxis], count, axis=1)
        found._evaluate(sampled, drawn, forcing, each)
        amplitude = 0.3 * level.velocities[3:5].astype(float)
        expected = np.hypot(np.std(sampled[3:7], axis=1), [*amplitude, 0.0, 0.0])
        own = amplitude * level.velocities[3:5] / level.total_velocity
        total = math.hypot(float(np.std(sampled[-3])), *own)
        pairs = zip(level.velocity_stddevs[3:7], expected, strict=True)
        for stated, sample in [*pairs, (level.total_velocity_stddev, total)]:
            if not math.isnan(stated):
                errors.append(abs(float(stated / sample) - 1.0))
    assert len(errors) > 60
    assert np.quantile(errors, 0.98) < 0.1


def test_no_deviation_where_modes_cancel() -> None:
    """Where the response is a small difference of large terms, shapes decide, which vary, too."""
    found, _, predictor = shipped("three_point_linkage_on_tractor")
    rng, unknown = np.random.default_rng(7), 0
    for _ in range(60):
        alpha3, pto = rng.uniform(1.6, 3.1), rng.uniform(100.0, 1500.0)
        level = level_at(found, alpha3, speeds(pto=pto), deviations(predictor, alpha3, 1e-4, 1e-3))
        forcing = found._forcing(np.array([speeds(pto=pto)]).T)
        responses = found._responses(found._values(np.array([alpha3])), forcing.omega)
        sizes = np.hypot(*responses.terms)[..., 0].sum(axis=0)
        small = np.sqrt(responses.squares[:, 0]) < 0.25 * sizes
        assert np.isnan(level.velocity_stddevs[small]).all()
        unknown += np.isnan(level.velocity_stddevs[small & ~np.isnan(level.velocities)]).sum()
    assert unknown > 10


def test_deviations_of_the_own_frequency() -> None:
    """What a speed leaves open is that of 2000 speeds within 10 %, but for 2 in 100."""
    rotor = {**ORDERS["rotor"], "exponent": 0, "amplitude_stddev": 0.0}  # type: ignore[dict-item]
    orders = {
        name: {**one, "frequency_stddev": 0.02}  # type: ignore[dict-item]
        for name, one in {"rotor": rotor, "shaft": ORDERS["shaft"]}.items()
    }
    found, _, predictor = shipped("three_point_linkage_on_tractor", orders)
    rng, count, errors = np.random.default_rng(5), 2000, list[float]()
    exact = np.zeros((2, count, predictor.table.n_modes))
    for _ in range(60):
        alpha3, pto = rng.uniform(1.6, 3.1), rng.uniform(100.0, 1500.0)
        level = level_at(found, alpha3, speeds(pto=pto), exact[:, 0])
        drawn = np.full((3, count), pto) * (1.0 + 0.02 * rng.standard_normal(count))
        sampled = found.at(np.full(count, alpha3), drawn, exact).velocities
        stated = level.velocity_stddevs / sampled.std(axis=0, dtype=float)
        errors += np.abs(stated[~np.isnan(stated)] - 1.0).tolist()
        share = level.velocities / level.total_velocity
        total = math.sqrt(np.nansum(np.square(share * level.velocity_stddevs)))
        unknown = np.isnan(level.velocity_stddevs) & ~np.isnan(level.velocities)
        if (unknown & (share > 0.1)).any():
            assert math.isnan(level.total_velocity_stddev)
        elif not unknown.any():
            assert level.total_velocity_stddev == pytest.approx(total, rel=1e-5, nan_ok=True)
        elif not math.isnan(level.total_velocity_stddev):  # one that is small may be unknown
            assert total * (1.0 - 1e-5) <= level.total_velocity_stddev <= 1.05 * total
    assert len(errors) > 120
    assert np.quantile(errors, 0.98) < 0.1


def test_totals_of_nothing() -> None:
    """Amplitudes of zero add up to zero, and the total of what is not known is not known."""
    still = {**ORDERS["rotor"], "force": [0.0, 0.0]}  # type: ignore[dict-item]
    found, _, predictor = shipped("three_point_linkage_on_tractor", {"rotor": still})
    stddev = deviations(predictor, 2.0, 0.01, 0.1)
    level, unknown = (level_at(found, 2.0, speeds(pto=pto), stddev) for pto in (540.0, math.nan))
    for name in ("total_velocity", "total_velocity_stddev", "total_acceleration"):
        assert getattr(level, name) == 0.0
        assert np.isnan(getattr(unknown, name))


def test_load_without_a_static_response() -> None:
    """A slow motion of the soil along x does not lift the hitch, so nothing is amplified."""
    road: dict[str, Any] = {"speed": "ground", "rolling_radius": 0.8, "orders": [1]}
    road["base_acceleration"] = [1.0]
    orders = {axis: {**road, "at": f"base.{axis}", "at_speed": 5.0} for axis in "xz"}
    found, _, predictor = shipped("three_point_linkage_on_tractor", orders)
    level = level_at(found, 2.2, speeds(ground=5.0), deviations(predictor, 2.2, 0.0, 0.0))
    assert np.isnan(level.amplifications).tolist() == [True, False]
    assert (level.velocities > 0.0).all()


def test_what_is_not_known() -> None:
    """Above the band, and for deviations without a basis, numbers are NaN."""
    found, _, predictor = shipped("three_point_linkage")
    level = level_at(found, 2.0, speeds(engine=4100.0), deviations(predictor, 2.0, 0.01, 0.1))
    assert np.isnan(level.amplifications[2])  # 205 Hz, while the band ends at 200 Hz
    assert not np.isnan(level.amplifications[1])
    assert np.isnan(level.velocity_stddevs).all()  # the paper states no uncertainty


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"at": "E9.z"}, r"has no place E9.z; give a point and a direction, such as E1.z"),
        ({"at": "E1.y"}, r"has no place E1.y"),
        ({"at": "P1.x"}, r"no FRF at P1, where P1.x acts; name them and E1 in .*--frf-points"),
        ({"force": None, "moment": [1.0], "at": "upper_link"}, r"upper_link is none; give one of"),
        ({"force": None, "base_acceleration": [1.0], "at": "E1.z"}, r"no motion E1.z; name one of"),
    ],
)
def test_loads_that_cannot_be_used(changes: dict[str, Any], words: str) -> None:
    """The error names the excitation, the place, and what to do about it."""
    given = {"speed": "pto", "orders": [1], "force": [1.0], "at": "E1.z", "at_speed": 540.0}
    given = {key: value for key, value in (given | changes).items() if value is not None}
    with pytest.raises(ExcitationError, match=f"excitation rotor 1: .*{words}"):
        shipped("three_point_linkage_on_tractor", {"rotor": given})


def test_clamped_ground_is_not_accelerated() -> None:
    """Without a base, an acceleration of it is refused with what to do."""
    given = {"speed": "pto", "orders": [1], "base_acceleration": [1.0], "at": "base.z"}
    with pytest.raises(ExcitationError, match="no base that could be accelerated; describe"):
        shipped("three_point_linkage", {"e": {**given, "at_speed": 540.0}})


def test_table_without_frfs() -> None:
    """Without FRFs in the table, nothing is known, and an amplitude is refused."""
    predictor = Predictor(replace(load_table(config_file(PAPER_TABLE)), places=()))
    mechanism = read_mechanism(config_file("three_point_linkage.yaml"))
    plain = [Excitation("e 1", Source.ENGINE, 1.0 / 60.0)]
    level = level_at(LevelTable(predictor, mechanism, plain), 2.0, speeds(), np.zeros((2, 3)))
    assert np.isnan(level.amplifications).all()
    with pytest.raises(ExcitationError, match="has no FRFs to compute a level from; leave"):
        LevelTable(predictor, mechanism, excitations_from_mapping(ORDERS))
