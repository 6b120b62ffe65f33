# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Margins and responses by order in exported C are those of the resonance monitor."""

import math
import re
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.cli.main import main
from linkage_vibration.export.c_source import c_sources
from linkage_vibration.export.constants import NAME, Export, export_of
from linkage_vibration.export.orders import joined_cells, largest_sizes
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable, kept_levels
from linkage_vibration.prediction.loads import FORCE, Load, LoadKind
from linkage_vibration.prediction.predictor import Predictor, predict_many
from linkage_vibration.prediction.resonance import ReportedSpeed, ResonanceMonitor, ResonanceState
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
from linkage_vibration.table.cells import Cells
from linkage_vibration.table.table import Table, load_table
from test.support.c_code import Library, compile_c, misra_rules, write
from test.support.programs import require

ORDERS = tuple(
    each for each in read_excitations(config_file("excitations.yaml")) if not each.terrain
)
SOIL = {"speed": "pto", "orders": [1.5], "at": "base.z", "at_speed": 540.0}
[ROAD] = excitations_from_mapping({"road": SOIL | {"base_acceleration": [0.3]}})
UNBALANCE = LoadKind("unbalance", "kg m", FORCE.unit_load, power=2)
ROTOR = replace(ROAD, name="rotor", load=Load(UNBALANCE, "E2.x", 0.02, 540.0, 1.0, 0.0))
CASES = {
    "tractor with amplitudes": (DEFAULT_MECHANISM, DEFAULT_TABLE, (*ORDERS, ROAD, ROTOR)),
    "paper without amplitudes": (
        PAPER_MECHANISM,
        PAPER_TABLE,
        tuple(replace(each, load=None) for each in ORDERS),
    ),
    "forty orders": (
        PAPER_MECHANISM,
        PAPER_TABLE,
        excitations_from_mapping(
            {"engine": {"speed": "engine", "orders": [0.25 * k for k in range(1, 41)]}}
        ),
    ),
}
N = 3000
LEVELS = "velocities", "accelerations", "amplifications"


Case = tuple[Table, LevelTable, tuple[Excitation, ...], Library]


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    """Return a table, levels, excitations, and their compiled export."""
    export = exported_case(request.param)
    library = Library(tmp_path_factory.mktemp("orders"), export)
    mechanism_file, _, excitations = CASES[request.param]
    mechanism = read_mechanism(config_file(mechanism_file))
    levels = kept_levels(Predictor(export.table), mechanism, excitations)
    return export.table, levels, excitations, library


@cache
def exported_case(name: str) -> Export:
    """Return an export of one of the cases."""
    mechanism_file, table_file, excitations = CASES[name]
    mechanism = read_mechanism(config_file(mechanism_file))
    table = load_table(config_file(table_file), mechanism)
    return export_of(table, mechanism, excitations)


def drawn(table: Table) -> tuple[Any, Any]:
    """Return angles and speeds, (n,) and (n, 3), of which a few are not known."""
    rng = np.random.default_rng(3)
    angles = rng.uniform(*table.alpha3_range, N)
    speeds = rng.uniform(0.0, [3000.0, 1200.0, 12.0], (N, 3))
    speeds[::7, 0], speeds[::11, 1], speeds[::13, 2] = math.nan, 0.0, math.nan
    angles[::17] = [math.nan, math.inf, 0.0][0]
    return angles, speeds


