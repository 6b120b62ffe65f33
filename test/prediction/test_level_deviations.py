# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Factors and probabilities of levels are those of whole models whose numbers are drawn."""

import math
import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import islice
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import number_at, split_paths, with_numbers
from linkage_vibration.prediction.ensemble import EnsembleResponses, GroundMembers
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.ground import GroundLevels, Terrain, ground_spectrum
from linkage_vibration.prediction.levels import LevelTable, _mean, kept_levels
from linkage_vibration.prediction.loads import UnitLoad
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor, described
from linkage_vibration.prediction.severity import WarningLimits
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import (
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    PAPER_MECHANISM,
    PAPER_TABLE,
    config_file,
)
from linkage_vibration.table.table import load_table
from test.support.in_plane import in_plane, plane_mechanism, plane_table
from test.support.level_factors import level_factors

FloatArray = NDArray[np.float64]

ALPHA3 = 2.2  # rad, between the angles at which members are solved
LINES = np.array([1.6, 5.0, 7.0, 30.0, 100.0, 185.0])  # Hz: at, between and above resonances
FORCE, MEMBERS = 100.0, 64  # N


def excitations(amplitude: float = 0.0, frequency: float = 0.0) -> tuple[Excitation, ...]:
    """Return a force at E1, 1 Hz/rpm, with relative standard deviations."""
    stddevs = {"amplitude_stddev": amplitude, "frequency_stddev": frequency}
    shaft = {"speed": "pto", "orders": [60.0], "force": [FORCE], "at": "E1.z", "at_speed": 1.0}
    return excitations_from_mapping({"shaft": shaft | stddevs})


@cache
def level_table(amplitude: float = 0.0, frequency: float = 0.0) -> LevelTable:
    """Return levels by that force, by the table of the shipped tractor in the plane."""
    orders = excitations(amplitude, frequency)
    return LevelTable(Predictor(plane_table()), plane_mechanism(), orders)


def speeds(lines: FloatArray) -> FloatArray:
    """Return speeds of all sources, (n_sources, n), with that of the PTO at some lines, Hz."""
    return np.array([lines if source is Source.PTO else 0.0 * lines for source in Source])


