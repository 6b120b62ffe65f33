# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: one list for checks, files and the manual."""

import math
import re
from array import array
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import yaml

from linkage_vibration.prediction.inputs.presets import PRESETS
from linkage_vibration.prediction.parameter_files import parameters_yaml, read_parameters
from linkage_vibration.prediction.periods import Periods
from linkage_vibration.prediction.settings import ParameterError, Parameters, check_value
from linkage_vibration.support.resources import (
    DEFAULT_EXCITATIONS,
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    config_file,
    share_directory,
)
from tools.parameter_table import parameter_table, preset_table


def test_the_manual_has_the_tables() -> None:
    """The tables of presets and parameters in docs/node.md are those of the tool."""
    tables = preset_table(), parameter_table(usual=True), parameter_table(usual=False)
    text = (share_directory() / "docs/node.md").read_text()
    assert all(table in text for table in tables)
    rows = "".join(line.split("|")[1] for table in tables[1:] for line in table.splitlines()[2:])
    listed = [
        name.replace("INPUT", of)
        for name in re.findall(r"`(\w+)`", rows)
        for of in (PRESETS if "INPUT" in name else [""])
    ]
    assert sorted(listed) == sorted(each.name for each in fields(Parameters))


def test_parameter_file_has_every_parameter() -> None:
    """The example file lists every parameter with its default, in the order of the manual."""
    text = (share_directory() / "config" / "linkage_vibration.params.yaml").read_text()
    written = yaml.safe_load(text)["/**"]["ros__parameters"]
    expected = yaml.safe_load(parameters_yaml(Parameters(), "/**"))["/**"]["ros__parameters"]
    assert written == expected
    assert list(written) == list(expected)


def test_defaults_are_valid() -> None:
    """Every default passes its own check."""
    for parameter in fields(Parameters):
        assert check_value(parameter.name, parameter.default) == parameter.default


def test_whole_numbers_may_stand_for_doubles() -> None:
    """An integer is accepted for a double or a text, and no other type is converted.

    `ros2 param load` of rclpy reads 1e-05, as YAML writes a double, as a text.
    """
    assert check_value("hitch_scale", 2) == 2.0
    assert isinstance(check_value("hitch_scale", 2), float)
    assert check_value("joint_name", 5) == "5"
    assert check_value("hitch_offset", "1e-05") == 1e-5
    for name, value in (
        ("hitch_scale", True),
        ("hitch_sign", 1.0),
        ("record", 1),
        ("joint_name", True),
        ("joint_name", 5.0),
    ):
        with pytest.raises(ParameterError, match=name):
            check_value(name, value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("hitch_scale", 0.0),
        ("hitch_scale", "fast"),
        ("hitch_offset", math.nan),
        ("joint_name", ""),
        ("hitch_sign", 0),
        ("hitch_sign", True),
    ],
)
def test_what_is_not_valid_is_refused_in_words(name: str, value: object) -> None:
    """The error names the parameter, its valid values, its value, and an example."""
    with pytest.raises(ParameterError, match=f"{name} must be .*, not .*; write for example"):
        check_value(name, value)


@pytest.mark.parametrize("value", ["bad topic!", "/a//b"])
def test_what_is_not_valid_may_be_left_empty(value: str) -> None:
    """An empty text is no example of a value, so the error says what it is for."""
    with pytest.raises(ParameterError, match=r"must be .*, not .*; leave it empty if you do not"):
        check_value("hitch_topic", value)


def test_ranges_hold_at_their_ends() -> None:
    """A range includes its ends, and excludes NaN and everything outside."""
    assert check_value("near_margin", 0) == 0.0
    assert check_value("near_margin", 1.0) == 1.0
    for value in (-1e-9, 1.0 + 1e-9, math.nan, math.inf):
        with pytest.raises(ParameterError, match="near_margin must be 0 to 1"):
            check_value("near_margin", value)


