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
from linkage_vibration.drawing.pose_picture import pose_figure
from linkage_vibration.export.constants import ExportError, export_of
from linkage_vibration.listening.amplitudes import predicted_levels, unit_responses
from linkage_vibration.listening.drive_modes import MeasuredDrive, model_shapes, search_modes
from linkage_vibration.listening.model_check import drive_targets
from linkage_vibration.listening.output_only import finish
from linkage_vibration.listening.sensor_response import SensorResponse
from linkage_vibration.mechanics.model import LinkageModel, ModelError
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.prediction.answers import LoadedModel, answer_frf, answer_mode_shapes
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
from linkage_vibration.support.resources import (
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    PAPER_TABLE,
    config_file,
)
from linkage_vibration.table.cells import Cells, JoinedCells
from linkage_vibration.table.table import Table, TableError, load_table, save_table
from linkage_vibration.table.tabulation import build_table
from test.support.c_code import Library
from test.support.hitch_in_space import hitch
from test.support.served import shipped

IN_SPACE = config_file(DEFAULT_MECHANISM)
LATERAL = ["tractor sway", "tractor yaw", "implement roll", "tractor roll", "implement sway"]


@pytest.fixture(scope="module")
def table() -> Table:
    """Return the table of the shipped hitch."""
    return load_table(config_file(DEFAULT_TABLE))


@pytest.fixture(scope="module")
def served() -> LoadedModel:
    """Return what a node of this table serves."""
    return shipped()


def both(alpha3: float) -> list[Any]:
    """Return the solutions of the models of both halves."""
    return [half.solve(alpha3) for half in LinkageModel(read_mechanism(IN_SPACE)).halves]


def test_both_halves_in_one_file(table: Table, tmp_path: Path) -> None:
    """A file keeps both, and its checksum is of both."""
    save_table(table, tmp_path / "table.npz")
    again = load_table(tmp_path / "table.npz", read_mechanism(IN_SPACE))
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
            np.testing.assert_allclose(answer.values, expected, rtol=error, atol=error * size / 2.0)
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
    assert answer.values[0, 0, 0] == pytest.approx(squares.sum(), rel=0.01)
    assert modes.positions[at] == 0.4  # the lower hitch point is 0.40 m left of the middle
    heave = int(np.abs(modes.shapes[:, at + 1]).argmax())
    assert modes.shapes[heave, at] == 0.0


@pytest.mark.parametrize("at", ["", "E1.z", "E1.y"])
def test_orders_are_near_modes_of_their_half(table: Table, served: LoadedModel, at: str) -> None:
    """An order in the plane is near the heave and never the sway; one across, the other way round.

    Without an amplitude, an order is in the plane.
    """
    load = Load(FORCE, at, 3000.0, 1.0, 0.0, 0.0) if at else None
    pto, across = Excitation("pto 1", Source.PTO, 1.0 / 60.0, load), at == "E1.y"
    watch = ResonanceMonitor([pto], levels=LevelTable(served.predictor, served.mechanism, [pto]))
    prediction, found = served.predictor.predict(2.3), []
    for name in ("implement heave", "implement sway"):
        hertz = prediction.natural_frequencies[table.mode_names.index(name)]
        watch.set_speed(Source.PTO, 60.0 * float(hertz), 0)
        found.append(watch.assess(prediction, 0.0, 0))
    own, other = found[across], found[not across]
    assert table.mode_names[own.mode] == ("implement sway" if across else "implement heave")
    assert own.state == ResonanceState.NOTE
    assert table.lateral_modes[other.mode] == across
    assert at or other.state in (ResonanceState.UNKNOWN, ResonanceState.CLEAR)


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
    drive = MeasuredDrive(table, served.mechanism, times, signals, places, angle, still)
    found = finish(search_modes(drive))
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


def test_blows_from_the_side(tmp_path: Path, capsys: Any) -> None:
    """`measure` names the modes that an accelerometer across shows; `calibrate` finds the chain.

    The signals are free decays at the frequencies of finite elements with a chain of 3 MN/m.
    """
    rate, true = 200.0, hitch(2.2, tractor=False, weight=True, chain=3e6)[0][:2]
    both: Any = yaml.safe_load(IN_SPACE.read_text())
    mapping = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    mapping.pop("uncertainty", None)
    del both["lateral"]["axles"], both["lateral"]["inertia"]["base"]
    own = mapping | {"lateral": both["lateral"]}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(own, sort_keys=False))
    times = np.arange(0.0, 80.0, 1.0 / rate)
    since = times % 10.0 - 1.0
    waves = [np.exp(-0.02 * w * since) * np.sin(w * since) for w in 2.0 * math.pi * true]
    signal = np.where(since >= 0.0, sum(waves), 0.0)
    signal += np.random.default_rng(3).normal(0.0, 1e-3, len(times))
    columns = np.column_stack([times, signal])
    titles = "time (s),acceleration y (m/s2)"
    np.savetxt(tmp_path / "y.csv", columns, "%.5f", ",", header=titles, comments="")
    recording, fit = f"{math.degrees(2.2)}:{tmp_path / 'y.csv'}", str(tmp_path / "fit.yaml")
    given = ["--mechanism", str(tmp_path / "mine.yaml"), "-o", fit]
    assert main(["measure", recording, *given]) == 0
    shown = capsys.readouterr().out
    assert "lateral mode 1 (implement roll)" in shown
    assert "lateral mode 2 (implement sway)" in shown
    content = yaml.safe_load((tmp_path / "fit.yaml").read_text())
    content["parameters"] = {"lateral.chains.check_chain.stiffness": [1e6, 1e7]}
    (tmp_path / "fit.yaml").write_text(yaml.safe_dump(content))
    assert main(["calibrate", fit, "-o", str(tmp_path / "fitted.yaml"), "--starts", "1"]) == 0
    fitted = yaml.safe_load((tmp_path / "fitted.yaml").read_text())
    found = fitted["lateral"]["chains"]["check_chain"]["stiffness"]
    assert found == pytest.approx(3e6, rel=0.05)


def test_pictures_of_both_halves(table: Table) -> None:
    """Lateral modes are dashed; a pose is drawn from behind, too; shapes are of the left side."""
    figure = plot(table)
    styles = [line.get_linestyle() for line in figure.axes[0].lines]
    assert styles == ["--" if lateral else "-" for lateral in table.lateral_modes]
    vertical, lateral = LinkageModel(read_mechanism(IN_SPACE)).halves
    assert len(pose_figure(vertical, 2.3).axes) == 2
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
    paper = load_table(config_file(PAPER_TABLE))
    assert paper.lateral is None
    assert paper.vertical is paper
    assert not paper.lateral_modes.any()


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
    """`predict` prints the names of the modes of both halves, and their frequencies beside them."""
    save_table(table, tmp_path / "both.npz")
    assert main(["predict", str(tmp_path / "both.npz"), "135"]) == 0
    rows = [line.split(" [Hz]") for line in capsys.readouterr().out.splitlines()[1:13]]
    assert [label for label, _ in rows] == [table.mode_label(mode) for mode in range(12)]
    sway = table.mode_names.index("implement sway")
    assert float(rows[sway][1]) == pytest.approx(5.11, abs=0.02)


def test_what_leaves_orders_across_the_plane_out(table: Table) -> None:
    """An export refuses them, and no level that they add to is predicted at a sensor."""
    mechanism = read_mechanism(IN_SPACE)
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