def test_same_numbers_as_the_node(case: Case) -> None:
    """Levels are equal as the message has them, and margins are those to the nearest modes."""
    table, known, excitations, library = case
    angles, speeds = drawn(table)
    predicted = library.predict(angles, 0.0 * angles)
    resonance = library.assess(predicted, speeds)
    predictions = predict_many(Predictor(table), angles, np.zeros(N))
    levels = known.at(angles, speeds.T)
    for name in (*LEVELS, "total_velocity", "total_acceleration"):
        own, expected = resonance[name].astype(np.float32), getattr(levels, name)
        np.testing.assert_array_equal(np.isnan(own), np.isnan(expected), name)
        np.testing.assert_allclose(own, expected, rtol=2e-7, err_msg=name)
        same = (own == expected) | np.isnan(own)
        assert same.mean() > 0.999, name  # pow() may differ in its last bit
    sources = [list(Source).index(each.source) for each in excitations]
    frequency = np.array([each.ratio for each in excitations]) * speeds[:, sources]
    frequency[~(frequency >= 0.0) | np.isnan(angles)[:, np.newaxis]] = math.nan
    np.testing.assert_array_equal(resonance["excitation_frequency"], frequency)
    naturals = predictions.natural_frequencies[:, np.newaxis]
    apart = np.abs(frequency[:, :, np.newaxis] / naturals - 1.0)
    has_speed = np.isfinite(frequency)
    # Orders in the plane are near modes of the vertical half alone.
    mode = np.where(np.isnan(apart) | table.lateral_modes, math.inf, apart).argmin(axis=2)
    np.testing.assert_array_equal(resonance["nearest_mode"], np.where(has_speed, mode + 1, 0))
    rows, columns = np.nonzero(has_speed)
    natural = predictions.natural_frequencies[rows, mode[has_speed]]
    np.testing.assert_array_equal(resonance["margin"][has_speed], frequency[has_speed] - natural)
    relative = (frequency[has_speed] - natural) / natural
    np.testing.assert_array_equal(resonance["relative_margin"][has_speed], relative)
    assert np.isnan(resonance["margin"][~has_speed]).all()
    assert len(columns)


def test_most_severe_excitation(case: Case) -> None:
    """The mode, the margin and the velocity of the monitor's excitation are in the arrays."""
    table, known, excitations, library = case
    predictor = Predictor(table)
    names = [each.name for each in excitations]
    angles, speeds = drawn(table)
    resonance = library.assess(library.predict(angles, 0.0 * angles), speeds)
    compared = 0
    for i in range(200):
        monitor = ResonanceMonitor(excitations, levels=known)
        for source, speed in zip(Source, speeds[i].tolist(), strict=True):
            monitor.set_speed(source, speed, 0)
        first = monitor.assess(predictor.predict(angles[i]), math.nan, 0)
        if first.excitation_index < 0:
            assert not resonance["nearest_mode"][i].any()
            continue
        k = names.index(first.excitation)
        assert resonance["nearest_mode"][i, k] == first.mode + 1
        assert resonance["margin"][i, k] == first.excitation_frequency - first.natural_frequency
        np.testing.assert_allclose(resonance["velocities"][i, k], first.velocities[k], rtol=2e-7)
        compared += 1
    assert compared > 100


def test_load_ratios(case: Case) -> None:
    """Load ratios are those of the node within 1 %, or 1e-5 of the static force."""
    table, known, _, library = case
    angles, speeds = drawn(table)
    resonance = library.assess(library.predict(angles, 0.0 * angles), speeds)
    levels = known.at(angles, speeds.T)
    for name in ("load_ratios", "total_load_ratio"):
        own, expected = resonance[name], getattr(levels, name)
        np.testing.assert_array_equal(np.isnan(own), np.isnan(expected), name)
        np.testing.assert_allclose(own, expected, rtol=0.01, atol=1e-5, err_msg=name)
    assert np.isfinite(resonance["total_load_ratio"]).any() == bool(known.force_places)


