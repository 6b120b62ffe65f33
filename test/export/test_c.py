# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Exported C gives the same bits as Python, compiles without a warning, and runs elsewhere."""

import math
import re
import subprocess
from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
import yaml

from linkage_vibration.cli.main import main
from linkage_vibration.export.c_source import c_sources
from linkage_vibration.export.constants import (
    NAME,
    NUMBERS,
    Constants,
    Export,
    ExportError,
    constants_of,
    export_of,
)
from linkage_vibration.export.fmu import fmu_bytes
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.prediction.level_cache import kept_table
from linkage_vibration.prediction.predictor import Predictor, predict_many
from linkage_vibration.support.resources import (
    DEFAULT_TABLE,
    PAPER_MECHANISM,
    PAPER_TABLE,
    config_file,
)
from linkage_vibration.table.table import Table, load_table
from linkage_vibration.table.tabulation import build_table
from test.support.c_code import (
    COMPILERS,
    SANITIZERS,
    STRICT,
    TARGETS,
    Library,
    angles_to_test,
    compile_c,
    misra_rules,
    run_program,
    write,
)
from test.support.crossing import AT, GAP, RATIO, crossing_crank, meeting_off_axis
from test.support.programs import require

ANGLES = 20_000


def four_bar() -> Table:
    """Return the table of a crank that turns all the way, coarsely meshed."""
    mapping = yaml.safe_load(config_file("four_bar.yaml").read_text())
    for link in mapping["links"].values():
        link |= {"elements": 4, "modes": 2}
    mapping["response"] |= {"modes": 2, "band_hz": [0.0, 200.0]}
    mechanism = mechanism_from_mapping(mapping)
    return kept_table(mechanism, partial(build_table, LinkageModel(mechanism), 1e-3), "coarse")


def measured() -> Table:
    """Return the paper's table with standard deviations, as that of measured links has them."""
    table = load_table(config_file(PAPER_TABLE))
    spread = 0.01 * table.natural_frequencies * (1.0 + np.sin(50.0 * table.alpha3))[:, np.newaxis]
    return replace(table, frequency_stddev=spread, damping_ratio_stddev=1e-4 * spread)


def one_mode() -> Table:
    """Return the paper's table with a single mode."""
    table = load_table(config_file(PAPER_TABLE))
    names = "natural_frequencies", "damping_ratios"
    cubics = table.cell_cubics[:, :, [0, table.n_modes, -2, -1]]
    arrays = {name: getattr(table, name)[:, :1] for name in names}
    return replace(table, **arrays, cell_cubics=cubics)


TABLES = {
    "paper": lambda: load_table(config_file(PAPER_TABLE)),
    "tractor": lambda: load_table(config_file(DEFAULT_TABLE)),
    "turning": four_bar,
    "measured": measured,
    "one mode": one_mode,
}


@pytest.fixture(scope="module", params=TABLES)
def table(request: pytest.FixtureRequest) -> Table:
    """Return a table of each kind."""
    return TABLES[request.param]()


@pytest.fixture(scope="module")
def paper() -> Table:
    """Return the paper's table."""
    return TABLES["paper"]()


@pytest.fixture(scope="module")
def tractor() -> Table:
    """Return the shipped table."""
    return TABLES["tractor"]()


def stddevs_for(angles: Any) -> Any:
    """Return standard deviations of angles, rad: none, small, large, negative, and not known."""
    chosen = np.array([0.0, 1e-4, 0.3, -1e-3, math.nan])
    return chosen[np.arange(len(angles)) % 5].astype(angles.dtype)


def in_gaps(constants: Constants, angles: Any) -> Any:
    """Return which angles are in gaps, where an export lacks numbers that the table has."""
    inside = np.zeros(len(angles), bool)
    for start, end in constants.gaps:
        inside |= (start <= angles) & (angles < end)
    return inside


def assert_same_bits(actual: Any, expected: Any) -> None:
    """Compare two sets of predictions number by number; a NaN equals a NaN."""
    np.testing.assert_array_equal(actual["status"], expected.status)
    for name in NUMBERS:
        np.testing.assert_array_equal(actual[name], getattr(expected, name), name)


@pytest.mark.parametrize("compiler", COMPILERS)
def test_same_bits_as_python(table: Table, compiler: str, tmp_path: Path) -> None:
    """At 20,000 angles every number equals that of the node, also beside borders and in turns."""
    export = export_of(table)
    angles = angles_to_test(export.constants, ANGLES)
    stddevs = stddevs_for(angles)
    prediction = Library(tmp_path, export, compiler).predict(angles, stddevs)
    expected = predict_many(Predictor(table), angles, stddevs)
    outside = ~in_gaps(export.constants, angles)
    assert_same_bits(prediction[outside], expected.rows(outside))
    assert {0, 1, 2} <= set(prediction["status"].tolist())