def coarse(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose links have fewer elements, none of which is reduced."""
    links = [replace(x, body=x.body.with_elements(4)) for x in mechanism.links]
    return replace(mechanism, links=tuple(links))


def drawn_models() -> Iterator[LinkageModel]:
    """Yield models with other numbers, each of which is described and solved as a whole."""
    mapping = in_plane(yaml.safe_load(config_file(DEFAULT_MECHANISM).read_text()))
    claims = mapping.pop("uncertainty")
    relative, absolute = claims["relative"], claims["absolute"]
    paths = [*relative, *absolute]
    correlation = np.eye(len(paths))
    for entry in claims["correlations"]:
        i, j = (paths.index(path) for path in entry["between"])
        correlation[i, j] = correlation[j, i] = entry["value"]
    root = np.linalg.cholesky(correlation)
    generator = np.random.default_rng(5)
    while True:
        changed: dict[str, Any] = mapping
        for path, draw in zip(paths, root @ generator.standard_normal(len(paths)), strict=True):
            share, shift = relative.get(path, 0.0) * draw, absolute.get(path, 0.0) * draw
            for place in split_paths(path):
                value = number_at(mapping, place) * math.exp(share) + shift
                changed = with_numbers(changed, [(place, value)])
        yield LinkageModel(coarse(mechanism_from_mapping(changed)), reduced=False)


@pytest.fixture(scope="module")
def models() -> list[LinkageModel]:
    """Return 250 of these models."""
    return list(islice(drawn_models(), 250))


@pytest.mark.nightly(short="test_amplitude_and_frequency_belong_to_the_members")
def test_factors_and_probabilities_are_those_of_models(models: list[LinkageModel]) -> None:
    """At, between and above resonances, they agree with the samples."""
    sampled = np.empty((len(models), 2, len(LINES)))  # velocities and load ratios
    for row, model in zip(sampled, models, strict=True):
        # By the FRFs of the components, and by the modes of the assembly.
        drive = [("E1", "z")]
        receptance = model.coupled_frf(ALPHA3, LINES, drive, drive).values[:, 0, 0]
        forces = [place for place in model.forces.places if not place[0].startswith("base:")]
        frf = np.abs(model.solve(ALPHA3).frf(forces, drive).frf(LINES)[:, :, 0]) ** 2
        names = [each for each, _ in forces]
        first = [names.index(each) for each in dict.fromkeys(names)]
        ratios = (
            np.sqrt(np.add.reduceat(frf, first, axis=1))
            / model.reference_forces(ALPHA3)[: len(first)]
        )
        row[:] = np.abs(receptance) * math.tau * LINES, ratios.max(axis=1)
    sampled *= FORCE / math.sqrt(2.0)
    levels = level_table()
    actual = level_factors(levels, np.full(len(LINES), ALPHA3), speeds(LINES), 0.0)
    factors = [actual[name][:, 0] for name in ("velocity_factors", "load_ratio_factors")]
    assert within_samples(np.log(factors), np.log(sampled))
    totals = levels.member_totals(np.full(len(LINES), ALPHA3), speeds(LINES))
    assert [total.shape for total in totals] == 2 * [(MEMBERS, len(LINES))]
    medians = np.median(np.log(totals[::-1]), axis=1)
    assert np.abs(medians - np.median(np.log(sampled), axis=0)).max() < 0.1
    limits = np.quantile(sampled[:, 1], [0.1, 0.5, 0.9], axis=0)
    for share, row in zip((0.9, 0.5, 0.1), limits, strict=True):
        for line, limit in enumerate(row.tolist()):
            at = np.array([ALPHA3]), speeds(LINES[[line]])
            assert level_factors(levels, *at, limit)["warning_probability"][0] == pytest.approx(
                share, abs=0.1
            )


def within_samples(stated: FloatArray, logs: FloatArray) -> bool:
    """Return whether deviations are within 15 % and three standard errors of those of samples.

    The standard error of a sampled deviation s is sqrt((kurtosis - 1) / n) s / 2.
    """
    logs = logs - logs.mean(axis=0)
    deviations = logs.std(axis=0)
    kurtosis = (logs**4).mean(axis=0) / deviations**4
    error = 3.0 * np.sqrt((kurtosis - 1.0) / len(logs)) / 2.0
    return bool((np.abs(stated / deviations - 1.0) < 0.15 + error).all())


@pytest.mark.nightly(short="test_amplitude_and_frequency_belong_to_the_members")
def test_the_ground_belongs_to_the_members(models: list[LinkageModel]) -> None:
    """Levels by the ground scatter as those of models, at a point, in a pin and in a cylinder."""
    mechanism, terrain, table = plane_mechanism(), Terrain(256e-6), plane_table()
    places = [("E1", "z"), ("lower_link:P1", "force_x"), ("lift_cylinders", "force")]
    members = GroundMembers(table, mechanism, terrain, places)
    slow_and_fast = 3.0, 9.0  # m/s
    squares = np.empty((40, 2, len(places)))
    for row, model in zip(squares, models[: len(squares)], strict=True):
        for cell, speed in zip(row, slow_and_fast, strict=True):
            for i, place in enumerate(places):
                lines, density = ground_spectrum(
                    model, model.mechanism, terrain, place, ALPHA3, speed
                )
                cell[i] = trapezoid(density, lines)
    shares = members.shares(np.full(2, ALPHA3), np.array(slow_and_fast))
    stated = np.log(shares).std(axis=1)
    assert within_samples(stated, np.log(squares))
    # A road that is twice as high has four times the mean squares.
    one, two = np.ones(2), np.ones((2, 2))
    unit = GroundLevels(one, one, two, two, two, one, np.zeros(2, np.int8))
    every = members.levels(unit, np.full(2, ALPHA3), np.array(slow_and_fast), np.full(MEMBERS, 2.0))
    found = np.array([every.velocity**2, *every.forces2])
    np.testing.assert_allclose(found, 4.0 * shares.reshape(-1, 3).T)
    nominal = LinkageModel(coarse(mechanism), reduced=False)
    for share, speed in zip(shares, slow_and_fast, strict=True):
        lines, density = ground_spectrum(nominal, mechanism, terrain, places[0], ALPHA3, speed)
        median = np.median(squares[:, slow_and_fast.index(speed), 0])
        expected = math.log(median / trapezoid(density, lines))
        assert np.median(np.log(share[:, 0])) == pytest.approx(expected, abs=0.2)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_the_ground_has_no_level_without_a_speed() -> None:
    """A speed or an angle that is NaN gives NaN, and no warning of NumPy reaches the user."""
    members = GroundMembers(plane_table(), plane_mechanism(), Terrain(256e-6), [("E1", "z")])
    shares = members.shares(np.array([ALPHA3, ALPHA3, np.nan]), np.array([3.0, np.nan, 3.0]))
    assert np.isfinite(shares).all(axis=(1, 2)).tolist() == [True, False, False]


def test_amplitude_and_frequency_belong_to_the_members() -> None:
    """Amplitudes add their variance; far above a mode, a frequency changes a level by its power."""
    line = np.array([30.0])
    at = np.array([ALPHA3]), speeds(line), 0.0
    plain, loud, unsteady = (
        math.log(float(level_factors(level_table(*stddevs), *at)["velocity_factors"][0, 0]))
        for stddevs in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.02))
    )
    assert loud == pytest.approx(math.hypot(plain, 0.5), rel=0.02)
    near = level_table().at(np.full(2, ALPHA3), speeds(30.0 * np.array([0.98, 1.02])))
    power = math.log(near.velocities[1, 0] / near.velocities[0, 0]) / math.log(1.02 / 0.98)
    assert unsteady == pytest.approx(math.hypot(plain, 0.02 * power), rel=0.02)
    assert unsteady > 1.0001 * plain


def test_without_uncertainty_nothing_is_stated() -> None:
    """A table without an ensemble has no members, and no factor."""
    mechanism = read_mechanism(config_file(PAPER_MECHANISM))
    shaft = {"speed": "pto", "orders": [1], "force": [FORCE], "at": "E1.z", "at_speed": 540.0}
    table = load_table(config_file(PAPER_TABLE), mechanism)
    orders = excitations_from_mapping({"shaft": shaft | {"amplitude_stddev": 0.5}})
    levels = LevelTable(Predictor(table), mechanism, orders)
    at = np.array([2.0]), speeds(np.array([540.0]))
    assert levels.member_totals(*at)[0].shape == (0, 1)
    assert all(np.isnan(values).all() for values in level_factors(levels, *at, 0.3).values())
    assert not len(table.ensemble_alpha3)


def test_factors_need_nearly_all_members() -> None:
    """Of 64 members three may be unknown; the mean is then that of the others."""
    values = np.ones((2, MEMBERS, 1))
    values[0, :3] = values[1, :4] = np.nan
    np.testing.assert_array_equal(_mean(values), [[1.0], [np.nan]])


def test_factors_are_held_for_a_second() -> None:
    """They are computed again after 1 s of stamps, if the state changes, or if stamps jump back."""
    levels = level_table()
    predictor = levels.predictor
    stamps = [0, 999_999_999, 1_000_000_000, 1_999_999_999, 500_000_000, 600_000_000, 700_000_000]
    angles = np.radians([100.0, 120.0, 140.0, 160.0, 170.0, 110.0, 130.0])
    monitor = ResonanceMonitor(excitations(), levels=levels)
    monitor.set_fixed(Source.PTO, 7.0)
    actual, states = list[float](), list[int]()
    for angle, time in zip(angles.tolist(), stamps, strict=True):
        if time == stamps[-1]:
            monitor.rules.limits = WarningLimits(warning=1e9, note=0.0)
        message = described(monitor.assess(predictor.predict(angle), 0.0, time))
        actual.append(message.load_ratio_factor)
        states.append(message.state)
    fresh = level_factors(levels, angles, speeds(np.full(7, 7.0)), 0.33)["load_ratio_factors"][:, 0]
    assert actual == fresh[[0, 0, 2, 2, 4, 4, 6]].tolist()
    assert len(set(fresh.tolist())) == 7
    assert len(set(states[:-1])) == 1 != len(set(states))


def test_a_member_that_is_not_possible_is_not_known() -> None:
    """Its responses are NaN without a warning of NumPy, and those of the others are as before."""
    table = load_table(config_file(DEFAULT_TABLE))
    place, poles = table.places[0], table.ensemble_poles.copy()
    poles[3] = np.nan
    loads = [UnitLoad((place,), lambda alpha3: (np.ones(1), np.zeros(1)))]
    omega, first = np.full((1, 1), 30.0), np.zeros(1, np.int64)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        whole, without = (
            EnsembleResponses(each, loads, [place], 0)
            .at(np.array([2.0]))
            .responses(omega, first)[0]
            for each in (table, replace(table, ensemble_poles=poles))
        )
    assert np.isnan(without[3]).all()
    np.testing.assert_array_equal(np.delete(without, 3, 0), np.delete(whole, 3, 0))


def test_a_member_that_lacks_a_level_has_no_total() -> None:
    """At 3 m/s the ground makes nearly all of the velocity, so the total has its deviation.

    One member of the shipped table has no lateral modes, so its levels by the ground are not known.
    What the mechanism itself does not know, as orders without a speed, takes no total away.
    """
    mechanism, predictor = read_mechanism(), Predictor(load_table())
    every = read_excitations(config_file("excitations.yaml"))
    levels = kept_levels(predictor, mechanism, every)
    at = np.radians([95.0, 120.0]), np.array([[2000.0] * 2, [1000.0] * 2, [3.0] * 2])
    ground = [each.terrain is not None for each in every].index(True)
    for speeds in (at[1], np.where(at[1] > 900.0, math.nan, at[1])):
        nominal, factors = levels.at(at[0], speeds), level_factors(levels, at[0], speeds, 0.33)
        own, total = nominal.velocities[:, ground], nominal.total_velocity
        assert (own > 0.98 * total).all()
        logs = np.log([factors["total_velocity_factor"], factors["velocity_factors"][:, ground]])
        np.testing.assert_allclose(logs[0], logs[1], rtol=0.05)
        lost = [np.isnan(totals).sum(axis=0) for totals in levels.member_totals(at[0], speeds)]
        assert np.array(lost).tolist() == [[1, 1], [1, 1]]
