# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: one list for declaring, checking and the manual."""

import math
from array import array
from dataclasses import fields

import pytest
import yaml
from rclpy.parameter import Parameter

from linkage_vibration.inputs import JointInput, PercentInput
from linkage_vibration.resources import share_directory
from linkage_vibration.ros.parameters import (
    ParameterError,
    Parameters,
    changed,
    check_value,
    in_own_types,
    parameter_table,
    parameters_yaml,
)


def test_readme_has_the_table() -> None:
    """The README's table of parameters is the one that the code gives."""
    assert parameter_table().strip() in (share_directory() / "README.md").read_text()


def test_parameter_file_has_every_parameter() -> None:
    """The file to begin from lists every parameter with its default, in the manual's order."""
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
    """YAML's 2 is taken as 2.0 where a double is wanted, and nothing else is bent."""
    assert check_value("scale", 2) == 2.0
    assert isinstance(check_value("scale", 2), float)
    for name, value in (("scale", True), ("sign", 1.0), ("record", 1), ("joint_name", 5)):
        with pytest.raises(ParameterError, match=name):
            check_value(name, value)


@pytest.mark.parametrize(
    ("name", "value"),
    [("scale", 0.0), ("scale", "fast"), ("offset", math.nan), ("joint_name", ""), ("sign", 0)],
)
def test_what_is_not_valid_is_refused_in_words(name: str, value: object) -> None:
    """The parameter, what it must be, what it is, and an example."""
    with pytest.raises(ParameterError, match=f"{name} must be .*, not .*; write for example"):
        check_value(name, value)


def test_ranges_hold_at_their_ends() -> None:
    """A range includes its ends, refuses what is beyond, and NaN."""
    assert check_value("warning_margin", 0) == 0.0
    assert check_value("warning_margin", 1.0) == 1.0
    for value in (-1e-9, 1.0 + 1e-9, math.nan, math.inf):
        with pytest.raises(ParameterError, match="warning_margin must be 0 to 1"):
            check_value("warning_margin", value)


def test_lists_of_numbers() -> None:
    """Arrays, lists and whole numbers make a calibration; what holds no numbers does not."""
    assert check_value("percent_points", array("d", [0.0, 100.0])) == (0.0, 100.0)
    assert check_value("percent_points", [0, 50, 100]) == (0.0, 50.0, 100.0)
    for value in ("0 100", ["0", "100"], 5.0, [True, False]):
        with pytest.raises(ParameterError, match="percent_points"):
            check_value("percent_points", value)


def test_inputs_are_what_was_asked_for() -> None:
    """The joint's rule or the calibration make angles; one that cannot be used names its keys."""
    joint = Parameters(sign=-1, scale=0.5, offset=2.0, angle_stddev=0.1).crank_input()
    assert joint == JointInput("hitch_rockshaft_joint", -1, 0.5, 2.0, 0.1)
    assert isinstance(Parameters(input="percent").crank_input(), PercentInput)
    with pytest.raises(ParameterError, match="percent_points, percent_angles: .*point 2"):
        Parameters(input="percent", percent_angles=(1.0, 1.0)).crank_input()


def test_what_may_be_set() -> None:
    """Live parameters at any time, the others while not configured, and none that is not valid."""
    settings = Parameters()
    live, other = Parameter("warning_margin", value=0.2), Parameter("log_directory", value="/tmp")
    found, result = changed(settings, [live], configured=True)
    assert (found.warning_margin, result.successful) == (0.2, True)
    found, result = changed(settings, [live, other], configured=True)
    assert found == settings
    assert "log_directory is read when the node is configured" in result.reason
    found, result = changed(settings, [live, other], configured=False)
    assert (found.log_directory, found.warning_margin) == ("/tmp", 0.2)
    found, result = changed(settings, [Parameter("use_sim_time", value=True)], configured=True)
    assert (found, result.successful) == (settings, True)


def test_whole_numbers_are_set_as_doubles() -> None:
    """What ROS would refuse for its type is turned before; what means something else is not."""
    asked = [Parameter("stale_after", value=2), Parameter("sign", value=-1)]
    stale_after, sign = in_own_types(asked)
    assert (stale_after.value, type(stale_after.value)) == (2.0, float)
    assert (sign.value, type(sign.value)) == (-1, int)
