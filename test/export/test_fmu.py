# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""FMPy validates, compiles and simulates exported FMUs, with the predictions of the node."""

import subprocess
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("fmpy.build", reason="FMPy is missing or too old; later ones need NumPy 2")

import fmpy
from fmpy.build import build_platform_binary
from fmpy.validation import validate_fmu

from linkage_vibration.cli.main import main
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import PREDICTION
from linkage_vibration.playback.replay import replay
from linkage_vibration.review.log import Log, read_log
from linkage_vibration.support.resources import PAPER_TABLE, config_file
from linkage_vibration.table.table import save_table
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


def test_fmpy_finds_no_fault(fmu: Path) -> None:
    """The description, its variables and the files agree with the standard."""
    assert validate_fmu(str(fmu)) == []


def test_description(fmu: Path) -> None:
    """Units and descriptions are those of the message, and limits those of the table."""
    description = fmpy.read_model_description(str(fmu))
    variables = {one.name: one for one in description.modelVariables}
    for field in message_fields(PREDICTION):
        name = f"{field.name}[1]" if field.is_sequence else field.name
        if field.type == "float64":
            assert variables[name].unit == field.unit
            assert variables[name].description.startswith(field.comment)
    angle = variables["crank_angle"]
    assert np.degrees([float(angle.min), float(angle.max)]) == pytest.approx([90.0, 180.0])
    assert "implement heave" in variables["natural_frequencies[4]"].description
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
    found = fmpy.simulate_fmu(
        str(fmu),
        fmi_type=interface,
        start_values={"crank_angle": 0.1, "engine_speed": 2000.0},
        stop_time=0.1,
        output_interval=0.01,
        solver="Euler",
        output=["status", "natural_frequencies[1]", "nearest_mode[1]", "frf_peak_frequency"],
    )
    assert (found["status"] == 1).all()
    assert np.isnan(found["natural_frequencies[1]"]).all()
    assert (found["nearest_mode[1]"] == 0).all()


def test_turning_crank_in_single_precision(tmp_path: Path) -> None:
    """A crank that turns has no limits, and its numbers repeat after ten turns."""
    save_table(four_bar(), tmp_path / "four_bar.npz")
    options = [str(tmp_path / "four_bar.npz"), "--single"]
    path = make(tmp_path / "four_bar.fmu", *options)
    assert validate_fmu(str(path)) == []
    found = [
        fmpy.simulate_fmu(
            str(path), start_values={"crank_angle": angle}, stop_time=0.1, fmi_type="ModelExchange"
        )["natural_frequencies[1]"][-1]
        for angle in (1.0, 1.0 + 20.0 * np.pi)
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-5)
    angle = fmpy.read_model_description(str(path)).modelVariables
    assert all(one.max is None for one in angle if one.name == "crank_angle")


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
        found = simulate(tmp_path / "fmu", interface, drive, STEP)
        assert min(differences(found, drive, STEP)) < 1e-9


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
    found = {one.name: one.description for one in description.modelVariables}
    assert found["margin[1]"].endswith('; a < b & "c" */ 1')


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


def test_sizes(tmp_path: Path) -> None:
    """Fewer cells make a smaller FMU."""
    sizes = []
    for options in ([], ["--tolerance", "1e-4"]):
        path = tmp_path / "x.fmu"
        table = str(config_file(PAPER_TABLE))
        assert main(["export", table, "--fmu", str(path), "--source-only", *options]) == 0
        sizes.append(path.stat().st_size)
    assert sizes[1] < sizes[0] / 2
