# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes of simulated drives of a tractor that differs from the table's."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmark.listening.simulation import HEAVE, SENSORS, Drive, Scene, simulate
from linkage_vibration.listening import drive_modes
from linkage_vibration.listening.drive_modes import (
    DriveMode,
    MeasuredDrive,
    _best,
    model_shapes,
    search_modes,
)
from linkage_vibration.listening.output_only import Candidate, PausableTask, finish, mac
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table
from test.support.in_plane import plane_mechanism, plane_table

SENSED = [("E1", "x"), ("E1", "z"), ("V1", "z")]


def listen_modes(*given: Any) -> tuple[DriveMode, ...]:
    """Return the modes of a drive without pauses."""
    return finish(search_modes(MeasuredDrive(*given)))


@pytest.fixture(scope="module")
def arguments() -> tuple[Table, Mechanism]:
    """Return the table and the mechanism of the tractor."""
    return plane_table(), plane_mechanism()


@pytest.fixture(scope="module")
def drive() -> Drive:
    """Return a drive on a rough road, whose implement is heavier than that of the table."""
    return simulate(1, Scene(road=256e-6, seconds=180.0))


def test_heave_of_a_heavier_implement(arguments: tuple[Table, Mechanism], drive: Drive) -> None:
    """The heave, 5 % below the prediction, is within three deviations; the PTO at it hides it."""
    speeds = {Source(name): values for name, values in drive.speeds.items()}
    given = *arguments, drive.times, drive.signals, SENSORS, drive.crank_angle, speeds
    heaves = [each for each in listen_modes(*given) if each.mode == HEAVE and not each.doubt]
    assert heaves
    for each in heaves:
        there = np.abs(drive.crank_angle - each.alpha3) < math.radians(2.0)
        true = drive.frequencies[there, HEAVE].mean()
        assert abs(each.frequency - true) < 3.0 * each.frequency_stddev
        assert abs(each.frequency / each.predicted - 1.0) < 0.1
    order = 60.0 * heaves[0].frequency / float(drive.speeds["pto"].mean())
    shaft = excitations_from_mapping({"shaft": {"speed": "pto", "orders": [order]}})
    doubts = [each.doubt for each in listen_modes(*given, shaft) if each.mode == HEAVE]
    assert any(doubt.startswith(f"shaft {order:g} was within") for doubt in doubts)


def test_tone_in_place_of_the_heave(arguments: tuple[Table, Mechanism], drive: Drive) -> None:
    """A tone with the shape of the heave is named; without it, no doubt is about a tone."""
    table, _ = arguments
    speeds = {Source(name): values for name, values in drive.speeds.items()}
    there = drive.times > drive.times[-1] / 2.0 + 3.0
    alpha3 = float(drive.crank_angle[there].mean())
    shape = model_shapes(table, alpha3, SENSORS)[:, HEAVE].real
    hertz = 1.03 * table.evaluate(np.array([alpha3]))[0, HEAVE]
    wave = np.sin(2.0 * math.pi * hertz * drive.times)[:, np.newaxis]
    for size, doubted in ((0.0, False), (5.0, True)):
        signals = drive.signals + size * wave * shape
        given = *arguments, drive.times, signals, SENSORS, drive.crank_angle, speeds
        heaves = [each for each in listen_modes(*given) if each.mode == HEAVE]
        nearest = min(heaves, key=lambda each: abs(each.alpha3 - alpha3))
        assert nearest.doubt.startswith(f"a tone at {hertz:.2f} Hz") == doubted


def heave_doubt(
    arguments: tuple[Table, Mechanism],
    drive: Drive,
    excitations: Sequence[Excitation] = (),
    **changed: FloatArray | None,
) -> str:
    """Return the doubt about the heave at 168 deg with other speeds; None means not known."""
    speeds = {Source(name): speed for name, speed in (drive.speeds | changed).items()}
    known = {source: speed for source, speed in speeds.items() if speed is not None}
    given = drive.times, drive.signals, SENSORS, drive.crank_angle, known, excitations
    return [each for each in listen_modes(*arguments, *given) if each.mode == HEAVE][-1].doubt


@pytest.mark.parametrize(("seconds", "doubted"), [(0.2, False), (1.5, True)])
def test_order_in_a_part_of_a_stretch(
    arguments: tuple[Table, Mechanism], drive: Drive, seconds: float, doubted: bool
) -> None:
    """An order is at the heave for 1 or 8 % of a stretch, and for less than 2 % of the drive."""
    shaft = excitations_from_mapping({"shaft": {"speed": "pto", "orders": [1]}})
    near = (drive.times > 5.0) & (drive.times < 5.0 + seconds)
    pto = np.where(near, 60.0 * 8.16, 3000.0)
    assert heave_doubt(arguments, drive, shaft, pto=pto).startswith("shaft 1 was") == doubted


SOIL = {"field": {"speed": "ground", "terrain": {"class": "B"}, "raised": False}}