def test_only_the_peak_is_lost_where_it_jumps(tractor: Table, tmp_path: Path) -> None:
    """In the gap where the peak jumps, every other number has the bits of the table."""
    tractor = tractor.vertical
    export = export_of(tractor)
    [(start, end)] = export.constants.gaps
    angles = np.linspace(start, end, 52)[1:-1]
    expected = predict_many(Predictor(tractor), angles, stddevs_for(angles))
    assert np.isfinite(expected.frf_peak_magnitude).all()
    assert np.ptp(expected.frf_peak_frequency) > 0.3
    prediction = Library(tmp_path, export).predict(angles, stddevs_for(angles))
    for name in NUMBERS:
        lost = name.startswith("frf_peak")
        exact = np.full(len(angles), np.nan) if lost else getattr(expected, name)
        np.testing.assert_array_equal(prediction[name], exact, name)


def equal_numbers(export: Export, folder: Path, compiler: str, *flags: str, **more: Any) -> float:
    """Return the share of numbers of a compiled program that have the bits of the node's."""
    angles = angles_to_test(export.constants)
    angles = angles[~in_gaps(export.constants, angles)]
    stddevs = stddevs_for(angles)
    rows = np.column_stack([angles, stddevs, np.zeros((len(angles), 3))])
    actual = run_program(export, rows, folder, compiler, "-ffp-contract=off", *flags, **more)
    expected = predict_many(Predictor(export.table), angles, stddevs)
    columns = [expected.status, *(getattr(expected, name) for name in NUMBERS)]
    node = np.column_stack(columns)
    np.testing.assert_allclose(actual, node, rtol=1e-9, atol=1e-12)
    return float(np.mean((actual == node) | np.isnan(node)))


@pytest.mark.parametrize(
    "table",
    [
        "measured",
        *(pytest.param(each, marks=pytest.mark.nightly) for each in TABLES if each != "measured"),
    ],
    indirect=True,
)
def test_sanitizers(table: Table, tmp_path: Path) -> None:
    """With the sanitizers of gcc, which find no fault, every number equals that of the node."""
    assert equal_numbers(export_of(table), tmp_path, require("gcc"), *SANITIZERS) == 1.0


@pytest.mark.parametrize("target", TARGETS)
def test_other_processors(tractor: Table, target: str, tmp_path: Path) -> None:
    """Compiled for another processor and run in an emulator, all numbers are equal.

    Those of i686, which computes with 80 bits, are close.
    """
    compiler, emulator = require(f"{target}-gcc"), require(TARGETS[target])
    flags = "-O2", "-fexcess-precision=fast", "-static"
    share = equal_numbers(export_of(tractor), tmp_path, compiler, *flags, emulator=[emulator])
    assert share == 1.0 or target.startswith("i686")


def test_microcontroller(paper: Table, tmp_path: Path) -> None:
    """A compiler for microcontrollers takes it."""
    export = export_of(paper)
    write(c_sources(export), tmp_path)
    compiler = require("arm-none-eabi-gcc")
    flags = "-mcpu=cortex-m7", "-mfloat-abi=hard", "-mfpu=fpv5-d16", "-mthumb"
    compile_c([compiler, *STRICT, "-O2", *flags, "-c", f"{export.name}.c"], tmp_path)


def test_misra(paper: Table, tmp_path: Path) -> None:
    """A checker of MISRA C:2012 finds no deviation that the source does not list."""
    files = c_sources(export_of(paper))
    rules = misra_rules(files, tmp_path)
    # cppcheck 2.10 does not see 8.7, and 2.22 takes the name "cell" for a literal with a suffix.
    assert {"2.5", "8.9"} <= rules <= {"2.5", "7.3", "8.7", "8.9"}
    for rule in rules - {"7.3"}:
        assert re.search(rf"^ \* +rules? {rule} ", files[f"{NAME}.c"], re.M)


NAMES = ["навеска", "*/ int main(void) { /*", 'a "quoted" \\ name ??/', "line\nbreak \u202e"]


@pytest.mark.parametrize("name", NAMES)
def test_names_of_mechanisms(paper: Table, name: str, tmp_path: Path) -> None:
    """Whatever the mechanism and its modes are called, the files compile."""
    names = (name,) * paper.n_modes
    export = export_of(paper)
    export = replace(export, table=replace(paper, mechanism_name=name, mode_names=names))
    write(c_sources(export), tmp_path)
    use = f'#include "{NAME}.h"\nconst char *const names[] = {NAME.upper()}_MODE_NAMES;\n'
    (tmp_path / "use.c").write_text(use)
    compile_c([require("gcc"), *STRICT, "-c", f"{NAME}.c", "use.c"], tmp_path)
    assert (tmp_path / f"{NAME}.h").read_text().isascii()


