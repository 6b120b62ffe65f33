# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's command line: its help, and one sentence about whatever prevents the start."""

import os
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from linkage_vibration.drawing.live_line import LiveLine
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.ros.bag_player import play_bag, watch
from linkage_vibration.ros.command_line import StartError, check_arguments, refusal
from linkage_vibration.ros.node import main
from linkage_vibration.ros.spinning import run
from linkage_vibration.support.missing_library import missing_library
from linkage_vibration.support.resources import config_file

QOS = "qos_overrides./joint_states.subscription"
DRIVE = config_file("drives/hitch_duty_cycle.mcap")


@pytest.mark.parametrize(
    ("arguments", "unknown"),
    [
        (["joint_name:=boom"], "joint_name:=boom"),
        (["--params-file", "x"], "--params-file"),
        (["--ros-args", "-p", "hitch_sign:=1", "--", "--hlep"], "--hlep"),
    ],
)
def test_unknown_arguments(arguments: list[str], unknown: str) -> None:
    """Whatever is not behind --ros-args is refused, with the form that ROS 2 reads."""
    with pytest.raises(StartError, match=f"Argument {unknown} is unknown; .* `--ros-args -p PARA"):
        check_arguments(arguments)
    check_arguments(["--ros-args", "-p", "joint_name:=boom", "--"])


def test_errors_of_rcl_are_sentences() -> None:
    """The places in rcl's source code are left out, and lines become one."""
    error = RuntimeError("no security.\nPlease compile it, at /a/b.cpp:4, at /c.c:20")
    assert str(refusal(error)) == "ROS 2 cannot start: no security.; Please compile it."
    assert "Argument --params_file is unknown" in str(refusal(RuntimeError("['--params_file']")))


def test_help_lists_every_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    """The help is printed without starting ROS 2."""
    assert main(["linkage_vibration_node", "--help"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("usage: linkage_vibration_node")
    for parameter in fields(Parameters):
        assert f"\n  {parameter.name}\n" in printed


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-r", f"__node:={256 * 'a'}"], "cannot start: error creating node: invalid node"),
        (["-r", f"__node:={240 * 'a'}"], "cannot start: Invalid service name: topic length"),
        (["-r", f"__ns:=/{240 * 'a'}"], "choose another name."),
        (["--params_file", "x"], "--params_file is unknown; write"),
        (["-p", "calibration:=[]"], "given without a value, for example as an empty list"),
        (["-p", "use_simtime:=true"], "did you mean use_sim_time?"),
        (["-p", "use_sim_time:=1"], "Parameter use_sim_time must be true or false, not 1"),
        (["--log-level", "loud"], "does not use a valid severity level"),
        (["-p", "hitch_sign:=3"], "Parameter hitch_sign must be 1 or -1, not 3"),
        (["-p", "hitch_offset:=.nan"], "Parameter hitch_offset must be"),
        (["-p", "table_file:=/none.npz"], "/none.npz: cannot be read"),
        (["-r", "~/prediction:=/joint_states"], "is that of both an input and the output"),
        (["-p", "log_directory:=/none"], "log_directory must be a folder to which the node"),
        (["-p", f"{QOS}.depth:=0"], "depth must be 1 to 1000, not 0"),
        (["-p", f"{QOS}.reliability:=best"], "must be reliable or best_effort, not"),
    ],
)
def test_refusals(
    environment: dict[str, str], arguments: list[str], words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Whatever prevents the start, the node ends with a sentence and exit code 1."""
    assert run(["node", "--ros-args", *arguments], lambda: False) == 1
    assert words in capfd.readouterr().err.splitlines()[-1]


def test_files_without_parameters_for_the_node(
    environment: dict[str, str], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A node does not run on its defaults because a file names another node or namespace."""
    own, other = tmp_path / "own.yaml", tmp_path / "other.yaml"
    own.write_text("/**: {ros__parameters: {autostart: false}}")
    other.write_text("linkage_vibration: {ros__parameters: {joint_name: arm}}")
    named = ["node", "--ros-args", "-r", "__ns:=/tractor", "-r", "__node:=hitch"]
    assert run([*named, "--params-file", str(other)], lambda: True) == 1
    words = f"{other} has no parameters for the node; give them below `/tractor/hitch:` or `/**:`"
    assert words in capfd.readouterr().err.splitlines()[-1]
    both = ["--params-file", str(own), "--params-file", str(other)]
    assert run([*named, *both], lambda: True) == 0
    assert words in capfd.readouterr().err


def test_single_parameters_do_not_replace_a_file(
    environment: dict[str, str], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """By -p as from a launch file, which writes them to a file, they leave the rule as it is."""
    other, launched = tmp_path / "other.yaml", tmp_path / "launch_params_ab12"
    other.write_text("somebody: {ros__parameters: {joint_name: arm}}")
    launched.write_text("/linkage_vibration: {ros__parameters: {autostart: false}}")
    alone = ["node", "--ros-args", "-r", "__node:=linkage_vibration"]
    given = {"by -p": ["-p", "autostart:=false"], "launched": ["--params-file", str(launched)]}
    for single in given.values():
        assert run([*alone, "--params-file", str(other), *single], lambda: True) == 1
        assert f"{other} has no parameters" in capfd.readouterr().err.splitlines()[-1]
        assert run([*alone, *single], lambda: True) == 0
        assert "has no parameters" not in capfd.readouterr().err


def test_commands_without_security(
    environment: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """`play` refuses an invalid name, and security that is not set up, also with --watch."""
    with pytest.raises(StartError, match="Invalid topic name"):
        watch("bad name!", LiveLine(sys.stdout))
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    for start in (
        lambda: watch("/node", LiveLine(sys.stdout)),
        lambda: play_bag(DRIVE, Parameters(), {}, LiveLine(sys.stdout)),
    ):
        with pytest.raises(StartError, match="check ROS_SECURITY_KEYSTORE"):
            start()


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("zstandard", "run `pip install zstandard`"),
        ("yaml", "run `pip install PyYAML`"),
        ("rclpy", "source a ROS 2 installation (Jazzy or later)"),
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
