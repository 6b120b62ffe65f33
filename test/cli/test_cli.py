# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The command line."""

import base64
import csv
import math
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

import linkage_vibration.cli
from linkage_vibration.cli.build import _description
from linkage_vibration.cli.main import ROUTES, SUBCOMMANDS, argument_parser, main
from linkage_vibration.cli.predict import print_columns
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import DEFAULT_MECHANISM, DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> Any:
    """Return a function that calls the command in an empty folder: its code and what it prints."""
    monkeypatch.chdir(tmp_path)

    def called(*arguments: str) -> SimpleNamespace:
        code, (out, err) = main(arguments), capsys.readouterr()
        return SimpleNamespace(returncode=code, stdout=out, stderr=err)

    return called


def test_subcommands() -> None:
    """Each module that is not shared is a subcommand, and the parser is built without NumPy."""
    folder = Path(linkage_vibration.cli.__file__).parent
    names = {path.stem for path in folder.glob("*.py")} - {
        "__init__",
        "__main__",
        "arguments",
        "main",
    }
    assert sorted(SUBCOMMANDS) == sorted(names)
    code = "import sys; from linkage_vibration.cli.main import argument_parser as a; a(); "
    code += "sys.exit('numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_help_and_former_names(capsys: Any) -> None:
    """Help lists each command once, in three routes; a former name says what it is now."""
    with pytest.raises(SystemExit):
        main(["--help"])
    printed = capsys.readouterr().out
    assert len(SUBCOMMANDS) == 14
    assert all(len(re.findall(rf"^  {name} ", printed, re.MULTILINE)) == 1 for name in SUBCOMMANDS)
    assert all(f"\n\n{route}:\n" in printed for route in ROUTES)
    with pytest.raises(SystemExit) as ended:
        main(["summary", "log.mcap"])
    assert ended.value.code == 2
    assert capsys.readouterr().err == "linkage-vibration: 'summary' is now 'review --json'.\n"


