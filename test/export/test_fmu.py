# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""FMPy validates, compiles and simulates exported FMUs, with the predictions of the node."""

import copy
import ctypes
import subprocess
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("fmpy.build", reason="FMPy is missing or too old; later ones need NumPy 2")

import fmpy
from fmpy.build import build_platform_binary
from fmpy.container_fmu.cli import create_container_fmu
from fmpy.container_fmu.config import Component, Configuration, Connection
from fmpy.fmi2 import FMU2Model, defaultCallbacks, fmi2CallbackLoggerTYPE
from fmpy.model_description import CoSimulation, DefaultExperiment, ModelDescription, ModelVariable
from fmpy.validation import validate_fmu

from linkage_vibration.cli.main import main
from linkage_vibration.export.constants import ExportError
from linkage_vibration.export.fmu import platform_of
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import PREDICTION
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.predictor import Predictor, predict_many
from linkage_vibration.review.log import Log, read_log
from linkage_vibration.support.resources import DEFAULT_TABLE, PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table, save_table
from test.export.test_c import four_bar
from test.support.c_code import STRICT, compile_c
from test.support.fmu import differences, simulate
from test.support.programs import require

INTERFACES = "ModelExchange", "CoSimulation"
PREFIX = "linkage_vibration"
STEP = 0.02  # s


def make(path: Path, *options: str) -> Path:
    """Export an FMU of the shipped table, or of the one that the options name."""
    require("cc")
    assert main(["export", "--fmu", str(path), *options]) == 0
    return path


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an FMU of the shipped table with excitations."""
    orders = str(config_file("excitations.yaml"))
    return make(tmp_path_factory.mktemp("fmu") / "hitch.fmu", "--excitations", orders)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Log:
    """Return the log of the node's predictions for the shipped drive."""
    log = tmp_path_factory.mktemp("drive") / "log.mcap"
    replay(config_file("drives/hitch_duty_cycle.mcap"), log)
    return read_log(log)


@pytest.mark.nightly(short="test_fmpy_compiles_the_sources")
def test_fmpy_finds_no_fault(fmu: Path) -> None:
    """The description, its variables and the files agree with the standard."""
    assert validate_fmu(str(fmu)) == []


def test_description(fmu: Path) -> None:
    """Units and descriptions are those of the message, and limits those of the table."""
    description = fmpy.read_model_description(str(fmu))
    variables = {each.name: each for each in description.modelVariables}
    for field in message_fields(PREDICTION):
        name = f"{field.name}[1]" if field.is_sequence else field.name
        if field.type == "float64":
            assert variables[name].unit == field.unit
            assert variables[name].description.startswith(field.comment)
    angle = variables["crank_angle"]
    assert np.degrees([float(angle.min), float(angle.max)]) == pytest.approx([90.0, 180.0])
    assert "implement heave" in variables["natural_frequencies[8]"].description
    assert "1 STATUS_OUT_OF_RANGE" in variables["status"].description
    assert variables["velocities[3]"].description.endswith("; engine 3")
    assert variables["engine_speed"].unit == "rpm"


@pytest.mark.parametrize("interface", INTERFACES)
def test_drive(fmu: Path, drive: Log, interface: str) -> None:
    """Over the shipped drive it predicts as the node; a co-simulation lags one step."""
    now, before = differences(simulate(fmu, interface, drive, STEP), drive, STEP)
    if interface == "ModelExchange":
        assert now < 1e-9
    else:
        assert before < 1e-9
        assert now > 1e-3  # the lag


@pytest.mark.parametrize("interface", INTERFACES)
def test_outside_the_table(fmu: Path, interface: str) -> None:
    """Outside the table the status says so, and the numbers are NaN."""
    simulated = fmpy.simulate_fmu(
        str(fmu),
        fmi_type=interface,
        start_values={"crank_angle": 0.1, "engine_speed": 2000.0},
        stop_time=0.1,
        output_interval=0.01,
        solver="Euler",
        output=["status", "natural_frequencies[1]", "nearest_mode[1]", "frf_peak_frequency"],
    )
    assert (simulated["status"] == 1).all()
    assert np.isnan(simulated["natural_frequencies[1]"]).all()
    assert (simulated["nearest_mode[1]"] == 0).all()


