# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A linkage with a lateral half has one list of modes, wherever a user sees them."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.signal import lfilter

from linkage_vibration.cli.main import main
from linkage_vibration.drawing.geometry import curves, left_curves
from linkage_vibration.drawing.pose_picture import draw_pose
from linkage_vibration.export.constants import ExportError
from linkage_vibration.export.exported import export_of
from linkage_vibration.listening.amplitudes import predicted_levels, unit_responses
from linkage_vibration.listening.drive_modes import model_shapes, search_modes
from linkage_vibration.listening.model_check import drive_targets
from linkage_vibration.listening.output_only import finish
from linkage_vibration.listening.sensor_response import SensorResponse
from linkage_vibration.mechanics.model import LinkageModel, ModelError
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.prediction.answers import (
    LoadedModel,
    ModelWithoutTable,
    answer_frf,
    answer_mode_shapes,
)
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.loads import FORCE, Load
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor, ResonanceState
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.readers.targets import Target
from linkage_vibration.review.picture import plot
from linkage_vibration.studies.calibration import CalibrationError, _natural_frequencies
from linkage_vibration.studies.measurement import compare
from linkage_vibration.studies.ringdown import MeasuredMode
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.cells import Cells, JoinedCells
from linkage_vibration.table.table import Table, TableError, load_table, save_table
from linkage_vibration.table.tabulation import build_table
from test.support.c_code import Library

IN_SPACE = config_file("three_point_linkage_in_space.yaml")
LATERAL = ["tractor sway", "tractor yaw", "implement roll", "tractor roll", "implement sway"]


@pytest.fixture(scope="module")
def table() -> Table:
    """Return the table of the shipped hitch in space, exact."""
    mechanism = replace(read_mechanism(IN_SPACE), uncertainty=None)
    return build_table(LinkageModel(mechanism), 1e-5)


@pytest.fixture(scope="module")
def served(table: Table) -> LoadedModel:
    """Return what a node of this table serves."""
    mechanism = replace(read_mechanism(IN_SPACE), uncertainty=None)
    return ModelWithoutTable(mechanism, IN_SPACE.read_text()).with_predictor(Predictor(table))


def both(alpha3: float) -> list[Any]:
    """Return the solutions of the models of both halves."""
    return [half.solve(alpha3) for half in LinkageModel(read_mechanism(IN_SPACE)).halves]


def test_both_halves_in_one_file(table: Table, tmp_path: Path) -> None:
    """A file keeps both, and its checksum is of both."""
    save_table(table, tmp_path / "table.npz")
    again = load_table(tmp_path / "table.npz", replace(read_mechanism(IN_SPACE), uncertainty=None))
    assert again.lateral is not None
    assert table.lateral is not None
    assert again.lateral.checksum == table.lateral.checksum != table.checksum
    assert again.checksum == table.checksum != table.vertical.checksum
    np.testing.assert_array_equal(again.natural_frequencies, table.natural_frequencies)
    spoiled = dict(np.load(tmp_path / "table.npz"))
    spoiled["lateral_natural_frequencies"] *= 1.001
    np.savez(tmp_path / "spoiled.npz", **spoiled)
    with pytest.raises(TableError, match="checksum differs"):
        load_table(tmp_path / "spoiled.npz")


@pytest.mark.parametrize("alpha3_deg", [90.0, 97.0, 135.0, 171.0, 180.0])
def test_one_list_of_modes(table: Table, alpha3_deg: float) -> None:
    """It is what the models of both halves, which finite elements confirm, have together."""
    alpha3, names = math.radians(alpha3_deg), np.array(table.mode_names)
    vertical, lateral = (solution.natural_frequencies[:6] for solution in both(alpha3))
    found = Predictor(table).predict(alpha3)
    frequencies = found.natural_frequencies
    np.testing.assert_allclose(frequencies[table.lateral_modes], lateral, rtol=1e-5)
    np.testing.assert_allclose(frequencies[~table.lateral_modes], vertical, rtol=1e-5)
    assert names[table.lateral_modes].tolist() == [*LATERAL, "implement yaw"]
    assert names[~table.lateral_modes][3] == "implement heave"
    assert alpha3_deg > 90.0 or (np.diff(frequencies) > 0.0).all()
    many = Predictor(table).predict(np.array([2.0, alpha3]))
    np.testing.assert_array_equal(many.natural_frequencies[1], frequencies)
    np.testing.assert_array_equal(many.frequency_slopes[1], found.frequency_slopes)


