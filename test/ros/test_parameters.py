# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: one list for declaring, checking and the manual."""

from dataclasses import fields

import pytest

from linkage_vibration.resources import share_directory
from linkage_vibration.ros.parameters import (
    ParameterError,
    Parameters,
    check_value,
    parameter_table,
    parameters_yaml,
)


def test_readme_has_the_table() -> None:
    """The README's table of parameters is the one that the code gives."""
    assert parameter_table().strip() in (share_directory() / "README.md").read_text()


def test_parameter_file_has_every_parameter() -> None:
    """The file to begin from lists every parameter with its default."""
    text = (share_directory() / "config" / "linkage_vibration.params.yaml").read_text()
    lines = [line.split("#")[0].rstrip() for line in text.splitlines()]
    expected = parameters_yaml(Parameters(), "/**").splitlines()
    assert [line for line in lines if line] == expected


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


def test_crank_angle() -> None:
    """Angle = sign * scale * position + offset."""
    assert Parameters(sign=-1, scale=0.5, offset=2.0).crank_angle(0.25) == 1.875