@pytest.fixture
def instance(fmu: Path, tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Return a function that makes instances for model exchange in continuous time, by FMPy."""
    description, made = fmpy.read_model_description(str(fmu)), []
    folder = fmpy.extract(str(fmu), str(tmp_path / "fmu"))

    def make(angle: float, engine_speed: float = 0.0) -> Any:
        model = FMU2Model(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.modelExchange.modelIdentifier,
        )
        model.instantiate()
        made.append(model)
        model.setupExperiment()
        model.enterInitializationMode()
        model.setReal([1, 3], [angle, engine_speed])
        model.exitInitializationMode()
        model.newDiscreteStates()
        model.enterContinuousTimeMode()
        return model

    yield make
    for model in made:
        model.terminate()
        model.freeInstance()


def references(fmu: Path, *names: str) -> list[int]:
    """Return the value references of variables."""
    variables = fmpy.read_model_description(str(fmu)).modelVariables
    actual = {each.name: each.valueReference for each in variables}
    return [actual[name] for name in names]


def indicators(model: Any, count: int) -> list[float]:
    """Return the event indicators of an instance."""
    values = (ctypes.c_double * count)()
    model.getEventIndicators(values, count)
    return list(values)


def test_integers_change_in_events_alone(fmu: Path, instance: Callable[..., Any]) -> None:
    """Beyond a border an indicator is negative, and the status changes with the event, not before.

    Until then, natural frequencies are those at the border.
    """
    count = fmpy.read_model_description(str(fmu)).numberOfEventIndicators
    [status, heave] = references(fmu, "status", "natural_frequencies[8]")
    model = instance(np.pi - 1e-3)
    assert count == 13  # of the status, and of the nearest modes of twelve excitations
    assert model.getInteger([status]) == [0]
    assert indicators(model, count)[0] == pytest.approx(1e-3)
    model.setReal([1], [np.pi + 2e-3])
    assert indicators(model, count)[0] == pytest.approx(-2e-3)
    assert model.getInteger([status]) == [0]
    assert np.isfinite(model.getReal([heave])).all()
    model.enterEventMode()
    model.newDiscreteStates()
    assert model.getInteger([status]) == [1]
    assert np.isnan(model.getReal([heave])).all()
    model.enterContinuousTimeMode()
    assert indicators(model, count)[0] == pytest.approx(2e-3)
    model.setReal([1], [2.0])
    assert indicators(model, count)[0] < 0.0
    assert np.isnan(model.getReal([heave])).all()  # until the event


def test_nearest_mode_changes_in_events_alone(fmu: Path, instance: Callable[..., Any]) -> None:
    """The indicator of an excitation is negative where another mode is nearer than the held one."""
    nearest, first, frequency = references(
        fmu, "nearest_mode[3]", "natural_frequencies[8]", "excitation_frequency[3]"
    )
    model = instance(2.5, 1000.0)
    natural = model.getReal([first, first + 2])  # between them is a lateral mode
    per_rpm = model.getReal([frequency])[0] / 1000.0
    # Two modes are equally near, relatively, at their harmonic mean.
    middle = 2.0 * natural[0] * natural[1] / (natural[0] + natural[1]) / per_rpm
    model = instance(2.5, 0.99 * middle)
    assert model.getInteger([nearest]) == [8]
    assert indicators(model, 13)[3] > 0.0
    model.setReal([3], [1.01 * middle])
    assert model.getInteger([nearest]) == [8]
    assert indicators(model, 13)[3] < 0.0
    model.enterEventMode()
    model.newDiscreteStates()
    assert model.getInteger([nearest]) == [10]


def test_importer_finds_the_events(fmu: Path) -> None:
    """Over a ramp that leaves the table, FMPy's rows have numbers exactly where the status says."""
    given = np.array([(0.0, 3.0), (1.0, 3.3)], [("time", float), ("crank_angle", float)])
    simulated = fmpy.simulate_fmu(
        str(fmu),
        fmi_type="ModelExchange",
        solver="Euler",
        input=given,
        stop_time=1.0,
        step_size=0.01,
        output_interval=0.01,
        output=["status", "natural_frequencies[8]"],
    )
    assert set(simulated["status"]) == {0, 1}
    outside = simulated["status"] == 1
    np.testing.assert_array_equal(np.isnan(simulated["natural_frequencies[8]"]), outside)
    assert simulated["time"][outside].min() == pytest.approx((np.pi - 3.0) / 0.3, abs=0.02)


def test_two_fmus_in_one_process(tmp_path: Path) -> None:
    """Two FMUs that are loaded at once predict by their own tables, also under one name."""
    models, actual = [], []
    for number, source in enumerate((DEFAULT_TABLE, PAPER_TABLE)):
        table = load_table(config_file(source))
        path = make(tmp_path / f"{number}.fmu", str(config_file(source)))
        model = FMU2Model(
            guid=fmpy.read_model_description(str(path)).guid,
            unzipDirectory=fmpy.extract(str(path), str(tmp_path / str(number))),
            modelIdentifier=PREFIX,
        )
        model.instantiate()
        models.append((model, references(path, "natural_frequencies[1]"), Predictor(table)))
    for model, reference, predictor in models:
        model.setReal([1], [2.4])
        actual.append((*model.getReal(reference), predictor.predict(2.4).natural_frequencies[0]))
    assert actual[0][0] == actual[0][1] != actual[1][0] == actual[1][1]
    for model, _, _ in models:
        model.freeInstance()


def test_container_of_fmpy(tmp_path: Path) -> None:
    """FMPy packs two FMUs into one for co-simulation, of which the second follows the first.

    The angle of the second is a natural frequency of the first, which enters its table at pi / 2.
    Each lags a step behind its input.
    """
    components, predictors = [], []
    for name, source in (("tractor", DEFAULT_TABLE), ("paper", PAPER_TABLE)):
        path = make(tmp_path / f"{name}.fmu", str(config_file(source)), "--name", name)
        components.append(Component(name, path, fmpy.read_model_description(str(path))))
        predictors.append(Predictor(load_table(config_file(source))))
    first, second = components

    def variable(component: Component, name: str) -> ModelVariable:
        variables = component.modelDescription.modelVariables
        return next(each for each in variables if each.name == name)

    model = ModelDescription(fmiVersion="2.0", modelName="both", instantiationToken="both")
    model.guid, model.generationTool = "both", "test"
    model.unitDefinitions = first.modelDescription.unitDefinitions
    model.coSimulation = CoSimulation(canHandleVariableCommunicationStepSize=True)
    model.coSimulation.fixedInternalStepSize = STEP
    model.defaultExperiment = DefaultExperiment(stepSize=str(STEP))
    time = ModelVariable("time", 0, type="Real", causality="independent", variability="continuous")
    angle = replace_variable(variable(first, "crank_angle"), "crank_angle", start="2.0")
    outputs = {
        replace_variable(variable(each, name), f"{each.name}.{name}"): (each, variable(each, name))
        for each in components
        for name in ("natural_frequencies[2]", "status")
    }
    model.modelVariables += [time, angle, *outputs]
    mappings = {angle: [(first, variable(first, "crank_angle"))]}
    mappings |= {output: [pair] for output, pair in outputs.items()}
    coupled = [variable(first, "natural_frequencies[2]")], [variable(second, "crank_angle")]
    connectors = copy.deepcopy(coupled)
    for [connector] in connectors:
        connector.type = "Float64"  # as the container calls it
    connection = Connection(first, connectors[0], second, connectors[1])
    (tmp_path / "both").mkdir()
    create_container_fmu(
        Configuration(False, model, components, [connection], mappings),
        tmp_path / "both",
        tmp_path / "both.fmu",
    )
    given = np.array([(0.0, 2.0), (1.0, 3.0)], [("time", float), ("crank_angle", float)])
    simulated = fmpy.simulate_fmu(
        str(tmp_path / "both.fmu"),
        validate=False,  # FMPy writes no structure of the model
        input=given,
        stop_time=1.0,
        output_interval=STEP,
    )
    assert set(simulated["paper.status"]) == {0, 1}
    late = simulated["time"] > 5 * STEP
    angles = np.interp(simulated["time"] - STEP, given["time"], given["crank_angle"])
    natural = predict_many(predictors[0], angles, 0.0 * angles).natural_frequencies[:, 1]
    np.testing.assert_allclose(
        simulated["tractor.natural_frequencies[2]"][late], natural[late], 1e-12
    )
    followed = np.append(natural[0], natural[:-1])
    expected = predict_many(predictors[1], followed, 0.0 * followed)
    np.testing.assert_array_equal(simulated["paper.status"][late], expected.status[late])
    np.testing.assert_allclose(
        simulated["paper.natural_frequencies[2]"][late],
        expected.natural_frequencies[late, 1],
        1e-12,
    )


def replace_variable(variable: ModelVariable, name: str, start: str | None = None) -> ModelVariable:
    """Return a copy of a variable with another name."""
    changed = copy.copy(variable)
    changed.name, changed.start = name, start
    return changed


def test_states_are_kept(fmu: Path, instance: Callable[..., Any]) -> None:
    """A state that was read, or written to bytes and read again, brings back its outputs."""
    [heave] = references(fmu, "natural_frequencies[8]")
    model = instance(2.2)
    before, state = model.getReal([heave]), model.getFMUstate()
    data = model.serializeFMUstate(state)
    for again in (state, model.deSerializeFMUstate(data)):
        model.setReal([1], [2.9])
        assert model.getReal([heave]) != before
        model.setFMUstate(again)
        assert model.getReal([heave]) == before
        model.freeFMUstate(again)


def test_directional_derivatives(fmu: Path, instance: Callable[..., Any]) -> None:
    """Those of natural frequencies are the slopes; others are those of a line between two calls."""
    names = "natural_frequencies[8]", "damping_ratios[8]", "velocities[3]"
    outputs = references(fmu, *names)
    [slope] = references(fmu, "frequency_slopes[8]")
    model = instance(2.2, 1500.0)
    actual = model.getDirectionalDerivative(outputs, [1, 3], [1.0, 0.0])
    assert actual[0] == model.getReal([slope])[0]
    along = model.getDirectionalDerivative(outputs, [1, 3], [0.5, 40.0])
    ends = [instance(2.2 + 0.5 * h, 1500.0 + 40.0 * h).getReal(outputs) for h in (-1e-5, 1e-5)]
    np.testing.assert_allclose(along, (np.array(ends[1]) - ends[0]) / 2e-5, rtol=1e-5)


def test_refused_instance_says_why(fmu: Path, tmp_path: Path) -> None:
    """With the guid of another export there is no instance, and the logger gets a sentence."""
    folder = fmpy.extract(str(fmu), str(tmp_path / "fmu"))
    model = FMU2Model(guid="of another export", unzipDirectory=folder, modelIdentifier=PREFIX)
    said: list[str] = []
    functions = defaultCallbacks
    kept = functions.logger

    def logger(environment: Any, name: Any, status: int, category: Any, message: bytes) -> None:
        said.append(category.decode())

    functions.logger = fmi2CallbackLoggerTYPE(logger)
    try:
        with pytest.raises(Exception, match="instantiate"):
            model.instantiate(callbacks=functions)
    finally:
        functions.logger = kept
        model.freeLibrary()
    assert said == ["logStatusError"]


def test_documents(fmu: Path) -> None:
    """The FMU has an author, a licence, a page and an icon."""
    with zipfile.ZipFile(fmu) as archive:
        assert archive.read("model.png").startswith(b"\x89PNG")
        page = archive.read("documentation/index.html").decode()
        about = archive.read("modelDescription.xml").decode()
    assert "<h1>three_point_linkage_on_tractor</h1>" in page
    assert 'author="The linkage_vibration authors" license="Apache-2.0"' in about


def elf(machine: int) -> bytes:
    """Return the beginning of a library for Linux."""
    return b"\x7fELF\x02\x01\x01" + bytes(9) + b"\x03\x00" + machine.to_bytes(2, "little")


@pytest.mark.parametrize(
    ("library", "platform"),
    [(elf(62), "linux64"), (elf(183), "aarch64-linux"), (elf(40), "aarch32-linux")],
)
def test_platform_is_that_of_the_library(library: bytes, platform: str) -> None:
    """The header of the library says where it runs, also if another machine compiled it."""
    assert platform_of(library) == platform


@pytest.mark.parametrize("library", [b"", b"text", elf(243)])
def test_library_for_no_platform(library: bytes) -> None:
    """A library of another format or for another processor is refused."""
    with pytest.raises(ExportError, match="not for Linux on an x86 or Arm processor"):
        platform_of(library)


def test_turning_crank(tmp_path: Path) -> None:
    """A crank that turns has no limits, and its numbers repeat after ten turns."""
    save_table(four_bar(), tmp_path / "four_bar.npz")
    path = make(tmp_path / "four_bar.fmu", str(tmp_path / "four_bar.npz"))
    assert validate_fmu(str(path)) == []
    actual = [
        fmpy.simulate_fmu(
            str(path), start_values={"crank_angle": angle}, stop_time=0.1, fmi_type="ModelExchange"
        )["natural_frequencies[1]"][-1]
        for angle in (1.0, 1.0 + 20.0 * np.pi)
    ]
    assert actual[0] == pytest.approx(actual[1], rel=1e-9)
    angle = fmpy.read_model_description(str(path)).modelVariables
    assert all(each.max is None for each in angle if each.name == "crank_angle")


def test_fmpy_compiles_the_sources(drive: Log, tmp_path: Path) -> None:
    """From a source-only FMU, FMPy compiles a library that gives the same numbers."""
    require("cmake")
    path = make(tmp_path / "source.fmu", "--source-only")
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        assert not any(name.startswith("binaries") for name in archive.namelist())
        archive.extractall(tmp_path / "fmu")
    build_platform_binary(tmp_path / "fmu", generator="Unix Makefiles")
    for interface in INTERFACES:
        simulated = simulate(tmp_path / "fmu", interface, drive, STEP)
        assert min(differences(simulated, drive, STEP)) < 1e-9


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_sources_have_no_warnings(fmu: Path, compiler: str, tmp_path: Path) -> None:
    """The wrapper compiles without a warning, also with a prefix of its functions."""
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    prefix = f"-DFMI2_FUNCTION_PREFIX={PREFIX}_"
    for more in ([], [prefix]):
        command = [require(compiler), *STRICT, *more, "-c", "fmi2.c"]
        compile_c(command, tmp_path / "sources")
    symbols = subprocess.run(
        [require("nm"), "fmi2.o"],
        cwd=tmp_path / "sources",
        capture_output=True,
        text=True,
        check=True,
    )
    assert f" T {PREFIX}_fmi2DoStep" in symbols.stdout


def test_equal_exports_have_equal_bytes(tmp_path: Path) -> None:
    """An FMU without a library does not depend on when or where it was exported."""
    paths = [tmp_path / "one.fmu", tmp_path / "other.fmu"]
    for path in paths:
        assert main(["export", "--fmu", str(path), "--source-only"]) == 0
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_names_in_the_description(tmp_path: Path) -> None:
    """Names of excitations that XML would misread are escaped."""
    orders = tmp_path / "orders.yaml"
    orders.write_text('"a < b & \\"c\\" */": {speed: engine, orders: [1]}\n')
    options = ["--excitations", str(orders), "--source-only"]
    assert main(["export", "--fmu", str(tmp_path / "x.fmu"), *options]) == 0
    description = fmpy.read_model_description(str(tmp_path / "x.fmu"))
    actual = {each.name: each.description for each in description.modelVariables}
    assert actual["margin[1]"].endswith('; a < b & "c" */ 1')


def test_without_a_compiler(tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says what to install, and how to do without it."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    assert main(["export", "--fmu", str(tmp_path / "x.fmu")]) == 1
    assert "No C compiler was found" in capsys.readouterr().err
    monkeypatch.setenv("CC", "/nowhere/cc")
    assert main(["export", "--fmu", str(tmp_path / "x.fmu")]) == 1
    assert "/nowhere/cc cannot be run" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.fmu"))


def test_compiler_that_fails(tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error contains what the compiler said."""
    script = tmp_path / "cc"
    script.write_text("#!/bin/sh\necho 'no space left' >&2\nexit 1\n")
    script.chmod(0o755)
    monkeypatch.setenv("CC", str(script))
    assert main(["export", "--fmu", str(tmp_path / "x.fmu")]) == 1
    assert "cannot build the FMU (no space left)" in capsys.readouterr().err