def drive(table: Table) -> tuple[Any, Any, Any]:
    """Return times, ns, angles and speeds, (n, 3), of a drive into a resonance and out of it.

    The PTO stays below, in and above the resonance for long and for short, then the same backwards;
    between them there are a gap, a step back, an unknown speed and angles out of the table.
    """
    low, high = table.alpha3_range
    # The monitor alone doubts a speed that goes to and fro without values between both sides.
    ramp = np.append(np.linspace(0.0, 1100.0, 300), np.tile([100.0, 320.0, 540.0, 320.0], 60))
    pto = np.concatenate([ramp, ramp[::-1], ramp])
    n = len(pto)
    times = 20_000_000 * np.arange(n)
    times[n // 2 :] += 5_000_000_000
    times[2 * n // 3 :] -= 2_000_000_000
    speeds = np.column_stack([np.linspace(800.0, 2200.0, n), pto, np.full(n, math.nan)])
    speeds[n // 4 : n // 4 + 30, 1] = math.nan
    angles = 0.5 * (low + high) + 0.45 * (high - low) * np.sin(np.linspace(0.0, 9.0, n))
    angles[n // 5 : n // 5 + 40] = high + 0.1
    return times, angles, speeds


def test_states_over_a_drive(case: Case) -> None:
    """States, dwell and hysteresis are those of the node's monitor in both directions."""
    table, known, excitations, library = case
    times, angles, speeds = drive(table)
    limits = WarningLimits(warning=0.02, note=0.01, dwell=0.3, near=0.1)
    monitor = ResonanceMonitor(excitations, limits, levels=known)
    reports = [
        ReportedSpeed(i, source, speed, int(times[i]))
        for i, row in enumerate(speeds.tolist())
        for source, speed in zip(Source, row, strict=True)
    ]
    predictions = predict_many(Predictor(table), angles, 0.0 * angles)
    still = np.zeros(len(times))
    expected = monitor.assess_many(predictions, still, times, reports, still)
    predicted = library.predict(angles, still)
    faults = library.judge(predicted, library.assess(predicted, speeds), times, limits)
    np.testing.assert_array_equal(faults[:, 0], expected.state)
    # Numbers of exported forces may differ by 0.5 %, which can exchange two loads of one size.
    other = np.flatnonzero(faults[:, 1] != expected.excitation_index)
    assert len(other) < 1e-3 * len(times)
    for i in other:
        loads = known.at(angles[i : i + 1], speeds[i : i + 1].T).load_ratios[0]
        assert loads[faults[i, 1]] == pytest.approx(loads[expected.excitation_index[i]], rel=0.01)
    np.testing.assert_array_equal(faults[:, 2:], expected.states)
    entered = np.flatnonzero(np.diff((faults[:, 0] == ResonanceState.WARNING).astype(int)))
    assert (len(entered) >= 4) == bool(known.force_places)


@pytest.mark.parametrize(("back", "expected"), [(0.999, True), (1.0, False)])
def test_a_small_step_back_of_the_time_ends_no_warning(
    case: Case, back: float, expected: bool
) -> None:
    """A load above its limit warns after 1 s, and goes on unless the time goes back by a second."""
    table, known, _, library = case
    if not known.force_places:
        return
    times = np.rint(1e9 * np.append(np.arange(20) / 10.0, 1.9 - back)).astype(np.int64)
    angles = np.full(len(times), np.mean(table.alpha3_range))
    predicted = library.predict(angles, 0.0 * angles)
    assessed = library.assess(predicted, np.tile([1000.0, 540.0, math.nan], (len(times), 1)))
    limits = WarningLimits(warning=0.0, note=0.0, dwell=1.0)
    warns = library.judge(predicted, assessed, times, limits)[:, 0] == ResonanceState.WARNING
    assert warns.tolist() == [False] * 10 + [True] * 10 + [expected]


_MAIN = """
#include "PREFIX.h"
#include <math.h>
#include <string.h>
static uint64_t state = 88172645463325252u;
static uint64_t drawn(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state;
}
/* Return an extreme number, any bits, or a number of an angle or a speed. */
static double number(void)
{
    static const double extremes[8] = {0.0, -0.0, 1e308, -1e308, 5e-324, NAN, INFINITY, -INFINITY};
    const uint64_t bits = drawn();
    double any;
    memcpy(&any, &bits, sizeof(any));
    switch (drawn() % 4u) {
    case 0: return (double)extremes[drawn() % 8u];
    case 1: return any;
    case 2: return (double)(1.5 + 1.7e-5 * (double)(drawn() % 100000u));
    default: return (double)(3e-2 * (double)(drawn() % 100000u));
    }
}
int main(void)
{
    PREFIX_warnings warnings = {0};
    int i;
    for (i = 0; i < 20000; i++) {
        const double speeds[3] = {number(), number(), number()};
        PREFIX_limits limits = PREFIX_DEFAULT_LIMITS;
        PREFIX_prediction prediction;
        PREFIX_resonance found;
        PREFIX_load_state judged;
        if (i % 2) {
            limits.warning = number();
            limits.near = number();
            limits.dwell = (int64_t)drawn();
        }
        PREFIX_predict(number(), number(), &prediction);
        PREFIX_assess(&prediction, speeds, &found);
        PREFIX_judge(&prediction, &found, &limits, (int64_t)drawn() >> (drawn() % 60u), &warnings,
                     &judged);
        if (judged.excitation < -1 || judged.excitation >= PREFIX_ORDERS) return 1;
    }
    return 0;
}
"""


@pytest.mark.parametrize(
    "name",
    [
        "paper without amplitudes",
        pytest.param("tractor with amplitudes", marks=pytest.mark.nightly),
    ],
)
def test_sanitizers(name: str, tmp_path: Path) -> None:
    """Sanitizers find neither a wrong address nor undefined behaviour, whatever the arguments."""
    write(c_sources(exported_case(name)), tmp_path)
    main = re.sub("PREFIX(?=_DEFAULT|_ORDERS)", NAME.upper(), _MAIN)
    (tmp_path / "main.c").write_text(main.replace("PREFIX", NAME))
    kinds = "-fsanitize=address,undefined,float-cast-overflow"
    command = [require("gcc"), "-std=c99", kinds, "-fno-sanitize-recover=all", f"{NAME}.c"]
    compile_c([*command, "main.c", "-lm", "-o", "run"], tmp_path)
    done = subprocess.run([tmp_path / "run"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", ["tractor with amplitudes", "paper without amplitudes"])
def test_misra(name: str, tmp_path: Path) -> None:
    """A checker of MISRA C:2012 finds no deviation that the source does not list."""
    rules = misra_rules(c_sources(exported_case(name)), tmp_path)
    assert rules <= {"2.5", "7.3", "8.7", "8.9"}


def test_command(tmp_path: Path, capsys: Any) -> None:
    """The command takes excitations, and says that it leaves the ground out."""
    orders = str(config_file("excitations.yaml"))
    assert main(["export", "--excitations", orders, "--c", str(tmp_path)]) == 0
    assert "The ground is left out" in capsys.readouterr().out
    header = (tmp_path / "linkage_vibration.h").read_text()
    assert '_ORDER_NAMES { \\\n    "engine 0.5", \\\n' in header
    assert "_ORDERS 12\n" in header


def test_table_of_another_mechanism(tmp_path: Path, capsys: Any) -> None:
    """Responses need the mechanism of the table."""
    table, orders = (str(config_file(n)) for n in (PAPER_TABLE, "excitations.yaml"))
    other = ["--mechanism", str(config_file(DEFAULT_MECHANISM)), "--c", str(tmp_path / "x")]
    assert main(["export", table, "--excitations", orders, *other]) == 1
    assert "was built from another mechanism" in capsys.readouterr().err


def test_largest_sizes() -> None:
    """They are magnitudes, and those of cells without cubics do not count."""
    cubics = np.array([[0.0, 0.0, 2.0, -7.0], [np.nan] * 4, [0.0, 0.0, 1.0, 4.0]])[..., np.newaxis]
    np.testing.assert_array_equal(largest_sizes(cubics), [7.0])
    np.testing.assert_array_equal(largest_sizes(cubics[1:2]), [0.0])


@pytest.mark.parametrize(("share", "left"), [(1e-8, 1.0), (1e-5, 0.5), (1e-2, 0.5)])
def test_joined_cells(share: float, left: float) -> None:
    """Fewer cells differ from those of a table by no more than the limits, which they use."""
    table = load_table(config_file(PAPER_TABLE))
    starts, cubics = table.cells.arrays
    ends = np.append(starts, table.alpha3_range[1])
    limits = share * largest_sizes(cubics)
    fewer = Cells(*joined_cells(ends, cubics, limits))
    angles = np.linspace(*table.alpha3_range, 20_001)
    off = np.abs(fewer.many_values(angles) - table.cells.many_values(angles)) / limits
    assert 0.5 < off.max() <= 1.0
    assert len(fewer.arrays[0]) < left * len(starts)
    same = joined_cells(ends, cubics, 0.0 * limits)
    assert len(same[0]) == len(starts)