def test_slopes_and_the_peak(table: Table) -> None:
    """Slopes are differences of frequencies; the peak is that of the vertical half."""
    predictor, step = Predictor(table), 1e-6
    low, here, high = (predictor.predict(2.2 + k * step) for k in (-1, 0, 1))
    differences = (high.natural_frequencies - low.natural_frequencies) / (2.0 * step)
    np.testing.assert_allclose(here.frequency_slopes, differences, rtol=1e-4, atol=1e-6)
    own = Predictor(table.vertical).predict(2.2)
    assert here.frf_peak_magnitude == pytest.approx(own.frf_peak_magnitude, rel=1e-12)


def test_frfs_of_both_halves(served: LoadedModel) -> None:
    """Inputs along y excite the lateral half, others the vertical one; no request may mix them."""
    alpha3, lines = math.radians(135.0), np.array([0.5, 2.0, 20.0])
    for half, places, drive in ((1, ["E1.y", "V1.x"], "E1.y"), (0, ["E1.z", "V1.x"], "E1.z")):
        expected = both(alpha3)[half].frf(places, [drive]).frf(lines)
        for exact, error in ((True, 1e-9), (False, 2e-3)):
            answer = answer_frf(served, alpha3, places, [drive], lines, exact=exact)
            size = np.abs(expected).max()
            np.testing.assert_allclose(answer.frf, expected, rtol=error, atol=error * size / 2.0)
    for outputs, inputs, why in (
        (["E1.y"], ["E1.y", "E1.z"], "give one kind at a time"),
        (["E1.y"], ["E1.z"], "nothing moves along y"),
    ):
        for exact in (True, False):
            with pytest.raises(ModelError, match=why):
                answer_frf(served, alpha3, outputs, inputs, lines, exact=exact)


def test_shapes_of_both_halves(served: LoadedModel) -> None:
    """The receptance along y is about the sum of shape^2 / omega^2 of the lateral modes at rest."""
    modes = answer_mode_shapes(served, 2.3)
    assert (np.diff(modes.natural_frequencies) > 0.0).all()
    at = modes.places.index(("E1", "y"))
    answer = answer_frf(served, 2.3, ["E1.y"], ["E1.y"], np.array([0.0]), exact=True)
    squares = (modes.shapes[:, at] / (2.0 * math.pi * modes.natural_frequencies)) ** 2
    assert answer.frf[0, 0, 0] == pytest.approx(squares.sum(), rel=0.01)
    assert modes.positions[at] == 0.4  # the lower hitch point is 0.40 m left of the middle
    heave = int(np.abs(modes.shapes[:, at + 1]).argmax())
    assert modes.shapes[heave, at] == 0.0


def test_orders_in_the_plane_excite_no_lateral_mode(table: Table, served: LoadedModel) -> None:
    """An order at the sway of the implement is near a mode of the vertical half, if near any."""
    pto = Excitation("pto 1", Source.PTO, 1.0 / 60.0)
    watch = ResonanceMonitor([pto], levels=LevelTable(served.predictor, served.mechanism, [pto]))
    prediction, found = served.predictor.predict(2.3), []
    for name in ("implement sway", "implement heave"):
        hertz = prediction.natural_frequencies[table.mode_names.index(name)]
        watch.set_speed(Source.PTO, 60.0 * float(hertz), 0)
        found.append(watch.assess(prediction, 0.0, 0))
    sway, heave = found
    assert not table.lateral_modes[sway.mode]
    assert sway.state == ResonanceState.UNKNOWN or sway.state == ResonanceState.CLEAR
    assert table.mode_names[heave.mode] == "implement heave"
    assert heave.state == ResonanceState.NOTE


def test_exported_c_has_one_list(table: Table, served: LoadedModel, tmp_path: Path) -> None:
    """C predicts the modes of both halves; an order is near those in the plane alone."""
    pto = Excitation("pto 1", Source.PTO, 1.0 / 60.0)
    export = export_of(table, served.mechanism, [pto])
    assert export.mode_labels[2] == f"mode 3 ({table.mode_names[2]})"
    library, angles = Library(tmp_path, export), np.linspace(*table.alpha3_range, 50)
    predicted, speeds = library.predict(angles, 0.0 * angles), np.full((50, 3), math.nan)
    naturals = table.evaluate(angles)[:, : table.n_modes]
    np.testing.assert_array_equal(predicted["natural_frequencies"], naturals)
    for hertz in (1.0, 2.3, 5.0, 60.0):
        speeds[:, list(Source).index(Source.PTO)] = 60.0 * hertz
        apart = np.abs(hertz / naturals - 1.0)
        apart[:, table.lateral_modes] = math.inf
        nearest = library.assess(predicted, speeds)["nearest_mode"][:, 0]
        np.testing.assert_array_equal(nearest, apart.argmin(axis=1) + 1)