@pytest.mark.parametrize("name", ["", "9a", "a-b", "Hitch", "a" * 21, "hülle"])
def test_names_that_are_refused(paper: Table, name: str) -> None:
    """A name that cannot begin names in C, or is too long, is refused; twenty letters are not."""
    with pytest.raises(ExportError, match="cannot begin names in C; give up to 20"):
        export_of(paper, name=name)
    assert export_of(paper, name="a" * 20).name == "a" * 20


def test_names_differ_in_their_first_31_characters(tractor: Table) -> None:
    """With the longest name, all names in C that begin with it differ so early."""
    name = "a" * 20
    files = c_sources(export_of(tractor, name=name))
    words = {word for text in files.values() for word in re.findall(r"\w+", text)}
    names = {word for word in words if word.lower().startswith(name)}
    assert len(names) > 10
    assert len({word[:31] for word in names}) == len(names)


_BOTH = """
#include "first.h"
#include "second.h"
#include <stdio.h>
#include <string.h>
int main(void)
{
    static const char *const names[FIRST_MODES] = FIRST_MODE_NAMES;
    first_prediction one;
    second_prediction two;
    first_predict(0.5 * (FIRST_RANGE_LOW + FIRST_RANGE_HIGH), 0.0, &one);
    second_predict(0.5 * (SECOND_RANGE_LOW + SECOND_RANGE_HIGH), 0.0, &two);
    printf("%.17g %.17g %s %s %s\\n", one.natural_frequencies[0], two.natural_frequencies[0],
           names[3], SECOND_TABLE_ID, FIRST_VERSION);
    return strcmp(FIRST_TABLE_ID, SECOND_TABLE_ID) == 0;
}
"""