def test_a_table_knows_its_mechanism(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """A table names a shipped mechanism, or the one beside it; a mechanism finds its table."""
    monkeypatch.chdir(tmp_path)
    table = config_file("tables/three_point_linkage.npz")
    assert main(["pose", str(table), "120"]) == 0
    shutil.copy(table, "hitch.npz")
    text = config_file("three_point_linkage.yaml").read_text()
    Path("hitch.yaml").write_text(text)
    capsys.readouterr()
    assert main(["predict", "hitch.yaml", "120"]) == 0
    by_mechanism = capsys.readouterr()
    assert by_mechanism.err == "The table hitch.npz is used.\n"
    assert main(["predict", "hitch.npz", "120"]) == 0
    by_table = capsys.readouterr()
    assert (by_table.out, by_table.err) == (by_mechanism.out, "")
    assert main(["predict", "120"]) == 0
    assert "No mechanism is given; this is the shipped" in capsys.readouterr().err


def test_a_table_is_built_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """The second command prints the same without building, from a file in the cache folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    shutil.copy(config_file("four_bar.yaml"), tmp_path / "own.yaml")
    printed = []
    for said in (True, False):
        assert main(["predict", str(tmp_path / "own.yaml")]) == 0
        out, err = capsys.readouterr()
        assert ("Building the table" in err) == said
        printed.append(out)
    assert printed[0] == printed[1]


def test_build_writes_a_table(run: Any, tmp_path: Path, printed: Mechanism) -> None:
    """Build writes a table for the mechanism, and prints its error and the solutions it took."""
    source = str(config_file("three_point_linkage_as_printed.yaml"))
    done = run("build", source, "--tolerance", "1e-4", "--frf-points", "E1")
    assert done.returncode == 0
    table = load_table(tmp_path / "three_point_linkage_as_printed.npz", printed)
    assert f"{table.interpolation_error.max():.1e}" in done.stdout
    assert table.table_id in done.stdout
    assert table.places == (("E1", "z"), ("E1", "x"))  # that of the response first
    assert " solutions" in done.stdout


INERTIAS = {"roll": 550.0, "yaw": 650.0}  # kg m2, of the shipped implement of 800 kg


def printed_columns(text: str) -> list[list[str]]:
    """Return what `predict` prints for each angle: the angle, frequencies, and the peak."""
    columns = list[list[str]]()
    for block in text.split("alpha3")[1:]:
        rows = [line.partition("] ")[2].split() for line in block.splitlines() if "] " in line]
        columns += map(list, zip(*rows, strict=True))
    return columns


def test_predict_prints_what_the_predictor_says(run: Any) -> None:
    """There is one column for each angle; an angle out of range says so and sets the exit code."""
    done = run("predict", "90", "140", "180")
    assert done.returncode == 0
    predictor = Predictor(load_table(config_file("tables/three_point_linkage_on_tractor.npz")))
    first = predictor.predict(90.0 * 3.141592653589793 / 180.0).natural_frequencies[0]
    assert f"{first:.4f}" == printed_columns(done.stdout)[0][1]
    shares = run("predict", "140", "--shares", "--angle-stddev-deg", "1").stdout
    expected = predictor.shares(140.0 * 3.141592653589793 / 180.0, 3.141592653589793 / 180.0)
    rows = [line.split()[-4] for line in shares.splitlines() if re.match(r"mode[^]]*$", line)]
    assert rows == [f"{value:.3g}" for value in expected.angle.ravel().tolist()]
    exact = run("predict", "140", "--shares").stdout  # without the option, the angle is exact
    rows = [line.split()[-4] for line in exact.splitlines() if re.match(r"mode[^]]*$", line)]
    assert rows == ["0"] * expected.angle.size
    outside = run("predict", "200", "2.3")
    assert outside.returncode == 1
    assert "OUT_OF_RANGE" in outside.stdout
    assert "angle 200 deg is not in the table's 90 to 180 deg.\n" in outside.stdout
    assert "; 2.3 rad is in range, so were radians given in place of degrees?\n" in outside.stdout


def test_predict_over_a_range(tmp_path: Path, capsys: Any) -> None:
    """A range has both ends, in either direction; the CSV file has the printed columns."""
    path = tmp_path / "heights.csv"
    assert main(["predict", "90:180:30", "175:165:-5", "--csv", str(path)]) == 0
    printed = printed_columns(capsys.readouterr().out)
    assert [float(row[0]) for row in printed] == [90, 120, 150, 180, 175, 170, 165]
    with path.open() as file:
        written = list(csv.DictReader(file))
    assert [float(row["crank_angle_deg"]) for row in written] == [90, 120, 150, 180, 175, 170, 165]
    assert [f"{float(row['natural_frequency_4_hz']):.4f}" for row in written] == [
        row[4] for row in printed
    ]
    assert [f"{float(row['frf_peak_magnitude_m_per_n']):.4e}" for row in written] == [
        row[14] for row in printed
    ]
    thin = ["predict", "100:100.3:0.1"]  # 0.1 has no exact value; the last angle must not be lost
    assert main(thin) == 0
    assert len(printed_columns(capsys.readouterr().out)) == 4


@pytest.mark.parametrize("angles", ["90:180", "90:180:-5", "90:180:0", "90:nan:5"])
def test_ranges_that_are_refused(angles: str, capsys: Any) -> None:
    """What is no angle, has no step or leads away from the last angle is refused with the form."""
    with pytest.raises(SystemExit):
        main(["predict", angles])
    assert f"'{angles}' is no angle and no FIRST:LAST:STEP." in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["predict", "90:180:1e-4"])
    assert "has over 100000 numbers" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "name", "value"),
    [
        (["predict", "-90:-80:5"], "angles_deg", [-90.0, -85.0, -80.0]),
        (["predict", "-.5:0:.5", "-1e1", "--shares"], "angles_deg", [-0.5, 0.0, -10.0]),
        (["plot", "3.yaml", "-90"], "mechanism", Path("3.yaml")),
        (["plot", "3.yaml", "-90"], "angles_deg", [-90.0]),
        (["pose"], "mechanism", None),
        (["measure", "-120:a.csv", "-9:b.csv"], "recordings", ["-120:a.csv", "-9:b.csv"]),
        (["pose", "-90", "-1e-3"], "angles_deg", [-90.0, -1e-3]),
        (["calibrate", "--readings", "-43.2=-38.2"], "readings", ["-43.2=-38.2"]),
        (["pose", "-o", "x.png"], "output", Path("x.png")),
    ],
)
def test_words_that_begin_with_minus(words: list[str], name: str, value: object) -> None:
    """Such a word is a number, alone or with what follows; only letters after it make an option."""
    assert vars(argument_parser().parse_args(words))[name] == value


@pytest.mark.parametrize("deviation", ["-1", "inf"])
def test_deviations_that_are_refused(deviation: str, capsys: Any) -> None:
    """A standard deviation is a number from 0."""
    with pytest.raises(SystemExit):
        main(["predict", "120", "--angle-stddev-deg", deviation])
    assert f"'{deviation}'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("build", "none.yaml"), "none.yaml: cannot be opened"),
        (("build", "--tolerance", "0"), "1e-11"),
        (("build", "--frf-points", "Q"), "no point Q"),
        (("build", "-o", "none/table.npz"), "cannot be written"),
        (("predict", "none.npz", "140"), "none.npz: cannot be read"),
        (("build", "--plan", "--points", "E1"), "a direction after each point"),
        (("build", "--plan", "--tolerance", "0"), "from 1e-9 to 1"),
    ],
)
def test_errors_are_one_sentence(
    run: Any, tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    """An error is one line without a traceback, and the exit code is 1."""
    done = run(*arguments)
    assert done.returncode == 1
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.rglob("*.npz")), os.listdir(tmp_path)


def test_plan_chooses_and_measures(run: Any, tmp_path: Path) -> None:
    """Plan prints its choice and the measured errors, and writes the chosen mechanism."""
    asked = ("--band-hz", "0", "40", "--points", "E1", "z", "--tolerance", "1e-3")
    done = run("build", "--plan", *asked, "--angle-deg", "120", "-o", "planned.yaml")
    assert done.returncode == 0, done.stderr
    assert "elements a link" in done.stdout
    assert "measured" in done.stdout
    planned = read_mechanism(tmp_path / "planned.yaml")
    assert planned.response.band == (0.0, 40.0)
    assert planned.response.peak_band == (4.7, 40.0)  # that of the file begins at 4.7 Hz
    assert planned.links[0].modes < 20


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        (("replay", "a.mcap", "-o", "x.csv"), r"use x\.mcap"),
        (("replay", "a.mcap", "-o", "x.db3"), r"use x\.mcap\.$"),
        (("review", "a.mcap", "-o", "x.csv"), r"use x\.html"),
        (("review", "a.mcap", "--csv", "x.mcap"), r"use x\.csv"),
        (("review", "a.mcap", "--png", "x.html"), r"use x\.png"),
        (("recover", "a.mcap", "-o", "x.csv"), r"use x\.mcap"),
        (("build", "-o", "x.yaml"), r"use x\.npz"),
        (("pose", "-o", "x.svg"), r"use x\.png"),
        (("predict", "120", "--csv", "x.xlsx"), r"use x\.csv"),
    ],
)
def test_output_of_another_format(
    words: tuple[str, ...],
    remedy: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A suffix of another format is refused before anything is read, and names the right option."""
    monkeypatch.chdir(tmp_path)
    assert main(words) == 1
    assert re.search(remedy, capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", [["build"], ["build", "--plan"]])
def test_output_that_cannot_be_written(run: Any, command: list[str]) -> None:
    """It is refused before the work begins."""
    for output, problem in (("", "is a folder"), ("no/such.file", "create it")):
        done = run(*command, "-o", output)
        assert done.returncode == 1
        assert problem in done.stderr


def test_calibration_without_starts(run: Any) -> None:
    """A number of starting points below 1 is refused."""
    done = run("calibrate", "paper.yaml", "--starts", "0")
    assert done.returncode == 1
    assert "--starts is 0; give 1 or more" in done.stderr


@pytest.mark.parametrize("command", ["calibrate", "build"])
def test_file_that_does_not_exist(run: Any, command: str) -> None:
    """The error names the file once."""
    done = run(command, "nope")
    assert done.returncode == 1
    assert done.stderr.count("nope") == 1


def test_plot(tmp_path: Path, capsys: Any) -> None:
    """The PTO loads most where its tines meet the implement's heave, in list and map alike.

    Without loads it says so.
    """
    picture = tmp_path / "linkage.png"
    assert main(["plot", "-o", str(picture)]) == 0
    engine, pto, ground, _, title, head, *rows, left, _ = capsys.readouterr().out.splitlines()
    assert picture.read_bytes().startswith(b"\x89PNG")
    match = re.search(r"up to (\S+) of its force at rest, at (\d+) deg and (\d+) rpm", pto)
    assert match is not None
    assert main(["predict", match[2]]) == 0
    heave = float(printed_columns(capsys.readouterr().out)[0][8])
    assert 2 * 0.45 * float(match[3]) / 60.0 == pytest.approx(heave, rel=0.03)
    assert "Above the limit of 0.33 are speeds" in pto
    assert "which is not above the limit of 0.33." in engine
    assert "km/h" in ground
    assert title.endswith("PTO 200 rpm to 1100 rpm, ground 2 km/h to 50 km/h:")
    loads = [float(row.split()[-2]) for row in rows]
    assert head.split()[-3:] == ["load", "ratio", "factor"]
    assert len(loads) == 10
    assert float(match[1]) >= loads[0]
    assert rows[0].split()[-5:-3] == [match[2], match[3]]
    assert loads == sorted(loads, reverse=True)
    assert left.startswith("Of 7 more, the largest known load ratio is 0.00")
    alone = tmp_path / "engine.yaml"
    alone.write_text("engine: {speed: engine, orders: [3]}\n")
    assert main(["plot", "--excitations", str(alone), "-o", str(picture)]) == 0
    assert capsys.readouterr().out.startswith("The load ratio by the engine is not known")
    alone.write_text(
        "engine: {speed: engine, orders: [3]}\n"
        "shaft: {speed: engine, orders: [1], force: [9.0], at: E1.z, at_speed: 2000.0}\n"
    )
    assert main(["plot", "--excitations", str(alone), "-o", str(picture)]) == 0
    assert "(without engine 3, which have no amplitude)" in capsys.readouterr().out
    # Above 1000 rpm, order 12 is beyond the table, and order 3 meets the implement's pitch.
    alone.write_text(
        "slow: {speed: engine, orders: [3], force: [900.0], at: E1.z, at_speed: 2000.0}\n"
        "fast: {speed: engine, orders: [12], force: [9.0], at: E1.z, at_speed: 2000.0}\n"
    )
    assert main(["plot", "--excitations", str(alone), "-o", str(picture)]) == 0
    engine, _, _, _, first, *_ = capsys.readouterr().out.splitlines()
    assert first.split()[:2] == ["slow", "3"]
    assert f"up to {first.split()[-2]} of its force at rest" in engine
    assert "(without what is not known there)" in engine
    assert engine.endswith("Where the map is grey, the load ratio is not fully known.")


def test_masses_of_the_implement(tmp_path: Path, capsys: Any) -> None:
    """Frequencies are those of the model with each mass, and the largest peak has a mass."""
    mapping = yaml.safe_load(config_file(DEFAULT_MECHANISM).read_text())
    del mapping["uncertainty"]  # which takes most of the time
    source = tmp_path / "exact.yaml"
    source.write_text(yaml.safe_dump(mapping, sort_keys=False))
    assert main(["predict", str(source), "120", "--implement-mass", "900:1500:600"]) == 0
    printed = capsys.readouterr()
    light, heavy = printed_columns(printed.out)
    assert re.findall("With .*", printed.out) == ["With 900 kg:", "With 1500 kg:"]
    for mass, column in (900.0, light), (1500.0, heavy):
        values = {"rigid_bodies.implement.mass": mass}  # and inertias across change as it does
        values |= {f"lateral.inertia.implement.{k}": v * mass / 800.0 for k, v in INERTIAS.items()}
        changed = read_mechanism().with_values(values)
        halves = LinkageModel(changed).halves
        modes = [half.solve(math.radians(120.0)).natural_frequencies[:6] for half in halves]
        found = sorted(float(word) for word in column[1:13])
        assert found == pytest.approx(np.sort(modes, axis=None), rel=1e-4)
    peak = max(light[-1], heavy[-1], key=float)
    assert peak == light[-1]
    worst = printed.out.splitlines()[-1]
    assert worst == f"The largest peak of these masses is {peak} m/N, at 120 deg with 900 kg."
    assert "The implement has 900, 1500 kg" in printed.err
    assert main(["predict", "--implement-mass", "900:1500", "--csv", str(tmp_path / "x.csv")]) == 1
    assert "--csv has the predictions of one mass" in capsys.readouterr().err


@pytest.mark.nightly(short="test_masses_of_the_implement")
def test_worst_of_several_masses(tmp_path: Path, capsys: Any) -> None:
    """A plot and advice name the mass that loads most."""
    picture = str(tmp_path / "linkage.png")
    assert main(["plot", "--implement-mass", "900:1500:600", "-o", picture]) == 0
    out = capsys.readouterr().out
    assert out.count("with an implement of 900 kg") == 3
    assert "factor   mass [kg]" in out
    assert main(["advise", "165", "30", "--implement-mass", "900:1500:600"]) == 0
    head, now, *_ = capsys.readouterr().out.splitlines()
    assert (head.split()[-2:], now.split()[-1]) == (["mass", "[kg]"], "900")


@pytest.mark.parametrize("mass", ["300:300", "300:x", "300:900:-3"])
def test_masses_that_are_refused(mass: str, capsys: Any) -> None:
    """A range needs two different ends, and a step from the first to the last."""
    with pytest.raises(SystemExit):
        main(["predict", "--implement-mass", mass])
    assert "is no mass and no FIRST:LAST:STEP." in capsys.readouterr().err
    options = argument_parser().parse_args(["plot", "--implement-mass", "300:1500"])
    assert options.implement_mass == [300.0, 600.0, 900.0, 1200.0, 1500.0]
    options = argument_parser().parse_args(["plot", "--implement-mass", "700"])
    assert options.implement_mass == [700.0]


def test_plot_as_a_page(tmp_path: Path, capsys: Any) -> None:
    """The page has the sentences and the picture in itself; another ending is refused."""
    alone = tmp_path / "engine.yaml"
    alone.write_text("engine: {speed: engine, orders: [3]}\n")
    page = tmp_path / "linkage.html"
    assert main(["plot", "--excitations", str(alone), "-o", str(page)]) == 0
    text, sentence = page.read_text(), capsys.readouterr().out.splitlines()[0]
    assert f"<p>{sentence}</p>" in text
    assert "<td>engine 3</td><td>mode 10 (implement pitch)</td>" in text
    assert "<td>not known</td><td>no amplitude is given</td>" in text
    assert "three_point_linkage_on_tractor</h1>" in text
    match = re.search(r'src="data:image/png;base64,([^"]+)"', text)
    assert match is not None
    assert base64.b64decode(match[1]).startswith(b"\x89PNG")
    assert "http" not in text.replace("http://www.w3.org", "")
    assert main(["plot", "-o", str(tmp_path / "linkage.foo")]) == 1
    assert "linkage.foo: a plot is a .png or an .html file" in capsys.readouterr().err


def test_advise(tmp_path: Path, capsys: Any) -> None:
    """Table and CSV show the same advice; a reversed range is refused."""
    csv = tmp_path / "map.csv"
    range_ = ["--angles-deg", "100", "160", "--speeds-kmh", "10", "40"]
    given = ["advise", "165", "30", *range_, "--engine-rpm", "1800"]
    assert main([*given, "--csv", str(csv)]) == 0
    printed = capsys.readouterr().out.splitlines()
    rows = [line.split(",") for line in csv.read_text().splitlines()[1:]]
    loads = {(float(row[0]), float(row[1])): float(row[2]) for row in rows}
    assert len(loads) == 91 * 17
    (angle, speed), least = min(loads.items(), key=lambda item: item[1])
    both = printed[4].removeprefix("quietest both").split()
    assert float(both[0]) == pytest.approx(math.degrees(angle), rel=1e-3)
    assert float(both[1]) == pytest.approx(3.6 * speed, rel=1e-3)
    assert float(both[2]) == pytest.approx(least, rel=1e-3)
    assert printed[6].startswith("Not counted, as their loads are not known: pto_shaft 1")
    ends = [[word.end() for word in re.finditer(r"\S+", line)] for line in (printed[0], printed[4])]
    titles = ("[deg]", "[km/h]", "ratio", "factor", "[mm/s]", "factor", "[%]")
    columns = [k for k, word in enumerate(printed[0].split()) if word in titles]
    assert [ends[0][k] for k in columns] == ends[1][2:]  # numbers end where their titles do
    assert main(["advise", "165", "30", "--speeds-kmh", "40", "10"]) == 1
    assert (
        "The permitted ground speeds are 11.1111 to 2.77778 m/s (40 to 10 km/h)"
        in capsys.readouterr().err
    )
    assert main(["advise", "200", "30"]) == 1
    assert "How strongly it is loaded now is not known: " in capsys.readouterr().out
    # At its own quietest height, with no other speed, nothing is advised.
    assert main(["advise", "133", "30", "--angles-deg", "133", "134", "--engine-rpm", "1800"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[3].startswith("quietest speed    none: nothing permitted has a smaller load")


@pytest.mark.parametrize("known", [True, False])
def test_build_says_why_deviations_are_not_known(known: bool) -> None:
    """The last line is the reason why standard deviations are NaN, if any is."""
    mechanism = read_mechanism(config_file(DEFAULT_MECHANISM))
    table = load_table(config_file(DEFAULT_TABLE), mechanism)
    deviations = np.full(table.parameter_stddev.shape, 0.01 if known else math.nan)
    changed = replace(table, parameter_stddev=deviations)
    *_, line = _description(changed, 1, Path("table.npz"), mechanism)
    assert line.startswith("Standard deviations are not known: at each angle") != known


@pytest.mark.parametrize(("width", "each"), [(88, 1), (76, 2), (77, 1), (99, 1)])
def test_columns_of_a_prediction_fit_in_a_line(width: int, each: int, capsys: Any) -> None:
    """Of 100 characters, names take their width, and each column 12; at least one is printed."""
    print_columns(["", "n" * width], [["1", "2"], ["3", "4"]])
    lines = capsys.readouterr().out.splitlines()
    assert [len(line.split()) for line in lines[::2]] == ([2] if each == 2 else [1, 1])
    assert lines[1].startswith("n" * width)