def test_cells_of_both_halves_side_by_side() -> None:
    """They are the cubics of each half, and where one half has none, what this half finds."""
    cubic = np.array([[[2.0], [-1.0], [0.5], [3.0]]])  # 2 t^3 - t^2 + t / 2 + 3 from 1 rad on
    known = Cells(np.array([1.0]), cubic)
    broken = np.zeros((3, 4, 1))
    broken[1, 3], broken[2, 2:] = math.inf, [[1.0], [7.0]]
    finder: Any = SimpleNamespace(values=lambda i, x: [10.0 * x], slopes=lambda i, x: [10.0])
    both = JoinedCells([Cells(np.array([1.0, 1.25, 1.5]), broken, finder), known], np.array([1, 0]))
    for x, other, slope in ((1.1, 0.0, 0.0), (1.3, 13.0, 10.0), (1.7, 7.2, 1.0)):
        t = x - 1.0
        values = [2.0 * t**3 - t**2 + t / 2.0 + 3.0, other]
        assert both.values(x) == pytest.approx(values, rel=1e-14)
        assert both.many_values(np.array([x]))[0].tolist() == both.values(x)
        assert both.slopes(x) == pytest.approx([6.0 * t**2 - 2.0 * t + 0.5, slope], rel=1e-13)


def test_listening_names_lateral_modes(table: Table, served: LoadedModel) -> None:
    """Of accelerations along x, y and z it finds both kinds of modes, each under its own name.

    The simulated modes are independent, and 3 % below those of the table.
    """
    rate, alpha3, random = 50.0, 2.3, np.random.default_rng(5)
    places = [("E1", axis) for axis in "xyz"]
    shapes = model_shapes(table, alpha3, places).real
    prediction = served.predictor.predict(alpha3)
    times = np.arange(0.0, 240.0, 1.0 / rate)
    signals, true = random.normal(0.0, 1e-3, (len(times), 3)), {}
    for name in ("implement roll", "implement sway", "implement heave"):
        mode = table.mode_names.index(name)
        true[mode] = 0.97 * prediction.natural_frequencies[mode]
        pole = np.exp(2.0 * math.pi * true[mode] * (-0.02 + 1j) / rate)
        motion = lfilter(
            [1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], random.normal(size=len(times))
        )
        shape = shapes[:, mode] / np.abs(shapes[:, mode]).max()
        signals += np.outer(motion / motion.std(), shape)
    angle, still = np.full(len(times), alpha3), {Source.GROUND: np.zeros(len(times))}
    found = finish(search_modes(table, served.mechanism, times, signals, places, angle, still))
    sure = {each.mode: each for each in found if not each.doubt}
    assert sure.keys() == true.keys()
    for mode, each in sure.items():
        assert abs(each.frequency - true[mode]) < 3.0 * each.frequency_stddev
    targets = yaml.safe_load(drive_targets(found, table, IN_SPACE, IN_SPACE.parent / "f.yaml"))
    asked = {(each.get("half", "vertical"), each["mode"]) for each in targets["targets"]}
    assert asked == {("lateral", 3), ("lateral", 5), ("vertical", 4)}


def test_measured_modes_of_both_halves() -> None:
    """Measured modes belong to the nearest modes of either half, which calibrate under `half`."""
    model = LinkageModel(read_mechanism(IN_SPACE))
    vertical, lateral = (half.solve(2.3).natural_frequencies for half in model.halves)
    hertz = (1.002 * lateral[2], 1.002 * lateral[4], 1.002 * vertical[3])
    measured = [MeasuredMode(hz, 0.03, 1e-3 * hz, 1e-3, 5) for hz in hertz]
    found = [str(each.mode) for each in compare(model, 2.3, measured)]
    assert found[0] == "lateral mode 3 (implement roll)"
    assert found[1:] == ["lateral mode 5 (implement sway)", "mode 4 (implement heave)"]
    targets = [Target(5, 2.3, 1.0, 0.01, "lateral"), Target(4, 2.3, 1.0, 0.01)]
    assert str(targets[0]) == "lateral mode 5 at 131.78 deg"
    frequencies = _natural_frequencies(model, targets)
    np.testing.assert_allclose(frequencies, [lateral[4], vertical[3]], rtol=1e-12)
    flat = LinkageModel(replace(read_mechanism(IN_SPACE), lateral=None))
    with pytest.raises(CalibrationError, match="has no `lateral` half"):
        _natural_frequencies(flat, targets)