def test_two_tables_in_one_program(
    paper: Table, tractor: Table, tmp_path: Path, capsys: Any
) -> None:
    """Exports with two names link into one program, and each predicts by its own table."""
    for name, source in (("first", DEFAULT_TABLE), ("second", PAPER_TABLE)):
        table = str(config_file(source))
        assert main(["export", table, "--c", str(tmp_path), "--name", name]) == 0
    (tmp_path / "main.c").write_text(_BOTH)
    command = [require("gcc"), *STRICT, "-ffp-contract=off", "main.c", "first.c", "second.c"]
    compile_c([*command, "-lm", "-o", "run"], tmp_path)
    done = subprocess.run([tmp_path / "run"], capture_output=True, text=True)
    assert done.returncode == 0
    expected = [
        Predictor(each).predict(0.5 * sum(each.alpha3_range)).natural_frequencies[0]
        for each in (tractor, paper)
    ]
    words = f"{expected[0]:.17g} {expected[1]:.17g} mode 4 (tractor surge) {paper.table_id} "
    assert done.stdout.startswith(words)
    # Another table under the same name is refused, and nothing changes; the same one is not.
    before = (tmp_path / "first.h").read_bytes()
    again = ["--c", str(tmp_path), "--name", "first"]
    assert main(["export", str(config_file(PAPER_TABLE)), *again]) == 1
    assert f"an export of the table {tractor.table_id}, and is kept" in capsys.readouterr().err
    assert (tmp_path / "first.h").read_bytes() == before
    assert main(["export", str(config_file(DEFAULT_TABLE)), *again]) == 0
    (tmp_path / "first.h").write_text("/* of somebody else */")
    assert main(["export", str(config_file(DEFAULT_TABLE)), *again]) == 1
    assert "first.h is another file, and is kept" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("flags", "header", "words"),
    [
        (["-ffast-math"], "", "-ffast-math"),
        (["-ffinite-math-only"], "", "-ffinite-math-only"),
        ([], "#define DBL_MANT_DIG 24\n", "needs a double of IEEE 754 with 53 binary digits"),
    ],
)
def test_compilers_that_are_refused(
    paper: Table, tmp_path: Path, flags: list[str], header: str, words: str
) -> None:
    """Options without NaN, and a double of 32 bits, are refused; `-O3` is not."""
    write(c_sources(export_of(paper)), tmp_path)
    command = [require("gcc"), "-std=c99", "-I.", "-c", f"{NAME}.c"]
    compile_c([*command, "-O3"], tmp_path)
    if header:
        (tmp_path / "float.h").write_text(header)
    done = subprocess.run([*command, *flags], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode != 0
    assert words in done.stderr


def test_export_is_repeatable(paper: Table) -> None:
    """Two exports are equal, and name the table and the mechanism."""
    files = c_sources(export_of(paper))
    assert files == c_sources(export_of(paper))
    assert not any("malloc" in text for text in files.values())
    assert paper.table_id in files[f"{NAME}.h"]
    assert paper.mechanism_name in files[f"{NAME}.h"]


@pytest.mark.parametrize("unknown", [False, True])
def test_header_and_fmu_say_why_deviations_are_not_known(tractor: Table, unknown: bool) -> None:
    """If a deviation is NaN, the header and the description of an FMU have the table's reason."""
    deviations = tractor.parameter_stddev.copy()
    deviations[:, :, 0] = math.nan if unknown else 0.01
    export = export_of(replace(tractor, parameter_stddev=deviations))
    header = " ".join(c_sources(export)[f"{export.name}.h"].replace("\n * ", " ").split())
    with ZipFile(BytesIO(fmu_bytes(export, compiled=False))) as fmu:
        description = fmu.read("modelDescription.xml").decode()
    for text in (header, description):
        assert ("Standard deviations are not known where modes veer" in text) == unknown


def test_table_with_meeting_poles_is_refused() -> None:
    """Where poles nearly meet over much of the range, the error says where, and what to do."""
    dashpot, alpha3 = meeting_off_axis()
    stroke = (alpha3 - 5e-7, alpha3 + 5e-7)
    mechanism = crossing_crank(GAP, AT, RATIO, dashpot)
    mechanism = replace(mechanism, stroke=stroke, assembly_alpha3=stroke[0])
    table = build_table(LinkageModel(mechanism), 1e-2)
    with pytest.raises(ExportError, match=r"over .* deg of its range, from .* deg on, poles are"):
        constants_of(table)


def test_overdamped_mode(tmp_path: Path) -> None:
    """Beside the angle at which a mode vanishes is a tiny gap; everywhere else bits are equal."""
    mapping = yaml.safe_load(config_file(PAPER_MECHANISM).read_text())
    for link in mapping["links"].values():
        link |= {"elements": 4, "modes": 2}
    mapping["input"]["range_deg"] = [160.0, 165.0]
    mapping["springs"] = {"s": {"between": ["P2", "E1"], "damping": 1e5}}
    table = build_table(LinkageModel(mechanism_from_mapping(mapping)), 1e-3)
    export = export_of(table)
    constants = export.constants
    assert constants.gaps
    assert "are NaN there" in constants.gap_text
    assert "are NaN there" in c_sources(export)[f"{NAME}.h"]
    angles = angles_to_test(constants, 3000)
    stddevs = stddevs_for(angles)
    prediction = Library(tmp_path, export).predict(angles, stddevs)
    expected = predict_many(Predictor(table), angles, stddevs)
    inside = in_gaps(constants, angles)
    assert_same_bits(prediction[~inside], expected.rows(~inside))
    assert np.isnan(expected.natural_frequencies[~inside, 0]).any()  # it is overdamped
    assert np.isnan(prediction["natural_frequencies"][inside]).any()


def test_command(tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command writes two files into a new folder, and prints cells and sizes."""
    monkeypatch.chdir(tmp_path)
    source = str(config_file(PAPER_TABLE))
    assert main(["export", source, "--c", "new/folder"]) == 0
    names = {path.name for path in Path("new/folder").iterdir()}
    prefix = "linkage_vibration"
    assert names == {f"{prefix}.h", f"{prefix}.c"}
    out = capsys.readouterr().out
    equal = r"The numbers are those of the table, to the last bit\."
    assert re.search(rf" 117 cells, 3\d{{4}} bytes of constants\. {equal}", out)
    header = Path(f"new/folder/{prefix}.h").read_text()
    assert re.search(rf" 117 cells; 3\d{{4}} bytes of constants\.\n \* {equal}", header)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "Nothing is written; give --c DIR"),
        (["--c", "file"], "file: the folder cannot be created"),
        (["--fmu", "table.html"], r"the output is a .fmu file"),
        (["missing.npz", "--c", "out"], "missing.npz: cannot be read"),
    ],
)
def test_command_that_cannot_be_run(
    tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch, arguments: list[str], words: str
) -> None:
    """What is wrong is an error of one sentence."""
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    assert main(["export", *arguments]) == 1
    assert words in capsys.readouterr().err


def test_inputs_are_kept(tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A table whose name is that of a source file in the folder is not replaced."""
    monkeypatch.chdir(tmp_path)
    Path("linkage_vibration.c").write_bytes(config_file(PAPER_TABLE).read_bytes())
    before = Path("linkage_vibration.c").read_bytes()
    assert main(["export", "linkage_vibration.c", "--c", "."]) == 1
    assert "is an input" in capsys.readouterr().err
    assert Path("linkage_vibration.c").read_bytes() == before
