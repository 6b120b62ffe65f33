# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What explains modes that a changed model makes, and targets that `calibrate` reads."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmark.listening.simulation import GRID, HEAVE, SENSORS, Scene, modes, simulate
from linkage_vibration.listening.drive_modes import DriveMode, MeasuredDrive, search_modes
from linkage_vibration.listening.model_check import (
    DriveError,
    difference_text,
    drive_targets,
    explanations,
    number_effects,
)
from linkage_vibration.listening.output_only import finish
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import with_numbers
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.readers.mechanism import load_yaml, read_mechanism
from linkage_vibration.studies.calibration import calibrate, read_calibration, write_mechanism
from linkage_vibration.support.resources import config_file
from test.support.first_order import first_order
from test.support.in_plane import in_plane, plane_mechanism, plane_table

FILE = config_file("three_point_linkage_on_tractor.yaml")
MASS = "rigid_bodies.implement.mass"
MODE = DriveMode(2.5, 3, 8.0, 0.08, 0.003, 7.6, 0.038, 0.02, 0.002, (30.0,))


def test_a_heavier_implement_explains_its_modes() -> None:
    """Of a model with 10 % more mass, one deviation of the mass explains nearly everything."""
    model = LinkageModel(plane_mechanism())
    mapping = with_numbers(in_plane(load_yaml(FILE)[0]), [(MASS, 880.0)])
    heavier = LinkageModel(mechanism_from_mapping(mapping))
    measured = []
    for alpha3 in (1.9, 2.4, 2.9):
        pairs = [each.solve(alpha3).natural_frequencies for each in (model, heavier)]
        for mode in (0, 3):
            predicted, actual = (float(each[mode]) for each in pairs)
            values = predicted, 0.08, 0.001, actual, 0.002 * actual
            measured.append(DriveMode(alpha3, mode, *values, 0.02, 0.002, (30.0,)))
    table, mechanism = plane_table(), plane_mechanism()
    best = explanations(table, mechanism, measured)[0]
    assert best.path == MASS
    assert best.change == pytest.approx(1.0, abs=0.1)
    assert best.left < 0.1
    doubted = [replace(each, doubt="a reason") for each in measured]
    assert explanations(table, mechanism, doubted) == ()
    bare = replace(table, ensemble_alpha3=np.empty(0))
    assert explanations(bare, mechanism, measured) == ()


def test_sentences() -> None:
    """A mode that is 5 % lower with 8 % is consistent, and with 1 % not; a doubt is named."""
    text = difference_text(MODE, "heave")
    assert text == (
        "The heave at 143.2 deg is 5.0 % lower than predicted, 7.600 +- 0.038 Hz: "
        "consistent, 0.6 standard deviations."
    )
    known = difference_text(replace(MODE, predicted_stddev=0.01), "heave")
    assert known.endswith("Hz: not consistent, 4.4 standard deviations.")
    unknown = difference_text(replace(MODE, predicted_stddev=math.nan), "heave")
    assert unknown.endswith("not known, because the deviation of the prediction is not known.")
    doubted = difference_text(replace(MODE, doubt="engine 1 was near"), "heave")
    assert doubted == "The heave at 143.2 deg, 7.600 Hz, is doubtful: engine 1 was near."


@pytest.mark.nightly(short="test_targets")
def test_targets_of_a_drive_calibrate(tmp_path: Path) -> None:
    """Targets of a drive with 20 % more mass bring the heave nearer to the truth everywhere.

    At the two heights of the drive it is within 1 %.
    """
    drive = simulate(3, Scene(mass=1.2, oil=1.0, road=256e-6, seconds=180.0))
    table, mechanism = plane_table(), plane_mechanism()
    speeds = {Source(name): values for name, values in drive.speeds.items()}
    given = drive.times, drive.signals, SENSORS, drive.crank_angle, speeds
    found = finish(search_modes(MeasuredDrive(table, mechanism, *given)))
    actual = [mode for mode in found if mode.mode == HEAVE]
    described, path, fitted = (tmp_path / f"{each}.yaml" for each in ("own", "targets", "fitted"))
    numbers = {MASS: 0.1, "rigid_bodies.implement.inertia": 0.1}
    uncertainty = {"uncertainty": {"relative": numbers}}
    described.write_text(
        yaml.safe_dump(in_plane(load_yaml(FILE)[0]) | uncertainty, sort_keys=False)
    )
    path.write_text(drive_targets(actual, table, described, path))
    task = read_calibration(path)
    assert len(task.targets) == 2
    result = calibrate(task, starts=1)
    write_mechanism(task, result, fitted)
    model, heights = LinkageModel(read_mechanism(fitted)), [float(each.at) for each in task.targets]
    true = np.abs(modes(1.2, 1.0, False)[0][:, HEAVE]) / (2.0 * math.pi)
    after = [model.solve(alpha3).natural_frequencies[HEAVE] for alpha3 in GRID.tolist()]
    errors = np.abs(after / true - 1.0)
    assert errors.max() < np.abs(table.evaluate(GRID)[:, HEAVE] / true - 1.0).max()
    assert np.interp(heights, GRID, errors).max() < 0.01
    mass = result.names.index(MASS)
    stddev = math.sqrt(result.covariance[mass, mass])
    assert abs(math.log(result.values[mass] / (1.2 * 800.0))) < 3.0 * stddev


def test_targets(tmp_path: Path) -> None:
    """A calibration reads the targets of modes without doubts; without any there is an error."""
    doubted, table = replace(MODE, doubt="a reason"), plane_table()
    path = tmp_path / "fit.yaml"
    path.write_text(drive_targets([MODE, doubted], table, FILE, path))
    [target] = read_calibration(path).targets
    assert (target.mode, target.frequency) == (4, 7.6)
    assert target.at == pytest.approx(2.5)
    assert target.deviation == pytest.approx(math.hypot(0.005, 0.003), rel=1e-2)
    with pytest.raises(DriveError, match="no mode of the drive is without doubt"):
        drive_targets([doubted], table, FILE, path)


def test_effects_are_those_of_the_model() -> None:
    """Each number changes each mode as the derivatives of the model say, and all of them together.

    They are differences over standard deviations of up to 25 %, so higher orders remain: up to 4 %,
    and 0.002. These limits were set at other heights.
    """
    table, mechanism = plane_table(), plane_mechanism()
    assert mechanism.uncertainty is not None
    heights = np.random.default_rng(7).uniform(*table.alpha3_range, 3).tolist()
    effects = number_effects(table, mechanism, np.array(heights))
    variances = np.einsum("iak,ij,jak->ak", effects, mechanism.uncertainty.correlation, effects)
    np.testing.assert_allclose(
        np.sqrt(variances),
        table.evaluate_parameter_deviations(np.array(heights))[:, : table.n_modes],
        rtol=0.03,
    )
    exact = first_order(LinkageModel(mechanism), heights, 4).swapaxes(0, 1)
    np.testing.assert_allclose(effects[..., :4], exact, 0.04, 2e-3)