def test_pictures_of_both_halves(table: Table, tmp_path: Path) -> None:
    """Lateral modes are dashed; a pose is drawn from behind, too; shapes are of the left side."""
    figure = plot(table)
    styles = [line.get_linestyle() for line in figure.axes[0].lines]
    assert styles == ["--" if lateral else "-" for lateral in table.lateral_modes]
    vertical, lateral = LinkageModel(read_mechanism(IN_SPACE)).halves
    draw_pose(vertical, 2.3, tmp_path / "pose.png")
    solution = lateral.solve(2.3)
    moved = left_curves(solution, 2, vertical)
    assert {name: len(curve) for name, curve in moved.items()} == {
        name: len(curve) for name, curve in curves(vertical, solution.configuration).items()
    }
    shown = moved["lower_link"][-1], moved["implement"][0]  # both are E1
    np.testing.assert_allclose(shown[0], shown[1], rtol=1e-9)
    expected = solution.participation(["E1.x", "E1.z"])[:, 2]
    np.testing.assert_allclose(shown[1], expected, rtol=1e-12)


def test_without_lateral_there_is_one_half() -> None:
    """A committed table is its own vertical half."""
    shipped = load_table(config_file("tables/three_point_linkage_on_tractor.npz"))
    assert shipped.lateral is None
    assert shipped.vertical is shipped
    assert not shipped.lateral_modes.any()


def test_an_uncertain_chain() -> None:
    """The deviation of each mode is what its own change with the chain gives, to first order."""
    mapping: Any = yaml.safe_load(IN_SPACE.read_text())
    mapping["uncertainty"] = {"relative": {"lateral.chains.check_chain.stiffness": 0.05}}
    lateral = build_table(
        LinkageModel(mechanism_from_mapping(mapping), half="lateral"), 1e-3, points=["E1"]
    )
    del mapping["uncertainty"]
    frequencies = []
    for stiffness in (4.9e6, 5.1e6):
        mapping["lateral"]["chains"]["check_chain"]["stiffness"] = stiffness
        model = LinkageModel(mechanism_from_mapping(mapping), half="lateral")
        frequencies.append(model.solve(2.2).natural_frequencies[:5])
    rate = np.log(frequencies[1] / frequencies[0]) / math.log(5.1 / 4.9)
    prediction = Predictor(lateral).predict(2.2)
    found = (prediction.frequency_stddevs / prediction.natural_frequencies)[:5]
    assert found[4] == pytest.approx(0.05 * abs(rate[4]), rel=0.15)
    assert found[3] < 0.2 * found[4]


def test_commands(table: Table, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`predict` prints the names of the modes of both halves, and their frequencies in one row."""
    save_table(table, tmp_path / "both.npz")
    assert main(["predict", str(tmp_path / "both.npz"), "135"]) == 0
    words, row = capsys.readouterr().out.split("alpha3 [deg]")
    labels = words.replace("\n", " ").strip().split(", ")
    assert labels == [table.mode_label(mode) for mode in range(12)]
    sway = table.mode_names.index("implement sway")
    assert float(row.splitlines()[1].split()[1 + sway]) == pytest.approx(5.05, abs=0.02)


def test_what_leaves_orders_across_the_plane_out(table: Table) -> None:
    """An export refuses them, and no level that they add to is predicted at a sensor."""
    mechanism = replace(read_mechanism(IN_SPACE), uncertainty=None)
    upright, across = (
        Excitation(at, Source.PTO, 1.0, Load(FORCE, at, 300.0, 1.0, 0.0, 0.0))
        for at in ("E1.z", "E1.y")
    )
    with pytest.raises(ExportError, match=r"excitation E1\.y acts across the plane"):
        export_of(table, mechanism, [upright, across])
    sensor: Any = SimpleNamespace(at="E1", accelerates=True, name="mast")
    for excitations, known in (([upright], True), ([upright, across], False)):
        transfer = SensorResponse(table, mechanism, excitations, sensor)
        zeros = np.zeros((1, len(excitations)))
        orders: Any = SimpleNamespace(
            frequencies=zeros + 5.0, speeds=zeros + 5.0, squares=zeros, noise=zeros, detected=zeros
        )
        units = unit_responses(transfer, orders, np.array([2.0]))
        levels, _ = predicted_levels(transfer, excitations, orders, units, [Source.PTO])
        assert np.isfinite(levels).tolist() == [known]
