# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's command line: its help, and one sentence about whatever prevents the start."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import pytest

from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.ros.command_line import StartError, check_arguments, refusal
from linkage_vibration.ros.node import main
from linkage_vibration.support.missing_library import missing_library
from test.support.ros_process import until


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["joint_name:=boom"], "did you mean `--ros-args -p joint_name:=VALUE`"),
        (["--recrod"], "did you mean `--ros-args -p record:=VALUE`"),
        (["joint_states:=arm"], "did you mean `--ros-args -r joint_states:=TOPIC`"),
        (["__ns:=/a"], "did you mean `--ros-args -r __ns:=NAMESPACE`"),
        (["--params-file", "x"], "did you mean `--ros-args --params-file FILE`"),
        (
            ["--ros-args", "-p", "sign:=1", "--", "--hlep"],
            "--hlep is unknown; did you mean `--help`",
        ),
        (["7"], "`--help` lists what is valid"),
    ],
)
def test_unknown_arguments(arguments: list[str], words: str) -> None:
    """Whatever is not behind --ros-args is refused, with the closest valid argument."""
    with pytest.raises(StartError, match=words):
        check_arguments(arguments)
    check_arguments(["--ros-args", "-p", "joint_name:=boom", "--"])


def test_errors_of_rcl_are_sentences() -> None:
    """The places in rcl's source code are left out, and lines become one."""
    error = RuntimeError("no security.\nPlease compile it, at /a/b.cpp:4, at /c.c:20")
    assert str(refusal(error)) == "ROS 2 cannot start the node: no security.; Please compile it."
    assert "did you mean `--ros-args --params-file FILE`?" in str(
        refusal(RuntimeError("['--params_file']"))
    )


def test_help_lists_every_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    """The help is printed without starting ROS 2."""
    assert main(["linkage_vibration_node", "--help"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("usage: linkage_vibration_node")
    for parameter in fields(Parameters):
        assert f"\n  {parameter.name}\n" in printed


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        (256 * "a", [], "cannot start the node: error creating node: invalid node"),
        ("failed", ["-p", "recrod:=true"], "Parameter recrod is unknown; did you mean record?"),
        ("failed", ["--params_file", "x"], "did you mean `--ros-args --params-file FILE`?"),
    ],
)
def test_refusals_end_the_node(
    start: Callable[..., Any], name: str, arguments: list[str], words: str
) -> None:
    """The process ends with one sentence and exit code 1."""
    failed = start(*arguments, name=name)
    until(lambda: failed.process.poll() is not None, "the node's end")
    assert failed.process.returncode == 1
    [line] = failed.printed.splitlines()
    assert words in line


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("zstandard", "run `pip install zstandard`"),
        ("yaml", "run `pip install PyYAML`"),
        ("rclpy", "source a ROS 2 installation"),
        ("std_srvs", "source a ROS 2 installation"),
        ("linkage_vibration_interfaces", "build it with colcon"),
    ],
)
def test_missing_library_has_a_remedy(module: str, words: str) -> None:
    """The sentence names the library, and what to run."""
    sentence = missing_library(ModuleNotFoundError("none", name=f"{module}.part"))
    assert sentence.startswith(f"Python cannot import {module} ")
    assert words in sentence


@pytest.mark.parametrize("module", ["linkage_vibration.ros.node", "linkage_vibration.cli"])
def test_missing_library_ends_the_commands(module: str) -> None:
    """The node and the command line end with one sentence and exit code 1."""
    code = (
        "import runpy, sys; sys.modules['scipy'] = None; sys.argv[1:] = ['predict', '90'];"
        f"runpy.run_module('{module}', run_name='__main__')"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ
    )
    assert run.returncode == 1
    [line] = run.stderr.splitlines()
    assert "run `pip install scipy`" in line