@pytest.mark.parametrize(("name", "least"), [("prediction_rate", 0.001), ("resonance_rate", 1.0)])
def test_rates_are_not_limited_or_have_periods(name: str, least: float) -> None:
    """A period has at most 1000 s, whose ns fit 64 bits, and at most 1 s where warnings need it."""
    for value in (0.0, least, 1e4):
        assert check_value(name, value) == value
        Periods(value).due(np.array([2**63 - 1]))
    for value in (-1.0, 5e-324, 1e-10, 0.999 * least, 10001.0, math.nan):
        with pytest.raises(ParameterError, match=f"{name} must be 0, or {least:g} to 10000, not"):
            check_value(name, value)


def test_lists_of_numbers() -> None:
    """Arrays, lists and whole numbers are accepted as a calibration; text is not."""
    calibration = (0.0, 3.0, 50.0, 2.5, 100.0, 2.0)
    assert check_value("calibration", array("d", calibration)) == calibration
    assert check_value("calibration", [0, 3, 50, 2.5, 100, 2]) == calibration
    for value in ("0 100", ["0", "3", "100", "2"], 5.0, [True, False, True, False]):
        with pytest.raises(ParameterError, match="calibration"):
            check_value("calibration", value)


def test_calibration_in_degrees_is_refused() -> None:
    """Angles beyond a full turn are refused, and the same angle is given in rad."""
    with pytest.raises(ParameterError, match=r"calibration.*180 rad.* write 3\.14159\."):
        check_value("calibration", [0.0, 180.0, 100.0, 90.0])


def test_files_that_ship_stand_for_those_not_named() -> None:
    """Without names the files of the package are used; another mechanism has no table."""
    shipped = Parameters()
    assert shipped.mechanism_path() == config_file(DEFAULT_MECHANISM)
    assert shipped.table_path() == config_file(DEFAULT_TABLE)
    assert shipped.excitation_path() == config_file(DEFAULT_EXCITATIONS)
    assert shipped.log_path() == Path.cwd()
    other = Parameters(mechanism_file="~/linkage.yaml")
    assert (other.mechanism_path(), other.table_path()) == (Path.home() / "linkage.yaml", None)
    both = Parameters(mechanism_file="linkage.yaml", table_file="table.npz")
    assert both.table_path() == Path("table.npz").absolute()


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    """A written file of parameters can be read back."""
    path = tmp_path / "params.yaml"
    given = Parameters(
        hitch_sign=-1, hitch_scale=1e-3, calibration=(0.0, 3.0, 100.0, 1.5), near_margin=1e-10
    )
    for name in ("/linkage_vibration", "linkage_vibration", "/**"):
        path.write_text(parameters_yaml(given, name))
        assert read_parameters(path) == given
    assert read_parameters(config_file("linkage_vibration.params.yaml")) == Parameters()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("/**: {ros__parameters: {hitch_sign: 2}}", "sign must be 1 or -1, not 2"),
        ("/**: {ros__parameters: {near_margin: 1.5}}", "near_margin must be 0 to 1, not 1.5"),
        ("/**: {ros__parameters: {hitch_scale: far}}", "scale must be .* not 'far'"),
        ("/**: {ros__parameters: {hitch_scale: 1" + 400 * "0" + "}}", "too large"),
        ("/**: {ros__parameters: {recrod: true}}", r"recrod is unknown; did you mean record\?"),
        ("/**: {ros__parameters: {input: can}}", r"input is unknown; did you mean hitch_input\?"),
        ("/**: {ros__parameters: {sign: -1}}", r"sign is unknown; did you mean hitch_sign\?"),
        ("/**: {ros__parameters: {pto_scal: 2.0}}", r"did you mean pto_scale\?"),
        ("/**: {ros__parameters: {qqq: 1}}", "qqq is unknown; .* --help` lists what is valid"),
        ("other_node: {ros__parameters: {}}", "has no parameters for the node"),
        ("/tractor/linkage_vibration: {ros__parameters: {}}", "has no parameters for the node"),
        ("", "has no parameters for the node"),
        ("a: [", "cannot be read as YAML"),
    ],
)
def test_files_that_cannot_be_used(tmp_path: Path, text: str, words: str) -> None:
    """The error names the file, the parameter and the remedy."""
    path = tmp_path / "params.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError, match=f"params.yaml.*{words}"):
        read_parameters(path)
    with pytest.raises(ParameterError, match=r"missing.yaml.*No such file"):
        read_parameters(tmp_path / "missing.yaml")
