# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Warnings in a minute of work, beside forces that are integrated over time."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmark.force_integration import PinForces, Run, running
from benchmark.working_hour import (
    KINDS,
    RATE,
    Outcome,
    Work,
    limits_table,
    outcome,
    write_excitations,
)
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor
from linkage_vibration.prediction.severity import ResonanceState
from linkage_vibration.prediction.verdict import episodes
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import (
    DEFAULT_EXCITATIONS,
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    config_file,
)
from linkage_vibration.table.table import load_table

MECHANISM = read_mechanism(config_file(DEFAULT_MECHANISM))
FLAT = "flat spot of a tyre"


def road() -> Work:
    """Return a minute on the road, in which the wheels twice meet a mode of the tractor."""
    times = np.arange(65 * RATE + 1) / RATE
    nodes = {
        Source.ENGINE: ([0.0, 60.0], [1400.0, 1900.0]),
        Source.PTO: ([0.0, 60.0], [0.0, 0.0]),
        Source.GROUND: ([0.0, 5.0, 35.0, 45.0, 65.0], [4.0, 4.0, 8.5, 8.5, 5.0]),
    }
    speeds = {source: np.interp(times, *points) for source, points in nodes.items()}
    angle = np.radians(105.0 + 0.5 * np.sin(2.0 * np.pi * 0.2 * times))
    return Work(Run(times, angle, speeds), np.full(len(times), KINDS.index("road")))


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Return what the node says about a tyre with a flat spot on the road."""
    return outcome(road(), FLAT, tmp_path_factory.mktemp("flat"))


@pytest.mark.nightly(short="test_no_warning_is_shorter_than_the_dwell_time")
def test_healthy_machine(tmp_path: Path) -> None:
    """The default excitations are in warning for less than a tenth of the time on the road."""
    healthy = outcome(road(), "healthy", tmp_path)
    assert healthy.share(ResonanceState.WARNING) <= 0.1
    assert np.isfinite(healthy.drive.resonances.total_load_ratio).mean() > 0.99


@pytest.mark.nightly(short="test_integration_reaches_the_steady_forces")
def test_warnings_are_those_of_the_forces(flat: Outcome) -> None:
    """At most 1 % of the time above 1.5 limits passes without a warning, and none is needless."""
    assert flat.clearly.mean() > 0.05
    assert flat.missed <= 0.01
    assert flat.needless == 0.0
    reported = flat.drive.resonances.total_load_ratio
    steady = flat.ratio > 0.1  # speeds change slowly here
    assert np.median(reported[steady] / flat.ratio[steady]) == pytest.approx(1.0, abs=0.05)


def test_no_warning_is_shorter_than_the_dwell_time(flat: Outcome) -> None:
    """Each lasts for 1 s at least, and in some time above the limit there is none."""
    lengths = [episode.duration for episode in episodes(flat.drive)]
    assert lengths
    assert min(lengths) >= 1.0
    assert (flat.drive.resonances.total_load_ratio > flat.limit)[~flat.warns].any()


@pytest.mark.nightly(short="test_no_warning_is_shorter_than_the_dwell_time")
def test_each_warning_names_what_ends_it(flat: Outcome, tmp_path: Path) -> None:
    """At the speed, or the angle, that a warning names, it ends after the dwell time."""
    assert flat.named() == 1.0
    excitations = read_excitations(write_excitations(tmp_path / "flat.yaml", FLAT))
    predictor = Predictor(load_table(config_file(DEFAULT_TABLE)))
    levels = LevelTable(predictor, MECHANISM, excitations)
    sources = {each.name: each.source for each in excitations}
    drive, run = flat.drive, road().run

    def states(at: list[tuple[float, dict[Source, float]]]) -> list[int]:
        """Return the last state after 2.5 s at each of some angles and speeds."""
        monitor, actual, time = ResonanceMonitor(excitations, levels=levels), list[int](), 0
        for angle, speeds in at:
            for _ in range(125):  # 50 Hz
                time += 20_000_000
                for source, speed in speeds.items():
                    monitor.set_speed(source, speed, time)
                state = monitor.assess(predictor.predict(angle), 0.0, time).state
            actual.append(int(state))
        return actual

    changes = 0
    for row in np.flatnonzero(flat.warns)[::100].tolist():
        message, time = drive.resonances.message(row), drive.times[row]
        speeds = {
            source: float(np.interp(time, run.times, values))
            for source, values in run.speeds.items()
        }
        angle = float(drive.angles[row])
        if states([(angle, speeds)]) != [ResonanceState.WARNING]:
            continue  # It is about to end.
        if not math.isnan(message.quiet_speed):
            calm = {**speeds, sources[message.excitation]: float(message.quiet_speed)}
            changes += 1
            assert states([(angle, speeds), (angle, calm)])[1] != ResonanceState.WARNING
        if not math.isnan(message.quiet_angle):
            changes += 1
            after = states([(angle, speeds), (float(message.quiet_angle), speeds)])
            assert after[1] != ResonanceState.WARNING
    assert changes > 3


def test_limits_that_are_asked_are_met_or_not(flat: Outcome) -> None:
    """A machine that warns for too long, or misses warnings, does not meet what is asked."""
    quiet = np.zeros_like(flat.drive.resonances.state)
    resonances = flat.drive.resonances.rows(slice(None))
    resonances.state = quiet
    silent = replace(flat, drive=replace(flat.drive, resonances=resonances))
    actual = limits_table({"healthy": flat, FLAT: flat, "bent cardan shaft": silent})
    healthy, faulty, missed = actual.splitlines()[2:]
    assert flat.share(ResonanceState.WARNING) > 0.1
    assert healthy.count("not met") == 1  # warned for more than a tenth of the time
    assert (faulty.count(", met"), faulty.count("not met")) == (2, 0)
    assert "100.0 %, not met" in missed


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("engine 3", marks=pytest.mark.nightly),
        "tines 2",
        pytest.param("tyre_lugs 1", marks=pytest.mark.nightly),
    ],
)
def test_integration_reaches_the_steady_forces(name: str) -> None:
    """At rest, the integrated forces are those of the assembly, without modes, at one frequency."""
    [first] = [e for e in read_excitations(config_file(DEFAULT_EXCITATIONS)) if e.name == name]
    assert first.load is not None
    speed = {Source.ENGINE: 1500.0, Source.PTO: 560.0, Source.GROUND: 7.0}[first.source]
    times = np.arange(30 * RATE + 1) / RATE
    alpha3 = math.radians(165.0)
    still = np.zeros(len(times))
    speeds = dict.fromkeys(Source, still) | {first.source: still + speed}
    model = LinkageModel(MECHANISM)
    forces = PinForces(model, [first], (alpha3, alpha3 + 0.01))
    actual = running(forces.mean_squares(Run(times, still + alpha3, speeds)), 5.0)[-1]
    assert actual == pytest.approx(steady(model, alpha3, first.name, speed), rel=0.03)


def steady(model: LinkageModel, alpha3: float, name: str, speed: float) -> float:
    """Return the largest load ratio by an excitation, from the places of the model."""
    [first] = [e for e in read_excitations(config_file(DEFAULT_EXCITATIONS)) if e.name == name]
    assert first.load is not None
    hertz = first.ratio * speed
    solution, places = model.solve(alpha3), model.forces.places
    omega, size = 2.0 * math.pi * hertz, first.load.amplitude / math.sqrt(2.0)
    if name == "tines 2":
        response = solution.frf(places, [("E1", "x")]).frf(np.array([hertz]))[0, :, 0]
    elif name == "engine 3":  # a pair of forces at the axles, 2.5 m apart
        both = [("rear_axle", "z"), ("front_axle", "z")]
        response = solution.frf(places, both).frf(np.array([hertz]))[0] @ [-0.4, 0.4]
    else:  # through the stiffness and the damping of the rear tyres
        response = solution.frf(places, [("rear_axle", "z")]).frf(np.array([hertz]))[0, :, 0]
        response = response * (700e3 + 1j * omega * 4460.0)
    names = model.force_places
    squares: FloatArray = np.zeros(len(names))
    np.add.at(squares, [names.index(place) for place, _ in places], np.abs(response) ** 2)
    ratios = size * np.sqrt(squares) / model.reference_forces(alpha3)
    return float(ratios[[not name.startswith("base:") for name in names]].max())