@pytest.mark.parametrize(
    ("excitations", "speed", "doubted"),
    [
        ((), 1.0, True),
        (excitations_from_mapping(SOIL), -1.0, True),
        (excitations_from_mapping(SOIL), 0.05, False),
    ],
)
def test_lines_of_wheels_that_roll(
    arguments: tuple[Table, Mechanism],
    drive: Drive,
    excitations: Sequence[Excitation],
    speed: float,
    doubted: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Lines are sought also without a terrain, with a tool in the soil, and in reverse.

    At 0.05 of its speed, the machine stands.
    """

    def lines(*_: object) -> PausableTask[FloatArray]:
        yield
        return np.array([8.16])

    monkeypatch.setattr(drive_modes, "wheelbase_lines", lines)
    doubt = heave_doubt(arguments, drive, excitations, ground=speed * drive.speeds["ground"])
    assert doubt.startswith("the wheelbase makes a line at 8.16 Hz") == doubted


def test_wheels_need_the_speed(arguments: tuple[Table, Mechanism], drive: Drive) -> None:
    """Without the speed over ground, wheels may roll; a mechanism without wheels does not care."""
    table, mechanism = arguments
    doubt = heave_doubt(arguments, drive, ground=None)
    assert doubt.startswith("the ground speed, which a line of the wheelbase follows, is not known")
    assert heave_doubt((table, replace(mechanism, base=None)), drive, ground=None) == ""
    assert heave_doubt(arguments, drive) == ""


def test_without_a_base(arguments: tuple[Table, Mechanism], drive: Drive) -> None:
    """Where no wheels are modelled, a raised terrain does not end the search: heave is found."""
    table, mechanism = arguments
    speeds = {Source(name): values for name, values in drive.speeds.items()}
    given = drive.times, drive.signals, SENSORS, drive.crank_angle, speeds
    field = {"field": {"speed": "ground", "terrain": {"class": "B"}, "raised": True}}
    modes = listen_modes(
        table, replace(mechanism, base=None), *given, excitations_from_mapping(field)
    )
    assert HEAVE in [each.mode for each in modes if not each.doubt]


@pytest.mark.parametrize("stddev", [0.019, 0.021, 0.5])
def test_deviation_does_not_select(stddev: float) -> None:
    """A random deviation does not decide whether a candidate is the mode; its shape does."""
    shapes = np.eye(2, dtype=complex)
    actual = [Candidate(5.0, 0.02, shapes[0], 5.0 * stddev, 0.001)]
    assert _best(actual, 0, np.array([5.1, 9.0]), shapes) is actual[0]
    assert _best(actual, 1, np.array([5.1, 9.0]), shapes) is None


@pytest.mark.parametrize("seconds", [600.0, pytest.param(3600.0, marks=pytest.mark.nightly)])
def test_time_without_excitation(arguments: tuple[Table, Mechanism], seconds: float) -> None:
    """The noise of the sensors alone shows no mode in an hour at two heights."""
    drive = simulate(5, Scene(road=0.0, seconds=seconds))
    speeds = {Source(name): values for name, values in drive.speeds.items()}
    modes = listen_modes(*arguments, drive.times, drive.signals, SENSORS, drive.crank_angle, speeds)
    assert [each for each in modes if not each.doubt] == []


def test_shapes_of_the_table(arguments: tuple[Table, Mechanism]) -> None:
    """They are those of the undamped model, as damping hardly couples its modes."""
    table, mechanism = arguments
    shapes = model_shapes(table, 2.5, SENSORS)
    undamped = LinkageModel(mechanism).solve(2.5).mode_shapes(SENSORS)
    for mode in range(4):
        assert mac(shapes[:, mode], undamped[:, [mode]].astype(complex))[0] > 0.95


def test_shapes_beside_a_strong_damper(mapping: Any) -> None:
    """They are those of the poles of the state matrix, whose points do not move in phase."""
    ends = {"joint": "E1", "bodies": ["lower_link", "implement"]}
    mapping["springs"] = {"damper": ends | {"stiffness": 1e3, "damping": 3e3}}
    mapping["input"]["range_deg"] = [130.0, 140.0]
    for link in mapping["links"].values():
        link |= {"elements": 4, "modes": 2}
    model, alpha3 = LinkageModel(mechanism_from_mapping(mapping)), math.radians(134.0)
    actual = model_shapes(build_table(model, 1e-6), alpha3, SENSED)
    solution = model.solve(alpha3)
    system, n = solution.coupled, len(solution.coupled.mass)
    state = np.eye(2 * n, k=n)
    state[n:] = -np.linalg.solve(system.mass, np.hstack([system.stiffness, system.damping]))
    poles, vectors = np.linalg.eig(state)
    first = np.argsort(np.where(poles.imag > 0.0, np.abs(poles), np.inf))[: actual.shape[1]]
    rows = system.restrict(model.rows(SENSED, model.kinematics.at(alpha3)))
    exact = rows @ vectors[:n, first]
    exact /= exact[np.abs(exact).argmax(axis=0), np.arange(len(first))]
    assert abs(exact[2, 0].imag) > 0.2 * abs(exact[2, 0].real)
    np.testing.assert_allclose(actual, exact, atol=1e-5)


def test_difference() -> None:
    """With 3 and 4 %, ln(measured / predicted) of 0.1 is 2 deviations, and -0.097 is -1.94."""
    high, low = 5.0 * math.exp(0.1), 5.0 * math.exp(-0.097)
    mode = DriveMode(2.0, 3, 5.0, 0.03, 0.0, high, 0.04 * high, 0.02, 0.0, (9.0,))
    assert mode.difference == pytest.approx(2.0)
    assert mode.consistent is False
    assert replace(mode, predicted_stddev=math.nan).consistent is None
    lower = DriveMode(2.0, 3, 5.0, 0.03, 0.0, low, 0.04 * low, 0.02, 0.0, (9.0,))
    assert lower.difference == pytest.approx(-1.94)
    assert lower.consistent
